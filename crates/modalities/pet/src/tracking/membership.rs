//! Fuzzy memberships of lines in markers, and the sums that both trackers of than2015 need (eq. 3.14 to 3.18, chapter 6).
//!
//! ```text
//! u_nk = f_k d_nk^(-2/(q-1)) / Σ_j f_j d_nj^(-2/(q-1)),   q = 1.6,   u = 0 where d > 5 mm
//! A_k = Σ u^q (I - nnᵀ)      V_k = Σ u^q (I - nnᵀ) f = Σ u^q f (foot points)      Σ u^q d_k = V_k - A_k M_k
//! ```
//!
//! Signs: than2015 eq. 6.10 has d with the wrong sign (harmless in |d|², not in a step), eq. 6.24 prints `n_iy² - 1` where
//! `n_iz² - 1` belongs, eq. 3.10 lacks a minus that 6.22 has. Here A is positive semidefinite and d points from marker to line.
//! Distances below 1 um count as 1 um, so that a line through a marker is its own and nothing divides by zero.
//!
//! The loop goes by [`CHUNK`] packs and there by steps, not by packs: roots are long chains of operations that wait for each other,
//! and those of several packs are made meanwhile.

use super::lanes::{Eight, three};
use super::likelihood::MAX_MARKERS;
use super::octet::Octet;
use super::register::{Kernel, Register, Unit, dispatch, dot, load, splat3, sums};
use super::window::Rays;
use nalgebra::{Matrix3, Vector3};

/// Exponent of the memberships.
pub const FUZZINESS: f64 = 1.6;
/// A line further from a marker than this is none of its own, m.
pub const REACH_M: f64 = 5e-3;
/// Packs whose roots are made together.
const CHUNK: usize = 4;
/// Square of the smallest distance, m².
const SMALLEST_M2: f64 = 1e-12;

/// Sums of one marker.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Share {
    /// Σ u.
    pub(crate) members: f64,
    /// Σ u^q.
    pub(crate) weight: f64,
    /// V, m.
    pub(crate) side_m: Vector3<f64>,
    /// A.
    pub(crate) matrix: Matrix3<f64>,
}

/// A marker as a pass sees it.
#[derive(Clone, Copy, Default)]
struct Placed {
    at_m: Vector3<f64>,
    /// Relative activity f.
    share: f64,
    /// f^q.
    powered: f64,
}

/// As [`Placed`], in all lanes.
#[derive(Clone, Copy)]
struct Spread<S: Unit> {
    at: [Octet<S>; 3],
    share: Octet<S>,
    powered: Octet<S>,
}

/// What eight lines add to each sum of a marker.
#[derive(Clone, Copy, Default)]
struct Sums<T = f64> {
    members: T,
    weight: T,
    side: [T; 3],
    matrix: [T; 6],
}

/// A pass: memberships at these places with these shares; `Σ u^q d²`, m².
pub(crate) fn pass(
    rays: &[Rays<Eight>],
    places_m: &[Vector3<f64>],
    shares: &[f64],
    out: &mut [Share],
) -> f64 {
    fn fixed<const J: usize>(
        rays: &[Rays<Eight>],
        places_m: &[Vector3<f64>],
        shares: &[f64],
        out: &mut [Share],
    ) -> f64 {
        let used = places_m.len().min(J);
        // Empty places have no share and own nothing.
        let mut placed = [Placed { share: 1e-9, powered: 0.0, ..Placed::default() }; J];
        for ((to, at_m), f) in placed.iter_mut().zip(places_m).zip(shares) {
            let share = f.max(1e-9);
            *to = Placed { at_m: *at_m, share, powered: share.powf(FUZZINESS) };
        }
        let (cost_m2, sums) = dispatch(Loop { rays, placed: &placed });
        for (share, s) in out.iter_mut().zip(&sums[..used]) {
            *share = Share {
                members: s.members,
                weight: s.weight,
                side_m: Vector3::from(s.side),
                matrix: Matrix3::identity() * s.weight - super::likelihood::symmetric(&s.matrix),
            };
        }
        cost_m2
    }
    match places_m.len() {
        0..=3 => fixed::<3>(rays, places_m, shares, out),
        4..=6 => fixed::<6>(rays, places_m, shares, out),
        _ => fixed::<MAX_MARKERS>(rays, places_m, shares, out),
    }
}

/// The loop over a window's packs.
struct Loop<'a, const J: usize> {
    rays: &'a [Rays<Eight>],
    placed: &'a [Placed; J],
}

