//! The raw model: a flux reading explained by a capsule's pose.
//!
//! Residual `z_k - h_k` over the valid channels, Jacobian by `[δp_world, δθ_capsule]`, independent noise
//! `σ_k² = σ² + (ε z_k)²` with ε the relative model error that the estimator allows for.

use crate::bound::inverse_of_information;
use crate::channels::{Channels, Prediction};
use crate::solver::Unknown;
use lumenav_core::fix::FixModel;
use lumenav_core::{
    Frame, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Noise, Part, StateView,
};
use lumenav_fields::FieldSource;
use nalgebra::{DMatrix, DVector, Vector3};
use std::sync::Arc;

/// Flux readings of an array at known places.
#[derive(Clone, Debug)]
pub struct FluxModel {
    /// The channels at the reading's time.
    pub channels: Arc<Channels>,
    /// The assumed source.
    pub source: FieldSource,
    /// The magnet in the capsule, m.
    pub offset_capsule_m: Vector3<f64>,
    /// Assumed noise, T.
    pub noise_tesla: f64,
    /// Assumed relative model error.
    pub relative_error: f64,
    /// What the estimator does not know beside the pose: it takes from the information.
    pub unknown: Unknown,
}

impl FluxModel {
    /// Variance of a channel's noise, T².
    pub fn variance(&self, flux_tesla: f64) -> f64 {
        self.noise_tesla.powi(2) + (self.relative_error * flux_tesla).powi(2)
    }

    fn predicted(&self, at: &dyn StateView) -> Result<(DVector<f64>, DMatrix<f64>), ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let mut buffers = Prediction::default();
        Ok(self.channels.linearize_capsule(&self.source, &pose, &self.offset_capsule_m, &mut buffers))
    }

    fn readings<'m>(&self, m: &'m Measurement) -> Result<(&'m [f64], &'m [bool]), ModalityError> {
        let flux = m.value.f64("flux_tesla")?;
        if flux.len() != self.channels.len() {
            return Err(ModalityError::Reading(format!(
                "{} flux readings, the array has {} channels",
                flux.len(),
                self.channels.len()
            )));
        }
        Ok((flux, m.value.valid()))
    }
}

impl MeasurementModel for FluxModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let (flux, valid) = self.readings(m)?;
        let (predicted, jacobian) = self.predicted(at)?;
        if valid.iter().all(|v| *v) {
            let variance = DVector::from_iterator(flux.len(), flux.iter().map(|z| self.variance(*z)));
            let residual = DVector::from_column_slice(flux) - predicted;
            let jacobian = vec![(Part::Pose(Instant::Now), jacobian)];
            return Ok(Linearization::Residual { residual, jacobian, noise: Noise::Diagonal(variance) });
        }
        let rows: Vec<usize> = (0..flux.len()).filter(|k| valid[*k]).collect();
        let pick = |f: &dyn Fn(usize) -> f64| DVector::from_iterator(rows.len(), rows.iter().map(|k| f(*k)));
        Ok(Linearization::Residual {
            residual: pick(&|k| flux[k] - predicted[k]),
            jacobian: vec![(Part::Pose(Instant::Now), jacobian.select_rows(&rows))],
            noise: Noise::Diagonal(pick(&|k| self.variance(flux[k]))),
        })
    }

    fn expected_information(
        &self,
        m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        let (flux, valid) = self.readings(m)?;
        let (predicted, mut jacobian) = self.predicted(at)?;
        for k in 0..flux.len() {
            let weight = if valid[k] { 1.0 / self.variance(predicted[k]).sqrt() } else { 0.0 };
            jacobian.row_mut(k).scale_mut(weight);
        }
        let information = jacobian.tr_mul(&jacobian);
        if self.unknown == Unknown::default() {
            return Ok(Some(information));
        }
        let mut nuisance = DMatrix::zeros(flux.len(), self.unknown.count());
        for (k, channel) in self.channels.channels.iter().enumerate().filter(|(k, _)| valid[*k]) {
            let weight = 1.0 / self.variance(predicted[k]).sqrt();
            let strength = self.unknown.strength.then_some(predicted[k]);
            let ambient = channel.axis_world.iter().copied().filter(|_| self.unknown.ambient);
            for (i, value) in strength.into_iter().chain(ambient).enumerate() {
                nuisance[(k, i)] = weight * value;
            }
        }
        // Nothing is known of the pose where nothing tells what else is unknown.
        let Some(covariance) = inverse_of_information(&nuisance) else {
            return Ok(Some(DMatrix::zeros(6, 6)));
        };
        let mixed = jacobian.tr_mul(&nuisance);
        Ok(Some(information - &mixed * covariance * mixed.transpose()))
    }

    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

/// A maximum-likelihood fix that remembers the reading it came from.
///
/// To a filter it is a pose with a covariance; to whoever asks for the bound it is the flux reading, because the fix's own
/// covariance is an estimate of the bound and not the bound.
#[derive(Clone, Debug)]
pub struct FixOfFlux {
    /// The raw model.
    pub flux: FluxModel,
    /// The reading.
    pub reading: Arc<Frame>,
}

impl MeasurementModel for FixOfFlux {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        FixModel.linearize(m, at)
    }

    fn expected_information(
        &self,
        m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        let raw = Measurement { value: self.reading.clone(), ..m.clone() };
        self.flux.expected_information(&raw, at)
    }

    fn strongly_nonlinear(&self) -> bool {
        FixModel.strongly_nonlinear()
    }
}
