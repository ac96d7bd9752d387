//! A pose with its covariance, and the standard model of a front end that delivers one.
//!
//! Error `[δp_world (m), δθ_capsule (rad)]` as everywhere. A source that is symmetric about an axis says nothing about
//! the roll around it: such a fix is of kind [`FixKind::Pointing`] and has 5 degrees of freedom.
//!
//! Residual of a fix `(p_z, R_z)` at the state `(p, R)`, with δ = ominus(fix, state) and Jacobians by the inverse right
//! Jacobian of SO(3):
//!
//! ```text
//! position: p_z - p                                      H = [I 0]
//! full:     [p_z - p; Log(Rᵀ R_z)]                        H = [I 0; 0 J_r⁻¹(-θ)]   (θ = Log(Rᵀ R_z))
//! pointing: [p_z - p; E_zᵀ (u_z - R x)],  E_z = tangent basis at u_z = R_z x,   H_θ = E_zᵀ R (-[x]ₓ)
//! ```

use crate::frame::{Frame, Schema};
use crate::measurement::{Instant, Linearization, Measurement, MeasurementModel, Noise, Part, StateView};
use crate::modality::ModalityError;
use crate::pose::{log_so3, right_jacobian_inverse_so3, skew, tangent_basis};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::sync::{Arc, LazyLock};

/// What a fix knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FixKind {
    /// Position only, 3 degrees of freedom.
    Position,
    /// Position and direction of the capsule's x axis, 5 degrees of freedom.
    Pointing,
    /// Position and attitude, 6 degrees of freedom.
    Full,
}

impl FixKind {
    /// Degrees of freedom of the error.
    pub fn degrees_of_freedom(self) -> usize {
        match self {
            Self::Position => 3,
            Self::Pointing => 5,
            Self::Full => 6,
        }
    }
}

/// A pose and the covariance of its error `[δp_world, δθ_capsule]`.
///
/// For [`FixKind::Pointing`] the covariance has a zero row and column at the roll (δθ_x), for [`FixKind::Position`] at all
/// of δθ: what is not known is not given a number.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseEstimate {
    /// The pose.
    pub world_from_capsule: Isometry3<f64>,
    /// Covariance in m², m·rad, rad².
    pub covariance: Matrix6<f64>,
    /// What of it is known.
    pub kind: FixKind,
}

/// Schema of a fix: position, quaternion (scalar last), upper triangle of the covariance row by row, degrees of freedom.
static FIX_SCHEMA: LazyLock<Arc<Schema>> = LazyLock::new(|| {
    let mut labels: Vec<String> =
        ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"].iter().map(ToString::to_string).collect();
    for row in 0..6 {
        for column in row..6 {
            labels.push(format!("cov_{row}{column}"));
        }
    }
    labels.push("degrees_of_freedom".to_owned());
    Schema::channels("pose_fix/1", "value", labels)
});

impl PoseEstimate {
    /// As the columns that cross the seam.
    pub fn to_frame(&self) -> Frame {
        let p = self.world_from_capsule.translation.vector;
        let q = self.world_from_capsule.rotation.coords;
        let mut values = vec![p.x, p.y, p.z, q.x, q.y, q.z, q.w];
        for row in 0..6 {
            for column in row..6 {
                values.push(self.covariance[(row, column)]);
            }
        }
        values.push(self.kind.degrees_of_freedom() as f64);
        // The schema above has exactly these 29 labels.
        Frame::of_values(FIX_SCHEMA.clone(), values).expect("29 labels, 29 values")
    }

    /// Back from the columns.
    ///
    /// # Errors
    /// [`ModalityError::Reading`] where the frame is not a complete fix.
    pub fn from_frame(frame: &Frame) -> Result<Self, ModalityError> {
        let v = frame.f64("value")?;
        if v.len() != 29 || frame.valid().contains(&false) {
            return Err(ModalityError::Reading("an incomplete pose fix".to_owned()));
        }
        let mut covariance = Matrix6::zeros();
        let mut next = 7;
        for row in 0..6 {
            for column in row..6 {
                covariance[(row, column)] = v[next];
                covariance[(column, row)] = v[next];
                next += 1;
            }
        }
        let kind = match v[28] {
            3.0 => FixKind::Position,
            5.0 => FixKind::Pointing,
            6.0 => FixKind::Full,
            other => {
                return Err(ModalityError::Reading(format!("a pose fix with {other} degrees of freedom")));
            }
        };
        Ok(Self {
            world_from_capsule: Isometry3::from_parts(
                Translation3::new(v[0], v[1], v[2]),
                UnitQuaternion::new_normalize(Quaternion::new(v[6], v[3], v[4], v[5])),
            ),
            covariance,
            kind,
        })
    }
}

