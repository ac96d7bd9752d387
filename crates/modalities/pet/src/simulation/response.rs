//! Responses of a block, tabulated: how often a photon of up to 511 keV is accepted, and where it is placed.
//!
//! The table is over energy, angle of incidence and distance of the entry from the block's nearest edge. Each cell is made by
//! [`BlockPhysics::respond`] and the energy window, and keeps the depths of accepted photons and how far beside their straight way they
//! were placed, in its plane and across. Looked up, a place is put beside the photon's own way. Neglected: the phase of the
//! entry on the pitch, the side on which the edge lies; a photon that enters through a side counts as one at the edge.

use super::block::{BlockPhysics, passes_window};
use super::compton::ELECTRON_REST_ENERGY_EV;
use super::photon::Photon;
use crate::scanner::{CrystalGrid, Scanner};
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::Vector3;
use rand::RngExt as _;

/// Cells over energy, the last one for 511 keV itself.
const ENERGIES: usize = 9;
/// Cells over the angle of incidence.
const ANGLES: usize = 9;
/// Angles beyond this count as this, rad: 67.5 degrees, 7.5 a cell.
const LARGEST_RAD: f64 = 1.178_097_245_096_172_5;
/// Ends of the cells over the distance from an edge, m: most photons that scatter stop within 10 mm.
const EDGES_M: [f64; 2] = [3e-3, 9e-3];
/// Photons per cell: the acceptance is known within 1 % of itself.
const PHOTONS: usize = 5000;

/// Places kept per cell: enough to look random, few enough to stay in the cache.
const PLACES: usize = 800;

/// One cell.
#[derive(Clone, Debug, Default)]
struct Cell {
    accepted: f64,
    /// Beside the straight way in its plane and across, depth, m.
    places_m: Vec<[f32; 3]>,
}

/// The table.
#[derive(Clone, Debug)]
pub(super) struct Response {
    grid: CrystalGrid,
    kill_ev: f64,
    cells: Vec<Cell>,
    /// The largest acceptance at 511 keV.
    pub most_at_511: f64,
}

impl Response {
    /// Makes the table; the same for the same scanner and scintillator.
    pub fn new(scanner: &Scanner, physics: &BlockPhysics, kill_ev: f64) -> Self {
        let streams = RandomStreams::new(0, 0, "pet-tables");
        let mut table = Self { grid: scanner.grid, kill_ev, cells: Vec::new(), most_at_511: 0.0 };
        for index in 0..ENERGIES * ANGLES * (EDGES_M.len() + 1) {
            let mut random = streams.stream("response", index as u64);
            let cell = table.fill(scanner, physics, index, &mut random);
            if index % ENERGIES == ENERGIES - 1 {
                table.most_at_511 = table.most_at_511.max(cell.accepted);
            }
            table.cells.push(cell);
        }
        table
    }

    /// Follows the photons of one cell.
    fn fill(
        &self,
        scanner: &Scanner,
        physics: &BlockPhysics,
        index: usize,
        random: &mut RandomStream,
    ) -> Cell {
        let (energy, rest) = (index % ENERGIES, index / ENERGIES);
        let (angle, edge) = (rest % ANGLES, rest / ANGLES);
        let (mut cell, mut accepted) = (Cell::default(), 0);
        for _ in 0..PHOTONS {
            let energy_ev = if energy == ENERGIES - 1 {
                ELECTRON_REST_ENERGY_EV
            } else {
                let step_ev = (ELECTRON_REST_ENERGY_EV - self.kill_ev) / (ENERGIES - 1) as f64;
                self.kill_ev + step_ev * (energy as f64 + random.random::<f64>())
            };
            // Even in solid angle within the cell.
            let [low, high] = [angle, angle + 1].map(|a| (a as f64 * LARGEST_RAD / ANGLES as f64).cos());
            let cos = low + (high - low) * random.random::<f64>();
            let (sin, turn) = ((1.0 - cos * cos).sqrt(), std::f64::consts::TAU * random.random::<f64>());
            let direction = Vector3::new(sin * turn.cos(), sin * turn.sin(), cos);
            let entry = self.entry(edge, random);
            let mut photon = Photon::emitted(entry - direction * 1e-6, direction, energy_ev);
            let Some(deposit) = physics.respond(&mut photon, random) else { continue };
            if passes_window(&scanner.detection, deposit.energy_ev, random) {
                accepted += 1;
                if cell.places_m.len() == PLACES {
                    continue;
                }
                let moved = deposit.place_block_m - entry;
                let (c, s) = (turn.cos(), turn.sin());
                cell.places_m.push(
                    [moved.x * c + moved.y * s - moved.z * sin / cos, moved.y * c - moved.x * s, moved.z]
                        .map(|v| v as f32),
                );
            }
        }
        cell.accepted = f64::from(accepted) / PHOTONS as f64;
        cell
    }

