//! The estimator side of a plugin: from readings to measurements.

use crate::Name;
use crate::fix::{FixKind, PoseEstimate};
use crate::frame::Reading;
use crate::measurement::{BlockSpec, Measurement, StateView};
use crate::modality::ModalityError;
use crate::primitive::Primitive;
use crate::time::SimTime;
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::sync::Arc;

/// The filter's prediction at the time of a reading: a start point, never evidence.
#[derive(Clone, Debug)]
pub struct PosePrior {
    /// The instant.
    pub at: SimTime,
    /// Predicted pose and covariance.
    pub pose: PoseEstimate,
    /// Predicted velocity in the world, m/s, where the filter has one: what a reading that lasts can be straightened by.
    pub velocity_world_m_s: Option<Vector3<f64>>,
}

/// What a front end made of a reading.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// Measurements, in time order.
    Measured(Vec<Measurement>),
    /// Nothing to say (yet).
    Nothing,
    /// The reading was looked at and refused, and why.
    Refused {
        /// In words.
        why: Name,
    },
}

/// Turns one sensor's readings into measurements. One per track and trial.
///
/// Called once per reading, in the order of arrival. A filter replays measurements, never readings; a front end that
/// keeps no state gives bit-equal tracks under any arrival order within the filter's lag.
pub trait FrontEnd: Send {
    /// Looks at one reading. `prior` is the filter's prediction, or `None` where there is no filter or it has not started.
    ///
    /// # Errors
    /// [`ModalityError`] where the reading does not fit the installed sensor.
    fn process(&mut self, reading: &Reading, prior: Option<&PosePrior>) -> Result<Outcome, ModalityError>;

    /// Instants of which the filter must keep a clone (key frames).
    fn wanted_clones(&self) -> Vec<SimTime> {
        Vec::new()
    }

    /// How much of a pose its sensor can tell apart, however many readings there are: three markers in an isosceles triangle
    /// leave two rolls, and a filter that has settled on one of them does not know it. A track claims no more than the best of its
    /// sensors can tell.
    fn resolves(&self) -> FixKind {
        FixKind::Full
    }

    /// Nuisance blocks that the measurements' models will read.
    fn blocks(&self) -> Vec<BlockSpec> {
        Vec::new()
    }

    /// State as bytes; empty for a stateless front end.
    fn snapshot(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Back to a snapshot.
    ///
    /// # Errors
    /// [`ModalityError::Snapshot`] where the bytes are not one of this front end's.
    fn restore(&mut self, bytes: &[u8]) -> Result<(), ModalityError> {
        if bytes.is_empty() { Ok(()) } else { Err(ModalityError::Snapshot) }
    }

    /// What of the last reading is worth drawing.
    fn scene(&self, _out: &mut Vec<Primitive>) {}
}

/// Body motion that an inertial reading measured over its interval.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionSample {
    /// Mean angular rate over the interval in the capsule's frame, rad/s, bias removed.
    pub angular_rate_capsule_rad_s: Vector3<f64>,
    /// Its covariance, (rad/s)².
    pub covariance: Matrix3<f64>,
    /// The block that holds its bias, and `∂rate/∂block` (3 rows).
    pub bias: Option<(Name, DMatrix<f64>)>,
}

/// An inertial sensor that drives the prediction instead of correcting it.
pub trait MotionInput: Send + Sync {
    /// Nuisance blocks (biases) that the filter must carry.
    fn blocks(&self) -> Vec<BlockSpec> {
        Vec::new()
    }

    /// The motion over the reading's interval, seen from a state (for its bias).
    ///
    /// # Errors
    /// [`ModalityError`] where the reading does not fit the installed sensor.
    fn sample(&self, reading: &Reading, state: &dyn StateView) -> Result<MotionSample, ModalityError>;
}

/// What a modality contributes to a track.
pub struct Estimator {
    /// Makes measurements of readings.
    pub front_end: Option<Box<dyn FrontEnd>>,
    /// Drives the prediction.
    pub motion_input: Option<Arc<dyn MotionInput>>,
}

impl Estimator {
    /// Measurements only: what most modalities are.
    pub fn of_front_end(front_end: impl FrontEnd + 'static) -> Self {
        Self { front_end: Some(Box::new(front_end)), motion_input: None }
    }
}
