//! The laws every plugin is tested against, as functions that an outside plugin's tests can call too.
//!
//! - [`check_model`]: analytic Jacobian (or gradient) against central differences by every part of the state, at states also
//!   near 0 and π; a part that the model does not name must not matter;
//! - [`check_observed_information`]: the information of a model whose information is the exact curvature of its likelihood;
//! - [`check_front_end_is_deterministic`]: same readings, same measurements; a snapshot goes on as the original does;
//! - [`check_information`]: mean realised information against the expected one;
//! - [`check_sensor_is_deterministic`]: same streams, same bytes; another seed, other bytes;
//! - [`check_units`]: every column's name ends in a unit.

#![expect(clippy::disallowed_types, reason = "world side: the determinism law drives a sensor with a truth")]

use crate::frame::{Reading, Rows, Schema};
use crate::front_end::{FrontEnd, Outcome, PosePrior};
use crate::measurement::{Instant, Linearization, Measurement, MeasurementModel, Part};
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

/// Step of the central differences, in m, rad, m/s or rad/s and in standard deviations of a block: cube root of the machine's
/// precision balances truncation and rounding.
const STEP: f64 = 6e-6;

/// A step along one column of a part. A block has a unit of its own (1e-9 T as well as 40 dB): its step is measured in its
/// initial standard deviation, where the model tells it.
fn step_of(model: &dyn MeasurementModel, part: &Part, column: usize) -> f64 {
    let Part::Block(name) = part else { return STEP };
    let spec = model.blocks().iter().find(|spec| spec.name == *name);
    let sigma = spec.and_then(|spec| spec.initial_sigma.get(column)).copied().filter(|sigma| *sigma > 0.0);
    STEP * sigma.unwrap_or(1.0)
}

/// Every part that a state holds.
fn parts_of(state: &NominalState) -> Vec<Part> {
    let clones = state.clones.keys().map(|at| Part::Pose(Instant::Clone(*at)));
    let blocks = state.blocks.keys().cloned().map(Part::Block);
    let core = [Part::Pose(Instant::Now), Part::Velocity, Part::AngularRate];
    core.into_iter().chain(clones).chain(blocks).collect()
}

/// Central differences of a vector by one part, a column per error column.
fn differences(
    model: &dyn MeasurementModel,
    measurement: &Measurement,
    state: &NominalState,
    part: &Part,
    of: &dyn Fn(&Linearization) -> Result<DVector<f64>, LawViolation>,
) -> Result<DMatrix<f64>, LawViolation> {
    let width = state.dimension(part).ok_or_else(|| LawViolation::MissingPart(part.clone()))?;
    let mut columns = Vec::with_capacity(width);
    for column in 0..width {
        let size = step_of(model, part, column);
        let mut step = DVector::zeros(width);
        step[column] = size;
        let (mut ahead, mut behind) = (state.clone(), state.clone());
        ahead.perturb(part, step.as_view());
        behind.perturb(part, (-step).as_view());
        let (ahead, behind) =
            (of(&model.linearize(measurement, &ahead)?)?, of(&model.linearize(measurement, &behind)?)?);
        if ahead.len() != behind.len() {
            return Err(LawViolation::Derivative { part: part.clone(), relative: f64::NAN, allowed: 0.0 });
        }
        columns.push((ahead - behind) / (2.0 * size));
    }
    Ok(DMatrix::from_columns(&columns))
}

/// Refuses a derivative that differs from the numeric one by more than `allowed` of the largest entry of both.
fn compare(
    part: Part,
    analytic: &DMatrix<f64>,
    numeric: &DMatrix<f64>,
    allowed: f64,
) -> Result<f64, LawViolation> {
    if analytic.shape() != numeric.shape() {
        return Err(LawViolation::Derivative { part, relative: f64::INFINITY, allowed });
    }
    let scale = analytic.amax().max(numeric.amax()).max(f64::MIN_POSITIVE);
    let relative = (analytic - numeric).amax() / scale;
    if relative.is_nan() || relative > allowed {
        return Err(LawViolation::Derivative { part, relative, allowed });
    }
    Ok(relative)
}

/// Compares the derivative by every part that the state holds with central differences; returns the largest relative
/// difference. Give the state what the measurement could depend on: velocity, rate, every block, every clone.
///
/// A part that the model names no derivative by must not change a bit of the value.
///
/// # Errors
/// [`LawViolation`] where it exceeds `allowed`, the model fails, or names a part that the state does not hold.
pub fn check_model(
    model: &dyn MeasurementModel,
    measurement: &Measurement,
    state: &NominalState,
    allowed: f64,
) -> Result<f64, LawViolation> {
    let named = derivatives(&model.linearize(measurement, state)?, state)?;
    let of = |linearization: &Linearization| Ok(values(linearization));
    let mut worst: f64 = 0.0;
    if let Some((part, _)) = named.iter().find(|(part, _)| state.dimension(part).is_none()) {
        return Err(LawViolation::MissingPart(part.clone()));
    }
    for part in parts_of(state) {
        let numeric = differences(model, measurement, state, &part, &of)?;
        let mut analytic = DMatrix::zeros(numeric.nrows(), numeric.ncols());
        // A part that stands twice counts twice.
        for (_, matrix) in named.iter().filter(|(other, _)| *other == part) {
            if matrix.shape() != analytic.shape() {
                return Err(LawViolation::Derivative { part, relative: f64::INFINITY, allowed });
            }
            analytic += matrix;
        }
        worst = worst.max(compare(part, &analytic, &numeric, allowed)?);
    }
    Ok(worst)
}

