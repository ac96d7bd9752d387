//! What may be out of order: `[[motility.fault]]`.
//!
//! A fault leaves only a part of an organ's contractions, from a time on and for a while: gastroparesis those of the stomach (and with them the
//! openings of the pylorus), ileus those of the small bowel and the colon. Waves that run when it begins end as they would have.
//!
//! Reflux leaves a part of the duodenum's aboral contractions; the others run towards the stomach, through a pylorus that stands open as long. Of the
//! antral waves, which would meet them there, it leaves the same part: duodenal waves run back when the antrum rests (*juxtapyloric retroperistalsis* in the bibliography), and contents
//! come back with them (Castedal et al. 2000) through a pylorus that is open (Ehrlein et al. 1989, in dogs).

use crate::error::AnatomyError;
use crate::motility_limits::in_range;
use crate::segment::SegmentKey;
use crate::tract::Tract;
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
    /// Part of the contractions that is left (in reflux: of the stomach's, and of the duodenum's aboral ones), 0 to 1. Default 0: none.
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
    /// Duodenum and pylorus: what is in the duodenum comes back into the stomach.
    Reflux,
}

impl FaultKind {
    /// As files name it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Gastroparesis => "gastroparesis",
            Self::Ileus => "ileus",
            Self::Reflux => "reflux",
        }
    }

    /// The segments that it concerns.
    fn segments(self) -> &'static [SegmentKey] {
        use SegmentKey as Key;
        match self {
            Self::Gastroparesis => &[Key::Stomach],
            Self::Ileus => &[
                Key::Duodenum,
                Key::Jejunum,
                Key::Ileum,
                Key::TerminalIleum,
                Key::Caecum,
                Key::Ascending,
                Key::Transverse,
                Key::Descending,
                Key::Sigmoid,
                Key::Rectum,
            ],
            Self::Reflux => &[Key::Duodenum],
        }
    }
}

/// The kind of organ whose contractions a cell makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Organ {
    Oesophagus,
    Stomach,
    Duodenum,
    /// What of it lies behind the duodenum.
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
            FaultKind::Ileus => matches!(organ, Organ::Duodenum | Organ::SmallBowel | Organ::Colon),
            FaultKind::Reflux => matches!(organ, Organ::Stomach | Organ::Duodenum),
        }
    }

    /// While contents come back through the pylorus, s.
    pub(crate) fn reflux_s(&self) -> Option<[f64; 2]> {
        let end_s = self.end_s.map_or(f64::INFINITY, |end_s| end_s.0);
        (self.kind == FaultKind::Reflux).then_some([self.start_s.0, end_s])
    }

    /// Whether another one of its kind lasts at the same time.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let end_s = |fault: &Self| fault.end_s.map_or(f64::INFINITY, |end_s| end_s.0);
        self.kind == other.kind && self.start_s.0 < end_s(other) && other.start_s.0 < end_s(self)
    }

    /// Refuses a fault of organs that the tract has not.
    pub(crate) fn check_organs(&self, tract: &Tract) -> Result<(), AnatomyError> {
        let organs = self.kind.segments();
        if tract.segments.iter().any(|segment| organs.contains(&segment.key)) {
            return Ok(());
        }
        let available = tract.segments.iter().map(|segment| segment.key).collect();
        Err(AnatomyError::NoSuchOrgan { fault: self.kind.as_str(), organs, available })
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
    /// What does not remain runs the other way.
    turns: bool,
}

impl Impairment {
    /// Those of an organ.
    pub(crate) fn of(faults: &[FaultConfig], organ: Organ) -> Vec<Self> {
        let concerned = faults.iter().filter(|fault| fault.concerns(organ));
        let impairment = |fault: &FaultConfig| Self {
            start_s: fault.start_s.0,
            end_s: fault.end_s.map_or(f64::INFINITY, |end_s| end_s.0),
            remaining: fault.remaining.0,
            turns: fault.kind == FaultKind::Reflux && organ == Organ::Duodenum,
        };
        concerned.map(impairment).collect()
    }

    /// Part of the contractions that is left at a time.
    pub(super) fn remaining(all: &[Self], time_s: f64) -> f64 {
        Self::present(all, time_s).filter(|one| !one.turns).map(|one| one.remaining).product()
    }

    /// Part of the aboral contractions that still run aborally at a time.
    pub(super) fn aboral(all: &[Self], time_s: f64) -> f64 {
        Self::present(all, time_s).filter(|one| one.turns).map(|one| one.remaining).product()
    }

    /// Whether contractions run the other way at a time.
    pub(super) fn turns(all: &[Self], time_s: f64) -> bool {
        Self::present(all, time_s).any(|one| one.turns)
    }

    fn present(all: &[Self], time_s: f64) -> impl Iterator<Item = &Self> {
        all.iter().filter(move |one| (one.start_s..one.end_s).contains(&time_s))
    }
}
