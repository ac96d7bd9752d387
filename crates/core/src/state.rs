//! A nominal state that can be moved along its error parts: what filters carry, and what bounds and laws look from.

use crate::Name;
use crate::measurement::{Instant, Part, StateView};
use crate::pose::oplus;
use crate::time::SimTime;
use nalgebra::{DVector, DVectorView, Isometry3, Vector3, Vector6};
use std::collections::BTreeMap;

/// Pose, velocity, angular rate, clones and nuisance blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct NominalState {
    /// Pose now.
    pub world_from_capsule: Isometry3<f64>,
    /// Velocity in the world, m/s.
    pub velocity_world_m_s: Vector3<f64>,
    /// Angular rate in the capsule's frame, rad/s.
    pub angular_rate_capsule_rad_s: Vector3<f64>,
    /// Poses kept of earlier instants.
    pub clones: BTreeMap<SimTime, Isometry3<f64>>,
    /// Nuisance blocks by name.
    pub blocks: BTreeMap<Name, DVector<f64>>,
}

impl NominalState {
    /// At rest at a pose, without clones or blocks.
    pub fn at_rest(world_from_capsule: Isometry3<f64>) -> Self {
        Self {
            world_from_capsule,
            velocity_world_m_s: Vector3::zeros(),
            angular_rate_capsule_rad_s: Vector3::zeros(),
            clones: BTreeMap::new(),
            blocks: BTreeMap::new(),
        }
    }

    /// Number of error columns of a part; `None` where this state does not hold it.
    pub fn dimension(&self, part: &Part) -> Option<usize> {
        match part {
            Part::Pose(Instant::Now) => Some(6),
            Part::Pose(Instant::Clone(at)) => self.clones.contains_key(at).then_some(6),
            Part::Velocity | Part::AngularRate => Some(3),
            Part::Block(name) => self.blocks.get(name).map(DVector::len),
        }
    }

    /// Moves one part by an error of its dimension; a part that is not held is left alone.
    pub fn perturb(&mut self, part: &Part, error: DVectorView<'_, f64>) {
        match part {
            Part::Pose(Instant::Now) => {
                self.world_from_capsule =
                    oplus(&self.world_from_capsule, &Vector6::from_iterator(error.iter().copied()));
            }
            Part::Pose(Instant::Clone(at)) => {
                if let Some(pose) = self.clones.get_mut(at) {
                    *pose = oplus(pose, &Vector6::from_iterator(error.iter().copied()));
                }
            }
            Part::Velocity => self.velocity_world_m_s += Vector3::from_iterator(error.iter().copied()),
            Part::AngularRate => {
                self.angular_rate_capsule_rad_s += Vector3::from_iterator(error.iter().copied());
            }
            Part::Block(name) => {
                if let Some(block) = self.blocks.get_mut(name) {
                    *block += error;
                }
            }
        }
    }
}

impl StateView for NominalState {
    fn world_from_capsule(&self, at: Instant) -> Option<Isometry3<f64>> {
        match at {
            Instant::Now => Some(self.world_from_capsule),
            Instant::Clone(time) => self.clones.get(&time).copied(),
        }
    }

    fn velocity_world_m_s(&self) -> Vector3<f64> {
        self.velocity_world_m_s
    }

    fn angular_rate_capsule_rad_s(&self) -> Vector3<f64> {
        self.angular_rate_capsule_rad_s
    }

    fn block(&self, name: &str) -> Option<DVectorView<'_, f64>> {
        self.blocks.get(name).map(DVector::as_view)
    }
}
