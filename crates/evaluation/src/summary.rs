//! Mean, RMSE, median, 95th percentile and maximum of a series that arrives one value at a time.
//!
//! ```text
//! mean = sum(x) / n          rmse = sqrt(sum(x^2) / n)
//! quantile(p) = x[k] + (h - k) (x[k+1] - x[k]),   h = (n - 1) p,  k = floor(h),  x sorted, indices from 0
//! ```
//!
//! The quantile rule is the linear one, NumPy's default (type 7 of Hyndman and Fan 1996). Quantiles are
//! exact, not sketched, because the p95 of a rare fault is what a study is about: every value is kept, 8
//! bytes each (an hour at 100 Hz is 2.9 MB; [`crate::bounded`] has the same figures in bounded memory). Sums are
//! compensated (Neumaier 1974), so the figures of a million values are good to the last digits.
//!
//! Values whose square is not finite (NaN, infinite, beyond 1e154) do not enter the figures; they are counted
//! (`rejected`), so nothing is lost silently.

use serde::{Deserialize, Serialize};

/// The figures of one scalar error, in the unit of what was pushed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScalarSummary {
    /// Arithmetic mean.
    pub mean: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// 50 % quantile.
    pub median: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// Largest value.
    pub max: f64,
}

impl ScalarSummary {
    /// The same figures in another unit: each multiplied by a positive `factor` (1e3 makes millimetres of
    /// metres).
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            mean: self.mean * factor,
            rmse: self.rmse * factor,
            median: self.median * factor,
            p95: self.p95 * factor,
            max: self.max * factor,
        }
    }
}

/// A sum that carries what rounding cut off (Neumaier 1974).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct CompensatedSum {
    sum: f64,
    carry: f64,
}

impl CompensatedSum {
    pub(crate) fn add(&mut self, value: f64) {
        let total = self.sum + value;
        self.carry += if self.sum.abs() >= value.abs() {
            (self.sum - total) + value
        } else {
            (value - total) + self.sum
        };
        self.sum = total;
    }

    pub(crate) fn value(&self) -> f64 {
        self.sum + self.carry
    }
}

/// Count, mean and root mean square of what arrives one value at a time.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    sum: CompensatedSum,
    sum_of_squares: CompensatedSum,
    pub(crate) count: usize,
    pub(crate) rejected: usize,
}

impl Moments {
    /// Whether the value enters the figures; one whose square is not finite is counted as rejected.
    pub(crate) fn take(&mut self, value: f64) -> bool {
        let enters = (value * value).is_finite();
        if enters {
            self.count += 1;
            self.sum.add(value);
            self.sum_of_squares.add(value * value);
        } else {
            self.rejected += 1;
        }
        enters
    }

    pub(crate) fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum.value() / self.count as f64)
    }

    pub(crate) fn rmse(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum_of_squares.value() / self.count as f64).sqrt())
    }
}

/// Values of a block: a growing vector would hold up to twice what it needs.
const BLOCK: usize = 4096;

/// Collects one scalar error over a run; see the module for the rules.
#[derive(Debug, Clone, Default)]
pub struct Quantiles {
    /// In ascending order; what has come since the last question waits in the blocks.
    sorted: Vec<f64>,
    blocks: Vec<Vec<f64>>,
    moments: Moments,
}

impl Quantiles {
    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes one value; one whose square is not finite is counted as rejected.
    pub fn push(&mut self, value: f64) {
        if !self.moments.take(value) {
            return;
        }
        if self.blocks.last().is_none_or(|block| block.len() == BLOCK) {
            self.blocks.push(Vec::with_capacity(BLOCK));
        }
        // There is a last block now.
        if let Some(block) = self.blocks.last_mut() {
            block.push(value);
        }
    }

    /// How many values the figures rest on.
    pub fn count(&self) -> usize {
        self.moments.count
    }

    /// How many values were rejected as not finite.
    pub fn rejected(&self) -> usize {
        self.moments.rejected
    }

    /// Arithmetic mean; `None` without values.
    pub fn mean(&self) -> Option<f64> {
        self.moments.mean()
    }

