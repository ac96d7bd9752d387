//! The raw model: a flux reading explained by a capsule's pose.
//!
//! Residual `z_k - h_k` over the valid channels, Jacobian by `[δp_world, δθ_capsule]`, independent noise
//! `σ_k² = σ² + (ε z_k)²` with ε the relative model error that the estimator allows for. What is unknown beside the pose is a state of
//! the filter ([`crate::nuisance`]); an ambient field that is not carried is integrated out of each reading, which leaves the
//! differences between channels (orthonormal contrasts).

use crate::channels::{Channels, Prediction};
use crate::nuisance::{Explained, Nuisance};
use crate::solver::{LinearPrior, Unknown};
use lumenav_core::fix::FixModel;
use lumenav_core::linear::generalised_inverse;
use lumenav_core::{
    BlockSpec, Frame, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Noise, Part,
    StateView,
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
    /// What this reading alone has to tell beside the pose: it takes from the information. No state of the filter.
    pub unknown: Unknown,
    /// What is known of that beforehand.
    pub prior: LinearPrior,
    /// What the filter carries from reading to reading.
    pub nuisance: Arc<Nuisance>,
}

impl FluxModel {
    /// Variance of a channel's noise, T².
    pub fn variance(&self, flux_tesla: f64) -> f64 {
        self.noise_tesla.powi(2) + (self.relative_error * flux_tesla).powi(2)
    }

    fn predicted(&self, at: &dyn StateView) -> Result<Explained, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        self.nuisance.explain(&self.channels, at, |channels| {
            let mut buffers = Prediction::default();
            let (flux, jacobian) =
                channels.linearize_capsule(&self.source, &pose, &self.offset_capsule_m, &mut buffers);
            (flux, jacobian, buffers.fields().collect())
        })
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

    /// Takes the ambient field out of whitened rows (residual first): rotated by the reflections that turn `[W^½ A; Λ^½]` into a triangle,
    /// of which the first rows hold what is told of the field, and nothing else is lost. Gives independent rows of unit noise. Directions of the
    /// field that no channel reads along have no row.
    fn without_ambient(&self, rows: DMatrix<f64>, axes: DMatrix<f64>) -> DMatrix<f64> {
        let count = rows.nrows();
        let root = self.prior.ambient.cholesky().map(|factor| factor.l().transpose());
        let extra = if root.is_some() { 3 } else { 0 };
        let mut rows = rows.resize_vertically(count + extra, 0.0);
        let mut axes = axes.resize_vertically(count + extra, 0.0);
        if let Some(root) = root {
            axes.view_mut((count, 0), (3, 3)).copy_from(&root);
        }
        let told = told_directions(&axes);
        let kept = (count + extra).min(told.ncols());
        (axes * told).qr().q_tr_mul(&mut rows);
        rows.remove_rows(0, kept)
    }

    /// The residual form whose ambient field is integrated out.
    fn marginal(&self, valid: &[usize], variance: &DVector<f64>, rows: DMatrix<f64>) -> DMatrix<f64> {
        let mut axes = DMatrix::zeros(valid.len(), 3);
        for (row, k) in valid.iter().enumerate() {
            axes.row_mut(row).tr_copy_from(&self.channels.channels[*k].axis_world);
        }
        let mut rows = rows;
        for (row, variance) in variance.iter().enumerate() {
            let weight = 1.0 / variance.sqrt();
            axes.row_mut(row).scale_mut(weight);
            rows.row_mut(row).scale_mut(weight);
        }
        self.without_ambient(rows, axes)
    }
}

