//! The errors of this crate: what was asked of a statistic that it cannot give.

use thiserror::Error;

/// Everything that can go wrong while judging a track.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EvaluationError {
    /// A covariance that is no covariance: it claims no error, or less than none, in some direction.
    #[error("a covariance of {size} x {size} is not positive definite")]
    NotPositiveDefinite {
        /// Rows of the matrix.
        size: usize,
    },
    /// An error vector and its covariance, or two series, do not belong together.
    #[error("{what}: {first} and {second} do not belong together")]
    ShapeMismatch {
        /// Which two things were compared.
        what: &'static str,
        /// Length of the first.
        first: usize,
        /// Length of the second.
        second: usize,
    },
    /// A number that is NaN or infinite where a finite one is needed.
    #[error("{what}: value {index} is not finite")]
    NotFinite {
        /// What the number stood for.
        what: &'static str,
        /// Its index in the series.
        index: usize,
    },
    /// The statistic needs more data.
    #[error("{what} needs at least {needed} values, {given} given")]
    TooFew {
        /// The statistic.
        what: &'static str,
        /// How many it needs.
        needed: usize,
        /// How many there are.
        given: usize,
    },
    /// A parameter outside of what it may be.
    #[error("{what} must be {allowed}, {value} given")]
    OutOfRange {
        /// The parameter.
        what: &'static str,
        /// What it may be.
        allowed: &'static str,
        /// What it was.
        value: f64,
    },
    /// Time stands still or runs backwards within a trajectory.
    #[error("time does not increase at pose {index} of the trajectory")]
    TimeNotIncreasing {
        /// Index of the later pose.
        index: usize,
    },
    /// No two poses of the trajectories are close enough in time.
    #[error("no stamps of the two trajectories are within {max_difference_s} s of each other")]
    NoMatchingStamps {
        /// The largest difference allowed, s.
        max_difference_s: f64,
    },
    /// The alignment is not determined by the positions: they lie on a line or in one point.
    #[error(
        "the positions do not determine an alignment: they lie on a line or in one point \
         (singular values of their covariance {largest_m2:e} and {second_m2:e} m^2)"
    )]
    DegenerateAlignment {
        /// Largest singular value of the cross covariance, m^2.
        largest_m2: f64,
        /// Second singular value, m^2.
        second_m2: f64,
    },
    /// No pair of poses is as far apart as a relative error asks for.
    #[error("no pair of poses is {delta} apart")]
    NoPairs {
        /// The distance asked for, with its unit.
        delta: String,
    },
}

/// Checks that every value of a series is finite.
pub(crate) fn all_finite(what: &'static str, values: &[f64]) -> Result<(), EvaluationError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(EvaluationError::NotFinite { what, index }),
        None => Ok(()),
    }
}

/// Checks that a number is a share strictly between 0 and 1.
pub(crate) fn proper_share(what: &'static str, value: f64) -> Result<(), EvaluationError> {
    if value > 0.0 && value < 1.0 {
        Ok(())
    } else {
        Err(EvaluationError::OutOfRange { what, allowed: "between 0 and 1", value })
    }
}