    /// Root of the mean square; `None` without values.
    pub fn rmse(&self) -> Option<f64> {
        self.moments.rmse()
    }

    /// The quantile of probability `p`, 0 to 1 (outside of it: clamped); `None` without values.
    pub fn quantile(&mut self, p: f64) -> Option<f64> {
        self.sort();
        quantile_of_sorted(&self.sorted, p)
    }

    /// The five figures; `None` without values.
    pub fn summary(&mut self) -> Option<ScalarSummary> {
        Some(ScalarSummary {
            mean: self.mean()?,
            rmse: self.rmse()?,
            median: self.quantile(0.5)?,
            p95: self.quantile(0.95)?,
            max: self.quantile(1.0)?,
        })
    }

    /// Share of the values that are at most `threshold`, 0 to 1; `None` without values.
    pub fn share_within(&mut self, threshold: f64) -> Option<f64> {
        self.sort();
        let within = self.sorted.partition_point(|value| *value <= threshold);
        (!self.sorted.is_empty()).then(|| within as f64 / self.sorted.len() as f64)
    }

    /// The cumulative distribution at `points` equal steps of probability from 0 to 1, as `(value,
    /// probability)`: the line of a CDF plot. Empty without values or with fewer than 2 points.
    pub fn cumulative_distribution(&mut self, points: usize) -> Vec<(f64, f64)> {
        if points < 2 {
            return Vec::new();
        }
        self.sort();
        (0..points)
            .filter_map(|i| {
                let p = i as f64 / (points - 1) as f64;
                quantile_of_sorted(&self.sorted, p).map(|value| (value, p))
            })
            .collect()
    }

    /// Part of the sum that the largest `part` of the values make, the last one in part; `None` where that is less than one value, or the sum
    /// is not above 0.
    pub fn share_of_largest(&mut self, part: f64) -> Option<f64> {
        self.sort();
        let wanted = part.clamp(0.0, 1.0) * self.sorted.len() as f64;
        let all = self.mean()? * self.count() as f64;
        if wanted < 1.0 || all <= 0.0 {
            return None;
        }
        let mut sum = CompensatedSum::default();
        for (k, value) in self.sorted.iter().rev().enumerate().take_while(|(k, _)| (*k as f64) < wanted) {
            sum.add(value * (wanted - k as f64).min(1.0));
        }
        Some(sum.value() / all)
    }

    fn sort(&mut self) {
        if !self.blocks.is_empty() {
            self.sorted.reserve_exact(self.count() - self.sorted.len());
            for block in std::mem::take(&mut self.blocks) {
                self.sorted.extend(block);
            }
            self.sorted.sort_unstable_by(f64::total_cmp);
        }
    }
}

impl Extend<f64> for Quantiles {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        values.into_iter().for_each(|value| self.push(value));
    }
}

impl FromIterator<f64> for Quantiles {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut quantiles = Self::new();
        quantiles.extend(values);
        quantiles
    }
}

/// The quantile of probability `p` (clamped to 0..1) of values in ascending order; `None` without values.
pub fn quantile_of_sorted(sorted: &[f64], p: f64) -> Option<f64> {
    let (below, above, part) = ranks(sorted.len(), p)?;
    Some(between(sorted[below], sorted[above], part))
}

/// The two ranks between which the quantile of probability `p` (clamped to 0..1) of `count` values lies, and how far along.
pub(crate) fn ranks(count: usize, p: f64) -> Option<(usize, usize, f64)> {
    let last = count.checked_sub(1)?;
    let position = last as f64 * p.clamp(0.0, 1.0);
    let below = position.floor() as usize;
    Some((below, (below + 1).min(last), position - below as f64))
}

