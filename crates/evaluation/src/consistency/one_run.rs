//! NEES and NIS of one run, collected as the run goes in constant memory.
//!
//! ```text
//! coverage of the credible region p = share of updates with NEES <= chi2_p(dof)      nominal: p
//! inside 95 %                        = share of updates with chi2_0.025 <= NEES <= chi2_0.975
//! pooled NIS                         = sum NIS / sum dof, band: chi2 of (sum dof) / sum dof
//! ```

use super::{ErrorBlock, nees};
use crate::chi_square::{Band, chi_square_band, chi_square_quantile, standard_normal_quantile};
use crate::error::{EvaluationError, proper_share};
use crate::pose_error::PoseError;
use crate::summary::CompensatedSum;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The NEES figures of one run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NeesSummary {
    /// Mean NEES over the updates; `dof` for a filter whose claims are right on average.
    pub mean: f64,
    /// Degrees of freedom of one NEES.
    pub dof: usize,
    /// Share of updates inside the two-sided 95 % band of one NEES.
    pub inside_95: f64,
    /// Updates the figures rest on.
    pub updates: usize,
    /// Updates left out because their covariance is not positive definite or the form not finite.
    pub not_positive_definite: usize,
    /// Share of updates with the truth in the 50 % credible region.
    pub coverage_50: f64,
    /// Share of updates with the truth in the 90 % credible region.
    pub coverage_90: f64,
    /// Share of updates with the truth in the 95 % credible region.
    pub coverage_95: f64,
}

/// Collects the NEES of one run (or of one step over runs).
#[derive(Debug, Clone)]
pub struct NeesAccumulator {
    dof: usize,
    band_95: Band,
    regions: [f64; 3],
    sum: CompensatedSum,
    updates: usize,
    not_positive_definite: usize,
    inside_95: usize,
    covered: [usize; 3],
}

impl NeesAccumulator {
    /// Starts a collection of NEES values of `dof` degrees of freedom.
    ///
    /// # Errors
    /// `dof` is zero.
    pub fn new(dof: usize) -> Result<Self, EvaluationError> {
        let region = |share| chi_square_quantile(dof as f64, share);
        Ok(Self {
            dof,
            band_95: chi_square_band(dof as f64, 0.95)?,
            regions: [region(0.5)?, region(0.9)?, region(0.95)?],
            sum: CompensatedSum::default(),
            updates: 0,
            not_positive_definite: 0,
            inside_95: 0,
            covered: [0; 3],
        })
    }

    /// Takes one NEES; one that is not finite counts as unusable.
    pub fn push(&mut self, value: f64) {
        if !value.is_finite() {
            self.push_unusable();
            return;
        }
        self.updates += 1;
        self.sum.add(value);
        self.inside_95 += usize::from(self.band_95.contains(value));
        for (covered, region) in self.covered.iter_mut().zip(self.regions) {
            *covered += usize::from(value <= region);
        }
    }

    /// Counts an update whose covariance gives no NEES.
    pub fn push_unusable(&mut self) {
        self.not_positive_definite += 1;
    }

    /// Takes the error and covariance of one pose; returns its NEES, `None` where the covariance gives none
    /// (counted). `block` must have the degrees of freedom of the collection.
    ///
    /// # Errors
    /// The block has other degrees of freedom.
    pub fn push_pose(
        &mut self,
        error: &PoseError,
        covariance: &Matrix6<f64>,
        block: ErrorBlock,
    ) -> Result<Option<f64>, EvaluationError> {
        if block.dof() != self.dof {
            let what = "degrees of freedom of the block and of the collection";
            return Err(EvaluationError::ShapeMismatch { what, first: block.dof(), second: self.dof });
        }
        let value = nees(error, covariance, block).ok();
        match value {
            Some(value) => self.push(value),
            None => self.push_unusable(),
        }
        Ok(value)
    }