/// The measurement model of every front end that delivers a pose.
#[derive(Clone, Copy, Debug, Default)]
pub struct FixModel;

/// A fix as residual, Jacobian with respect to `[δp, δθ]`, and covariance.
fn fix_residual(fix: &PoseEstimate, state: &Isometry3<f64>) -> (DVector<f64>, DMatrix<f64>, DMatrix<f64>) {
    let n = fix.kind.degrees_of_freedom();
    let mut residual = DVector::zeros(n);
    let mut jacobian = DMatrix::zeros(n, 6);
    let dp = fix.world_from_capsule.translation.vector - state.translation.vector;
    residual.rows_mut(0, 3).copy_from(&dp);
    jacobian.view_mut((0, 0), (3, 3)).fill_with_identity();
    let covariance = match fix.kind {
        FixKind::Position => fix.covariance.fixed_view::<3, 3>(0, 0).into_owned().as_slice().to_vec(),
        FixKind::Full => {
            let theta = log_so3(&(state.rotation.inverse() * fix.world_from_capsule.rotation));
            residual.rows_mut(3, 3).copy_from(&theta);
            jacobian.view_mut((3, 3), (3, 3)).copy_from(&right_jacobian_inverse_so3(&-theta));
            fix.covariance.as_slice().to_vec()
        }
        FixKind::Pointing => {
            let x = Vector3::x();
            let measured = fix.world_from_capsule.rotation * x;
            let (e1, e2) = tangent_basis(&measured);
            let difference = measured - state.rotation * x;
            // d(R x) = -R [x]ₓ δθ
            let turn = -(state.rotation.to_rotation_matrix().into_inner() * skew(&x));
            let mut to_tangent = DMatrix::zeros(5, 6);
            to_tangent.view_mut((0, 0), (3, 3)).fill_with_identity();
            let measured_turn =
                -(fix.world_from_capsule.rotation.to_rotation_matrix().into_inner() * skew(&x));
            for (row, e) in [(3, e1), (4, e2)] {
                residual[row] = e.dot(&difference);
                jacobian.view_mut((row, 3), (1, 3)).copy_from(&(e.transpose() * turn));
                to_tangent.view_mut((row, 3), (1, 3)).copy_from(&(e.transpose() * measured_turn));
            }
            let tangent = &to_tangent * fix.covariance * to_tangent.transpose();
            tangent.as_slice().to_vec()
        }
    };
    (residual, jacobian, DMatrix::from_vec(n, n, covariance))
}

impl MeasurementModel for FixModel {
    fn linearize(&self, m: &Measurement, at: &dyn StateView) -> Result<Linearization, ModalityError> {
        let fix = PoseEstimate::from_frame(&m.value)?;
        let state = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let (residual, jacobian, covariance) = fix_residual(&fix, &state);
        Ok(Linearization::Residual {
            residual,
            jacobian: vec![(Part::Pose(Instant::Now), jacobian)],
            noise: Noise::Full(covariance),
        })
    }

    fn expected_information(
        &self,
        m: &Measurement,
        at: &dyn StateView,
    ) -> Result<Option<DMatrix<f64>>, ModalityError> {
        let fix = PoseEstimate::from_frame(&m.value)?;
        let state = at.world_from_capsule(Instant::Now).ok_or(ModalityError::MissingState("the pose now"))?;
        let (_, jacobian, covariance) = fix_residual(&fix, &state);
        let weighted = covariance
            .cholesky()
            .ok_or_else(|| {
                ModalityError::Undefined("the covariance of a fix is not positive definite".into())
            })?
            .solve(&jacobian);
        Ok(Some(jacobian.transpose() * weighted))
    }
}
