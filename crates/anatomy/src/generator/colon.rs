//! A seeded generator of colons.
//!
//! The colon is a frame inside the torso: caecum and ascending colon up the right side, the hepatic flexure, the transverse
//! colon hanging forward and down, the splenic flexure (higher and further back), the descending colon down the left side,
//! the loop of the sigmoid, the rectum along the sacrum. A frame line through jittered control points (`FRAME`, torso RAS, mm,
//! sized to the gut box of 0.21 x 0.16 x 0.36 m of GCA-Models EdinGCA_3D_00090) is displaced by a wander
//!
//! ```text
//! x(s) = f(s) + A g(s) [n(s) cos(2πs/λ1 + φ1) + b(s) cos(2πs/λ2 + φ2)],   g = 1 / (1 + (κ_f / 20 m⁻¹)²)
//! ```
//!
//! that leaves flexures alone. The total length is drawn from 1.503 ± 0.185 m, range 1.097 to 1.959 m (Utano et al. 2021, CT
//! colonography of 295 people); *redundancy* `q`, which lets transverse and sigmoid hang deeper and the wander widen, is
//! solved for so that the line has that length. An attempt is kept when lengths, radii and bends of all segments lie
//! in the measured ranges ([`Ranges`]) and no lumina overlap; otherwise the next attempt draws anew (its number
//! is the sequence number of its random stream).
//!
//! Neglected: haustra (they are the wall's, [`crate::segment::Wall`]), the taeniae, oval cross-sections, sex and age.

use crate::bends::Bends;
use crate::centre_line::CentreLine;
use crate::error::AnatomyError;
use crate::generator::{Generated, round_to_micrometres};
use crate::segment::SegmentKey;
use crate::tract::{End, SegmentPoints, TractDraft};
use lumenav_core::RandomStreams;
use nalgebra::{Point3, Vector3};
use rand::Rng as _;
use std::f64::consts::TAU;

/// Attempts before giving up: most seeds need one or two.
const ATTEMPTS: u32 = 100;
/// Distance of the points of the result, m.
const STEP_M: f64 = 0.006;
/// Largest redundancy tried.
const REDUNDANCY_LIMIT: f64 = 1.8;
/// Total length for which the frame has its own size, m, and the power with which the frame grows with the length: half
/// of a long colon is a larger body, half is more redundancy.
pub(super) const FRAME_TOTAL_M: f64 = 1.35;
pub(super) const SIZE_EXPONENT: f64 = 0.5;
/// Control points move by up to this, each axis, mm.
const JITTER_MM: f64 = 5.0;

/// Mean, standard deviation and range of the colon's length, m (Utano et al. 2021, n = 295).
const TOTAL_M: (f64, f64, f64, f64) = (1.503, 0.185, 1.097, 1.959);

const SOURCE: &str = "generated; lengths, radii and bends within those measured on CT and Visible Human surfaces (GCA-Models, \
doi:10.1186/s12911-023-02111-9), total length from Utano et al. 2021 (CT colonography, n = 295)";

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct ColonRequest {
    /// Total length before scaling, m; drawn where `None`.
    pub total_length_m: Option<f64>,
    /// Factor on the centre line (a child, a large adult).
    pub length_scale: f64,
    /// Factor on the radii.
    pub radius_scale: f64,
}

impl Default for ColonRequest {
    fn default() -> Self {
        Self { total_length_m: None, length_scale: 1.0, radius_scale: 1.0 }
    }
}

/// What was measured for one part of the colon: range of its length and of its median radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ranges {
    /// First and last segment of the part.
    pub segments: (SegmentKey, SegmentKey),
    /// Range of the length, m.
    pub length_m: (f64, f64),
    /// Range of the median radius of each segment in it, m.
    pub radius_m: (f64, f64),
}

