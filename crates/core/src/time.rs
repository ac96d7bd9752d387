//! Time: integer nanoseconds since the scenario's start.
//!
//! Integers so that two rates meet exactly where they should and replay is bit-exact; seconds as `f64` appear only
//! at the border (files, printouts) and inside filters as differences.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{Add, Sub};

/// Nanoseconds since the scenario's start (may be negative: a sensor's window can reach before it).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SimTime(pub i64);

/// Nanoseconds in a second.
pub const NANOSECONDS_PER_SECOND: i64 = 1_000_000_000;

impl SimTime {
    /// The scenario's start.
    pub const ZERO: Self = Self(0);

    /// The nearest nanosecond to `seconds`.
    pub fn from_seconds(seconds: f64) -> Self {
        Self(nanoseconds(seconds))
    }

    /// Seconds since the start.
    pub fn seconds(self) -> f64 {
        // Whole and fractional part apart: exact to the nanosecond for any exam length.
        (self.0 / NANOSECONDS_PER_SECOND) as f64 + (self.0 % NANOSECONDS_PER_SECOND) as f64 * 1e-9
    }

    /// Signed seconds from `earlier` to `self`.
    pub fn since_s(self, earlier: Self) -> f64 {
        (self.0 - earlier.0) as f64 * 1e-9
    }

    /// The middle of an interval, the time stamp a reading stands for.
    pub fn middle(interval: (Self, Self)) -> Self {
        Self(interval.0.0 + (interval.1.0 - interval.0.0) / 2)
    }
}

/// The nearest whole number of nanoseconds to a duration in seconds.
pub fn nanoseconds(seconds: f64) -> i64 {
    (seconds * NANOSECONDS_PER_SECOND as f64).round() as i64
}

impl Add<i64> for SimTime {
    type Output = Self;
    fn add(self, nanoseconds: i64) -> Self {
        Self(self.0.saturating_add(nanoseconds))
    }
}

impl Sub<i64> for SimTime {
    type Output = Self;
    fn sub(self, nanoseconds: i64) -> Self {
        Self(self.0.saturating_sub(nanoseconds))
    }
}

impl Sub for SimTime {
    type Output = i64;
    fn sub(self, other: Self) -> i64 {
        self.0 - other.0
    }
}

impl fmt::Display for SimTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s", self.seconds())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_seconds_and_nanoseconds_round_trip() {
        for ns in [0, 1, -1, 999_999_999, 28_800_000_000_001, -5_000_000_007] {
            assert_eq!(SimTime::from_seconds(SimTime(ns).seconds()), SimTime(ns));
        }
    }

    #[test]
    fn closed_form_middle_of_a_window() {
        assert_eq!(SimTime::middle((SimTime(10), SimTime(20))), SimTime(15));
    }
}
