//! When is a published number reproduced?
//!
//! Each row states its tolerance before anything runs. Within it the number is *reproduced*; beyond it on the good side it is
//! *better*; beyond it on the other side, or on any side where there is no good one, it *differs*. A claim in words,
//! put as a number that is met, or stayed below or above, *holds* or *does not hold*. Where the source gives no number,
//! or ours is about another thing, the row is *not comparable* and says why.

use serde::{Deserialize, Serialize};
use std::fmt;

/// How ours compares with what was published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// Within the stated tolerance.
    #[serde(rename = "reproduced")]
    Reproduced,
    /// Beyond the tolerance, to the good.
    #[serde(rename = "better")]
    Better,
    /// Beyond the tolerance.
    #[serde(rename = "differs")]
    Differs,
    /// A claim (a number to be met, or to stay below or above) that is true of the model as stated.
    #[serde(rename = "holds")]
    Holds,
    /// A claim that is not.
    #[serde(rename = "does not hold")]
    DoesNotHold,
    /// No number to compare with.
    #[serde(rename = "not comparable")]
    NotComparable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Reproduced => "reproduced",
            Self::Better => "better",
            Self::Differs => "differs",
            Self::Holds => "holds",
            Self::DoesNotHold => "does not hold",
            Self::NotComparable => "not comparable",
        })
    }
}

/// How far ours may be from the published number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tolerance {
    /// A share of the published number.
    Relative(f64),
    /// In the row's unit.
    Absolute(f64),
}

impl Tolerance {
    /// The tolerance around a published number, in its unit.
    pub fn around(self, published: f64) -> f64 {
        match self {
            Self::Relative(share) => share * published.abs(),
            Self::Absolute(width) => width,
        }
    }

    /// In words.
    pub fn text(self, unit: &str) -> String {
        match self {
            Self::Relative(share) => format!("{} %", trimmed(100.0 * share)),
            Self::Absolute(width) if unit.is_empty() => trimmed(width),
            Self::Absolute(width) => format!("{} {unit}", trimmed(width)),
        }
    }
}

/// At most six digits behind the point, none that says nothing.
pub(crate) fn trimmed(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Which side is the good one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// Errors, failures, times.
    LowerIsBetter,
    /// Availability.
    HigherIsBetter,
    /// Rates, shares, doses: a number to be met.
    Match,
}

/// The verdict on a number.
pub(crate) fn judge(
    published: Option<f64>,
    ours: Option<f64>,
    tolerance: Tolerance,
    sense: Sense,
) -> Verdict {
    let (Some(published), Some(ours)) = (published, ours.filter(|v| v.is_finite())) else {
        return Verdict::NotComparable;
    };
    let beyond = ours - published;
    // A billionth of the number is rounding: 0.3 - 0.27 is not beyond 10 % of 0.3.
    if beyond.abs() <= tolerance.around(published) + 1e-9 * published.abs() {
        return Verdict::Reproduced;
    }
    match sense {
        Sense::LowerIsBetter if beyond < 0.0 => Verdict::Better,
        Sense::HigherIsBetter if beyond > 0.0 => Verdict::Better,
        _ => Verdict::Differs,
    }
}

/// What this project wants of a row, apart from what was published.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// The estimator of which it is wanted.
    pub of: String,
    /// Its value is to be at most this, in the row's unit.
    pub at_most: f64,
    /// Whether it is.
    pub met: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_verdicts() {
        use Sense::{HigherIsBetter, LowerIsBetter, Match};
        use Verdict::{Better, Differs, NotComparable, Reproduced};
        let ten = Tolerance::Relative(0.1);
        for (ours, sense, wanted) in [
            (0.33, LowerIsBetter, Reproduced),
            (0.27, LowerIsBetter, Reproduced),
            (0.269, LowerIsBetter, Better),
            (0.331, LowerIsBetter, Differs),
            (0.269, Match, Differs),
            (0.331, HigherIsBetter, Better),
            (0.269, HigherIsBetter, Differs),
            (f64::NAN, LowerIsBetter, NotComparable),
        ] {
            assert_eq!(judge(Some(0.3), Some(ours), ten, sense), wanted, "{ours} {sense:?}");
        }
        assert_eq!(judge(None, Some(1.0), ten, Match), NotComparable);
        assert_eq!(judge(Some(1.0), None, ten, Match), NotComparable);
        // No failure in 720 windows is not met by one failure, however large the share.
        assert_eq!(judge(Some(0.0), Some(1.0), ten, LowerIsBetter), Differs);
        assert_eq!(judge(Some(0.0), Some(1.0), Tolerance::Absolute(2.0), LowerIsBetter), Reproduced);
    }

    #[test]
    fn closed_form_tolerances_in_words() {
        assert_eq!(Tolerance::Relative(0.1).text("mm"), "10 %");
        assert_eq!(Tolerance::Absolute(3.0).text("points"), "3 points");
        assert_eq!(Tolerance::Absolute(0.05).text(""), "0.05");
    }
}