/// Ranges over five people (CT, Visible Human male and female).
pub const MEASURED: [Ranges; 5] = [
    ranges(SegmentKey::Caecum, SegmentKey::Caecum, (0.04, 0.08), (0.019, 0.032)),
    ranges(SegmentKey::Ascending, SegmentKey::Ascending, (0.11, 0.27), (0.017, 0.023)),
    ranges(SegmentKey::Transverse, SegmentKey::Transverse, (0.27, 0.65), (0.013, 0.023)),
    ranges(SegmentKey::Descending, SegmentKey::Descending, (0.22, 0.59), (0.008, 0.020)),
    ranges(SegmentKey::Sigmoid, SegmentKey::Rectum, (0.26, 0.75), (0.009, 0.017)),
];
/// Median bend radius of the whole colon, m.
pub const MEASURED_BEND_RADIUS_M: (f64, f64) = (0.026, 0.045);
/// Sharp turns (see [`crate::bends`]) of the whole colon.
pub const MEASURED_SHARP_TURNS: (usize, usize) = (3, 6);

const fn ranges(first: SegmentKey, last: SegmentKey, length_m: (f64, f64), radius_m: (f64, f64)) -> Ranges {
    Ranges { segments: (first, last), length_m, radius_m }
}

/// A control point: segment it belongs to, position in the torso (RAS, mm) and how it moves with the redundancy.
struct Control(SegmentKey, [f64; 3], [f64; 3]);

/// The frame line, from the tip of the caecum to the anus.
const FRAME: [Control; 27] = {
    use SegmentKey::{Ascending, Caecum, Descending, Rectum, Sigmoid, Transverse};
    const STILL: [f64; 3] = [0.0; 3];
    [
        Control(Caecum, [72.0, 14.0, -98.0], STILL),
        Control(Caecum, [78.0, 6.0, -74.0], STILL),
        Control(Ascending, [83.0, -2.0, -46.0], STILL),
        Control(Ascending, [85.0, -16.0, -2.0], STILL),
        Control(Ascending, [85.0, -25.0, 44.0], STILL),
        Control(Ascending, [79.0, -28.0, 82.0], STILL),
        // Hepatic flexure: over the top, forward and down.
        Control(Transverse, [64.0, -12.0, 102.0], STILL),
        Control(Transverse, [52.0, 12.0, 86.0], STILL),
        Control(Transverse, [44.0, 38.0, 52.0], [0.0, 2.0, -16.0]),
        Control(Transverse, [18.0, 56.0, 30.0], [0.0, 5.0, -36.0]),
        Control(Transverse, [-16.0, 56.0, 34.0], [0.0, 5.0, -36.0]),
        Control(Transverse, [-42.0, 44.0, 74.0], [0.0, 2.0, -16.0]),
        Control(Transverse, [-56.0, 14.0, 124.0], STILL),
        // Splenic flexure: higher and further back.
        Control(Transverse, [-68.0, -12.0, 152.0], STILL),
        Control(Descending, [-82.0, -33.0, 138.0], STILL),
        Control(Descending, [-88.0, -42.0, 100.0], STILL),
        Control(Descending, [-90.0, -42.0, 52.0], STILL),
        Control(Descending, [-89.0, -36.0, 4.0], STILL),
        Control(Descending, [-87.0, -22.0, -44.0], STILL),
        Control(Descending, [-80.0, -4.0, -86.0], STILL),
        // Loop of the sigmoid: forward, up behind the transverse colon, over to the right and back down.
        Control(Sigmoid, [-62.0, 16.0, -112.0], STILL),
        Control(Sigmoid, [-42.0, 30.0, -94.0], [0.0, -4.0, 12.0]),
        Control(Sigmoid, [-26.0, 32.0, -62.0], [-6.0, -16.0, 34.0]),
        Control(Sigmoid, [0.0, 28.0, -60.0], [6.0, -18.0, 34.0]),
        Control(Sigmoid, [10.0, 6.0, -98.0], [8.0, -2.0, 10.0]),
        Control(Rectum, [4.0, -34.0, -124.0], STILL),
        Control(Rectum, [0.0, -44.0, -150.0], STILL),
    ]
};
/// The last control point: the anus.
const ANUS_MM: [f64; 3] = [0.0, -26.0, -178.0];

/// Ranges the median radius of a segment is drawn from, m: the measured ones less a margin for the variation along it.
fn radius_range_m(key: SegmentKey) -> (f64, f64) {
    match key {
        SegmentKey::Caecum => (0.023, 0.028),
        SegmentKey::Ascending => (0.018, 0.022),
        SegmentKey::Transverse => (0.0145, 0.020),
        SegmentKey::Descending => (0.0095, 0.0165),
        _ => (0.0105, 0.0155),
    }
}

