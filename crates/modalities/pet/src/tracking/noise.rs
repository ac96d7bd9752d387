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
//! S and τ come from the scanner's file: [`BlockNoise::of_block`] sends photons from about the scanner's middle into one block of its
//! scintillator ([`crate::simulation::deposits`], fixed seed), takes the error of the told place from where the photon's way is as deep
//! as the deposit, fits both laws ([`BlockNoise::of_samples`]) and tells how much of its information counts
//! ([`BlockNoise::information_share`]). No label of any
//! simulated or recorded line enters. [`BlockNoise::reference`] holds an independent study's numbers for 4 x 6 x 20 mm GSO crystals.

use super::lanes::{Four, LANES, Three, lanes};
use crate::coverage::Coverage;
use crate::markers::MarkerSet;
use crate::scanner::Scanner;
use crate::simulation::deposits::{SampledDeposit, sampled_deposits};
use crate::simulation::{EndPoints, Scintillator, SourceMarker};
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::{Matrix3, Vector3};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
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

/// How wrongly one end of a line is told, in the frame of its block.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockNoise {
    /// Share of the tail.
    pub tail_share: f64,
    /// Variances of the core: tangential, axial, depth, m².
    pub core_m2: [f64; 3],
    /// Variances of the tail: tangential, axial, depth, m².
    pub tail_m2: [f64; 3],
    /// What counts of what a line says, above 0 to 1. No mixture of two normal laws is the law of crystals, which are flat; of a law that is not
    /// exact the variance J of the score is not the information I, and covariances taken from the information are too small by I/J
    /// (White 1982). So the information, and the score with it, is taken at this share `I/J`.
    pub information_share: f64,
}

impl BlockNoise {
    /// GSO crystals of 4 x 6 x 20 mm: `0.75 N(S) + 0.25 N(11 S)`, S = 2.0, 4.4, 44 mm² (reference A, a Monte Carlo of the block).
    pub fn reference() -> Self {
        let core_m2 = [2.0e-6, 4.4e-6, 44e-6];
        Self { tail_share: 0.25, core_m2, tail_m2: core_m2.map(|v| 11.0 * v), information_share: 1.0 }
    }

    /// From the physics of a scanner's blocks (all alike): see the head of this file. The same file gives the same numbers.
    /// Without crystals the file's resolution is added, and the depth is not told.
    pub fn of_block(scanner: &Scanner, scintillator: &Scintillator, end_points: EndPoints) -> Self {
        let mut random = RandomStreams::new(0, 0, "pet-line-noise").stream("told", 0);
        let deposits = sampled_deposits(scanner, scintillator);
        let errors: Vec<_> =
            deposits.iter().map(|sample| error_of(scanner, end_points, sample, &mut random)).collect();
        let fit = Self::of_samples(&errors).map(|fit| {
            // Ends that are told as they are: what is left beside photons that scattered is the source's own spread.
            if end_points == EndPoints::Continuous && scanner.detection.position_fwhm_m.is_none() {
                return fit;
            }
            let length_m = 2.0 * (scanner.blocks[0].centre_world_m.norm() + scanner.told_depth_m());
            let information_share = fit.information_share_of(&errors, round_m2(length_m), &mut random);
            Self { information_share, ..fit }
        });
        // A block that stops next to nothing tells next to nothing: then the crystal's own size.
        fit.unwrap_or_else(|| {
            let g = &scanner.grid;
            let core_m2 = [g.tangential_pitch_m, g.axial_pitch_m, g.depth_m].map(|v| v * v / 12.0);
            Self { tail_share: 0.0, core_m2, tail_m2: core_m2, information_share: 1.0 }
        })
    }

    /// A detector without crystals: one normal law of the given resolution across, and a depth that is not told.
    pub fn of_resolution(fwhm_m: f64, depth_m: f64) -> Self {
        let across = (fwhm_m / FWHM_PER_SD).powi(2);
        let core_m2 = [across, across, depth_m * depth_m / 12.0];
        Self { tail_share: 0.0, core_m2, tail_m2: core_m2, information_share: 1.0 }
    }

