//! From lines to poses: three trackers over windows of unlabelled lines, one trait.
//!
//! | tracker | what it is | source |
//! |---|---|---|
//! | [`fcm`] | free markers by fuzzy C-means over lines, pose by fitting the set to them | than2015, chapter 3 |
//! | [`rigid`] | the same memberships, the pose itself by least squares | than2015, chapter 6 |
//! | [`mixture`] | likelihood of the pose: a component per marker, an explicit background, noise per line from the scanner | this project |
//!
//! [`points`] follows independent points (tracer particles, calibration sources) by the same likelihood, each with a place and no attitude.
//!
//! Below them: [`window`] (lines made ready for the loops), [`noise`] (covariance of a line's offset from its marker), [`centroid`],
//! [`initialize`] and [`likelihood`] (value, gradient and observed information of a pose: what a tight filter update reads).
//!
//! Conventions: error `[δp_world (m), δθ_capsule (rad)]` at the capsule's origin, right perturbation (`lumenav_core::pose`). No
//! tracker ever answers with a pose that the window does not support: it returns a [`Failure`] that says why.

#![allow(
    clippy::inline_always,
    clippy::needless_range_loop,
    clippy::unused_self,
    clippy::large_types_passed_by_value,
    clippy::neg_cmp_op_on_partial_ord,
    reason = "what is not a number fails a comparison, and `!(a > b)` says so; kernels over packs of four lines: a call that is not inlined there leaves the vector registers, and loops run over \
              several arrays at once"
)]

mod body;
pub mod budget;
pub mod centroid;
mod classic;
pub(crate) mod climb;
mod densest;
pub mod estimate_markers;
mod expected;
pub mod failure;
pub mod fcm;
pub mod initialize;
mod lanes;
pub mod likelihood;
mod membership;
pub mod mixture;
mod nearest;
pub mod noise;
mod octet;
pub mod points;
mod quad;
mod register;
pub mod rigid;
pub mod thompson;
pub mod window;

pub use budget::Budget;
pub use classic::ClassicOptions;
pub use climb::Limits;
pub use failure::Failure;
pub use fcm::Fcm;
pub use likelihood::{Evaluation, Likelihood, Weights};
pub use mixture::{Mixture, MixtureOptions};
pub use noise::{BlockErrors, BlockNoise, LineNoise, SourceNoise};
pub use points::{Points, TrackedPoint};
pub use rigid::Rigid;
pub use window::{Preparation, Window};

use crate::line::Line;
use lumenav_core::{MotionEstimate, PriorUse};
use nalgebra::{Isometry3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

/// What is known before a window is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Predicted pose at the window's middle.
    pub world_from_capsule: Isometry3<f64>,
    /// Its covariance, `[δp_world, δθ_capsule]` at the capsule's origin, m² and rad².
    pub covariance: Matrix6<f64>,
    /// Predicted velocity of the capsule's origin, m/s: lines are carried along it to the window's middle.
    pub velocity_world_m_s: Vector3<f64>,
    /// [`PriorUse::None`]: not looked at; [`PriorUse::StartOnly`]: a start point and a hint between poses that the lines cannot tell
    /// apart; [`PriorUse::Contained`]: enters the estimate (maximum a posteriori), which then must not be fused with it again.
    pub how: PriorUse,
}

/// What a tracker took a line for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Role {
    /// Most likely from this marker.
    Marker(u8),
    /// Most likely scattered or random.
    Background,
    /// Thrown out before the estimate (outlier test).
    Dropped,
    /// Not looked at: beyond the line budget, or no line at all (ends in one place, not finite).
    Unused,
}

/// Another pose that explains the window as well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rival {
    /// The pose.
    pub world_from_capsule: Isometry3<f64>,
    /// Its log-likelihood less that of the answer; 0 for a symmetry of the marker set.
    pub log_likelihood_difference: f64,
}

/// A window's pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracked {
    /// The pose at the window's middle.
    pub world_from_capsule: Isometry3<f64>,
    /// Its covariance, `[δp_world, δθ_capsule]` at the capsule's origin, m² and rad².
    pub covariance: Matrix6<f64>,
    /// Places of the markers, m: on the rigid body for `rigid` and `mixture`, free for `fcm`.
    pub markers_world_m: Vec<Vector3<f64>>,
    /// Share of each marker in the lines that are not background; they sum to 1.
    pub shares: Vec<f64>,
    /// Share of the lines taken that are background (`mixture`), or that were thrown out (`fcm`, `rigid`).
    pub background_share: f64,
    /// What each line of the window was taken for.
    pub roles: Vec<Role>,
    /// Lines that entered.
    pub used_lines: usize,
    /// Log-likelihood of the window (`mixture`), or minus the cost in m² (`rigid`, `fcm`).
    pub log_likelihood: f64,
    /// Poses that the lines cannot tell from this one.
    pub ambiguous: Vec<Rival>,
    /// Whether the pose was searched for anew in this window, and why.
    pub reinitialized: Option<Reinitialized>,
    /// What the prior did to the pose.
    pub prior_use: PriorUse,
    /// The motion that a pose from several windows came with (`mixture`).
    pub motion: Option<MotionEstimate>,
}

