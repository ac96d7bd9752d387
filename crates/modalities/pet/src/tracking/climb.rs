//! To the top of the likelihood: damped Newton steps on SE(3), shares by EM on the way.
//!
//! Step: `(H + λ D) δ = g`, H the observed information (with the prior's, where it is contained), D its diagonal kept above a floor.
//! λ is 0 where H is positive definite and the last step raised the objective; else it grows until both hold. Between steps the
//! shares move to their expectation under a Dirichlet prior about the nominal ones, the background's under a Beta prior about the
//! last window's: a window of 54 lines alone says too little of them.

use super::failure::Failure;
use super::likelihood::{Evaluation, Likelihood, Weights};
use super::window::Window;
use crate::coverage::Coverage;
use lumenav_core::pose::{ominus, oplus, right_jacobian_inverse_so3};
use nalgebra::{Cholesky, Const, Isometry3, Matrix6, Vector3, Vector6};
use std::sync::Arc;

/// Steps before giving up; a warm start needs four, a poor one fifteen.
const MAX_STEPS: u32 = 40;
/// A climb ends with a step shorter than the root of this many standard deviations: a tenth, and the square of that is left behind it.
pub(crate) const FINE: f64 = 1e-2;
/// As [`FINE`], where tops are compared and odds of e^3 decide: a fifth of a standard deviation.
pub(crate) const COARSE: f64 = 4e-2;
/// Longest step, m and rad: beyond it the quadratic form has nothing to say.
const LONGEST_M: f64 = 4e-3;
const LONGEST_RAD: f64 = 0.5;
/// Floor of D per effective line: a line of 3 mm standard deviation, and the same on an arm of 5 mm.
const FLOOR_POSITION: f64 = 1.0 / (3e-3 * 3e-3);
const FLOOR_ROTATION: f64 = FLOOR_POSITION * 5e-3 * 5e-3;
/// Objectives that differ by less per near line are one: what single precision leaves of the logarithm of a density.
const SAME: f64 = 2e-6;
/// First damping after a refused step.
const FIRST_DAMPING: f64 = 0.1;
/// Strength of the prior of the markers' shares, lines: activities are known to some per cent, what the scanner sees of them is computed,
/// attenuation hardly differs over 13 mm.
const SHARE_LINES: f64 = 200.0;
/// Strength of the background's prior, lines: half a window of the thinnest row.
const BACKGROUND_LINES: f64 = 25.0;
/// Spread evenly over the markers, whatever the scanner sees of them: none is without a voice.
const LEAST_SEEN: f64 = 0.03;
/// A background of none or of all would leave the other without a voice.
const BACKGROUND_LIMITS: [f64; 2] = [0.01, 0.97];

/// A normal prior of the pose.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NormalPrior {
    pub(crate) mean: Isometry3<f64>,
    pub(crate) information: Matrix6<f64>,
}

/// The shares before a window.
#[derive(Clone, Debug, Default)]
pub(crate) struct SharePrior {
    /// Shares of the activity.
    pub(crate) shares: Vec<f64>,
    /// What the scanner sees of a marker from where it is.
    pub(crate) coverage: Arc<Coverage>,
    /// Where the scanner stands in the lines' frame, m.
    pub(crate) scanner_world_m: Vector3<f64>,
    pub(crate) background: f64,
}

impl SharePrior {
    /// Shares of the lines of markers at a pose: activity times solid angle. Where the scanner sees
    /// none of the markers, those of the activity.
    pub(crate) fn at(&self, likelihood: &Likelihood, pose: &Isometry3<f64>, shares: &mut Vec<f64>) {
        shares.clear();
        for (activity, at) in self.shares.iter().zip(&likelihood.markers_capsule_m) {
            let place = pose.transform_point(&(*at).into()).coords - self.scanner_world_m;
            shares.push(activity * self.coverage.solid_angle_sr(&place));
        }
        let total: f64 = shares.iter().sum();
        if !(total > 0.0) {
            return shares.clone_from(&self.shares);
        }
        let least = LEAST_SEEN / shares.len() as f64;
        let kept = 1.0 - LEAST_SEEN;
        shares.iter_mut().for_each(|share| *share = least + kept * *share / total);
    }
}

/// Where a climb ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Top {
    pub(crate) pose: Isometry3<f64>,
    /// Log-likelihood, log-prior of the shares and, where contained, of the pose.
    pub(crate) objective: f64,
    pub(crate) log_likelihood: f64,
    /// Log-likelihood less that of a window that is all background: comparable between windows prepared about different places.
    pub(crate) gain: f64,
    /// What all lines say in full, and the prior: the covariance is the inverse of its share that counts ([`super::noise::LineNoise::information_share`]).
    pub(crate) information: Matrix6<f64>,
    pub(crate) effective_lines: f64,
    /// Lines that pass near.
    pub(crate) near: usize,
    pub(crate) converged: bool,
}

