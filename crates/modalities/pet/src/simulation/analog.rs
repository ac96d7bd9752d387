//! Every decay, photon by photon: the mode against which the others are held.

use super::Physics;
use super::compton::isotropic;
use super::detectors::{Hits, Kind, Single};
use super::photon::Photon;
use super::source::{ANNIHILATION_EV, MarkerPaths, opposite};
use lumenav_core::RandomStream;
use nalgebra::Vector3;
use rand::RngExt as _;

/// One photon: out of the body, into the detectors.
pub(super) fn follow(
    physics: &Physics,
    from_m: Vector3<f64>,
    direction: Vector3<f64>,
    (energy_ev, kind): (f64, Kind),
    random: &mut RandomStream,
    hits: &mut Hits,
) {
    let mut photon = Photon::emitted(from_m, direction, energy_ev);
    if let Some(scatterings) = physics.body.leave(&mut photon, random) {
        physics.detectors.detect(photon, kind, scatterings, random, hits);
    }
}

/// The prompt gammas of a decay.
pub(super) fn prompts(
    physics: &Physics,
    marker: usize,
    from_m: Vector3<f64>,
    random: &mut RandomStream,
    hits: &mut Hits,
) {
    for gamma in &physics.markers[marker].isotope.gammas {
        if random.random::<f64>() < gamma.per_decay {
            let direction = isotropic(random);
            follow(physics, from_m, direction, (gamma.energy_ev, Kind::Prompt), random, hits);
        }
    }
}

/// One whole decay of a marker at a place.
pub(super) fn decay(
    physics: &Physics,
    marker: usize,
    place_m: Vector3<f64>,
    random: &mut RandomStream,
    hits: &mut Hits,
) {
    hits.clear();
    let source = &physics.markers[marker];
    if random.random::<f64>() < physics.positrons_per_decay[marker] {
        let from_m = place_m + source.annihilation_offset_m(random);
        let first = isotropic(random);
        let second = opposite(&first, physics.acollinearity_sigma_rad, random);
        for direction in [first, second] {
            follow(physics, from_m, direction, (ANNIHILATION_EV, Kind::Annihilation), random, hits);
        }
    }
    if !source.isotope.gammas.is_empty() {
        let from_m = place_m + source.core_offset_m(random);
        prompts(physics, marker, from_m, random, hits);
    }
}

/// Reads all hits of a decay out.
pub(super) fn read_out(
    physics: &Physics,
    hits: &Hits,
    (after_s, decay, marker): (f64, u32, usize),
    random: &mut RandomStream,
    singles: &mut Vec<Single>,
) {
    for hit in hits.as_slice() {
        singles.extend(physics.detectors.read_out(hit, after_s, decay, marker as u8, random));
    }
}

/// All singles of a window, unsorted.
pub(super) fn singles(
    physics: &Physics,
    paths: &MarkerPaths,
    (start_s, duration_s): (f64, f64),
    random: &mut RandomStream,
    hits: &mut Hits,
    singles: &mut Vec<Single>,
) {
    singles.clear();
    let mut number = 0_u32;
    for marker in 0..physics.markers.len() {
        let count = super::poisson(physics.decay_rate_hz(marker, start_s) * duration_s, random);
        for _ in 0..count {
            let after_s = duration_s * random.random::<f64>();
            decay(physics, marker, paths.at(marker, after_s), random, hits);
            read_out(physics, hits, (after_s, number, marker), random, singles);
            number = number.wrapping_add(1);
        }
    }
}
