//! Bootstrap intervals, bias-corrected and accelerated (BCa; Efron 1987).
//!
//! ```text
//! z0 = Phi^-1( share of resampled statistics below the sample's; ties count half )
//! a  = sum U^3 / (6 (sum U^2)^{3/2}),   U_i = mean of the leave-one-out statistics - the i-th of them
//! p(z) = Phi( z0 + (z0 + z) / (1 - a (z0 + z)) ),   interval = quantiles p(z_{alpha/2}), p(z_{1-alpha/2})
//! ```
//!
//! Quantiles of the resampled statistics by the linear rule of [`crate::summary`]. With fewer than about ten
//! values every bootstrap interval is somewhat too narrow.

use crate::chi_square::{Band, standard_normal_probability, standard_normal_quantile};
use crate::error::{EvaluationError, all_finite, proper_share};
use crate::summary::quantile_of_sorted;
use rand::{Rng, RngExt as _};
use serde::{Deserialize, Serialize};

/// Resamples taken where nothing else is asked for: the ends of a 95 % interval then wander by 1 to 2 % of
/// its width.
pub const DEFAULT_RESAMPLES: usize = 9_999;

/// How an interval is made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BootstrapSettings {
    /// Probability that the interval holds the true value, 0 to 1.
    pub confidence: f64,
    /// Number of resamples.
    pub resamples: usize,
}

impl Default for BootstrapSettings {
    fn default() -> Self {
        Self { confidence: 0.95, resamples: DEFAULT_RESAMPLES }
    }
}

/// A mean over trials with its interval, in the unit of the values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeanInterval {
    /// Arithmetic mean.
    pub mean: f64,
    /// Lower end of the interval.
    pub lower: f64,
    /// Upper end of the interval.
    pub upper: f64,
    /// Confidence of the interval.
    pub confidence: f64,
    /// Number of values.
    pub count: usize,
}

/// The mean of values with its BCa interval.
///
/// # Errors
/// As [`bca_interval`].
pub fn mean_with_interval<R: Rng + ?Sized>(
    values: &[f64],
    settings: &BootstrapSettings,
    rng: &mut R,
) -> Result<MeanInterval, EvaluationError> {
    let Band { lower, upper } = bca_interval(values, mean_of, settings, rng)?;
    Ok(MeanInterval {
        mean: mean_of(values),
        lower,
        upper,
        confidence: settings.confidence,
        count: values.len(),
    })
}

/// The BCa interval of any statistic of a sample of independent values (the order of values must not matter
/// to it).
///
/// Values that all give the same statistic (all equal, say) give an interval of no width.
///
/// # Errors
/// Fewer than 2 values, values or statistics that are not finite, a confidence outside of (0, 1), no
/// resamples.
pub fn bca_interval<R: Rng + ?Sized>(
    values: &[f64],
    statistic: impl Fn(&[f64]) -> f64,
    settings: &BootstrapSettings,
    rng: &mut R,
) -> Result<Band, EvaluationError> {
    check(values, settings)?;
    let of_sample = statistic(values);
    let resampled = resampled_statistics(values, &statistic, settings.resamples, rng);
    all_finite("statistic of the sample", &[of_sample])?;
    all_finite("resampled statistics", &resampled)?;
    if resampled[0] == resampled[resampled.len() - 1] {
        return Ok(Band { lower: resampled[0], upper: resampled[0] });
    }
    let bias = bias_correction(&resampled, of_sample);
    let acceleration = acceleration(values, &statistic)?;
    let end = |z: f64| {
        let shifted = bias + z;
        let p = standard_normal_probability(bias + shifted / (1.0 - acceleration * shifted));
        // There is at least one resample, so there is a quantile.
        quantile_of_sorted(&resampled, p).unwrap_or(of_sample)
    };
    let z = standard_normal_quantile(0.5 + 0.5 * settings.confidence);
    Ok(Band { lower: end(-z), upper: end(z) })
}

fn check(values: &[f64], settings: &BootstrapSettings) -> Result<(), EvaluationError> {
    proper_share("confidence", settings.confidence)?;
    if settings.resamples == 0 {
        return Err(EvaluationError::OutOfRange { what: "resamples", allowed: "one or more", value: 0.0 });
    }
    if values.len() < 2 {
        return Err(EvaluationError::TooFew { what: "bootstrap interval", needed: 2, given: values.len() });
    }
    all_finite("values of a bootstrap", values)
}

