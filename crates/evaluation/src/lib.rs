//! How good is a track, and does it know how good it is?
//!
//! A *track* is what an estimator says over time: a pose, and a covariance that claims how wrong the pose may
//! be. Two questions follow, and this crate keeps them side by side.
//!
//! **How wrong was it?** [`pose_error`] compares one estimate with the truth of the same instant; [`summary`]
//! collects such errors into mean, RMSE, median, p95 and maximum ([`bounded`] in constant memory); [`trajectory`] gives absolute and relative
//! errors (ATE, APE, RPE) of whole trajectories as the tool `evo` does; [`bound`] sets the error against the
//! best that the measurements allow; [`plausibility`] asks what can be asked without a truth.
//!
//! **Did it know?** An estimator that is 2 mm off and claims 2 mm is worth more than one that is 1 mm off and
//! claims 0.1 mm: a doctor, a magnet controller or another filter acts on the claim. The measure is the
//! *normalised estimation error squared*,
//!
//! ```text
//! NEES = error^T * (claimed covariance)^-1 * error
//! ```
//!
//! the squared error counted in claimed standard deviations. For a right claim its mean is the number of
//! components of the error (3 for a position): twice as much means errors 1.4 times as large as claimed
//! (*overconfident*), a quarter means half as large (*cautious*). The same form of the innovation, measured
//! minus predicted, is the NIS; it needs no truth. [`consistency`] has both, the bands they must lie in, what
//! may be tested with what, and a verdict in words.
//!
//! **Is that luck?** [`monte_carlo`] puts intervals around means over trials and compares tracks on the same
//! seeds.
//!
//! ```
//! use lumenav_evaluation::consistency::{ErrorBlock, one_run::NeesAccumulator, verdict::Verdict};
//! use lumenav_evaluation::pose_error::PoseError;
//! use nalgebra::{Isometry3, Matrix6};
//!
//! let mut nees = NeesAccumulator::new(ErrorBlock::Position.dof())?;
//! let claimed = Matrix6::identity() * 0.001_f64.powi(2); // 1 mm in each axis
//! for k in 0..100 {
//!     let truth = Isometry3::translation(0.001 * f64::from(k), 0.0, 0.0);
//!     let estimate = Isometry3::translation(0.001 * f64::from(k), 0.004, 0.0); // 4 mm off
//!     nees.push_pose(&PoseError::between(&estimate, &truth), &claimed, ErrorBlock::Position)?;
//! }
//! let verdict = nees.summary().map(|summary| Verdict::of_run(&summary));
//! assert!(verdict.is_some_and(|verdict| verdict.to_string().starts_with("overconfident: mean NEES 16.00")));
//! # Ok::<(), lumenav_evaluation::error::EvaluationError>(())
//! ```
//!
//! Conventions: SI units; poses are `world_from_capsule`; errors are `[dp_world (3), dtheta_capsule (3)]` by
//! right perturbation. Not covered: comparison of several targets (one capsule, one truth), tests of attitude
//! distributions far from Gaussian (a particle filter's ring of headings has no useful covariance).

pub mod bound;
pub mod bounded;
pub mod chi_square;
pub mod consistency;
pub mod displacement;
pub mod error;
pub mod monte_carlo;
pub mod plausibility;
pub mod pose_error;
pub mod summary;
pub mod trajectory;

pub use error::EvaluationError;
