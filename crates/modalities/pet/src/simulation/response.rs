//! Responses of a block, tabulated: how often a photon of up to 511 keV is accepted, and where it is placed.
//!
//! The table is over energy, angle of incidence, distance of the entry from the block's nearest edge, and whether the photon heads for
//! that edge (then it may leave the block early: next to an edge a fifth fewer are accepted). Each cell is made by
//! [`BlockPhysics::respond`] and the energy window, and keeps what accepted photons left where: beside their straight way, in its plane
//! and across, and in depth. Looked up, they are put beside the photon's own way, and the crystal with most of the energy is the one
//! that fires, as in the block itself: it depends on where between two crystals a photon came in. Neglected: that an interaction cannot
//! fall into a gap; a photon that enters through a side counts as one at the edge.

use super::block::{BlockPhysics, EDGES_M, passes_window};
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
/// Kinds of entries: two near an edge, each heading for it or away, and the others.
const ENTRIES: usize = 2 * EDGES_M.len() + 1;
/// Photons per cell: the acceptance is known within 1.5 % of itself.
const PHOTONS: usize = 3000;
/// Tracks kept per cell: enough to look random, few enough to stay in the cache.
const TRACKS: usize = 800;
/// As [`PHOTONS`] and [`TRACKS`] at 511 keV, away from the edges and at the first [`STEEP`] angles: two or three of these cells make nearly
/// all true lines of a source near the middle, so their own chance is that of every run. With 800 tracks the offsets' last tenth was 7 %
/// too wide; an acceptance that is 0.7 % off makes 1.4 % of the lines.
const PHOTONS_OF_MOST: usize = 80_000;
const TRACKS_OF_MOST: usize = 12_000;
const STEEP: usize = 4;
/// Interactions kept of a photon, those that left most: one in a hundred of the accepted has more.
const MOST_DEPOSITS: usize = 4;

/// What a photon left: energy, eV, and place beside the straight way in its plane and across, and depth, m. Unused ones left nothing.
type Track = [[f32; 4]; MOST_DEPOSITS];

/// One cell.
#[derive(Clone, Debug, Default)]
struct Cell {
    accepted: f64,
    tracks: Vec<Track>,
}

/// Where a photon is placed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    /// The crystal that fires.
    pub crystal: (u32, u32),
    /// Mean place in it, weighted with energy, block coordinates, m.
    pub place_block_m: Vector3<f64>,
}

/// The table.
#[derive(Clone, Debug)]
pub(super) struct Response {
    grid: CrystalGrid,
    kill_ev: f64,
    cells: Vec<Cell>,
    /// Cosines of the angles between cells.
    cosines: [f64; ANGLES - 1],
    /// The largest acceptance of each energy.
    most: [f64; ENERGIES],
    /// The largest at 511 keV up to and with each angle.
    most_within: [f64; ANGLES],
}

