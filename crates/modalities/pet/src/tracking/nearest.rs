//! The marker that each line passes nearest to.

use super::lanes::{Eight, three};
use super::octet::Octet;
use super::register::{Kernel, Register, Unit, dispatch, dot, load, splat3};
use super::window::Rays;
use nalgebra::Vector3;

/// Of eight lines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    /// Squared distance from the nearest marker, at most that of the reach; 0 in a pack's empty places, m².
    pub(crate) squared_m2: Eight,
    /// Its number; -1 where none is within reach.
    pub(crate) marker: Eight,
}

/// The nearest markers of a window's lines, within a reach, into `found`.
pub(crate) fn nearest(
    rays: &[Rays<Eight>],
    markers_m: &[Vector3<f64>],
    reach_m: f64,
    found: &mut Vec<Nearest>,
) {
    found.clear();
    dispatch(Loop { rays, markers_m, reach_m, found });
}

struct Loop<'a> {
    rays: &'a [Rays<Eight>],
    markers_m: &'a [Vector3<f64>],
    reach_m: f64,
    found: &'a mut Vec<Nearest>,
}

impl Kernel for Loop<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) {
        let all = |number: f64| Octet::splat(unit, number);
        for r in self.rays {
            let (n, foot) = (load(unit, &r.direction), load(unit, &r.foot_m));
            let (mut least, mut marker) = (all(self.reach_m * self.reach_m), all(-1.0));
            for (number, at_m) in self.markers_m.iter().enumerate() {
                let at = splat3(unit, at_m);
                let v: [Octet<S>; 3] = three!(i => foot[i] - at[i]);
                let along = dot(&v, &n);
                let squared = along.mul_sub_from(along, dot(&v, &v));
                marker = squared.less_select(least, all(number as f64), marker);
                least = squared.min(least);
            }
            let squared_m2 = (least * Octet::of(unit, r.filled)).numbers();
            self.found.push(Nearest { squared_m2, marker: marker.numbers() });
        }
    }
}
