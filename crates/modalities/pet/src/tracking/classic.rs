//! What the two trackers of than2015 share: centroid and outliers, search, failure prediction, health, answer.
//!
//! Per window: budget, centroid with Thompson's test ([`super::centroid`]), start (prior, last markers, or the search of
//! [`super::initialize`]), the tracker's own iteration, health. Failure prediction (section 3.4.4): the search is repeated where two
//! starting points are nearer than 5 mm, or fewer than half of the kept lines pass within 5 mm of one. Health (section 5.5.1):
//! no share below 0.01, free markers 7 to 16 mm apart (3 mm beyond the set's own least and largest distance), and, which the
//! thesis does not ask, no answer where under 30 per cent of the kept lines pass a marker.
//!
//! The covariance is `κ σ² (Σ Jᵀ A J)⁻¹` with σ² the weighted mean squared distance per dimension and κ = [`INFLATION`]: memberships
//! that move with the pose, and lines beyond reach that are not seen, make the plain form too small. κ is 1: not calibrated, so this
//! covariance is overconfident; fuse `mixture`'s instead.

use super::body::Body;
use super::budget::{Budget, TRUE_LINES_PER_MARKER};
use super::centroid::{Centroid, Weight};
use super::climb::Limits;
use super::failure::Failure;
use super::initialize::Search;
use super::membership::{REACH_M, Share, pass};
use super::nearest::{Nearest, nearest};
use super::window::{Preparation, Window};
use super::{Memory, Prior, Reinitialized, Rival, Role, Tracked};
use crate::line::Line;
use crate::markers::MarkerSet;
use lumenav_core::PriorUse;
use lumenav_core::pose::oplus;
use nalgebra::{Cholesky, Const, Isometry3, Matrix3, Matrix6, Vector3, Vector6};

/// Largest move of a marker below which an iteration rests, m (than2015, section 3.4.3).
pub const REST_M: f64 = 1e-5;
/// Passes before an iteration ends (spec: 50).
pub const MAX_PASSES: usize = 50;
/// Starting points nearer than this are suspicious, m (section 3.4.4).
const NEAR_M: f64 = 5e-3;
/// Share of the kept lines that must pass a starting point.
const PASSING_START: f64 = 0.5;
/// Share of the kept lines that must pass a marker in the end.
const PASSING_END: f64 = 0.3;
/// Least share of a marker (section 5.5.1).
const LEAST_SHARE: f64 = 0.01;
/// Passes for each candidate of a search.
const CANDIDATE_PASSES: usize = 6;
/// What a step of Gauss-Newton leaves is of second order: after one by this angle 0.8 um on an arm of 8 mm, a tenth of the rest.
const FINE_RAD: f64 = 1e-2;
/// Covariance over that of weighted least squares with fixed memberships: 1, not calibrated.
const INFLATION: f64 = 1.0;
/// Least variance of a line, m²: a fifth of a millimetre, so that few lines that happen to meet do not claim a certainty.
const SMALLEST_VARIANCE_M2: f64 = 4e-8;
/// Kept lines per degree of freedom.
const FEWEST_KEPT: usize = 6;

/// Settings of `fcm` and `rigid`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassicOptions {
    /// Weight of lines in the centroid.
    pub weight: Weight,
    /// Never throw a line out that the marker set can explain ([`super::centroid`]); `false`: Thompson's test as printed.
    pub spare_body: bool,
    /// Lines looked at.
    pub budget: Budget,
    /// Predict failures and search anew (section 3.4.4). `false`: every window starts from the last pose there was, and nothing is searched
    /// for after the first.
    pub predict_failures: bool,
    /// Largest standard deviations of a pose.
    pub limits: Limits,
}

impl Default for ClassicOptions {
    fn default() -> Self {
        Self {
            weight: Weight::Uniform,
            spare_body: true,
            budget: Budget::TruePerMarker(TRUE_LINES_PER_MARKER),
            predict_failures: true,
            limits: Limits::default(),
        }
    }
}

/// Shared state and buffers.
#[derive(Clone, Debug)]
pub(crate) struct Classic {
    pub(crate) body: Body,
    pub(crate) options: ClassicOptions,
    pub(crate) memory: Memory,
    window: Window,
    centroid: Centroid,
    search: Search,
    /// Markers from the window's origin, m.
    pub(crate) places_m: Vec<Vector3<f64>>,
    pub(crate) shares: Vec<f64>,
    pub(crate) sums: Vec<Share>,
    starts: Vec<Isometry3<f64>>,
    /// `fcm`'s markers, which are no rigid set: a window starts where they were, not where the last pose puts them.
    pub(crate) are_markers_free: bool,
    nearest: Vec<Nearest>,
    /// Cost of the last pass, m².
    cost_m2: f64,
}

