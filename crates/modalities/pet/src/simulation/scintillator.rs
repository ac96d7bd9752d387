//! What detector crystals are made of: `models/scintillators/*.toml`.
//!
//! ```text
//! μ_Compton(E) = n_e σ_KN(E),      μ_photoelectric(E) = μ_511 (511 keV / E)^p
//! ```
//!
//! Fluorescence, coherent scattering, pair production and the paths of electrons (0.1 mm) are neglected. The coefficients stand
//! in a table over energy, from which [`Scintillator::attenuation_per_m`] interpolates.

use super::compton::{ELECTRON_REST_ENERGY_EV, klein_nishina_m2};
use lumenav_core::config::quantity::Positive;
use lumenav_core::{ConfigError, Node};
use serde::{Deserialize, Serialize};

/// `[scintillator]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScintillatorTable {
    name: String,
    source: String,
    /// Electrons per volume, 1/cm³.
    electron_density_per_cm3: Positive,
    /// Photoelectric attenuation at 511 keV, 1/cm.
    photoelectric_511_per_cm: Positive,
    /// It falls with this power of the energy.
    photoelectric_exponent: Positive,
}

/// `[scintillator]` is all there is in the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScintillatorFile {
    #[expect(dead_code, reason = "named here, so that other tables are refused; parsed by itself")]
    scintillator: serde::de::IgnoredAny,
}

/// Step of the table over energy, eV: straight lines in it are within 0.1 % above 100 keV.
const STEP_EV: f64 = 2e3;
/// Steps of the table: it ends at 4 MeV, above all gammas of positron emitters.
const STEPS: usize = 2000;
/// No solid has more electrons than osmium's 4e24 per cm³ by far; less than air's 4e20 is no detector. 1/cm³.
const ELECTRONS_PER_CM3: [f64; 2] = [1e20, 1e25];
/// Photoelectric coefficients outside this are a typing error, 1/cm at 511 keV.
const MAX_PHOTOELECTRIC_PER_CM: f64 = 100.0;
/// Exponents outside this are a typing error: 2.3 to 3.2 in real scintillators.
const EXPONENTS: [f64; 2] = [1.0, 4.0];

/// A scintillator.
#[derive(Clone, Debug, PartialEq)]
pub struct Scintillator {
    /// Its name.
    pub name: String,
    /// Electrons per volume, 1/m³.
    pub electron_density_per_m3: f64,
    /// Photoelectric attenuation at 511 keV, 1/m.
    pub photoelectric_511_per_m: f64,
    /// It falls with this power of the energy.
    pub photoelectric_exponent: f64,
    /// Total and Compton coefficient at multiples of [`STEP_EV`], 1/m.
    table_per_m: Vec<[f64; 2]>,
}

