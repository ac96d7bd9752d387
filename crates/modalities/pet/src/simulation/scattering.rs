//! First scatterings of photons of 511 keV that leave a chance of a line.
//!
//! Of all scatterings in the body most take so much energy that no block accepts the photon afterwards. So the cosine of the first is drawn
//! with the density `dσ/dΩ · a`, a the largest acceptance of a photon of the energy that is left, or less; of all first
//! scatterings these are the share `∫ dσ/dΩ a / σ`. Drawn by bins of the cosine, under their largest density, and thinned to it.

use super::compton::{ELECTRON_REST_ENERGY_EV, klein_nishina_m2, klein_nishina_m2_per_sr, scattered_share};
use super::response::Response;
use rand::{Rng, RngExt as _};

/// Bins of the cosine: one in twenty draws is thinned away.
const BINS: usize = 64;

/// A scattering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scattering {
    /// Cosine of the angle.
    pub cos_angle: f64,
    /// Energy that is left, eV.
    pub energy_ev: f64,
    /// Acceptance by which it was drawn.
    pub given: f64,
}

/// Draws scatterings.
#[derive(Clone, Debug)]
pub(super) struct Scatterings {
    /// Cosine below which too little energy is left.
    least_cos: f64,
    /// Largest density of each bin, m²/sr.
    most_m2_per_sr: [f64; BINS],
    /// Their sum up to and with a bin.
    cumulative: [f64; BINS],
}

impl Scatterings {
    /// For blocks that respond so to photons of at least an energy, eV.
    pub fn new(response: &Response, kill_ev: f64) -> Self {
        let least_cos = (2.0 - ELECTRON_REST_ENERGY_EV / kill_ev).clamp(-1.0, 1.0);
        let mut made = Self { least_cos, most_m2_per_sr: [0.0; BINS], cumulative: [0.0; BINS] };
        let mut sum = 0.0;
        for bin in 0..BINS {
            // Acceptance grows with energy, energy with the cosine; the cross section has one minimum and no maximum inside.
            let [low, high] = [bin, bin + 1].map(|edge| made.cosine(edge as f64));
            let section = |cos| klein_nishina_m2_per_sr(ELECTRON_REST_ENERGY_EV, cos);
            let acceptance = response.most_up_to(energy_after_ev(high));
            made.most_m2_per_sr[bin] = section(low).max(section(high)) * acceptance;
            sum += made.most_m2_per_sr[bin];
            made.cumulative[bin] = sum;
        }
        made
    }

    /// The cosine at a place between bins.
    fn cosine(&self, place: f64) -> f64 {
        self.least_cos + (1.0 - self.least_cos) * place / BINS as f64
    }

    /// Draws per scattering.
    pub fn per_scattering(&self) -> f64 {
        let width = (1.0 - self.least_cos) / BINS as f64;
        std::f64::consts::TAU * width * self.cumulative[BINS - 1] / klein_nishina_m2(ELECTRON_REST_ENERGY_EV)
    }

    /// Draws a scattering; `None` where it is thinned away.
    pub fn draw<R: Rng + ?Sized>(&self, response: &Response, random: &mut R) -> Option<Scattering> {
        let level = random.random::<f64>() * self.cumulative[BINS - 1];
        let bin = self.cumulative.partition_point(|sum| *sum <= level).min(BINS - 1);
        let cos_angle = self.cosine(bin as f64 + random.random::<f64>());
        let energy_ev = energy_after_ev(cos_angle);
        let given = response.most_up_to(energy_ev);
        let density = klein_nishina_m2_per_sr(ELECTRON_REST_ENERGY_EV, cos_angle) * given;
        let is_kept = random.random::<f64>() * self.most_m2_per_sr[bin] < density;
        is_kept.then_some(Scattering { cos_angle, energy_ev, given })
    }
}

/// Energy of a photon of 511 keV after scattering, eV.
fn energy_after_ev(cos_angle: f64) -> f64 {
    ELECTRON_REST_ENERGY_EV * scattered_share(ELECTRON_REST_ENERGY_EV, cos_angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scanner::Scanner;
    use crate::simulation::block::{BlockPhysics, kill_energy_ev};
    use crate::simulation::compton::scatter;
    use crate::simulation::scintillator;
    use lumenav_core::{Node, RandomStreams};
    use std::path::Path;

    /// Scatterings drawn at large and thinned by the acceptance are those drawn by bins: chi-square of two samples over 20 bins of the
    /// cosine; 0.999 quantile of 19 degrees of freedom is 43.8.
    #[test]
    fn cross_scatterings_are_those_of_klein_and_nishina_thinned() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/reduced.toml");
        let scanner = Scanner::from_node(&Node::open(&models).unwrap()).unwrap();
        let kill_ev = kill_energy_ev(&scanner.detection);
        let physics = BlockPhysics::new(&scanner, scintillator::tests::model("gso"));
        let response = Response::new(&scanner, &physics, kill_ev);
        let scatterings = Scatterings::new(&response, kill_ev);
        let mut random = RandomStreams::new(3, 0, "scattering").stream("angles", 0);
        let n = 200_000;
        let mut counts = [[0.0; 2]; 20];
        let mut add = |kind: usize, cos: f64| counts[((cos + 1.0) * 10.0).min(19.0) as usize][kind] += 1.0;
        for _ in 0..n {
            let (share, cos_angle) = scatter(ELECTRON_REST_ENERGY_EV, &mut random);
            let energy_ev = share * ELECTRON_REST_ENERGY_EV;
            if energy_ev >= kill_ev && random.random::<f64>() < response.most_up_to(energy_ev) {
                add(0, cos_angle);
            }
            if random.random::<f64>() < scatterings.per_scattering()
                && let Some(drawn) = scatterings.draw(&response, &mut random)
            {
                add(1, drawn.cos_angle);
            }
        }
        let term = |[a, b]: &[f64; 2]| (a - b).powi(2) / (a + b).max(1.0);
        let chi2: f64 = counts.iter().map(term).sum();
        assert!(chi2 < 43.8, "chi-square {chi2}: {counts:?}");
    }
}