impl Classic {
    pub(crate) fn new(set: &MarkerSet, options: ClassicOptions) -> Self {
        let body = Body::new(set);
        let count = body.len();
        Self {
            shares: body.shares.clone(),
            sums: vec![Share::default(); count],
            places_m: vec![Vector3::zeros(); count],
            body,
            options,
            memory: Memory::default(),
            window: Window::default(),
            centroid: Centroid::default(),
            search: Search::default(),
            starts: Vec::new(),
            are_markers_free: false,
            nearest: Vec::new(),
            cost_m2: 0.0,
        }
    }

    /// Budget, centroid, outliers, start: afterwards `places_m` and `shares` are where the iteration begins, and `sums` of a first pass
    /// there. Poses are told from the window's origin.
    pub(crate) fn begin(
        &mut self,
        lines: &[Line],
        prior: Option<&Prior>,
    ) -> Result<(Isometry3<f64>, Option<Reinitialized>), Failure> {
        let hint = prior.filter(|p| p.how != PriorUse::None).map(|p| p.world_from_capsule);
        let known = hint.or(self.memory.world_from_capsule);
        let place = known.map(|p| p.transform_point(&self.body.centroid_m.into()).coords);
        let about_world_m =
            place.or(self.memory.centroid_world_m).unwrap_or_else(|| super::window::middle_m(lines));
        let budget = self.options.budget.lines(self.body.len(), self.memory.background_share);
        let how = Preparation { budget, ..Preparation::about(about_world_m) };
        self.window.load(lines, &how, FEWEST_KEPT)?;
        let spared_m = if self.options.spare_body { self.body.spared_m } else { 0.0 };
        let centre = self.centroid.find(&self.window, self.options.weight, spared_m)?;
        let kept = self.centroid.kept().len();
        if kept < FEWEST_KEPT {
            return Err(Failure::TooFewLines { given: lines.len(), usable: kept, needed: FEWEST_KEPT });
        }
        self.memory.centroid_world_m = Some(about_world_m + centre);
        self.shares.clone_from(&self.body.shares);
        if let Some(pose) = known {
            let local = from_origin(&pose, &about_world_m);
            self.place(&local);
            if self.are_markers_free && hint.is_none() && self.memory.markers_world_m.len() == self.body.len()
            {
                for (at, world) in self.places_m.iter_mut().zip(&self.memory.markers_world_m) {
                    *at = world - about_world_m;
                }
            }
            let passing = self.memberships();
            if !self.options.predict_failures || self.start_is_sound(passing) {
                return Ok((local, None));
            }
        }
        let why = match (known, self.memory.windows) {
            (Some(_), _) => Reinitialized::Predicted,
            (None, 0) => Reinitialized::FirstWindow,
            (None, _) => Reinitialized::AfterFailure,
        };
        let found = self.best_candidate(&centre)?;
        self.place(&found);
        self.memberships();
        Ok((found, Some(why)))
    }

    pub(crate) fn place(&mut self, pose: &Isometry3<f64>) {
        for (at, m) in self.places_m.iter_mut().zip(&self.body.markers_m) {
            *at = pose.transform_point(&(*m).into()).coords;
        }
    }

    /// Section 3.4.4: of so many lines within reach of a marker.
    fn start_is_sound(&self, passing: f64) -> bool {
        let is_near =
            |(i, a): (usize, &Vector3<f64>)| self.places_m[..i].iter().any(|b| (a - b).norm() < NEAR_M);
        !self.places_m.iter().enumerate().any(is_near)
            && passing >= PASSING_START * self.centroid.kept().len() as f64
    }

    /// A pass at the present places; the lines within reach of a marker.
    pub(crate) fn memberships(&mut self) -> f64 {
        let rays = self.centroid.kept_narrow();
        self.cost_m2 = pass(rays, &self.places_m, &self.shares, &mut self.sums);
        self.passing()
    }

    /// Lines within reach of a marker at the last pass.
    fn passing(&self) -> f64 {
        self.sums.iter().map(|s| s.members).sum()
    }