impl Top {
    /// A pose about which no line has said anything.
    pub(crate) fn nothing_at(pose: &Isometry3<f64>) -> Self {
        Self {
            pose: *pose,
            objective: 0.0,
            log_likelihood: 0.0,
            gain: 0.0,
            information: Matrix6::zeros(),
            effective_lines: 0.0,
            near: 0,
            converged: false,
        }
    }

    /// Ends a climb by a step whose gain the quadratic form tells: so near to the top it is not looked at again.
    fn take_last(&mut self, step: &Vector6<f64>, gradient: &Vector6<f64>) {
        let gain = 0.5 * step.dot(gradient);
        self.pose = oplus(&self.pose, step);
        self.objective += gain;
        self.log_likelihood += gain;
        self.gain += gain;
        self.converged = true;
    }

    /// What a window's lines say about it.
    pub(crate) fn add(&mut self, of_lines: &Evaluation, window: &Window) {
        self.objective += of_lines.log_likelihood;
        self.log_likelihood += of_lines.log_likelihood;
        self.gain += of_lines.log_likelihood - window.near() as f64 * window.background_per_m2.ln();
        self.information += of_lines.information;
        self.effective_lines += of_lines.effective_lines();
        self.near += window.near();
    }
}

/// Buffers of a climb.
#[derive(Clone, Debug)]
pub(crate) struct Climber {
    pub(crate) weights: Weights,
    /// Shares before the window, at the start of the climb.
    expected: Vec<f64>,
    pub(crate) evaluation: Evaluation,
}

impl Climber {
    pub(crate) fn new(markers: usize) -> Self {
        Self {
            weights: Weights { shares: vec![1.0 / markers.max(1) as f64; markers], background: 0.3 },
            expected: Vec::with_capacity(markers),
            evaluation: Evaluation::default(),
        }
    }

    /// Climbs from `start` by at most so many steps, until the square of one in standard deviations is less than `shortest`; afterwards [`Self::weights`] are those at the top.
    pub(crate) fn climb(
        &mut self,
        likelihood: &Likelihood,
        window: &Window,
        start: &Isometry3<f64>,
        shares: &SharePrior,
        prior: Option<&NormalPrior>,
        (steps, shortest): (u32, f64),
    ) -> Top {
        shares.at(likelihood, start, &mut self.expected);
        self.weights.shares.clone_from(&self.expected);
        self.weights.background = shares.background;
        let mut top = self.look(likelihood, window, start, shares, prior);
        let mut gradient = self.evaluation.gradient;
        let mut damping = 0.0;
        for _ in 0..steps.min(MAX_STEPS) {
            let floor = self.floor(&top);
            let Some(step) = damped_step(&top.information, &gradient, &floor, &mut damping) else { break };
            if step.dot(&gradient) < shortest && damping == 0.0 {
                top.take_last(&step, &gradient);
                break;
            }
            let before = (self.weights.clone_shares(), self.weights.background);
            self.expect(shares);
            let trial = self.look(likelihood, window, &oplus(&top.pose, &step), shares, prior);
            if trial.objective >= top.objective - SAME * top.near as f64 {
                top = trial;
                gradient = self.evaluation.gradient;
                damping = if damping > 2e-3 { 0.1 * damping } else { 0.0 };
            } else {
                self.weights.restore(before.0, before.1);
                damping = (10.0 * damping).max(FIRST_DAMPING);
                if damping > 1e8 {
                    break;
                }
                // The evaluation's buffers hold the refused place's counts: those of the kept one are needed.
                top = self.look(likelihood, window, &top.pose, shares, prior);
                gradient = self.evaluation.gradient;
            }
        }
        top
    }

    fn floor(&self, top: &Top) -> Vector6<f64> {
        let lines = top.effective_lines.max(1.0);
        let (p, r) = (FLOOR_POSITION * lines, FLOOR_ROTATION * lines);
        Vector6::new(p, p, p, r, r, r)
    }

    /// Shares at their expectation.
    fn expect(&mut self, prior: &SharePrior) {
        let lines = self.evaluation.effective_lines();
        let counts = self.weights.shares.iter_mut().zip(&self.evaluation.lines_of_marker).zip(&self.expected);
        for ((share, n), nominal) in counts {
            *share = (n + SHARE_LINES * nominal) / (lines + SHARE_LINES);
        }
        let all = lines + self.evaluation.background_lines + BACKGROUND_LINES;
        let background = (self.evaluation.background_lines + BACKGROUND_LINES * prior.background) / all;
        self.weights.background = background.clamp(BACKGROUND_LIMITS[0], BACKGROUND_LIMITS[1]);
    }

    /// The Dirichlet's and the Beta's logarithm: without it the shares' step towards their prior looks like a step down.
    fn log_share_prior(&self, prior: &SharePrior) -> f64 {
        let of_markers: f64 = self.weights.shares.iter().zip(&self.expected).map(|(w, n)| n * w.ln()).sum();
        let b = self.weights.background;
        let of_background = prior.background * b.ln() + (1.0 - prior.background) * (1.0 - b).ln();
        SHARE_LINES * of_markers + BACKGROUND_LINES * of_background
    }