impl Response {
    /// Makes the table; the same for the same scanner and scintillator.
    pub fn new(scanner: &Scanner, physics: &BlockPhysics, kill_ev: f64) -> Self {
        let streams = RandomStreams::new(0, 0, "pet-tables");
        let cosines = std::array::from_fn(|cell| (LARGEST_RAD * (cell + 1) as f64 / ANGLES as f64).cos());
        let mut table = Self {
            cosines,
            grid: scanner.grid,
            kill_ev,
            cells: Vec::new(),
            most: [0.0; ENERGIES],
            most_within: [0.0; ANGLES],
        };
        for index in 0..ENERGIES * ANGLES * ENTRIES {
            let mut random = streams.stream("response", index as u64);
            let cell = table.fill(scanner, physics, index, &mut random);
            let most = &mut table.most[index % ENERGIES];
            *most = most.max(cell.accepted);
            if index % ENERGIES == ENERGIES - 1 {
                let angle = index / ENERGIES % ANGLES;
                for most in &mut table.most_within[angle..] {
                    *most = most.max(cell.accepted);
                }
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
        let (angle, kind) = (rest % ANGLES, rest / ANGLES);
        if !self.has(kind) {
            return Cell::default();
        }
        let (mut cell, mut accepted) = (Cell::default(), 0);
        let is_at_511 = energy == ENERGIES - 1;
        let makes_most = is_at_511 && kind == ENTRIES - 1 && angle < STEEP;
        let (photons, most) = if makes_most { (PHOTONS_OF_MOST, TRACKS_OF_MOST) } else { (PHOTONS, TRACKS) };
        let mut left: Vec<(f64, Vector3<f64>)> = Vec::new();
        for _ in 0..photons {
            let energy_ev = if is_at_511 {
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
            let entry = self.entry(kind, &direction, random);
            let mut photon = Photon::emitted(entry - direction * 1e-6, direction, energy_ev);
            left.clear();
            let tell = |energy_ev: f64, place_m: &Vector3<f64>| left.push((energy_ev, *place_m));
            let Some(deposit) = physics.respond_telling(&mut photon, random, tell) else { continue };
            if passes_window(&scanner.detection, deposit.energy_ev, random) {
                accepted += 1;
                if cell.tracks.len() == most {
                    continue;
                }
                left.sort_by(|a, b| b.0.total_cmp(&a.0));
                let (c, s) = (turn.cos(), turn.sin());
                let mut track = Track::default();
                for (to, (energy_ev, place_m)) in track.iter_mut().zip(&left) {
                    let moved = place_m - entry;
                    let along_m = moved.x * c + moved.y * s - moved.z * sin / cos;
                    *to = [*energy_ev, along_m, moved.y * c - moved.x * s, moved.z].map(|v| v as f32);
                }
                cell.tracks.push(track);
            }
        }
        cell.accepted = f64::from(accepted) / photons as f64;
        cell
    }

    /// Whether the block is large enough to have a place of a kind.
    fn has(&self, kind: usize) -> bool {
        let nearest_m = kind.checked_sub(2).map_or(0.0, |further| EDGES_M[further / 2]);
        self.grid.half_width_m().min(self.grid.half_length_m()) > nearest_m
    }

    /// A place on the face where a photon of this direction is of a kind; anywhere where the block has no such place.
    fn entry(&self, kind: usize, direction: &Vector3<f64>, random: &mut RandomStream) -> Vector3<f64> {
        let (w, l) = (self.grid.half_width_m(), self.grid.half_length_m());
        let mut place = Vector3::zeros();
        for _ in 0..10_000 {
            place = Vector3::new(
                w * (2.0 * random.random::<f64>() - 1.0),
                l * (2.0 * random.random::<f64>() - 1.0),
                0.0,
            );
            if self.kind_of(&place, direction) == kind {
                break;
            }
        }
        place
    }

    /// Near which edge a photon enters, and whether it heads for it.
    fn kind_of(&self, entry_m: &Vector3<f64>, direction: &Vector3<f64>) -> usize {
        let away_m =
            [self.grid.half_width_m() - entry_m.x.abs(), self.grid.half_length_m() - entry_m.y.abs()];
        let axis = usize::from(away_m[1] < away_m[0]);
        let Some(near) = EDGES_M.iter().position(|end_m| away_m[axis] < *end_m) else { return ENTRIES - 1 };
        2 * near + usize::from(direction[axis] * entry_m[axis] < 0.0)
    }

    /// The largest acceptance at 511 keV of photons that come in under at most an angle, told by its cosine.
    pub fn most_at_511_within(&self, cosine: f64) -> f64 {
        self.most_within[self.angle(cosine)]
    }

    /// The largest acceptance at an energy.
    pub fn most_at(&self, energy_ev: f64) -> f64 {
        self.most[self.energy(energy_ev)]
    }

    /// The largest acceptance at an energy or below.
    pub fn most_up_to(&self, energy_ev: f64) -> f64 {
        self.most[..=self.energy(energy_ev)].iter().copied().fold(0.0, f64::max)
    }

    /// The cell over energy.
    fn energy(&self, energy_ev: f64) -> usize {
        if energy_ev > ELECTRON_REST_ENERGY_EV * (1.0 - 1e-9) {
            return ENERGIES - 1;
        }
        let part = (energy_ev - self.kill_ev) / (ELECTRON_REST_ENERGY_EV - self.kill_ev);
        ((part * (ENERGIES - 1) as f64).max(0.0) as usize).min(ENERGIES - 2)
    }

    /// The cell over the angle of incidence.
    fn angle(&self, cosine: f64) -> usize {
        self.cosines.iter().filter(|end| cosine <= **end).count()
    }

    /// The cell of a photon that enters at a place (block coordinates).
    fn cell(&self, photon: &Photon) -> &Cell {
        let angle = self.angle(photon.direction.z);
        let energy = self.energy(photon.energy_ev);
        &self.cells[(self.kind_of(&photon.place_m, &photon.direction) * ANGLES + angle) * ENERGIES + energy]
    }

    /// Where a photon (block coordinates, at its entry) is placed; `None` where it is not accepted. `given` is the probability with which
    /// photons that get here were already chosen: at least the acceptance of their cell.
    pub fn draw(&self, photon: &Photon, given: f64, random: &mut RandomStream) -> Option<Placed> {
        let cell = self.cell(photon);
        debug_assert!(cell.accepted <= given * (1.0 + 1e-9), "{} of {given}", cell.accepted);
        if random.random::<f64>() * given >= cell.accepted || cell.tracks.is_empty() {
            return None;
        }
        self.place(photon, &cell.tracks[random.random_range(0..cell.tracks.len())])
    }

    /// The crystal with most of a track's energy, laid along a photon's way; `None` where all of it lies beside the block.
    fn place(&self, photon: &Photon, track: &Track) -> Option<Placed> {
        let (x, y) = (photon.direction.x, photon.direction.y);
        let sin = (x * x + y * y).sqrt();
        // Nearly along the face the straight way has no end: as at the largest angle of the table.
        let slope = sin / photon.direction.z.max(LARGEST_RAD.cos());
        let (c, s) = if sin > 0.0 { (x / sin, y / sin) } else { (1.0, 0.0) };
        let mut sums = [((0, 0), 0.0, Vector3::zeros()); MOST_DEPOSITS];
        let mut used = 0;
        for deposit in track {
            let [energy_ev, along_m, across_m, depth_m] = deposit.map(f64::from);
            let along_m = along_m + depth_m * slope;
            let place_m = Vector3::new(
                photon.place_m.x + along_m * c - across_m * s,
                photon.place_m.y + along_m * s + across_m * c,
                depth_m,
            );
            let Some(crystal) = self.grid.cell(place_m.x, place_m.y).filter(|_| energy_ev > 0.0) else {
                continue;
            };
            let slot = sums[..used].iter().position(|sum| sum.0 == crystal).unwrap_or(used);
            used = used.max(slot + 1);
            sums[slot] = (crystal, sums[slot].1 + energy_ev, sums[slot].2 + place_m * energy_ev);
        }
        let (crystal, energy_ev, moment) = sums[..used].iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Placed { crystal: *crystal, place_block_m: moment / *energy_ev })
    }
}
