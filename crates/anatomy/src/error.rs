//! The one error type of this crate.
//!
//! Geometry speaks of points and arc lengths; the loader of [`crate::tract_file`] turns each of these into a
//! [`lumenav_core::ConfigError`] at the file, line and key that caused it.

use crate::segment::SegmentKey;
use lumenav_core::{ConfigError, Node};

/// What can be wrong with a tract or with one of its parts.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AnatomyError {
    /// A centre line needs at least two points.
    #[error("a centre line needs at least 2 points, there are {count}")]
    TooFewPoints {
        /// Points given.
        count: usize,
    },
    /// More points than any anatomy has.
    #[error("a centre line has at most {limit} points, there are {count}")]
    TooManyPoints {
        /// Points given.
        count: usize,
        /// Points allowed.
        limit: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} is not finite")]
    PointNotFinite {
        /// Index of the point, from 0.
        index: usize,
    },
    /// A coordinate is far outside any room.
    #[error("point {index} lies more than {limit_m} m from the origin (are its units right?)")]
    PointTooFar {
        /// Index of the point, from 0.
        index: usize,
        /// Largest coordinate allowed, m.
        limit_m: f64,
    },
    /// Two neighbours coincide.
    #[error("points {} and {index} are {distance_m:e} m apart: neighbours have to differ by at least 1e-6 m", index - 1)]
    RepeatedPoint {
        /// Index of the second of the two points, from 0.
        index: usize,
        /// Their distance, m.
        distance_m: f64,
    },
    /// The line is longer than any anatomy.
    #[error("the centre line is {length_m} m long, at most {limit_m} m are allowed (are its units right?)")]
    TooLong {
        /// Sum of the chords, m.
        length_m: f64,
        /// Length allowed, m.
        limit_m: f64,
    },
    /// The curve through the points turns on the spot.
    #[error("the centre line turns back on the spot between points {} and {index}", index - 1)]
    Cusp {
        /// Index of the point after the cusp, from 0.
        index: usize,
    },
    /// A value that has to be positive and finite is not.
    #[error("{name} has to be positive and finite, it is {value}")]
    NotPositive {
        /// Name with its unit.
        name: &'static str,
        /// The value.
        value: f64,
    },
    /// A rhythm so fast, or waves so slow, that they would pile up.
    #[error(
        "{at_once:.0} waves of one place would run at a time (rate x run / speed), at most {limit} may; look at {name}"
    )]
    TooManyWaves {
        /// Key of the speed.
        name: &'static str,
        /// Waves at a time, on average.
        at_once: f64,
        /// Waves allowed.
        limit: f64,
    },
    /// One of the scheduled waves cannot be.
    #[error("scheduled wave {}: {error}", index + 1)]
    InWave {
        /// Its place in the list, from 0.
        index: usize,
        /// What is wrong with it.
        error: Box<AnatomyError>,
    },
    /// One of the faults cannot be.
    #[error("fault {}: {error}", index + 1)]
    InFault {
        /// Its place in the list, from 0.
        index: usize,
        /// What is wrong with it.
        error: Box<AnatomyError>,
    },
    /// One of the meals cannot be.
    #[error("meal {}: {error}", index + 1)]
    InMeal {
        /// Its place in the list, from 0.
        index: usize,
        /// What is wrong with it.
        error: Box<AnatomyError>,
    },
    /// An interval that another one of its kind has already.
    #[error("{name}: it overlaps an earlier one; allowed: before that begins or after it ends")]
    Overlap {
        /// Name with its unit.
        name: &'static str,
    },
    /// A fault of organs that the tract does not have.
    #[error("{fault} concerns {}; this tract has: {}", list(organs), list(available))]
    NoSuchOrgan {
        /// The fault, as files name it.
        fault: &'static str,
        /// What it concerns.
        organs: &'static [SegmentKey],
        /// Segments of the tract, in order.
        available: Vec<SegmentKey>,
    },
    /// A value outside its range.
    #[error("{name} has to be from {low} to {high}, it is {value}")]
    OutOfRange {
        /// Name with its unit.
        name: &'static str,
        /// The value.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// The stations of a profile do not increase.
    #[error("the arc lengths of a radius profile have to increase; entry {index} does not")]
    NotIncreasing {
        /// Index of the entry, from 0.
        index: usize,
    },
    /// Segments asked for that this tract does not have.
    #[error("no segment `{asked}`; this tract has: {}", list(available))]
    NoSuchSegment {
        /// The name asked for.
        asked: String,
        /// Segments of the tract, in order.
        available: Vec<SegmentKey>,
    },
    /// A selection that leaves a hole or is out of order.
    #[error(
        "segments have to be consecutive and in order from mouth to anus; `{after}` does not follow `{before}` in: {}",
        list(available)
    )]
    NotConsecutive {
        /// The segment before.
        before: SegmentKey,
        /// The one that does not follow it.
        after: SegmentKey,
        /// Segments of the tract, in order.
        available: Vec<SegmentKey>,
    },
    /// An empty tract.
    #[error("a tract needs at least one segment")]
    NoSegments,
    /// Two segments do not meet.
    #[error("`{before}` ends {gap_m} m before `{after}` begins; gaps below {limit_m} m are bridged")]
    Gap {
        /// The segment before.
        before: SegmentKey,
        /// The segment after.
        after: SegmentKey,
        /// Distance between them, m.
        gap_m: f64,
        /// Largest gap bridged, m.
        limit_m: f64,
    },
    /// The centre line comes too close to itself.
    #[error(
        "the centre line comes within {distance_m:.5} m of itself, at {first_m:.4} m (`{first}`) and {second_m:.4} m \
         (`{second}`) along it; at least {limit_m} m are needed"
    )]
    SelfApproach {
        /// The smaller arc length, m.
        first_m: f64,
        /// Its segment.
        first: SegmentKey,
        /// The larger arc length, m.
        second_m: f64,
        /// Its segment.
        second: SegmentKey,
        /// Distance, m.
        distance_m: f64,
        /// Distance needed, m.
        limit_m: f64,
    },
    /// The generator found no whole gut that meets its request.
    #[error("no gut in {attempts} attempts met the request; the last: {reason}")]
    NoGutFound {
        /// Attempts made.
        attempts: u32,
        /// Why the last one failed.
        reason: String,
    },
    /// The generator found no anatomy that meets its request.
    #[error("no colon in {attempts} attempts met the request: {reason}")]
    NoColonFound {
        /// Attempts made.
        attempts: u32,
        /// Why the last one failed.
        reason: String,
    },
}

