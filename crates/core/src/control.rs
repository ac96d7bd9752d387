//! The seam of closed-loop actuation: a controller sees published estimates and encoder poses, never the truth.

use crate::{Name, PoseEstimate, SimTime};
use nalgebra::{Isometry3, Vector6};
use std::collections::BTreeMap;

/// What a track says, and when one could have known it.
#[derive(Clone, Debug)]
pub struct PublishedEstimate {
    /// The instant the estimate is about.
    pub at: SimTime,
    /// The instant it was available (the arrival of the last measurement in it).
    pub available: SimTime,
    /// Pose and covariance.
    pub pose: PoseEstimate,
    /// Velocity in the world, m/s, where the track estimates one.
    pub velocity_world_m_s: Option<nalgebra::Vector3<f64>>,
}

/// What an actuator is told to do from now on.
#[derive(Clone, Debug, PartialEq)]
pub struct Command {
    /// The actuator's name in the scenario.
    pub actuator: Name,
    /// Linear (m/s) and angular (rad/s) velocity in the world frame.
    pub twist_world: Vector6<f64>,
}

/// Closed-loop control from estimates.
pub trait Controller: Send {
    /// Commands at `now` from the last published estimate and the poses that encoders tell.
    fn step(
        &mut self,
        now: SimTime,
        last: Option<&PublishedEstimate>,
        known_poses: &BTreeMap<String, Isometry3<f64>>,
    ) -> Vec<Command>;
}