impl Scintillator {
    /// Reads a scintillator's file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(file: &Node) -> Result<Self, ConfigError> {
        let _: ScintillatorFile = file.parse_quietly()?;
        let node = file.child_or_empty("scintillator");
        let table: ScintillatorTable = node.parse()?;
        let within = |key: &str, value: f64, [low, high]: [f64; 2]| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(node
                    .error_at(key, &format!("{value} is no scintillator's; allowed: {low:e} to {high:e}")))
            }
        };
        within("electron_density_per_cm3", table.electron_density_per_cm3.0, ELECTRONS_PER_CM3)?;
        let largest = [0.0, MAX_PHOTOELECTRIC_PER_CM];
        within("photoelectric_511_per_cm", table.photoelectric_511_per_cm.0, largest)?;
        within("photoelectric_exponent", table.photoelectric_exponent.0, EXPONENTS)?;
        Ok(Self::new(
            &table.name,
            table.electron_density_per_cm3.0 * 1e6,
            table.photoelectric_511_per_cm.0 * 100.0,
            table.photoelectric_exponent.0,
        ))
    }

    /// A scintillator from its coefficients: electrons per m³, photoelectric attenuation at 511 keV in 1/m, its exponent.
    pub fn new(
        name: &str,
        electron_density_per_m3: f64,
        photoelectric_511_per_m: f64,
        photoelectric_exponent: f64,
    ) -> Self {
        let at = |i: usize| {
            // Below the first step nothing is looked up: photons end there.
            let energy_ev = STEP_EV * i.max(1) as f64;
            let compton = electron_density_per_m3 * klein_nishina_m2(energy_ev);
            let photoelectric =
                photoelectric_511_per_m * (ELECTRON_REST_ENERGY_EV / energy_ev).powf(photoelectric_exponent);
            [compton + photoelectric, compton]
        };
        Self {
            name: name.to_owned(),
            electron_density_per_m3,
            photoelectric_511_per_m,
            photoelectric_exponent,
            table_per_m: (0..=STEPS).map(at).collect(),
        }
    }

    /// Total and Compton attenuation coefficient at an energy, 1/m.
    pub fn attenuation_per_m(&self, energy_ev: f64) -> [f64; 2] {
        let place = (energy_ev / STEP_EV).clamp(0.0, STEPS as f64 - 1.0);
        let index = place as usize;
        let part = (place - index as f64).min(1.0);
        let (a, b) = (self.table_per_m[index], self.table_per_m[index + 1]);
        [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::path::Path;

    pub(crate) fn model(name: &str) -> Scintillator {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scintillators");
        Scintillator::from_node(&Node::open(&folder.join(format!("{name}.toml"))).unwrap()).unwrap()
    }

    #[test]
    fn closed_form_the_table_follows_the_laws() {
        for name in ["gso", "lyso", "bgo", "nai"] {
            let crystal = model(name);
            for energy_ev in [103.3e3, 255.1e3, 340.7e3, 510_998.95, 1274.5e3] {
                let [total, compton] = crystal.attenuation_per_m(energy_ev);
                let expected = crystal.electron_density_per_m3 * klein_nishina_m2(energy_ev);
                assert!((compton / expected - 1.0).abs() < 1e-3, "{name} {energy_ev}");
                let photo = crystal.photoelectric_511_per_m
                    * (ELECTRON_REST_ENERGY_EV / energy_ev).powf(crystal.photoelectric_exponent);
                assert!(((total - compton) / photo - 1.0).abs() < 1e-3, "{name} {energy_ev}");
            }
        }
    }

    #[test]
    fn published_attenuation_at_511_kev() {
        // Without coherent scattering: GSO 0.67, LYSO 0.79, BGO 0.91, NaI 0.33 /cm: sums of the incoherent and photoelectric
        // columns of Elam's tables (2002), within 3 % because binding takes about 1 % of the incoherent part.
        for (name, expected) in [("gso", 0.668), ("lyso", 0.774), ("bgo", 0.906), ("nai", 0.326)] {
            let total = model(name).attenuation_per_m(ELECTRON_REST_ENERGY_EV)[0] / 100.0;
            assert!((total / expected - 1.0).abs() < 0.03, "{name}: {total} /cm");
        }
    }

    #[test]
    fn law_bad_files_are_refused_with_line_and_key() {
        let good = "[scintillator]\nname = \"x\"\nsource = \"y\"\nelectron_density_per_cm3 = 1e24\n\
            photoelectric_511_per_cm = 0.2\nphotoelectric_exponent = 2.6\n";
        let read = |text: &str| {
            Scintillator::from_node(&Node::parse_text(text, "s.toml", Path::new(""), &[]).unwrap())
        };
        assert!(read(good).is_ok());
        for (from, to, key) in [
            ("1e24", "1e30", "electron_density_per_cm3"),
            ("= 0.2", "= -0.2", "photoelectric_511_per_cm"),
            ("= 0.2", "= 1e9", "photoelectric_511_per_cm"),
            ("2.6", "26", "photoelectric_exponent"),
            ("source = \"y\"\n", "", "source"),
            ("[scintillator]", "[other]\n[scintillator]", "other"),
        ] {
            let error = read(&good.replace(from, to)).unwrap_err().to_string();
            assert!(error.starts_with("s.toml:") && error.contains(key), "{error}");
        }
    }
}
