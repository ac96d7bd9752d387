//! From decays to lines.
//!
//! A [`Simulator`] makes the lines of one window from the physics of every decay: Poisson times, positron range, two photons nearly
//! opposite and prompt gammas, Compton scattering in the body ([`photon`]), the response of crystals ([`block`]), energy and time
//! resolution, and the sorting of coincidences ([`coincidence`]). Rates, true fractions and line noise are results, not settings.
//!
//! Where `efficiency` of the scanner is at most 1 it is the share of detected photons that are read out, so lines scale with its
//! square. A value above 1 cannot be a share: it then stands for everything that makes the real scanner see more lines than this
//! physics (a higher activity, crystals denser than assumed), and decays are multiplied by its square. Lines scale the same way;
//! randoms, a few per cent, with its fourth power instead of its square.
//!
//! Neglected: attenuation in the capsule itself (2 mm of plastic), coherent scattering, pair production of prompt gammas, pile-up of
//! different decays in a block, decays just before the window.

pub mod agreement;
mod aim;
mod analog;
pub mod block;
pub mod coincidence;
pub mod compton;
pub mod deposits;
mod detectors;
mod forced;
pub mod isotope;
pub mod photon;
mod response;
mod scattering;
pub mod scintillator;
pub mod source;
mod tables;
mod tabulated;

pub use block::{BlockPhysics, Deposit};
pub use coincidence::{Label, LabelledLine, Origin};
pub use detectors::{Detectors, EndPoints};
pub use isotope::Isotope;
pub use photon::{Body, Photon};
pub use scintillator::Scintillator;
pub use source::{Shell, SourceMarker};
pub use tables::TableStore;

use crate::scanner::Scanner;
use detectors::{Hits, Single};
use forced::{Forced, Window};
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::Isometry3;
use rand::RngExt as _;
use rand_distr::Poisson;
use serde::{Deserialize, Serialize};
use source::MarkerPaths;
use tabulated::Tabulated;

/// How lines are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Every decay is followed.
    Analog,
    /// Photons are aimed at blocks; unbiased.
    #[default]
    Forced,
    /// Detector response and backgrounds from tables.
    Tabulated,
}

/// What a simulator can be told beside scanner, body and markers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How lines are made.
    pub mode: Mode,
    /// What the scanner reports as the place of a photon.
    pub end_points: EndPoints,
    /// FWHM of the angle by which two photons miss 180 degrees, in each of two planes, degrees.
    pub acollinearity_fwhm_deg: f64,
}

impl Default for Settings {
    fn default() -> Self {
        // Water at body temperature: about 0.5 degrees (Colombino et al. 1965).
        Self { mode: Mode::default(), end_points: EndPoints::default(), acollinearity_fwhm_deg: 0.5 }
    }
}

/// Everything that a decay's photons meet; does not change during a run.
#[derive(Clone, Debug)]
struct Physics {
    detectors: Detectors,
    body: Body,
    markers: Vec<SourceMarker>,
    positrons_per_decay: Vec<f64>,
    acollinearity_sigma_rad: f64,
    /// Decays are multiplied by this: 1, or the square of an efficiency above 1.
    decay_scale: f64,
}

impl Physics {
    /// Decays per second of a marker at a time.
    fn decay_rate_hz(&self, marker: usize, at_s: f64) -> f64 {
        let source = &self.markers[marker];
        source.activity_bq * source.isotope.remaining(at_s) * self.decay_scale
    }
}

/// Makes the lines of windows.
#[derive(Clone, Debug)]
pub struct Simulator {
    physics: Physics,
    mode: Mode,
    paths: MarkerPaths,
    hits: Hits,
    singles: Vec<Single>,
    free_at_s: Vec<f64>,
    forced: Forced,
    tabulated: Option<Tabulated>,
}

