//! Covariance of a line's offset from its marker, per line, from the scanner's geometry.
//!
//! Each end of a line is told wrongly: by the crystal's size, by the depth that is not measured, by photons that scatter from one
//! crystal into another. In the frame of its block (tangential, axial, depth) the error of one end is a mixture of two normal laws,
//! core `S_c` and tail `S_t` (share τ of the tail). A line has two independent ends, hence three components:
//!
//! ```text
//! both core  (1-τ)²     wa S_c,a + wb S_c,b
//! one tail   2τ(1-τ)    the mean of the other two
//! both tail  τ²         wa S_t,a + wb S_t,b            wa = (1-s)², wb = s²,  s = place along the line
//! ```
//!
//! each projected perpendicular to the line, plus what the source adds: `(positron range + core)` and acollinearity
//! `σ_α² (L s (1-s))²` for a line of length L (a photon that leaves at an angle δ to the other shifts the line by `δ d_a d_b / L`).
//!
//! S and τ come from the scanner's file: [`BlockErrors::of_block`] sends photons from about the scanner's middle into one block of its
//! scintillator ([`crate::simulation::deposits`], fixed seed), takes the error of the told place from where the photon's way is as deep
//! as the deposit, and fits both laws ([`BlockNoise::of_samples`]). From the same errors it is told how much of a line's information
//! counts ([`LineNoise::information_share`]) and how far the lines of a source lie beside it where the scanner sees less on one side
//! ([`LineNoise::beside`]). No label of any simulated or recorded line enters. [`BlockNoise::reference`] holds an independent study's
//! numbers for 4 x 6 x 20 mm GSO crystals.

mod block;
mod errors;
mod field;

pub use block::BlockNoise;
pub use errors::BlockErrors;

use super::lanes::{Four, LANES, Three, lanes};
use crate::coverage::Coverage;
use crate::markers::MarkerSet;
use crate::scanner::{Block, Scanner};
use crate::simulation::SourceMarker;
use errors::Calibration;
use field::Beside;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// Components of a line's noise.
pub const COMPONENTS: usize = 3;
/// FWHM over standard deviation of a normal law.
pub const FWHM_PER_SD: f64 = 2.354820045030949;
/// Acollinearity of photons from positrons that stop in water, FWHM, rad: 0.5 degrees (Colombino et al. 1965, Nuovo Cimento 38).
pub const ACOLLINEARITY_FWHM_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Lines that pass the markers' centroid within this are looked at, m; among them the background is even. Scattered and random lines
/// pass at 20, 33, 53, 74, 91 mm (10 to 90 per cent, reduced scanner) or further (full ring), so their density over 30 mm varies
/// by a tenth; 99 of 100 true lines pass within 20 mm of the triangle's centroid.
pub const BACKGROUND_RADIUS_M: f64 = 0.030;
/// Beyond this from the outermost marker's reach passes one true line in a hundred, m.
const MARGIN_M: f64 = 0.015;
/// Share of the background lines that pass within [`BACKGROUND_RADIUS_M`] of the markers, reduced scanner: even density between the
/// quantiles above, and Rayleigh's law of 45 mm. On a full ring it is smaller.
pub const BACKGROUND_NEAR: f64 = 0.20;
/// Variance per axis that Na-22's positron range and a core of 0.25 to 0.5 mm add, m²: reference A.
pub const SODIUM_SOURCE_VARIANCE_M2: f64 = 0.12e-6;

/// Slots of the table from a place's direction to its block.
const SLOTS: usize = 2048;

/// The noise of all lines of a scanner.
#[derive(Clone, Debug, PartialEq)]
pub struct LineNoise {
    /// Core and tail covariance per block, world, m²: xx, xy, xz, yy, yz, zz.
    covariances: Vec<([f64; 6], [f64; 6])>,
    /// Block by direction from the scanner's axis; empty where blocks do not stand on a ring.
    slots: Vec<u32>,
    heads: Scanner,
    coverage: Arc<Coverage>,
    beside: Beside,
    /// What counts of what a line says, above 0 to 1: of a law that is not exact the variance J of the score is not the information I, and
    /// covariances taken from the information are too small by I/J. So the information, and the score with it, is taken at this
    /// share `I/J`.
    pub information_share: f64,
    /// Shares of the three components.
    pub component_shares: [f64; COMPONENTS],
    /// Variance per axis that the source adds, m².
    pub source_variance_m2: f64,
    /// Standard deviation of the angle between the photons per axis, rad.
    pub acollinearity_sd_rad: f64,
    /// Lines within this of the markers' centroid are looked at, and background is even among them, m.
    pub background_radius_m: f64,
}

