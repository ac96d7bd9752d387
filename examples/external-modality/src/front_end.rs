//! The estimator side: a reading becomes one measurement, with a position to start a filter from where four beacons are heard.

use crate::model::BeaconModel;
use crate::physics::locate;
use lumenav_core::{
    BlockSpec, FixKind, FrontEnd, Measurement, MeasurementModel as _, ModalityError, Outcome, PoseEstimate,
    PosePrior, Reading,
};
use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion};
use std::sync::Arc;

/// Keeps no state.
pub struct BeaconFrontEnd {
    model: Arc<BeaconModel>,
}

impl BeaconFrontEnd {
    /// Measurements that this model explains.
    pub fn new(model: BeaconModel) -> Self {
        Self { model: Arc::new(model) }
    }

    fn fix(&self, reading: &Reading) -> Result<Option<PoseEstimate>, ModalityError> {
        let seen: Vec<_> =
            self.model.heard(&reading.payload)?.map(|(_, beacon, time_s)| (beacon, time_s)).collect();
        Ok(locate(&seen, self.model.installed().sigma_s).map(|(position, variance_m2)| {
            let mut covariance = Matrix6::zeros();
            covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&variance_m2);
            PoseEstimate {
                world_from_capsule: Isometry3::from_parts(
                    Translation3::from(position),
                    UnitQuaternion::identity(),
                ),
                covariance,
                kind: FixKind::Position,
            }
        }))
    }
}

impl FrontEnd for BeaconFrontEnd {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        if !reading.payload.valid().contains(&true) {
            return Ok(Outcome::Refused { why: "no beacon was heard".into() });
        }
        Ok(Outcome::Measured(vec![Measurement {
            fix: self.fix(reading)?,
            ..Measurement::of_reading(reading, self.model.clone())
        }]))
    }

    fn blocks(&self) -> Vec<BlockSpec> {
        self.model.blocks().to_vec()
    }
}
