//! The project's own tracker: maximum of the robust likelihood of [`super::likelihood`], with the hypotheses that keep it honest.
//!
//! A window starts from the prior, or from the last pose, or (nothing known, a fallen likelihood) from a search over all attitudes:
//! centroid, [`super::initialize`], climbs from the best candidates. Two things that a single window cannot see:
//!
//! - **Not enough lines for a first pose.** Where two attitudes explain the first window nearly equally well, the answer is
//!   [`Failure::Ambiguous`], and the next search is over the lines of up to [`STACK`] windows.
//!   With `start_windows` above 1 the first pose is always that of several windows together: of so many, or of those that it took until
//!   every marker was told well enough (`start_sigma_m`; file `mixture/start.rs`).
//! - **A wrong order of the markers.** A flip of the near-isosceles triangle fits nearly as well as the truth and moves with it. Every
//!   [`TEST_EVERY`] windows the last [`STACK`] are climbed again from every other order of the markers; a better one is taken.
//!
//! In the same windows a search looks for another place that explains the window much better: a capsule that was thrown may be followed
//! at a peak that is none of its orders. A search follows also where the place that was told or held has no lines (a capsule that comes
//! back from out of view, a prediction that ran away), or the mean log-likelihood per line falls by four of its own standard
//! deviations. Where it finds two poses that both explain the lines better than the followed one, that one is *doubted*: no answer is
//! given, and no prediction looked at, until the next windows tell which. Poses that the marker set cannot tell apart are listed, and
//! of them the nearest to the prior (or to the last pose) is the answer.

mod order;
mod place;
mod search;
mod start;

use super::body::Body;
use super::budget::Budget;
use super::centroid::Centroid;
use super::climb::{Climber, FINE, Limits, NormalPrior, SharePrior, Top, covariance};
use super::densest::Densest;
use super::estimate_markers::MarkerEstimate;
use super::failure::Failure;
use super::initialize::Search;
use super::lanes::Eight;
use super::likelihood::{Likelihood, likeliest_origins};
use super::noise::LineNoise;
use super::window::{Preparation, Window};
use super::{Memory, Prior, Reinitialized, Rival, Role, Tracked, Tracker};
use crate::line::Line;
use crate::markers::MarkerSet;
use lumenav_core::{MotionEstimate, PriorUse};
use nalgebra::{Isometry3, Vector3};

/// Windows between two tests of the markers' order.
pub const TEST_EVERY: u64 = 10;
/// Windows that a test or a stacked search looks at.
pub const STACK: usize = 5;
/// Most windows that a first pose is taken from together, 1.2 s of windows of 50 ms. Within them an even motion is believed, and the covariance
/// knows of no other: a capsule of 45 mm/s that turns leaves it by 1 mm, a deviation of a line, in eight windows. A fixed number above that is
/// for slow capsules; one that starts as soon as it can ([`MixtureOptions::start_sigma_m`]) takes some eleven windows of 54 lines, and
/// was as good as it said at that speed, too.
pub const MOST_START_WINDOWS: usize = 24;
/// Windows whose mean log-likelihood is remembered.
const REMEMBERED: usize = 20;
/// Another order is taken where it explains the windows better by this: odds of twenty to one.
const BETTER: f64 = 3.0;
/// Poses whose markers agree within this are one, m: half of the shortest side.
const SAME_POSE_M: f64 = 3e-3;
/// Lines per degree of freedom that the markers must explain.
const LINES_PER_FREEDOM: usize = 2;
/// Background share before the first window, among the lines that pass near: 20 to 50 per cent of all (than2015 table 4.2), of which
/// a fifth passes within 30 mm.
pub const FIRST_BACKGROUND: f64 = 0.1;
/// Least gain of a pose over background alone, log-likelihood. A rule of thumb, for a mixture against background alone is not a regular
/// test: half of what chi-square with 6 degrees of freedom exceeds once in ten thousand. A true line gains 2 to 3.
pub(crate) const FOLLOWED_GAIN: f64 = 14.0;
/// Lines of each window that a test of the markers' order looks at, and of the last windows together that a test of the place does: few
/// enough for each, since a window of so many leaves no doubt.
const TEST_LINES: usize = 300;
/// Steps of a climb from a candidate and in a test.
const SEARCH_STEPS: u32 = 15;
const TEST_STEPS: u32 = 6;
const FULL_STEPS: u32 = 30;

