//! Is one track better than another on the same seeds, by how much, and how sure is that?
//!
//! ```text
//! d_k = figure of the second track at seed k - figure of the first        (positive: the first is better)
//! ```
//!
//! Figures are errors: smaller is better. The mean of `d` with its BCa interval says how much, the
//! signed-rank test how sure; "beats" is said only if the interval leaves zero out *and* p (Holm-corrected in
//! a family) is below [`SIGNIFICANCE`].

use super::bootstrap::{BootstrapSettings, MeanInterval, mean_with_interval};
use super::signed_rank::{SignedRank, holm, signed_rank};
use crate::error::EvaluationError;
use rand::Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Level of the test behind the word "beats".
pub const SIGNIFICANCE: f64 = 0.05;

/// One comparison of two tracks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairedComparison {
    /// Name of the first track.
    pub first: String,
    /// Name of the second track.
    pub second: String,
    /// Mean of second minus first with its interval, in the unit of the figures; positive: the first is
    /// better.
    pub advantage_of_first: MeanInterval,
    /// The test; a positive effect: the first is better.
    pub test: SignedRank,
    /// p-value corrected for the family of comparisons it belongs to; `None` for a single comparison.
    pub p_holm: Option<f64>,
    /// Seeds that only one of the tracks has, left out.
    pub unpaired_seeds: usize,
}

/// Compares two tracks by a figure per seed (an error: smaller is better).
///
/// # Errors
/// Fewer than 2 common seeds, figures that are not finite, bad settings.
pub fn compare_paired<R: Rng + ?Sized>(
    (first, figures_of_first): (&str, &BTreeMap<u64, f64>),
    (second, figures_of_second): (&str, &BTreeMap<u64, f64>),
    settings: &BootstrapSettings,
    rng: &mut R,
) -> Result<PairedComparison, EvaluationError> {
    let differences: Vec<f64> = figures_of_first
        .iter()
        .filter_map(|(seed, figure)| figures_of_second.get(seed).map(|other| other - figure))
        .collect();
    let given = differences.len();
    if given < 2 {
        return Err(EvaluationError::TooFew { what: "paired comparison on common seeds", needed: 2, given });
    }
    Ok(PairedComparison {
        first: first.to_owned(),
        second: second.to_owned(),
        advantage_of_first: mean_with_interval(&differences, settings, rng)?,
        test: signed_rank(&differences)?,
        p_holm: None,
        unpaired_seeds: figures_of_first.len() + figures_of_second.len() - 2 * given,
    })
}

/// Corrects the p-values of comparisons that are made together.
///
/// # Errors
/// None for comparisons made by [`compare_paired`]; p-values that are not finite otherwise.
pub fn correct_family(comparisons: &mut [PairedComparison]) -> Result<(), EvaluationError> {
    let p: Vec<f64> = comparisons.iter().map(|comparison| comparison.test.p_value).collect();
    for (comparison, corrected) in comparisons.iter_mut().zip(holm(&p)?) {
        comparison.p_holm = Some(corrected);
    }
    Ok(())
}

impl PairedComparison {
    /// The p-value that counts: corrected, where the comparison belongs to a family.
    pub fn p_value(&self) -> f64 {
        self.p_holm.unwrap_or(self.test.p_value)
    }

    /// Whether the interval leaves zero out and the test agrees.
    pub fn is_decided(&self) -> bool {
        self.interval_leaves_out_zero() && self.p_value() < SIGNIFICANCE
    }

    /// The finding in one sentence. Figures are multiplied by `factor` and carry `unit`: metres and `(1e3,
    /// "mm")` give "magnetic-eskf beats magnetic by 1.9 mm (95 % CI 1.7 to 2.1, 20 seeds)".
    pub fn sentence(&self, factor: f64, unit: &str) -> String {
        let ahead = self.advantage_of_first.mean >= 0.0;
        let (winner, loser) = if ahead { (&self.first, &self.second) } else { (&self.second, &self.first) };
        let MeanInterval { mean, lower, upper, confidence, count } = self.advantage_of_first;
        let (low, high) = if ahead { (lower, upper) } else { (-upper, -lower) };
        let (mean, low, high) = (mean.abs() * factor, low * factor, high * factor);
        let digits = decimals(0.5 * (high - low));
        let figures = format!(
            "{mean:.digits$} {unit} ({:.0} % CI {low:.digits$} to {high:.digits$}, {count} seeds)",
            100.0 * confidence
        );
        if self.is_decided() {
            format!("{winner} beats {loser} by {figures}")
        } else if self.interval_leaves_out_zero() {
            let p = self.p_value();
            format!(
                "{winner} is ahead of {loser} by {figures}, \
                 which the signed-rank test does not confirm (p = {p:.2})"
            )
        } else {
            format!("no difference shown between {winner} and {loser}: {winner} ahead by {figures}")
        }
    }