    /// Fits core and tail to errors `(tangential, axial, depth)` of single ends, m: EM on a mixture of two centred normal laws with
    /// diagonal covariances, from the quartile's spread as core and four times the rest as tail. `None` for fewer than 100 samples.
    pub fn of_samples(errors_block_m: &[Vector3<f64>]) -> Option<Self> {
        if errors_block_m.len() < 100 {
            return None;
        }
        let moment = |i: usize| {
            let mean = errors_block_m.iter().map(|e| e[i] * e[i]).sum::<f64>() / errors_block_m.len() as f64;
            mean.max(SMALLEST_VARIANCE_M2)
        };
        let whole = [moment(0), moment(1), moment(2)];
        let mut fit = Self {
            tail_share: 0.25,
            core_m2: whole.map(|v| 0.3 * v),
            tail_m2: whole.map(|v| 3.0 * v),
            information_share: 1.0,
        };
        for _ in 0..EM_STEPS {
            fit = fit.em_step(errors_block_m);
        }
        Some(fit)
    }

    /// What a line says of its information: see [`Self::information_share`]. Of lines of two ends each through a source in the middle that
    /// spreads by `round_m2` per axis; trace, each axis by its own information.
    fn information_share_of(
        &self,
        errors_block_m: &[Vector3<f64>],
        round_m2: f64,
        random: &mut RandomStream,
    ) -> f64 {
        let laws = self.laws_of_lines(round_m2);
        let (mut squares, mut information) = ([0.0; 2], [0.0; 2]);
        let ends = errors_block_m.len();
        let pairs =
            (1..=PARTNERS).flat_map(|k| (0..ends).map(move |i| (i, (i + k * ends / (PARTNERS + 1)) % ends)));
        for (a, b) in pairs.map(|(a, b)| (&errors_block_m[a], &errors_block_m[b])) {
            let u: [f64; 2] = std::array::from_fn(|axis| {
                let blur: f64 = random.sample(StandardNormal);
                0.5 * (a[axis] + b[axis]) + round_m2.sqrt() * blur
            });
            let (mut density, mut slope, mut bend) = (0.0, [0.0; 2], [0.0; 2]);
            for (share, variances) in &laws {
                let q = u[0] * u[0] / variances[0] + u[1] * u[1] / variances[1];
                let weight = share * (-0.5 * q).exp() / (variances[0] * variances[1]).sqrt();
                density += weight;
                for axis in 0..2 {
                    let pull = u[axis] / variances[axis];
                    slope[axis] += weight * pull;
                    bend[axis] += weight * (pull * pull - 1.0 / variances[axis]);
                }
            }
            // Beyond what an exponential can hold there is no score.
            for axis in 0..2 {
                let score = if density > 0.0 { slope[axis] / density } else { 0.0 };
                squares[axis] += score * score;
                information[axis] += score * score - if density > 0.0 { bend[axis] / density } else { 0.0 };
            }
        }
        let ratio = 0.5 * (squares[0] / information[0] + squares[1] / information[1]);
        // A line never counts for more than it says.
        if ratio > 1.0 { 1.0 / ratio } else { 1.0 }
    }

    /// Share, and variance tangential and axial, of the three components of a line through the middle of its scanner, m².
    fn laws_of_lines(&self, round_m2: f64) -> [(f64, [f64; 2]); COMPONENTS] {
        let t = self.tail_share;
        let half = |of_core: f64, of_tail: f64| {
            std::array::from_fn(|axis| {
                0.5 * (of_core * self.core_m2[axis] + of_tail * self.tail_m2[axis]) + round_m2
            })
        };
        [
            ((1.0 - t) * (1.0 - t), half(1.0, 0.0)),
            (2.0 * t * (1.0 - t), half(0.5, 0.5)),
            (t * t, half(0.0, 1.0)),
        ]
    }

    fn em_step(&self, errors: &[Vector3<f64>]) -> Self {
        let density = |e: &Vector3<f64>, v: &[f64; 3]| {
            let q: f64 = (0..3).map(|i| e[i] * e[i] / v[i]).sum();
            (-0.5 * q).exp() / (v[0] * v[1] * v[2]).sqrt()
        };
        let (mut tail, mut core) = ([0.0; 4], [0.0; 4]);
        for e in errors {
            let t = self.tail_share * density(e, &self.tail_m2);
            let c = (1.0 - self.tail_share) * density(e, &self.core_m2);
            let share = if t + c > 0.0 { t / (t + c) } else { 1.0 };
            for (sums, w) in [(&mut tail, share), (&mut core, 1.0 - share)] {
                sums[3] += w;
                for i in 0..3 {
                    sums[i] += w * e[i] * e[i];
                }
            }
        }
        let variances = |sums: &[f64; 4], old: &[f64; 3]| -> [f64; 3] {
            std::array::from_fn(|i| {
                if sums[3] > 1.0 { (sums[i] / sums[3]).max(SMALLEST_VARIANCE_M2) } else { old[i] }
            })
        };
        Self {
            tail_share: tail[3] / errors.len() as f64,
            core_m2: variances(&core, &self.core_m2),
            tail_m2: variances(&tail, &self.tail_m2),
            ..*self
        }
    }
}