/// From the nearer end, so that the result is exact at both ends and never leaves the interval.
pub(crate) fn between(below: f64, above: f64, part: f64) -> f64 {
    let step = above - below;
    if part < 0.5 { below + step * part } else { above - step * (1.0 - part) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    #[test]
    fn closed_form_one_to_one_hundred() {
        let mut quantiles: Quantiles = (1..=100).rev().map(f64::from).collect();
        let summary = quantiles.summary().unwrap();
        assert_relative_eq!(summary.mean, 50.5, max_relative = 1e-15);
        // sum k^2 = n (n + 1) (2 n + 1) / 6
        assert_relative_eq!(summary.rmse, (101.0 * 201.0 / 6.0_f64).sqrt(), max_relative = 1e-15);
        assert_relative_eq!(summary.median, 50.5, max_relative = 1e-15);
        assert_relative_eq!(summary.p95, 95.05, max_relative = 1e-14);
        assert_eq!(summary.max, 100.0);
        assert_eq!(quantiles.share_within(20.0), Some(0.2));
        assert_eq!(quantiles.cumulative_distribution(3), vec![(1.0, 0.0), (50.5, 0.5), (100.0, 1.0)]);
    }

    #[test]
    fn closed_form_the_largest_twentieth() {
        // 95 times 0.1 and five times 10.
        let mut quantiles: Quantiles = (0..100).map(|k| if k % 20 == 7 { 10.0 } else { 0.1 }).collect();
        assert_relative_eq!(quantiles.share_of_largest(0.05).unwrap(), 50.0 / 59.5, max_relative = 1e-12);
        // Two and a half of the hundred.
        assert_relative_eq!(quantiles.share_of_largest(0.025).unwrap(), 25.0 / 59.5, max_relative = 1e-12);
        assert_eq!(quantiles.share_of_largest(0.009), None);
        assert_eq!([0.0, 0.0].into_iter().collect::<Quantiles>().share_of_largest(0.5), None);
    }

    #[test]
    fn closed_form_empty_and_single() {
        let mut quantiles = Quantiles::new();
        assert_eq!(quantiles.summary(), None);
        assert_eq!(quantiles.share_within(1.0), None);
        quantiles.push(f64::NAN);
        quantiles.push(f64::INFINITY);
        assert_eq!((quantiles.count(), quantiles.rejected()), (0, 2));
        quantiles.push(2.0);
        let expected = ScalarSummary { mean: 2.0, rmse: 2.0, median: 2.0, p95: 2.0, max: 2.0 };
        assert_eq!(quantiles.summary(), Some(expected));
        assert_eq!(expected.scaled(1e3).p95, 2000.0);
    }

    #[test]
    fn closed_form_values_pushed_after_a_quantile_count() {
        let mut quantiles: Quantiles = [3.0, 1.0].into_iter().collect();
        assert_eq!(quantiles.quantile(0.5), Some(2.0));
        quantiles.push(0.0);
        assert_eq!(quantiles.quantile(0.5), Some(1.0));
    }

    #[test]
    fn closed_form_compensated_sum_keeps_small_terms() {
        // 1 + 1e6 times 1e-16: a plain sum stays at 1.
        let mut sum = CompensatedSum::default();
        sum.add(1.0);
        (0..1_000_000).for_each(|_| sum.add(1e-16));
        assert_relative_eq!(sum.value(), 1.0 + 1e-10, max_relative = 1e-15);
    }

    #[test]
    fn closed_form_json_has_the_five_keys() {
        let summary = ScalarSummary { mean: 1.0, rmse: 2.0, median: 3.0, p95: 4.0, max: 5.0 };
        let text = serde_json::to_string(&summary).unwrap();
        assert_eq!(text, r#"{"mean":1.0,"rmse":2.0,"median":3.0,"p95":4.0,"max":5.0}"#);
    }

    proptest! {
        #[test]
        fn law_figures_are_ordered(values in proptest::collection::vec(0.0..1e3_f64, 1..200)) {
            let summary = values.iter().copied().collect::<Quantiles>().summary().unwrap();
            prop_assert!(summary.median <= summary.p95 && summary.p95 <= summary.max);
            let slack = 1.0 + 1e-12;
            prop_assert!(summary.mean <= summary.rmse * slack && summary.rmse <= summary.max * slack);
        }
    }
}