impl Simulator {
    /// A simulator of a scanner with its scintillator, a body (or air) and markers as they really are.
    pub fn new(
        scanner: Scanner,
        scintillator: Scintillator,
        phantom: Option<Phantom>,
        markers: Vec<SourceMarker>,
        settings: Settings,
    ) -> Self {
        Self::sharing(&TableStore::default(), scanner, scintillator, phantom, markers, settings)
    }

    /// As [`Self::new`], with tables (of [`Mode::Tabulated`]) that other simulators of the same set-up have made or will use.
    pub fn sharing(
        store: &TableStore,
        scanner: Scanner,
        scintillator: Scintillator,
        phantom: Option<Phantom>,
        markers: Vec<SourceMarker>,
        settings: Settings,
    ) -> Self {
        let decay_scale = scanner.detection.efficiency.max(1.0).powi(2);
        let detectors = Detectors::new(scanner, scintillator, settings.end_points);
        let body = Body::new(phantom, detectors.kill_ev());
        let positrons_per_decay = markers.iter().map(|m| m.isotope.positrons_per_decay()).collect();
        let acollinearity_sigma_rad = settings.acollinearity_fwhm_deg.to_radians() / block::FWHM_PER_SIGMA;
        let physics =
            Physics { detectors, body, markers, positrons_per_decay, acollinearity_sigma_rad, decay_scale };
        let tabulated = (settings.mode == Mode::Tabulated).then(|| Tabulated::new(store.of(&physics)));
        Self {
            physics,
            mode: settings.mode,
            paths: MarkerPaths::default(),
            hits: Hits::new(),
            singles: Vec::new(),
            free_at_s: Vec::new(),
            forced: Forced::default(),
            tabulated,
        }
    }

    /// From now on the body stands so far from where its file says, m. Not in [`Mode::Tabulated`]: its tables hold one place of the
    /// body.
    pub fn move_body(&mut self, moved_m: nalgebra::Vector3<f64>) {
        self.physics.body.move_to(moved_m);
    }

    /// The lines of one window, in the order of time, into `out` (cleared first). `motion` tells `world_from_capsule` at a time.
    ///
    /// Random numbers are those of `sequence` alone: a window's lines depend on no other window.
    pub fn window(
        &mut self,
        motion: &dyn Fn(f64) -> Isometry3<f64>,
        start_s: f64,
        duration_s: f64,
        random: &RandomStreams,
        sequence: u64,
        out: &mut Vec<LabelledLine>,
    ) {
        out.clear();
        self.paths.follow(&self.physics.markers, motion, start_s, duration_s);
        let mut random = random.stream("decays", sequence);
        let window = Window { start_s, duration_s };
        let (physics, paths) = (&self.physics, &self.paths);
        let made = match &mut self.tabulated {
            Some(tables) => tables.window(physics, paths, window, &mut random, out),
            None if self.mode == Mode::Analog => false,
            None => self.forced.window(physics, paths, window, &mut random, out),
        };
        if made {
            out.sort_unstable_by(|a, b| a.line.t_s.total_cmp(&b.line.t_s).then(a.crystals.cmp(&b.crystals)));
        } else {
            self.analog(start_s, duration_s, &mut random, out);
        }
    }

    fn analog(
        &mut self,
        start_s: f64,
        duration_s: f64,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let span_s = (start_s, duration_s);
        analog::singles(&self.physics, &self.paths, span_s, random, &mut self.hits, &mut self.singles);
        coincidence::sort(&mut self.singles);
        let scanner = self.physics.detectors.scanner();
        coincidence::apply_dead_time(scanner, &mut self.singles, &mut self.free_at_s);
        coincidence::pair(scanner, &self.singles, |a, b| {
            out.push(LabelledLine::of(a, b, start_s, duration_s));
        });
    }
}

/// A Poisson draw; 0 for a mean of 0.
fn poisson(mean: f64, random: &mut RandomStream) -> u64 {
    // An error means a mean that is not positive or not finite: nothing is there to decay.
    Poisson::new(mean).map_or(0, |distribution| random.sample(distribution) as u64)
}

#[cfg(test)]
mod tests;
