//! The laws every plugin is tested against, as functions that an outside plugin's tests can call too.
//!
//! - [`check_model`]: analytic Jacobian (or gradient) against central differences, at states also near 0 and π;
//! - [`check_information`]: mean realised information against the expected one;
//! - [`check_sensor_is_deterministic`]: same streams, same bytes; another seed, other bytes;
//! - [`check_units`]: every column's name ends in a unit.

#![expect(clippy::disallowed_types, reason = "world side: the determinism law drives a sensor with a truth")]

use crate::frame::{Rows, Schema};
use crate::measurement::{Linearization, Measurement, MeasurementModel, Part};
use crate::modality::ModalityError;
use crate::random::RandomStreams;
use crate::sensor::Sensor;
use crate::state::NominalState;
use crate::time::SimTime;
use crate::truth::TruthView;
use crate::units::unit_of;
use nalgebra::{DMatrix, DVector};

/// A law that does not hold, and where.
#[derive(Debug, thiserror::Error)]
pub enum LawViolation {
    /// The model could not be evaluated.
    #[error(transparent)]
    Model(#[from] ModalityError),
    /// The state does not hold a part that the model differentiates by.
    #[error("the state does not hold {0:?}")]
    MissingPart(Part),
    /// Analytic and numeric derivative differ.
    #[error(
        "derivative by {part:?}: analytic and central differences differ by {relative:.2e} (allowed {allowed:.1e})"
    )]
    Derivative {
        /// By which part.
        part: Part,
        /// Largest difference over the largest entry.
        relative: f64,
        /// The tolerance asked for.
        allowed: f64,
    },
    /// Expected and mean realised information differ.
    #[error(
        "information: expected and mean realised differ by {relative:.2e} of the norm (allowed {allowed:.1e})"
    )]
    Information {
        /// Frobenius norm of the difference over that of the expected.
        relative: f64,
        /// The tolerance asked for.
        allowed: f64,
    },
    /// Two runs of one sensor differ, or two seeds agree.
    #[error("determinism: {0}")]
    Determinism(String),
    /// A column without a unit.
    #[error("column `{0}` does not end in a unit")]
    Unit(String),
}

/// Step of the central differences: cube root of the machine's precision balances truncation and rounding.
const STEP: f64 = 6e-6;

/// Compares the derivative by every part with central differences; returns the largest relative difference.
///
/// # Errors
/// [`LawViolation`] where it exceeds `allowed`, or the model fails.
pub fn check_model(
    model: &dyn MeasurementModel,
    measurement: &Measurement,
    state: &NominalState,
    allowed: f64,
) -> Result<f64, LawViolation> {
    let mut worst: f64 = 0.0;
    for (part, analytic) in derivatives(&model.linearize(measurement, state)?, state)? {
        let mut numeric = DMatrix::zeros(analytic.nrows(), analytic.ncols());
        for column in 0..analytic.ncols() {
            let mut step = DVector::zeros(analytic.ncols());
            step[column] = STEP;
            let (mut ahead, mut behind) = (state.clone(), state.clone());
            ahead.perturb(&part, step.as_view());
            behind.perturb(&part, (-step).as_view());
            let difference = values(&model.linearize(measurement, &ahead)?)
                - values(&model.linearize(measurement, &behind)?);
            numeric.set_column(column, &(difference / (2.0 * STEP)));
        }
        let scale = analytic.amax().max(numeric.amax()).max(f64::MIN_POSITIVE);
        let relative = (&analytic - &numeric).amax() / scale;
        if relative.is_nan() || relative > allowed {
            return Err(LawViolation::Derivative { part, relative, allowed });
        }
        worst = worst.max(relative);
    }
    Ok(worst)
}

/// `∂(value)/∂part` with value = residual (sign turned: `z - h`) or log-likelihood.
fn derivatives(
    linearization: &Linearization,
    state: &NominalState,
) -> Result<Vec<(Part, DMatrix<f64>)>, LawViolation> {
    match linearization {
        Linearization::Residual { jacobian, .. } => {
            Ok(jacobian.iter().map(|(part, matrix)| (part.clone(), -matrix)).collect())
        }
        Linearization::Information { parts, gradient, .. } => {
            let mut start = 0;
            let mut all = Vec::new();
            for part in parts {
                let size = state.dimension(part).ok_or_else(|| LawViolation::MissingPart(part.clone()))?;
                all.push((part.clone(), gradient.rows(start, size).transpose().into_owned()));
                start += size;
            }
            Ok(all.into_iter().map(|(p, m)| (p, DMatrix::from_row_slice(1, m.len(), m.as_slice()))).collect())
        }
    }
}

fn values(linearization: &Linearization) -> DVector<f64> {
    match linearization {
        Linearization::Residual { residual, .. } => residual.clone(),
        Linearization::Information { log_likelihood, .. } => DVector::from_element(1, *log_likelihood),
    }
}

/// Compares the mean of realised information matrices with the expected one; returns the relative difference.
///
/// # Errors
/// [`LawViolation::Information`] where it exceeds `allowed`.
pub fn check_information(
    expected: &DMatrix<f64>,
    realised: &[DMatrix<f64>],
    allowed: f64,
) -> Result<f64, LawViolation> {
    let mut mean = DMatrix::zeros(expected.nrows(), expected.ncols());
    for one in realised {
        mean += one;
    }
    mean /= realised.len().max(1) as f64;
    let relative = (&mean - expected).norm() / expected.norm().max(f64::MIN_POSITIVE);
    if relative.is_nan() || relative > allowed {
        return Err(LawViolation::Information { relative, allowed });
    }
    Ok(relative)
}

/// Runs a sensor `count` times twice with one seed and once with another.
///
/// # Errors
/// [`LawViolation::Determinism`] where the first two differ or the third agrees.
pub fn check_sensor_is_deterministic(
    build: &dyn Fn() -> Box<dyn Sensor>,
    truth: &dyn TruthView,
    component: &str,
    count: usize,
) -> Result<(), LawViolation> {
    let run = |seed: u64| -> Result<Vec<String>, LawViolation> {
        let streams = RandomStreams::new(seed, 0, component);
        let mut sensor = build();
        let mut all = Vec::new();
        for _ in 0..count {
            let at: SimTime = sensor.next_due();
            let observation = sensor.observe(truth, at, &streams)?;
            // Debug prints every bit of every number, labels included.
            all.push(format!("{observation:?}"));
        }
        Ok(all)
    };
    let (first, again, other) = (run(1)?, run(1)?, run(2)?);
    if let Some(at) = first.iter().zip(&again).position(|(a, b)| a != b) {
        return Err(LawViolation::Determinism(format!("reading {at} differs between two equal runs")));
    }
    if first == other {
        return Err(LawViolation::Determinism("another seed gives the same readings".to_owned()));
    }
    Ok(())
}

/// Every column (or channel label) of a schema ends in a unit.
///
/// # Errors
/// [`LawViolation::Unit`] with the first that does not.
pub fn check_units(schema: &Schema) -> Result<(), LawViolation> {
    let labels: Vec<&String> = match &schema.rows {
        Rows::Channels(labels) => labels.iter().collect(),
        Rows::Events => schema.columns.iter().map(|c| &c.name).collect(),
    };
    match labels.into_iter().find(|name| unit_of(name).is_none()) {
        Some(name) => Err(LawViolation::Unit(name.clone())),
        None => Ok(()),
    }
}
