//! What no choice of n candidates can beat: the convex relaxation, in which a candidate may be chosen in part.
//!
//! ```text
//! minimise  F(w) = F(I_0 + Σ w_i I_i)     0 ≤ w_i ≤ 1,  Σ w_i = n
//! F(v) ≥ F(w) + ∇F(w)·(v - w)  for every v, so   bound = F(w) + Σ_{n smallest} ∂F/∂w_i - ∇F(w)·w
//! ```
//!
//! by the method of Frank and Wolfe (1956), whose linear subproblem is that sum: the best corner is the n candidates with the smallest
//! slopes. Every iterate gives a bound; the largest of them is told. The worst pose: for any weights λ over the poses that sum to one,
//! `max_m tr C_m ≥ Σ λ_m tr C_m`, whose minimum is bounded in the same way; λ is taken from a p-norm's optimum.

use super::moving::by_information;
use super::table::InformationTable;
use crate::criterion::Criterion;
use crate::information::{Inverse, Size};
use nalgebra::Matrix3;

const ITERATIONS: usize = 600;
/// Exponent of the p-norm that gives the weights of the poses.
const SHARPNESS: f64 = 64.0;
/// Steps of the line search: a golden section each.
const SECTIONS: usize = 24;
/// It has settled where bound and value agree to this.
const GAP: f64 = 1e-4;

/// A convex F over the sums at all poses, and how it is shown.
#[derive(Clone, Debug)]
enum Convex {
    /// Σ λ_m tr C_m.
    Weighted(Vec<f64>),
    /// (mean (tr C)^(p/2))^(2/p).
    PNorm(f64),
    /// mean log det C.
    D,
}

impl Convex {
    /// F and its slopes by the position's blocks.
    fn slopes(&self, inverses: &[Inverse], slopes: &mut Vec<Matrix3<f64>>) -> f64 {
        match self {
            Self::Weighted(weights) => {
                slopes.clear();
                slopes.extend(weights.iter().map(|w| Matrix3::identity() * *w));
                weights.iter().zip(inverses).map(|(w, i)| w * i.position_trace_m2()).sum()
            }
            Self::PNorm(p) => {
                let norm = Criterion::PNorm(*p).slopes(*p, inverses, slopes).exp();
                slopes.iter_mut().for_each(|s| *s *= norm);
                norm
            }
            Self::D => Criterion::D.slopes(0.0, inverses, slopes),
        }
    }
}

/// A lower bound on the criterion of any choice of `count` candidates, in the criterion's unit; `None` where the criterion is not convex,
/// where no relaxation was found that sees every pose, or where it was stopped.
pub fn lower_bound(
    table: &InformationTable,
    prior: &[f64],
    count: usize,
    criterion: Criterion,
    stopped: &dyn Fn() -> bool,
) -> Option<f64> {
    let equal = || vec![1.0 / table.poses as f64; table.poses];
    match criterion {
        Criterion::Rms => Some(
            1e3 * minimum(table, prior, count, &Convex::Weighted(equal()), stopped)?.bound.max(0.0).sqrt(),
        ),
        Criterion::PNorm(p) if criterion.is_convex() => {
            Some(1e3 * minimum(table, prior, count, &Convex::PNorm(p), stopped)?.bound.max(0.0).sqrt())
        }
        Criterion::D => Some(minimum(table, prior, count, &Convex::D, stopped)?.bound),
        Criterion::Worst => {
            let sharp = minimum(table, prior, count, &Convex::PNorm(SHARPNESS), stopped)?;
            let mut slopes = Vec::new();
            Convex::PNorm(SHARPNESS).slopes(&sharp.inverses, &mut slopes);
            let sum: f64 = slopes.iter().map(|s| s[(0, 0)]).sum();
            let weights = slopes.iter().map(|s| s[(0, 0)] / sum).collect();
            Some(
                1e3 * minimum(table, prior, count, &Convex::Weighted(weights), stopped)?
                    .bound
                    .max(0.0)
                    .sqrt(),
            )
        }
        Criterion::Mean | Criterion::PNorm(_) | Criterion::E => None,
    }
}

