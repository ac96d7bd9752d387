//! Witness: relative poses between key frames (a stochastic clone) and position fixes, against GTSAM's iSAM2.
//!
//! With `R_ij = R_iᵀ R_j`, `t_ij = R_iᵀ (p_j - p_i)` and the measured `(R_z, t_z) = (R_ij Exp(n), t_ij + m)`:
//!
//! ```text
//! r = [Log(R_ijᵀ R_z); t_z - t_ij]
//! ∂r_θ: J_r⁻¹(-r_θ) [δθ_j - R_ijᵀ δθ_i]        ∂r_t: R_iᵀ (δp_j - δp_i) + [t_ij]ₓ δθ_i
//! ```
//!
//! iSAM2 has no motion model; ours is made so weak (29 mm and 0.3 rad in a step, against 0.5 mm and 0.01 rad) that it adds
//! 0.1 % to the information.

use super::{Document, instant, matrix, measured, options, vector};
use lumenav::core::config::quantity::NonNegative;
use lumenav::core::fix::FixModel;
use lumenav::core::laws::{check_model, check_sensor_is_deterministic, check_units};
use lumenav::core::pose::{exp_so3, log_so3, right_jacobian_inverse_so3, skew};
use lumenav::core::{
    FixKind, FrontEnd, Instant, Linearization, Measurement, MeasurementModel, ModalityError, Name, Noise,
    NominalState, Outcome, Part, PoseEstimate, PosePrior, PriorUse, Reading, Schema, SimTime, StateView,
};
use lumenav::fusion::{Eskf, EskfOptions, Filter as _, Verdict};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

pub(super) fn schema() -> Arc<Schema> {
    let labels = ["turn_x_rad", "turn_y_rad", "turn_z_rad", "move_x_m", "move_y_m", "move_z_m"];
    Schema::channels("relative_pose/1", "value", labels.map(str::to_owned).to_vec())
}

struct RelativePoseModel {
    sigma_rad: f64,
    sigma_m: f64,
}

impl MeasurementModel for RelativePoseModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let since = m.since.ok_or(ModalityError::MissingState("the start of a relative motion"))?;
        let clone = Instant::Clone(since);
        let first =
            at.world_from_capsule(clone).ok_or(ModalityError::MissingState("the clone of a key frame"))?;
        let now = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let z = m.value.f64("value")?;
        let relative = first.inverse() * now;
        let angle = log_so3(&(relative.rotation.inverse() * exp_so3(&vector(&z[..3]))));
        let mut residual = DVector::zeros(6);
        residual.rows_mut(0, 3).copy_from(&angle);
        residual.rows_mut(3, 3).copy_from(&(vector(&z[3..]) - relative.translation.vector));
        let first_from_world = first.rotation.inverse().to_rotation_matrix().into_inner();
        let inverse = right_jacobian_inverse_so3(&-angle);
        let (mut by_now, mut by_first) = (DMatrix::zeros(6, 6), DMatrix::zeros(6, 6));
        by_now.view_mut((0, 3), (3, 3)).copy_from(&inverse);
        let back = relative.rotation.inverse().to_rotation_matrix().into_inner();
        by_first.view_mut((0, 3), (3, 3)).copy_from(&-(inverse * back));
        by_now.view_mut((3, 0), (3, 3)).copy_from(&first_from_world);
        by_first.view_mut((3, 0), (3, 3)).copy_from(&-first_from_world);
        by_first.view_mut((3, 3), (3, 3)).copy_from(&skew(&relative.translation.vector));
        let noise =
            DVector::from_fn(6, |i, _| if i < 3 { self.sigma_rad.powi(2) } else { self.sigma_m.powi(2) });
        let jacobian = vec![(Part::Pose(clone), by_first), (Part::Pose(Instant::Now), by_now)];
        Ok(Linearization::Residual { residual, jacobian, noise: Noise::Diagonal(noise) })
    }

    /// The lever `[t_ij]ₓ` is as wrong as the predicted step, which a weak motion model knows badly; seen once more from the
    /// updated pose it is right (attitude RMSE 2.4 % above iSAM2 without this, 0.5 % with it).
    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

