//! How far a reported end lies from the photon's path: calculated from the scanner's and the scintillator's files.
//!
//! Photons of 511 keV start evenly in a ball of [`FIELD_RADIUS_M`] about the scanner's centre, fly to places spread evenly over the
//! faces of its blocks, and are followed through the crystals by the same physics that any detector of these crystals has
//! ([`crate::simulation::block`]). Of those that pass the energy window the error is the reported place less the place of the first
//! interaction, which lies on the photon's path, along the block's own axes. A core and a tail (photons that scatter from one
//! crystal into another) are fitted to the errors. No line of a simulated or recorded window is looked at: the calculation knows
//! what a maker's data sheet knows. It is seeded and therefore the same for every user of a scanner.

use super::noise::BlockNoise;
use crate::scanner::Scanner;
use crate::simulation::block::passes_window;
use crate::simulation::compton::{ELECTRON_REST_ENERGY_EV, isotropic};
use crate::simulation::{BlockPhysics, EndPoints, Photon, Scintillator};
use lumenav_core::RandomStreams;
use nalgebra::Vector3;
use rand::RngExt as _;

/// Where photons start: the part of a field of view that a gut fills, m.
const FIELD_RADIUS_M: f64 = 0.1;
/// Errors that are fitted: the tail's share is then known to 0.006, variances to 2 %.
const SAMPLES: usize = 6000;
/// Photons sent before giving up: one in three is detected in 20 mm of GSO, one in fifty would still do.
const MOST_PHOTONS: usize = 50 * SAMPLES;

impl BlockNoise {
    /// The noise of the ends that a scanner reports.
    pub fn of_scanner(scanner: &Scanner, scintillator: &Scintillator, end_points: EndPoints) -> Self {
        let depth_m = scanner.grid.depth_m;
        if let Some(fwhm_m) = scanner.detection.position_fwhm_m {
            return Self::of_resolution(fwhm_m, depth_m);
        }
        // Hardly a photon is seen: the width of a crystal is all that is known.
        let of_crystal = || Self::of_resolution(scanner.grid.tangential_m.max(scanner.grid.axial_m), depth_m);
        Self::of_samples(&errors(scanner, scintillator, end_points)).unwrap_or_else(of_crystal)
    }
}

/// Errors of single ends along `(tangential, axial, outward)`, m.
fn errors(scanner: &Scanner, scintillator: &Scintillator, end_points: EndPoints) -> Vec<Vector3<f64>> {
    let physics = BlockPhysics::new(scanner, scintillator.clone());
    let mut random = RandomStreams::new(0, 0, "block-noise").stream("photons", 0);
    let (half_width_m, half_length_m) = (scanner.grid.half_width_m(), scanner.grid.half_length_m());
    let mut found = Vec::with_capacity(SAMPLES);
    for k in 0..MOST_PHOTONS {
        if found.len() == SAMPLES {
            break;
        }
        let block = k % scanner.blocks.len();
        let start = isotropic(&mut random) * (FIELD_RADIUS_M * random.random::<f64>().cbrt());
        let start = scanner.to_block(block, &start);
        let mut across = |half_m: f64| half_m * (2.0 * random.random::<f64>() - 1.0);
        let target = Vector3::new(across(half_width_m), across(half_length_m), 0.0);
        let Some(direction) = (target - start).try_normalize(1e-9) else { continue };
        let mut photon = Photon::emitted(start, direction, ELECTRON_REST_ENERGY_EV);
        let Some(deposit) = physics.respond(&mut photon, &mut random) else { continue };
        if !passes_window(&scanner.detection, deposit.energy_ev, &mut random) {
            continue;
        }
        let reported = match end_points {
            EndPoints::Crystal => {
                let (column, row) = deposit.crystal;
                centre_of(scanner, column, row)
            }
            EndPoints::Continuous => deposit.place_block_m,
        };
        found.push(reported - (start + direction * deposit.path_m));
    }
    found
}

/// Centre of a crystal in its block, m.
fn centre_of(scanner: &Scanner, column: u32, row: u32) -> Vector3<f64> {
    let g = &scanner.grid;
    let along = |index: u32, count: u32, pitch_m: f64| pitch_m * (f64::from(index) - 0.5 * f64::from(count - 1));
    Vector3::new(
        along(column, g.columns, g.tangential_pitch_m),
        along(row, g.rows, g.axial_pitch_m),
        0.5 * g.depth_m,
    )
}
