//! Seeded generators of tracts: a colon ([`colon()`]) and a whole gut from mouth to anus ([`whole_gut`]).
//!
//! Every generator draws from the streams of one seed, keeps the first attempt that lies in the measured ranges, counts its
//! attempts, and refuses with the reason of the last one. Equal seeds make equal bytes.

mod colon;
mod relaxation;
mod small_bowel;
mod upper;
mod whole;

pub use colon::{ColonRequest, MEASURED, MEASURED_BEND_RADIUS_M, MEASURED_SHARP_TURNS, Ranges, colon};
pub use whole::{BodySize, WholeGutRequest, whole_gut};

use crate::segment::SegmentKey;
use crate::tract::{End, SegmentPoints, Tract, TractDraft, TractReport};
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::{Point3, Vector3};
use rand::Rng as _;
use std::fmt::Write as _;

/// Distance of the points of a generated line, m.
const STEP_M: f64 = 0.006;

/// A generated tract.
#[derive(Debug, Clone)]
pub struct Generated {
    /// Its points.
    pub draft: TractDraft,
    /// The tract built of them.
    pub tract: Tract,
    /// What building it had to tell.
    pub report: TractReport,
    /// Attempts it took, from 1.
    pub attempts: u32,
}

/// Random numbers of one attempt.
struct Draws(RandomStream);

impl Draws {
    fn new(streams: &RandomStreams, purpose: &str, attempt: u32) -> Self {
        Self(streams.stream(purpose, u64::from(attempt)))
    }

    /// Uniform on [low, high): 53 random bits over 2^53, the same in every release of `rand`.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    /// One of `0..count`.
    fn below(&mut self, count: usize) -> usize {
        // The modulo's bias is below count / 2^64.
        (self.0.next_u64() % count.max(1) as u64) as usize
    }

    fn vector(&mut self, reach: f64) -> Vector3<f64> {
        let [x, y, z] = [(); 3].map(|()| self.between(-reach, reach));
        Vector3::new(x, y, z)
    }
}

/// Points of a line in the making, with the segment each belongs to.
#[derive(Debug, Clone, Default)]
struct Line {
    keys: Vec<SegmentKey>,
    points_m: Vec<Point3<f64>>,
    radii_m: Vec<f64>,
}

impl Line {
    fn push(&mut self, key: SegmentKey, point_m: Point3<f64>, radius_m: f64) {
        self.keys.push(key);
        self.points_m.push(point_m);
        self.radii_m.push(radius_m);
    }

    /// The segments, rounded to what a file keeps; neighbours share the point where they meet.
    fn segments(&self) -> Vec<SegmentPoints> {
        let mut segments: Vec<SegmentPoints> = Vec::new();
        for ((key, point), radius) in self.keys.iter().zip(&self.points_m).zip(&self.radii_m) {
            let (point, radius) = (round_to_micrometres(*point), (radius * 1e6).round() * 1e-6);
            let mut add = |segment: &mut SegmentPoints| {
                segment.points_m.push(point);
                segment.radii_m.push(radius);
            };
            if segments.last().is_some_and(|last| last.key == *key) {
                segments.iter_mut().last().map(add);
                continue;
            }
            segments.iter_mut().last().map(&mut add);
            let wall = key.default_wall();
            let source = String::new();
            segments.push(SegmentPoints {
                key: *key,
                points_m: vec![point],
                radii_m: vec![radius],
                wall,
                source,
            });
        }
        segments
    }
}

/// What a file keeps, so that the tract and its file are the same.
fn round_to_micrometres(point: Point3<f64>) -> Point3<f64> {
    point.map(|coordinate| (coordinate * 1e6).round() * 1e-6)
}

/// The tract file of a draft (torso frame); `made_by` is the command that made it, for the header.
pub fn tract_file_text(draft: &TractDraft, made_by: &str) -> String {
    let mut text = String::new();
    // Writing into a String cannot fail.
    let _ = writeln!(text, "# Made by: {}", made_by.replace('\n', " "));
    let _ = writeln!(text, "[tract]\nframe = \"ras\"\nname = {}", quoted(&draft.name));
    let _ = writeln!(text, "source = {}", quoted(&draft.source));
    let end = |end: End| if end == End::Exit { "exit" } else { "closed" };
    let _ = writeln!(text, "ends = [\"{}\", \"{}\"]", end(draft.ends.0), end(draft.ends.1));
    for segment in &draft.segments {
        let _ = writeln!(text, "\n[[tract.segment]]\nname = \"{}\"", segment.key);
        if !segment.source.is_empty() {
            let _ = writeln!(text, "source = {}", quoted(&segment.source));
        }
        let _ = writeln!(text, "points_mm = [ # x, y, z, radius");
        for (point, radius) in segment.points_m.iter().zip(&segment.radii_m) {
            let [x, y, z, r] = [point.x, point.y, point.z, *radius].map(|v| 1e3 * v);
            let _ = writeln!(text, "  [{x:.3}, {y:.3}, {z:.3}, {r:.3}],");
        }
        let _ = writeln!(text, "]");
    }
    text
}

/// A TOML string.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}
