//! What the figures say about a filter's claims, in words.
//!
//! Rules for one run, where NEES may not be tested (it is correlated in time) and a smooth path under a noisy
//! motion model lies below 1 by nature:
//!
//! - a mean NEES above [`OVERCONFIDENT_NEES_PER_DOF`] per degree of freedom, or a covariance that is not
//!   positive definite, is *overconfident*;
//! - one below [`CAUTIOUS_NEES_PER_DOF`] is *cautious*;
//! - between them it is *consistent*, that is: nothing speaks against it.
//!
//! Across runs and for innovations there are proper tests; their rules stand at the functions.
//!
//! In text a verdict is `consistent`, `overconfident: <reason>` or `cautious: <reason>`; so it stands in
//! `metrics.json`.

use super::across_runs::AcrossRunsSummary;
use super::one_run::{NeesSummary, NisSummary};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Mean NEES per degree of freedom above which one run is overconfident: errors 1.22 times as large as
/// claimed. The project's acceptance limit for deterministic paths.
pub const OVERCONFIDENT_NEES_PER_DOF: f64 = 1.5;

/// Mean NEES per degree of freedom below which one run is cautious: claimed standard deviations more than
/// twice the errors. Looser than its counterpart because a filter must allow for motions that a given path
/// does not make.
pub const CAUTIOUS_NEES_PER_DOF: f64 = 0.25;

/// Share of steps whose mean NEES over runs must lie in the 95 % band. Neighbouring steps share their errors,
/// so in 200 runs a perfect filter has stretches outside; 0.90 is the project's acceptance limit.
pub const CONSISTENT_SHARE_OF_STEPS: f64 = 0.90;

/// A judgement on a filter's claims.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Verdict {
    /// Errors and claims agree.
    Consistent,
    /// Errors are larger than claimed; the reason carries the figure.
    Overconfident(String),
    /// Errors are smaller than claimed; the reason carries the figure.
    Cautious(String),
}

/// A text that is none of the three verdicts.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("not a verdict: {0:?} (consistent, overconfident: <reason>, cautious: <reason>)")]
pub struct NotAVerdict(String);

impl Verdict {
    /// The verdict on one run, by the rules of the module.
    pub fn of_run(nees: &NeesSummary) -> Self {
        if nees.not_positive_definite > 0 {
            let total = nees.updates + nees.not_positive_definite;
            let bad = nees.not_positive_definite;
            return Self::Overconfident(format!("{bad} of {total} covariances are not positive definite"));
        }
        let (mean, dof, per_dof) = (nees.mean, nees.dof, nees.mean / nees.dof as f64);
        let figures = format!("mean NEES {mean:.2} at {dof} degrees of freedom ({per_dof:.2} each");
        let ratio = per_dof.sqrt();
        if per_dof > OVERCONFIDENT_NEES_PER_DOF {
            let limit = OVERCONFIDENT_NEES_PER_DOF;
            return Self::Overconfident(format!(
                "{figures}, limit {limit}): errors {ratio:.2} times the claim"
            ));
        }
        if per_dof < CAUTIOUS_NEES_PER_DOF {
            let limit = CAUTIOUS_NEES_PER_DOF;
            return Self::Cautious(format!("{figures}, limit {limit}): errors {ratio:.2} times the claim"));
        }
        Self::Consistent
    }

    /// The verdict of the innovations of one run: the summed NIS against its 95 % band.
    ///
    /// The test is strict: with many updates a mismatch of a percent shows. Read the figure, not only the
    /// word.
    pub fn of_innovations(nis: &NisSummary) -> Self {
        let (value, band) = (nis.mean_per_dof, nis.pooled_band_95_per_dof);
        let figures = format!(
            "mean NIS {value:.3} per degree of freedom, 95 % band {:.3} to {:.3} over {} updates",
            band.lower, band.upper, nis.updates
        );
        Self::by_band(value < band.lower, value > band.upper, figures)
    }