/// Ascending.
fn resampled_statistics<R: Rng + ?Sized>(
    values: &[f64],
    statistic: &impl Fn(&[f64]) -> f64,
    resamples: usize,
    rng: &mut R,
) -> Vec<f64> {
    // Drawn as u32: the stream of a usize depends on the width of the machine's word.
    let count = u32::try_from(values.len()).unwrap_or(u32::MAX);
    let mut sample = vec![0.0; values.len()];
    let mut statistics: Vec<f64> = (0..resamples)
        .map(|_| {
            for value in &mut sample {
                *value = values[rng.random_range(0..count) as usize];
            }
            statistic(&sample)
        })
        .collect();
    statistics.sort_unstable_by(f64::total_cmp);
    statistics
}

fn bias_correction(sorted: &[f64], of_sample: f64) -> f64 {
    let below = sorted.partition_point(|&s| s < of_sample);
    let within = sorted.partition_point(|&s| s <= of_sample);
    let n = sorted.len() as f64;
    // All resamples on one side would shift infinitely far; half a resample is what n of them can resolve.
    let share = ((below + within) as f64 / (2.0 * n)).clamp(0.5 / n, 1.0 - 0.5 / n);
    standard_normal_quantile(share)
}

fn acceleration(values: &[f64], statistic: &impl Fn(&[f64]) -> f64) -> Result<f64, EvaluationError> {
    let left_out: Vec<f64> = (0..values.len())
        .map(|i| {
            let others: Vec<f64> = values[..i].iter().chain(&values[i + 1..]).copied().collect();
            statistic(&others)
        })
        .collect();
    all_finite("leave-one-out statistics", &left_out)?;
    let mean = mean_of(&left_out);
    let (mut squares, mut cubes) = (0.0, 0.0);
    for value in left_out {
        let influence = mean - value;
        squares += influence * influence;
        cubes += influence * influence * influence;
    }
    // No influence of any value: nothing to accelerate.
    Ok(if squares > 0.0 { cubes / (6.0 * squares.powf(1.5)) } else { 0.0 })
}

fn mean_of(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_distr::{Distribution as _, Exp1};
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn closed_form_equal_values_have_no_width() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let interval = mean_with_interval(&[0.25; 6], &BootstrapSettings::default(), &mut rng).unwrap();
        assert_eq!((interval.mean, interval.lower, interval.upper, interval.count), (0.25, 0.25, 0.25, 6));
    }

    #[test]
    fn closed_form_refusals() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let settings = BootstrapSettings::default();
        assert!(mean_with_interval(&[1.0], &settings, &mut rng).is_err());
        assert!(mean_with_interval(&[1.0, f64::NAN], &settings, &mut rng).is_err());
        let none = BootstrapSettings { resamples: 0, ..settings };
        assert!(mean_with_interval(&[1.0, 2.0], &none, &mut rng).is_err());
        let sure = BootstrapSettings { confidence: 1.0, ..settings };
        assert!(mean_with_interval(&[1.0, 2.0], &sure, &mut rng).is_err());
    }

    #[test]
    fn law_same_generator_same_interval() {
        let values = [1.0, 3.0, 2.0, 8.0, 5.0];
        let interval = || {
            let mut rng = Pcg64Mcg::seed_from_u64(42);
            mean_with_interval(&values, &BootstrapSettings::default(), &mut rng).unwrap()
        };
        assert_eq!(interval(), interval());
    }

    /// Over many samples of a skewed distribution the 90 % interval holds the true mean about 90 % of the
    /// time.
    #[test]
    fn law_interval_covers_the_mean_of_a_skewed_distribution() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let settings = BootstrapSettings { confidence: 0.9, resamples: 1000 };
        let trials = 400;
        let covered = (0..trials)
            .filter(|_| {
                let values: Vec<f64> = (0..40).map(|_| Exp1.sample(&mut rng)).collect();
                let interval = mean_with_interval(&values, &settings, &mut rng).unwrap();
                interval.lower <= 1.0 && 1.0 <= interval.upper
            })
            .count();
        // Standard error 1.5 %; the BCa interval of 40 exponential values covers about 88 %.
        let share = covered as f64 / f64::from(trials);
        assert!((0.83..=0.95).contains(&share), "{share}");
    }
}