/// Compares the information of an information form with minus the central differences of its gradient, made symmetric (the
/// gradient is taken in a tangent space that turns with the attitude, which makes them differ by an antisymmetric part in
/// proportion to the gradient). Returns the largest relative difference.
///
/// Only for models whose information is the exact curvature: one with expected information, or with the complete data's
/// away from the peak, differs by design.
///
/// # Errors
/// [`LawViolation::Derivative`] where it exceeds `allowed`; [`LawViolation::Model`] for a residual form.
pub fn check_observed_information(
    model: &dyn MeasurementModel,
    measurement: &Measurement,
    state: &NominalState,
    allowed: f64,
) -> Result<f64, LawViolation> {
    let Linearization::Information { parts, information, .. } = model.linearize(measurement, state)? else {
        return Err(ModalityError::Undefined("a residual form has no information of its own".into()).into());
    };
    let of = |linearization: &Linearization| match linearization {
        Linearization::Information { gradient, .. } => Ok(gradient.clone()),
        Linearization::Residual { .. } => {
            Err(ModalityError::Undefined("a model changed its form between two states".into()).into())
        }
    };
    let mut numeric = DMatrix::zeros(information.nrows(), 0);
    for part in &parts {
        let block = differences(model, measurement, state, part, &of)?;
        let at = numeric.ncols();
        numeric = numeric.insert_columns(at, block.ncols(), 0.0);
        numeric.columns_mut(at, block.ncols()).copy_from(&-block);
    }
    // An information form without parts has nothing to differ in.
    let Some(first) = parts.into_iter().next() else { return Ok(0.0) };
    if numeric.nrows() != numeric.ncols() || numeric.shape() != information.shape() {
        return Err(LawViolation::Derivative { part: first, relative: f64::INFINITY, allowed });
    }
    let symmetric = (&numeric + numeric.transpose()) * 0.5;
    // Each column in its own standard deviation, so that a position's information does not hide an attitude's.
    let sigma = information.diagonal().map(|v| if v == 0.0 { 1.0 } else { 1.0 / v.abs().sqrt() });
    let scaled = |matrix: &DMatrix<f64>| {
        DMatrix::from_fn(sigma.len(), sigma.len(), |i, j| matrix[(i, j)] * sigma[i] * sigma[j])
    };
    compare(first, &scaled(&information), &scaled(&symmetric), allowed)
}

/// Runs two front ends of one kind over the same readings (a third starts from a snapshot halfway) and compares what they say.
///
/// # Errors
/// [`LawViolation::Determinism`] where two answers differ, or the front end fails on a reading or on its own snapshot.
pub fn check_front_end_is_deterministic(
    build: &dyn Fn() -> Box<dyn FrontEnd>,
    readings: &[Reading],
    prior: Option<&PosePrior>,
) -> Result<(), LawViolation> {
    let half = readings.len() / 2;
    let mut first = build();
    let (mut told, mut snapshot) = (Vec::new(), first.snapshot());
    for (k, reading) in readings.iter().enumerate() {
        if k == half {
            snapshot = first.snapshot();
        }
        told.push(answer(first.as_mut(), reading, prior)?);
    }
    let mut again = build();
    let mut restored = build();
    restored.restore(&snapshot)?;
    for (k, reading) in readings.iter().enumerate() {
        if answer(again.as_mut(), reading, prior)? != told[k] {
            return Err(LawViolation::Determinism(format!("reading {k}: two front ends answer differently")));
        }
        if k >= half && answer(restored.as_mut(), reading, prior)? != told[k] {
            let what = format!("reading {k}: a front end restored from its snapshot answers differently");
            return Err(LawViolation::Determinism(what));
        }
    }
    if again.snapshot() != first.snapshot() {
        return Err(LawViolation::Determinism("two front ends end in different states".to_owned()));
    }
    Ok(())
}

/// Everything a front end says, every bit of every number.
fn answer(
    front_end: &mut dyn FrontEnd,
    reading: &Reading,
    prior: Option<&PosePrior>,
) -> Result<String, LawViolation> {
    let outcome = front_end.process(reading, prior)?;
    let details = match &outcome {
        Outcome::Measured(all) => {
            all.iter().map(|m| format!("{m:?} {:?} {:?} {:?}", m.since, m.value, m.fix)).collect()
        }
        Outcome::Nothing | Outcome::Refused { .. } => Vec::new(),
    };
    Ok(format!("{outcome:?} {details:?} {:?}", front_end.wanted_clones()))
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