fn list(keys: &[SegmentKey]) -> String {
    keys.iter().map(SegmentKey::as_str).collect::<Vec<_>>().join(", ")
}

impl AnatomyError {
    /// The error of a `[motility]` table at the key that caused it.
    pub fn at_motility(&self, motility: &Node) -> ConfigError {
        let message = self.to_string();
        match self {
            Self::InWave { index, error }
            | Self::InFault { index, error }
            | Self::InMeal { index, error } => {
                let list = match self {
                    Self::InWave { .. } => "wave",
                    Self::InFault { .. } => "fault",
                    _ => "meal",
                };
                let entries = motility.children(list).unwrap_or_default();
                match (entries.get(*index), error.key()) {
                    (Some(entry), Some(key)) => entry.error_at(key, &message),
                    (Some(entry), None) => entry.error(&message),
                    (None, _) => motility.error(&message),
                }
            }
            _ => match self.key().map(|key| (key, key.split_once('.'))) {
                Some((_, Some((table, key)))) => motility.child_or_empty(table).error_at(key, &message),
                Some((key, None)) => motility.error_at(key, &message),
                None => motility.error(&message),
            },
        }
    }

    /// The key that a message about a number begins with.
    fn key(&self) -> Option<&str> {
        match self {
            Self::NotPositive { name, .. }
            | Self::OutOfRange { name, .. }
            | Self::Overlap { name }
            | Self::TooManyWaves { name, .. } => name.split_whitespace().next(),
            Self::NoSuchSegment { .. } => Some("segment"),
            Self::NoSuchOrgan { .. } => Some("kind"),
            _ => None,
        }
    }
}
