//! Witness: a gyroscope that drives the prediction (its bias a nuisance block) and an accelerometer that sees gravity,
//! against a filter of the same equations in NumPy.
//!
//! ```text
//! ω = gyro - b            ∂ω/∂b = -I
//! z = -Rᵀ g + noise       ∂z/∂δθ = [-Rᵀ g]ₓ
//! ```
//!
//! Unobservable: the turn about gravity, and with it one direction of the bias until the capsule has turned over.

use super::{Document, instant, measured, options, prior, vector};
use lumenav::core::config::quantity::NonNegative;
use lumenav::core::laws::{check_model, check_sensor_is_deterministic, check_units};
use lumenav::core::pose::skew;
use lumenav::core::{
    BlockSpec, FrontEnd, Instant, Linearization, Measurement, MeasurementModel, ModalityError, MotionInput,
    MotionSample, Name, Noise, NominalState, Outcome, Part, PosePrior, Reading, Schema, SimTime, StateView,
};
use lumenav::fusion::{Eskf, EskfOptions, Filter as _, Verdict};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};
use std::sync::Arc;

/// Gravity in the world of a patient lying supine.
pub(super) const GRAVITY_WORLD_M_S2: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

const BLOCK: &str = "gyro.bias_rad_s";

pub(super) fn gyro_schema() -> Arc<Schema> {
    Schema::channels("gyro/1", "rate_rad_s", ["x_rad_s", "y_rad_s", "z_rad_s"].map(str::to_owned).to_vec())
}

pub(super) fn accelerometer_schema() -> Arc<Schema> {
    Schema::channels(
        "accelerometer/1",
        "force_m_s2",
        ["x_m_s2", "y_m_s2", "z_m_s2"].map(str::to_owned).to_vec(),
    )
}

struct Gyro {
    sigma_rad_s: f64,
    block: BlockSpec,
}

impl MotionInput for Gyro {
    fn blocks(&self) -> Vec<BlockSpec> {
        vec![self.block.clone()]
    }

    fn sample(&self, reading: &Reading, state: &dyn StateView) -> Result<MotionSample, ModalityError> {
        let bias = state.block(BLOCK).ok_or_else(|| ModalityError::MissingBlock(BLOCK.to_owned()))?;
        if reading.payload.valid().contains(&false) {
            return Err(ModalityError::Reading("an incomplete angular rate".to_owned()));
        }
        Ok(MotionSample {
            angular_rate_capsule_rad_s: vector(reading.payload.f64("rate_rad_s")?) - bias,
            covariance: Matrix3::from_diagonal_element(self.sigma_rad_s.powi(2)),
            bias: Some((BLOCK.into(), -DMatrix::identity(3, 3))),
        })
    }
}

struct GravityModel {
    sigma_m_s2: f64,
}

impl MeasurementModel for GravityModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let expected = pose.rotation.inverse() * -GRAVITY_WORLD_M_S2;
        let residual = vector(m.value.f64("force_m_s2")?) - expected;
        let mut jacobian = DMatrix::zeros(3, 6);
        jacobian.view_mut((0, 3), (3, 3)).copy_from(&skew(&expected));
        Ok(Linearization::Residual {
            residual: DVector::from_column_slice(residual.as_slice()),
            jacobian: vec![(Part::Pose(Instant::Now), jacobian)],
            noise: Noise::Diagonal(DVector::from_element(3, self.sigma_m_s2.powi(2))),
        })
    }
}

struct GravityFrontEnd(Arc<GravityModel>);

impl FrontEnd for GravityFrontEnd {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        if reading.payload.valid().contains(&false) {
            return Ok(Outcome::Refused { why: "an axis of the accelerometer is lost".into() });
        }
        Ok(Outcome::Measured(vec![Measurement::of_reading(reading, self.0.clone())]))
    }
}

fn document() -> Document {
    Document::parse(include_str!("../cross/gyro_gravity.json"))
}

