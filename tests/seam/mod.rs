//! Witnesses of the plugin seam: four tiny plugins that know `lumenav::core` alone, each run through the filter against
//! numbers that an independent program made of the same readings (`tests/cross`, with the script beside each file).
//!
//! | witness | what of the seam it needs | against |
//! |---|---|---|
//! | [`ranges`] | a residual, a nuisance block with prior and random walk | FilterPy's extended Kalman filter |
//! | [`odometry`] | a stochastic clone, two sensors, a fix that starts the filter | GTSAM's iSAM2 |
//! | [`lines`] | 500 unlabelled lines as gradient and observed information | 40-digit automatic derivatives; NEES over seeds |
//! | [`gyro`] | a motion input with a bias block | a filter in NumPy |
//!
//! Each also obeys the laws of `lumenav::core::laws`; [`world`] holds their sensors and the truth these look at.

mod gyro;
mod lines;
mod odometry;
mod ranges;
mod world;

use lumenav::core::config::quantity::{Finite, NonNegative, Positive};
use lumenav::core::{Frame, FrontEnd, Measurement, MotionModel, Name, Outcome, Reading, Schema, SimTime};
use lumenav::fusion::options::Probability;
use lumenav::fusion::{EskfOptions, PriorOptions};
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A committed document of `tests/cross`.
struct Document(serde_json::Value);

impl Document {
    fn parse(text: &str) -> Self {
        Self(serde_json::from_str(text).unwrap())
    }

    fn number(&self, key: &str) -> f64 {
        self.0[key].as_f64().unwrap_or_else(|| panic!("{key} is no number"))
    }

    fn numbers(&self, key: &str) -> Vec<f64> {
        numbers(&self.0[key])
    }

    fn rows(&self, key: &str) -> Vec<Vec<f64>> {
        self.0[key].as_array().unwrap_or_else(|| panic!("{key} is no array")).iter().map(numbers).collect()
    }
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn vector(values: &[f64]) -> Vector3<f64> {
    Vector3::from_column_slice(values)
}

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

/// A reading of channels or events that holds an instant or an interval and arrives at once.
fn reading(sensor: &str, sequence: u64, interval: (SimTime, SimTime), payload: Frame) -> Reading {
    Reading {
        sensor: Name::from(sensor),
        sequence,
        interval,
        arrival: interval.1,
        known_poses: BTreeMap::new(),
        payload,
    }
}

fn instant(sensor: &str, sequence: u64, at: SimTime, schema: &Arc<Schema>, values: &[f64]) -> Reading {
    reading(sensor, sequence, (at, at), Frame::of_values(schema.clone(), values.to_vec()).unwrap())
}

/// The one measurement that a front end makes of a reading.
fn measured(front_end: &mut dyn FrontEnd, reading: &Reading) -> Measurement {
    match front_end.process(reading, None).unwrap() {
        Outcome::Measured(mut all) if all.len() == 1 => all.remove(0),
        other => panic!("expected one measurement, got {other:?}"),
    }
}

/// Options that never gate, never give up and move by white noises of these sizes.
fn options(velocity_random_walk: f64, rate_random_walk: f64) -> EskfOptions {
    EskfOptions {
        motion: MotionModel {
            velocity_random_walk_m_s_per_sqrt_s: NonNegative(velocity_random_walk),
            velocity_time_constant_s: None,
            rate_random_walk_rad_s_per_sqrt_s: NonNegative(rate_random_walk),
            rate_time_constant_s: None,
        },
        gate_probability: Probability(1.0 - 1e-12),
        lost_position_sigma_m: Positive(1e6),
        ..EskfOptions::default()
    }
}

fn prior(position_sigma_m: f64, rotation_vector_rad: &Vector3<f64>, rotation_sigma_rad: f64) -> PriorOptions {
    PriorOptions {
        position_mm: [Finite(0.0); 3],
        position_sigma_mm: Positive(position_sigma_m * 1e3),
        rotation_vector_deg: [0, 1, 2].map(|i| Finite(rotation_vector_rad[i].to_degrees())),
        rotation_sigma_deg: Positive(rotation_sigma_rad.to_degrees()),
        velocity_mm_s: [Finite(0.0); 3],
    }
}
