//! The modified Thompson tau test: how far from the mean the furthest of n values may lie.
//!
//! `τ(n) = t (n-1) / (√n √(n - 2 + t²))`, t the two-sided Student quantile at α = 0.05 with n - 2 degrees of freedom
//! (than2015, section 3.4.2). A quantile costs microseconds, so each n is computed once and kept.

use statrs::distribution::{ContinuousCDF as _, StudentsT};

/// Probability that the furthest of n good values is thrown out.
const ALPHA: f64 = 0.05;
/// Beyond this count τ differs from its limit by less than 1e-4 between neighbours: it is computed for multiples of this.
const COARSE: usize = 4096;

/// τ of a sample of `n`; infinite for fewer than three values, of which none can be called far.
pub fn tau(n: usize) -> f64 {
    if n < 3 {
        return f64::INFINITY;
    }
    let Ok(student) = StudentsT::new(0.0, 1.0, (n - 2) as f64) else { return f64::INFINITY };
    let t = student.inverse_cdf(1.0 - 0.5 * ALPHA);
    let n = n as f64;
    t * (n - 1.0) / (n.sqrt() * (n - 2.0 + t * t).sqrt())
}

/// τ by n, filled as it is asked for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    known: Vec<f64>,
}

impl Table {
    pub(crate) fn tau(&mut self, n: usize) -> f64 {
        let n = if n > COARSE { n / COARSE * COARSE } else { n };
        if self.known.len() <= n {
            self.known.resize(n + 1, f64::NAN);
        }
        if self.known[n].is_nan() {
            self.known[n] = tau(n);
        }
        self.known[n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// than2015, section 3.4.2.
    #[test]
    fn published_values_of_tau() {
        assert!((tau(200) - 1.9530).abs() < 5e-5, "{}", tau(200));
        assert!((tau(500) - 1.9572).abs() < 5e-5, "{}", tau(500));
        assert_eq!(tau(2), f64::INFINITY);
        assert_eq!(Table::default().tau(200), tau(200));
    }
}