/// Settings of the tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct MixtureOptions {
    /// Lines looked at.
    pub budget: Budget,
    /// Test the markers' order over several windows.
    pub test_permutations: bool,
    /// Estimate where the markers are in the capsule.
    pub estimate_markers: bool,
    /// Windows from which a first pose is taken together, 1 to [`MOST_START_WINDOWS`]; a window of many lines needs no other.
    pub start_windows: usize,
    /// A start from several windows waits for no more of them once every marker's place is told to this standard deviation (root of the three
    /// variances' sum), m; 0: it waits for all.
    pub start_sigma_m: f64,
    /// Standard deviation of the angular rate before a first pose from several windows, rad/s per axis: the fastest path of than2015
    /// turns by 0.7 rad/s.
    pub start_rate_sigma_rad_s: f64,
    /// Largest standard deviations of a pose.
    pub limits: Limits,
}

impl Default for MixtureOptions {
    fn default() -> Self {
        Self {
            budget: Budget::All,
            test_permutations: true,
            estimate_markers: false,
            start_windows: 1,
            start_sigma_m: 0.0,
            start_rate_sigma_rad_s: 0.5,
            limits: Limits::default(),
        }
    }
}

/// The tracker.
#[derive(Clone, Debug)]
pub struct Mixture {
    body: Body,
    noise: LineNoise,
    options: MixtureOptions,
    likelihood: Likelihood,
    memory: Memory,
    shares: SharePrior,
    estimate: Option<MarkerEstimate>,
    window: Window,
    other: Window,
    centroid: Centroid,
    search: Search,
    climber: Climber,
    tops: Vec<Top>,
    stack: Vec<Line>,
    /// Lines of the last search, and of them those about the place where most pass.
    looked_at: Vec<Line>,
    crowded: Vec<Line>,
    densest: Densest,
    /// Objective of each other order of the markers over the last windows, and its number.
    orders: Vec<(f64, usize)>,
    /// Of a pose that this window's start from several windows brought.
    motion: Option<MotionEstimate>,
    origins: Vec<Eight>,
}

impl Mixture {
    /// For a marker set in a scanner.
    pub fn new(set: &MarkerSet, noise: LineNoise, options: MixtureOptions) -> Self {
        let body = Body::new(set);
        let noise = noise.wide_enough_for(set);
        Self {
            likelihood: Likelihood::new(body.markers_m.clone()),
            shares: SharePrior {
                shares: body.shares.clone(),
                coverage: noise.coverage().clone(),
                scanner_world_m: Vector3::zeros(),
                background: FIRST_BACKGROUND,
            },
            estimate: options.estimate_markers.then(|| MarkerEstimate::new(&body.markers_m)),
            climber: Climber::new(body.len()),
            memory: Memory::default(),
            window: Window::default(),
            other: Window::default(),
            centroid: Centroid::default(),
            search: Search::default(),
            tops: Vec::new(),
            stack: Vec::new(),
            looked_at: Vec::new(),
            crowded: Vec::new(),
            densest: Densest::default(),
            orders: Vec::new(),
            motion: None,
            origins: Vec::new(),
            body,
            noise,
            options,
        }
    }

    /// The likelihood with the markers as installed or, where they are estimated, as estimated.
    pub fn likelihood(&self) -> &Likelihood {
        &self.likelihood
    }

    /// The window prepared last, for evaluations of [`Self::likelihood`].
    pub fn window(&self) -> &Window {
        &self.window
    }

    /// The shares at the last top.
    pub fn weights(&self) -> &super::Weights {
        &self.climber.weights
    }

    fn budget(&self) -> Option<usize> {
        self.options.budget.lines(self.body.len(), self.memory.background_share)
    }

    fn needed(&self) -> usize {
        6 * LINES_PER_FREEDOM
    }

    fn place_of(&self, pose: &Isometry3<f64>) -> Vector3<f64> {
        pose.transform_point(&self.body.centroid_m.into()).coords
    }

    /// All lines, at rest, about a place in the scanner where it is now.
    fn about(&self, place_world_m: Vector3<f64>) -> Preparation {
        Preparation { scanner_world_m: self.shares.scanner_world_m, ..Preparation::about(place_world_m) }
    }

