//! The marker that each line passes nearest to.

use super::lanes::{Four, three};
use super::quad::{Kernel, Quad, Quads, Unit, dispatch, dot, quads, splat3};
use super::window::Rays;
use nalgebra::Vector3;

/// Of four lines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    /// Squared distance from the nearest marker, at most that of the reach; 0 in a pack's empty places, m².
    pub(crate) squared_m2: Four,
    /// Its number; -1 where none is within reach.
    pub(crate) marker: Four,
}

/// The nearest markers of a window's lines, within a reach, into `found`.
pub(crate) fn nearest(rays: &[Rays], markers_m: &[Vector3<f64>], reach_m: f64, found: &mut Vec<Nearest>) {
    found.clear();
    dispatch(Loop { rays, markers_m, reach_m, found });
}

struct Loop<'a> {
    rays: &'a [Rays],
    markers_m: &'a [Vector3<f64>],
    reach_m: f64,
    found: &'a mut Vec<Nearest>,
}

impl Kernel for Loop<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) {
        let all = |number: f64| Quad::splat(unit, number);
        for r in self.rays {
            let (n, foot) = (quads(unit, &r.direction), quads(unit, &r.foot_m));
            let (mut least, mut marker) = (all(self.reach_m * self.reach_m), all(-1.0));
            for (number, at_m) in self.markers_m.iter().enumerate() {
                let at = splat3(unit, at_m);
                let v: Quads<S> = three!(i => foot[i] - at[i]);
                let along = dot(&v, &n);
                let squared = along.mul_sub_from(along, dot(&v, &v));
                marker = squared.less_select(least, all(number as f64), marker);
                least = squared.min(least);
            }
            let squared_m2 = (least * Quad::of(unit, r.filled)).four();
            self.found.push(Nearest { squared_m2, marker: marker.four() });
        }
    }
}
