//! Tiny models for the tests, and how to draw from them.

use lumenav_core::config::quantity::NonNegative;
use lumenav_core::pose::{exp_so3, log_so3, right_jacobian_inverse_so3, skew};
use lumenav_core::{
    BlockSpec, FixKind, Frame, Instant, Linearization, Measurement, MeasurementModel, ModalityError,
    MotionInput, MotionModel, MotionSample, Name, Noise, Part, PoseEstimate, PriorUse, RandomStream, Reading,
    Schema, SimTime, StateView,
};
use lumenav_fusion::Belief;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3};
use rand_distr::{Distribution as _, StandardNormal};
use std::collections::BTreeMap;
use std::sync::Arc;

pub fn normal(stream: &mut RandomStream) -> f64 {
    StandardNormal.sample(stream)
}

pub fn normal3(stream: &mut RandomStream) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(stream))
}

/// A random symmetric positive definite matrix with eigenvalues of about `n * scale`.
pub fn positive_definite(n: usize, scale: f64, stream: &mut RandomStream) -> DMatrix<f64> {
    let root = DMatrix::from_fn(n, 2 * n, |_, _| normal(stream));
    let product = &root * root.transpose() * (0.5 * scale);
    (&product + product.transpose()) * 0.5
}

/// White-noise acceleration in translation and rotation.
pub fn white_motion(velocity_walk: f64, rate_walk: f64) -> MotionModel {
    MotionModel {
        velocity_random_walk_m_s_per_sqrt_s: NonNegative(velocity_walk),
        velocity_time_constant_s: None,
        rate_random_walk_rad_s_per_sqrt_s: NonNegative(rate_walk),
        rate_time_constant_s: None,
    }
}

pub fn values(name: &str, values: &[f64]) -> Arc<Frame> {
    let labels = (0..values.len()).map(|i| format!("{i}_unit")).collect();
    Arc::new(Frame::of_values(Schema::channels(name, "value", labels), values.to_vec()).unwrap())
}

pub fn measurement(
    sensor: &str,
    sequence: u64,
    at: SimTime,
    value: Arc<Frame>,
    model: Arc<dyn MeasurementModel>,
) -> Measurement {
    Measurement {
        sensor: Name::from(sensor),
        sequence,
        at,
        arrival: at,
        since: None,
        value,
        model,
        prior_use: PriorUse::None,
        fix: None,
        motion: None,
    }
}

/// `z = p + noise`.
pub struct PositionModel {
    pub sigma_m: f64,
}

impl MeasurementModel for PositionModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let residual = DVector::from_column_slice(m.value.f64("value")?) - pose.translation.vector;
        let mut jacobian = DMatrix::zeros(3, 6);
        jacobian.fill_diagonal(1.0);
        Ok(Linearization::Residual {
            residual: DVector::from_column_slice(residual.as_slice()),
            jacobian: vec![(Part::Pose(Instant::Now), jacobian)],
            noise: Noise::Diagonal(DVector::from_element(3, self.sigma_m.powi(2))),
        })
    }
}

/// `z = p + b + noise`, with the block `bias_m`.
pub struct BiasedModel {
    pub sigma_m: f64,
}

impl MeasurementModel for BiasedModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let bias = at.block("bias_m").ok_or_else(|| ModalityError::MissingBlock("bias_m".to_owned()))?;
        let expected = pose.translation.vector + bias;
        let residual = DVector::from_column_slice(m.value.f64("value")?) - expected;
        let mut jacobian = DMatrix::zeros(3, 6);
        jacobian.fill_diagonal(1.0);
        Ok(Linearization::Residual {
            residual: DVector::from_column_slice(residual.as_slice()),
            jacobian: vec![
                (Part::Pose(Instant::Now), jacobian),
                (Part::Block("bias_m".into()), DMatrix::identity(3, 3)),
            ],
            noise: Noise::Diagonal(DVector::from_element(3, self.sigma_m.powi(2))),
        })
    }
}

/// A position reading that can also start a filter.
pub fn position_fix(
    sensor: &str,
    sequence: u64,
    at: SimTime,
    position: &Vector3<f64>,
    sigma_m: f64,
) -> Measurement {
    let model = Arc::new(PositionModel { sigma_m });
    let mut m = measurement(sensor, sequence, at, values("position/1", position.as_slice()), model);
    let mut covariance = Matrix6::zeros();
    (0..3).for_each(|i| covariance[(i, i)] = sigma_m.powi(2));
    m.fix = Some(PoseEstimate {
        world_from_capsule: Isometry3::from_parts(Translation3::from(*position), UnitQuaternion::identity()),
        covariance,
        kind: FixKind::Position,
    });
    m
}

/// Distance from an anchor.
pub struct RangeModel {
    pub anchor_world_m: Vector3<f64>,
    pub sigma_m: f64,
    pub iterated: bool,
}

impl MeasurementModel for RangeModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let difference = pose.translation.vector - self.anchor_world_m;
        let mut jacobian = DMatrix::zeros(1, 6);
        jacobian.view_mut((0, 0), (1, 3)).copy_from(&difference.normalize().transpose());
        Ok(Linearization::Residual {
            residual: DVector::from_element(1, m.value.f64("value")?[0] - difference.norm()),
            jacobian: vec![(Part::Pose(Instant::Now), jacobian)],
            noise: Noise::Diagonal(DVector::from_element(1, self.sigma_m.powi(2))),
        })
    }

    fn strongly_nonlinear(&self) -> bool {
        self.iterated
    }
}

