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

use super::lanes::{Four, Three, dot, splat3, three};
use super::likelihood::MAX_MARKERS;
use super::window::Rays;
use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};

/// Exponent of the memberships.
pub const FUZZINESS: f64 = 1.6;
/// A line further from a marker than this is none of its own, m.
pub const REACH_M: f64 = 5e-3;
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

/// Relative activity f of a marker, and f^q.
#[derive(Clone, Copy)]
struct Activity {
    plain: Four,
    powered: Four,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    members: Four,
    weight: Four,
    side: Three,
    matrix: [Four; 6],
}

/// A pass: memberships at these places with these shares; `Σ u^q d²`, m².
pub(crate) fn pass(rays: &[Rays], places_m: &[Vector3<f64>], shares: &[f64], out: &mut [Share]) -> f64 {
    fn fixed<const J: usize>(
        rays: &[Rays],
        places_m: &[Vector3<f64>],
        shares: &[f64],
        out: &mut [Share],
    ) -> f64 {
        let used = places_m.len().min(J);
        let place = |k: usize| places_m.get(k).copied().unwrap_or_default();
        let at: [Three; J] = std::array::from_fn(|k| splat3(&place(k)));
        // Empty places have no share and own nothing.
        let share: [Activity; J] = std::array::from_fn(|k| {
            let f = shares.get(k).map_or(0.0, |f| f.max(1e-9));
            Activity { plain: Four::splat(f), powered: Four::splat(f.powf(FUZZINESS)) }
        });
        let (cost_m2, sums) = Arch::new().dispatch(Loop { rays, at: &at, share: &share });
        for (share, s) in out.iter_mut().zip(&sums[..used]) {
            *share = Share {
                members: s.members.sum(),
                weight: s.weight.sum(),
                side_m: Vector3::from(s.side.map(Four::sum)),
                matrix: Matrix3::identity() * s.weight.sum() - super::likelihood::symmetric(&s.matrix),
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
    rays: &'a [Rays],
    at: &'a [Three; J],
    share: &'a [Activity; J],
}

impl<const J: usize> WithSimd for Loop<'_, J> {
    type Output = (f64, [Sums; J]);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let mut sums = [Sums::default(); J];
        let mut cost = Four::ZERO;
        for r in self.rays {
            cost += one_pack::<J>(r, self.at, self.share, &mut sums);
        }
        (cost.sum(), sums)
    }
}

#[inline(always)]
fn one_pack<const J: usize>(r: &Rays, at: &[Three; J], share: &[Activity; J], sums: &mut [Sums; J]) -> Four {
    // With y = d^(-2/3), m^(-2/3): d^(-2/(q-1)) = y⁵ and its q-th power y⁸, q = 1.6; with t the sum of f y⁵ and r = t^(-1/5), u = f y⁵ r⁵
    // and u^q = f^q (y r)⁸.
    let mut squared = [Four::ZERO; J];
    let mut roots = [Four::ZERO; J];
    let mut own = [Four::ZERO; J];
    for k in 0..J {
        let v: Three = three!(i => r.foot_m[i] - at[k][i]);
        let along = dot(&v, &r.direction);
        squared[k] = (dot(&v, &v) - along * along).max(Four::splat(SMALLEST_M2));
        roots[k] = squared[k].inverse_cube_root();
        let y2 = roots[k] * roots[k];
        own[k] = share[k].plain * roots[k] * (y2 * y2);
    }
    let mut total = Four::splat(f64::MIN_POSITIVE);
    for of_marker in own {
        total += of_marker;
    }
    let root = total.inverse_fifth_root();
    let root2 = root * root;
    let inverse = root2 * root2 * root;
    let reach = Four::splat(REACH_M * REACH_M);
    let mut cost = Four::ZERO;
    for k in 0..J {
        let inside = squared[k].less_select(reach, r.filled, Four::ZERO);
        let u = own[k] * inverse * inside;
        let z = roots[k] * root;
        let z2 = z * z;
        let z4 = z2 * z2;
        let w = share[k].powered * (z4 * z4) * inside;
        let s = &mut sums[k];
        s.members += u;
        s.weight += w;
        cost = w.mul_add(squared[k], cost);
        let n = &r.direction;
        let wn: Three = three!(i => w * n[i]);
        for i in 0..3 {
            s.side[i] = w.mul_add(r.foot_m[i], s.side[i]);
        }
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (sum, (i, l)) in s.matrix.iter_mut().zip(pairs) {
            *sum = wn[i].mul_add(n[l], *sum);
        }
    }
    cost
}