#[test]
fn cross_gyroscope_and_gravity_equal_the_numpy_filter() {
    let document = document();
    let block = BlockSpec {
        name: Name::from(BLOCK),
        initial: DVector::zeros(3),
        initial_sigma: DVector::from_element(3, document.number("prior_bias_sigma_rad_s")),
        random_walk: DVector::from_element(3, document.number("bias_random_walk_rad_s_per_sqrt_s")),
    };
    let gyro = Arc::new(Gyro { sigma_rad_s: document.number("gyro_sigma_rad_s"), block });
    let model = GravityModel { sigma_m_s2: document.number("accelerometer_sigma_m_s2") };
    let mut front_end = GravityFrontEnd(Arc::new(model));
    let start = vector(&document.numbers("prior_rotation_vector_rad"));
    let options = EskfOptions { lag_s: NonNegative(0.2), ..options(1e-3, 1.0) };
    let mut filter = Eskf::new(options, gyro.blocks())
        .with_prior(&prior(0.01, &start, document.number("prior_sigma_rad")), SimTime::ZERO);
    let every = document.number("every") as usize;
    let (history, tilt) = (document.rows("history"), document.numbers("tilt_error_rad"));
    let forces = document.rows("accelerometer_m_s2");
    let time = |k: usize| SimTime::from_seconds(document.number("step_s") * k as f64);
    let (mut worst, mut worst_variance, mut worst_nis) = (0.0_f64, 0.0_f64, 0.0_f64);
    for (k, rate) in document.rows("gyro_rad_s").iter().enumerate() {
        let mut reading = instant("gyro", k as u64, time(k + 1), &gyro_schema(), rate);
        reading.interval.0 = time(k);
        filter.offer_motion(reading, gyro.clone());
        if (k + 1) % every != 0 {
            continue;
        }
        let index = k / every;
        let reading =
            instant("accelerometer", index as u64, time(k + 1), &accelerometer_schema(), &forces[index]);
        let offered = filter.offer(measured(&mut front_end, &reading));
        let Verdict::Accepted(innovation) = offered.verdict else { panic!("{index}: {:?}", offered.verdict) };
        let belief = filter.belief().unwrap();
        let expected = &history[index];
        let rotation = belief.state.world_from_capsule.rotation.to_rotation_matrix().into_inner().transpose();
        let ours = rotation.iter().chain(belief.state.blocks[BLOCK].iter());
        ours.zip(expected).for_each(|(a, b)| worst = worst.max((a - b).abs()));
        for (i, column) in (3..6).chain(12..15).enumerate() {
            let relative = (belief.covariance[(column, column)] / expected[12 + i] - 1.0).abs();
            worst_variance = worst_variance.max(relative);
        }
        worst_nis = worst_nis.max((innovation.chi_square / expected[18] - 1.0).abs());
    }
    println!("state {worst:.1e}, variance {worst_variance:.1e}, NIS {worst_nis:.1e}");
    assert!(worst < 1e-9, "state {worst:e}");
    assert!(worst_variance < 1e-8, "variance {worst_variance:e}");
    assert!(worst_nis < 1e-7, "NIS {worst_nis:e}");
    // Bounded and converged: after 15 s no tilt above 1.5 degrees; each bias within four of its standard deviations, which
    // have shrunk from 50 to below 3 mrad/s.
    assert!(tilt[60..].iter().all(|angle| *angle < 1.5_f64.to_radians()));
    let belief = filter.belief().unwrap();
    for (i, bias) in document.numbers("last_true_bias_rad_s").iter().enumerate() {
        let sigma = belief.covariance[(12 + i, 12 + i)].sqrt();
        assert!(sigma < 3e-3, "bias {i} is known to {sigma} only");
        assert!((belief.state.blocks[BLOCK][i] - bias).abs() < 4.0 * sigma, "bias {i}");
    }
}

#[test]
fn law_gravity_model_derivatives_and_units() {
    check_units(&gyro_schema()).unwrap();
    check_units(&accelerometer_schema()).unwrap();
    let model = Arc::new(GravityModel { sigma_m_s2: 0.05 });
    let mut front_end = GravityFrontEnd(model.clone());
    let reading = instant("accelerometer", 0, SimTime::ZERO, &accelerometer_schema(), &[1.0, 9.0, -3.0]);
    let measurement = measured(&mut front_end, &reading);
    for turn in [0.0, 1e-9, 1.0, std::f64::consts::PI - 1e-7] {
        let state = NominalState::at_rest(Isometry3::new(Vector3::zeros(), Vector3::new(turn, 0.0, 0.2)));
        check_model(model.as_ref(), &measurement, &state, 1e-6).unwrap();
    }
    let lost = instant("accelerometer", 0, SimTime::ZERO, &accelerometer_schema(), &[1.0, f64::NAN, -3.0]);
    assert!(matches!(front_end.process(&lost, None), Ok(Outcome::Refused { .. })));
}

#[test]
fn law_gyroscope_and_accelerometer_are_deterministic() {
    super::world::with_truth(|truth| {
        check_sensor_is_deterministic(&|| super::world::sensor(super::world::Gyro), truth, "gyro", 20)?;
        check_sensor_is_deterministic(
            &|| super::world::sensor(super::world::Accelerometer),
            truth,
            "force",
            20,
        )
    })
    .unwrap();
}
