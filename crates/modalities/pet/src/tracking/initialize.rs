//! Where the markers are when nothing is known: the set is turned about the lines' centroid (than2015, eq. 3.6 to 3.13).
//!
//! Cost of a turn: the sum over lines of the squared distance to the nearest marker, `|M|² + |f|² - 2 M·f - (n·M)²` for a line with
//! direction n and foot point f. Looked at are [`TURNS`] turns spread evenly over SO(3) by the super-Fibonacci spiral (Alexa 2022,
//! "Super-Fibonacci spirals", CVPR, algorithm 1); the best of different places are handed on for refinement.

use super::lanes::{Four, dot, splat3};
use super::window::Rays;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use pulp::{Arch, Simd, WithSimd};

/// Turns looked at: neighbours are 19 degrees apart, a third of what the refinement bridges.
pub const TURNS: usize = 1024;
/// Turns handed on for refinement.
pub const CANDIDATES: usize = 8;
/// Candidates are at least so far apart, rad.
const APART_RAD: f64 = 0.6;
/// The two constants of the spiral: √2 and the positive root of `ψ⁴ = ψ + 4`.
const PHI: f64 = std::f64::consts::SQRT_2;
const PSI: f64 = 1.533751168755204288118041;

/// Searches; keeps its buffers and the turns.
#[derive(Clone, Debug)]
pub struct Search {
    turns: Vec<UnitQuaternion<f64>>,
    order: Vec<(f64, u32)>,
    found: Vec<(f64, UnitQuaternion<f64>)>,
}

impl Default for Search {
    fn default() -> Self {
        Self { turns: (0..TURNS).map(turn).collect(), order: Vec::new(), found: Vec::new() }
    }
}

/// Turn `i` of the spiral.
fn turn(i: usize) -> UnitQuaternion<f64> {
    let s = i as f64 + 0.5;
    let t = s / TURNS as f64;
    let (r, big_r) = (t.sqrt(), (1.0 - t).sqrt());
    let (alpha, beta) = (std::f64::consts::TAU * s / PHI, std::f64::consts::TAU * s / PSI);
    UnitQuaternion::new_normalize(Quaternion::new(
        big_r * beta.cos(),
        r * alpha.sin(),
        r * alpha.cos(),
        big_r * beta.sin(),
    ))
}

impl Search {
    /// The best turns, best first, with their mean squared distance, m². `arms_m`: markers from their centroid, capsule axes;
    /// `rays` from the centroid of the lines.
    pub(crate) fn find(
        &mut self,
        rays: &[Rays],
        centre: &Vector3<f64>,
        arms_m: &[Vector3<f64>],
    ) -> &[(f64, UnitQuaternion<f64>)] {
        let order = &mut self.order;
        order.clear();
        Arch::new().dispatch(Costs { rays, centre, arms_m, turns: &self.turns, order });
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        self.found.clear();
        for (cost, i) in &self.order {
            let turn = self.turns[*i as usize];
            if self.found.iter().all(|(_, other)| other.angle_to(&turn) > APART_RAD) {
                self.found.push((*cost, turn));
                if self.found.len() == CANDIDATES {
                    break;
                }
            }
        }
        &self.found
    }
}

/// The costs of all turns, with their numbers, into `order`.
struct Costs<'a> {
    rays: &'a [Rays],
    centre: &'a Vector3<f64>,
    arms_m: &'a [Vector3<f64>],
    turns: &'a [UnitQuaternion<f64>],
    order: &'a mut Vec<(f64, u32)>,
}

impl WithSimd for Costs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (i, turn) in self.turns.iter().enumerate() {
            self.order.push((cost(self.rays, self.centre, self.arms_m, turn), i as u32));
        }
    }
}

#[inline(always)]
fn cost(rays: &[Rays], centre: &Vector3<f64>, arms_m: &[Vector3<f64>], turn: &UnitQuaternion<f64>) -> f64 {
    let mut places = [Vector3::zeros(); super::likelihood::MAX_MARKERS];
    let used = arms_m.len().min(places.len());
    for (place, arm) in places.iter_mut().zip(arms_m) {
        *place = centre + turn * arm;
    }
    let mut sum = Four::ZERO;
    for r in rays {
        let mut least = Four::splat(f64::INFINITY);
        for place in &places[..used] {
            let m = splat3(place);
            let along = dot(&m, &r.direction);
            let squared = Four::splat(place.norm_squared()) - (dot(&m, &r.foot_m) + dot(&m, &r.foot_m));
            least = (squared - along * along).min(least);
        }
        sum += (least + dot(&r.foot_m, &r.foot_m)) * r.filled;
    }
    sum.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_the_turns_cover_all_attitudes() {
        let search = Search::default();
        let mut random = lumenav_core::RandomStreams::new(1, 0, "search").stream("turns", 0);
        for _ in 0..500 {
            let mut normal =
                || -> f64 { rand_distr::Distribution::sample(&rand_distr::StandardNormal, &mut random) };
            let any = UnitQuaternion::new_normalize(Quaternion::new(normal(), normal(), normal(), normal()));
            let nearest = search.turns.iter().map(|t| t.angle_to(&any)).fold(f64::INFINITY, f64::min);
            assert!(nearest.to_degrees() < 20.0, "a hole of {} degrees", nearest.to_degrees());
        }
    }
}
