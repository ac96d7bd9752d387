//! The proper test of NEES: its mean over independent runs at each step.
//!
//! ```text
//! mean_k = (1/N) sum_runs NEES_k,    N mean_k ~ chi2(N dof)
//! ```
//!
//! Runs are independent, so at one step the band is exact for a linear-Gaussian filter whose truth is drawn
//! from its own model. Steps are not independent of each other; therefore the share of steps in the band is
//! judged with slack ([`super::verdict::CONSISTENT_SHARE_OF_STEPS`]), not by a further test.
//!
//! Beside it the coverage of credible regions over all runs and steps: `share of NEES <= chi2_p(dof)`, nominally p.

use crate::chi_square::{Band, chi_square_quantile, mean_chi_square_band};
use crate::error::EvaluationError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How the mean NEES over runs lies to its band.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AcrossRunsSummary {
    /// Degrees of freedom of one NEES.
    pub dof: usize,
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
    /// Ends of the 50, 90 and 95 % regions, and how many updates lie inside each.
    regions: [f64; 3],
    covered: [usize; 3],
}

#[derive(Debug, Clone, Copy, Default)]
struct Step {
    sum: f64,
    count: usize,
}

impl NeesAcrossRuns {
    /// Starts a collection of NEES values of `dof` degrees of freedom.
    ///
    /// # Errors
    /// `dof` is zero.
    pub fn new(dof: usize) -> Result<Self, EvaluationError> {
        let region = |share| chi_square_quantile(dof as f64, share);
        let regions = [region(0.5)?, region(0.9)?, region(0.95)?];
        Ok(Self { dof, runs: 0, steps: BTreeMap::new(), regions, covered: [0; 3] })
    }

    /// Degrees of freedom of one NEES.
    pub fn dof(&self) -> usize {
        self.dof
    }

    /// Takes the steps of one run with their NEES; a value that is not finite stands for a step without estimate, runs may
    /// differ in length. Runs must come in the order of their trials, so that sums do not depend on threads.
    pub fn push_run(&mut self, steps: impl IntoIterator<Item = (i64, f64)>) {
        self.runs += 1;
        for (at, value) in steps {
            let step = self.steps.entry(at).or_default();
            if value.is_finite() {
                step.sum += value;
                step.count += 1;
                for (covered, region) in self.covered.iter_mut().zip(self.regions) {
                    *covered += usize::from(value <= region);
                }
            }
        }
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
        let mut known = BTreeMap::new();
        let mut bands = Vec::with_capacity(self.steps.len());
        for step in self.steps.values() {
            if step.count > 0 && !known.contains_key(&step.count) {
                known.insert(step.count, mean_chi_square_band(self.dof, step.count, 0.95)?);
            }
            bands.push(known.get(&step.count).copied());
        }
        Ok(bands)
    }

    /// Share of the steps whose mean NEES per degree of freedom lies in `band` (the nonlinear matched case is
    /// judged by 0.85 to 1.25); `None` without steps.
    pub fn share_of_steps_within(&self, band: Band) -> Option<f64> {
        let means: Vec<f64> = self.means().into_iter().flatten().collect();
        let inside = means.iter().filter(|&&mean| band.contains(mean / self.dof as f64)).count();
        (!means.is_empty()).then(|| inside as f64 / means.len() as f64)
    }

    /// The figures against the 95 % band.
    ///
    /// # Errors
    /// No step has an estimate; `dof` is zero.
    pub fn summary(&self) -> Result<AcrossRunsSummary, EvaluationError> {
        let bands = self.bands_95()?;
        let (mut steps, mut above, mut below, mut sum, mut count) = (0, 0, 0, 0.0, 0);
        for ((step, mean), band) in self.steps.values().zip(self.means()).zip(bands) {
            let (Some(mean), Some(band)) = (mean, band) else { continue };
            steps += 1;
            above += usize::from(mean > band.upper);
            below += usize::from(mean < band.lower);
            sum += step.sum;
            count += step.count;
        }
        if steps == 0 {
            return Err(EvaluationError::TooFew { what: "NEES across runs", needed: 1, given: 0 });
        }
        let share = |number: usize| number as f64 / steps as f64;
        Ok(AcrossRunsSummary {
            dof: self.dof,
            runs: self.runs,
            steps,
            mean_per_dof: sum / (count as f64 * self.dof as f64),
            share_inside_95: share(steps - above - below),
            share_above_95: share(above),
            share_below_95: share(below),
            coverage_50: self.covered[0] as f64 / count as f64,
            coverage_90: self.covered[1] as f64 / count as f64,
            coverage_95: self.covered[2] as f64 / count as f64,
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
        // Regions of 2 dof end at -2 ln(1 - p): 1.39, 4.61, 5.99.
        assert_eq!(
            (summary.coverage_50, summary.coverage_90, summary.coverage_95),
            (0.0, 2.0 / 3.0, 2.0 / 3.0)
        );
        assert!(NeesAcrossRuns::new(0).is_err());
        assert_eq!(runs.share_of_steps_within(Band { lower: 0.85, upper: 1.6 }), Some(0.5));
    }
}