/// Keeps one state: the last key frame, of which it wants a clone.
struct OdometryFrontEnd {
    model: Arc<RelativePoseModel>,
    key_frame: SimTime,
}

impl FrontEnd for OdometryFrontEnd {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        let (since, at) = reading.interval;
        self.key_frame = at;
        Ok(Outcome::Measured(vec![Measurement {
            at,
            since: Some(since),
            ..Measurement::of_reading(reading, self.model.clone())
        }]))
    }

    fn wanted_clones(&self) -> Vec<SimTime> {
        vec![self.key_frame]
    }

    fn snapshot(&self) -> Vec<u8> {
        self.key_frame.0.to_le_bytes().to_vec()
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), ModalityError> {
        let bytes: [u8; 8] = bytes.try_into().map_err(|_| ModalityError::Snapshot)?;
        self.key_frame = SimTime(i64::from_le_bytes(bytes));
        Ok(())
    }
}

fn fix(sequence: u64, at: SimTime, pose: &PoseEstimate) -> Measurement {
    Measurement {
        sensor: Name::from("fix"),
        sequence,
        at,
        arrival: at,
        since: None,
        value: Arc::new(pose.to_frame()),
        model: Arc::new(FixModel),
        prior_use: PriorUse::None,
        fix: Some(pose.clone()),
        motion: None,
    }
}

fn second(k: usize) -> SimTime {
    SimTime::from_seconds(k as f64)
}

fn run(document: &Document) -> (Eskf, f64, f64, f64) {
    let model = RelativePoseModel {
        sigma_rad: document.number("odometry_sigma_rad"),
        sigma_m: document.number("odometry_sigma_m"),
    };
    let mut front_end = OdometryFrontEnd { model: Arc::new(model), key_frame: second(0) };
    // White noises per step of 29 mm and 0.29 rad. A lag of a step and a half: two clones at most.
    let mut filter = Eskf::new(EskfOptions { lag_s: NonNegative(1.5), ..options(0.05, 0.5) }, Vec::new());
    let name = Name::from("odometry");
    let mut covariance = Matrix6::zeros();
    for i in 0..3 {
        covariance[(i, i)] = document.number("prior_sigma_m").powi(2);
        covariance[(3 + i, 3 + i)] = document.number("prior_sigma_rad").powi(2);
    }
    let start = PoseEstimate {
        world_from_capsule: Isometry3::from_parts(
            Translation3::from(vector(&document.numbers("first_position_m"))),
            exp_so3(&vector(&document.numbers("first_rotation_vector_rad"))),
        ),
        covariance,
        kind: FixKind::Full,
    };
    assert!(matches!(filter.offer(fix(0, second(0), &start)).verdict, Verdict::Started));
    filter.want_clones(&name, front_end.wanted_clones());
    let (every, fixes) = (document.number("every") as usize, document.rows("fixes_m"));
    let position_covariance = Matrix6::from_diagonal_element(document.number("fix_sigma_m").powi(2));
    let (truth_m, truth_rad) =
        (document.rows("truth_positions_m"), document.rows("truth_rotation_vectors_rad"));
    let (isam2_m, odometry) = (document.rows("isam2_positions_m"), document.rows("odometry_rad_m"));
    let (mut position, mut attitude, mut from_isam2) = (0.0, 0.0, 0.0);
    for k in 0..truth_m.len() {
        if k > 0 {
            let mut reading = instant("odometry", k as u64, second(k), &schema(), &odometry[k - 1]);
            reading.interval.0 = second(k - 1);
            let offered = filter.offer(measured(&mut front_end, &reading));
            assert!(matches!(offered.verdict, Verdict::Accepted(_)), "pose {k}: {:?}", offered.verdict);
            if k % every == 0 {
                let pose = PoseEstimate {
                    world_from_capsule: Isometry3::from_parts(
                        Translation3::from(vector(&fixes[k / every - 1])),
                        UnitQuaternion::identity(),
                    ),
                    covariance: position_covariance,
                    kind: FixKind::Position,
                };
                let offered = filter.offer(fix(k as u64, second(k), &pose));
                assert!(matches!(offered.verdict, Verdict::Accepted(_)), "fix {k}: {:?}", offered.verdict);
            }
            filter.want_clones(&name, front_end.wanted_clones());
        }
        let pose = filter.belief().unwrap().state.world_from_capsule;
        position += (pose.translation.vector - vector(&truth_m[k])).norm_squared();
        attitude += (pose.rotation.inverse() * exp_so3(&vector(&truth_rad[k]))).angle().powi(2);
        from_isam2 += (pose.translation.vector - vector(&isam2_m[k])).norm_squared();
    }
    let mean = |sum: f64| (sum / truth_m.len() as f64).sqrt();
    (filter, mean(position), mean(attitude), mean(from_isam2))
}