    /// The verdict over Monte-Carlo runs: at least [`CONSISTENT_SHARE_OF_STEPS`] of the steps inside the
    /// band, else the side on which more steps lie.
    pub fn of_runs(summary: &AcrossRunsSummary) -> Self {
        if summary.share_inside_95 >= CONSISTENT_SHARE_OF_STEPS {
            return Self::Consistent;
        }
        let above = summary.share_above_95 >= summary.share_below_95;
        let (share, side) =
            if above { (summary.share_above_95, "above") } else { (summary.share_below_95, "below") };
        let figures = format!(
            "mean NEES over {} runs lies {side} its 95 % band at {:.0} % of {} steps \
             ({:.2} per degree of freedom)",
            summary.runs,
            100.0 * share,
            summary.steps,
            summary.mean_per_dof
        );
        Self::by_band(!above, above, figures)
    }

    /// Whether the verdict is [`Verdict::Consistent`].
    pub fn is_consistent(&self) -> bool {
        *self == Self::Consistent
    }

    fn by_band(below: bool, above: bool, reason: String) -> Self {
        match (below, above) {
            (true, _) => Self::Cautious(reason),
            (_, true) => Self::Overconfident(reason),
            _ => Self::Consistent,
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Consistent => f.write_str("consistent"),
            Self::Overconfident(reason) => write!(f, "overconfident: {reason}"),
            Self::Cautious(reason) => write!(f, "cautious: {reason}"),
        }
    }
}

impl FromStr for Verdict {
    type Err = NotAVerdict;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "consistent" {
            return Ok(Self::Consistent);
        }
        match text.split_once(": ") {
            Some(("overconfident", reason)) => Ok(Self::Overconfident(reason.to_owned())),
            Some(("cautious", reason)) => Ok(Self::Cautious(reason.to_owned())),
            _ => Err(NotAVerdict(text.to_owned())),
        }
    }
}

impl From<Verdict> for String {
    fn from(verdict: Verdict) -> Self {
        verdict.to_string()
    }
}

impl TryFrom<String> for Verdict {
    type Error = NotAVerdict;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(mean: f64) -> NeesSummary {
        NeesSummary {
            mean,
            dof: 3,
            inside_95: 0.9,
            updates: 600,
            not_positive_definite: 0,
            coverage_50: 0.5,
            coverage_90: 0.9,
            coverage_95: 0.95,
        }
    }

    #[test]
    fn closed_form_thresholds_and_words() {
        assert_eq!(Verdict::of_run(&summary(3.0)), Verdict::Consistent);
        assert_eq!(Verdict::of_run(&summary(4.49)), Verdict::Consistent);
        assert_eq!(Verdict::of_run(&summary(0.76)), Verdict::Consistent);
        let text = Verdict::of_run(&summary(12.0)).to_string();
        assert_eq!(
            text,
            "overconfident: mean NEES 12.00 at 3 degrees of freedom (4.00 each, limit 1.5): \
             errors 2.00 times the claim"
        );
        let text = Verdict::of_run(&summary(0.48)).to_string();
        assert!(text.starts_with("cautious: mean NEES 0.48"), "{text}");
        assert!(text.ends_with("errors 0.40 times the claim"), "{text}");
        let broken = NeesSummary { not_positive_definite: 2, ..summary(3.0) };
        let text = Verdict::of_run(&broken).to_string();
        assert_eq!(text, "overconfident: 2 of 602 covariances are not positive definite");
    }

    #[test]
    fn law_text_and_json_round_trip() {
        for verdict in [
            Verdict::Consistent,
            Verdict::Overconfident("mean NEES 6: twice".to_owned()),
            Verdict::Cautious("mean NEES 0.1".to_owned()),
        ] {
            assert_eq!(verdict.to_string().parse(), Ok(verdict.clone()));
            let json = serde_json::to_string(&verdict).unwrap();
            assert_eq!(serde_json::from_str::<Verdict>(&json).unwrap(), verdict);
        }
        assert!("perhaps: so".parse::<Verdict>().is_err());
        assert!(serde_json::from_str::<Verdict>("\"fine\"").is_err());
    }
}
