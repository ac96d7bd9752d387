//! The figures of [`crate::summary`] in memory that does not grow with the run.
//!
//! Up to [`EXACT_VALUES`] different values are counted each, so the figures of a short run and those of a quantity with few
//! values (a latency) are exact and follow the linear rule of [`crate::summary`]. Beyond that the counts move into a DDSketch
//! (Masson, Rim and Lee, "DDSketch: a fast and fully-mergeable quantile sketch with relative-error guarantees", VLDB 2019): a
//! quantile is then within [`RELATIVE_ACCURACY`] of the value of its rank `floor((n - 1) p)`, whatever the distribution. Mean,
//! RMSE and maximum stay exact in any case.

use crate::summary::{Moments, ScalarSummary, between, ranks};
use sketches_ddsketch::{Config, DDSketch};
use std::collections::BTreeMap;

/// So many different values are counted each: 3.4 minutes at 20 Hz, in about 0.1 MB.
pub const EXACT_VALUES: usize = 4096;

/// Relative accuracy of a quantile beyond that: half a thousandth, below what a figure of three digits shows.
pub const RELATIVE_ACCURACY: f64 = 5e-4;

/// Bins of 0.1 % each, 8 bytes: half a megabyte at most, for 28 decades; errors between 1e-6 and 1e2 take a third of that.
const MOST_BINS: u32 = 1 << 16;

/// Smaller values count as zero: it is below the rounding of any error in any unit that is printed.
const SMALLEST: f64 = 1e-15;

/// Collects one scalar error over a run of any length; see the module for the rules.
#[derive(Clone, Default)]
pub struct BoundedQuantiles {
    values: Values,
    moments: Moments,
}

#[derive(Clone)]
enum Values {
    /// How often each value came, by its place in the order of numbers.
    Counted(BTreeMap<i64, u64>),
    Sketched(Box<DDSketch>),
}

impl Default for Values {
    fn default() -> Self {
        Self::Counted(BTreeMap::new())
    }
}

/// Place of a number in the order of all numbers: the map of [`f64::total_cmp`], which is its own inverse.
fn place(bits: i64) -> i64 {
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

fn place_of(value: f64) -> i64 {
    place(value.to_bits() as i64)
}

fn value_at(at: i64) -> f64 {
    f64::from_bits(place(at) as u64)
}

impl BoundedQuantiles {
    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes one value; one whose square is not finite is counted as rejected.
    pub fn push(&mut self, value: f64) {
        if !self.moments.take(value) {
            return;
        }
        match &mut self.values {
            Values::Counted(counts) => {
                *counts.entry(place_of(value)).or_default() += 1;
                if counts.len() > EXACT_VALUES {
                    let mut sketch = DDSketch::new(Config::new(RELATIVE_ACCURACY, MOST_BINS, SMALLEST));
                    counts.iter().for_each(|(at, count)| sketch.add_with_count(value_at(*at), *count));
                    self.values = Values::Sketched(Box::new(sketch));
                }
            }
            Values::Sketched(sketch) => sketch.add(value),
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

    /// The quantile of probability `p`, 0 to 1 (outside of it: clamped); `None` without values.
    pub fn quantile(&self, p: f64) -> Option<f64> {
        let (below, above, part) = ranks(self.count(), p)?;
        match &self.values {
            Values::Counted(counts) => {
                let at_rank = |rank: usize| {
                    let mut before = 0;
                    let mut reached = counts.iter().skip_while(|(_, count)| {
                        before += **count;
                        before <= rank as u64
                    });
                    reached.next().map(|(at, _)| value_at(*at))
                };
                Some(between(at_rank(below)?, at_rank(above)?, part))
            }
            Values::Sketched(sketch) => {
                let found = sketch.quantile(p.clamp(0.0, 1.0)).ok()??;
                // The middle of the last bin may lie beyond the largest value.
                Some(found.clamp(sketch.min()?, sketch.max()?))
            }
        }
    }

    /// The five figures; `None` without values.
    pub fn summary(&self) -> Option<ScalarSummary> {
        Some(ScalarSummary {
            mean: self.mean()?,
            rmse: self.moments.rmse()?,
            median: self.quantile(0.5)?,
            p95: self.quantile(0.95)?,
            max: self.quantile(1.0)?,
        })
    }
}

impl std::fmt::Debug for BoundedQuantiles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BoundedQuantiles").field("moments", &self.moments).finish_non_exhaustive()
    }
}

impl Extend<f64> for BoundedQuantiles {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        values.into_iter().for_each(|value| self.push(value));
    }
}