    /// A climb from a pose that is believed.
    fn follow(
        &mut self,
        lines: &[Line],
        start: &Isometry3<f64>,
        velocity_world_m_s: Vector3<f64>,
        prior: Option<&NormalPrior>,
    ) -> Result<Top, Failure> {
        // Lines spread evenly over a window: their mean is its middle.
        let at_s = start::mean_time_s(lines).unwrap_or(0.0);
        let how = Preparation {
            velocity_world_m_s,
            at_s,
            budget: self.budget(),
            ..self.about(self.place_of(start))
        };
        self.window.prepare(lines, &self.noise, &how, self.needed())?;
        Ok(self.climber.climb(&self.likelihood, &self.window, start, &self.shares, prior, (FULL_STEPS, FINE)))
    }

    /// Keeps a window for what windows tell together; one that repeats lines of the last that was kept would count them twice, and is not:
    /// `false`.
    fn remember(&mut self, lines: &[Line], pose: &Isometry3<f64>) -> bool {
        if self.memory.recent.last().is_some_and(|(kept, _)| overlap(kept, lines)) {
            return false;
        }
        let most = if self.memory.started { STACK } else { self.options.start_windows.max(STACK) };
        let recent = &mut self.memory.recent;
        if recent.len() >= most {
            recent.rotate_left(1);
            if let Some((kept, at)) = recent.last_mut() {
                kept.clear();
                kept.extend_from_slice(lines);
                *at = *pose;
            }
        } else {
            recent.push((lines.to_vec(), *pose));
        }
        true
    }

    /// The kept windows that hold nothing of this one.
    fn earlier_than(&self, lines: &[Line]) -> impl DoubleEndedIterator<Item = &(Vec<Line>, Isometry3<f64>)> {
        self.memory.recent.iter().filter(|(kept, _)| !overlap(kept, lines))
    }

    /// The window's top, and why it was searched for.
    fn locate(
        &mut self,
        lines: &[Line],
        prior: Option<&Prior>,
    ) -> Result<(Top, Option<Reinitialized>), Failure> {
        let hint = prior.filter(|p| p.how != PriorUse::None);
        let contained = hint.filter(|p| p.how == PriorUse::Contained).and_then(|p| {
            // Lines count in full in a climb: beside them a prior weighs the more, and both are scaled in the end.
            let information = p.covariance.cholesky()?.inverse() / self.noise.information_share;
            Some(NormalPrior { mean: p.world_from_capsule, information })
        });
        let velocity = hint.map_or_else(Vector3::zeros, |p| p.velocity_world_m_s);
        if self.memory.doubted {
            return self.resolve_doubt(lines);
        }
        let start = hint.map(|p| p.world_from_capsule).or(self.memory.world_from_capsule);
        let Some(start) = start else {
            let why = if self.memory.windows == 0 {
                Reinitialized::FirstWindow
            } else {
                Reinitialized::AfterFailure
            };
            return Ok((self.first_pose(lines)?, Some(why)));
        };
        let top = self.follow(lines, &start, velocity, contained.as_ref())?;
        let is_sound = top.converged && top.gain >= FOLLOWED_GAIN && !self.fell(&top);
        if is_sound && !self.is_test_due() {
            return Ok((top, None));
        }
        self.relocalize(lines, (&top, is_sound), &start, velocity, contained.as_ref())
    }

