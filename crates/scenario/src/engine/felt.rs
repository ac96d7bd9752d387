//! The engine within a moving patient: what the capsule feels in the gut's frame, and its state in the world.
//!
//! The equations stand at the head of [`crate::patient::FrameMotion`]'s file. Without a patient the gut's frame is the world's, and every
//! number is the one of a torso that rests.

use super::{CAPSULE, Engine, EngineState};
use crate::patient::{Felt, FrameMotion, Patient};
use nalgebra::Vector3;
use std::sync::{Arc, OnceLock};

impl Engine {
    /// The same engine, at t = 0, within a patient who moves. Gravity of the configuration is then that of the room.
    #[must_use]
    pub fn within(mut self, patient: Arc<Patient>) -> Self {
        self.patient = Some(patient);
        self.fingerprint = OnceLock::new();
        self
    }

    /// The patient around it.
    pub fn patient(&self) -> Option<&Arc<Patient>> {
        self.patient.as_ref()
    }

    /// The motion of the gut's frame; `None` where it is the world.
    fn gut(&self, time_s: f64) -> Option<FrameMotion> {
        self.patient.as_ref().map(|patient| patient.gut(time_s))
    }

    /// What the capsule feels beside forces at a place, gut frame.
    pub(super) fn felt_at(&self, time_s: f64, centre_m: &Vector3<f64>, velocity_m_s: &Vector3<f64>) -> Felt {
        match self.gut(time_s) {
            Some(gut) => gut.felt(&self.gravity_world_m_s2, centre_m, velocity_m_s),
            None => Felt { gravity_m_s2: self.gravity_world_m_s2, coriolis_m_s2: Vector3::zeros() },
        }
    }

    /// All of what is felt, m/s².
    pub(super) fn felt_total(&self, felt: &Felt) -> Vector3<f64> {
        if self.patient.is_some() { felt.total_m_s2() } else { felt.gravity_m_s2 }
    }

    /// Specific force of a capsule that rests in the gut, capsule frame, m/s².
    pub(super) fn specific_force_at_rest(&self, time_s: f64) -> Vector3<f64> {
        let pose = self.bodies.pose(CAPSULE);
        let felt = self.felt_at(time_s, &pose.translation.vector, &Vector3::zeros());
        pose.rotation.inverse() * -self.felt_total(&felt)
    }

    /// The actuators' force (N) and torque (N m) in the gut's frame.
    pub(super) fn wrench_gut(&self, time_s: f64) -> [Vector3<f64>; 2] {
        match self.gut(time_s) {
            Some(gut) => self.wrench_world.map(|w| gut.world_from_frame.rotation.inverse() * w),
            None => self.wrench_world,
        }
    }

    /// Until when the patient does not move the gut, s, if it is still at `time_s`; one step is kept free before it moves, so that none
    /// into which a motion falls is slept through.
    pub(super) fn patient_still_until_s(&self, time_s: f64) -> f64 {
        match &self.patient {
            Some(patient) => patient.still_until_s(time_s) - self.step_s,
            None => f64::INFINITY,
        }
    }

    /// The capsule's state now.
    pub fn state(&self) -> EngineState {
        let state = self.state_in_gut();
        match self.gut(state.at.seconds()) {
            Some(gut) => in_world(&gut, &state),
            None => state,
        }
    }

    /// As [`Engine::state`], with pose, velocity and angular rate in the gut's frame instead of the world's: what `world` in their names
    /// says holds for a gut that rests. The specific force is that in the world.
    pub fn state_in_gut(&self) -> EngineState {
        let pose = self.bodies.pose(CAPSULE);
        let twist = self.bodies.twist(CAPSULE);
        let at = self.time();
        // What has left is not stepped any more, and still moves with the patient.
        let capsule = self.capsule();
        let moved = capsule.left && self.patient.is_some();
        EngineState {
            at,
            world_from_capsule: pose,
            velocity_world_m_s: twist.linear,
            angular_rate_capsule_rad_s: pose.rotation.inverse() * twist.angular,
            specific_force_capsule_m_s2: if moved {
                self.specific_force_at_rest(at.seconds())
            } else {
                self.specific_force_capsule_m_s2
            },
            arc_length_m: capsule.station.arc_length_m,
            offset_m: capsule.offset_m,
            segment: self.tract.segments[capsule.segment_index].key,
            wall_force_n: self.wall_force_n,
            contact: self.touching > 0,
            left: capsule.left,
        }
    }
}

/// The state of what a frame carries, in the world.
fn in_world(gut: &FrameMotion, state: &EngineState) -> EngineState {
    let pose = &state.world_from_capsule;
    let x_m = &pose.translation.vector;
    let turned = pose.rotation.inverse() * gut.rate_frame_rad_s;
    EngineState {
        world_from_capsule: gut.world_from_frame * pose,
        velocity_world_m_s: gut.velocity_world(x_m, &state.velocity_world_m_s),
        angular_rate_capsule_rad_s: state.angular_rate_capsule_rad_s + turned,
        ..*state
    }
}
