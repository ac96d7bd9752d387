//! What a detector block makes of one photon.
//!
//! The photon is followed through the block's crystals: Compton scattering and photoelectric absorption there, nothing in the gaps
//! between them (Woodcock's method, 1965: a collision that falls into a gap is none). The block sums the energies, and the crystal
//! of the largest deposit gives the place. Most photons of 511 keV scatter first (in GSO three of four), so the largest deposit often
//! lies some crystals away from where the photon came in: the heavy tail of line offsets comes from here.
//!
//! Block coordinates: `(h, z, depth)` along columns, rows, and into the block from its face ([`Scanner::to_block`]), m. Neglected:
//! paths of electrons, fluorescence, optical cross-talk between crystals.

use super::photon::{Photon, free_path};
use super::scintillator::Scintillator;
use crate::scanner::{CrystalGrid, Detection, Scanner};
use nalgebra::Vector3;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// A photon of less energy ends where it is: its free path in any scintillator is below 0.1 mm. eV.
const LOCAL_EV: f64 = 20e3;
/// Deposits that are told apart; a photon of 1.3 MeV has scattered below [`LOCAL_EV`] or left long before.
const MAX_DEPOSITS: usize = 24;
/// FWHM of a Gaussian over its standard deviation, `2 sqrt(2 ln 2)`.
pub const FWHM_PER_SIGMA: f64 = 2.354_820_045_030_949_3;

/// Ends of steps over the distance of an entry from its block's nearest edge, m: most photons that scatter stop within 10 mm.
pub const EDGES_M: [f64; 2] = [3e-3, 9e-3];
/// Half the side of the cube about the scanner's middle where capsules are, m.
pub const FIELD_M: f64 = 0.1;

/// What a block saw of one photon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deposit {
    /// Sum of all energy left in the block, eV.
    pub energy_ev: f64,
    /// Column and row of the crystal of the largest deposit.
    pub crystal: (u32, u32),
    /// Energy left in that crystal, eV.
    pub crystal_energy_ev: f64,
    /// Mean place in that crystal, weighted with energy, block coordinates, m.
    pub place_block_m: Vector3<f64>,
    /// Way of the photon from its emission to its first interaction here, m.
    pub path_m: f64,
}

/// Physics of one block of a scanner.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockPhysics {
    grid: CrystalGrid,
    scintillator: Scintillator,
    half_m: [f64; 2],
}

/// Energy by crystal, of one photon.
struct Crystals {
    cells: [(u32, u32); MAX_DEPOSITS],
    energies_ev: [f64; MAX_DEPOSITS],
    moments: [Vector3<f64>; MAX_DEPOSITS],
    used: usize,
}

impl Crystals {
    fn new() -> Self {
        Self {
            cells: [(0, 0); MAX_DEPOSITS],
            energies_ev: [0.0; MAX_DEPOSITS],
            moments: [Vector3::zeros(); MAX_DEPOSITS],
            used: 0,
        }
    }

    fn add(&mut self, cell: (u32, u32), energy_ev: f64, place_m: &Vector3<f64>) {
        let slot = match self.cells[..self.used].iter().position(|c| *c == cell) {
            Some(slot) => slot,
            None if self.used < MAX_DEPOSITS => {
                self.cells[self.used] = cell;
                self.energies_ev[self.used] = 0.0;
                self.moments[self.used] = Vector3::zeros();
                self.used += 1;
                self.used - 1
            }
            None => MAX_DEPOSITS - 1,
        };
        self.energies_ev[slot] += energy_ev;
        self.moments[slot] += place_m * energy_ev;
    }

    fn largest(&self) -> Option<usize> {
        (0..self.used).max_by(|a, b| self.energies_ev[*a].total_cmp(&self.energies_ev[*b]))
    }
}

impl BlockPhysics {
    /// Blocks of a scanner, made of a scintillator.
    pub fn new(scanner: &Scanner, scintillator: Scintillator) -> Self {
        let grid = scanner.grid;
        Self { half_m: [grid.half_width_m(), grid.half_length_m()], grid, scintillator }
    }