    /// Relative activities from the memberships.
    pub(crate) fn update_shares(&mut self) {
        let all = self.passing();
        if all > 0.0 {
            for (share, sums) in self.shares.iter_mut().zip(&self.sums) {
                *share = sums.members / all;
            }
        }
    }

    /// The best pose of a search: each candidate is refined a little, judged by the squared distance of its lines, capped at reach.
    fn best_candidate(&mut self, centre: &Vector3<f64>) -> Result<Isometry3<f64>, Failure> {
        self.starts.clear();
        let found = self.search.find(self.centroid.kept_rays(), centre, &self.body.arms_m);
        self.starts.extend(found.iter().map(|(_, turn)| self.body.at_centroid(centre, turn)));
        let mut best: Option<(f64, Isometry3<f64>)> = None;
        for k in 0..self.starts.len() {
            let mut pose = self.starts[k];
            self.shares.clone_from(&self.body.shares);
            for _ in 0..CANDIDATE_PASSES {
                self.place(&pose);
                self.memberships();
                if !self.rigid_step(&mut pose) {
                    break;
                }
            }
            self.place(&pose);
            let cost = self.capped_cost();
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, pose));
            }
        }
        self.shares.clone_from(&self.body.shares);
        best.map(|(_, pose)| pose).ok_or(Failure::Indefinite)
    }

    /// Squared distances of the kept lines from their markers, each capped at reach, m².
    fn capped_cost(&mut self) -> f64 {
        nearest(self.centroid.kept_narrow(), &self.places_m, REACH_M, &mut self.nearest);
        self.nearest.iter().map(|lines| lines.squared_m2.sum()).sum()
    }

    /// Minimum over SE(3) of the cost with the memberships of the last pass (chapter 6): Gauss-Newton on sums that do not change.
    /// `false` where they do not fix a pose.
    pub(crate) fn rigid_step(&self, pose: &mut Isometry3<f64>) -> bool {
        /// Quadratic convergence: three steps leave nothing, whatever the first turn.
        const STEPS: usize = 3;
        for _ in 0..STEPS {
            let (matrix, side) = self.normal_world(pose);
            let Some(root) = Cholesky::<f64, Const<6>>::new(matrix) else { return false };
            let mut step = root.solve(&side);
            let turned = pose.rotation.inverse() * step.fixed_rows::<3>(3).into_owned();
            step.fixed_rows_mut::<3>(3).copy_from(&turned);
            let turn = turned.norm();
            // A long turn leaves the region of the linear form.
            if turn > 0.5 {
                step *= 0.5 / turn;
            }
            if !step.iter().all(|v| v.is_finite()) {
                return false;
            }
            *pose = oplus(pose, &step);
            if turn < FINE_RAD {
                break;
            }
        }
        true
    }

    /// `Σ Jᵀ A J` and `Σ Jᵀ (V - A M)` by `[δp, δφ]`, both in world axes: J = [1, -[a]x], a the marker's arm.
    fn normal_world(&self, pose: &Isometry3<f64>) -> (Matrix6<f64>, Vector6<f64>) {
        let (mut pp, mut pr, mut rr) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for (m, s) in self.body.markers_m.iter().zip(&self.sums) {
            let arm = pose.rotation * m;
            let f = s.side_m - s.matrix * (pose.translation.vector + arm);
            force += f;
            torque += arm.cross(&f);
            pp += s.matrix;
            // -A [a]x, whose columns are a x A_i since A is symmetric, turned over; then [a]x of it.
            let lever = across(&arm, &s.matrix).transpose();
            pr += lever;
            rr += across(&arm, &lever);
        }
        let mut matrix = Matrix6::zeros();
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&pp);
        matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&pr);
        matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&pr.transpose());
        matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&rr);
        let side = Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
        (matrix, side)
    }

    /// Health, covariance, roles: the answer, from the iteration's last places and pose, and its last pass, less than a rest's move away.
    pub(crate) fn finish(
        &mut self,
        pose: &Isometry3<f64>,
        prior: Option<&Prior>,
        why: Option<Reinitialized>,
        out: &mut Tracked,
    ) -> Result<(), Failure> {
        let kept = self.centroid.kept().len();
        let passing = self.passing();
        if passing < PASSING_END * kept as f64 {
            return Err(Failure::Background {
                effective: passing,
                background: 100.0 * (1.0 - passing / self.window.len() as f64),
                needed: (PASSING_END * kept as f64).ceil() as usize,
            });
        }
        self.check_health()?;
        let covariance = self.covariance(pose)?;
        let origin = self.window.origin_world_m;
        let world = Isometry3::from_parts((pose.translation.vector + origin).into(), pose.rotation);
        let hint = prior.filter(|p| p.how != PriorUse::None);
        let near = hint.map(|p| p.world_from_capsule).or(self.memory.world_from_capsule);
        out.world_from_capsule = near.map_or(world, |near| self.body.nearest_twin(&world, &near));
        out.covariance = covariance;
        if out.world_from_capsule != world {
            let turn = out.world_from_capsule.rotation.inverse() * world.rotation;
            let mut jacobian = Matrix6::identity();
            jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn.to_rotation_matrix().into_inner());
            out.covariance = jacobian * covariance * jacobian.transpose();
        }
        out.markers_world_m.clear();
        out.markers_world_m.extend(self.places_m.iter().map(|p| p + origin));
        out.shares.clone_from(&self.shares);
        out.background_share = 1.0 - passing / self.window.len() as f64;
        out.used_lines = kept;
        out.log_likelihood = -self.capped_cost();
        out.ambiguous.clear();
        out.ambiguous.extend(
            self.body
                .twins(&out.world_from_capsule)
                .map(|world_from_capsule| Rival { world_from_capsule, log_likelihood_difference: 0.0 }),
        );
        out.reinitialized = why;
        out.prior_use = if hint.is_some() { PriorUse::StartOnly } else { PriorUse::None };
        self.roles(&mut out.roles);
        Ok(())
    }

    fn check_health(&self) -> Result<(), Failure> {
        let all = self.passing();
        for (marker, sums) in self.sums.iter().enumerate() {
            let share = sums.members / all;
            if !(share >= LEAST_SHARE) {
                return Err(Failure::Share { marker, share, allowed: LEAST_SHARE });
            }
        }
        let [least, most] = self.body.distances_m;
        for (i, a) in self.places_m.iter().enumerate() {
            for (j, b) in self.places_m[..i].iter().enumerate() {
                let distance = (a - b).norm();
                if !(least..=most).contains(&distance) {
                    let (distance_mm, allowed_mm) = (distance * 1e3, [least * 1e3, most * 1e3]);
                    return Err(Failure::Distance { pair: [j, i], distance_mm, allowed_mm });
                }
            }
        }
        Ok(())
    }

    /// From the sums of the last pass.
    fn covariance(&self, pose: &Isometry3<f64>) -> Result<Matrix6<f64>, Failure> {
        let (matrix, _) = self.normal_world(pose);
        let mut to_world = Matrix6::identity();
        to_world.fixed_view_mut::<3, 3>(3, 3).copy_from(&pose.rotation.to_rotation_matrix().into_inner());
        let matrix = to_world.transpose() * matrix * to_world;
        let weight: f64 = self.sums.iter().map(|s| s.weight).sum();
        let variance_m2 = 0.5 * self.cost_m2 / weight.max(f64::MIN_POSITIVE);
        let scale = INFLATION * variance_m2.max(SMALLEST_VARIANCE_M2);
        super::climb::covariance(&(matrix / scale), &self.options.limits)
    }

    /// Of the markers that [`Self::capped_cost`] found.
    fn roles(&self, roles: &mut [Role]) {
        for index in &self.window.indices {
            roles[*index as usize] = Role::Dropped;
        }
        let markers = self.nearest.iter().flat_map(|lines| lines.marker.0);
        for (place, marker) in self.centroid.kept().iter().zip(markers) {
            let role = if marker < 0.0 { Role::Background } else { Role::Marker(marker as u8) };
            roles[self.window.indices[*place as usize] as usize] = role;
        }
    }

    /// What a window leaves behind.
    pub(crate) fn remember(&mut self, done: Result<(), Failure>, out: &Tracked) -> Result<(), Failure> {
        self.memory.windows += 1;
        if done.is_err() && self.options.predict_failures {
            self.memory.world_from_capsule = None;
        }
        if done.is_ok() {
            self.memory.world_from_capsule = Some(out.world_from_capsule);
            self.memory.markers_world_m.clone_from(&out.markers_world_m);
            self.memory.background_share = Some(out.background_share);
        }
        done
    }
}

/// `[a]x M`: a x each column.
fn across(a: &Vector3<f64>, m: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[a.cross(&m.column(0)), a.cross(&m.column(1)), a.cross(&m.column(2))])
}

fn from_origin(pose: &Isometry3<f64>, origin_world_m: &Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts((pose.translation.vector - origin_world_m).into(), pose.rotation)
}