/// Error of the place that a scanner tells of a deposit, in the block's frame, m: from where the photon's way is as deep, since what lies
/// further along the way moves no line.
fn error_of(
    scanner: &Scanner,
    end_points: EndPoints,
    sample: &SampledDeposit,
    random: &mut RandomStream,
) -> Vector3<f64> {
    let (g, deposit) = (&scanner.grid, &sample.deposit);
    let mut told = deposit.place_block_m;
    if let Some(fwhm_m) = scanner.detection.position_fwhm_m {
        let (a, b): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
        told += Vector3::new(a, b, 0.0) * (fwhm_m / FWHM_PER_SD);
        told.z = scanner.told_depth_m();
    } else if end_points == EndPoints::Crystal {
        let centre =
            |index: u32, pitch_m: f64, count: u32| pitch_m * (f64::from(index) - 0.5 * f64::from(count - 1));
        let (column, row) = deposit.crystal;
        told = Vector3::new(
            centre(column, g.tangential_pitch_m, g.columns),
            centre(row, g.axial_pitch_m, g.rows),
            scanner.told_depth_m(),
        );
    }
    told - sample.way_beside_m()
}

/// What a source of Na-22 and the acollinearity add to a line of this length in its middle, per axis, m².
fn round_m2(length_m: f64) -> f64 {
    let bend_m = 0.25 * length_m * ACOLLINEARITY_FWHM_RAD / FWHM_PER_SD;
    bend_m * bend_m + SODIUM_SOURCE_VARIANCE_M2
}

