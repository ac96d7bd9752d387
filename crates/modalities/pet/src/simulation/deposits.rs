//! Deposits that a block reports of photons from about the scanner's middle, and how deep they lie in the mean.
//!
//! A line is told through two crystals' axes, the depth is not measured. A photon that comes in at an angle θ to the block's outward
//! direction deposits at the depth z and is told at `d`: across its way that is an error of `(d - z) sin θ`, on average none where
//!
//! ```text
//! d = E[z]     z the depth of the deposit that gives the crystal, of photons that pass the energy window
//! ```
//!
//! A photon that scattered first lies deeper, but along its own way in the mean: what counts is where the deposit lies, not the first
//! interaction. STIR calls d the average depth of interaction, CASToR the mean depth of interaction (their scanner files).

use super::block::{BlockPhysics, Deposit, FIELD_M, kill_energy_ev, passes_window};
use super::photon::Photon;
use super::scintillator::Scintillator;
use super::source::ANNIHILATION_EV;
use crate::scanner::Scanner;
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::Vector3;
use rand::RngExt as _;

/// Deposits that a mean or a fit looks at: variances to 3 per cent, a depth to 0.1 mm.
pub const SAMPLES: usize = 6000;
/// Photons sent at most; the thinnest shipped crystal keeps one of six.
const TRIES: usize = 200_000;

/// A deposit that passed the energy window, and the photon that made it, block coordinates.
#[derive(Clone, Copy, Debug)]
pub struct SampledDeposit {
    /// Where the photon came from, m.
    pub from_block_m: Vector3<f64>,
    /// Where it went.
    pub direction: Vector3<f64>,
    /// What it left.
    pub deposit: Deposit,
}

impl SampledDeposit {
    /// Where the photon's way, taken straight on, is as deep in the block as the deposit, m.
    pub fn way_beside_m(&self) -> Vector3<f64> {
        let depth_m = self.deposit.place_block_m.z - self.from_block_m.z;
        self.from_block_m + self.direction * (depth_m / self.direction.z)
    }
}

/// [`SAMPLES`] deposits in a block of a scanner of photons from the cube where capsules are; fewer where a block stops next to nothing.
/// The same scanner gives the same deposits.
pub fn sampled_deposits(scanner: &Scanner, scintillator: &Scintillator) -> Vec<SampledDeposit> {
    let physics = BlockPhysics::new(scanner, scintillator.clone());
    let mut random = RandomStreams::new(0, 0, "pet-line-noise").stream("block", 0);
    let middle = scanner.to_block(0, &scanner.middle_m());
    (0..TRIES).filter_map(|_| one(scanner, &physics, &middle, &mut random)).take(SAMPLES).collect()
}

fn one(
    scanner: &Scanner,
    physics: &BlockPhysics,
    middle_block_m: &Vector3<f64>,
    random: &mut RandomStream,
) -> Option<SampledDeposit> {
    let g = &scanner.grid;
    let mut spread = |half_m: f64| half_m * (2.0 * random.random::<f64>() - 1.0);
    let from_block_m = middle_block_m + Vector3::new(spread(FIELD_M), spread(FIELD_M), spread(FIELD_M));
    let to = Vector3::new(spread(g.half_width_m()), spread(g.half_length_m()), 0.0);
    let direction = (to - from_block_m).try_normalize(0.0)?;
    let mut photon = Photon::emitted(from_block_m, direction, ANNIHILATION_EV);
    let deposit = physics.respond(&mut photon, random)?;
    let detection = &scanner.detection;
    let is_kept = deposit.energy_ev >= kill_energy_ev(detection)
        && direction.z > 0.0
        && passes_window(detection, deposit.energy_ev, random);
    is_kept.then_some(SampledDeposit { from_block_m, direction, deposit })
}

impl Scanner {
    /// This scanner with its ends told as deep as deposits lie in the mean, unless its file says how deep: told at the middle of the
    /// crystals, behind most of them, everything beside the axis is seen too far out (parallax).
    #[must_use]
    pub fn with_interaction_depth(mut self, scintillator: &Scintillator) -> Self {
        if self.interaction_depth_m.is_none() {
            let deposits = sampled_deposits(&self, scintillator);
            let sum_m: f64 = deposits.iter().map(|sample| sample.deposit.place_block_m.z).sum();
            // A block that stops nothing tells nothing.
            self.interaction_depth_m = (!deposits.is_empty()).then(|| sum_m / deposits.len() as f64);
        }
        self
    }
}