    fn interval_leaves_out_zero(&self) -> bool {
        self.advantage_of_first.lower > 0.0 || self.advantage_of_first.upper < 0.0
    }
}

/// Decimals that show one digit of half the interval's width: what the data can tell, no more.
fn decimals(half_width: f64) -> usize {
    if half_width > 0.0 && half_width.is_finite() {
        (-half_width.log10().floor()).clamp(0.0, 6.0) as usize
    } else {
        3
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    fn figures(values: &[f64]) -> BTreeMap<u64, f64> {
        (1..).zip(values.iter().copied()).collect()
    }

    /// Errors of two tracks over seeds: a large scatter common to both, a small one of their own.
    fn tracks(seeds: u64, advantage_m: f64) -> (BTreeMap<u64, f64>, BTreeMap<u64, f64>) {
        let mut rng = Pcg64Mcg::seed_from_u64(11);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut first, mut second) = (BTreeMap::new(), BTreeMap::new());
        for seed in 1..=seeds {
            let common = 0.02 + 0.005 * draw();
            first.insert(seed, common + 0.0003 * draw());
            second.insert(seed, common + advantage_m + 0.0003 * draw());
        }
        (first, second)
    }

    fn compare(first: &BTreeMap<u64, f64>, second: &BTreeMap<u64, f64>) -> PairedComparison {
        let mut rng = Pcg64Mcg::seed_from_u64(12);
        let settings = BootstrapSettings::default();
        compare_paired(("magnetic-eskf", first), ("magnetic", second), &settings, &mut rng).unwrap()
    }

    /// Pairing finds 1.9 mm under a scatter of 5 mm between seeds, and says so.
    #[test]
    fn closed_form_known_advantage_is_found() {
        let (first, second) = tracks(20, 0.0019);
        let comparison = compare(&first, &second);
        let found = comparison.advantage_of_first;
        assert!((found.mean - 0.0019).abs() < 4.0 * 0.0003 * (2.0_f64 / 20.0).sqrt(), "{found:?}");
        assert!(found.lower > 0.0015 && found.upper < 0.0023, "{found:?}");
        assert_eq!(comparison.test.effect, 1.0);
        let sentence = comparison.sentence(1e3, "mm");
        assert!(sentence.starts_with("magnetic-eskf beats magnetic by 1.9 mm (95 % CI 1."), "{sentence}");
        assert!(sentence.ends_with(", 20 seeds)"), "{sentence}");
        // The other way round the sentence is the same but for the last digits of the interval.
        let mirrored = compare(&second, &first);
        assert!(mirrored.advantage_of_first.mean < 0.0);
        let sentence = mirrored.sentence(1e3, "mm");
        assert!(sentence.starts_with("magnetic beats magnetic-eskf by 1.9 mm (95 % CI 1."), "{sentence}");
    }

    #[test]
    fn closed_form_words_for_the_undecided() {
        let (first, second) = tracks(20, 0.0);
        let sentence = compare(&first, &second).sentence(1e3, "mm");
        assert!(sentence.starts_with("no difference shown between "), "{sentence}");
        // Five seeds can never reach 5 % in the signed-rank test.
        let (first, second) = tracks(5, 0.0019);
        let sentence = compare(&first, &second).sentence(1e3, "mm");
        assert!(sentence.contains(" is ahead of ") && sentence.ends_with("(p = 0.06)"), "{sentence}");
        let same = figures(&[0.001, 0.002]);
        let sentence = compare(&same, &same).sentence(1e3, "mm");
        assert!(sentence.ends_with("by 0.000 mm (95 % CI 0.000 to 0.000, 2 seeds)"), "{sentence}");
    }

    #[test]
    fn closed_form_only_common_seeds_count() {
        let (first, mut second) = tracks(20, 0.0019);
        second.remove(&3);
        second.insert(77, 1.0);
        let comparison = compare(&first, &second);
        assert_eq!((comparison.advantage_of_first.count, comparison.unpaired_seeds), (19, 2));
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let alone = figures(&[0.1]);
        let refused = compare_paired(("a", &alone), ("b", &second), &BootstrapSettings::default(), &mut rng);
        assert!(matches!(refused, Err(EvaluationError::TooFew { given: 1, .. })));
    }

    /// A finding that stands alone may fall in a family of many.
    #[test]
    fn law_family_correction_can_undecide() {
        let (first, second) = tracks(6, 0.0019);
        let alone = compare(&first, &second);
        assert!(alone.is_decided());
        let mut family = vec![alone; 3];
        correct_family(&mut family).unwrap();
        assert!(family.iter().all(|comparison| !comparison.is_decided()));
        assert!((family[0].p_value() - 3.0 * 0.03125).abs() < 1e-15);
    }
}
