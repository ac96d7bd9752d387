//! Errors of single ends as a block's physics makes them, and what follows from them for whole lines.
//!
//! No mixture of two normal laws is the law of crystals, which are flat, and no scanner sees all lines of a place. With u a line's offset, s
//! the score of the law that trackers believe, and the offset's parts c (range, acollinearity), i (photons that scatter on to another
//! crystal; where there are no crystals, light that tells the place) and the crystal's size:
//!
//! ```text
//! I = E[-ds/du],  J = E[s²]                  what counts of the information: I/J (White 1982)
//! v = (E[s c] + ½ E[s i]) / I                what the edges of the field cut off, as a variance
//! ```
//!
//! v: where what the blocks see, S, falls off, the lines of a source that are seen lie on the side where more is seen. Of offsets c that exist
//! before the photons arrive, an edge lets through all on one side of it: `E[c | seen] = E[c²] ∇ ln S`. A photon that scatters on is
//! lost only where it leaves the block, and none comes in from beside it: half as much, and so with a place that light tells beside what is
//! read out. (Of a plate whose crystal goes on behind the end of what is read out, places are told inward as often: all of it. The
//! simulator has no such plate, and half is taken.) Blocks end where crystals end, so their size cuts nothing off. [`super::field`] makes of v and S how far a source's lines lie beside it.

use super::block::BlockNoise;
use super::{FWHM_PER_SD, SourceNoise};
use crate::scanner::Scanner;
use crate::simulation::deposits::{SampledDeposit, sampled_deposits};
use crate::simulation::{EndPoints, Scintillator};
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::Vector3;
use rand::RngExt as _;
use rand_distr::StandardNormal;

/// Each sampled end is one of so many lines when it is asked what counts of them: their share stands to 0.4 per cent.
const PARTNERS: usize = 32;

/// Error of one end in its block's frame, tangential, axial and in depth, m: of the told place from where the photon's way is as deep as the
/// deposit, since what lies further along the way moves no line.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EndError {
    /// Of the place by which the block keeps or loses it: the deposit's, or that which light tells.
    scattered_m: Vector3<f64>,
    /// Of the place that is told.
    told_m: Vector3<f64>,
}

/// The errors of a scanner's ends, and the law fitted to them.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockErrors {
    /// What trackers believe.
    pub law: BlockNoise,
    ends: Vec<EndError>,
    /// Of a line through the scanner's middle, m.
    length_m: f64,
}

/// What lines of a source say, beyond their law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Calibration {
    /// See [`super::LineNoise::information_share`].
    pub(super) information_share: f64,
    /// The variance v in the head of this file, across the scanner's axis and along it, m².
    pub(super) cut_off_m2: [f64; 2],
}

impl Calibration {
    /// Of a law that is exact, in a field without an edge.
    pub(super) const EXACT: Self = Self { information_share: 1.0, cut_off_m2: [0.0; 2] };
}

impl BlockErrors {
    /// From the physics of a scanner's blocks (all alike). The same file gives the same numbers. Without crystals the file's resolution is
    /// added, and the depth is not told.
    pub fn of_block(scanner: &Scanner, scintillator: &Scintillator, end_points: EndPoints) -> Self {
        let mut random = RandomStreams::new(0, 0, "pet-line-noise").stream("told", 0);
        let deposits = sampled_deposits(scanner, scintillator);
        let ends: Vec<EndError> =
            deposits.iter().map(|sample| EndError::of(scanner, end_points, sample, &mut random)).collect();
        let told: Vec<Vector3<f64>> = ends.iter().map(|end| end.told_m).collect();
        let length_m =
            2.0 * ((scanner.blocks[0].centre_world_m - scanner.middle_m()).norm() + scanner.told_depth_m());
        match BlockNoise::of_samples(&told) {
            Some(law) => Self { law, ends, length_m },
            None => Self { law: BlockNoise::of_crystal(scanner), ends: Vec::new(), length_m },
        }
    }

