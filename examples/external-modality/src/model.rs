//! Times of flight explained by position and speed of sound.
//!
//! Residual: measured minus predicted, one row per beacon that was heard; columns `[δp_world, δθ_capsule]` (attitude: zero) and
//! the block `<sensor>.speed_unit` (s of [`crate::physics`]).

use crate::Installed;
use crate::physics::{derivatives, time_of_flight_s};
use lumenav_core::{
    BlockSpec, Frame, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Name, Noise,
    Part, StateView,
};
use nalgebra::{DMatrix, DVector, Vector3};

/// The measurement model.
pub struct BeaconModel {
    installed: Installed,
    blocks: [BlockSpec; 1],
}

impl BeaconModel {
    /// `speed_ratio_sigma`: prior standard deviation of the speed of sound's deviation.
    pub fn new(sensor: &Name, installed: Installed, speed_ratio_sigma: f64) -> Self {
        let block = BlockSpec {
            name: format!("{sensor}.speed_unit").into(),
            initial: DVector::zeros(1),
            initial_sigma: DVector::from_element(1, speed_ratio_sigma),
            // The tissue on the way changes with the capsule's place: a thousandth within a minute.
            random_walk: DVector::from_element(1, 1e-3 / 60.0_f64.sqrt()),
        };
        Self { installed, blocks: [block] }
    }

    /// The beacons.
    pub fn installed(&self) -> &Installed {
        &self.installed
    }

    /// Index, place and time of flight of every beacon that was heard.
    ///
    /// # Errors
    /// [`ModalityError::Reading`] where the frame is not one of this sensor's.
    pub fn heard<'a>(
        &'a self,
        frame: &'a Frame,
    ) -> Result<impl Iterator<Item = (usize, Vector3<f64>, f64)> + 'a, ModalityError> {
        let times_s = frame.f64("time_of_flight_s")?;
        if times_s.len() != self.installed.beacons_world_m.len() {
            let (got, expected) = (times_s.len(), self.installed.beacons_world_m.len());
            return Err(ModalityError::Reading(format!("{got} times of flight for {expected} beacons")));
        }
        let all = self.installed.beacons_world_m.iter().zip(times_s).zip(frame.valid()).enumerate();
        Ok(all.filter(|(_, (_, valid))| **valid).map(|(i, ((beacon, time), _))| (i, *beacon, *time)))
    }

    fn state(&self, at: &dyn StateView) -> Result<(Vector3<f64>, f64), ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let name = &self.blocks[0].name;
        let speed = at.block(name).ok_or_else(|| ModalityError::MissingBlock(name.to_string()))?;
        Ok((pose.translation.vector, speed[0]))
    }
}

impl MeasurementModel for BeaconModel {
    fn blocks(&self) -> &[BlockSpec] {
        &self.blocks
    }

    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let (position_m, speed_ratio) = self.state(at)?;
        let heard: Vec<_> = self.heard(&m.value)?.collect();
        let mut residual = DVector::zeros(heard.len());
        let mut by_pose = DMatrix::zeros(heard.len(), 6);
        let mut by_speed = DMatrix::zeros(heard.len(), 1);
        for (row, (_, beacon, time_s)) in heard.iter().enumerate() {
            residual[row] = time_s - time_of_flight_s(&position_m, beacon, speed_ratio);
            let (by_position, by_ratio) = derivatives(&position_m, beacon, speed_ratio);
            by_pose.view_mut((row, 0), (1, 3)).copy_from(&by_position.transpose());
            by_speed[(row, 0)] = by_ratio;
        }
        Ok(Linearization::Residual {
            noise: Noise::Diagonal(DVector::from_element(residual.len(), self.installed.sigma_s.powi(2))),
            residual,
            jacobian: vec![
                (Part::Pose(Instant::Now), by_pose),
                (Part::Block(self.blocks[0].name.clone()), by_speed),
            ],
        })
    }

    fn expected_information(
        &self,
        m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        let (position_m, speed_ratio) = self.state(at)?;
        let mut information = DMatrix::zeros(6, 6);
        for (_, beacon, _) in self.heard(&m.value)? {
            let by_position = derivatives(&position_m, &beacon, speed_ratio).0 / self.installed.sigma_s;
            let sum = information.view((0, 0), (3, 3)) + by_position * by_position.transpose();
            information.view_mut((0, 0), (3, 3)).copy_from(&sum);
        }
        Ok(Some(information))
    }
}
