//! The proper test of NEES: its mean over independent runs at each step.
//!
//! ```text
//! mean_k = (1/N) sum_runs NEES_k,    N mean_k ~ chi2(N dof)
//! ```
//!
//! Where runs differ in their degrees of freedom at a step (one knows its roll, another does not), `N dof` is their sum.
//!
//! Runs are independent, so at one step the band is exact for a linear-Gaussian filter whose truth is drawn
//! from its own model. Steps are not independent of each other; therefore the share of steps in the band is
//! judged with slack ([`super::verdict::CONSISTENT_SHARE_OF_STEPS`]), not by a further test.
//!
//! Beside it the coverage of credible regions over all runs and steps: `share of NEES <= chi2_p(dof)`, nominally p.

use crate::chi_square::{Band, chi_square_band, chi_square_quantile};
use crate::error::EvaluationError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How the mean NEES over runs lies to its band.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AcrossRunsSummary {
    /// Mean degrees of freedom of one NEES.
    pub dof: f64,
    /// Number of runs.
    pub runs: usize,
    /// Steps at which any run gave a NEES.
    pub steps: usize,
    /// Mean over all runs and steps, per degree of freedom (a figure, no test).
    pub mean_per_dof: f64,
    /// Share of steps inside the 95 % band.
    pub share_inside_95: f64,
    /// Share of steps above it.
    pub share_above_95: f64,
    /// Share of steps below it.
    pub share_below_95: f64,
    /// Updates whose covariance gave no NEES: they are in no band and in no region.
    pub unusable: usize,
    /// Share of all updates with the truth in the 50 % credible region.
    pub coverage_50: f64,
    /// Share of all updates with the truth in the 90 % credible region.
    pub coverage_90: f64,
    /// Share of all updates with the truth in the 95 % credible region.
    pub coverage_95: f64,
}

/// Collects NEES per step over runs; memory is that of one run.
///
/// A step is any whole number that means the same in every run: an index, or a time in nanoseconds.
#[derive(Debug, Clone)]
pub struct NeesAcrossRuns {
    dof: usize,
    runs: usize,
    steps: BTreeMap<i64, Step>,
    /// Ends of the 50, 90 and 95 % regions by degrees of freedom.
    regions: BTreeMap<usize, [f64; 3]>,
    /// How many updates lie inside each.
    covered: [usize; 3],
    unusable: usize,
}

#[derive(Debug, Clone, Copy, Default)]
struct Step {
    sum: f64,
    count: usize,
    total_dof: usize,
}

impl Step {
    /// The band of the mean.
    fn band_95(&self) -> Result<Band, EvaluationError> {
        Ok(chi_square_band(self.total_dof as f64, 0.95)?.divided_by(self.count as f64))
    }
}

impl NeesAcrossRuns {
    /// Starts a collection of NEES values, of `dof` degrees of freedom where nothing else is said.
    ///
    /// # Errors
    /// `dof` is zero.
    pub fn new(dof: usize) -> Result<Self, EvaluationError> {
        let mut collection = Self {
            dof,
            runs: 0,
            steps: BTreeMap::new(),
            regions: BTreeMap::new(),
            covered: [0; 3],
            unusable: 0,
        };
        collection.regions_of(dof)?;
        Ok(collection)
    }

    fn regions_of(&mut self, dof: usize) -> Result<[f64; 3], EvaluationError> {
        if let Some(known) = self.regions.get(&dof) {
            return Ok(*known);
        }
        let region = |share| chi_square_quantile(dof as f64, share);
        let regions = [region(0.5)?, region(0.9)?, region(0.95)?];
        self.regions.insert(dof, regions);
        Ok(regions)
    }

    /// Takes the steps of one run with their NEES; a value that is not finite stands for a covariance that gave none: it is
    /// counted as unusable and covers nothing. Runs may differ in length. Runs must come in the order of their trials, so that sums do not depend on threads.
    pub fn push_run(&mut self, steps: impl IntoIterator<Item = (i64, f64)>) {
        let dof = self.dof;
        // Fails only for zero degrees of freedom, which `new` has refused.
        let _ = self.push_run_of(steps.into_iter().map(|(at, value)| (at, dof, value)));
    }

    /// As [`Self::push_run`], where each step has degrees of freedom of its own: step, degrees of freedom, NEES.
    ///
    /// # Errors
    /// Zero degrees of freedom.
    pub fn push_run_of(
        &mut self,
        steps: impl IntoIterator<Item = (i64, usize, f64)>,
    ) -> Result<(), EvaluationError> {
        self.runs += 1;
        for (at, dof, value) in steps {
            let regions = self.regions_of(dof)?;
            let step = self.steps.entry(at).or_default();
            if value.is_finite() {
                step.sum += value;
                step.count += 1;
                step.total_dof += dof;
                for (covered, region) in self.covered.iter_mut().zip(regions) {
                    *covered += usize::from(value <= region);
                }
            } else {
                self.unusable += 1;
            }
        }
        Ok(())
    }

