//! The one error type of this crate.

use std::fmt;

/// What can be wrong with a field source or with the slices of a batch call.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldError {
    /// A size that has to be positive and finite is not.
    NotPositive {
        /// Name of the parameter, with its unit (`radius_m`).
        name: &'static str,
        /// The offending value, in the unit of the name.
        value: f64,
    },
    /// A strength that has to be finite is not.
    NotFinite {
        /// Name of the parameter, with its unit (`remanence_tesla`).
        name: &'static str,
        /// The offending value, in the unit of the name.
        value: f64,
    },
    /// A slice of a batch call has another length than the first one.
    LengthMismatch {
        /// Name of the slice.
        name: &'static str,
        /// Length of the first slice.
        expected: usize,
        /// Length found.
        actual: usize,
    },
}

impl fmt::Display for FieldError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotPositive { name, value } => {
                write!(formatter, "{name} has to be positive and finite, it is {value}")
            }
            Self::NotFinite { name, value } => write!(formatter, "{name} has to be finite, it is {value}"),
            Self::LengthMismatch { name, expected, actual } => {
                write!(formatter, "slice {name} has {actual} elements, {expected} are expected")
            }
        }
    }
}

impl std::error::Error for FieldError {}

/// `value` if it is positive and finite.
pub(crate) fn positive(name: &'static str, value: f64) -> Result<f64, FieldError> {
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(FieldError::NotPositive { name, value }) }
}

/// `value` if it is finite.
pub(crate) fn finite(name: &'static str, value: f64) -> Result<f64, FieldError> {
    if value.is_finite() { Ok(value) } else { Err(FieldError::NotFinite { name, value }) }
}

/// Nothing if `actual` is `expected`.
pub(crate) fn same_length(name: &'static str, expected: usize, actual: usize) -> Result<(), FieldError> {
    if expected == actual { Ok(()) } else { Err(FieldError::LengthMismatch { name, expected, actual }) }
}
