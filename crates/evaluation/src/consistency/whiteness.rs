//! Are innovations free of the past? The test of Ljung and Box 1978, one value at a time.
//!
//! ```text
//! r_k = sum_{t>k} (x_t - m)(x_{t-k} - m) / sum_t (x_t - m)^2
//! Q   = n (n + 2) sum_{k=1..K} r_k^2 / (n - k)  ~  chi2(K)  for white x
//! ```
//!
//! The sums over lagged products are kept for values shifted by the first one and put right for the mean at
//! the end, so memory is 2 K numbers however long the run. Vector innovations are made uncorrelated by the
//! Cholesky factor of their covariance, tested component by component, and the smallest p is corrected by
//! Holm's rule.
//!
//! The order of values counts, their times do not: test one sensor of constant rate at a time.
//!
//! A coloured innovation says what a NEES of 1 can hide: a bias that drifts, a delay, a motion model that
//! lags.

use super::whitened;
use crate::chi_square::chi_square_tail;
use crate::error::EvaluationError;
use crate::monte_carlo::signed_rank::holm;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Result of a test of whiteness.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LjungBoxResult {
    /// The statistic Q.
    pub statistic: f64,
    /// Lags tested, the degrees of freedom.
    pub lags: usize,
    /// Length of the series.
    pub count: usize,
    /// Probability of a larger Q from a white series.
    pub p_value: f64,
}

/// Collects a series for the test.
#[derive(Debug, Clone)]
pub struct LjungBox {
    lags: usize,
    count: usize,
    shift: f64,
    sum: f64,
    sum_of_squares: f64,
    products: Vec<f64>,
    first: Vec<f64>,
    last: VecDeque<f64>,
}

impl LjungBox {
    /// Starts a test of the lags 1 to `lags`.
    ///
    /// # Errors
    /// `lags` is zero.
    pub fn new(lags: usize) -> Result<Self, EvaluationError> {
        if lags == 0 {
            return Err(EvaluationError::OutOfRange { what: "lags", allowed: "one or more", value: 0.0 });
        }
        Ok(Self {
            lags,
            count: 0,
            shift: 0.0,
            sum: 0.0,
            sum_of_squares: 0.0,
            products: vec![0.0; lags],
            first: Vec::with_capacity(lags),
            last: VecDeque::with_capacity(lags + 1),
        })
    }

    /// Takes the next value.
    ///
    /// # Errors
    /// It is not finite.
    pub fn push(&mut self, value: f64) -> Result<(), EvaluationError> {
        if !value.is_finite() {
            return Err(EvaluationError::NotFinite { what: "series of a whiteness test", index: self.count });
        }
        if self.count == 0 {
            self.shift = value;
        }
        let x = value - self.shift;
        self.count += 1;
        self.sum += x;
        self.sum_of_squares += x * x;
        for (product, past) in self.products.iter_mut().zip(&self.last) {
            *product += x * past;
        }
        if self.first.len() < self.lags {
            self.first.push(x);
        }
        self.last.push_front(x);
        self.last.truncate(self.lags);
        Ok(())
    }

    /// The test.
    ///
    /// # Errors
    /// No more values than lags, or all values equal.
    pub fn result(&self) -> Result<LjungBoxResult, EvaluationError> {
        let needed = self.lags + 2;
        if self.count < needed {
            return Err(EvaluationError::TooFew { what: "whiteness test", needed, given: self.count });
        }
        let n = self.count as f64;
        let mean = self.sum / n;
        let variance = self.sum_of_squares - n * mean * mean;
        if variance <= 0.0 {
            let what = "sum of squares of a whiteness test";
            return Err(EvaluationError::OutOfRange { what, allowed: "positive", value: variance });
        }
        let (mut head, mut tail, mut weighted) = (0.0, 0.0, 0.0);
        for k in 1..=self.lags {
            // Values without partner at this lag: the first k have none before, the last k none after them.
            head += self.first[k - 1];
            tail += self.last[k - 1];
            let left = n - k as f64;
            let lagged = self.products[k - 1] - mean * (2.0 * self.sum - head - tail) + left * mean * mean;
            let correlation = lagged / variance;
            weighted += correlation * correlation / left;
        }
        let statistic = n * (n + 2.0) * weighted;
        let p_value = chi_square_tail(self.lags as f64, statistic)?;
        Ok(LjungBoxResult { statistic, lags: self.lags, count: self.count, p_value })
    }
}

/// Collects vector innovations with their covariances.
#[derive(Debug, Clone)]
pub struct InnovationWhiteness {
    lags: usize,
    components: Vec<LjungBox>,
}

impl InnovationWhiteness {
    /// Starts a test of the lags 1 to `lags`.
    pub fn new(lags: usize) -> Self {
        Self { lags, components: Vec::new() }
    }