    /// Entry and exit of a ray through the block, through any of its six sides, as distances along `direction`, m; `None` where it
    /// misses or the block lies behind. The entry is 0 for a photon inside. Block coordinates.
    pub fn chord_m(&self, place_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64)> {
        let half_depth_m = 0.5 * self.grid.depth_m;
        let half = [self.half_m[0], self.half_m[1], half_depth_m];
        let from_middle = [place_m.x, place_m.y, place_m.z - half_depth_m];
        let (mut near_m, mut far_m) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            if direction[axis] == 0.0 {
                if from_middle[axis].abs() > half[axis] {
                    return None;
                }
                continue;
            }
            let inverse = 1.0 / direction[axis];
            let (middle_m, reach_m) = (-from_middle[axis] * inverse, half[axis] * inverse.abs());
            near_m = near_m.max(middle_m - reach_m);
            far_m = far_m.min(middle_m + reach_m);
        }
        (near_m < far_m).then_some((near_m, far_m))
    }

    /// Whether a ray from before the face certainly passes beside the block: it meets the face's plane further out than its depth could bring
    /// it in. Told without a division; block coordinates.
    pub fn is_missed_from_the_front(&self, place_m: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
        direction.z > 0.0 && self.is_missed_from_about(place_m, direction, (0.0, 0.0))
    }

    /// As [`Self::is_missed_from_the_front`], of all rays that start within a distance, m, and differ in direction by at most an angle, rad.
    #[inline]
    pub fn is_missed_from_about(
        &self,
        place_m: &Vector3<f64>,
        direction: &Vector3<f64>,
        (within_m, within_rad): (f64, f64),
    ) -> bool {
        let before_m = -place_m.z;
        if before_m < within_m {
            return false;
        }
        let inward = direction.z + within_rad;
        inward <= 0.0
            || (0..2).any(|axis| {
                let on_plane = (place_m[axis] * direction.z + direction[axis] * before_m).abs();
                // Of h n + v b, which is where the ray meets the plane times n: a turn moves v and n, a start anywhere in the ball h and b.
                let moved =
                    within_rad * (place_m[axis].abs() + before_m) + within_m * (1.0 + 2.0 * within_rad);
                let reach = (direction[axis].abs() + within_rad) * self.grid.depth_m;
                on_plane - moved > self.half_m[axis] * inward + reach
            })
    }

    /// Column and row of the crystal that holds a place; `None` in a gap or beside the block.
    fn crystal(&self, place_m: &Vector3<f64>) -> Option<(u32, u32)> {
        let index = |along_m: f64, pitch_m: f64, size_m: f64, count: u32| {
            let place = along_m / pitch_m + 0.5 * f64::from(count);
            if !(place >= 0.0 && place < f64::from(count)) {
                return None;
            }
            let cell = place as u32;
            let is_inside = (place - f64::from(cell) - 0.5).abs() * pitch_m <= 0.5 * size_m;
            is_inside.then_some(cell)
        };
        let g = &self.grid;
        Some((
            index(place_m.x, g.tangential_pitch_m, g.tangential_m, g.columns)?,
            index(place_m.y, g.axial_pitch_m, g.axial_m, g.rows)?,
        ))
    }

    /// Follows a photon (block coordinates) through the block. What it left there; `None` where it passed or missed. Afterwards
    /// `photon` is what leaves the block: of energy 0 where nothing does, untouched where it missed.
    pub fn respond<R: Rng + ?Sized>(&self, photon: &mut Photon, random: &mut R) -> Option<Deposit> {
        self.respond_telling(photon, random, |_, _| ())
    }

    /// As [`Self::respond`], telling the energy, eV, and the place of each interaction.
    pub(super) fn respond_telling<R: Rng + ?Sized>(
        &self,
        photon: &mut Photon,
        random: &mut R,
        mut tell: impl FnMut(f64, &Vector3<f64>),
    ) -> Option<Deposit> {
        let (near_m, mut far_m) = self.chord_m(&photon.place_m, &photon.direction)?;
        let before = *photon;
        photon.advance(near_m);
        far_m -= near_m;
        let mut crystals = Crystals::new();
        let mut first_path_m = None;
        let [mut total_per_m, mut compton_per_m] = self.scintillator.attenuation_per_m(photon.energy_ev);
        loop {
            let step_m = free_path(random) / total_per_m;
            if step_m >= far_m {
                if first_path_m.is_none() {
                    *photon = before;
                }
                break;
            }
            photon.advance(step_m);
            far_m -= step_m;
            let Some(cell) = self.crystal(&photon.place_m) else { continue };
            first_path_m.get_or_insert(photon.path_m);
            let absorbed = random.random::<f64>() * total_per_m >= compton_per_m;
            let place_m = photon.place_m;
            let left_ev = if absorbed { photon.energy_ev } else { photon.scatter(random) };
            let is_last = absorbed || photon.energy_ev < LOCAL_EV;
            let all_ev = if is_last && !absorbed { left_ev + photon.energy_ev } else { left_ev };
            crystals.add(cell, all_ev, &place_m);
            tell(all_ev, &place_m);
            if is_last {
                photon.energy_ev = 0.0;
                break;
            }
            [total_per_m, compton_per_m] = self.scintillator.attenuation_per_m(photon.energy_ev);
            // Inside a convex block there is always a way out; rounding at the surface counts as outside.
            match self.chord_m(&photon.place_m, &photon.direction) {
                Some((_, out_m)) => far_m = out_m,
                None => break,
            }
        }
        let winner = crystals.largest()?;
        let crystal_energy_ev = crystals.energies_ev[winner];
        Some(Deposit {
            energy_ev: crystals.energies_ev[..crystals.used].iter().sum(),
            crystal: crystals.cells[winner],
            crystal_energy_ev,
            place_block_m: crystals.moments[winner] / crystal_energy_ev,
            path_m: first_path_m.unwrap_or(photon.path_m),
        })
    }
}

/// Standard deviation of a measured energy, eV: the resolution at 511 keV, falling with the root of the energy.
pub fn energy_sigma_ev(detection: &Detection, energy_ev: f64) -> f64 {
    let reference_ev = super::compton::ELECTRON_REST_ENERGY_EV;
    detection.energy_resolution * (energy_ev * reference_ev).sqrt() / FWHM_PER_SIGMA
}

/// Whether a deposit, measured with its blur, passes the energy window.
pub fn passes_window<R: Rng + ?Sized>(detection: &Detection, energy_ev: f64, random: &mut R) -> bool {
    let noise: f64 = random.sample(StandardNormal);
    let measured_ev = energy_ev + energy_sigma_ev(detection, energy_ev) * noise;
    (detection.energy_window_ev[0]..=detection.energy_window_ev[1]).contains(&measured_ev)
}

/// Energy of which a full deposit lies four standard deviations below the energy window: photons of less are given up, eV. For the
/// Allegro's window and resolution 330 keV.
pub fn kill_energy_ev(detection: &Detection) -> f64 {
    // E + 4 c sqrt(E) = low, a quadratic equation in sqrt(E).
    let c = 4.0 * energy_sigma_ev(detection, 1.0);
    let low_ev = detection.energy_window_ev[0];
    let root = -0.5 * c + (0.25 * c * c + low_ev).sqrt();
    root * root
}

#[cfg(test)]
mod tests;
