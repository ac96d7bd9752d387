//! Positron emitters: `models/isotopes/*.toml`.
//!
//! A decay emits a positron of one branch, or none (electron capture), and prompt gammas, each drawn by itself: correlations of a
//! gamma with a branch are neglected. The positron annihilates at rest at a distance from its decay that follows a Gamma
//! distribution of shape 2, `p(r) = r/s² exp(-r/s)`, with the branch's mean `2 s` in water, in a direction that is isotropic.

use lumenav_core::config::quantity::{NonNegative, Positive};
use lumenav_core::{ConfigError, Node};
use rand::{Rng, RngExt as _};
use rand_distr::Exp1;
use serde::{Deserialize, Serialize};

/// `[isotope]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct IsotopeTable {
    name: String,
    source: String,
    half_life_s: Positive,
}

/// `[[positron]]`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PositronTable {
    per_decay: Positive,
    mean_range_mm: NonNegative,
}

/// `[[gamma]]`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GammaTable {
    per_decay: Positive,
    energy_kev: Positive,
}

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct IsotopeFile {
    #[expect(dead_code, reason = "named here, so that other tables are refused; parsed by itself")]
    isotope: serde::de::IgnoredAny,
    #[serde(default)]
    positron: Vec<serde::de::IgnoredAny>,
    #[serde(default)]
    gamma: Vec<serde::de::IgnoredAny>,
}

/// A kind of positron that an isotope emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositronBranch {
    /// Positrons of this kind per decay.
    pub per_decay: f64,
    /// Mean distance between decay and annihilation in water, m.
    pub mean_range_m: f64,
}

/// A photon that an isotope emits with a decay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PromptGamma {
    /// Photons per decay.
    pub per_decay: f64,
    /// Energy, eV.
    pub energy_ev: f64,
}

/// An isotope.
#[derive(Clone, Debug, PartialEq)]
pub struct Isotope {
    /// Its name.
    pub name: String,
    /// Half-life, s.
    pub half_life_s: f64,
    /// Branches with a positron.
    pub positrons: Vec<PositronBranch>,
    /// Prompt gammas.
    pub gammas: Vec<PromptGamma>,
}

/// More gammas than this would not fit the record of one decay.
pub const MAX_GAMMAS: usize = 6;
/// The simulator's tables of cross sections end here, keV.
const MAX_ENERGY_KEV: f64 = 4000.0;
/// The largest range that is ever drawn, over the mean of its branch.
const LARGEST_OVER_MEAN: f64 = 10.0;
/// No positron emitter's mean range is larger, mm (Rb-82: 7.1).
const MAX_RANGE_MM: f64 = 50.0;

