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

use super::lanes::{Four, Three, cross, dot, splat3};
use super::likelihood::MAX_MARKERS;
use super::window::Rays;
use nalgebra::{Matrix3, Matrix6, Vector3};
use pulp::Arch;

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

/// Sums over all markers.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Total {
    /// Σ g gᵀ, g = Σ_k u^q [d; a x d] (world axes, about the capsule's origin); zero where not asked for.
    pub(crate) outer: Matrix6<f64>,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    members: Four,
    weight: Four,
    side: Three,
    matrix: [Four; 6],
}

/// A pass: memberships at these places with these shares. `arms_m`: places from the capsule's origin, for `outer`.
pub(crate) fn pass(
    rays: &[Rays],
    places_m: &[Vector3<f64>],
    shares: &[f64],
    arms_m: Option<&[Vector3<f64>]>,
    out: &mut [Share],
) -> Total {
    fn fixed<const J: usize, const OUTER: bool>(
        rays: &[Rays],
        places_m: &[Vector3<f64>],
        shares: &[f64],
        arms_m: &[Vector3<f64>],
        out: &mut [Share],
    ) -> Total {
        let used = places_m.len().min(J);
        let place = |k: usize| places_m.get(k).copied().unwrap_or_default();
        let at: [Three; J] = std::array::from_fn(|k| splat3(&place(k)));
        let arms: [Three; J] = std::array::from_fn(|k| splat3(&arms_m.get(k).copied().unwrap_or_default()));
        // Empty places: a logarithm so low that they own nothing.
        let log_share: [Four; J] =
            std::array::from_fn(|k| Four::splat(shares.get(k).map_or(-600.0, |f| f.max(1e-9).ln())));
        let mut sums = [Sums::default(); J];
        let mut outer = [Four::ZERO; 21];
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for r in rays {
                    one_pack::<J, OUTER>(r, &at, &arms, &log_share, &mut sums, &mut outer);
                }
            },
        );
        for (share, s) in out.iter_mut().zip(&sums[..used]) {
            *share = Share {
                members: s.members.sum(),
                weight: s.weight.sum(),
                side_m: Vector3::from(s.side.map(Four::sum)),
                matrix: Matrix3::identity() * s.weight.sum() - super::likelihood::symmetric(&s.matrix),
            };
        }
        let mut total = Total::default();
        let mut n = 0;
        for i in 0..6 {
            for l in i..6 {
                total.outer[(i, l)] = outer[n].sum();
                total.outer[(l, i)] = total.outer[(i, l)];
                n += 1;
            }
        }
        total
    }
    match (places_m.len(), arms_m) {
        (0..=3, None) => fixed::<3, false>(rays, places_m, shares, &[], out),
        (4..=6, None) => fixed::<6, false>(rays, places_m, shares, &[], out),
        (_, None) => fixed::<MAX_MARKERS, false>(rays, places_m, shares, &[], out),
        (0..=3, Some(arms)) => fixed::<3, true>(rays, places_m, shares, arms, out),
        (_, Some(arms)) => fixed::<MAX_MARKERS, true>(rays, places_m, shares, arms, out),
    }
}

#[inline(always)]
fn one_pack<const J: usize, const OUTER: bool>(
    r: &Rays,
    at: &[Three; J],
    arms: &[Three; J],
    log_share: &[Four; J],
    sums: &mut [Sums; J],
    outer: &mut [Four; 21],
) {
    let power = Four::splat(-1.0 / (FUZZINESS - 1.0));
    let mut squared = [Four::ZERO; J];
    let mut logs = [Four::ZERO; J];
    let mut offsets = [[Four::ZERO; 3]; J];
    let mut least = Four::splat(f64::INFINITY);
    for k in 0..J {
        let v: Three = std::array::from_fn(|i| r.foot_m[i] - at[k][i]);
        let along = dot(&v, &r.direction);
        offsets[k] = std::array::from_fn(|i| v[i] - along * r.direction[i]);
        squared[k] = dot(&offsets[k], &offsets[k]).max(Four::splat(SMALLEST_M2));
        logs[k] = log_share[k] + power * squared[k].ln();
        least = (-logs[k]).min(least);
    }
    // Largest logarithm taken out, so that nothing overflows.
    let mut total = Four::ZERO;
    for log in &mut logs {
        *log += least;
        total += log.exp();
    }
    let log_total = total.ln();
    let reach = Four::splat(REACH_M * REACH_M);
    let mut score = [Four::ZERO; 6];
    for k in 0..J {
        let log = logs[k] - log_total;
        let inside = squared[k].less_select(reach, r.filled, Four::ZERO);
        let u = log.exp() * inside;
        let w = (Four::splat(FUZZINESS) * log).exp() * inside;
        let s = &mut sums[k];
        s.members += u;
        s.weight += w;
        let n = &r.direction;
        let wn: Three = std::array::from_fn(|i| w * n[i]);
        for i in 0..3 {
            s.side[i] += w * r.foot_m[i];
        }
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (sum, (i, l)) in s.matrix.iter_mut().zip(pairs) {
            *sum += wn[i] * n[l];
        }
        if OUTER {
            let force: Three = std::array::from_fn(|i| w * offsets[k][i]);
            let torque = cross(&arms[k], &force);
            for i in 0..3 {
                score[i] += force[i];
                score[i + 3] += torque[i];
            }
        }
    }
    if OUTER {
        let mut n = 0;
        for i in 0..6 {
            for l in i..6 {
                outer[n] += score[i] * score[l];
                n += 1;
            }
        }
    }
}
