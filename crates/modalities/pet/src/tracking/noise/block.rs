//! How wrongly one end of a line is told, as two normal laws.

use super::COMPONENTS;
use super::FWHM_PER_SD;
use crate::scanner::Scanner;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// No detector tells a place to better than a tenth of a millimetre; keeps every covariance invertible.
const SMALLEST_VARIANCE_M2: f64 = 1e-8;
/// Steps of the fit: the shares of a sample of 20,000 (the deposits are 6,000) stand still to three digits after 60.
const EM_STEPS: usize = 60;

/// How wrongly one end of a line is told, in the frame of its block.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockNoise {
    /// Share of the tail.
    pub tail_share: f64,
    /// Variances of the core: tangential, axial, depth, m².
    pub core_m2: [f64; 3],
    /// Variances of the tail: tangential, axial, depth, m².
    pub tail_m2: [f64; 3],
}

impl BlockNoise {
    /// GSO crystals of 4 x 6 x 20 mm: `0.75 N(S) + 0.25 N(11 S)`, S = 2.0, 4.4, 44 mm² (reference A, a Monte Carlo of the block).
    pub fn reference() -> Self {
        let core_m2 = [2.0e-6, 4.4e-6, 44e-6];
        Self { tail_share: 0.25, core_m2, tail_m2: core_m2.map(|v| 11.0 * v) }
    }

    /// A detector without crystals: one normal law of the given resolution across, and a depth that is not told.
    pub fn of_resolution(fwhm_m: f64, depth_m: f64) -> Self {
        let across = (fwhm_m / FWHM_PER_SD).powi(2);
        let core_m2 = [across, across, depth_m * depth_m / 12.0];
        Self { tail_share: 0.0, core_m2, tail_m2: core_m2 }
    }

    /// Of a block that stops next to nothing: the crystal's own size.
    pub(super) fn of_crystal(scanner: &Scanner) -> Self {
        let g = &scanner.grid;
        let core_m2 = [g.tangential_pitch_m, g.axial_pitch_m, g.depth_m].map(|v| v * v / 12.0);
        Self { tail_share: 0.0, core_m2, tail_m2: core_m2 }
    }

    /// Fits core and tail to errors `(tangential, axial, depth)` of single ends, m: EM on a mixture of two centred normal laws with
    /// diagonal covariances, from the quartile's spread as core and four times the rest as tail. `None` for fewer than 100 samples.
    pub fn of_samples(errors_block_m: &[Vector3<f64>]) -> Option<Self> {
        if errors_block_m.len() < 100 {
            return None;
        }
        let moment = |i: usize| {
            let mean = errors_block_m.iter().map(|e| e[i] * e[i]).sum::<f64>() / errors_block_m.len() as f64;
            mean.max(SMALLEST_VARIANCE_M2)
        };
        let whole = [moment(0), moment(1), moment(2)];
        let mut fit =
            Self { tail_share: 0.25, core_m2: whole.map(|v| 0.3 * v), tail_m2: whole.map(|v| 3.0 * v) };
        for _ in 0..EM_STEPS {
            fit = fit.em_step(errors_block_m);
        }
        Some(fit)
    }

    /// Share, and variance tangential and axial, of the three components of a line through the middle of its scanner, m².
    pub(super) fn laws_of_lines(&self, round_m2: f64) -> [(f64, [f64; 2]); COMPONENTS] {
        let t = self.tail_share;
        let half = |of_core: f64, of_tail: f64| {
            std::array::from_fn(|axis| {
                0.5 * (of_core * self.core_m2[axis] + of_tail * self.tail_m2[axis]) + round_m2
            })
        };
        [
            ((1.0 - t) * (1.0 - t), half(1.0, 0.0)),
            (2.0 * t * (1.0 - t), half(0.5, 0.5)),
            (t * t, half(0.0, 1.0)),
        ]
    }

    fn em_step(&self, errors: &[Vector3<f64>]) -> Self {
        let density = |e: &Vector3<f64>, v: &[f64; 3]| {
            let q: f64 = (0..3).map(|i| e[i] * e[i] / v[i]).sum();
            (-0.5 * q).exp() / (v[0] * v[1] * v[2]).sqrt()
        };
        let (mut tail, mut core) = ([0.0; 4], [0.0; 4]);
        for e in errors {
            let t = self.tail_share * density(e, &self.tail_m2);
            let c = (1.0 - self.tail_share) * density(e, &self.core_m2);
            let share = if t + c > 0.0 { t / (t + c) } else { 1.0 };
            for (sums, w) in [(&mut tail, share), (&mut core, 1.0 - share)] {
                sums[3] += w;
                for i in 0..3 {
                    sums[i] += w * e[i] * e[i];
                }
            }
        }
        let variances = |sums: &[f64; 4], old: &[f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| {
                if sums[3] > 1.0 { (sums[i] / sums[3]).max(SMALLEST_VARIANCE_M2) } else { old[i] }
            })
        };
        Self {
            tail_share: tail[3] / errors.len() as f64,
            core_m2: variances(&core, &self.core_m2),
            tail_m2: variances(&tail, &self.tail_m2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::RandomStreams;

    #[test]
    fn closed_form_the_fit_finds_the_mixture_that_it_was_drawn_from() {
        use rand_distr::{Distribution as _, StandardNormal};
        let mut random = RandomStreams::new(7, 0, "noise-test").stream("fit", 0);
        let truth = BlockNoise::reference();
        let sample: Vec<Vector3<f64>> = (0..20_000)
            .map(|i| {
                let v = if i % 4 == 0 { truth.tail_m2 } else { truth.core_m2 };
                Vector3::from(v.map(|v| {
                    let z: f64 = StandardNormal.sample(&mut random);
                    z * v.sqrt()
                }))
            })
            .collect();
        let fit = BlockNoise::of_samples(&sample).unwrap();
        assert!((fit.tail_share - 0.25).abs() < 0.015, "{fit:?}");
        for i in 0..3 {
            assert!((fit.core_m2[i] / truth.core_m2[i] - 1.0).abs() < 0.06, "{fit:?}");
            assert!((fit.tail_m2[i] / truth.tail_m2[i] - 1.0).abs() < 0.08, "{fit:?}");
        }
        assert_eq!(BlockNoise::of_samples(&sample[..99]), None);
    }
}
