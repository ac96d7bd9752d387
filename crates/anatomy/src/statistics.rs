//! Figures of a tract, part by part, and how they compare with those measured in people.
//!
//! The centre line is sampled every millimetre, smoothed by a Gaussian of 5 mm, because centre lines from CT are noisy below
//! that scale, and sampled anew every millimetre of what is left (smoothing shortens bends, so samples would crowd there).
//! The reference figures were taken this way. With `x_i` the samples at distance `h`,
//!
//! ```text
//! x' = (x_i+1 - x_i-1) / 2h,   x'' = (x_i+1 - 2 x_i + x_i-1) / h²,   κ = |x' × x''| / |x'|³
//! ```
//!
//! - bend radius: 1/κ; its median and its 5th percentile (the 95th of κ), and the mean of κ;
//! - sharp turns: going along, a turn is counted where the tangent is more than 120 degrees from one at most 60 mm back (in
//!   the small bowel, whose loops are tighter, 40 mm); the search then starts afresh (as in [`crate::bends`]). The
//!   reference does not state its window; on the small bowels of `Edin00090` and the Visible Human male 40 mm give its one
//!   turn per 8 to 9 cm (27 and 30 turns on 2.29 and 2.62 m; 60 mm would give 36 and 38);
//! - length is that of the unsmoothed line; radii are sampled on it every millimetre;
//! - closest approach: smallest distance of two samples (2 mm apart) more than 60 mm apart along the line;
//! - overlaps: those of the [`TractReport`].
//!
//! The reference (five people: CT and Visible Human, GCA-Models, doi:10.1186/s12911-023-02111-9; and literature) is
//! [`MEASURED`]: each range with its source. Where there is one person, the range is a quarter to either side and says so.
//! Neglected: the first and last 15 mm of a tract, where the smoothing window is cut, keep their shortened window.

use crate::segment::SegmentKey;
use crate::tract::{NEIGHBOUR_M, Tract, TractReport};
use nalgebra::{Point3, Vector3};
use std::fmt;

mod measured;
pub use measured::{MEASURED, MeasuredRange};

/// Distance of the samples, m.
const STEP_M: f64 = 0.001;
/// Standard deviation of the smoothing, m, and where its window ends, in standard deviations.
const SMOOTHING_M: f64 = 0.005;
const WINDOW_DEVIATIONS: f64 = 3.0;
/// A turn has to happen within this length, m (small bowel; elsewhere); its angle is 120 degrees (the cosine).
const TURN_WINDOWS_M: (f64, f64) = (0.04, 0.06);
const TURN_COSINE: f64 = -0.5;
/// Every how many samples the closest approach is looked for.
const APPROACH_STRIDE: usize = 2;

/// A stretch of the gut that figures are given for: consecutive segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Its name.
    pub name: &'static str,
    /// First and last segment it may consist of.
    pub segments: (SegmentKey, SegmentKey),
}

/// The parts, in order; a tract has those of which it has a segment (`whole` ones only where both ends are there).
pub const PARTS: [Part; 12] = {
    use SegmentKey as Key;
    [
        part("oesophagus", Key::Oesophagus, Key::Oesophagus),
        part("stomach", Key::Stomach, Key::Stomach),
        part("duodenum", Key::Duodenum, Key::Duodenum),
        part("jejunum", Key::Jejunum, Key::Jejunum),
        part("ileum", Key::Ileum, Key::TerminalIleum),
        part("small bowel", Key::Duodenum, Key::TerminalIleum),
        part("caecum", Key::Caecum, Key::Caecum),
        part("ascending", Key::Ascending, Key::Ascending),
        part("transverse", Key::Transverse, Key::Transverse),
        part("descending", Key::Descending, Key::Descending),
        part("sigmoid and rectum", Key::Sigmoid, Key::Rectum),
        part("colon", Key::Caecum, Key::Rectum),
    ]
};

const fn part(name: &'static str, first: SegmentKey, last: SegmentKey) -> Part {
    Part { name, segments: (first, last) }
}

