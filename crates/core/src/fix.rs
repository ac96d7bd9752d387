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
//! pointing: [p_z - p; -h(R x)]                           H = [I 0; 0 ∂h/∂u (-R [x]ₓ)]
//! ```
//!
//! with h the logarithm on the sphere at `u_z = R_z x`, in a tangent basis E_z there: its length is the angle θ between
//! both directions, however large, so a heading that is reversed lies farther away than any other:
//!
//! ```text
//! h(u) = f(c) E_zᵀ u      c = u · u_z = cos θ      f = θ / sin θ       f' = df/dc = (θ cos θ - sin θ) / sin³ θ
//! ∂h/∂u = f E_zᵀ + f' E_zᵀ u u_zᵀ  =  f (I - e eᵀ) E_zᵀ - e u_zᵀ / sin θ        with E_zᵀ u = sin θ e
//! ```
//!
//! (the first form near 0, the second elsewhere: near 180° the first one's terms grow and cancel).
//!
//! At 180° every way round is as short and the logarithm has no value. Within `ANTIPODE_SINE` of it the residual goes round
//! by the direction in which u lies, or by the first tangent where it lies nowhere, and the Jacobian keeps the way round
//! alone (`∂h/∂u = -e eᵀ`): how the way round itself would turn is left out, as its derivative has no bound.
//!
//! A fix that knows attitude is strongly nonlinear: at large angles the weight of its first linearization belongs to the
//! predicted attitude, not to the one that the update arrives at, so updates are iterated.

use crate::frame::{Frame, Schema};
use crate::measurement::{Instant, Linearization, Measurement, MeasurementModel, Noise, Part, StateView};
use crate::modality::ModalityError;
use crate::pose::{log_so3, right_jacobian_inverse_so3, skew, tangent_basis};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix2, Matrix2x3, Matrix6, Quaternion, SMatrix, Translation3,
    UnitQuaternion, Vector2, Vector3,
};
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

/// How the capsule moves, beside a fix, from a front end that saw it over some time: what a filter starts from.
///
/// The velocity is measured alone: a filter that starts from it joins it with what it believes of a velocity at the start. Of the rate a
/// few windows say little: it holds what the front end believed beforehand, and is taken as it is.
///
/// The roll is known here even where the fix does not claim it: a source whose markers look alike after a turn cannot tell one pose from
/// its twin, but it knows how it goes on from the one that it chose.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionEstimate {
    /// Velocity of the capsule's origin, world, m/s.
    pub velocity_world_m_s: Vector3<f64>,
    /// Angular rate, rad/s.
    pub angular_rate_capsule_rad_s: Vector3<f64>,
    /// Covariance of the error `[δp_world, δθ_capsule, δv_world, δω_capsule]` of the fix's pose and the motion together, SI.
    pub covariance: SMatrix<f64, 12, 12>,
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
    /// The same pose claiming no more than `kind`: rows and columns of what is left out are zero.
    pub fn limited_to(mut self, kind: FixKind) -> Self {
        if kind < self.kind {
            let unknown = match kind {
                FixKind::Position => 3..6,
                FixKind::Pointing => 3..4,
                FixKind::Full => 0..0,
            };
            for i in unknown {
                self.covariance.row_mut(i).fill(0.0);
                self.covariance.column_mut(i).fill(0.0);
            }
            self.kind = kind;
        }
        self
    }

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

/// Sine of the angle to the antipode, rad, under which the logarithm on the sphere takes the documented way round. Above it
/// the quotient f still has ten digits.
const ANTIPODE_SINE: f64 = 1e-6;

/// Angle in radians under which series replace the quotients of the logarithm on the sphere; their next terms are of order
/// θ⁴: below 1e-13.
const SMALL_ANGLE_RAD: f64 = 5e-4;

