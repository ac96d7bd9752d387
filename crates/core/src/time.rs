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

    /// Seconds in decimal notation, exact where the text has at most nine decimals; `None` where it is no finite number or too large.
    pub fn parse_seconds(text: &str) -> Option<Self> {
        let (negative, digits) = match text.strip_prefix('-') {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
        let plain = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
        if (whole.is_empty() && fraction.is_empty())
            || !plain(whole)
            || !plain(fraction)
            || fraction.len() > 9
        {
            // Exponents and longer fractions: as good as f64 can tell.
            let nanoseconds = text.parse::<f64>().ok()? * 1e9;
            return (nanoseconds.abs() < 9.2e18).then_some(Self(nanoseconds.round() as i64));
        }
        let whole: i64 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
        let fraction: i64 = format!("{fraction:0<9}").parse().ok()?;
        let magnitude = whole.checked_mul(NANOSECONDS_PER_SECOND)?.checked_add(fraction)?;
        Some(Self(if negative { -magnitude } else { magnitude }))
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
    fn closed_form_times_as_people_write_them() {
        for (text, ns) in [
            ("1.5", 1_500_000_000),
            (".25", 250_000_000),
            ("1e-3", 1_000_000),
            ("2", 2_000_000_000),
            ("1700000000.123456789", 1_700_000_000_123_456_789),
            ("-5.000000007", -5_000_000_007),
        ] {
            assert_eq!(SimTime::parse_seconds(text), Some(SimTime(ns)), "{text}");
        }
        for bad in ["", "-", ".", "nan", "inf", "1e30", "x", "1,5"] {
            assert_eq!(SimTime::parse_seconds(bad), None, "{bad}");
        }
    }

    #[test]
    fn closed_form_middle_of_a_window() {
        assert_eq!(SimTime::middle((SimTime(10), SimTime(20))), SimTime(15));
    }
}