    /// Takes one innovation (n) and its covariance (n x n); n must stay the same over the run.
    ///
    /// # Errors
    /// The covariance is not positive definite, the length changes, a value is not finite, or `lags` is zero.
    pub fn push(
        &mut self,
        innovation: &DVector<f64>,
        covariance: &DMatrix<f64>,
    ) -> Result<(), EvaluationError> {
        let white = whitened(innovation, covariance)?;
        if self.components.is_empty() {
            self.components = vec![LjungBox::new(self.lags)?; white.len()];
        }
        let (first, second) = (self.components.len(), white.len());
        if first != second {
            return Err(EvaluationError::ShapeMismatch { what: "lengths of innovations", first, second });
        }
        if let Some(index) = white.iter().position(|value| !value.is_finite()) {
            return Err(EvaluationError::NotFinite { what: "innovation", index });
        }
        self.components.iter_mut().zip(&white).try_for_each(|(component, value)| component.push(*value))
    }

    /// The test of each component.
    ///
    /// # Errors
    /// As [`LjungBox::result`].
    pub fn components(&self) -> Result<Vec<LjungBoxResult>, EvaluationError> {
        self.components.iter().map(LjungBox::result).collect()
    }

    /// Smallest p over the components, corrected for their number; white at level alpha if it is not below
    /// alpha.
    ///
    /// # Errors
    /// As [`LjungBox::result`]; no innovations.
    pub fn p_value(&self) -> Result<f64, EvaluationError> {
        let p: Vec<f64> = self.components()?.iter().map(|result| result.p_value).collect();
        let too_few = EvaluationError::TooFew { what: "whiteness test", needed: self.lags + 2, given: 0 };
        holm(&p)?.into_iter().min_by(f64::total_cmp).ok_or(too_few)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use rand::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    /// Alternating +1, -1: r_1 = -(n - 1) / n, so Q = (n + 2)(n - 1) / n.
    #[test]
    fn closed_form_alternating_series() {
        let mut test = LjungBox::new(1).unwrap();
        for i in 0..100 {
            test.push(if i % 2 == 0 { 1.0 } else { -1.0 }).unwrap();
        }
        assert_relative_eq!(test.result().unwrap().statistic, 102.0 * 99.0 / 100.0, max_relative = 1e-12);
    }

    #[test]
    fn closed_form_refusals() {
        assert!(LjungBox::new(0).is_err());
        let mut test = LjungBox::new(2).unwrap();
        assert!(test.push(f64::NAN).is_err());
        (0..3).for_each(|_| test.push(1.0).unwrap());
        assert!(matches!(test.result(), Err(EvaluationError::TooFew { needed: 4, given: 3, .. })));
        test.push(1.0).unwrap();
        assert!(matches!(test.result(), Err(EvaluationError::OutOfRange { .. })));
        let mut vector = InnovationWhiteness::new(2);
        assert!(vector.p_value().is_err());
        vector.push(&DVector::zeros(2), &DMatrix::identity(2, 2)).unwrap();
        assert!(vector.push(&DVector::zeros(3), &DMatrix::identity(3, 3)).is_err());
    }

    /// A large constant does not matter (the shift), and neither does the scale.
    #[test]
    fn law_shift_and_scale_are_irrelevant() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let (mut plain, mut moved) = (LjungBox::new(5).unwrap(), LjungBox::new(5).unwrap());
        for _ in 0..300 {
            let x: f64 = StandardNormal.sample(&mut rng);
            plain.push(x).unwrap();
            moved.push(1e6 + 10.0 * x).unwrap();
        }
        let (plain, moved) = (plain.result().unwrap(), moved.result().unwrap());
        assert_relative_eq!(plain.statistic, moved.statistic, max_relative = 1e-6);
    }

    /// Correlated components with white time pass; a drifting bias fails.
    #[test]
    fn law_white_vectors_pass_and_coloured_fail() {
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        let factor = DMatrix::from_row_slice(2, 2, &[1e-3, 0.0, 0.8e-3, 0.2e-3]);
        let covariance = &factor * factor.transpose();
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut white, mut coloured, mut bias) =
            (InnovationWhiteness::new(10), InnovationWhiteness::new(10), 0.0);
        for _ in 0..1000 {
            let innovation = &factor * DVector::from_vec(vec![draw(), draw()]);
            white.push(&innovation, &covariance).unwrap();
            bias = 0.95 * bias + 0.1 * draw();
            coloured.push(&(innovation + DVector::from_vec(vec![0.0, bias * 1e-3])), &covariance).unwrap();
        }
        assert!(white.p_value().unwrap() > 0.01, "{:?}", white.components());
        assert!(coloured.p_value().unwrap() < 1e-6, "{:?}", coloured.components());
    }
}