/// The logarithm on the sphere at `measured` of `u` (both unit), in the tangent basis there, and its derivative by u.
fn sphere_log(measured: &Vector3<f64>, u: &Vector3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
    let (e1, e2) = tangent_basis(measured);
    let to_tangent = Matrix2x3::from_rows(&[e1.transpose(), e2.transpose()]);
    let flat = to_tangent * u;
    let (sine, cosine) = (flat.norm(), u.dot(measured));
    let angle = sine.atan2(cosine);
    if cosine < 0.0 && sine < ANTIPODE_SINE {
        let way = if sine > 0.0 { flat / sine } else { Vector2::x() };
        return (way * angle, -(way * way.transpose()) * to_tangent);
    }
    if cosine > 0.0 && sine < SMALL_ANGLE_RAD {
        let square = angle * angle;
        let (factor, slope) = (1.0 + square / 6.0, -1.0 / 3.0 - 2.0 / 15.0 * square);
        return (flat * factor, to_tangent * factor + flat * measured.transpose() * slope);
    }
    let way = flat / sine;
    let across = Matrix2::identity() - way * way.transpose();
    (way * angle, across * to_tangent * (angle / sine) - way * measured.transpose() / sine)
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
            let (log, by_direction) = sphere_log(&measured, &(state.rotation * x));
            // d(R x) = -R [x]ₓ δθ
            let turn = -(state.rotation.to_rotation_matrix().into_inner() * skew(&x));
            residual.rows_mut(3, 2).copy_from(&-log);
            jacobian.view_mut((3, 3), (2, 3)).copy_from(&(by_direction * turn));
            let mut to_tangent = DMatrix::zeros(5, 6);
            to_tangent.view_mut((0, 0), (3, 3)).fill_with_identity();
            let measured_turn =
                -(fix.world_from_capsule.rotation.to_rotation_matrix().into_inner() * skew(&x));
            for (row, e) in [(3, e1), (4, e2)] {
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

    fn strongly_nonlinear(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws::check_model;
    use crate::pose::exp_so3;
    use crate::state::NominalState;
    use crate::time::SimTime;
    use crate::{Name, PriorUse};
    use std::f64::consts::PI;

    fn pointing(measured: &UnitQuaternion<f64>) -> Measurement {
        let mut covariance = Matrix6::identity() * 1e-4;
        covariance[(3, 3)] = 0.0;
        let fix = PoseEstimate {
            world_from_capsule: Isometry3::from_parts(Translation3::identity(), *measured),
            covariance,
            kind: FixKind::Pointing,
        };
        Measurement {
            sensor: Name::from("s"),
            sequence: 0,
            at: SimTime::ZERO,
            arrival: SimTime::ZERO,
            since: None,
            value: Arc::new(fix.to_frame()),
            model: Arc::new(FixModel),
            prior_use: PriorUse::None,
            fix: None,
            motion: None,
        }
    }

    /// A state whose heading is `angle_rad` from the measured one, turned about a direction across it and rolled.
    fn turned(measured: &UnitQuaternion<f64>, angle_rad: f64, way_rad: f64) -> NominalState {
        let across = Vector3::new(0.0, way_rad.cos(), way_rad.sin());
        let rotation = measured * exp_so3(&(across * angle_rad)) * exp_so3(&Vector3::new(0.7, 0.0, 0.0));
        NominalState::at_rest(Isometry3::from_parts(Translation3::new(0.01, 0.0, -0.02), rotation))
    }

    fn residual_of(m: &Measurement, state: &NominalState) -> (DVector<f64>, DMatrix<f64>) {
        let Linearization::Residual { residual, jacobian, .. } = FixModel.linearize(m, state).unwrap() else {
            panic!("a fix has a residual")
        };
        (residual, jacobian[0].1.clone())
    }

    const ATTITUDES: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [0.3, -1.2, 2.0], [0.0, PI, 0.0]];

    #[test]
    fn closed_form_pointing_residual_is_as_long_as_the_angle() {
        for attitude in ATTITUDES {
            let measured = exp_so3(&Vector3::from(attitude));
            for angle in [0.0, 1e-9, 1e-5, 4.9e-4, 5.1e-4, 0.1, 0.5 * PI, 2.6, 3.1, PI - 2e-6, PI - 1e-7] {
                for way in [0.0, 1.0, 4.0] {
                    let (residual, _) = residual_of(&pointing(&measured), &turned(&measured, angle, way));
                    let length = residual.rows(3, 2).norm();
                    assert!((length - angle).abs() < 1e-12, "{angle}: {length}");
                }
            }
        }
    }

    #[test]
    fn law_pointing_jacobian_is_the_derivative_at_any_angle() {
        for attitude in ATTITUDES {
            let measured = exp_so3(&Vector3::from(attitude));
            for degrees in [0.0_f64, 1e-7, 0.028, 0.029, 1.0, 45.0, 89.0, 91.0, 135.0, 170.0, 179.0] {
                for way in [0.0, 1.0, 4.0] {
                    let state = turned(&measured, degrees.to_radians(), way);
                    check_model(&FixModel, &pointing(&measured), &state, 1e-6)
                        .unwrap_or_else(|error| panic!("{degrees} degrees, way {way}: {error}"));
                }
            }
        }
    }

    /// A step along the residual always brings the heading nearer, up to the antipode itself.
    #[test]
    fn law_pointing_residual_leads_home() {
        let measured = exp_so3(&Vector3::new(0.3, -1.2, 2.0));
        for angle in [0.3, 1.5, 1.7, 2.6, 3.1, PI - 1e-5, PI - 1e-8, PI] {
            let state = turned(&measured, angle, 1.0);
            let m = pointing(&measured);
            let (residual, jacobian) = residual_of(&m, &state);
            assert!(residual.iter().chain(jacobian.iter()).all(|v| v.is_finite()), "{angle}");
            assert!((residual.rows(3, 2).norm() - angle).abs() < 1e-12, "{angle}");
            let step = jacobian.svd(true, true).solve(&residual, 1e-9).unwrap();
            let mut moved = state.clone();
            moved.perturb(&Part::Pose(Instant::Now), (&step * 0.5).as_view());
            let nearer = residual_of(&m, &moved).0.rows(3, 2).norm();
            assert!((nearer - 0.5 * angle).abs() < 1e-6, "{angle}: half a step leaves {nearer}");
        }
    }
}
