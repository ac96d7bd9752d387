//! What may be out of order: `[[motility.fault]]`.
//!
//! A fault leaves only a part of an organ's contractions, from a time on and for a while: gastroparesis those of the stomach (and with them the
//! openings of the pylorus), ileus those of the small bowel and the colon. Waves that run when it begins end as they would have.

use crate::error::AnatomyError;
use crate::motility_limits::in_range;
use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use serde::{Deserialize, Serialize};

/// Latest time of a fault, s.
const LATEST_S: f64 = 1e9;

/// `[[motility.fault]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultConfig {
    /// What is out of order.
    pub kind: FaultKind,
    /// From when, s. Default 0.
    #[serde(default = "zero")]
    pub start_s: NonNegative,
    /// Until when, s; for good where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_s: Option<Positive>,
    /// Part of the contractions that is left, 0 to 1. Default 0: none (a paralysis).
    #[serde(default = "none")]
    pub remaining: Fraction,
}

/// Which organs a fault concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The stomach.
    Gastroparesis,
    /// Small bowel and colon.
    Ileus,
}

/// The kind of organ whose contractions a cell makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Organ {
    Oesophagus,
    Stomach,
    SmallBowel,
    Colon,
}

fn zero() -> NonNegative {
    NonNegative(0.0)
}

fn none() -> Fraction {
    Fraction(0.0)
}

impl FaultConfig {
    fn concerns(&self, organ: Organ) -> bool {
        match self.kind {
            FaultKind::Gastroparesis => organ == Organ::Stomach,
            FaultKind::Ileus => matches!(organ, Organ::SmallBowel | Organ::Colon),
        }
    }

    pub(crate) fn check(&self) -> Result<(), AnatomyError> {
        in_range("start_s", self.start_s.0, 0.0, LATEST_S)?;
        let Some(end_s) = self.end_s else { return Ok(()) };
        // It lasts for a while.
        in_range("end_s (after start_s)", end_s.0, self.start_s.0.next_up(), LATEST_S)
    }
}

/// A fault where it concerns a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Impairment {
    start_s: f64,
    end_s: f64,
    remaining: f64,
}

impl Impairment {
    /// Those of an organ.
    pub(crate) fn of(faults: &[FaultConfig], organ: Organ) -> Vec<Self> {
        let concerned = faults.iter().filter(|fault| fault.concerns(organ));
        let impairment = |fault: &FaultConfig| Self {
            start_s: fault.start_s.0,
            end_s: fault.end_s.map_or(f64::INFINITY, |end_s| end_s.0),
            remaining: fault.remaining.0,
        };
        concerned.map(impairment).collect()
    }

    /// Part of the contractions that is left at a time.
    pub(super) fn remaining(all: &[Self], time_s: f64) -> f64 {
        let present = all.iter().filter(|one| (one.start_s..one.end_s).contains(&time_s));
        present.map(|one| one.remaining).product()
    }
}
