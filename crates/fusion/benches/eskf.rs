//! Time of one predict and update, 12 states: six ranges, and 48 readings of a flux-like field with diagonal noise; beside
//! them a naive filter on nalgebra's own products (static 12 x 12, dense H, inverse-free but nothing exploited).
//!
//! `tests/cross/filter_bench.py` times FilterPy on the six ranges.

use divan::Bencher;
use lumenav_core::config::quantity::{NonNegative, Positive};
use lumenav_core::{
    FixKind, Frame, Instant, Linearization, Measurement, MeasurementModel, ModalityError, MotionModel, Name,
    Noise, Part, PoseEstimate, PriorUse, Schema, SimTime, StateView,
};
use lumenav_fusion::options::Probability;
use lumenav_fusion::update::propose;
use lumenav_fusion::{Belief, Eskf, EskfOptions, Filter as _};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, SMatrix, SVector, Vector3};
use std::sync::Arc;

fn main() {
    divan::main();
}

const STEP_NS: i64 = 10_000_000;

/// Readings that depend on position (ranges) or on position and attitude (a direction-weighted inverse cube).
struct Model {
    sensors_world_m: Vec<Vector3<f64>>,
    flux: bool,
    variance: f64,
}

impl Model {
    fn new(count: usize, flux: bool) -> Self {
        let place = |i: usize| {
            let t = i as f64;
            Vector3::new((2.4 * t).cos(), (2.4 * t).sin(), 0.3 * (t - 0.5 * count as f64) / count as f64)
                * 0.4
        };
        Self { sensors_world_m: (0..count).map(place).collect(), flux, variance: 1e-6 }
    }

    fn predicted(&self, pose: &Isometry3<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let n = self.sensors_world_m.len();
        let (mut values, mut jacobian) = (DVector::zeros(n), DMatrix::zeros(n, 6));
        let axis = pose.rotation * Vector3::x();
        let turn = pose.rotation.to_rotation_matrix().into_inner();
        for (i, sensor) in self.sensors_world_m.iter().enumerate() {
            let d = pose.translation.vector - sensor;
            let r2 = d.norm_squared();
            if self.flux {
                // m . d / r^3 in units of 1/m^2, with its derivatives.
                let r3 = r2 * r2.sqrt();
                let along = axis.dot(&d);
                values[i] = along / r3;
                let by_position = axis / r3 - d * (3.0 * along / (r3 * r2));
                let by_axis = turn.transpose() * d / r3;
                for k in 0..3 {
                    jacobian[(i, k)] = by_position[k];
                }
                jacobian[(i, 4)] = -by_axis.z;
                jacobian[(i, 5)] = by_axis.y;
            } else {
                values[i] = r2.sqrt();
                for k in 0..3 {
                    jacobian[(i, k)] = d[k] / values[i];
                }
            }
        }
        (values, jacobian)
    }
}

impl MeasurementModel for Model {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let (values, jacobian) = self.predicted(&pose);
        Ok(Linearization::Residual {
            residual: DVector::from_column_slice(m.value.f64("value")?) - values,
            jacobian: vec![(Part::Pose(Instant::Now), jacobian)],
            noise: Noise::Diagonal(DVector::from_element(self.sensors_world_m.len(), self.variance)),
        })
    }
}

fn motion() -> MotionModel {
    MotionModel {
        velocity_random_walk_m_s_per_sqrt_s: NonNegative(4e-3),
        velocity_time_constant_s: Some(Positive(2.0)),
        rate_random_walk_rad_s_per_sqrt_s: NonNegative(0.1),
        rate_time_constant_s: Some(Positive(2.0)),
    }
}

fn start() -> Belief {
    let fix = PoseEstimate {
        world_from_capsule: Isometry3::new(Vector3::new(0.01, 0.02, -0.01), Vector3::new(0.1, 0.2, -0.3)),
        covariance: Matrix6::identity() * 1e-4,
        kind: FixKind::Full,
    };
    Belief::start(SimTime::ZERO, &fix, 0.02, 0.5)
}

fn measurement(model: &Arc<Model>, at: SimTime, sequence: u64) -> Measurement {
    let truth = Isometry3::new(Vector3::new(0.011, 0.02, -0.01), Vector3::new(0.1, 0.2, -0.3));
    let values = model.predicted(&truth).0;
    let labels = (0..values.len()).map(|i| format!("{i}_unit")).collect();
    let frame = Frame::of_values(Schema::channels("bench/1", "value", labels), values.as_slice().to_vec());
    Measurement {
        sensor: Name::from("bench"),
        sequence,
        at,
        arrival: at,
        since: None,
        // As many values as labels, by the lines above.
        value: Arc::new(frame.expect("channels and labels agree")),
        model: model.clone(),
        prior_use: PriorUse::None,
        fix: None,
        motion: None,
    }
}