impl FromIterator<f64> for BoundedQuantiles {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut quantiles = Self::new();
        quantiles.extend(values);
        quantiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::summary::Quantiles;
    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand_distr::{Distribution as _, LogNormal};
    use rand_pcg::Pcg64Mcg;

    /// Errors as a filter makes them: five decades, a long tail.
    fn errors(count: usize) -> Vec<f64> {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let errors = LogNormal::new(-1.0, 1.5).unwrap();
        (0..count).map(|_| errors.sample(&mut rng)).collect()
    }

    #[test]
    fn cross_few_values_give_what_all_values_give() {
        let few: Vec<f64> = errors(EXACT_VALUES);
        let mut all: Quantiles = few.iter().copied().collect();
        let bounded: BoundedQuantiles = few.iter().copied().collect();
        assert_eq!(bounded.summary(), all.summary());
        // A latency: any number of times the same few values.
        let latencies = (0..100_000).map(|i| f64::from(20 + 10 * (i % 3)));
        let mut all: Quantiles = latencies.clone().collect();
        let bounded: BoundedQuantiles = latencies.collect();
        assert_eq!(bounded.summary(), all.summary());
        assert_eq!(bounded.summary().unwrap().median, 30.0);
    }

    #[test]
    fn law_many_values_give_quantiles_within_the_accuracy_in_bounded_memory() {
        let many = errors(200_000);
        let bounded: BoundedQuantiles = many.iter().copied().collect();
        let mut sorted = many.clone();
        sorted.sort_by(f64::total_cmp);
        for p in [0.001, 0.05, 0.5, 0.9, 0.95, 0.999, 0.99999] {
            let exact = sorted[(p * (sorted.len() - 1) as f64) as usize];
            let off = bounded.quantile(p).unwrap() / exact - 1.0;
            // A rounding in the logarithm may put a value into the next bin.
            assert!(off.abs() <= RELATIVE_ACCURACY * (1.0 + 1e-9), "{p}: {off}");
        }
        let (mut all, figures): (Quantiles, _) = (many.iter().copied().collect(), bounded.summary().unwrap());
        let exact = all.summary().unwrap();
        assert_eq!((figures.mean, figures.rmse, figures.max), (exact.mean, exact.rmse, exact.max));
        assert_eq!((bounded.count(), bounded.quantile(0.0)), (200_000, Some(sorted[0])));
        let Values::Sketched(sketch) = &bounded.values else { panic!("every value is kept") };
        assert!(sketch.length() < 20_000, "{} bins", sketch.length());
    }

    #[test]
    fn closed_form_signs_zeros_and_what_is_no_number() {
        let mut bounded = BoundedQuantiles::new();
        assert_eq!((bounded.summary(), bounded.quantile(0.5)), (None, None));
        bounded.extend([f64::NAN, f64::INFINITY, -3.0, 0.0, 1.0]);
        assert_eq!((bounded.count(), bounded.rejected()), (3, 2));
        assert_eq!([0.0, 0.25, 0.5, 1.0].map(|p| bounded.quantile(p).unwrap()), [-3.0, -1.5, 0.0, 1.0]);
        // The same beyond the limit: -5000 to 5000.
        let many: BoundedQuantiles = (-5000..=5000).map(f64::from).collect();
        assert!(matches!(many.values, Values::Sketched(_)));
        assert_eq!([0.0, 0.5, 1.0].map(|p| many.quantile(p).unwrap()), [-5000.0, 0.0, 5000.0]);
        assert!((many.quantile(0.25).unwrap() / -2500.0 - 1.0).abs() <= RELATIVE_ACCURACY);
        // All but one of one value: the figures cannot leave the values.
        let same: BoundedQuantiles = (0..10_000).map(|i| 7.0 + 1e-9 * f64::from(i)).collect();
        assert!((0..=20).all(|i| (7.0..7.000_01).contains(&same.quantile(0.05 * f64::from(i)).unwrap())));
    }

    proptest! {
        #[test]
        fn cross_any_few_values_give_what_all_values_give(
            values in proptest::collection::vec(prop_oneof![-1e3..1e3_f64, Just(0.0), Just(-0.0), Just(5.0)], 1..100),
            p in 0.0..1.0_f64,
        ) {
            let mut all: Quantiles = values.iter().copied().collect();
            let bounded: BoundedQuantiles = values.into_iter().collect();
            prop_assert_eq!(bounded.summary(), all.summary());
            prop_assert_eq!(bounded.quantile(p), all.quantile(p));
        }
    }
}