    /// Checks that a pose is one, and writes it.
    fn answer(&mut self, top: &Top, prior: Option<&Prior>, out: &mut Tracked) -> Result<(), Failure> {
        let lines = self.window.len() as f64;
        // Of a pose from several windows this one need not say so much.
        let is_of_stack = self.motion.is_some();
        if !is_of_stack && top.effective_lines < self.needed() as f64 {
            let background = 100.0 * (1.0 - top.effective_lines / lines);
            return Err(Failure::Background {
                effective: top.effective_lines,
                background,
                needed: self.needed(),
            });
        }
        if !is_of_stack && !(top.gain >= FOLLOWED_GAIN) {
            return Err(Failure::NoEvidence { gain: top.gain, needed: FOLLOWED_GAIN });
        }
        if !top.converged {
            return Err(Failure::NotConverged { steps: FULL_STEPS });
        }
        out.covariance = covariance(&(top.information * self.noise.information_share), &self.options.limits)?;
        let hint = prior.filter(|p| p.how != PriorUse::None);
        let near = hint.map(|p| p.world_from_capsule).or(self.memory.world_from_capsule);
        out.world_from_capsule = near.map_or(top.pose, |near| self.body.nearest_twin(&top.pose, &near));
        out.motion.clone_from(&self.motion);
        if out.world_from_capsule != top.pose {
            let turn = out.world_from_capsule.rotation.inverse() * top.pose.rotation;
            out.covariance = turned_covariance(&out.covariance, &turn);
            if let Some(motion) = &mut out.motion {
                turn_motion(motion, &turn);
            }
        }
        out.ambiguous.clear();
        out.ambiguous.extend(
            self.body
                .twins(&out.world_from_capsule)
                .map(|world_from_capsule| Rival { world_from_capsule, log_likelihood_difference: 0.0 }),
        );
        let pose = out.world_from_capsule;
        out.markers_world_m.clear();
        out.markers_world_m.extend(
            self.likelihood.markers_capsule_m.iter().map(|m| pose.transform_point(&(*m).into()).coords),
        );
        out.shares.clone_from(&self.climber.weights.shares);
        out.background_share = 1.0 - top.effective_lines / lines;
        out.used_lines = self.window.len();
        out.log_likelihood = top.log_likelihood;
        out.prior_use = hint.map_or(PriorUse::None, |p| p.how);
        Ok(())
    }

    /// The likeliest origin of each line.
    fn roles(&mut self, pose: &Isometry3<f64>, roles: &mut [Role]) {
        let mut placed = [super::likelihood::Placed::default(); super::likelihood::MAX_MARKERS];
        let weights = &self.climber.weights;
        let used = self.likelihood.place(pose, &self.window.origin_world_m, weights, &mut placed);
        likeliest_origins(&self.window.narrow_shapes, &placed[..used], weights.background, &mut self.origins);
        for index in &self.window.indices {
            roles[*index as usize] = Role::Background;
        }
        let of_lines = self.origins.iter().flat_map(|pack| pack.0);
        for (origin, index) in of_lines.zip(&self.window.near_indices) {
            if origin >= 0.0 {
                roles[*index as usize] = Role::Marker(origin as u8);
            }
        }
    }

    /// What a good window teaches.
    fn learn(&mut self, lines: &[Line], top: &Top, due: bool, out: &Tracked) {
        let known = &mut self.memory.mean_log_likelihoods;
        if known.len() >= REMEMBERED {
            known.remove(0);
        }
        known.push(top.gain / self.window.len().max(1) as f64);
        // The background's share follows over some windows; it is that among the lines that pass near.
        self.shares.background += 0.2 * (self.climber.weights.background - self.shares.background);
        self.memory.background_near = Some(self.shares.background);
        self.memory.background_share = Some(out.background_share);
        self.memory.started = true;
        self.memory.centroid_world_m = Some(self.place_of(&out.world_from_capsule));
        self.memory.markers_world_m.clone_from(&out.markers_world_m);
        self.memory.world_from_capsule = Some(out.world_from_capsule);
        let is_new = self.remember(lines, &out.world_from_capsule);
        // Where the order is about to be tested it may be wrong: such a window teaches nothing about the markers.
        if let Some(estimate) = self.estimate.as_mut().filter(|_| is_new && !due) {
            let (pose, share) = (&out.world_from_capsule, self.noise.information_share);
            estimate.add(&self.window, &self.likelihood, pose, &self.climber.weights, share);
            self.likelihood.markers_capsule_m.clone_from_slice(estimate.markers_m());
            self.memory.marker_estimate = Some(estimate.clone());
        }
    }
}

/// Whether a window holds lines of an earlier one. Both are stretches of one stream, so the later begins within the earlier, or is none of it.
fn overlap(earlier: &[Line], later: &[Line]) -> bool {
    later.first().is_some_and(|first| earlier.contains(first))
        || earlier.last().is_some_and(|last| later.contains(last))
}

/// A covariance told in capsule axes that are turned: `θ_new = turn · θ_old`.
fn turned_covariance(
    covariance: &nalgebra::Matrix6<f64>,
    turn: &nalgebra::UnitQuaternion<f64>,
) -> nalgebra::Matrix6<f64> {
    let mut jacobian = nalgebra::Matrix6::identity();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn.to_rotation_matrix().into_inner());
    jacobian * covariance * jacobian.transpose()
}

