//! Analytic centre lines: straight, helix, three half circles.
//!
//! A shape stands in a tract file in place of a segment's points, as `shape = { kind = "…", … }`. Points are laid every
//! 2 mm, close enough that the spline through them leaves the shape by less than 1e-8 m where its curvature is continuous.
//!
//! - `straight`: from `start_mm` to `end_mm`.
//! - `helix`: around the z axis through `centre_mm`, counter-clockwise seen from +z,
//!   `(x, y, z) = c + (r cos a, r sin a, p (a - a0)/2π - p n/2)` for `a` from `a0 = start_angle_deg` over `n = turns`
//!   with pitch `p` (negative: downwards).
//! - `three-half-circles`: the track of than2015 (T. D. Than, PhD thesis, Wollongong 2015): half circles of the given
//!   diameters in the YZ, XZ and YZ planes, joined so that the tangent (along ±z) is continuous. With `d` the diameters and
//!   `c` the centre: from `c + (-d2/2, -d1, 0)` over the top to `c + (-d2/2, 0, 0)`, below to `c + (d2/2, 0, 0)`, over the
//!   top to `c + (d2/2, d3, 0)`. The thesis states planes and diameters; the joints and the centre are this project's
//!   choice, the only smooth one but for mirror images. The spline rounds off the jumps of the curvature within 2 mm of
//!   the joints.

use lumenav_core::ConfigError;
use lumenav_core::Node;
use lumenav_core::config::quantity::{Finite, Positive};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Kinds of shapes, for messages.
const KINDS: &str = "straight, helix, three-half-circles";
/// Distance of the points, m.
const STEP_M: f64 = 0.002;
/// Points at most: the centre line's own limit on its length is met first by any shape of a possible size.
const POINT_LIMIT: f64 = 60_000.0;
const ORIGIN: [Finite; 3] = [Finite(0.0); 3];

#[derive(Debug, Serialize, Deserialize)]
struct Kind {
    kind: String,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Straight {
    kind: String,
    start_mm: [Finite; 3],
    end_mm: [Finite; 3],
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Helix {
    kind: String,
    #[serde(default = "origin")]
    centre_mm: [Finite; 3],
    radius_mm: Positive,
    pitch_mm: Finite,
    turns: Positive,
    #[serde(default)]
    start_angle_deg: Finite,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ThreeHalfCircles {
    kind: String,
    #[serde(default = "origin")]
    centre_mm: [Finite; 3],
    diameters_mm: [Positive; 3],
}

fn origin() -> [Finite; 3] {
    ORIGIN
}

/// The points (m, in the file's frame) of the shape that a `shape` table describes.
///
/// # Errors
/// [`ConfigError`] at the key that is wrong.
pub fn points(node: &Node) -> Result<Vec<Point3<f64>>, ConfigError> {
    let kind: Kind = node.parse_quietly()?;
    match kind.kind.as_str() {
        "straight" => {
            let shape: Straight = node.parse()?;
            Ok(vec![Point3::from(metres(&shape.start_mm)), Point3::from(metres(&shape.end_mm))])
        }
        "helix" => helix(node, &node.parse()?),
        "three-half-circles" => three_half_circles(node, &node.parse()?),
        other => Err(node.error_at("kind", &format!("no shape is called `{other}`; allowed: {KINDS}"))),
    }
}

fn metres(millimetres: &[Finite; 3]) -> Vector3<f64> {
    Vector3::new(millimetres[0].0, millimetres[1].0, millimetres[2].0) * 1e-3
}

/// Number of intervals of about 2 mm.
fn intervals(node: &Node, length_m: f64) -> Result<u32, ConfigError> {
    let count = (length_m / STEP_M).ceil().max(8.0);
    if count > POINT_LIMIT {
        return Err(node.error(&format!("the shape is {length_m} m long; at most 100 m are allowed")));
    }
    Ok(count as u32)
}

fn helix(node: &Node, shape: &Helix) -> Result<Vec<Point3<f64>>, ConfigError> {
    let (radius, pitch, turns) = (shape.radius_mm.0 * 1e-3, shape.pitch_mm.0 * 1e-3, shape.turns.0);
    let centre = metres(&shape.centre_mm);
    let count = intervals(node, turns * (TAU * radius).hypot(pitch))?;
    let start = shape.start_angle_deg.0.to_radians();
    let at = |i: u32| {
        let turned = turns * f64::from(i) / f64::from(count);
        let angle = start + TAU * turned;
        let up = pitch * (turned - 0.5 * turns);
        Point3::from(centre + Vector3::new(radius * angle.cos(), radius * angle.sin(), up))
    };
    Ok((0..=count).map(at).collect())
}

fn three_half_circles(node: &Node, shape: &ThreeHalfCircles) -> Result<Vec<Point3<f64>>, ConfigError> {
    let radii = shape.diameters_mm.map(|diameter| 0.5e-3 * diameter.0);
    let centre = metres(&shape.centre_mm);
    let (left, right) = (Vector3::x() * -radii[1], Vector3::x() * radii[1]);
    // Middle, direction from the middle to the start, direction of the top of each half circle.
    let halves = [
        (left - Vector3::y() * radii[0], -Vector3::y(), Vector3::z()),
        (Vector3::zeros(), -Vector3::x(), -Vector3::z()),
        (right + Vector3::y() * radii[2], -Vector3::y(), Vector3::z()),
    ];
    let mut points = vec![Point3::from(centre + halves[0].0 + halves[0].1 * radii[0])];
    for ((middle, to_start, to_top), radius) in halves.iter().zip(radii) {
        let count = intervals(node, PI * radius)?;
        points.extend((1..=count).map(|i| {
            let angle = PI * f64::from(i) / f64::from(count);
            Point3::from(centre + middle + (to_start * angle.cos() + to_top * angle.sin()) * radius)
        }));
    }
    Ok(points)
}