/// Everything random about one attempt.
struct Draw {
    total_m: f64,
    jitter_mm: Vec<[f64; 3]>,
    wander_mm: f64,
    wavelengths_m: [f64; 2],
    phases: [f64; 2],
    radii_m: Vec<(SegmentKey, f64)>,
    ripple: [f64; 3],
}

impl Draw {
    fn new(streams: &RandomStreams, attempt: u32) -> Self {
        let mut stream = streams.stream("colon", u64::from(attempt));
        // 53 random bits over 2^53: uniform on [0, 1), the same in every release of `rand`.
        let mut unit = || (stream.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let normal = (-2.0 * (1.0 - unit()).ln()).sqrt() * (TAU * unit()).cos();
        let (mean, deviation, low, high) = TOTAL_M;
        let mut between = |low: f64, high: f64| low + (high - low) * unit();
        Self {
            total_m: (mean + deviation * normal).clamp(low, high),
            jitter_mm: (0..FRAME.len()).map(|_| [(); 3].map(|()| between(-JITTER_MM, JITTER_MM))).collect(),
            wander_mm: between(8.0, 10.0),
            wavelengths_m: [between(0.10, 0.13), between(0.10, 0.13)],
            phases: [between(0.0, TAU), between(0.0, TAU)],
            radii_m: keys()
                .map(|key| {
                    let (low, high) = radius_range_m(key);
                    (key, between(low, high))
                })
                .collect(),
            ripple: [between(0.03, 0.07), between(0.05, 0.08), between(0.0, TAU)],
        }
    }

    /// The resting radius of a segment at an arc length of the frame, m.
    fn radius_m(&self, key: SegmentKey, s: f64) -> f64 {
        let median = self.radii_m.iter().find(|(k, _)| *k == key).map_or(0.015, |(_, radius)| *radius);
        let [depth, wavelength_m, phase] = self.ripple;
        // The blind end of the caecum is rounded.
        let end = if key == SegmentKey::Caecum { 1.0 - 0.35 * (-s / 0.008).exp() } else { 1.0 };
        median * end * (1.0 + depth * (TAU * s / wavelength_m + phase).sin())
    }
}

fn keys() -> impl Iterator<Item = SegmentKey> {
    SegmentKey::ALL.into_iter().filter(SegmentKey::is_colon)
}

/// Generates a colon from the streams of one seed.
///
/// # Errors
/// [`AnatomyError::OutOfRange`] for a length that nobody measured or factors outside 0.1 to 10; [`AnatomyError::NoColonFound`] when
/// no attempt meets the ranges (a small `length_scale` with a large `radius_scale` cannot).
pub fn colon(request: &ColonRequest, streams: &RandomStreams) -> Result<Generated, AnatomyError> {
    let (_, _, low, high) = TOTAL_M;
    if let Some(value) = request.total_length_m.filter(|total| !(low..=high).contains(total)) {
        return Err(AnatomyError::OutOfRange { name: "total_length_m", value, low, high });
    }
    let mut reason = String::new();
    for attempt in 0..ATTEMPTS {
        let mut draw = Draw::new(streams, attempt);
        draw.total_m = request.total_length_m.unwrap_or(draw.total_m);
        let Some(draft) = solve_redundancy(&draw) else {
            reason = format!("the frame cannot be {:.3} m long", draw.total_m);
            continue;
        };
        match check(&draft) {
            Ok(()) => {}
            Err(failed) => {
                reason = failed;
                continue;
            }
        }
        let draft = draft.scaled(request.length_scale, request.radius_scale)?;
        match draft.clone().build() {
            Ok((tract, report)) if report.overlaps.is_empty() => {
                return Ok(Generated { draft, tract, report, attempts: attempt + 1 });
            }
            Ok((_, report)) => reason = report.warnings.join("; "),
            Err(error) => reason = error.to_string(),
        }
    }
    Err(AnatomyError::NoColonFound { attempts: ATTEMPTS, reason })
}

/// The draft whose line has the drawn length, by bisection on the redundancy.
fn solve_redundancy(draw: &Draw) -> Option<TractDraft> {
    let length_m = |q: f64| {
        let points: Vec<Point3<f64>> =
            draft_of(draw, q)?.segments.iter().flat_map(|segment| segment.points_m.clone()).collect();
        Some(points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>())
    };
    let (mut low, mut high) = (0.0, REDUNDANCY_LIMIT);
    if !(length_m(low)?..=length_m(high)?).contains(&draw.total_m) {
        return None;
    }
    for _ in 0..16 {
        let middle = 0.5 * (low + high);
        if length_m(middle)? < draw.total_m { low = middle } else { high = middle }
    }
    draft_of(draw, 0.5 * (low + high))
}

/// The colon of one draw and redundancy; `None` where the frame folds back on itself.
fn draft_of(draw: &Draw, redundancy: f64) -> Option<TractDraft> {
    let size = (draw.total_m / FRAME_TOTAL_M).powf(SIZE_EXPONENT);
    let mut controls: Vec<Point3<f64>> = FRAME
        .iter()
        .zip(&draw.jitter_mm)
        .map(|(Control(_, at, moves), jitter)| {
            let axis = |i: usize| 1e-3 * size * (at[i] + redundancy * moves[i] + jitter[i]);
            Point3::new(axis(0), axis(1), axis(2))
        })
        .collect();
    controls.push(Point3::from(Vector3::from(ANUS_MM) * (1e-3 * size)));
    let frame = CentreLine::through(&controls).ok()?;
    let count = (frame.length_m() / STEP_M).ceil() as usize;
    let amplitude_m = 1e-3 * draw.wander_mm * (0.5 + 0.5 * redundancy);
    let mut segments: Vec<SegmentPoints> = keys()
        .map(|key| SegmentPoints {
            key,
            points_m: Vec::new(),
            radii_m: Vec::new(),
            wall: key.default_wall(),
            source: String::new(),
        })
        .collect();
    for i in 0..=count {
        let s = frame.length_m() * i as f64 / count as f64;
        let station = frame.station(s);
        let calm = 1.0 / (1.0 + (station.curvature_per_m / 20.0).powi(2));
        // Both ends are held: the wander rises over 6 cm.
        let held = (s.min(frame.length_m() - s) / 0.06).min(1.0);
        let wave = |k: usize| (TAU * s / draw.wavelengths_m[k] + draw.phases[k]).cos();
        let away = (station.normal * wave(0) + station.binormal * wave(1)) * (amplitude_m * calm * held);
        let control =
            frame.knots_m().partition_point(|knot| *knot <= s).saturating_sub(1).min(FRAME.len() - 1);
        let key = FRAME[control].0;
        // `keys` yields the segments of FRAME, so one of them matches.
        let place = segments.iter().position(|segment| segment.key == key)?;
        let point = round_to_micrometres(station.position_m + away);
        let radius_m = (draw.radius_m(key, s) * 1e6).round() * 1e-6;
        // Neighbours share the point where they meet.
        let meets = segments[place].points_m.is_empty() && place > 0;
        for segment in &mut segments[place - usize::from(meets)..=place] {
            segment.points_m.push(point);
            segment.radii_m.push(radius_m);
        }
    }
    Some(TractDraft {
        name: "colon".to_owned(),
        segments,
        ends: (End::Closed, End::Exit),
        torso_half_extents_m: None,
        source: SOURCE.to_owned(),
    })
}

/// Whether a draft lies within what was measured; in words, where not.
fn check(draft: &TractDraft) -> Result<(), String> {
    let (tract, _) = draft.clone().build().map_err(|error| error.to_string())?;
    for range in &MEASURED {
        let (first, last) = (tract.segment(range.segments.0), tract.segment(range.segments.1));
        let (Some(first), Some(last)) = (first, last) else { return Err("a segment is missing".to_owned()) };
        let length_m = last.end_m - first.start_m;
        if !(range.length_m.0..=range.length_m.1).contains(&length_m) {
            return Err(format!("`{}` would be {length_m:.3} m long", first.key));
        }
    }
    let bends = Bends::of(&tract.centre_line, 0.0, tract.length_m());
    let (low, high) = MEASURED_BEND_RADIUS_M;
    if !(low..=high).contains(&bends.median_radius_m) {
        return Err(format!("the median bend radius would be {:.4} m", bends.median_radius_m));
    }
    let (fewest, most) = MEASURED_SHARP_TURNS;
    if !(fewest..=most).contains(&bends.sharp_turns) {
        return Err(format!("there would be {} sharp turns", bends.sharp_turns));
    }
    Ok(())
}
