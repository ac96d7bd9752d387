//! What a filter consumes: a measurement, and the model that explains it.
//!
//! A model is asked about a *state*, never about a belief: iterated updates, sigma points and particles look away from
//! the mean, and a model that sees a covariance will use it twice.

use crate::Name;
use crate::fix::{MotionEstimate, PoseEstimate};
use crate::frame::{Frame, Reading};
use crate::modality::ModalityError;
use crate::time::SimTime;
use nalgebra::{DMatrix, DVector, DVectorView, Isometry3, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Which pose of the state is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Instant {
    /// The capsule at the measurement's own time.
    Now,
    /// The stochastic clone that the filter keeps of the pose at this time.
    Clone(SimTime),
}

/// A group of columns of the error state. The filter owns the order.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// `[δp_world (m), δθ_capsule (rad)]`, 6 columns.
    Pose(Instant),
    /// `δv_world` (m/s), 3 columns.
    Velocity,
    /// `δω_capsule` (rad/s), 3 columns.
    AngularRate,
    /// A nuisance block by name, as many columns as its [`BlockSpec`] says.
    Block(Name),
}

/// The nominal state, without its covariance.
pub trait StateView {
    /// Pose now, or of a clone; `None` where there is no such clone.
    fn world_from_capsule(&self, at: Instant) -> Option<Isometry3<f64>>;
    /// Velocity in the world, m/s.
    fn velocity_world_m_s(&self) -> Vector3<f64>;
    /// Angular rate in the capsule's frame, rad/s.
    fn angular_rate_capsule_rad_s(&self) -> Vector3<f64>;
    /// A nuisance block's values; `None` where the track does not estimate it.
    fn block(&self, name: &str) -> Option<DVectorView<'_, f64>>;
}

/// Covariance of a residual.
#[derive(Clone, Debug)]
pub enum Noise {
    /// Independent channels: their variances.
    Diagonal(DVector<f64>),
    /// Independent groups of channels, in order.
    Blocks(Vec<DMatrix<f64>>),
    /// All correlated.
    Full(DMatrix<f64>),
}

/// A measurement as seen from one state.
#[derive(Clone, Debug)]
pub enum Linearization {
    /// `z - h(x)`, `∂h/∂(error)` per part, and R.
    Residual {
        /// `z - h(x)`.
        residual: DVector<f64>,
        /// `∂h/∂part`, as many rows as the residual.
        jacobian: Vec<(Part, DMatrix<f64>)>,
        /// Covariance of the residual's noise.
        noise: Noise,
    },
    /// Gradient and curvature of the log-likelihood, for hundreds to thousands of unlabelled events.
    ///
    /// `information` is the *observed* information (the missing part of an expectation-maximisation subtracted, Louis
    /// 1982); the complete-data one would be overconfident.
    Information {
        /// The columns, in order.
        parts: Vec<Part>,
        /// `∂ log p/∂(error)`.
        gradient: DVector<f64>,
        /// `-∂² log p/∂(error)²`, symmetric positive semidefinite.
        information: DMatrix<f64>,
        /// `log p(z | x)` up to a constant of the measurement.
        log_likelihood: f64,
        /// How many events carried it (responsibility-weighted): reports, and refusing windows that are all background.
        effective_count: f64,
    },
}

/// A nuisance state that a model asks the filter to estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockSpec {
    /// Unique name, `<sensor>.<what>_<unit>`.
    pub name: Name,
    /// Start values.
    pub initial: DVector<f64>,
    /// Their standard deviations.
    pub initial_sigma: DVector<f64>,
    /// Random walk, unit per square root of a second; 0 for a constant.
    pub random_walk: DVector<f64>,
}

/// Explains a measurement by a state.
pub trait MeasurementModel: Send + Sync {
    /// Nuisance blocks that this model reads, with prior and random walk.
    fn blocks(&self) -> &[BlockSpec] {
        &[]
    }

    /// Residual or information form at a state.
    ///
    /// # Errors
    /// [`ModalityError`] where the state lacks what the model reads (a clone, a block) or the model is undefined there.
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError>;

