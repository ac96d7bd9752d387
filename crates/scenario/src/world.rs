//! A world that can be stepped: truth now, a little of the past, notes on what happened, pictures.

#![expect(clippy::disallowed_types, reason = "world side: the world is where truth comes from")]

use crate::error::ScenarioError;
use lumenav_core::{CapsuleTruth, Primitive, SimTime, TruthView};

/// Something worth telling: a segment entered, the capsule stalled or left.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldNote {
    /// When.
    pub at: SimTime,
    /// In words.
    pub text: String,
    /// Holds for the whole run (a doubt about the tract), and is told whenever it begins to be observed.
    pub standing: bool,
}

/// A world's state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Of what the world was built from: scenario, seed, trial. A state belongs to worlds with the same.
    pub world: u64,
    /// The state.
    pub bytes: Vec<u8>,
}

/// A source of truth, engine or kinematic.
pub trait World: Send {
    /// Moves on so that truth is known up to `to`.
    ///
    /// # Errors
    /// [`ScenarioError::Engine`] where the world breaks a law of its own (the capsule leaves the lumen).
    fn advance_to(&mut self, to: SimTime) -> Result<(), ScenarioError>;

    /// Truth over the held interval.
    fn truth(&self) -> &dyn TruthView;

    /// Nothing before this instant will be asked any more.
    fn forget_before(&mut self, at: SimTime);

    /// Notes since the last call.
    fn take_notes(&mut self) -> Vec<WorldNote>;

    /// Its state as bytes, from which a world built alike goes on bit by bit; `None` where that saves nothing (a function of time alone).
    fn checkpoint(&self) -> Option<Checkpoint> {
        None
    }

    /// Takes on the state of a checkpoint of a world built alike. Notes from before it are dropped.
    ///
    /// # Errors
    /// [`ScenarioError::Checkpoint`]: other bytes, or of another world. The world is then as it was.
    fn restore(&mut self, _bytes: &[u8]) -> Result<(), ScenarioError> {
        Err(ScenarioError::Checkpoint { why: "this world has none" })
    }

    /// What does not move, or moves as a whole: tract, body.
    fn static_scene(&self, out: &mut Vec<Primitive>);

    /// What moves besides the capsule: contractions of the wall, and where a patient who moves has carried what stands still in it.
    fn moving_scene(&self, _out: &mut Vec<Primitive>) {}
}

/// Samples of truth in time order, interpolated in between (constant twist).
///
/// Steps are a few milliseconds apart, so the interpolation error is below a micrometre for accelerations under 1 m/s².
#[derive(Clone, Debug, Default)]
pub struct TruthHistory {
    samples: std::collections::VecDeque<CapsuleTruth>,
}

impl TruthHistory {
    /// Adds the newest sample.
    pub fn push(&mut self, truth: CapsuleTruth) {
        self.samples.push_back(truth);
    }

    /// Drops what lies before `at`, but keeps the sample just before it.
    pub fn forget_before(&mut self, at: SimTime) {
        while self.samples.len() > 2 && self.samples[1].at <= at {
            self.samples.pop_front();
        }
    }

    /// The newest instant.
    pub fn newest(&self) -> Option<SimTime> {
        self.samples.back().map(|s| s.at)
    }

    /// Truth at an instant; the nearest end where it lies outside. `None` while empty.
    pub fn at(&self, at: SimTime) -> Option<CapsuleTruth> {
        let after = self.samples.partition_point(|s| s.at < at);
        let Some(b) = self.samples.get(after) else { return self.samples.back().cloned() };
        if b.at == at || after == 0 {
            return Some(b.clone());
        }
        let a = &self.samples[after - 1];
        let fraction = at.since_s(a.at) / b.at.since_s(a.at);
        let mix_known = |x: Option<f64>, y: Option<f64>| x.zip(y).map(|(x, y)| x + (y - x) * fraction);
        let mix = |x: &nalgebra::Vector3<f64>, y: &nalgebra::Vector3<f64>| x.lerp(y, fraction);
        Some(CapsuleTruth {
            at,
            world_from_capsule: lumenav_core::pose::interpolate(
                &a.world_from_capsule,
                &b.world_from_capsule,
                fraction,
            ),
            velocity_world_m_s: mix(&a.velocity_world_m_s, &b.velocity_world_m_s),
            angular_rate_capsule_rad_s: mix(&a.angular_rate_capsule_rad_s, &b.angular_rate_capsule_rad_s),
            specific_force_capsule_m_s2: mix(&a.specific_force_capsule_m_s2, &b.specific_force_capsule_m_s2),
            arc_length_m: mix_known(a.arc_length_m, b.arc_length_m),
            segment: a.segment.clone(),
            wall_force_n: mix_known(a.wall_force_n, b.wall_force_n),
        })
    }

    /// The held interval; empty at 0 while there is no sample.
    pub fn interval(&self) -> std::ops::Range<SimTime> {
        match (self.samples.front(), self.samples.back()) {
            (Some(a), Some(b)) => a.at..b.at,
            _ => SimTime::ZERO..SimTime::ZERO,
        }
    }
}