    /// The figures; `None` where no update gave a NEES and none was unusable. With only unusable updates the
    /// mean and the shares are zero and the count tells why.
    pub fn summary(&self) -> Option<NeesSummary> {
        if self.updates + self.not_positive_definite == 0 {
            return None;
        }
        // Zero updates: the sums are zero as well, and the shares shall be zero, not NaN.
        let n = self.updates.max(1) as f64;
        Some(NeesSummary {
            mean: self.sum.value() / n,
            dof: self.dof,
            inside_95: self.inside_95 as f64 / n,
            updates: self.updates,
            not_positive_definite: self.not_positive_definite,
            coverage_50: self.covered[0] as f64 / n,
            coverage_90: self.covered[1] as f64 / n,
            coverage_95: self.covered[2] as f64 / n,
        })
    }
}

/// The NIS figures of one run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NisSummary {
    /// Sum of NIS over sum of degrees of freedom; 1 for right claims.
    pub mean_per_dof: f64,
    /// 95 % band of that figure.
    pub pooled_band_95_per_dof: Band,
    /// Share of updates inside the two-sided 95 % band of one NIS.
    pub inside_95: f64,
    /// Number of updates.
    pub updates: usize,
    /// Sum of the degrees of freedom.
    pub total_dof: usize,
    /// Innovations left out because their NIS is not finite.
    pub rejected: usize,
}

/// Collects the NIS of one run; updates may have different numbers of readings.
#[derive(Debug, Clone, Default)]
pub struct NisAccumulator {
    bands_95: BTreeMap<usize, Band>,
    sum: CompensatedSum,
    total_dof: usize,
    updates: usize,
    inside_95: usize,
    rejected: usize,
}

impl NisAccumulator {
    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes one NIS of `dof` readings, before the gate; one that is not finite is counted as rejected.
    ///
    /// # Errors
    /// `dof` is zero.
    pub fn push(&mut self, value: f64, dof: usize) -> Result<(), EvaluationError> {
        let band = match self.bands_95.get(&dof) {
            Some(band) => *band,
            None => *self.bands_95.entry(dof).or_insert(chi_square_band(dof as f64, 0.95)?),
        };
        if value.is_finite() {
            self.sum.add(value);
            self.total_dof += dof;
            self.updates += 1;
            self.inside_95 += usize::from(band.contains(value));
        } else {
            self.rejected += 1;
        }
        Ok(())
    }

    /// The figures; `None` without updates.
    pub fn summary(&self) -> Option<NisSummary> {
        let total = self.total_dof as f64;
        // Fails only for zero degrees of freedom, which means no updates.
        let band = chi_square_band(total, 0.95).ok()?;
        Some(NisSummary {
            mean_per_dof: self.sum.value() / total,
            pooled_band_95_per_dof: band.divided_by(total),
            inside_95: self.inside_95 as f64 / self.updates as f64,
            updates: self.updates,
            total_dof: self.total_dof,
            rejected: self.rejected,
        })
    }
}