fn core(bencher: Bencher, count: usize, flux: bool) {
    let model = Arc::new(Model::new(count, flux));
    let (mut belief, motion) = (start(), motion());
    let mut m = measurement(&model, SimTime::ZERO, 0);
    bencher.bench_local(|| {
        m.at = m.at + STEP_NS;
        belief.predict(m.at, &motion);
        // A bench of a failing update would measure nothing.
        propose(&belief, &m, 1).expect("a sound update").apply(&mut belief);
    });
}

fn event_log(bencher: Bencher, count: usize, flux: bool) {
    let model = Arc::new(Model::new(count, flux));
    let options =
        EskfOptions { motion: motion(), gate_probability: Probability(0.999_999), ..EskfOptions::default() };
    let mut filter = Eskf::new(options, Vec::new());
    let mut m = measurement(&model, SimTime::ZERO, 0);
    m.fix = start().pose().into();
    filter.offer(m.clone());
    m.fix = None;
    bencher.bench_local(|| {
        m.at = m.at + STEP_NS;
        m.arrival = m.at;
        m.sequence += 1;
        filter.offer(m.clone())
    });
    assert_eq!(filter.counters().accepted, m.sequence);
}

/// Static 12 x 12 with a dense H of N readings, Cholesky of S, Joseph form, NIS; attitude by the same pose model.
struct Naive<const N: usize> {
    pose: Isometry3<f64>,
    velocity: Vector3<f64>,
    covariance: SMatrix<f64, 12, 12>,
}

impl<const N: usize> Naive<N> {
    fn step(&mut self, model: &Model, z: &DVector<f64>) -> f64 {
        let dt = STEP_NS as f64 * 1e-9;
        let mut f = SMatrix::<f64, 12, 12>::identity();
        let mut q = SMatrix::<f64, 12, 12>::zeros();
        for i in 0..3 {
            f[(i, 6 + i)] = dt;
            f[(3 + i, 9 + i)] = dt;
            for (value, rate, walk) in [(i, 6 + i, 4e-3_f64), (3 + i, 9 + i, 0.1)] {
                q[(value, value)] = walk.powi(2) * dt.powi(3) / 3.0;
                q[(value, rate)] = walk.powi(2) * dt * dt / 2.0;
                q[(rate, value)] = q[(value, rate)];
                q[(rate, rate)] = walk.powi(2) * dt;
            }
        }
        self.pose.translation.vector += self.velocity * dt;
        self.covariance = f * self.covariance * f.transpose() + q;
        let (values, jacobian) = model.predicted(&self.pose);
        let residual = SVector::<f64, N>::from_iterator((z - values).iter().copied());
        let mut h = SMatrix::<f64, N, 12>::zeros();
        for j in 0..6 {
            for i in 0..N {
                h[(i, j)] = jacobian[(i, j)];
            }
        }
        let r = SMatrix::<f64, N, N>::identity() * model.variance;
        let s = h * self.covariance * h.transpose() + r;
        // S is a covariance plus a positive diagonal.
        let factor = s.cholesky().expect("S is positive definite");
        let gain = factor.solve(&(h * self.covariance)).transpose();
        let error = gain * residual;
        let left = SMatrix::<f64, 12, 12>::identity() - gain * h;
        self.covariance = left * self.covariance * left.transpose() + gain * r * gain.transpose();
        let pose: nalgebra::Vector6<f64> = error.fixed_rows::<6>(0).into_owned();
        self.pose = lumenav_core::pose::oplus(&self.pose, &pose);
        self.velocity += error.fixed_rows::<3>(6);
        residual.dot(&factor.solve(&residual))
    }
}

fn naive<const N: usize>(bencher: Bencher, flux: bool) {
    let model = Arc::new(Model::new(N, flux));
    let belief = start();
    let z = DVector::from_column_slice(
        measurement(&model, SimTime::ZERO, 0).value.f64("value").expect("that column"),
    );
    let mut filter = Naive::<N> {
        pose: belief.state.world_from_capsule,
        velocity: Vector3::zeros(),
        covariance: SMatrix::from_iterator(belief.covariance.iter().copied()),
    };
    bencher.bench_local(|| filter.step(&model, &z));
}

#[divan::bench]
fn predict_update_6_ranges(bencher: Bencher) {
    core(bencher, 6, false);
}

#[divan::bench]
fn predict_update_48_flux(bencher: Bencher) {
    core(bencher, 48, true);
}

#[divan::bench]
fn event_log_6_ranges(bencher: Bencher) {
    event_log(bencher, 6, false);
}

#[divan::bench]
fn event_log_48_flux(bencher: Bencher) {
    event_log(bencher, 48, true);
}

#[divan::bench]
fn naive_nalgebra_6_ranges(bencher: Bencher) {
    naive::<6>(bencher, false);
}

#[divan::bench]
fn naive_nalgebra_48_flux(bencher: Bencher) {
    naive::<48>(bencher, true);
}
