//! What an optimal layout is optimal in: criteria over the position's bound C at the poses of a workspace.
//!
//! ```text
//! rms (A)   √(mean tr C)            mean   mean √(tr C)          worst  max √(tr C)
//! p-norm    (mean (tr C)^(p/2))^(1/p)        d  mean log det C   e      max √λ_max(C)
//! ```
//!
//! Searches minimise a monotone function F of the criterion. Where it is a maximum, a gradient is that of the p-norm in its place,
//! which for a large p hugs it: `max ≤ p-norm · M^(1/p)`.

use crate::information::Inverse;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// Root of the mean squared error: A-optimality.
    Rms,
    /// Mean error.
    Mean,
    /// Largest error.
    Worst,
    /// Between the root mean square (2) and the largest (∞).
    PNorm(f64),
    /// Mean log volume: D-optimality.
    D,
    /// Largest error along any direction: E-optimality.
    E,
}

impl Criterion {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rms => "rms",
            Self::Mean => "mean",
            Self::Worst => "worst",
            Self::PNorm(_) => "p-norm",
            Self::D => "d",
            Self::E => "e",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        if self == Self::D { "log m^6" } else { "mm" }
    }

    /// From F to the criterion in its unit.
    pub fn shown(self, f: f64) -> f64 {
        match self {
            Self::Rms | Self::Worst | Self::E => 1e3 * f.max(0.0).sqrt(),
            Self::Mean => 1e3 * f,
            Self::PNorm(_) => 1e3 * (0.5 * f).exp(),
            Self::D => f,
        }
    }

    /// Whether F is a convex function of the information, so that a relaxation bounds it from below.
    pub fn is_convex(self) -> bool {
        match self {
            // A power below 1 of a convex function need not be convex.
            Self::Mean => false,
            Self::PNorm(p) => p >= 2.0,
            Self::Rms | Self::Worst | Self::D | Self::E => true,
        }
    }

    /// What counts at one pose.
    fn at(self, inverse: &Inverse) -> f64 {
        match self {
            Self::Rms | Self::Worst | Self::PNorm(_) => inverse.position_trace_m2(),
            Self::Mean => inverse.position_trace_m2().max(0.0).sqrt(),
            Self::D => inverse.position_m2().determinant().ln(),
            Self::E => inverse.position_m2().symmetric_eigenvalues().max(),
        }
    }

    fn is_maximum(self) -> bool {
        matches!(self, Self::Worst | Self::E)
    }

    /// F of poses given one after another; infinite as soon as one has no bound, or once it cannot come out below `limit` any more.
    pub fn value(self, count: usize, limit: f64, mut inverse: impl FnMut(usize) -> Option<Inverse>) -> f64 {
        if let Self::PNorm(p) = self {
            return p_norm(p, count, limit, inverse);
        }
        let (mut sum, mut largest) = (0.0, f64::NEG_INFINITY);
        // All terms but logarithms are positive: a partial sum is a lower bound.
        let most = match self {
            Self::Rms | Self::Mean => limit * count as f64,
            Self::PNorm(_) | Self::Worst | Self::D | Self::E => f64::INFINITY,
        };
        for i in 0..count {
            let Some(inverse) = inverse(i) else { return f64::INFINITY };
            let value = self.at(&inverse);
            sum += value;
            largest = largest.max(value);
            if sum > most || (self.is_maximum() && largest > limit) {
                return f64::INFINITY;
            }
        }
        let mean = sum / count as f64;
        match self {
            Self::Worst | Self::E => largest,
            Self::PNorm(_) | Self::Rms | Self::Mean | Self::D => mean,
        }
    }

    /// F and its derivative by the position's block at each pose. Maxima are replaced by the p-norm with exponent `sharpness` (2 or
    /// more), of which F is the logarithm.
    pub fn slopes(self, sharpness: f64, inverses: &[Inverse], slopes: &mut Vec<Matrix3<f64>>) -> f64 {
        let count = inverses.len() as f64;
        slopes.clear();
        match self {
            Self::Rms => {
                slopes.resize(inverses.len(), Matrix3::identity() / count);
                inverses.iter().map(Inverse::position_trace_m2).sum::<f64>() / count
            }
            Self::Mean => {
                let roots = inverses.iter().map(|i| i.position_trace_m2().max(f64::MIN_POSITIVE).sqrt());
                slopes.extend(roots.clone().map(|root| Matrix3::identity() * (0.5 / root / count)));
                roots.sum::<f64>() / count
            }
            Self::D => {
                let of = |i: &Inverse| i.position_m2().try_inverse().unwrap_or_default() / count;
                slopes.extend(inverses.iter().map(of));
                inverses.iter().map(|i| i.position_m2().determinant().ln()).sum::<f64>() / count
            }
            Self::PNorm(p) => {
                let traces = inverses.iter().map(|i| (i.position_trace_m2(), Matrix3::identity()));
                log_p_norm(p, &traces.collect::<Vec<_>>(), slopes)
            }
            Self::Worst => {
                let traces = inverses.iter().map(|i| (i.position_trace_m2(), Matrix3::identity()));
                log_p_norm(sharpness, &traces.collect::<Vec<_>>(), slopes)
            }
            Self::E => {
                let largest = inverses.iter().map(|i| {
                    let eigen = i.position_m2().symmetric_eigen();
                    let at = eigen.eigenvalues.imax();
                    let along = eigen.eigenvectors.column(at).into_owned();
                    (eigen.eigenvalues[at], along * along.transpose())
                });
                log_p_norm(sharpness, &largest.collect::<Vec<_>>(), slopes)
            }
        }
    }
}