/// A motion told in capsule axes that are turned: attitude and rate as in [`turned_covariance`].
fn turn_motion(motion: &mut MotionEstimate, turn: &nalgebra::UnitQuaternion<f64>) {
    let matrix = turn.to_rotation_matrix().into_inner();
    let mut jacobian = nalgebra::SMatrix::<f64, 12, 12>::identity();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&matrix);
    jacobian.fixed_view_mut::<3, 3>(9, 9).copy_from(&matrix);
    motion.angular_rate_capsule_rad_s = turn * motion.angular_rate_capsule_rad_s;
    motion.covariance = jacobian * motion.covariance * jacobian.transpose();
}

impl Tracker for Mixture {
    fn name(&self) -> &'static str {
        "mixture"
    }

    fn track_into(
        &mut self,
        lines: &[Line],
        prior: Option<&Prior>,
        out: &mut Tracked,
    ) -> Result<(), Failure> {
        out.roles.clear();
        out.roles.resize(lines.len(), Role::Unused);
        out.markers_world_m.clear();
        out.reinitialized = None;
        self.motion = None;
        let due = self.is_test_due();
        let located = self.locate(lines, prior);
        let done = located.and_then(|(top, why)| {
            if let Err(failure) = self.answer(&top, prior, out) {
                // Another place was better, and this window cannot say where in it: the one that was followed is wrong all the same.
                self.memory.doubted |= why == Some(Reinitialized::LikelihoodFell);
                return Err(self.doubt(failure));
            }
            if why.is_some() {
                // A pose that was searched for holds nothing of the prior.
                out.prior_use = PriorUse::None;
            }
            out.reinitialized = why;
            Ok(top)
        });
        self.memory.windows += 1;
        let top = match done {
            Ok(top) => top,
            Err(failure) => {
                self.forget(lines, &failure);
                return Err(failure);
            }
        };
        // What was gathered before the first pose has none.
        let is_searched = matches!(
            out.reinitialized,
            Some(Reinitialized::FirstWindow | Reinitialized::AfterFailure | Reinitialized::LikelihoodFell)
        );
        if is_searched || !self.memory.started {
            self.memory.recent.clear();
            // A search that found another order as likely would not have answered.
            self.memory.order_evidence.clear();
            self.memory.order_evidence.resize(self.body.permutations.len(), -search::AMBIGUOUS);
        }
        self.roles(&out.world_from_capsule, &mut out.roles);
        self.learn(lines, &top, due, out);
        if due && self.memory.recent.len() == STACK {
            self.test_order(lines, prior, out);
        }
        Ok(())
    }

    fn scanner_at(&mut self, place_world_m: &Vector3<f64>) {
        self.shares.scanner_world_m = *place_world_m;
    }

    fn memory(&self) -> Memory {
        self.memory.clone()
    }

    fn recall(&mut self, memory: Memory) {
        self.shares.background = memory.background_near.unwrap_or(FIRST_BACKGROUND);
        if self.options.estimate_markers {
            let estimate = memory.marker_estimate.clone();
            let estimate = estimate.unwrap_or_else(|| MarkerEstimate::new(&self.body.markers_m));
            self.likelihood.markers_capsule_m.clone_from_slice(estimate.markers_m());
            self.estimate = Some(estimate);
        }
        self.memory = memory;
    }
}

impl Mixture {
    /// After a failure: the pose is forgotten, the lines are kept where the trouble was ambiguity.
    fn forget(&mut self, lines: &[Line], failure: &Failure) {
        let searching = self.memory.world_from_capsule.is_none();
        self.memory.world_from_capsule = None;
        // A start from several windows goes on gathering, whatever one of them lacks.
        let is_gathering = self.options.start_windows > 1 && !self.memory.started;
        match failure {
            _ if is_gathering => drop(self.remember(lines, &Isometry3::identity())),
            Failure::Ambiguous { .. } | Failure::Gathering { .. } | Failure::Doubted { .. } if searching => {
                self.remember(lines, &Isometry3::identity());
            }
            _ => self.memory.recent.clear(),
        }
        if !searching {
            self.memory.mean_log_likelihoods.clear();
        }
    }
}