#[test]
fn cross_odometry_over_clones_equals_isam2_within_one_percent() {
    let document = Document::parse(include_str!("../cross/odometry_gtsam.json"));
    let (filter, position_m, attitude_rad, from_isam2_m) = run(&document);
    println!(
        "RMSE {:.3} mm {:.2} deg, iSAM2 {:.3} mm {:.2} deg, {:.3} mm RMS between them",
        position_m * 1e3,
        attitude_rad.to_degrees(),
        document.number("position_rmse_m") * 1e3,
        document.number("attitude_rmse_rad").to_degrees(),
        from_isam2_m * 1e3
    );
    assert!((position_m / document.number("position_rmse_m") - 1.0).abs() < 0.01);
    assert!((attitude_rad / document.number("attitude_rmse_rad") - 1.0).abs() < 0.01);
    let belief = filter.belief().unwrap();
    let ours = belief.covariance.view((0, 0), (3, 3)).into_owned();
    let theirs = matrix(&document.rows("last_position_covariance_world_m2"));
    let relative = (ours - &theirs).norm() / theirs.norm();
    println!("covariance of the last position: {relative:.1e} of its norm away");
    assert!(relative < 0.05, "covariance {relative}");
    assert!(belief.state.clones.len() <= 3, "{} clones are kept", belief.state.clones.len());
}

#[test]
fn law_relative_pose_model_derivatives_and_units() {
    check_units(&schema()).unwrap();
    let model = Arc::new(RelativePoseModel { sigma_rad: 0.01, sigma_m: 5e-4 });
    let mut front_end = OdometryFrontEnd { model: model.clone(), key_frame: second(0) };
    let first = Isometry3::new(Vector3::new(0.1, 0.2, -0.1), Vector3::new(0.4, -1.0, 2.0));
    for turn in [0.0, 1e-6, 0.3, 3.0] {
        let relative = Isometry3::new(Vector3::new(3e-3, 1e-3, -2e-3), Vector3::new(0.1, turn, 0.05));
        let mut state = NominalState::at_rest(first * relative);
        state.clones.insert(second(0), first);
        let mut reading =
            instant("odometry", 1, second(1), &schema(), &[0.12, 0.9 * turn, 0.02, 3.1e-3, 0.8e-3, -2.1e-3]);
        reading.interval.0 = second(0);
        let measurement = measured(&mut front_end, &reading);
        check_model(model.as_ref(), &measurement, &state, 1e-6).unwrap();
        state.clones.clear();
        assert!(matches!(model.linearize(&measurement, &state), Err(ModalityError::MissingState(_))));
    }
    let bytes = front_end.snapshot();
    front_end.key_frame = second(7);
    front_end.restore(&bytes).unwrap();
    assert_eq!(front_end.key_frame, second(1));
    assert!(front_end.restore(&[1, 2]).is_err());
}

#[test]
fn law_odometry_sensor_is_deterministic() {
    super::world::with_truth(|truth| {
        check_sensor_is_deterministic(&|| super::world::sensor(super::world::Odometry), truth, "odometry", 20)
    })
    .unwrap();
}