impl MeasurementModel for FluxModel {
    fn blocks(&self) -> &[BlockSpec] {
        self.nuisance.specs()
    }

    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let (flux, valid) = self.readings(m)?;
        let explained = self.predicted(at)?;
        let rows: Vec<usize> = (0..flux.len()).filter(|k| valid[*k]).collect();
        let pick = |f: &dyn Fn(usize) -> f64| DVector::from_iterator(rows.len(), rows.iter().map(|k| f(*k)));
        let residual = pick(&|k| flux[k] - explained.flux_tesla[k]);
        let variance = pick(&|k| self.variance(flux[k]));
        let parts = std::iter::once((Part::Pose(Instant::Now), explained.by_pose)).chain(explained.by_block);
        let jacobian: Vec<(Part, DMatrix<f64>)> = if rows.len() == flux.len() {
            parts.collect()
        } else {
            parts.map(|(part, matrix)| (part, matrix.select_rows(&rows))).collect()
        };
        if !self.unknown.ambient {
            return Ok(Linearization::Residual { residual, jacobian, noise: Noise::Diagonal(variance) });
        }
        // Residual and all Jacobians side by side go through the same reflections.
        let width = 1 + jacobian.iter().map(|(_, matrix)| matrix.ncols()).sum::<usize>();
        let mut all = DMatrix::zeros(rows.len(), width);
        all.set_column(0, &residual);
        let mut column = 1;
        for (_, matrix) in &jacobian {
            all.columns_mut(column, matrix.ncols()).copy_from(matrix);
            column += matrix.ncols();
        }
        let kept = self.marginal(&rows, &variance, all);
        let mut column = 1;
        let jacobian = jacobian
            .into_iter()
            .map(|(part, matrix)| {
                let columns = kept.columns(column, matrix.ncols()).into_owned();
                column += matrix.ncols();
                (part, columns)
            })
            .collect();
        let noise = Noise::Diagonal(DVector::from_element(kept.nrows(), 1.0));
        Ok(Linearization::Residual { residual: kept.column(0).into_owned(), jacobian, noise })
    }

    fn expected_information(
        &self,
        m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        let (flux, valid) = self.readings(m)?;
        let Explained { flux_tesla: predicted, by_pose: mut jacobian, .. } = self.predicted(at)?;
        for k in 0..flux.len() {
            let weight = if valid[k] { 1.0 / self.variance(predicted[k]).sqrt() } else { 0.0 };
            jacobian.row_mut(k).scale_mut(weight);
        }
        let information = jacobian.tr_mul(&jacobian);
        if self.unknown == Unknown::default() {
            return Ok(Some(information));
        }
        let mut nuisance = DMatrix::zeros(flux.len() + 3, self.unknown.count());
        for (k, channel) in self.channels.channels.iter().enumerate().filter(|(k, _)| valid[*k]) {
            let weight = 1.0 / self.variance(predicted[k]).sqrt();
            let strength = self.unknown.strength.then_some(predicted[k]);
            let ambient = channel.axis_world.iter().copied().filter(|_| self.unknown.ambient);
            for (i, value) in strength.into_iter().chain(ambient).enumerate() {
                nuisance[(k, i)] = weight * value;
            }
        }
        let first = usize::from(self.unknown.strength);
        let known = self.prior.ambient.cholesky().filter(|_| self.unknown.ambient);
        if let Some(known) = known {
            nuisance.view_mut((flux.len(), first), (3, 3)).copy_from(&known.l().transpose());
        }
        let mut told = nuisance.tr_mul(&nuisance);
        if self.unknown.strength {
            told[(0, 0)] += self.prior.strength;
        }
        let (covariance, _) = generalised_inverse(&told);
        let mixed = jacobian.tr_mul(&nuisance.rows(0, flux.len()));
        Ok(Some(information - &mixed * covariance * mixed.transpose()))
    }

    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

/// Directions, as columns, along which axes read anything at all.
fn told_directions(axes: &DMatrix<f64>) -> DMatrix<f64> {
    /// Below this share of the largest eigenvalue a direction is rounding.
    const LEAST: f64 = 1e-12;
    let eigen = axes.tr_mul(axes).symmetric_eigen();
    let least = LEAST * eigen.eigenvalues.max();
    let told = (0..3).filter(|i| eigen.eigenvalues[*i] > least);
    eigen.eigenvectors.select_columns(&told.collect::<Vec<_>>())
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