/// Two known world directions seen from the capsule: `z = [Rᵀ a; Rᵀ b] + noise`.
pub struct DirectionsModel {
    pub world: [Vector3<f64>; 2],
    pub sigma: f64,
    pub iterated: bool,
}

impl MeasurementModel for DirectionsModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let pose = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let z = m.value.f64("value")?;
        let (mut residual, mut jacobian) = (DVector::zeros(6), DMatrix::zeros(6, 6));
        for (i, direction) in self.world.iter().enumerate() {
            let seen = pose.rotation.inverse() * direction;
            let difference = Vector3::from_column_slice(&z[3 * i..3 * i + 3]) - seen;
            residual.rows_mut(3 * i, 3).copy_from(&difference);
            jacobian.view_mut((3 * i, 3), (3, 3)).copy_from(&skew(&seen));
        }
        let noise = Noise::Diagonal(DVector::from_element(6, self.sigma.powi(2)));
        Ok(Linearization::Residual { residual, jacobian: vec![(Part::Pose(Instant::Now), jacobian)], noise })
    }

    fn strongly_nonlinear(&self) -> bool {
        self.iterated
    }
}

/// Turn and move since a clone: `[Log(R_iᵀ R_j); R_iᵀ (p_j - p_i)] + noise`.
pub struct RelativeModel {
    pub sigma: f64,
}

impl MeasurementModel for RelativeModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let clone = Instant::Clone(m.since.ok_or(ModalityError::MissingState("a start"))?);
        let first = at.world_from_capsule(clone).ok_or(ModalityError::MissingState("the clone"))?;
        let now = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let z = m.value.f64("value")?;
        let relative = first.inverse() * now;
        let measured = exp_so3(&Vector3::from_column_slice(&z[..3]));
        let angle = log_so3(&(relative.rotation.inverse() * measured));
        let inverse = right_jacobian_inverse_so3(&-angle);
        let back = relative.rotation.inverse().to_rotation_matrix().into_inner();
        let first_from_world = first.rotation.inverse().to_rotation_matrix().into_inner();
        let mut residual = DVector::zeros(6);
        residual.rows_mut(0, 3).copy_from(&angle);
        residual
            .rows_mut(3, 3)
            .copy_from(&(Vector3::from_column_slice(&z[3..]) - relative.translation.vector));
        let (mut by_now, mut by_first) = (DMatrix::zeros(6, 6), DMatrix::zeros(6, 6));
        by_now.view_mut((0, 3), (3, 3)).copy_from(&inverse);
        by_first.view_mut((0, 3), (3, 3)).copy_from(&-(inverse * back));
        by_now.view_mut((3, 0), (3, 3)).copy_from(&first_from_world);
        by_first.view_mut((3, 0), (3, 3)).copy_from(&-first_from_world);
        by_first.view_mut((3, 3), (3, 3)).copy_from(&skew(&relative.translation.vector));
        Ok(Linearization::Residual {
            residual,
            jacobian: vec![(Part::Pose(clone), by_first), (Part::Pose(Instant::Now), by_now)],
            noise: Noise::Diagonal(DVector::from_element(6, self.sigma.powi(2))),
        })
    }
}

/// A residual and a Jacobian given as they are, whatever the state.
pub struct GivenModel(pub Linearization);

impl MeasurementModel for GivenModel {
    fn linearize(&self, _m: &Measurement, _at: &dyn StateView) -> Result<Linearization, ModalityError> {
        Ok(self.0.clone())
    }
}

/// A gyroscope without bias.
pub struct Gyro {
    pub sigma_rad_s: f64,
}

impl MotionInput for Gyro {
    fn sample(&self, reading: &Reading, _state: &dyn StateView) -> Result<MotionSample, ModalityError> {
        Ok(MotionSample {
            angular_rate_capsule_rad_s: Vector3::from_column_slice(reading.payload.f64("value")?),
            covariance: Matrix3::from_diagonal_element(self.sigma_rad_s.powi(2)),
            bias: None,
        })
    }
}

pub fn gyro_reading(sequence: u64, interval: (SimTime, SimTime), rate: &Vector3<f64>) -> Reading {
    Reading {
        sensor: Name::from("gyro"),
        sequence,
        interval,
        arrival: interval.1,
        known_poses: BTreeMap::new(),
        payload: values("gyro/1", rate.as_slice()).as_ref().clone(),
    }
}

pub fn block(name: &str, width: usize, sigma: f64, walk: f64) -> BlockSpec {
    BlockSpec {
        name: Name::from(name),
        initial: DVector::zeros(width),
        initial_sigma: DVector::from_element(width, sigma),
        random_walk: DVector::from_element(width, walk),
    }
}

/// A belief that moves and turns, with a block of 3, a clone of `t = 1 s` and a random covariance, at `t = 1.5 s`.
pub fn rich_belief(stream: &mut RandomStream) -> Belief {
    let fix = PoseEstimate {
        world_from_capsule: Isometry3::from_parts(
            Translation3::from(normal3(stream)),
            exp_so3(&normal3(stream)),
        ),
        covariance: Matrix6::identity(),
        kind: FixKind::Full,
    };
    let mut belief = Belief::start(SimTime::from_seconds(1.0), &fix, 0.1, 0.1);
    belief.add_block(&block("b", 3, 1.0, 0.02));
    belief.clone_pose();
    belief.predict(SimTime::from_seconds(1.5), &white_motion(0.1, 0.1));
    belief.state.velocity_world_m_s = normal3(stream);
    belief.state.angular_rate_capsule_rad_s = normal3(stream);
    belief.covariance = positive_definite(belief.dimension(), 0.01, stream);
    belief
}