/// Confidence interval of a share counted in *independent* samples (Wilson 1927), for coverages over runs.
///
/// # Errors
/// `total` is zero or below `inside`, `confidence` not between 0 and 1.
pub fn wilson_interval(inside: usize, total: usize, confidence: f64) -> Result<Band, EvaluationError> {
    proper_share("confidence", confidence)?;
    if total == 0 || inside > total {
        let what = "counted samples and all samples";
        return Err(EvaluationError::ShapeMismatch { what, first: inside, second: total });
    }
    let (n, share) = (total as f64, inside as f64 / total as f64);
    let z = standard_normal_quantile(0.5 + 0.5 * confidence);
    let centre = share + z * z / (2.0 * n);
    let half = z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + z * z / n;
    // At the ends of the scale the interval ends there exactly; rounding must not pass them.
    let lower = if inside == 0 { 0.0 } else { (centre - half) / scale };
    let upper = if inside == total { 1.0 } else { (centre + half) / scale };
    Ok(Band { lower, upper })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consistency::verdict::Verdict;
    use approx::assert_relative_eq;
    use nalgebra::Isometry3;
    use rand::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    fn gaussian_nees(rng: &mut Pcg64Mcg, dof: usize, scale: f64) -> f64 {
        (0..dof)
            .map(|_| {
                let x: f64 = StandardNormal.sample(rng);
                scale * x * x
            })
            .sum()
    }

    /// Bands and regions hold what they promise for Gaussian errors: 20000 draws, limits at 4 standard
    /// errors.
    #[test]
    fn law_gaussian_errors_fill_the_bands() {
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        for dof in [3, 5, 6] {
            let mut collection = NeesAccumulator::new(dof).unwrap();
            (0..20_000).for_each(|_| collection.push(gaussian_nees(&mut rng, dof, 1.0)));
            let summary = collection.summary().unwrap();
            let close = |value: f64, p: f64| (value - p).abs() < 4.0 * (p * (1.0 - p) / 20_000.0).sqrt();
            assert!(close(summary.inside_95, 0.95), "{summary:?}");
            assert!(close(summary.coverage_50, 0.5), "{summary:?}");
            assert!(close(summary.coverage_90, 0.9), "{summary:?}");
            assert!(close(summary.coverage_95, 0.95), "{summary:?}");
            assert!((summary.mean / dof as f64 - 1.0).abs() < 4.0 * (2.0 / (20_000.0 * dof as f64)).sqrt());
            assert_eq!(Verdict::of_run(&summary), Verdict::Consistent);
        }
    }

    /// Noise misstated by 2 either way is seen by the verdicts of one run.
    #[test]
    fn law_misstated_noise_is_named() {
        let mut rng = Pcg64Mcg::seed_from_u64(8);
        for (scale, word) in [(4.0, "overconfident"), (0.24, "cautious")] {
            let (mut nees, mut nis) = (NeesAccumulator::new(3).unwrap(), NisAccumulator::new());
            for _ in 0..2000 {
                nees.push(gaussian_nees(&mut rng, 3, scale));
                nis.push(gaussian_nees(&mut rng, 4, scale), 4).unwrap();
            }
            assert!(Verdict::of_run(&nees.summary().unwrap()).to_string().starts_with(word));
            assert!(Verdict::of_innovations(&nis.summary().unwrap()).to_string().starts_with(word));
        }
    }

    /// White NIS with varying numbers of readings, pooled: 300 runs at a nominal 5 % leave the band 5 % of
    /// the time.
    #[test]
    fn law_pooled_nis_rejects_at_its_level() {
        let mut rng = Pcg64Mcg::seed_from_u64(9);
        let runs = 300;
        let outside = (0..runs)
            .filter(|_| {
                let mut nis = NisAccumulator::new();
                for k in 0..200 {
                    let dof = 1 + k % 5;
                    nis.push(gaussian_nees(&mut rng, dof, 1.0), dof).unwrap();
                }
                !Verdict::of_innovations(&nis.summary().unwrap()).is_consistent()
            })
            .count();
        let expected = wilson_interval(outside, runs, 0.999).unwrap();
        assert!(expected.contains(0.05), "{outside} of {runs}");
    }

    #[test]
    fn closed_form_counts() {
        let mut collection = NeesAccumulator::new(3).unwrap();
        assert_eq!(collection.summary(), None);
        let exact = PoseError::between(&Isometry3::identity(), &Isometry3::identity());
        let singular = Matrix6::zeros();
        assert_eq!(collection.push_pose(&exact, &singular, ErrorBlock::Position), Ok(None));
        assert_eq!(collection.push_pose(&exact, &Matrix6::identity(), ErrorBlock::Position), Ok(Some(0.0)));
        assert!(collection.push_pose(&exact, &Matrix6::identity(), ErrorBlock::FullPose).is_err());
        collection.push(f64::NAN);
        let summary = collection.summary().unwrap();
        assert_eq!((summary.updates, summary.not_positive_definite), (1, 2));
        assert_eq!((summary.mean, summary.coverage_50, summary.inside_95), (0.0, 1.0, 0.0));
        assert!(NeesAccumulator::new(0).is_err());
        let mut nis = NisAccumulator::new();
        assert_eq!(nis.summary(), None);
        assert!(nis.push(1.0, 0).is_err());
        nis.push(f64::INFINITY, 2).unwrap();
        nis.push(3.0, 2).unwrap();
        nis.push(1.0, 2).unwrap();
        let summary = nis.summary().unwrap();
        assert_eq!((summary.updates, summary.total_dof, summary.rejected), (2, 4, 1));
        assert_relative_eq!(summary.mean_per_dof, 1.0);
    }
}