    /// Evaluates a pose; the prior is added to the evaluation's gradient.
    fn look(
        &mut self,
        likelihood: &Likelihood,
        window: &Window,
        pose: &Isometry3<f64>,
        shares: &SharePrior,
        prior: Option<&NormalPrior>,
    ) -> Top {
        likelihood.evaluate_narrow(window, pose, &self.weights, &mut self.evaluation);
        let mut top = Top::nothing_at(pose);
        top.add(&self.evaluation, window);
        top.objective += self.log_share_prior(shares);
        if let Some(prior) = prior {
            let (value, gradient, information) = log_prior(prior, pose);
            top.objective += value;
            self.evaluation.gradient += gradient;
            top.information += information;
        }
        top
    }
}

impl Weights {
    /// The shares as a fixed array: taken back without allocation.
    fn clone_shares(&self) -> [f64; super::likelihood::MAX_MARKERS] {
        let mut kept = [0.0; super::likelihood::MAX_MARKERS];
        for (k, s) in kept.iter_mut().zip(&self.shares) {
            *k = *s;
        }
        kept
    }

    fn restore(&mut self, shares: [f64; super::likelihood::MAX_MARKERS], background: f64) {
        for (s, k) in self.shares.iter_mut().zip(shares) {
            *s = k;
        }
        self.background = background;
    }
}

/// `-½ ξᵀ Λ ξ` with ξ = pose ⊖ mean, its gradient and (Gauss-Newton) information.
fn log_prior(prior: &NormalPrior, pose: &Isometry3<f64>) -> (f64, Vector6<f64>, Matrix6<f64>) {
    let error = ominus(pose, &prior.mean);
    let mut jacobian = Matrix6::identity();
    let turn = error.fixed_rows::<3>(3).into_owned();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&right_jacobian_inverse_so3(&turn));
    let pull = prior.information * error;
    (
        -0.5 * error.dot(&pull),
        -(jacobian.transpose() * pull),
        jacobian.transpose() * prior.information * jacobian,
    )
}

/// The step, damped until it leads upwards, and cut to what a quadratic form can be trusted for.
fn damped_step(
    information: &Matrix6<f64>,
    gradient: &Vector6<f64>,
    floor: &Vector6<f64>,
    damping: &mut f64,
) -> Option<Vector6<f64>> {
    for _ in 0..12 {
        let mut matrix = *information;
        for i in 0..6 {
            matrix[(i, i)] += *damping * information[(i, i)].abs().max(floor[i]);
        }
        if let Some(root) = Cholesky::<f64, Const<6>>::new(matrix) {
            let mut step = root.solve(gradient);
            let long = (step.fixed_rows::<3>(0).norm() / LONGEST_M)
                .max(step.fixed_rows::<3>(3).norm() / LONGEST_RAD);
            if !long.is_finite() {
                return None;
            }
            if long > 1.0 {
                step /= long;
            }
            return Some(step);
        }
        *damping = (4.0 * *damping).max(FIRST_DAMPING);
    }
    None
}

/// Largest standard deviations that a pose may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Position, m.
    pub position_m: f64,
    /// Rotation, rad.
    pub rotation_rad: f64,
}

impl Default for Limits {
    /// A marker's distance from its neighbours, and half the way to the next vertex: beyond, the quadratic form means nothing.
    fn default() -> Self {
        Self { position_m: 5e-3, rotation_rad: 0.6 }
    }
}

/// The covariance of a top.
///
/// # Errors
/// [`Failure::Indefinite`], [`Failure::Uncertain`].
pub(crate) fn covariance(information: &Matrix6<f64>, limits: &Limits) -> Result<Matrix6<f64>, Failure> {
    let Some(root) = Cholesky::<f64, Const<6>>::new(*information) else { return Err(Failure::Indefinite) };
    let inverse = root.inverse();
    let worst = |from: usize| {
        let block = inverse.fixed_view::<3, 3>(from, from).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    // The trace bounds the largest eigenvalue.
    let all = |from: usize| (0..3).map(|i| inverse[(from + i, from + i)]).sum::<f64>();
    let is_surely_within = all(0) <= limits.position_m * limits.position_m
        && all(3) <= limits.rotation_rad * limits.rotation_rad;
    if is_surely_within {
        return Ok((inverse + inverse.transpose()) * 0.5);
    }
    let (position_m, rotation_rad) = (worst(0), worst(3));
    if !(position_m <= limits.position_m && rotation_rad <= limits.rotation_rad) {
        return Err(Failure::Uncertain {
            position_mm: position_m * 1e3,
            rotation_deg: rotation_rad.to_degrees(),
            allowed_mm: limits.position_m * 1e3,
            allowed_deg: limits.rotation_rad.to_degrees(),
        });
    }
    Ok((inverse + inverse.transpose()) * 0.5)
}