/// `(2/p) log mean s^(p/2)` of traces s: the largest is taken out of the sum, since s^(p/2) of a millimetre underflows from p = 100 on.
fn p_norm(p: f64, count: usize, limit: f64, mut inverse: impl FnMut(usize) -> Option<Inverse>) -> f64 {
    let (mut largest, mut sum) = (f64::MIN_POSITIVE, 0.0);
    let mut value = f64::NEG_INFINITY;
    for i in 0..count {
        let Some(inverse) = inverse(i) else { return f64::INFINITY };
        let trace = inverse.position_trace_m2();
        if trace > largest {
            sum *= (largest / trace).powf(0.5 * p);
            largest = trace;
        }
        sum += (trace / largest).powf(0.5 * p);
        // A partial sum is a lower bound.
        value = largest.ln() + 2.0 / p * (sum / count as f64).ln();
        if value > limit {
            return f64::INFINITY;
        }
    }
    value
}

/// `(2/p) log mean s^(p/2)` of positive s, and its slopes times each s's own derivative.
fn log_p_norm(p: f64, terms: &[(f64, Matrix3<f64>)], slopes: &mut Vec<Matrix3<f64>>) -> f64 {
    let largest = terms.iter().map(|(s, _)| *s).fold(f64::MIN_POSITIVE, f64::max);
    let powers: Vec<f64> = terms.iter().map(|(s, _)| (s / largest).powf(0.5 * p)).collect();
    let sum: f64 = powers.iter().sum();
    slopes.extend(terms.iter().zip(&powers).map(|((s, by), power)| by * (power / s / sum)));
    largest.ln() + 2.0 / p * (sum / terms.len() as f64).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::layout::packed_len;

    /// An information whose position block is this diagonal, in 1/m².
    fn information(diagonal: [f64; 3]) -> Vec<f64> {
        let mut packed = vec![0.0; packed_len(3)];
        for (i, value) in diagonal.into_iter().enumerate() {
            packed[packed_len(i) + i] = value;
        }
        packed
    }

    const DIAGONALS: [[f64; 3]; 2] = [[1.0, 4.0, 4.0], [0.25, 0.5, 1.0]];

    #[test]
    fn closed_form_values_of_two_poses() {
        let value =
            |c: Criterion| c.shown(c.value(2, f64::INFINITY, |i| Inverse::of(&information(DIAGONALS[i]), 3)));
        // Traces 1.5 and 7 m².
        assert!((value(Criterion::Rms) - 1e3 * 4.25_f64.sqrt()).abs() < 1e-9);
        assert!((value(Criterion::Mean) - 500.0 * (1.5_f64.sqrt() + 7.0_f64.sqrt())).abs() < 1e-9);
        assert!((value(Criterion::Worst) - 1e3 * 7.0_f64.sqrt()).abs() < 1e-9);
        assert!((value(Criterion::PNorm(4.0)) - 1e3 * 25.625_f64.powf(0.25)).abs() < 1e-9);
        assert!((value(Criterion::PNorm(2.0)) - value(Criterion::Rms)).abs() < 1e-9);
        // Of micrometres and a high power nothing underflows: 7 m² and 1.5 m², 1e-12 of them.
        for p in [100.0, 300.0, 1000.0] {
            let small = |i: usize| Inverse::of(&information(DIAGONALS[i].map(|d| 1e12 * d)), 3);
            let found = Criterion::PNorm(p).shown(Criterion::PNorm(p).value(2, f64::INFINITY, small));
            let wanted = 1e-3 * 7.0_f64.sqrt() * 0.5_f64.powf(1.0 / p);
            assert!((found / wanted - 1.0).abs() < 1e-9, "{p}: {found} {wanted}");
        }
        assert!((value(Criterion::D) - 0.5 * ((1.0 / 16.0_f64).ln() + 8.0_f64.ln())).abs() < 1e-12);
        assert!((value(Criterion::E) - 2000.0).abs() < 1e-9);
        for c in [Criterion::Rms, Criterion::Worst, Criterion::PNorm(4.0)] {
            assert_eq!(c.value(2, 0.1, |i| Inverse::of(&information(DIAGONALS[i]), 3)), f64::INFINITY);
            assert_eq!(c.value(1, f64::INFINITY, |_| None), f64::INFINITY);
        }
    }

    #[test]
    fn closed_form_slopes_are_those_of_central_differences() {
        let inverses = |shift: f64| -> Vec<Inverse> {
            let of = |mut d: [f64; 3]| {
                d[1] = 1.0 / (1.0 / d[1] + shift);
                Inverse::of(&information(d), 3).unwrap()
            };
            vec![of(DIAGONALS[0]), Inverse::of(&information(DIAGONALS[1]), 3).unwrap()]
        };
        for c in [
            Criterion::Rms,
            Criterion::Mean,
            Criterion::Worst,
            Criterion::PNorm(3.0),
            Criterion::D,
            Criterion::E,
        ] {
            let mut slopes = Vec::new();
            c.slopes(6.0, &inverses(0.0), &mut slopes);
            let slope = slopes[0][(1, 1)];
            let h = 1e-6;
            let differences = (c.slopes(6.0, &inverses(h), &mut slopes)
                - c.slopes(6.0, &inverses(-h), &mut slopes))
                / (2.0 * h);
            assert!((slope - differences).abs() < 1e-8 * (1.0 + slope.abs()), "{c:?}: {slope} {differences}");
        }
    }
}
