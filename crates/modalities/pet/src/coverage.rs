//! How much of a point's lines a scanner catches, from its geometry alone: what makes one marker brighter than the next.
//!
//! A point is on a line from block a to block b where the ray to a, turned round, meets b. In the plane across the axis that is an
//! interval of a's chord, seen under angles φ; along the axis one of slopes τ = tan λ:
//!
//! ```text
//! S = Σ_{a<b} ∫ [sin λ₂(φ) - sin λ₁(φ)] dφ        τ r_a ∈ z_a - z ± l,   -τ r_b ∈ z_b - z ± l
//! ```
//!
//! with r_a, r_b the distances of both blocks in the plane and l half a block's length; exact in λ, one or three points of Gauss and Legendre
//! in φ. In steradians, counted once per line. Neglected: absorption (over the few millimetres of a marker set it is even), obliquity in the
//! crystals. Near the axial end of a scanner S falls to nothing within centimetres: there the markers of one capsule differ by half.
//!
//! `planning::sensitivity` integrates over the physics as well, and is two hundred times slower.

use crate::scanner::Scanner;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Nodes and weights of Gauss and Legendre on [-1, 1].
const THREE_NODES: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];
const ONE_NODE: [(f64, f64); 1] = [(0.0, 2.0)];
/// A part of a chord that is seen under less than this takes one node, rad: it is wrong by a thousandth.
const NARROW_RAD: f64 = 0.12;
/// Half of the way over which a slope is taken, m: half a crystal, over which chords come into sight and leave it one by one.
const SLOPE_STEP_M: f64 = 2e-3;
/// Least share that directions are taken to tell of an axis: of plates far apart it is a tenth along their normal, and one pair of
/// narrow blocks tells next to nothing there.
const LEAST_ACROSS: f64 = 0.02;
/// Pairs grow with the square of the blocks.
const MOST_BLOCKS: usize = 512;
/// Blocks whose axes differ by more than this are not on one ring, cosine.
const PARALLEL: f64 = 1.0 - 1e-6;

/// A block's chord in the plane across the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Chord {
    centre_m: Vector2<f64>,
    along: Vector2<f64>,
    /// Away from the field of view.
    outward: Vector2<f64>,
    z_m: f64,
}

/// Two blocks that can fire together. All lines between them lie in the strip `from_m <= across · p <= to_m` of the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pair {
    a: u32,
    b: u32,
    across: Vector2<f64>,
    from_m: f64,
    to_m: f64,
}

/// Lines of a pair through a place that share their direction across the axis.
struct Fan {
    /// Weight of this direction.
    angle_rad: f64,
    /// Unit, across the axis, towards a.
    direction: Vector2<f64>,
    /// Least and largest slope along the axis, τ.
    low: f64,
    high: f64,
}

/// The pairs of blocks of a scanner, as a point sees them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Across the axis, and along it.
    axes: [Vector3<f64>; 3],
    chords: Vec<Chord>,
    pairs: Vec<Pair>,
    half_width_m: f64,
    half_length_m: f64,
}

impl Pair {
    fn new((a, one): (usize, &Chord), (b, other): (usize, &Chord), half_width_m: f64) -> Self {
        let way = other.centre_m - one.centre_m;
        let across = Vector2::new(-way.y, way.x) / way.norm().max(f64::MIN_POSITIVE);
        let (mut from_m, mut to_m) = (f64::INFINITY, f64::NEG_INFINITY);
        for chord in [one, other] {
            for side in [-1.0, 1.0] {
                let at_m = across.dot(&(chord.centre_m + chord.along * (side * half_width_m)));
                (from_m, to_m) = (from_m.min(at_m), to_m.max(at_m));
            }
        }
        Self { a: a as u32, b: b as u32, across, from_m, to_m }
    }
}

impl Coverage {
    /// Of a scanner; of one whose blocks do not share an axis, or are more than 512, nothing is told: 0 everywhere, and markers
    /// are as bright as they are active.
    pub fn new(scanner: &Scanner) -> Self {
        let Some(first) = scanner.blocks.first() else { return Self::default() };
        let axes = [first.tangential, first.outward, first.axial];
        if scanner.blocks.len() > MOST_BLOCKS
            || scanner.blocks.iter().any(|b| b.axial.dot(&first.axial).abs() < PARALLEL)
        {
            return Self::default();
        }
        let flat = |v: &Vector3<f64>| Vector2::new(v.dot(&axes[0]), v.dot(&axes[1]));
        let chord = |b: &crate::scanner::Block| Chord {
            centre_m: flat(&b.centre_world_m),
            along: flat(&b.tangential),
            outward: flat(&b.outward),
            z_m: b.centre_world_m.dot(&axes[2]),
        };
        let chords: Vec<Chord> = scanner.blocks.iter().map(chord).collect();
        let half_width_m = scanner.grid.half_width_m();
        let count = chords.len();
        let all = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
        let pairs = all
            .filter(|(a, b)| scanner.can_coincide(*a, *b))
            .map(|(a, b)| Pair::new((a, &chords[a]), (b, &chords[b]), half_width_m))
            .collect();
        Self { axes, chords, pairs, half_width_m, half_length_m: scanner.grid.half_length_m() }
    }