/// Each sampled end is one of so many lines when it is asked what counts of them.
const PARTNERS: usize = 8;
/// No detector tells a place to better than a tenth of a millimetre; keeps every covariance invertible.
const SMALLEST_VARIANCE_M2: f64 = 1e-8;
/// Steps of the fit: the shares of a sample of 20,000 stand still to three digits after 60.
const EM_STEPS: usize = 60;
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
    /// See [`BlockNoise::information_share`].
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
    /// The noise of a scanner's lines whose blocks all err as `block` says.
    pub fn new(scanner: &Scanner, block: &BlockNoise, source: &SourceNoise) -> Self {
        let covariances = scanner
            .blocks
            .iter()
            .map(|b| {
                let axes = Matrix3::from_columns(&[b.tangential, b.axial, b.outward]);
                let turned = |v: &[f64; 3]| {
                    let c = axes * Matrix3::from_diagonal(&Vector3::from(*v)) * axes.transpose();
                    [c[(0, 0)], c[(0, 1)], c[(0, 2)], c[(1, 1)], c[(1, 2)], c[(2, 2)]]
                };
                (turned(&block.core_m2), turned(&block.tail_m2))
            })
            .collect();
        let t = block.tail_share;
        Self {
            covariances,
            slots: slots(scanner),
            heads: scanner.clone(),
            coverage: Arc::new(Coverage::new(scanner)),
            information_share: block.information_share,
            component_shares: [(1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t],
            source_variance_m2: source.variance_m2,
            acollinearity_sd_rad: source.acollinearity_fwhm_rad / FWHM_PER_SD,
            background_radius_m: source.background_radius_m,
        }
    }

    /// What the scanner sees of a point.
    pub fn coverage(&self) -> &Arc<Coverage> {
        &self.coverage
    }

    /// With the region of even background widened, where a marker set is so large: lines that pass the outermost marker at less than 5 mm
    /// plus 15 mm are looked at.
    #[must_use]
    pub fn wide_enough_for(self, set: &MarkerSet) -> Self {
        let least_m = super::body::Body::new(set).spared_m + MARGIN_M;
        Self { background_radius_m: self.background_radius_m.max(least_m), ..self }
    }

    /// The blocks whose frames four places are told in.
    #[inline(always)]
    pub(crate) fn blocks_at(&self, places_world_m: &Three) -> [u32; LANES] {
        if self.slots.is_empty() {
            return self.nearest_blocks(places_world_m);
        }
        let slots = slots_of(places_world_m[0], places_world_m[1]);
        lanes!(lane => self.slots[slots[lane]])
    }

    fn nearest_blocks(&self, places_world_m: &Three) -> [u32; LANES] {
        std::array::from_fn(|lane| {
            let place = Vector3::from(places_world_m.map(|axis| axis.0[lane]));
            self.heads.nearest_block(&place) as u32
        })
    }

    #[inline(always)]
    pub(crate) fn end_covariances(&self, block: u32) -> (&[f64; 6], &[f64; 6]) {
        let (core, tail) = &self.covariances[block as usize];
        (core, tail)
    }
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
    let on_a_ring = |b: &crate::scanner::Block| {
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
            let noise = LineNoise::new(&scanner, &BlockNoise::reference(), &SourceNoise::default());
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

    #[test]
    fn closed_form_what_counts_of_a_law_that_is_not_exact() {
        use rand_distr::{Distribution as _, StandardNormal};
        let mut random = RandomStreams::new(8, 0, "noise-test").stream("share", 0);
        let law = BlockNoise { tail_share: 0.2, ..BlockNoise::reference() };
        let exact: Vec<Vector3<f64>> = (0..40_000)
            .map(|_| {
                let v = if random.random::<f64>() < 0.2 { law.tail_m2 } else { law.core_m2 };
                Vector3::from(v.map(|v| {
                    let z: f64 = StandardNormal.sample(&mut random);
                    z * v.sqrt()
                }))
            })
            .collect();
        let share = law.information_share_of(&exact, 1e-6, &mut random);
        assert!(share > 0.97, "{share}");
        // One normal law of κ times the true variance: score variance E[u²]/κ²v², information 1/κv, whatever the shape; so I/J = κ.
        let flat: Vec<Vector3<f64>> =
            (0..40_000).map(|_| Vector3::from_fn(|_, _| 8e-3 * (random.random::<f64>() - 0.5))).collect();
        for kappa in [0.5, 0.8, 1.0] {
            let law = BlockNoise { tail_share: 0.0, core_m2: [kappa * 64e-6 / 12.0; 3], ..law };
            let share = law.information_share_of(&flat, 0.0, &mut random);
            assert!((share / kappa - 1.0).abs() < 0.03, "{kappa}: {share}");
        }
    }

    /// Of the shipped scanners' crystals: some per cent of the information do not count.
    #[test]
    fn regress_information_share_of_the_shipped_scanners() {
        for (name, crystals) in [("allegro", "gso"), ("tf64", "lyso"), ("reduced", "gso")] {
            let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
            let file = Node::open(&models.join(format!("scintillators/{crystals}.toml"))).unwrap();
            let scintillator = Scintillator::from_node(&file).unwrap();
            let scanner = shipped(name).with_interaction_depth(&scintillator);
            let noise = BlockNoise::of_block(&scanner, &scintillator, EndPoints::Crystal);
            println!("{name}: {noise:?}");
            assert!((0.88..0.99).contains(&noise.information_share), "{name}: {noise:?}");
        }
    }

    #[test]
    fn closed_form_the_fit_finds_the_mixture_that_it_was_drawn_from() {
        use rand_distr::{Distribution as _, StandardNormal};
        let mut random = RandomStreams::new(7, 0, "noise-test").stream("fit", 0);
        let truth = BlockNoise::reference();
        let sample: Vec<Vector3<f64>> = (0..20_000)
            .map(|i| {
                let v = if i % 4 == 0 { truth.tail_m2 } else { truth.core_m2 };
                Vector3::from(v.map(|v| {
                    let z: f64 = StandardNormal.sample(&mut random);
                    z * v.sqrt()
                }))
            })
            .collect();
        let fit = BlockNoise::of_samples(&sample).unwrap();
        assert!((fit.tail_share - 0.25).abs() < 0.015, "{fit:?}");
        for i in 0..3 {
            assert!((fit.core_m2[i] / truth.core_m2[i] - 1.0).abs() < 0.06, "{fit:?}");
            assert!((fit.tail_m2[i] / truth.tail_m2[i] - 1.0).abs() < 0.08, "{fit:?}");
        }
        assert_eq!(BlockNoise::of_samples(&sample[..99]), None);
    }
}
