//! The fed state: `[[motility.meal]]`.
//!
//! A meal interrupts the migrating motor complex: as long as it is digested the small bowel contracts irregularly everywhere, more weakly than
//! in phase II (58 mN of traction for 74, Ahluwalia 1994), and the pylorus holds back what is as large as a capsule. Then the complex goes on where its clock stands.
//!
//! Neglected: the lag until the pattern sets in, the meal's energy, that the next complex begins anew, and the colon's answer to a meal.

use crate::error::AnatomyError;
use crate::motility_limits::in_range;
use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use serde::{Deserialize, Serialize};

/// Times of a meal, s.
const LATEST_S: f64 = 1e9;

/// `[[motility.meal]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MealConfig {
    /// When the fed pattern begins, s. Default 0.
    pub start_s: NonNegative,
    /// How long it lasts, s. Default 12960: 3.6 h, in which the stomach empties of a meal and then of a motility pill (S).
    pub duration_s: Positive,
    /// Part of the full rate of contractions in the small bowel. Default 0.2, that of phase II (B).
    pub rate_factor: Fraction,
    /// Factor on their amplitudes. Default 0.91 [T to 58 mN of traction].
    pub amplitude_factor: Fraction,
}

impl Default for MealConfig {
    fn default() -> Self {
        Self {
            start_s: NonNegative(0.0),
            duration_s: Positive(12_960.0),
            rate_factor: Fraction(0.2),
            amplitude_factor: Fraction(0.91),
        }
    }
}

impl MealConfig {
    pub(crate) fn check(&self) -> Result<(), AnatomyError> {
        in_range("start_s", self.start_s.0, 0.0, LATEST_S)?;
        in_range("duration_s", self.duration_s.0, 0.0, LATEST_S)
    }

    /// When it ends, s.
    pub(crate) fn end_s(&self) -> f64 {
        self.start_s.0 + self.duration_s.0
    }

    /// Whether both are digested at some time.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        self.start_s.0 < other.end_s() && other.start_s.0 < self.end_s()
    }

    /// Whether it is digested at `time_s`.
    pub(super) fn lasts_at(&self, time_s: f64) -> bool {
        (self.start_s.0..self.end_s()).contains(&time_s)
    }
}
