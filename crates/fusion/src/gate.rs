//! Chi-square gate: quantiles by degrees of freedom, computed once each.

use statrs::distribution::{ChiSquared, ContinuousCDF as _};
use std::collections::BTreeMap;

/// Thresholds of one probability.
#[derive(Clone, Debug)]
pub struct Gate {
    probability: f64,
    /// By twice the degrees of freedom, so that halves (weighted counts) have a place too.
    thresholds: BTreeMap<u64, f64>,
}

impl Gate {
    /// A gate that accepts a consistent measurement with this probability (between 0 and 1, ends excluded).
    pub fn new(probability: f64) -> Self {
        Self { probability, thresholds: BTreeMap::new() }
    }

    /// The quantile for `degrees_of_freedom` (rounded to the next half, at least one half).
    pub fn threshold(&mut self, degrees_of_freedom: f64) -> f64 {
        let key = ((2.0 * degrees_of_freedom).round() as u64).max(1);
        let probability = self.probability;
        *self.thresholds.entry(key).or_insert_with(|| {
            // The degrees of freedom are positive by the line above; should the library still refuse, nothing is gated.
            ChiSquared::new(key as f64 / 2.0).map_or(f64::INFINITY, |d| d.inverse_cdf(probability))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_chi_square_quantiles() {
        // Abramowitz and Stegun, table 26.8, Q = 0.05 and 0.001.
        let mut gate = Gate::new(0.95);
        for (dof, value) in [(1.0, 3.84146), (3.0, 7.81473), (6.0, 12.5916), (30.0, 43.7730)] {
            assert!((gate.threshold(dof) - value).abs() < 1e-4, "{dof}");
        }
        assert!((Gate::new(0.999).threshold(3.0) - 16.266).abs() < 1e-3);
    }
}
