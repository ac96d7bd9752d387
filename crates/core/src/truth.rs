//! What is true. Only the world side may name these types: sensors, the scenario engine, evaluation and recording.
//!
//! `clippy.toml` lists [`TruthView`] and [`CapsuleTruth`] as disallowed; each file of the world side opens with an
//! expectation of that lint and its reason, and a test holds the list of files that may. No front end, filter or
//! reader can therefore reach the truth without the build turning red.

#![expect(clippy::disallowed_types, reason = "this file defines what only the world side may name")]

use crate::Name;
use crate::time::SimTime;
use nalgebra::{Isometry3, Vector3};
use std::ops::Range;

/// The capsule's true state at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct CapsuleTruth {
    /// The instant.
    pub at: SimTime,
    /// True pose: origin at the capsule's geometric centre, x along its axis towards the camera.
    pub world_from_capsule: Isometry3<f64>,
    /// Velocity of the centre in the world, m/s.
    pub velocity_world_m_s: Vector3<f64>,
    /// Angular rate in the capsule's frame, rad/s.
    pub angular_rate_capsule_rad_s: Vector3<f64>,
    /// Specific force (what an ideal accelerometer reads: acceleration minus gravity) in the capsule's frame, m/s².
    pub specific_force_capsule_m_s2: Vector3<f64>,
    /// Arc length along the tract's centre line, m; `None` where there is no tract.
    pub arc_length_m: Option<f64>,
    /// The tract segment it is in.
    pub segment: Option<Name>,
    /// Norm of the force that the wall exerts, N; `None` where there is no wall (kinematic truth, replays).
    pub wall_force_n: Option<f64>,
}

/// What a sensor may ask of the world.
pub trait TruthView {
    /// The interval of time for which truth is held now. Asking outside it gives the nearest end.
    fn interval(&self) -> Range<SimTime>;
    /// The capsule at an instant inside [`TruthView::interval`].
    fn capsule(&self, at: SimTime) -> CapsuleTruth;
    /// `world_from_<name>` of a moving frame, `None` where the scenario has no such frame. Of a patient: `torso` (the trunk), `abdomen` (the
    /// belly's surface, which breath lifts), `gut` (in which the tract stands still).
    fn frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>>;
    /// What estimators are told of the pose of something that is worn on a frame: that of the frame to which it has been calibrated. For
    /// the `abdomen` this is the `torso`: nobody follows the belly's surface.
    fn told_frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        self.frame(name, at)
    }
}