    /// A place on the face at a distance from the nearest edge; anywhere where the block has no such place.
    fn entry(&self, edge: usize, random: &mut RandomStream) -> Vector3<f64> {
        let (w, l) = (self.grid.half_width_m(), self.grid.half_length_m());
        let mut place = Vector3::zeros();
        for _ in 0..10_000 {
            place = Vector3::new(
                w * (2.0 * random.random::<f64>() - 1.0),
                l * (2.0 * random.random::<f64>() - 1.0),
                0.0,
            );
            if self.edge_of(&place) == edge {
                break;
            }
        }
        place
    }

    fn edge_of(&self, entry_m: &Vector3<f64>) -> usize {
        let distance_m =
            (self.grid.half_width_m() - entry_m.x.abs()).min(self.grid.half_length_m() - entry_m.y.abs());
        EDGES_M.iter().position(|end_m| distance_m < *end_m).unwrap_or(EDGES_M.len())
    }

    /// The cell of a photon that enters at a place (block coordinates).
    fn cell(&self, entry_m: &Vector3<f64>, cosine: f64, energy_ev: f64) -> &Cell {
        let angle = cosine.clamp(0.0, 1.0).acos() / LARGEST_RAD * ANGLES as f64;
        let angle = (angle as usize).min(ANGLES - 1);
        let energy = if energy_ev > ELECTRON_REST_ENERGY_EV * (1.0 - 1e-9) {
            ENERGIES - 1
        } else {
            let part = (energy_ev - self.kill_ev) / (ELECTRON_REST_ENERGY_EV - self.kill_ev);
            ((part * (ENERGIES - 1) as f64).max(0.0) as usize).min(ENERGIES - 2)
        };
        &self.cells[(self.edge_of(entry_m) * ANGLES + angle) * ENERGIES + energy]
    }

    /// Where a photon (block coordinates, at its entry) is placed; `None` where it is not accepted. `given` is the probability with which
    /// photons that get here were already chosen: 1, or [`Self::most_at_511`].
    pub fn draw(&self, photon: &Photon, given: f64, random: &mut RandomStream) -> Option<Vector3<f64>> {
        let cell = self.cell(&photon.place_m, photon.direction.z, photon.energy_ev);
        if random.random::<f64>() * given >= cell.accepted || cell.places_m.is_empty() {
            return None;
        }
        let [along_m, across_m, depth_m] =
            cell.places_m[random.random_range(0..cell.places_m.len())].map(f64::from);
        let (x, y) = (photon.direction.x, photon.direction.y);
        let sin = x.hypot(y);
        // Nearly along the face the straight way has no end: as at the largest angle of the table.
        let along_m = along_m + depth_m * sin / photon.direction.z.max(LARGEST_RAD.cos());
        let (c, s) = if sin > 0.0 { (x / sin, y / sin) } else { (1.0, 0.0) };
        Some(Vector3::new(
            photon.place_m.x + along_m * c - across_m * s,
            photon.place_m.y + along_m * s + across_m * c,
            depth_m,
        ))
    }
}