impl<const J: usize> Kernel for Loop<'_, J> {
    type Output = (f64, [Sums; J]);

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> Self::Output {
        let all = |number: f64| Octet::splat(unit, number);
        let spread = |of: &Placed| Spread {
            at: splat3(unit, &of.at_m),
            share: all(of.share),
            powered: all(of.powered),
        };
        let zero = all(0.0);
        let mut placed = [spread(&Placed::default()); J];
        for (to, from) in placed.iter_mut().zip(self.placed) {
            *to = spread(from);
        }
        let none = Sums { members: zero, weight: zero, side: [zero; 3], matrix: [zero; 6] };
        let (mut sums, mut cost) = ([none; J], zero);
        let nothing = Pack { squared: [zero; J], roots: [zero; J], own: [zero; J], total: zero, root: zero };
        // Behind the end of the last chunk are packs of the one before, which nobody looks at.
        let mut packs = [nothing; CHUNK];
        for rays in self.rays.chunks(CHUNK) {
            for (pack, r) in packs.iter_mut().zip(rays) {
                *pack = Pack::new(unit, r, &placed);
            }
            for pack in &mut packs[..rays.len()] {
                pack.root = pack.total.inverse_fifth_root();
            }
            // Marker by marker: one's sums have room in the registers.
            for k in 0..J {
                let mut of_marker = sums[k];
                for (pack, r) in packs.iter().zip(rays) {
                    cost += pack.share_out(unit, k, r, &placed[k], &mut of_marker);
                }
                sums[k] = of_marker;
            }
        }
        let mut added = [Sums::default(); J];
        for (to, from) in added.iter_mut().zip(&sums) {
            *to = from.added();
        }
        (cost.numbers().sum(), added)
    }
}

/// Eight lines on their way to memberships: with y = d^(-2/3), m^(-2/3), d^(-2/(q-1)) is y⁵ and its q-th power y⁸, q = 1.6.
#[derive(Clone, Copy)]
struct Pack<S: Unit, const J: usize> {
    /// d².
    squared: [Octet<S>; J],
    /// y.
    roots: [Octet<S>; J],
    /// f y⁵.
    own: [Octet<S>; J],
    /// t, the sum of these.
    total: Octet<S>,
    /// t^(-1/5), r.
    root: Octet<S>,
}

impl<S: Unit, const J: usize> Pack<S, J> {
    #[inline(always)]
    fn new(unit: S, r: &Rays<Eight>, placed: &[Spread<S>; J]) -> Self {
        let (n, foot) = (load(unit, &r.direction), load(unit, &r.foot_m));
        let (zero, least) = (Octet::splat(unit, 0.0), Octet::splat(unit, SMALLEST_M2));
        let (mut squared, mut roots, mut own) = ([zero; J], [zero; J], [zero; J]);
        let mut total = Octet::splat(unit, Octet::<S>::LEAST);
        for k in 0..J {
            let v: [Octet<S>; 3] = three!(i => foot[i] - placed[k].at[i]);
            let along = dot(&v, &n);
            squared[k] = along.mul_sub_from(along, dot(&v, &v)).max(least);
            let root = squared[k].inverse_cube_root();
            let square = root * root;
            roots[k] = root;
            own[k] = placed[k].share * root * (square * square);
            total += own[k];
        }
        Self { squared, roots, own, total, root: zero }
    }

    /// Adds to the sums of a marker: u = f y⁵ r⁵ and u^q = f^q (y r)⁸. The cost.
    #[inline(always)]
    fn share_out(
        &self,
        unit: S,
        k: usize,
        r: &Rays<Eight>,
        placed: &Spread<S>,
        sums: &mut Sums<Octet<S>>,
    ) -> Octet<S> {
        let (zero, reach) = (Octet::splat(unit, 0.0), Octet::splat(unit, REACH_M * REACH_M));
        let inside = self.squared[k].less_select(reach, Octet::of(unit, r.filled), zero);
        let square = self.root * self.root;
        sums.members = (self.own[k] * inside).mul_add(square * square * self.root, sums.members);
        let z = self.roots[k] * self.root;
        let z2 = z * z;
        let z4 = z2 * z2;
        let w = placed.powered * (z4 * z4) * inside;
        sums.add(w, &load(unit, &r.direction), &load(unit, &r.foot_m));
        w * self.squared[k]
    }
}

impl<S: Unit> Sums<Octet<S>> {
    /// Over the lanes.
    #[inline(always)]
    fn added(&self) -> Sums {
        let [members, weight] = sums(&[self.members, self.weight]);
        Sums { members, weight, side: sums(&self.side), matrix: sums(&self.matrix) }
    }

    /// Eight lines of these weights u^q.
    #[inline(always)]
    fn add(&mut self, w: Octet<S>, n: &[Octet<S>; 3], foot: &[Octet<S>; 3]) {
        self.weight += w;
        let wn: [Octet<S>; 3] = three!(i => w * n[i]);
        for i in 0..3 {
            self.side[i] = w.mul_add(foot[i], self.side[i]);
        }
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (sum, (i, l)) in self.matrix.iter_mut().zip(pairs) {
            *sum = wn[i].mul_add(n[l], *sum);
        }
    }
}
