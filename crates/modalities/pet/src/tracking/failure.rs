//! Why a window has no pose.

use nalgebra::Isometry3;

/// Why a window has no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// Not enough lines, or too many of them no lines at all.
    #[error("{usable} usable lines of {given}; needed: {needed}")]
    TooFewLines {
        /// Lines of the window.
        given: usize,
        /// Those with two different, finite ends.
        usable: usize,
        /// The least.
        needed: usize,
    },
    /// A first pose is taken from several windows together, and there are not yet so many.
    #[error("a first pose is taken from up to {needed} windows together; {have} so far")]
    Gathering {
        /// Windows so far, this one included.
        have: usize,
        /// How many are waited for at most.
        needed: usize,
    },
    /// The lines all run one way, so that they do not fix a point.
    #[error("the lines run too much one way to fix a point (relative spread {spread:.1e})")]
    Parallel {
        /// Smallest over largest eigenvalue of the lines' information about a point.
        spread: f64,
    },
    /// Hardly a line passes the markers.
    #[error("{effective:.1} lines pass the markers, {background:.0} % are background; needed: {needed}")]
    Background {
        /// Lines that the markers explain.
        effective: f64,
        /// Share of background, per cent.
        background: f64,
        /// The least.
        needed: usize,
    },
    /// Background alone explains the window nearly as well as the best pose does: among so many places, one like it is found by chance.
    #[error(
        "background alone explains the lines nearly as well (log-likelihood gain {gain:.1}; needed: {needed})"
    )]
    NoEvidence {
        /// Log-likelihood of the pose less that of a window that is all background.
        gain: f64,
        /// The least.
        needed: f64,
    },
    /// The steps ran out.
    #[error("not converged after {steps} steps")]
    NotConverged {
        /// Steps taken.
        steps: u32,
    },
    /// The observed information is not positive definite: the top of the likelihood is no top.
    #[error("the information about the pose is not positive definite")]
    Indefinite,
    /// The standard deviation exceeds what a pose is worth.
    #[error(
        "the pose is too uncertain: {position_mm:.1} mm, {rotation_deg:.0} degrees (allowed {allowed_mm:.1} mm, {allowed_deg:.0} degrees)"
    )]
    Uncertain {
        /// Largest standard deviation of position.
        position_mm: f64,
        /// Largest standard deviation of rotation.
        rotation_deg: f64,
        /// Allowed.
        allowed_mm: f64,
        /// Allowed.
        allowed_deg: f64,
    },
    /// Poses that are no symmetry of the markers explain the window equally well.
    #[error("{} poses explain the window equally well (log-likelihood difference {difference:.2})", poses.len())]
    Ambiguous {
        /// The poses, the likeliest first.
        poses: Vec<Isometry3<f64>>,
        /// Log-likelihood of the second less that of the first.
        difference: f64,
    },
    /// Other poses explain the lines much better than the followed one, but it is not clear which.
    #[error("the followed pose is doubted: {why}")]
    Doubted {
        /// What the search for a better one ended with.
        why: Box<Failure>,
    },
    /// A marker has nearly no lines (than2015 section 5.5.1).
    #[error("marker {} has a share of {share:.4} of the lines (allowed: {allowed} or more)", marker + 1)]
    Share {
        /// Which, counted from 0.
        marker: usize,
        /// Its share.
        share: f64,
        /// The least.
        allowed: f64,
    },
    /// Two markers stand at a distance that the capsule does not allow (than2015 section 5.5.1).
    #[error("markers {} and {} are {distance_mm:.1} mm apart (allowed: {:.1} to {:.1} mm)", pair[0] + 1, pair[1] + 1, allowed_mm[0], allowed_mm[1])]
    Distance {
        /// Which two, counted from 0.
        pair: [usize; 2],
        /// How far apart.
        distance_mm: f64,
        /// The least and the most.
        allowed_mm: [f64; 2],
    },
    /// Independent points are numbered where all of them are seen, and that was not yet so; or of those that were lost one is back that
    /// could be any.
    #[error("{found} of {points} points found; which is which is not clear before all of them are seen")]
    Unnumbered {
        /// Points found.
        found: usize,
        /// How many there are, or were lost.
        points: usize,
    },
    /// Two independent points are nearer to each other than the region within which the background of each is taken as even.
    #[error("points {} and {} are {distance_mm:.1} mm apart (allowed: {allowed_mm:.0} mm or more)", pair[0] + 1, pair[1] + 1)]
    TooClose {
        /// Which two, counted from 0.
        pair: [usize; 2],
        /// How far apart.
        distance_mm: f64,
        /// The least.
        allowed_mm: f64,
    },
}