    /// `out[i] = log p(m | states[i])`, up to a constant of the measurement. The default evaluates [`Self::linearize`].
    ///
    /// # Errors
    /// As [`Self::linearize`].
    fn log_likelihoods(
        &self,
        m: &Measurement,
        states: &[&dyn StateView],
        out: &mut [f64],
    ) -> Result<(), ModalityError> {
        for (state, value) in states.iter().zip(out) {
            *value = log_likelihood_of(&self.linearize(m, *state)?);
        }
        Ok(())
    }

    /// Expected (not realised) information about `[δp_world, δθ_capsule]` at a state: what bounds and layouts ask.
    /// Known nuisance; `None` where the model has no closed form.
    ///
    /// # Errors
    /// As [`Self::linearize`].
    fn expected_information(
        &self,
        _m: &Measurement,
        _at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        Ok(None)
    }

    /// Whether the update should be iterated (strongly nonlinear in the pose).
    fn strongly_nonlinear(&self) -> bool {
        false
    }
}

/// `log p` of a linearization, up to terms that do not depend on the state.
fn log_likelihood_of(linearization: &Linearization) -> f64 {
    match linearization {
        Linearization::Information { log_likelihood, .. } => *log_likelihood,
        Linearization::Residual { residual, noise, .. } => match noise {
            Noise::Diagonal(variances) => {
                -0.5 * residual.iter().zip(variances.iter()).map(|(r, v)| r * r / v).sum::<f64>()
            }
            Noise::Full(covariance) => -0.5 * weighted_square(residual, covariance),
            Noise::Blocks(blocks) => {
                let mut start = 0;
                let mut sum = 0.0;
                for block in blocks {
                    let part = residual.rows(start, block.nrows()).into_owned();
                    sum += weighted_square(&part, block);
                    start += block.nrows();
                }
                -0.5 * sum
            }
        },
    }
}

/// `rᵀ C⁻¹ r`; infinite where C is not positive definite, so that such a state has no likelihood.
fn weighted_square(residual: &DVector<f64>, covariance: &DMatrix<f64>) -> f64 {
    covariance.clone().cholesky().map_or(f64::INFINITY, |c| residual.dot(&c.solve(residual)))
}

/// What the prior did to a measurement's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PriorUse {
    /// Nothing: the value is independent of the filter.
    None,
    /// A start point or an association; the value's noise is still independent of the filter.
    StartOnly,
    /// The value already contains the prior: it is a track of its own, and a filter refuses to fuse it.
    Contained,
}

/// One measurement of one sensor, as a front end hands it to a filter.
#[derive(Clone)]
pub struct Measurement {
    /// The sensor.
    pub sensor: Name,
    /// The reading's sequence number.
    pub sequence: u64,
    /// The instant it is about.
    pub at: SimTime,
    /// When it was available.
    pub arrival: SimTime,
    /// For relative motion: the filter must hold a clone of this instant.
    pub since: Option<SimTime>,
    /// The numbers that the model explains.
    pub value: Arc<Frame>,
    /// The model.
    pub model: Arc<dyn MeasurementModel>,
    /// What the prior did to it.
    pub prior_use: PriorUse,
    /// The front end's own pose, where it makes one: the estimate of a track without a filter, the start of one with.
    pub fix: Option<PoseEstimate>,
    /// How the capsule moves, beside the fix, where the front end saw it over some time: looked at where the fix starts a filter.
    pub motion: Option<MotionEstimate>,
}

impl Measurement {
    /// A whole reading, as it is: its payload is the value, nothing of the prior went in, and no fix stands beside it.
    pub fn of_reading(reading: &Reading, model: Arc<dyn MeasurementModel>) -> Self {
        Self {
            sensor: reading.sensor.clone(),
            sequence: reading.sequence,
            at: reading.at(),
            arrival: reading.arrival,
            since: None,
            value: Arc::new(reading.payload.clone()),
            model,
            prior_use: PriorUse::None,
            fix: None,
            motion: None,
        }
    }
}

impl std::fmt::Debug for Measurement {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Measurement")
            .field("sensor", &self.sensor)
            .field("sequence", &self.sequence)
            .field("at", &self.at)
            .field("arrival", &self.arrival)
            .field("prior_use", &self.prior_use)
            .finish_non_exhaustive()
    }
}