    /// `P⁻¹ ∇ ln S`, 1/m, P the mean of `1 - n nᵀ` over the directions n of the lines caught here, and the scanner's axis; `None` where
    /// nothing is caught.
    pub fn pull_per_m(&self, place_world_m: &Vector3<f64>) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let all = self.solid_angle_sr(place_world_m);
        if all <= 0.0 {
            return None;
        }
        let turn = Matrix3::from_columns(&self.axes);
        let seen = |step: Vector3<f64>| self.solid_angle_sr(&(place_world_m + turn * step));
        let slope = Vector3::from_fn(|axis, _| {
            let step = Vector3::ith(axis, SLOPE_STEP_M);
            (seen(step) - seen(-step)) / (2.0 * SLOPE_STEP_M * all)
        });
        let across = Matrix3::identity() - self.directions(place_world_m) / all;
        let mut eigen = across.symmetric_eigen();
        eigen.eigenvalues.iter_mut().for_each(|told| *told = told.max(LEAST_ACROSS));
        Some((turn * eigen.recompose().cholesky()?.solve(&slope), self.axes[2]))
    }

    /// `∫ n nᵀ` over the directions n of the lines caught here, scanner's own axes, sr.
    fn directions(&self, place_world_m: &Vector3<f64>) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        self.each_fan(place_world_m, |fan| {
            // cos λ dλ of cos² λ, of sin² λ, and of cos λ sin λ, between both slopes.
            let of = |slope: f64| {
                let (sine, cosine) = (sine(slope), (1.0 + slope * slope).sqrt().recip());
                [sine - sine.powi(3) / 3.0, sine.powi(3) / 3.0, -cosine.powi(3) / 3.0]
            };
            let (high, low) = (of(fan.high), of(fan.low));
            let [flat, along, mixed] = std::array::from_fn(|i| fan.angle_rad * (high[i] - low[i]));
            let n = fan.direction;
            let (xx, xy, yy) = (n.x * n.x * flat, n.x * n.y * flat, n.y * n.y * flat);
            let (xz, yz) = (n.x * mixed, n.y * mixed);
            sum += Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, along);
        });
        sum
    }

    /// Steradians of directions in which a line through this place is caught; 0 outside.
    pub fn solid_angle_sr(&self, place_world_m: &Vector3<f64>) -> f64 {
        let mut sum = 0.0;
        self.each_fan(place_world_m, |fan| sum += fan.angle_rad * (sine(fan.high) - sine(fan.low)));
        sum
    }

    fn each_fan(&self, place_world_m: &Vector3<f64>, mut tell: impl FnMut(&Fan)) {
        let p = Vector2::new(place_world_m.dot(&self.axes[0]), place_world_m.dot(&self.axes[1]));
        let z = place_world_m.dot(&self.axes[2]);
        for pair in &self.pairs {
            let at_m = pair.across.dot(&p);
            if at_m > pair.from_m && at_m < pair.to_m {
                self.fans_of(&self.chords[pair.a as usize], &self.chords[pair.b as usize], p, z, &mut tell);
            }
        }
    }

    fn fans_of(&self, a: &Chord, b: &Chord, p: Vector2<f64>, z: f64, tell: &mut impl FnMut(&Fan)) {
        let to_a = (a.centre_m - p).dot(&a.outward);
        let to_b = (b.centre_m - p).dot(&b.outward);
        let Some([from, to]) = self.seen_through(a, b, p, to_a).filter(|_| to_a > 0.0 && to_b > 0.0) else {
            return;
        };
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let nodes: &[(f64, f64)] = if to - from < NARROW_RAD * to_a { &ONE_NODE } else { &THREE_NODES };
        for (node, weight) in nodes {
            let ray = a.centre_m + a.along * (middle + half * node) - p;
            let r_a = ray.norm();
            let r_b = -to_b * r_a / ray.dot(&b.outward);
            let l = self.half_length_m;
            let low = ((a.z_m - l - z) / r_a).max((z - b.z_m - l) / r_b);
            let high = ((a.z_m + l - z) / r_a).min((z - b.z_m + l) / r_b);
            // Behind b, or along it, nothing is seen.
            if r_b > 0.0 && high > low {
                let angle_rad = weight * half * to_a / (r_a * r_a);
                tell(&Fan { angle_rad, direction: ray / r_a, low, high });
            }
        }
    }

    /// The part of a's chord that lies behind `p` as seen from b: where the lines from b's ends through `p` meet it.
    fn seen_through(&self, a: &Chord, b: &Chord, p: Vector2<f64>, to_a: f64) -> Option<[f64; 2]> {
        let meets = |side: f64| {
            let ray = p - (b.centre_m + b.along * (side * self.half_width_m));
            let rate = ray.dot(&a.outward);
            (rate > 0.0).then(|| (p + ray * (to_a / rate) - a.centre_m).dot(&a.along))
        };
        let (one, other) = (meets(-1.0)?, meets(1.0)?);
        let from = one.min(other).max(-self.half_width_m);
        let to = one.max(other).min(self.half_width_m);
        (from < to).then_some([from, to])
    }
}