    /// Mean NEES over the runs at each step; `None` at steps without estimate.
    pub fn means(&self) -> Vec<Option<f64>> {
        self.steps.values().map(|step| (step.count > 0).then(|| step.sum / step.count as f64)).collect()
    }

    /// The 95 % band of the mean NEES at each step, for a plot; `None` at steps without estimate.
    ///
    /// # Errors
    /// `dof` is zero.
    pub fn bands_95(&self) -> Result<Vec<Option<Band>>, EvaluationError> {
        self.steps.values().map(|step| (step.count > 0).then(|| step.band_95()).transpose()).collect()
    }

    /// Share of the steps whose mean NEES per degree of freedom lies in `band` (the nonlinear matched case is
    /// judged by 0.85 to 1.25); `None` without steps.
    pub fn share_of_steps_within(&self, band: Band) -> Option<f64> {
        let judged = || self.steps.values().filter(|step| step.count > 0);
        let inside = judged().filter(|step| band.contains(step.sum / step.total_dof as f64)).count();
        let steps = judged().count();
        (steps > 0).then(|| inside as f64 / steps as f64)
    }

    /// The figures against the 95 % band.
    ///
    /// # Errors
    /// No step has an estimate; `dof` is zero.
    pub fn summary(&self) -> Result<AcrossRunsSummary, EvaluationError> {
        let bands = self.bands_95()?;
        let (mut steps, mut above, mut below, mut sum, mut count, mut total_dof) = (0, 0, 0, 0.0, 0, 0);
        for ((step, mean), band) in self.steps.values().zip(self.means()).zip(bands) {
            let (Some(mean), Some(band)) = (mean, band) else { continue };
            steps += 1;
            above += usize::from(mean > band.upper);
            below += usize::from(mean < band.lower);
            sum += step.sum;
            count += step.count;
            total_dof += step.total_dof;
        }
        if steps == 0 {
            return Err(EvaluationError::TooFew { what: "NEES across runs", needed: 1, given: 0 });
        }
        let share = |number: usize| number as f64 / steps as f64;
        Ok(AcrossRunsSummary {
            dof: total_dof as f64 / count as f64,
            runs: self.runs,
            steps,
            mean_per_dof: sum / total_dof as f64,
            share_inside_95: share(steps - above - below),
            share_above_95: share(above),
            share_below_95: share(below),
            unusable: self.unusable,
            coverage_50: self.covered[0] as f64 / (count + self.unusable) as f64,
            coverage_90: self.covered[1] as f64 / (count + self.unusable) as f64,
            coverage_95: self.covered[2] as f64 / (count + self.unusable) as f64,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn closed_form_gaps_and_lengths() {
        let mut runs = NeesAcrossRuns::new(2).unwrap();
        assert!(runs.summary().is_err());
        runs.push_run([(10, 2.0), (20, f64::NAN), (30, 40.0)]);
        runs.push_run([(10, 4.0)]);
        assert_eq!(runs.means(), vec![Some(3.0), None, Some(40.0)]);
        let bands = runs.bands_95().unwrap();
        assert!(bands[1].is_none());
        // One value of 2 dof: quantiles -2 ln(1 - p).
        assert_relative_eq!(bands[2].unwrap().upper, -2.0 * 0.025_f64.ln(), max_relative = 1e-9);
        let summary = runs.summary().unwrap();
        assert_eq!((summary.runs, summary.steps), (2, 2));
        assert_eq!(
            (summary.share_inside_95, summary.share_above_95, summary.share_below_95),
            (0.5, 0.5, 0.0)
        );
        assert_relative_eq!(summary.mean_per_dof, 46.0 / 6.0);
        // Regions of 2 dof end at -2 ln(1 - p): 1.39, 4.61, 5.99; the unusable one is in none.
        assert_eq!((summary.coverage_50, summary.coverage_90, summary.coverage_95), (0.0, 0.5, 0.5));
        assert_eq!(summary.unusable, 1);
        assert!(NeesAcrossRuns::new(0).is_err());
        assert_eq!(runs.share_of_steps_within(Band { lower: 0.85, upper: 1.6 }), Some(0.5));
    }

    #[test]
    fn closed_form_steps_of_mixed_degrees_of_freedom() {
        let mut runs = NeesAcrossRuns::new(5).unwrap();
        runs.push_run_of([(1, 5, 4.0), (2, 6, 9.0)]).unwrap();
        runs.push_run_of([(1, 6, 8.0), (2, 6, 3.0)]).unwrap();
        let summary = runs.summary().unwrap();
        assert_relative_eq!(summary.dof, 23.0 / 4.0);
        assert_relative_eq!(summary.mean_per_dof, 24.0 / 23.0);
        // The sum at step 1 has 11 degrees of freedom.
        let band = runs.bands_95().unwrap()[0].unwrap();
        assert_relative_eq!(
            band.upper * 2.0,
            chi_square_quantile(11.0, 0.975).unwrap(),
            max_relative = 1e-12
        );
        assert!(runs.push_run_of([(1, 0, 1.0)]).is_err());
    }
}
