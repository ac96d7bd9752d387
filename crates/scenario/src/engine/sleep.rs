//! Sleep: a capsule that rests where the wall stands still is not stepped.
//!
//! In phase I of the small bowel nothing contracts for three quarters of an hour. A capsule whose surface has moved slower than
//! [`SLEEPING_M_S`] for [`SLEEPY_FOR_S`] is put to rest (no velocity) and left there until a wave comes within reach
//! ([`lumenav_anatomy::lumen::Lumen::still_until_s`]), the patient moves the gut ([`crate::patient::Patient::still_until_s`]; with
//! every breath), gravity turns or the wrench changes. With loose things in the tract a capsule never sleeps. What this leaves out is the creep of the
//! regularised friction, microns per second at most, which no real friction has.
//!
//! Waking depends on the motility, the patient and the capsule's place alone, so that steps and jumps end in the same bits.

use super::system::Twist;
use super::{CAPSULE, Engine};
use lumenav_core::SimTime;
use nalgebra::Vector3;

/// Speed of the fastest point of the capsule's surface below which it is taken to rest, m/s.
const SLEEPING_M_S: f64 = 1e-5;
/// For so long, s.
const SLEEPY_FOR_S: f64 = 1.0;

/// Number of a step that no exam reaches (a million years).
const LAST_STEP: f64 = 1e15;

/// Whether the capsule sleeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sleep {
    /// Steps that it has rested, up to the number that makes it sleep.
    pub(super) rested_steps: u64,
    /// When the wall has to be looked at again, s; `None` while awake.
    pub(super) until_s: Option<f64>,
}

impl Sleep {
    pub(super) const AWAKE: Self = Self { rested_steps: 0, until_s: None };
}

impl Engine {
    /// Called after a step that ended at `time_s`: counts rest, and falls asleep when there was enough of it.
    pub(super) fn doze(&mut self, time_s: f64) {
        let spin = self.bodies.pose(CAPSULE).rotation.inverse() * self.bodies.twist(CAPSULE).angular;
        let surface_m_s = self.fastest_end_m_s() + spin.x.abs() * self.capsule().shape.radius_m;
        // What is loose beside it may move it at any time.
        let alone = self.is_alone();
        let rests = self.config.sleep && alone && !self.capsule().left && surface_m_s < SLEEPING_M_S;
        self.sleep.rested_steps = if rests { self.sleep.rested_steps + 1 } else { 0 };
        if self.sleep.rested_steps as f64 * self.step_s < SLEEPY_FOR_S {
            return;
        }
        let until_s = self.still_until_s(time_s);
        if until_s > time_s {
            self.sleep.until_s = Some(until_s);
            self.bodies.set_twist(CAPSULE, &Twist { linear: Vector3::zeros(), angular: Vector3::zeros() });
            self.specific_force_capsule_m_s2 = self.specific_force_at_rest(time_s);
        }
    }

    /// Until when neither the wall within reach nor the patient moves, s.
    fn still_until_s(&self, time_s: f64) -> f64 {
        let capsule = self.capsule();
        let wall = self.lumen.still_until_s(capsule.station.arc_length_m, capsule.contacts.rings().reach_m());
        wall.min(self.patient_still_until_s(time_s))
    }

    /// Whether the step that starts at `time_s` is slept through; wakes where the wall is about to move.
    pub(super) fn sleeps_through(&mut self, time_s: f64) -> bool {
        let Some(until_s) = self.sleep.until_s else { return false };
        self.lumen.advance_to(time_s);
        if time_s < until_s {
            return true;
        }
        let until_s = self.still_until_s(time_s);
        self.sleep.until_s = (until_s > time_s).then_some(until_s);
        if self.sleep.until_s.is_none() {
            self.sleep = Sleep::AWAKE;
        }
        self.sleep.until_s.is_some()
    }

    /// While it sleeps or has left: the last step up to `last_step` before which nothing can happen. The present one otherwise.
    pub(super) fn undisturbed_until(&self, last_step: u64) -> u64 {
        if self.capsule().left {
            return last_step;
        }
        let Some(until_s) = self.sleep.until_s else { return self.step_index };
        let before_waking = self.first_step_at(until_s);
        let before_telling =
            self.watch.next(&self.config).map_or(u64::MAX, |at| self.last_step_at(SimTime(at.0 - 1)));
        before_waking.min(before_telling).min(last_step).max(self.step_index)
    }

    /// Index of the first step that starts at `time_s` or later.
    fn first_step_at(&self, time_s: f64) -> u64 {
        // Beyond this a step is no longer told from the next, and counting on would never end: a snapshot writes "for ever" as the
        // largest number.
        if time_s.is_nan() || time_s / self.step_s > LAST_STEP {
            return u64::MAX;
        }
        let mut index = (time_s / self.step_s).max(0.0) as u64;
        while index as f64 * self.step_s < time_s {
            index += 1;
        }
        index
    }

    /// Number of the last step that ends at or before `time`.
    pub(super) fn last_step_at(&self, time: SimTime) -> u64 {
        // Step n ends at floor(n 1e9 / rate), which is at or before t if n 1e9 < (t + 1) rate.
        let bound = u128::try_from(time.0 + 1).unwrap_or(0) * u128::from(self.config.step_rate_hz);
        (bound.div_ceil(1_000_000_000).max(1) - 1) as u64
    }
}