impl Default for Tracked {
    fn default() -> Self {
        Self {
            world_from_capsule: Isometry3::identity(),
            covariance: Matrix6::identity(),
            markers_world_m: Vec::new(),
            shares: Vec::new(),
            background_share: 0.0,
            roles: Vec::new(),
            used_lines: 0,
            log_likelihood: 0.0,
            ambiguous: Vec::new(),
            reinitialized: None,
            prior_use: PriorUse::None,
            motion: None,
        }
    }
}

/// Why a pose was searched for anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reinitialized {
    /// There was no pose to start from.
    FirstWindow,
    /// The window before failed.
    AfterFailure,
    /// The failure prediction of than2015 section 3.4.4.
    Predicted,
    /// The likelihood of the windows fell.
    LikelihoodFell,
    /// Another order of the markers explains the last windows better.
    Permutation,
}

/// Turns windows of lines into poses. Keeps what it learnt from one window to the next.
pub trait Tracker: Send {
    /// Its name in a scenario.
    fn name(&self) -> &'static str;

    /// The pose of one window, written into `out`, whose buffers are used again. After a failure `out` holds the roles alone.
    ///
    /// # Errors
    /// [`Failure`]: the window does not support a pose.
    fn track_into(&mut self, lines: &[Line], prior: Option<&Prior>, out: &mut Tracked)
    -> Result<(), Failure>;

    /// The pose of one window.
    ///
    /// # Errors
    /// [`Failure`]: the window does not support a pose.
    fn track(&mut self, lines: &[Line], prior: Option<&Prior>) -> Result<Tracked, Failure> {
        let mut out = Tracked::default();
        self.track_into(lines, prior, &mut out).map(|()| out)
    }

    /// Where the scanner stands in the frame of the lines, if a bed moves it: beforehand, for each window. At the origin until told.
    fn scanner_at(&mut self, _place_world_m: &Vector3<f64>) {}

    /// What it keeps from window to window.
    fn memory(&self) -> Memory;

    /// Goes on from a memory.
    fn recall(&mut self, memory: Memory);
}

/// Goes back in time: from a pose, a tracker follows `earlier` windows (in order of time) from the last to the first. It then holds the
/// first one's pose alone, as a place to start from; a window that fails hands on the pose of the one after it.
pub fn rewind<'w>(
    tracker: &mut dyn Tracker,
    from: &Isometry3<f64>,
    earlier: impl DoubleEndedIterator<Item = &'w [Line]>,
) {
    let start = |pose| Memory { world_from_capsule: Some(pose), started: true, ..Memory::default() };
    let (mut pose, mut tracked) = (*from, Tracked::default());
    for lines in earlier.rev() {
        tracker.recall(start(pose));
        if tracker.track_into(lines, None, &mut tracked).is_ok() {
            pose = tracked.world_from_capsule;
        }
    }
    tracker.recall(start(pose));
}

/// What a tracker keeps from window to window: everything that its next answer depends on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Windows seen.
    pub windows: u64,
    /// There was a pose (`mixture`): one that is lost is searched for at once, the first may wait for several windows.
    pub started: bool,
    /// The last window's pose; `None` before the first and after a failure.
    pub world_from_capsule: Option<Isometry3<f64>>,
    /// Centroid of the lines of the last window that had one, m.
    pub centroid_world_m: Option<Vector3<f64>>,
    /// Places of the markers in the last window, m.
    pub markers_world_m: Vec<Vector3<f64>>,
    /// Share of background lines in the last window.
    pub background_share: Option<f64>,
    /// Share of background among the lines that pass near, over some windows (`mixture`).
    pub background_near: Option<f64>,
    /// Log-likelihood per line, less that of mere background, of the last windows.
    pub mean_log_likelihoods: Vec<f64>,
    /// Marker positions in the capsule's frame as estimated so far; `None` where they are not estimated.
    pub marker_estimate: Option<estimate_markers::MarkerEstimate>,
    /// A search found that the followed pose, or the prediction, is wrong, and not yet which is right (`mixture`).
    pub doubted: bool,
    /// Log-likelihood by which each other order of the markers was ahead of the one that is followed, in all tests since it was found
    /// (`mixture`).
    pub order_evidence: Vec<f64>,
    /// The last windows: their lines and the pose given for each.
    pub recent: Vec<(Vec<Line>, Isometry3<f64>)>,
}