/// What is not the scanner's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceNoise {
    /// Variance per axis of the annihilations about their marker's centre, m².
    pub variance_m2: f64,
    /// FWHM of the angle between the photons, rad.
    pub acollinearity_fwhm_rad: f64,
    /// Lines within this of the markers' centroid are looked at, and background is even among them, m.
    pub background_radius_m: f64,
}

impl SourceNoise {
    /// Of the markers as installed: the mean of their annihilations' variances, by activity.
    pub fn of_markers(markers: &[SourceMarker]) -> Self {
        let activity_bq: f64 = markers.iter().map(|marker| marker.activity_bq).sum();
        let weighted: f64 = markers.iter().map(|marker| marker.activity_bq * marker.variance_m2()).sum();
        let variance_m2 = if activity_bq > 0.0 { weighted / activity_bq } else { SODIUM_SOURCE_VARIANCE_M2 };
        Self { variance_m2, ..Self::default() }
    }
}

impl Default for SourceNoise {
    fn default() -> Self {
        Self {
            variance_m2: SODIUM_SOURCE_VARIANCE_M2,
            acollinearity_fwhm_rad: ACOLLINEARITY_FWHM_RAD,
            background_radius_m: BACKGROUND_RADIUS_M,
        }
    }
}

impl LineNoise {
    /// The noise of a scanner's lines as its blocks' physics makes them.
    pub fn of_block(scanner: &Scanner, errors: &BlockErrors, source: &SourceNoise) -> Self {
        Self::calibrated(scanner, &errors.law, source, &errors.calibrate(source))
    }

    /// The noise of lines whose ends all err as `block` says, exactly, and of which none is lost: what this law itself draws.
    pub fn of_law(scanner: &Scanner, block: &BlockNoise, source: &SourceNoise) -> Self {
        Self::calibrated(scanner, block, source, &Calibration::EXACT)
    }