/// `sin(atan t)`.
fn sine(t: f64) -> f64 {
    t / (1.0 + t * t).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::sensitivity::{PhotonDetection, bundles};
    use lumenav_core::Node;
    use std::path::Path;

    fn scanner(name: &str) -> Scanner {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
        Scanner::from_node(&Node::open(&models.join(format!("scanners/{name}.toml"))).unwrap()).unwrap()
    }

    /// A pair of faces seen from the middle: the solid angle of a rectangle, `4 asin(sin α sin β)`.
    #[test]
    fn closed_form_solid_angle_of_two_pairs_of_plates() {
        let reduced = scanner("reduced");
        let half_angle = |half: f64| (half / 0.43205).atan().sin();
        let (alpha, beta) =
            (half_angle(reduced.grid.half_width_m()), half_angle(reduced.grid.half_length_m()));
        let wanted = 2.0 * 4.0 * (alpha * beta).asin();
        let found = Coverage::new(&reduced).solid_angle_sr(&Vector3::zeros());
        assert!((found / wanted - 1.0).abs() < 1e-5, "{found} {wanted}");
    }

    /// Against the planning's quadrature over the faces, with a scintillator that stops everything.
    #[test]
    fn cross_solid_angles_are_those_of_the_faces() {
        let black = PhotonDetection { attenuation_per_m: 1e9, accepted: [1.0; 3] };
        // Faces cut finely enough for a point off the middle of two plates; on a ring the cuts average out.
        for (name, per_side) in [("reduced", 600), ("allegro", 64)] {
            let scanner = scanner(name);
            let coverage = Coverage::new(&scanner);
            for place in [[0.0, 0.0, 0.0], [0.057, 0.0, -0.045], [-0.02, 0.03, 0.07], [0.03, -0.05, 0.0]] {
                let place = Vector3::from(place);
                let found = coverage.solid_angle_sr(&place);
                let all = bundles(&scanner, &black, None, &place, per_side);
                let wanted = all.iter().map(|b| b.per_positron).sum::<f64>() * std::f64::consts::TAU;
                assert!((found / wanted - 1.0).abs() < 0.01, "{name} {place:?}: {found} {wanted}");
            }
        }
    }

    /// Directions add up to what is seen, and what is seen falls off as the distance from the edge of two wide plates does.
    #[test]
    fn closed_form_directions_and_the_pull_of_an_edge() {
        for name in ["reduced", "allegro"] {
            let coverage = Coverage::new(&scanner(name));
            for place in [[0.0, 0.0, 0.0], [0.057, 0.01, -0.045], [-0.02, 0.03, 0.07]] {
                let place = Vector3::from(place);
                let (sum, seen) = (coverage.directions(&place).trace(), coverage.solid_angle_sr(&place));
                assert!((sum / seen - 1.0).abs() < 1e-12, "{name} {place:?}: {sum} {seen}");
            }
        }
        let reduced = scanner("reduced");
        let coverage = Coverage::new(&reduced);
        let pull = |place: [f64; 3]| coverage.pull_per_m(&Vector3::from(place)).unwrap().0;
        assert!(pull([0.0; 3]).norm() < 1e-9);
        // Of both pairs, at z: the solid angle of a rectangle whose half length is the way to the nearer end.
        let sine = |half: f64| (half / 0.43205).atan().sin();
        let seen = |z: f64| {
            8.0 * (sine(reduced.grid.half_width_m()) * sine(reduced.grid.half_length_m() - z)).asin()
        };
        for z in [0.02, 0.05, 0.07] {
            let place = Vector3::new(0.0, 0.0, z);
            let told = 1.0 - coverage.directions(&place)[(2, 2)] / coverage.solid_angle_sr(&place);
            let wanted = (seen(z + 1e-4) - seen(z - 1e-4)) / (2e-4 * seen(z)) / told;
            let (found, mirrored) = (pull([0.0, 0.0, z]), pull([0.0, 0.0, -z]));
            assert!((found.z / wanted - 1.0).abs() < 2e-3, "{z}: {found:?} {wanted}");
            assert!((found + mirrored).norm() < 1e-6 && found.x.abs() + found.y.abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn closed_form_nothing_is_seen_outside() {
        let coverage = Coverage::new(&scanner("reduced"));
        for place in [[0.0, 0.0, 0.095], [0.1, 0.1, 0.0], [0.0, 0.0, -1.0], [0.6, 0.0, 0.0]] {
            assert_eq!(coverage.solid_angle_sr(&Vector3::from(place)), 0.0, "{place:?}");
        }
    }
}
