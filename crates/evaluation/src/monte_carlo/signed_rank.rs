//! Wilcoxon's signed-rank test of paired differences, its effect size, and Holm's correction of several
//! tests.
//!
//! ```text
//! ranks of |d_i| (equal ones share the mean rank; zeros are dropped),  W+ = sum of ranks with d > 0,  W- likewise
//! T = min(W+, W-),   effect = (W+ - W-) / (W+ + W-)        (rank-biserial correlation, -1 to 1)
//! exact:   p = min(1, 2 P(T' <= T)),  T' the sum of a random half of the ranks 1..n
//! normal:  z = (T - n(n+1)/4) / sqrt( (n(n+1)(2n+1) - sum(t^3 - t)/2) / 24 ),  p = 2 Phi(-|z|),  t sizes of ties
//! ```
//!
//! Exact up to [`EXACT_UP_TO`] differences without ties and zeros, else the normal approximation with
//! correction for ties and without correction for continuity (as SciPy's `wilcoxon`). With 5 differences the
//! smallest possible p is 0.0625: fewer than 6 seeds can never reach 5 %.

use crate::chi_square::standard_normal_probability;
use crate::error::{EvaluationError, all_finite};
use serde::{Deserialize, Serialize};

/// Most differences for which the distribution is counted out; 2^50 sign patterns are still exact in a f64.
pub const EXACT_UP_TO: usize = 50;

/// How the p-value was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SignedRankMethod {
    /// By counting all sign patterns.
    Exact,
    /// By the normal approximation.
    Normal,
}

/// Result of the signed-rank test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SignedRank {
    /// min(W+, W-).
    pub statistic: f64,
    /// Two-sided p-value.
    pub p_value: f64,
    /// Rank-biserial correlation: 1 if all differences are positive, -1 if all are negative.
    pub effect: f64,
    /// Differences that are not zero.
    pub count: usize,
    /// How the p-value was found.
    pub method: SignedRankMethod,
}

/// The two-sided test that differences lie symmetrically about zero.
///
/// Without any difference that is not zero, p is 1 and the effect 0.
///
/// # Errors
/// Differences that are not finite.
pub fn signed_rank(differences: &[f64]) -> Result<SignedRank, EvaluationError> {
    all_finite("differences of a signed-rank test", differences)?;
    let mut used: Vec<f64> = differences.iter().copied().filter(|&d| d != 0.0).collect();
    used.sort_unstable_by(|a, b| a.abs().total_cmp(&b.abs()));
    let n = used.len();
    let (mut plus, mut minus, mut ties) = (0.0, 0.0, 0.0);
    let mut start = 0;
    for group in used.chunk_by(|a, b| a.abs() == b.abs()) {
        let size = group.len() as f64;
        let rank = start as f64 + 0.5 * (size + 1.0);
        let positive = group.iter().filter(|&&d| d > 0.0).count() as f64;
        plus += rank * positive;
        minus += rank * (size - positive);
        ties += size * size * size - size;
        start += group.len();
    }
    let exact = n == differences.len() && ties == 0.0 && n <= EXACT_UP_TO;
    let statistic: f64 = f64::min(plus, minus);
    let p_value = match n {
        0 => 1.0,
        _ if exact => exact_p(n, statistic as usize),
        _ => normal_p(n as f64, statistic, ties),
    };
    let effect = if n == 0 { 0.0 } else { (plus - minus) / (plus + minus) };
    let method = if exact { SignedRankMethod::Exact } else { SignedRankMethod::Normal };
    Ok(SignedRank { statistic, p_value, effect, count: n, method })
}

/// Holm's step-down correction (1979): p-values of a family, in the order given, such that comparing each
/// with alpha keeps the probability of any false finding below alpha.
///
/// # Errors
/// p-values that are not finite.
pub fn holm(p_values: &[f64]) -> Result<Vec<f64>, EvaluationError> {
    all_finite("p-values", p_values)?;
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut adjusted = vec![0.0; p_values.len()];
    let mut largest: f64 = 0.0;
    for (place, &index) in order.iter().enumerate() {
        let family_left = (p_values.len() - place) as f64;
        largest = largest.max((p_values[index] * family_left).min(1.0));
        adjusted[index] = largest;
    }
    Ok(adjusted)
}

/// Number of sign patterns of the ranks 1..n by their sum, built up rank by rank.
fn exact_p(n: usize, statistic: usize) -> f64 {
    let total = n * (n + 1) / 2;
    let mut patterns = vec![0.0; total + 1];
    patterns[0] = 1.0;
    for rank in 1..=n {
        for sum in (rank..=total).rev() {
            patterns[sum] += patterns[sum - rank];
        }
    }
    let at_most: f64 = patterns[..=statistic.min(total)].iter().sum();
    (2.0 * at_most / 2.0_f64.powi(n as i32)).min(1.0)
}

fn normal_p(n: f64, statistic: f64, ties: f64) -> f64 {
    let mean = n * (n + 1.0) / 4.0;
    let variance = (n * (n + 1.0) * (2.0 * n + 1.0) - 0.5 * ties) / 24.0;
    // The variance is at least that of n differences all tied, n (n + 1)^2 / 16 > 0.
    (2.0 * standard_normal_probability(-((statistic - mean) / variance.sqrt()).abs())).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn closed_form_all_positive() {
        for n in [1, 5, 10] {
            let differences: Vec<f64> = (1..=n).map(f64::from).collect();
            let test = signed_rank(&differences).unwrap();
            assert_eq!((test.statistic, test.effect, test.method), (0.0, 1.0, SignedRankMethod::Exact));
            assert_relative_eq!(test.p_value, 2.0 * 0.5_f64.powi(n), max_relative = 1e-15);
        }
    }

    #[test]
    fn closed_form_nothing_differs() {
        let test = signed_rank(&[0.0; 4]).unwrap();
        assert_eq!((test.p_value, test.effect, test.count), (1.0, 0.0, 0));
        assert_eq!(signed_rank(&[]).unwrap().p_value, 1.0);
        assert!(signed_rank(&[f64::NAN]).is_err());
    }

    /// The variance under ties against the sum of squared mid-ranks over 4, its definition.
    #[test]
    fn cross_tie_correction_equals_sum_of_squared_ranks() {
        // Ranks of |d|: 1.5 1.5 3 5 5 5 7.
        let ranks: [f64; 7] = [1.5, 1.5, 3.0, 5.0, 5.0, 5.0, 7.0];
        let variance = ranks.iter().map(|r| r * r).sum::<f64>() / 4.0;
        let test = signed_rank(&[1.0, -1.0, 2.0, 3.0, 3.0, -3.0, 4.0]).unwrap();
        assert_eq!((test.statistic, test.method), (6.5, SignedRankMethod::Normal));
        let expected = 2.0 * standard_normal_probability((6.5 - 14.0) / variance.sqrt());
        assert_relative_eq!(test.p_value, expected, max_relative = 1e-12);
    }

    #[test]
    fn law_sign_flip_turns_the_effect_only() {
        let differences = [0.3, -1.2, 2.2, 0.7, 1.9, -0.1];
        let flipped: Vec<f64> = differences.iter().map(|d| -d).collect();
        let (one, other) = (signed_rank(&differences).unwrap(), signed_rank(&flipped).unwrap());
        assert_eq!((one.p_value, one.statistic, one.effect), (other.p_value, other.statistic, -other.effect));
    }
}