    fn calibrated(
        scanner: &Scanner,
        block: &BlockNoise,
        source: &SourceNoise,
        calibration: &Calibration,
    ) -> Self {
        let t = block.tail_share;
        let coverage = Arc::new(Coverage::new(scanner));
        Self {
            covariances: covariances(scanner, block),
            slots: slots(scanner),
            heads: scanner.clone(),
            beside: Beside::new(scanner, coverage.clone(), calibration),
            coverage,
            information_share: calibration.information_share,
            component_shares: [(1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t],
            source_variance_m2: source.variance_m2,
            acollinearity_sd_rad: source.acollinearity_fwhm_rad / FWHM_PER_SD,
            background_radius_m: source.background_radius_m,
        }
    }

    /// The same in another scanner of the same blocks, for plans: these ask what lines say, and not where they lie.
    #[must_use]
    pub fn of_other_blocks(&self, scanner: &Scanner, block: &BlockNoise) -> Self {
        let coverage = Arc::new(Coverage::new(scanner));
        Self {
            covariances: covariances(scanner, block),
            slots: slots(scanner),
            heads: scanner.clone(),
            beside: Beside::new(scanner, coverage.clone(), &Calibration::EXACT),
            coverage,
            ..*self
        }
    }

    /// What the scanner sees of a point.
    pub fn coverage(&self) -> &Arc<Coverage> {
        &self.coverage
    }

    /// How far the lines that the scanner sees of a source lie beside it, in the mean, m: where it sees less on one side, lines are seen
    /// rather on the other. Zero where nothing is known of the scanner's field.
    pub fn beside(&self, place_scanner_m: &Vector3<f64>) -> Vector3<f64> {
        self.beside.at(place_scanner_m)
    }

    /// With the region of even background widened, where a marker set is so large: lines that pass the outermost marker at less than 5 mm
    /// plus 15 mm are looked at.
    #[must_use]
    pub fn wide_enough_for(self, set: &MarkerSet) -> Self {
        let least_m = super::body::Body::new(set).spared_m + MARGIN_M;
        Self { background_radius_m: self.background_radius_m.max(least_m), ..self }
    }

    /// The blocks whose frames four places, in the scanner's frame, are told in.
    #[inline(always)]
    pub(crate) fn blocks_at(&self, places_scanner_m: &Three) -> [u32; LANES] {
        if self.slots.is_empty() {
            return self.nearest_blocks(places_scanner_m);
        }
        let slots = slots_of(places_scanner_m[0], places_scanner_m[1]);
        lanes!(lane => self.slots[slots[lane]])
    }

    fn nearest_blocks(&self, places_scanner_m: &Three) -> [u32; LANES] {
        std::array::from_fn(|lane| {
            let place = Vector3::from(places_scanner_m.map(|axis| axis.0[lane]));
            self.heads.nearest_block(&place) as u32
        })
    }

    #[inline(always)]
    pub(crate) fn end_covariances(&self, block: u32) -> (&[f64; 6], &[f64; 6]) {
        let (core, tail) = &self.covariances[block as usize];
        (core, tail)
    }
}

/// Core and tail of each block's ends, world, m²: xx, xy, xz, yy, yz, zz.
fn covariances(scanner: &Scanner, law: &BlockNoise) -> Vec<([f64; 6], [f64; 6])> {
    let of_block = |b: &Block| {
        let axes = Matrix3::from_columns(&[b.tangential, b.axial, b.outward]);
        let turned = |v: &[f64; 3]| {
            let c = axes * Matrix3::from_diagonal(&Vector3::from(*v)) * axes.transpose();
            [c[(0, 0)], c[(0, 1)], c[(0, 2)], c[(1, 1)], c[(1, 2)], c[(2, 2)]]
        };
        (turned(&law.core_m2), turned(&law.tail_m2))
    };
    scanner.blocks.iter().map(of_block).collect()
}

/// Which slots four directions from the axis fall into: the "diamond angle", which grows with the angle and needs no arc tangent.
#[inline(always)]
fn slots_of(x: Four, y: Four) -> [usize; LANES] {
    let sum = (-x).max(x) + (-y).max(y);
    let around = x / sum.max(Four::splat(f64::MIN_POSITIVE));
    let turn = y.less_select(Four::ZERO, Four::splat(3.0) - around, Four::splat(1.0) + around);
    let slots = turn * Four::splat(SLOTS as f64 / 4.0);
    lanes!(lane => (slots.0[lane] as usize).min(SLOTS - 1))
}

/// Block by slot, where all blocks stand upright on rings about the axis, so that a direction tells the frame.
fn slots(scanner: &Scanner) -> Vec<u32> {
    let on_a_ring = |b: &Block| {
        let across = Vector3::new(b.centre_world_m.x, b.centre_world_m.y, 0.0);
        b.axial.z.abs() > 1.0 - 1e-9 && across.cross(&b.outward).norm() < 1e-9 && across.dot(&b.outward) > 0.0
    };
    if !scanner.blocks.iter().all(on_a_ring) {
        return Vec::new();
    }
    let mut table = vec![0; SLOTS];
    for (slot, block) in table.iter_mut().enumerate() {
        // The middle of the slot, on the diamond.
        let turn = (slot as f64 + 0.5) * 4.0 / SLOTS as f64;
        let (x, y) = if turn < 2.0 {
            (turn - 1.0, 1.0 - (turn - 1.0).abs())
        } else {
            (3.0 - turn, (3.0 - turn).abs() - 1.0)
        };
        let direction = Vector3::new(x, y, 0.0).normalize();
        let facing = |b: usize| scanner.blocks[b].outward.dot(&direction);
        *block =
            (0..scanner.blocks.len()).max_by(|a, b| facing(*a).total_cmp(&facing(*b))).unwrap_or(0) as u32;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scanner::CrystalIndex;
    use crate::tracking::lanes::splat3;
    use lumenav_core::Node;
    use std::path::Path;

    fn shipped(name: &str) -> Scanner {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners");
        Scanner::from_node(&Node::open(&folder.join(format!("{name}.toml"))).unwrap()).unwrap()
    }

    #[test]
    fn law_the_table_finds_the_block_of_every_crystal() {
        for name in ["allegro", "tf64", "reduced"] {
            let scanner = shipped(name);
            let noise = LineNoise::of_law(&scanner, &BlockNoise::reference(), &SourceNoise::default());
            let mut wrong = 0;
            for x in 0..scanner.blocks.len() as u32 * scanner.grid.columns {
                let crystal = CrystalIndex { x, z: 3 };
                let place = scanner.position(crystal).unwrap();
                let found = noise.blocks_at(&splat3(&place))[2];
                wrong += usize::from(scanner.block_of(crystal) != Some(found as usize));
            }
            // The border between two blocks falls into one slot of 0.18 degrees: a crystal beside it may be told in its neighbour's frame.
            assert!(wrong <= scanner.blocks.len(), "{name}: {wrong}");
        }
    }
}
