//! Where most lines pass: the place that a search starts from when nothing is known.
//!
//! Candidates are the middles of pairs of lines that nearly meet; of them the one with the largest `Σ exp(-d²/2s²)`, d the distance of a
//! line and s = [`PASSING_M`].

use super::lanes::three;
use super::quad::Quad;
use super::register::{Kernel, Register, Unit, dispatch, dot, load, splat3};
use super::window::{Rays, RaysThrough};
use crate::line::Line;
use nalgebra::Vector3;

/// Places looked at: with a fifth of the lines from a point, one pair in 25 meets there, so 16 places of 400.
const CANDIDATES: usize = 400;
/// Pairs of lines tried for a place.
const PAIRS: usize = 20 * CANDIDATES;
/// Scale of the count of lines that pass a place, m: the spread of a scanner's lines about their source, 1.5 to 4 mm.
pub(crate) const PASSING_M: f64 = 4e-3;
/// Two lines at less than this angle do not tell where they meet, sine.
const LEAST_SINE: f64 = 0.05;

/// Distance of a place from a line, m.
pub(crate) fn distance_m(line: &Line, at: &Vector3<f64>) -> f64 {
    let along = line.ends_world_m[1] - line.ends_world_m[0];
    (at - line.ends_world_m[0]).cross(&along).norm() / along.norm()
}

/// The middle of two lines where they come nearest, if they nearly meet between their ends.
fn meeting(a: &Line, b: &Line) -> Option<Vector3<f64>> {
    let (from, to) = (a.ends_world_m[0], b.ends_world_m[0]);
    let (u, v) = (a.ends_world_m[1] - from, b.ends_world_m[1] - to);
    let normal = u.cross(&v);
    let squared = normal.norm_squared();
    if !(squared > LEAST_SINE * LEAST_SINE * u.norm_squared() * v.norm_squared()) {
        return None;
    }
    let between = to - from;
    if between.dot(&normal).abs() > PASSING_M * squared.sqrt() {
        return None;
    }
    let s = between.cross(&v).dot(&normal) / squared;
    let t = between.cross(&u).dot(&normal) / squared;
    let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    inside.then(|| ((from + u * s) + (to + v * t)) * 0.5)
}

/// Looks for it; keeps its buffers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Densest {
    rays: RaysThrough,
    places: Vec<Vector3<f64>>,
}

impl Densest {
    /// Of the places where two of these usable lines nearly meet, the one that most of them pass.
    pub(crate) fn find(&mut self, lines: &[Line]) -> Option<Vector3<f64>> {
        let count = lines.len();
        // Pairs at growing distances in the list: every line is tried with many others, in an order that depends on nothing.
        let pairs = (1..count).flat_map(|apart| (0..count - apart).map(move |i| (i, i + apart)));
        let meetings = pairs.take(PAIRS).filter_map(|(i, j)| meeting(&lines[i], &lines[j]));
        self.places.clear();
        self.places.extend(meetings.take(CANDIDATES));
        dispatch(Busiest { rays: self.rays.of(lines), places: &self.places })
    }
}

/// Of some places the one that most lines pass.
struct Busiest<'a> {
    rays: &'a [Rays],
    places: &'a [Vector3<f64>],
}

impl Kernel for Busiest<'_> {
    type Output = Option<Vector3<f64>>;

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> Self::Output {
        let mut best = None;
        let mut most = 0.0;
        for place in self.places {
            let passing = passing(unit, self.rays, place);
            if passing >= most {
                (best, most) = (Some(*place), passing);
            }
        }
        best
    }
}

#[inline(always)]
fn passing<S: Unit>(unit: S, rays: &[Rays], place: &Vector3<f64>) -> f64 {
    let at = splat3(unit, place);
    let (zero, scale) = (Quad::splat(unit, 0.0), Quad::splat(unit, -0.5 / (PASSING_M * PASSING_M)));
    let mut sum = zero;
    for r in rays {
        let (n, foot) = (load(unit, &r.direction), load(unit, &r.foot_m));
        let v = three!(i => foot[i] - at[i]);
        let along = dot(&v, &n);
        let squared = along.mul_sub_from(along, dot(&v, &v)).max(zero);
        sum = Quad::of(unit, r.filled).mul_add((scale * squared).exp(), sum);
    }
    sum.numbers().sum()
}