/// Figures of one part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartStatistics {
    /// Which part.
    pub part: Part,
    /// Length, m.
    pub length_m: f64,
    /// Median of the resting radius, m.
    pub radius_median_m: f64,
    /// 90th percentile of the resting radius, m.
    pub radius_p90_m: f64,
    /// Median bend radius, m.
    pub bend_radius_median_m: f64,
    /// 5th percentile of the bend radius, m.
    pub bend_radius_p5_m: f64,
    /// Mean curvature, 1/m.
    pub mean_curvature_per_m: f64,
    /// Turns of more than 120 degrees within 60 mm.
    pub sharp_turns: usize,
}

/// Figures of a tract.
#[derive(Debug, Clone, PartialEq)]
pub struct TractStatistics {
    /// Part by part, in the order of [`PARTS`].
    pub parts: Vec<PartStatistics>,
    /// Smallest distance of the centre line to itself (more than 60 mm apart along it), m; infinite on a short tract.
    pub closest_approach_m: f64,
    /// Stretches where lumina overlap.
    pub overlaps: usize,
    /// Their length along the oral of the two, m.
    pub overlap_length_m: f64,
    /// Depth of the deepest, m.
    pub deepest_overlap_m: f64,
    /// Length of the tract, m.
    pub length_m: f64,
}

/// A quantity that has a measured range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Length, m.
    Length,
    /// Median radius of the lumen, m.
    RadiusMedian,
    /// Median bend radius, m.
    BendRadiusMedian,
    /// 5th percentile of the bend radius, m.
    BendRadiusP5,
    /// Mean curvature, 1/m.
    MeanCurvature,
    /// Length per turn of more than 120 degrees, m.
    LengthPerTurn,
    /// Turns of more than 120 degrees.
    SharpTurns,
}

impl Quantity {
    /// Name, unit for people and factor from SI.
    fn words(self) -> (&'static str, &'static str, f64) {
        match self {
            Self::Length => ("length", "m", 1.0),
            Self::RadiusMedian => ("median radius", "mm", 1e3),
            Self::BendRadiusMedian => ("median bend radius", "mm", 1e3),
            Self::BendRadiusP5 => ("5th percentile of bend radius", "mm", 1e3),
            Self::MeanCurvature => ("mean curvature", "1/m", 1.0),
            Self::LengthPerTurn => ("length per turn > 120 deg", "mm", 1e3),
            Self::SharpTurns => ("turns > 120 deg", "", 1.0),
        }
    }
}

impl PartStatistics {
    /// A quantity, SI.
    pub fn get(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Length => self.length_m,
            Quantity::RadiusMedian => self.radius_median_m,
            Quantity::BendRadiusMedian => self.bend_radius_median_m,
            Quantity::BendRadiusP5 => self.bend_radius_p5_m,
            Quantity::MeanCurvature => self.mean_curvature_per_m,
            // Infinite without a turn.
            Quantity::LengthPerTurn => self.length_m / self.sharp_turns as f64,
            Quantity::SharpTurns => self.sharp_turns as f64,
        }
    }
}

/// A figure beside what was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// The value of the tract, SI.
    pub value: f64,
    /// What was measured.
    pub measured: MeasuredRange,
}

impl Verdict {
    /// Whether the value lies in the range.
    pub fn inside(&self) -> bool {
        (self.measured.low..=self.measured.high).contains(&self.value)
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, unit, factor) = self.measured.quantity.words();
        let MeasuredRange { part, low, high, source, .. } = self.measured;
        let word = if self.inside() { "inside" } else { "OUTSIDE" };
        let [value, low, high] = [self.value, low, high].map(|v| v * factor);
        let title = format!("{part}: {name}");
        write!(formatter, "{title:<46} {value:9.3} {unit:<4} {low:8.3} to {high:8.3}  {word:<8} {source}")
    }
}

/// The line, sampled every millimetre or so, as it is and smoothed.
struct Samples {
    arc_lengths_m: Vec<f64>,
    radii_m: Vec<f64>,
    points_m: Vec<Vector3<f64>>,
    smooth: Smooth,
}