struct Minimum {
    bound: f64,
    inverses: Vec<Inverse>,
}

fn minimum(
    table: &InformationTable,
    prior: &[f64],
    count: usize,
    convex: &Convex,
    stopped: &dyn Fn() -> bool,
) -> Option<Minimum> {
    let one = table.len_of_one();
    let mut w = vec![count as f64 / table.candidates as f64; table.candidates];
    let mut sums = sums_of(table, prior, &w);
    let mut slopes = Vec::new();
    let mut bound = f64::NEG_INFINITY;
    let mut inverses = invert(&sums, one, table.size)?;
    for _ in 0..ITERATIONS {
        let value = convex.slopes(&inverses, &mut slopes);
        let gradient = gradient(table, &inverses, &slopes);
        let corner = smallest(&gradient, count);
        let here: f64 = gradient.iter().zip(&w).map(|(g, w)| g * w).sum();
        let there: f64 = corner.iter().map(|i| gradient[*i]).sum();
        bound = bound.max(value + there - here);
        if stopped() {
            return None;
        }
        if value - bound <= GAP * value.abs() {
            break;
        }
        let mut v = vec![0.0; table.candidates];
        corner.iter().for_each(|i| v[*i] = 1.0);
        let towards = sums_of(table, prior, &v);
        let step = line_search(&sums, &towards, one, table.size, convex);
        w.iter_mut().zip(&v).for_each(|(w, v)| *w += step * (v - *w));
        sums.iter_mut().zip(&towards).for_each(|(s, t)| *s += step * (t - *s));
        inverses = invert(&sums, one, table.size)?;
    }
    Some(Minimum { bound, inverses })
}

fn sums_of(table: &InformationTable, prior: &[f64], w: &[f64]) -> Vec<f64> {
    let one = table.len_of_one();
    let mut sums = Vec::with_capacity(table.poses * one);
    for pose in 0..table.poses {
        sums.extend_from_slice(prior);
        let sum = &mut sums[pose * one..];
        for (i, weight) in w.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            sum.iter_mut().zip(table.at(pose, i)).for_each(|(s, v)| *s += weight * v);
        }
    }
    sums
}

fn invert(sums: &[f64], one: usize, size: Size) -> Option<Vec<Inverse>> {
    sums.chunks(one).map(|sum| Inverse::of(sum, size)).collect()
}

fn gradient(table: &InformationTable, inverses: &[Inverse], slopes: &[Matrix3<f64>]) -> Vec<f64> {
    let mut gradient = vec![0.0; table.candidates];
    let mut weights = vec![0.0; table.len_of_one()];
    for (pose, (inverse, slope)) in inverses.iter().zip(slopes).enumerate() {
        by_information(inverse, slope, &mut weights);
        for (i, g) in gradient.iter_mut().enumerate() {
            *g += weights.iter().zip(table.at(pose, i)).map(|(w, v)| w * v).sum::<f64>();
        }
    }
    gradient
}

/// The `count` indices with the smallest values.
fn smallest(values: &[f64], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]).then(a.cmp(b)));
    order.truncate(count);
    order
}

/// The step from 0 to 1 with the smallest F, by golden section.
fn line_search(from: &[f64], to: &[f64], one: usize, size: Size, convex: &Convex) -> f64 {
    let mut slopes = Vec::new();
    let mut value = |step: f64| {
        let sums: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + step * (b - a)).collect();
        invert(&sums, one, size).map_or(f64::INFINITY, |inverses| convex.slopes(&inverses, &mut slopes))
    };
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut low, mut high) = (0.0, 1.0);
    let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_a, mut at_b) = (value(a), value(b));
    for _ in 0..SECTIONS {
        if at_a <= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - golden * (high - low);
            at_a = value(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + golden * (high - low);
            at_b = value(b);
        }
    }
    0.5 * (low + high)
}
