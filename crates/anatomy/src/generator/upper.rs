//! Oesophagus, stomach and duodenum: lines through jittered control points around the frame of the colon.
//!
//! The oesophagus comes down before the spine, the stomach is a J left of the middle, the duodenum the C from the pylorus to the
//! right, down and back to the flexure where the jejunum begins. Lengths: 0.229 m for the oesophagus (manometry, n = 252), about
//! 0.18 m (stomach) and 0.14 to 0.24 m (duodenum) on surfaces of people; radii: `radius_range_m`.
//! Neglected: the fundus above the cardia, the greater curvature (the lumen is a tube), the pylorus's narrowness.

use super::{Draws, Line, STEP_M};
use crate::centre_line::CentreLine;
use crate::error::AnatomyError;
use crate::segment::SegmentKey;
use nalgebra::{Point3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Control points of a body and colon of the frame's own size move by up to this, each axis, mm.
const JITTER_MM: f64 = 3.0;

/// Where the oesophagus becomes the stomach.
const CARDIA_MM: [f64; 3] = [-14.0, 6.0, 172.0];

/// Segment and position (torso, RAS, mm), sized as the colon's frame.
const FRAME_MM: [(SegmentKey, [f64; 3]); 20] = {
    use SegmentKey::{Duodenum, Oesophagus, Stomach};
    [
        (Oesophagus, [0.0, -58.0, 392.0]),
        (Oesophagus, [1.0, -66.0, 330.0]),
        (Oesophagus, [2.0, -64.0, 270.0]),
        (Oesophagus, [0.0, -48.0, 220.0]),
        (Oesophagus, [-6.0, -22.0, 190.0]),
        (Stomach, CARDIA_MM),
        (Stomach, [-29.0, 25.0, 166.0]),
        (Stomach, [-31.0, 49.0, 146.0]),
        (Stomach, [-24.0, 67.0, 120.0]),
        (Stomach, [-8.0, 73.0, 100.0]),
        (Stomach, [10.0, 67.0, 90.0]),
        (Duodenum, [18.0, 50.0, 97.0]),
        (Duodenum, [20.0, 30.0, 101.0]),
        (Duodenum, [19.0, 8.0, 92.0]),
        (Duodenum, [21.0, -12.0, 72.0]),
        (Duodenum, [20.0, -22.0, 48.0]),
        (Duodenum, [8.0, -27.0, 31.0]),
        (Duodenum, [-10.0, -24.0, 30.0]),
        (Duodenum, [-24.0, -12.0, 42.0]),
        (Duodenum, [-30.0, 4.0, 46.0]),
    ]
};

/// Ranges that the median radius is drawn from, m: within those measured, less what the ripple adds.
fn radius_range_m(key: SegmentKey) -> (f64, f64) {
    match key {
        SegmentKey::Oesophagus => (0.0065, 0.0085),
        SegmentKey::Stomach => (0.0165, 0.0195),
        _ => (0.0095, 0.0115),
    }
}

/// Radius along the stomach as a multiple of its median: narrow at both ends (cardia, pylorus), by the sine of the way.
fn stomach_shape(way: f64) -> f64 {
    0.6 + 0.45 * (2.0 * FRAC_PI_2 * way).sin().max(0.0).sqrt()
}

/// The line from the mouth to the end of the duodenum. `size` multiplies what lies in the colon's frame, `body` the oesophagus,
/// which is no longer where the colon is.
pub(super) fn upper(
    draws: &mut Draws,
    size: f64,
    body: f64,
    radius_scale: f64,
) -> Result<Line, AnatomyError> {
    let controls: Vec<Point3<f64>> = FRAME_MM
        .iter()
        .map(|(key, at)| {
            let at = Vector3::from(*at) + draws.vector(JITTER_MM);
            let cardia = Vector3::from(CARDIA_MM);
            let placed =
                if *key == SegmentKey::Oesophagus { cardia * size + (at - cardia) * body } else { at * size };
            Point3::from(placed * 1e-3)
        })
        .collect();
    let line = CentreLine::through(&controls)?;
    let keys = [SegmentKey::Oesophagus, SegmentKey::Stomach, SegmentKey::Duodenum];
    let medians = keys.map(|key| {
        let (low, high) = radius_range_m(key);
        draws.between(low, high)
    });
    let phase = draws.between(0.0, TAU);
    let count = (line.length_m() / STEP_M).ceil() as usize;
    let mut result = Line::default();
    for i in 0..=count {
        let s = line.length_m() * i as f64 / count as f64;
        let control = line.knots_m().partition_point(|knot| *knot <= s).saturating_sub(1);
        let key = FRAME_MM[control.min(FRAME_MM.len() - 1)].0;
        let way = way_through(key, s, line.knots_m());
        let shape = match key {
            SegmentKey::Stomach => stomach_shape(way),
            _ => 1.0 + 0.05 * (TAU * s / 0.06 + phase).sin(),
        };
        // `keys` holds every key of FRAME_MM.
        let median = keys.iter().zip(medians).find(|(k, _)| **k == key).map_or(0.01, |(_, median)| median);
        result.push(key, line.station(s).position_m, median * shape * radius_scale);
    }
    Ok(result)
}

/// How far through its segment an arc length is, 0 to 1.
fn way_through(key: SegmentKey, s: f64, knots_m: &[f64]) -> f64 {
    let first = FRAME_MM.iter().position(|(k, _)| *k == key).unwrap_or(0);
    let last = FRAME_MM.iter().rposition(|(k, _)| *k == key).map_or(0, |last| last + 1);
    let (start, end) = (knots_m[first], knots_m[last.min(knots_m.len() - 1)]);
    ((s - start) / (end - start)).clamp(0.0, 1.0)
}