/// The smoothed line, sampled anew.
struct Smooth {
    /// Arc length of each sample on the line as it is, m.
    arc_lengths_m: Vec<f64>,
    step_m: f64,
    tangents: Vec<Vector3<f64>>,
    curvatures_per_m: Vec<f64>,
}

impl Smooth {
    fn of(points: &[Vector3<f64>], arc_lengths_m: &[f64]) -> Self {
        let smooth = smoothed(points, arc_lengths_m[1]);
        let mut along = vec![0.0];
        for pair in smooth.windows(2) {
            along.push(along[along.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let length_m = along[along.len() - 1];
        let count = (length_m / STEP_M).ceil().max(2.0) as usize;
        let step_m = length_m / count as f64;
        let (points, arc_lengths_m): (Vec<_>, Vec<_>) = (0..=count)
            .map(|i| {
                let at = step_m * i as f64;
                let j = along.partition_point(|s| *s <= at).clamp(1, along.len() - 1) - 1;
                let share = (at - along[j]) / (along[j + 1] - along[j]).max(f64::MIN_POSITIVE);
                let original = arc_lengths_m[j] + share * (arc_lengths_m[j + 1] - arc_lengths_m[j]);
                (smooth[j] + (smooth[j + 1] - smooth[j]) * share, original)
            })
            .unzip();
        let (tangents, curvatures_per_m) = derivatives(&points, step_m);
        Self { arc_lengths_m, step_m, tangents, curvatures_per_m }
    }

    fn sharp_turns(&self, range: std::ops::Range<usize>, window_m: f64) -> usize {
        let window = (window_m / self.step_m).floor() as usize;
        let (mut start, mut turns) = (range.start, 0);
        for i in range {
            let turned = (start.max(i.saturating_sub(window))..i)
                .any(|j| self.tangents[j].dot(&self.tangents[i]) < TURN_COSINE);
            if turned {
                turns += 1;
                start = i;
            }
        }
        turns
    }
}

impl Samples {
    fn of(tract: &Tract) -> Self {
        let length_m = tract.length_m();
        let count = (length_m / STEP_M).ceil().max(2.0) as usize;
        let step_m = length_m / count as f64;
        let arc_lengths_m: Vec<f64> = (0..=count).map(|i| step_m * i as f64).collect();
        let points_m: Vec<Vector3<f64>> =
            arc_lengths_m.iter().map(|s| tract.station(*s).position_m.coords).collect();
        let radii_m = arc_lengths_m.iter().map(|s| tract.radius.radius_m(*s)).collect();
        let smooth = Smooth::of(&points_m, &arc_lengths_m);
        Self { arc_lengths_m, radii_m, points_m, smooth }
    }

    fn part(&self, part: Part, from_m: f64, to_m: f64) -> PartStatistics {
        let bends = between(&self.smooth.arc_lengths_m, from_m, to_m);
        let curvatures = sorted(&self.smooth.curvatures_per_m[bends.clone()]);
        let radii = sorted(&self.radii_m[between(&self.arc_lengths_m, from_m, to_m)]);
        let small = (SegmentKey::Duodenum..=SegmentKey::TerminalIleum).contains(&part.segments.0);
        let window_m = if small { TURN_WINDOWS_M.0 } else { TURN_WINDOWS_M.1 };
        PartStatistics {
            part,
            length_m: to_m - from_m,
            radius_median_m: quantile(&radii, 0.5),
            radius_p90_m: quantile(&radii, 0.9),
            bend_radius_median_m: 1.0 / quantile(&curvatures, 0.5),
            bend_radius_p5_m: 1.0 / quantile(&curvatures, 0.95),
            mean_curvature_per_m: curvatures.iter().sum::<f64>() / curvatures.len() as f64,
            sharp_turns: self.smooth.sharp_turns(bends, window_m),
        }
    }

    fn closest_approach_m(&self) -> f64 {
        let apart = (NEIGHBOUR_M / self.arc_lengths_m[1]).ceil() as usize;
        let mut closest = f64::INFINITY;
        for i in (0..self.points_m.len()).step_by(APPROACH_STRIDE) {
            for other in self.points_m.iter().skip(i + apart).step_by(APPROACH_STRIDE) {
                closest = closest.min((other - self.points_m[i]).norm_squared());
            }
        }
        closest.sqrt()
    }
}

/// Bends of a chain of points a few millimetres apart, taken as straight in between: what a generator looks at before there is
/// a centre line. Turns as in the small bowel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PolylineBends {
    /// In the order of [`BEND_QUANTITIES`].
    values: [f64; 4],
}

const BEND_QUANTITIES: [Quantity; 4] =
    [Quantity::BendRadiusMedian, Quantity::BendRadiusP5, Quantity::MeanCurvature, Quantity::LengthPerTurn];

impl PolylineBends {
    pub(crate) fn of(points: &[Point3<f64>]) -> Self {
        let mut along = vec![0.0];
        for pair in points.windows(2) {
            along.push(along[along.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let length_m = along[along.len() - 1];
        let count = (length_m / STEP_M).ceil().max(2.0) as usize;
        let (arc_lengths_m, fine): (Vec<f64>, Vec<Vector3<f64>>) = (0..=count)
            .map(|i| {
                let at = length_m * i as f64 / count as f64;
                let j = along.partition_point(|s| *s <= at).clamp(1, along.len() - 1) - 1;
                let share = (at - along[j]) / (along[j + 1] - along[j]).max(f64::MIN_POSITIVE);
                (at, points[j].coords + (points[j + 1] - points[j]) * share)
            })
            .unzip();
        let smooth = Smooth::of(&fine, &arc_lengths_m);
        let curvatures = sorted(&smooth.curvatures_per_m);
        let turns = smooth.sharp_turns(0..curvatures.len(), TURN_WINDOWS_M.0);
        let values = [
            1.0 / quantile(&curvatures, 0.5),
            1.0 / quantile(&curvatures, 0.95),
            curvatures.iter().sum::<f64>() / curvatures.len() as f64,
            length_m / turns as f64,
        ];
        Self { values }
    }

    /// Whether all figures lie in these ranges, SI, in the order of the fields' definition.
    pub(crate) fn within(&self, ranges: &[(f64, f64); 4]) -> bool {
        self.values.iter().zip(ranges).all(|(value, (low, high))| (low..=high).contains(&value))
    }

    /// Length per turn of more than 120 degrees, m.
    pub(crate) fn length_per_turn_m(&self) -> f64 {
        self.values[3]
    }
}

impl fmt::Display for PolylineBends {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (quantity, value) in BEND_QUANTITIES.iter().zip(self.values) {
            let (name, unit, factor) = quantity.words();
            write!(formatter, "{name} {:.1} {unit}; ", value * factor)?;
        }
        Ok(())
    }
}

/// Indices of the samples between two arc lengths, at least one.
fn between(arc_lengths_m: &[f64], from_m: f64, to_m: f64) -> std::ops::Range<usize> {
    let place = |s: f64| arc_lengths_m.partition_point(|at| *at < s);
    let first = place(from_m).min(arc_lengths_m.len() - 1);
    first..place(to_m).max(first + 1)
}

/// Convolution with a Gaussian; at the ends with what there is of its window.
fn smoothed(points: &[Vector3<f64>], step_m: f64) -> Vec<Vector3<f64>> {
    let half = (WINDOW_DEVIATIONS * SMOOTHING_M / step_m).ceil() as usize;
    let weights: Vec<f64> =
        (0..=half).map(|k| (-0.5 * (k as f64 * step_m / SMOOTHING_M).powi(2)).exp()).collect();
    (0..points.len())
        .map(|i| {
            let (mut sum, mut total) = (Vector3::zeros(), 0.0);
            // The window is symmetric at the ends too: a lopsided one would shorten the line and bend it.
            let reach = half.min(i).min(points.len() - 1 - i);
            for j in i - reach..=i + reach {
                sum += points[j] * weights[i.abs_diff(j)];
                total += weights[i.abs_diff(j)];
            }
            sum / total
        })
        .collect()
}

/// Unit tangents and curvatures by central differences; the two ends repeat their neighbours.
fn derivatives(points: &[Vector3<f64>], step_m: f64) -> (Vec<Vector3<f64>>, Vec<f64>) {
    let last = points.len() - 1;
    (0..=last)
        .map(|i| {
            let i = i.clamp(1, last - 1);
            let first = (points[i + 1] - points[i - 1]) / (2.0 * step_m);
            let second = (points[i + 1] - points[i] * 2.0 + points[i - 1]) / (step_m * step_m);
            let speed = first.norm().max(f64::MIN_POSITIVE);
            (first / speed, first.cross(&second).norm() / speed.powi(3))
        })
        .unzip()
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values
}

/// The quantile of sorted values, between neighbours by proportion.
fn quantile(sorted: &[f64], fraction: f64) -> f64 {
    let place = fraction * (sorted.len() - 1) as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64)
}

impl TractStatistics {
    /// The figures of a tract; `report` is what building it told.
    pub fn of(tract: &Tract, report: &TractReport) -> Self {
        let samples = Samples::of(tract);
        let parts = PARTS
            .into_iter()
            .filter_map(|part| {
                let (from_m, to_m) = extent_m(tract, part)?;
                Some(samples.part(part, from_m, to_m))
            })
            .collect();
        Self {
            parts,
            closest_approach_m: samples.closest_approach_m(),
            overlaps: report.overlaps.len(),
            overlap_length_m: report.overlaps.iter().fold(0.0, |sum, overlap| sum + overlap.length_m),
            deepest_overlap_m: report.overlaps.iter().map(|overlap| overlap.depth_m).fold(0.0, f64::max),
            length_m: tract.length_m(),
        }
    }

    /// The figures of the part of this name.
    pub fn part(&self, name: &str) -> Option<&PartStatistics> {
        self.parts.iter().find(|part| part.part.name == name)
    }

    /// Every figure that has a measured range, beside that range.
    pub fn verdicts(&self) -> Vec<Verdict> {
        MEASURED
            .into_iter()
            .filter_map(|measured| {
                let value = self.part(measured.part)?.get(measured.quantity);
                Some(Verdict { value, measured })
            })
            .collect()
    }
}

/// From where to where a part runs, m. A part of several segments counts only where its first and last organ are there: half a
/// colon is not compared with colons.
fn extent_m(tract: &Tract, part: Part) -> Option<(f64, f64)> {
    let within: Vec<_> = tract
        .segments
        .iter()
        .filter(|segment| (part.segments.0..=part.segments.1).contains(&segment.key))
        .collect();
    let (first, last) = (within.first()?, within.last()?);
    // The ileum may end without a terminal part, the sigmoid may hold the rectum.
    let ends_well = match part.segments.1 {
        SegmentKey::TerminalIleum => last.key >= SegmentKey::Ileum,
        SegmentKey::Rectum => last.key >= SegmentKey::Sigmoid,
        key => last.key == key,
    };
    (first.key == part.segments.0 && ends_well).then_some((first.start_m, last.end_m))
}

impl fmt::Display for TractStatistics {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            formatter,
            "{:<20} {:>8} {:>8} {:>8} {:>11} {:>8} {:>10} {:>6} {:>10}",
            "part", "length m", "r50 mm", "r90 mm", "bend r50 mm", "r5 mm", "mean κ /m", "turns", "mm/turn"
        )?;
        for part in &self.parts {
            writeln!(
                formatter,
                "{:<20} {:8.3} {:8.1} {:8.1} {:11.1} {:8.1} {:10.1} {:6} {:10.1}",
                part.part.name,
                part.length_m,
                1e3 * part.radius_median_m,
                1e3 * part.radius_p90_m,
                1e3 * part.bend_radius_median_m,
                1e3 * part.bend_radius_p5_m,
                part.mean_curvature_per_m,
                part.sharp_turns,
                1e3 * part.get(Quantity::LengthPerTurn)
            )?;
        }
        writeln!(
            formatter,
            "total {:.3} m; closest approach {:.1} mm; {} overlaps over {:.0} mm, deepest {:.1} mm",
            self.length_m,
            1e3 * self.closest_approach_m,
            self.overlaps,
            1e3 * self.overlap_length_m,
            1e3 * self.deepest_overlap_m
        )
    }
}

#[cfg(test)]
mod tests;
