//! How near an estimator comes to the best that its measurements allow.
//!
//! ```text
//! rmse / rms bound  = sqrt( sum e^2 / sum tr B )        both over the same updates
//! rms of ratios     = sqrt( mean( e^2 / tr B ) )        every update counts alike
//! ```
//!
//! `e` is the norm of the error (m, or rad) and `B` the Cramér-Rao bound of its covariance at that update
//! (m^2, or rad^2): in lumenav that of the update's own measurement alone, at the true pose. 1 is efficient; 1.5
//! leaves a third of the accuracy unused. The first figure is the spec's RMSE over bound, which the worst places dominate; the
//! second does not let one place with a poor bound hide the rest.
//!
//! A filter with a motion model remembers earlier measurements, which this bound does not: it may well lie below 1,
//! and its figures say how much the memory brings, not how efficient the filter is (that would take the
//! posterior bound). A track without memory that lies below 1 over many updates knew something that the bound did
//! not (a map, or truth that leaked), or is biased towards a prior: the bound holds for unbiased estimators.

use crate::summary::CompensatedSum;
use serde::{Deserialize, Serialize};

/// Efficiency of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Efficiency {
    /// Updates with an error and a bound.
    pub updates: usize,
    /// Updates left out: no finite error, or a bound that is not positive and finite (unobservable).
    pub rejected: usize,
    /// RMSE over the root mean trace of the bound; 1 is efficient.
    pub rmse_over_bound: f64,
    /// Root mean of e^2 / tr B; 1 is efficient.
    pub rms_of_ratios: f64,
}

/// Collects errors and bounds as a run goes.
#[derive(Debug, Clone, Default)]
pub struct EfficiencyAccumulator {
    updates: usize,
    rejected: usize,
    squared_errors: CompensatedSum,
    traces: CompensatedSum,
    squared_ratios: CompensatedSum,
}

impl EfficiencyAccumulator {
    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the norm of the error of one update and the trace of its bound, in the same unit and its square.
    pub fn push(&mut self, error: f64, bound_trace: f64) {
        let (squared, ratio) = (error * error, error * error / bound_trace);
        let usable = squared.is_finite() && bound_trace > 0.0 && bound_trace.is_finite() && ratio.is_finite();
        if !usable {
            self.rejected += 1;
            return;
        }
        self.updates += 1;
        self.squared_errors.add(squared);
        self.traces.add(bound_trace);
        self.squared_ratios.add(ratio);
    }

    /// The figures; `None` without usable updates.
    pub fn efficiency(&self) -> Option<Efficiency> {
        (self.updates > 0).then(|| Efficiency {
            updates: self.updates,
            rejected: self.rejected,
            rmse_over_bound: (self.squared_errors.value() / self.traces.value()).sqrt(),
            rms_of_ratios: (self.squared_ratios.value() / self.updates as f64).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use rand::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn closed_form_two_updates() {
        let mut efficiency = EfficiencyAccumulator::new();
        assert_eq!(efficiency.efficiency(), None);
        efficiency.push(0.002, 1e-6);
        efficiency.push(0.004, 16e-6);
        efficiency.push(0.001, 0.0);
        efficiency.push(0.001, f64::INFINITY);
        efficiency.push(f64::NAN, 1e-6);
        let result = efficiency.efficiency().unwrap();
        assert_eq!((result.updates, result.rejected), (2, 3));
        assert_relative_eq!(result.rmse_over_bound, (20.0_f64 / 17.0).sqrt(), max_relative = 1e-14);
        assert_relative_eq!(result.rms_of_ratios, 2.5_f64.sqrt(), max_relative = 1e-14);
    }

    /// The mean of n readings meets its bound sigma^2 / n; the median of n Gaussian readings needs pi / 2 of
    /// it.
    #[test]
    fn law_mean_is_efficient_and_median_is_not() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let (mut mean, mut median) = (EfficiencyAccumulator::new(), EfficiencyAccumulator::new());
        let n = 101;
        for _ in 0..8000 {
            let mut x: Vec<f64> = (0..n).map(|_| StandardNormal.sample(&mut rng)).collect();
            mean.push(x.iter().sum::<f64>() / n as f64, 1.0 / n as f64);
            x.sort_unstable_by(f64::total_cmp);
            median.push(x[n / 2], 1.0 / n as f64);
        }
        // Relative standard error of an rms of 8000 values is 0.8 %.
        assert_relative_eq!(mean.efficiency().unwrap().rms_of_ratios, 1.0, epsilon = 0.03);
        let expected = std::f64::consts::FRAC_PI_2.sqrt();
        assert_relative_eq!(median.efficiency().unwrap().rmse_over_bound, expected, epsilon = 0.04);
    }
}