    /// Of lines of two ends each through a source in the middle; an axis by its own information.
    pub(super) fn calibrate(&self, source: &SourceNoise) -> Calibration {
        if self.ends.is_empty() {
            return Calibration::EXACT;
        }
        let bend_m = 0.25 * self.length_m * source.acollinearity_fwhm_rad / FWHM_PER_SD;
        let round_m2 = bend_m * bend_m + source.variance_m2;
        let mut random = RandomStreams::new(0, 0, "pet-line-noise").stream("source", 0);
        let sums = self.sums(round_m2, &mut random);
        let ratio = 0.5 * (sums[0].squares / sums[0].information + sums[1].squares / sums[1].information);
        Calibration {
            // A line never counts for more than it says.
            information_share: if ratio > 1.0 { 1.0 / ratio } else { 1.0 },
            cut_off_m2: sums.map(|sum| (sum.by_source + 0.5 * sum.by_scatter) / sum.information),
        }
    }

    fn sums(&self, round_m2: f64, random: &mut RandomStream) -> [Sums; 2] {
        let laws = self.law.laws_of_lines(round_m2);
        let mut sums = [Sums::default(); 2];
        let count = self.ends.len();
        let pairs = (1..=PARTNERS)
            .flat_map(|k| (0..count).map(move |i| (i, (i + k * count / (PARTNERS + 1)) % count)));
        for (a, b) in pairs.map(|(a, b)| (&self.ends[a], &self.ends[b])) {
            let source: [f64; 2] =
                std::array::from_fn(|_| round_m2.sqrt() * random.sample::<f64, _>(StandardNormal));
            let u: [f64; 2] =
                std::array::from_fn(|axis| 0.5 * (a.told_m[axis] + b.told_m[axis]) + source[axis]);
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
            if density <= 0.0 {
                continue;
            }
            for axis in 0..2 {
                let score = slope[axis] / density;
                let sum = &mut sums[axis];
                sum.squares += score * score;
                sum.information += score * score - bend[axis] / density;
                sum.by_source += score * source[axis];
                sum.by_scatter += score * 0.5 * (a.scattered_m[axis] + b.scattered_m[axis]);
            }
        }
        sums
    }
}

/// Over lines: `s²`, `-ds/du`, `s c` and `s i`.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    squares: f64,
    information: f64,
    by_source: f64,
    by_scatter: f64,
}