impl Isotope {
    /// Reads an isotope's file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(file: &Node) -> Result<Self, ConfigError> {
        let whole: IsotopeFile = file.parse_quietly()?;
        let table: IsotopeTable = file.child_or_empty("isotope").parse()?;
        if whole.positron.is_empty() {
            return Err(file.error("an isotope without [[positron]] makes no lines of response"));
        }
        if whole.gamma.len() > MAX_GAMMAS {
            let message =
                format!("{} gammas; allowed: the strongest {MAX_GAMMAS} at most", whole.gamma.len());
            return Err(file.error_at("gamma", &message));
        }
        let mut positrons = Vec::new();
        for node in file.children("positron")? {
            let branch: PositronTable = node.parse()?;
            if branch.mean_range_mm.0 > MAX_RANGE_MM {
                return Err(node.error_at("mean_range_mm", &format!("allowed: 0 to {MAX_RANGE_MM} mm")));
            }
            positrons.push(PositronBranch {
                per_decay: branch.per_decay.0,
                mean_range_m: branch.mean_range_mm.0 * 1e-3,
            });
            if positrons.iter().map(|p| p.per_decay).sum::<f64>() > 1.0 + 1e-9 {
                return Err(node.error_at("per_decay", "more than one positron per decay in sum"));
            }
        }
        let mut gammas = Vec::new();
        for node in file.children("gamma")? {
            let gamma: GammaTable = node.parse()?;
            if gamma.per_decay.0 > 1.0 {
                return Err(node.error_at("per_decay", "more than one photon per decay; allowed: up to 1"));
            }
            if gamma.energy_kev.0 > MAX_ENERGY_KEV {
                return Err(node.error_at("energy_kev", &format!("allowed: up to {MAX_ENERGY_KEV} keV")));
            }
            gammas.push(PromptGamma { per_decay: gamma.per_decay.0, energy_ev: gamma.energy_kev.0 * 1e3 });
        }
        Ok(Self { name: table.name, half_life_s: table.half_life_s.0, positrons, gammas })
    }

    /// Positrons per decay.
    pub fn positrons_per_decay(&self) -> f64 {
        self.positrons.iter().map(|p| p.per_decay).sum()
    }

    /// Share of an activity that is left after a time.
    pub fn remaining(&self, after_s: f64) -> f64 {
        (-after_s * std::f64::consts::LN_2 / self.half_life_s).exp()
    }

    /// The largest distance that is ever drawn, m: beyond it lie 4e-8 of the longest branch.
    pub fn largest_range_m(&self) -> f64 {
        LARGEST_OVER_MEAN * self.positrons.iter().map(|p| p.mean_range_m).fold(0.0, f64::max)
    }

    /// Draws the distance between decay and annihilation in water, m, given that there is a positron.
    pub fn range_m<R: Rng + ?Sized>(&self, random: &mut R) -> f64 {
        let (branch, largest_m) = match &self.positrons[..] {
            [only] => (only, LARGEST_OVER_MEAN * only.mean_range_m),
            _ => (self.branch(random), self.largest_range_m()),
        };
        // Shape 2: the sum of two exponential draws.
        let (a, b): (f64, f64) = (random.sample(Exp1), random.sample(Exp1));
        (0.5 * branch.mean_range_m * (a + b)).min(largest_m)
    }

    /// Draws the branch of a positron.
    fn branch<R: Rng + ?Sized>(&self, random: &mut R) -> &PositronBranch {
        let mut left = random.random::<f64>() * self.positrons_per_decay();
        let mut branch = &self.positrons[0];
        for candidate in &self.positrons {
            branch = candidate;
            if left < candidate.per_decay {
                break;
            }
            left -= candidate.per_decay;
        }
        branch
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use lumenav_core::RandomStreams;
    use std::path::Path;

    pub(crate) fn model(name: &str) -> Isotope {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/isotopes");
        Isotope::from_node(&Node::open(&folder.join(format!("{name}.toml"))).unwrap()).unwrap()
    }

    #[test]
    fn law_all_isotopes_are_readable_and_named_as_their_files() {
        for name in ["na-22", "f-18", "ga-68", "cu-64", "i-124", "as-74", "rb-84"] {
            let isotope = model(name);
            assert_eq!(isotope.name, name);
            assert!(isotope.positrons_per_decay() <= 1.0);
        }
    }

    #[test]
    fn closed_form_ranges_are_gamma_distributed() {
        // Mean 2 s and mean square 6 s² of the Gamma distribution of shape 2; 5 standard errors.
        let mut random = RandomStreams::new(3, 0, "isotope").stream("range", 0);
        let na22 = model("na-22");
        let n = 100_000;
        let draws: Vec<f64> = (0..n).map(|_| na22.range_m(&mut random)).collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let square = draws.iter().map(|r| r * r).sum::<f64>() / f64::from(n);
        let s = 2e-4;
        assert!((mean / (2.0 * s) - 1.0).abs() < 5.0 * (0.5 / f64::from(n)).sqrt(), "{mean}");
        assert!(
            (square / (6.0 * s * s) - 1.0).abs() < 5.0 * (120.0_f64 / 36.0 / f64::from(n)).sqrt(),
            "{square}"
        );
        // Two branches: the mean of means.
        let ga68 = model("ga-68");
        let mean = (0..n).map(|_| ga68.range_m(&mut random)).sum::<f64>() / f64::from(n);
        let expected = (0.877 * 3.5e-3 + 0.012 * 1.1e-3) / 0.889;
        assert!((mean / expected - 1.0).abs() < 0.015, "{mean} {expected}");
    }

    #[test]
    fn closed_form_half_of_the_activity_is_left_after_a_half_life() {
        let f18 = model("f-18");
        assert!((f18.remaining(f18.half_life_s) - 0.5).abs() < 1e-15);
        assert_eq!(f18.remaining(0.0), 1.0);
    }

    #[test]
    fn law_bad_files_are_refused_with_line_and_key() {
        let good = "[isotope]\nname = \"x\"\nsource = \"y\"\nhalf_life_s = 10\n[[positron]]\nper_decay = 0.9\n\
            mean_range_mm = 0.5\n[[gamma]]\nenergy_kev = 600\nper_decay = 0.5\n";
        let read =
            |text: &str| Isotope::from_node(&Node::parse_text(text, "i.toml", Path::new(""), &[]).unwrap());
        assert!(read(good).is_ok());
        for (from, to, key) in [
            ("half_life_s = 10", "half_life_s = 0", "half_life_s"),
            ("per_decay = 0.9", "per_decay = 1.9", "per_decay"),
            ("mean_range_mm = 0.5", "mean_range_mm = 500", "mean_range_mm"),
            ("per_decay = 0.5", "per_decay = 2", "per_decay"),
            ("energy_kev = 600", "energy_kev = 1e9", "energy_kev"),
            ("[[gamma]]", "[[gama]]", "gama"),
        ] {
            let error = read(&good.replace(from, to)).unwrap_err().to_string();
            assert!(error.starts_with("i.toml:") && error.contains(key), "{error}");
        }
        let none = "[isotope]\nname = \"x\"\nsource = \"y\"\nhalf_life_s = 10\n";
        assert!(read(none).unwrap_err().to_string().contains("[[positron]]"));
    }
}