impl EndError {
    fn of(
        scanner: &Scanner,
        end_points: EndPoints,
        sample: &SampledDeposit,
        random: &mut RandomStream,
    ) -> Self {
        let (g, deposit) = (&scanner.grid, &sample.deposit);
        let (mut told, mut kept_by) = (deposit.place_block_m, deposit.place_block_m);
        if let Some(fwhm_m) = scanner.detection.position_fwhm_m {
            let (a, b): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
            told += Vector3::new(a, b, 0.0) * (fwhm_m / FWHM_PER_SD);
            kept_by = told;
            told.z = scanner.told_depth_m();
        } else if end_points == EndPoints::Crystal {
            let centre = |index: u32, pitch_m: f64, count: u32| {
                pitch_m * (f64::from(index) - 0.5 * f64::from(count - 1))
            };
            let (column, row) = deposit.crystal;
            told = Vector3::new(
                centre(column, g.tangential_pitch_m, g.columns),
                centre(row, g.axial_pitch_m, g.rows),
                scanner.told_depth_m(),
            );
        }
        let way_beside_m = sample.way_beside_m();
        Self { scattered_m: kept_by - way_beside_m, told_m: told - way_beside_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::Node;
    use std::path::Path;

    /// Ends that do not scatter, with errors of their own.
    fn errors(law: BlockNoise, told_m: impl IntoIterator<Item = Vector3<f64>>) -> BlockErrors {
        let end = |told_m| EndError { scattered_m: Vector3::zeros(), told_m };
        BlockErrors { law, ends: told_m.into_iter().map(end).collect(), length_m: 0.9 }
    }

    fn source(variance_m2: f64) -> SourceNoise {
        SourceNoise { variance_m2, acollinearity_fwhm_rad: 0.0, ..SourceNoise::default() }
    }

    #[test]
    fn closed_form_what_counts_of_a_law_that_is_not_exact() {
        let mut random = RandomStreams::new(8, 0, "noise-test").stream("share", 0);
        let law = BlockNoise { tail_share: 0.2, ..BlockNoise::reference() };
        let exact: Vec<Vector3<f64>> = (0..40_000)
            .map(|_| {
                let v = if random.random::<f64>() < 0.2 { law.tail_m2 } else { law.core_m2 };
                Vector3::from(v.map(|v| random.sample::<f64, _>(StandardNormal) * v.sqrt()))
            })
            .collect();
        let share = errors(law, exact).calibrate(&source(1e-6)).information_share;
        assert!(share > 0.97, "{share}");
        // One normal law of κ times the true variance: score variance E[u²]/κ²v², information 1/κv, whatever the shape; so I/J = κ.
        let flat: Vec<Vector3<f64>> =
            (0..40_000).map(|_| Vector3::from_fn(|_, _| 8e-3 * (random.random::<f64>() - 0.5))).collect();
        for kappa in [0.5, 0.8, 1.0] {
            let law = BlockNoise { tail_share: 0.0, core_m2: [kappa * 64e-6 / 12.0; 3], ..law };
            let share = errors(law, flat.clone()).calibrate(&source(0.0)).information_share;
            assert!((share / kappa - 1.0).abs() < 0.03, "{kappa}: {share}");
        }
    }

    /// One normal law that is exact: `s = u/v`, so an edge cuts off the source's variance, and half of what scatters.
    #[test]
    fn closed_form_an_edge_cuts_off_the_source_and_half_of_what_scatters() {
        let mut random = RandomStreams::new(9, 0, "noise-test").stream("edge", 0);
        let mut normal = |variance: f64| {
            let normal = |_, _| random.sample::<f64, _>(StandardNormal) * f64::sqrt(variance);
            Vector3::from_fn(normal)
        };
        let (scatter_m2, size_m2, source_m2) = (6e-6, 3e-6, 2e-6);
        let ends: Vec<EndError> = (0..40_000)
            .map(|_| {
                let scattered_m = normal(scatter_m2);
                EndError { scattered_m, told_m: scattered_m + normal(size_m2) }
            })
            .collect();
        let core_m2 = [scatter_m2 + size_m2; 3];
        let law = BlockNoise { tail_share: 0.0, core_m2, tail_m2: core_m2 };
        let found = BlockErrors { law, ends, length_m: 0.9 }.calibrate(&source(source_m2));
        for cut_off_m2 in found.cut_off_m2 {
            // A line's offset is the mean of two ends: half of an end's variance.
            let wanted = source_m2 + 0.5 * (0.5 * scatter_m2);
            assert!((cut_off_m2 / wanted - 1.0).abs() < 0.02, "{cut_off_m2} {wanted}");
        }
    }

    /// Of the shipped scanners' crystals and Na-22: some per cent of the information do not count, and an edge cuts off some mm².
    #[test]
    fn regress_calibration_of_the_shipped_scanners() {
        let wanted = [
            ("allegro", "gso", 0.960, [1.71, 2.03]),
            ("tf64", "lyso", 0.970, [1.7, 1.7]),
            ("reduced", "gso", 0.961, [1.75, 2.06]),
        ];
        for (name, crystals, share, cut_off_mm2) in wanted {
            let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
            let open = |file: String| Node::open(&models.join(file)).unwrap();
            let scintillator =
                Scintillator::from_node(&open(format!("scintillators/{crystals}.toml"))).unwrap();
            let scanner = Scanner::from_node(&open(format!("scanners/{name}.toml"))).unwrap();
            let scanner = scanner.with_interaction_depth(&scintillator);
            let errors = BlockErrors::of_block(&scanner, &scintillator, EndPoints::Crystal);
            let found = errors.calibrate(&SourceNoise::default());
            println!("{name}: {:?} {found:?}", errors.law);
            assert!((found.information_share - share).abs() < 0.005, "{name}: {found:?}");
            for (found, wanted) in found.cut_off_m2.iter().zip(cut_off_mm2) {
                assert!((1e6 * found / wanted - 1.0).abs() < 0.05, "{name}: {found:?}");
            }
        }
    }
}
