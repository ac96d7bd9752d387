//! Attitude on SO(3) and the one error convention of the project.
//!
//! Error of a pose: `ξ = [δp_world (m), δθ_capsule (rad)]`, right perturbation on SO(3) x R³:
//!
//! ```text
//! oplus:  p' = p + δp          R' = R · Exp(δθ)
//! ominus: δp = p' - p          δθ = Log(Rᵀ R')
//! ```
//!
//! `Exp`, `Log` and the right Jacobian `J_r` (with `Exp(θ + δ) ≈ Exp(θ)·Exp(J_r(θ) δ)`) follow Solà, Deray and Atchuthan,
//! "A micro Lie theory for state estimation in robotics" (2018), equations 132 to 145; below an angle of 1e-4 rad a
//! series replaces the quotients, whose next term is then below 1e-17.

use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3, Vector6};

/// Angle in radians under which the series branch is used.
const SMALL_ANGLE_RAD: f64 = 1e-4;

/// The cross-product matrix: `skew(a) * b == a x b`.
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Rotation by the rotation vector `theta_rad`.
pub fn exp_so3(theta_rad: &Vector3<f64>) -> UnitQuaternion<f64> {
    let squared = theta_rad.norm_squared();
    let angle = squared.sqrt();
    let (scalar, factor) = if angle < SMALL_ANGLE_RAD {
        (1.0 - squared / 8.0, 0.5 - squared / 48.0)
    } else {
        let (sine, cosine) = (0.5 * angle).sin_cos();
        (cosine, sine / angle)
    };
    let v = theta_rad * factor;
    UnitQuaternion::new_normalize(Quaternion::new(scalar, v.x, v.y, v.z))
}

/// Rotation vector (rad, norm at most π) of a rotation.
pub fn log_so3(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    // The half with a positive scalar part is the short way round.
    let sign = if rotation.w < 0.0 { -1.0 } else { 1.0 };
    let scalar = sign * rotation.w;
    let vector = rotation.imag() * sign;
    let sine = vector.norm();
    if sine < 0.5 * SMALL_ANGLE_RAD {
        // 2·atan(x)/x around zero, with x = sine / scalar.
        let x = sine / scalar;
        return vector * (2.0 / scalar * (1.0 - x * x / 3.0));
    }
    vector * (2.0 * sine.atan2(scalar) / sine)
}

/// Right Jacobian of SO(3) at the rotation vector `theta_rad`.
pub fn right_jacobian_so3(theta_rad: &Vector3<f64>) -> Matrix3<f64> {
    let squared = theta_rad.norm_squared();
    let angle = squared.sqrt();
    let k = skew(theta_rad);
    let (a, b) = if angle < SMALL_ANGLE_RAD {
        (0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0)
    } else {
        ((1.0 - angle.cos()) / squared, (angle - angle.sin()) / (squared * angle))
    };
    Matrix3::identity() - k * a + k * k * b
}

/// Inverse of the right Jacobian of SO(3); valid for angles below 2π.
pub fn right_jacobian_inverse_so3(theta_rad: &Vector3<f64>) -> Matrix3<f64> {
    let squared = theta_rad.norm_squared();
    let angle = squared.sqrt();
    let k = skew(theta_rad);
    let b = if angle < SMALL_ANGLE_RAD {
        1.0 / 12.0 + squared / 720.0
    } else {
        // (1 + cos)/sin written so that it stays finite at π.
        1.0 / squared - 0.5 * (0.5 * angle).cos() / (angle * (0.5 * angle).sin())
    };
    Matrix3::identity() + k * 0.5 + k * k * b
}

/// A pose moved by the error `[δp_world (m), δθ_capsule (rad)]`.
pub fn oplus(pose: &Isometry3<f64>, error: &Vector6<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + error.fixed_rows::<3>(0)),
        renormalize(pose.rotation * exp_so3(&error.fixed_rows::<3>(3).into_owned())),
    )
}

/// The error `[δp_world (m), δθ_capsule (rad)]` that moves `from` onto `to`.
pub fn ominus(to: &Isometry3<f64>, from: &Isometry3<f64>) -> Vector6<f64> {
    let position = to.translation.vector - from.translation.vector;
    let rotation = log_so3(&(from.rotation.inverse() * to.rotation));
    Vector6::new(position.x, position.y, position.z, rotation.x, rotation.y, rotation.z)
}

/// Constant-velocity interpolation between two poses, `fraction` 0 at `a` and 1 at `b`.
pub fn interpolate(a: &Isometry3<f64>, b: &Isometry3<f64>, fraction: f64) -> Isometry3<f64> {
    oplus(a, &(ominus(b, a) * fraction))
}

/// Removes the drift that long products of quaternions collect.
pub fn renormalize(rotation: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(rotation.into_inner())
}

/// Two unit vectors that complete `axis` (unit) to a right-handed frame `(axis, e1, e2)`: a tangent basis of the sphere
/// that exists at every pose (Duff et al. 2017, "Building an orthonormal basis, revisited").
pub fn tangent_basis(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let sign = if axis.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    (
        Vector3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        Vector3::new(b, sign + axis.y * axis.y * a, -axis.y),
    )
}

/// The rotation with the least turn that takes the capsule's x axis onto `axis_world` (unit). Roll is left as it falls:
/// a source that is symmetric about its axis says nothing of it.
pub fn attitude_from_axis(axis_world: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::x(), axis_world)
        // Only an axis of exactly -x has no unique shortest turn: any half turn about a normal serves.
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn samples() -> Vec<Vector3<f64>> {
        let mut all = Vec::new();
        for angle in [0.0, 1e-12, 1e-6, 0.99e-4, 1.01e-4, 0.3, 1.0, 2.0, 3.0, PI - 1e-6] {
            for axis in [Vector3::x(), Vector3::new(1.0, -2.0, 0.5).normalize(), -Vector3::z()] {
                all.push(axis * angle);
            }
        }
        all
    }

    #[test]
    fn closed_form_exp_equals_the_matrix_series() {
        for theta in samples() {
            let k = skew(&theta);
            let mut term = Matrix3::identity();
            let mut sum = term;
            for n in 1..60 {
                term = term * k / f64::from(n);
                sum += term;
            }
            let matrix = exp_so3(&theta).to_rotation_matrix().into_inner();
            assert!((matrix - sum).abs().max() < 1e-12, "theta {theta:?}");
        }
    }

    #[test]
    fn law_log_inverts_exp_to_1e_12() {
        for theta in samples() {
            assert!((log_so3(&exp_so3(&theta)) - theta).norm() < 1e-12, "theta {theta:?}");
        }
    }

    #[test]
    fn closed_form_right_jacobian_equals_its_series_and_inverts() {
        for theta in samples() {
            let k = skew(&theta);
            let mut term = Matrix3::identity();
            let mut sum = term;
            for n in 1..60 {
                term = -term * k / f64::from(n + 1);
                sum += term;
            }
            let jacobian = right_jacobian_so3(&theta);
            assert!((jacobian - sum).abs().max() < 1e-12, "theta {theta:?}");
            let identity = jacobian * right_jacobian_inverse_so3(&theta);
            assert!((identity - Matrix3::identity()).abs().max() < 1e-10, "theta {theta:?}");
        }
    }

    #[test]
    fn law_oplus_inverts_ominus() {
        let a = Isometry3::new(Vector3::new(0.1, 0.2, -0.3), Vector3::new(0.4, -2.0, 1.0));
        for theta in samples() {
            let error = Vector6::new(0.01, -0.02, 0.3, theta.x, theta.y, theta.z);
            assert!((ominus(&oplus(&a, &error), &a) - error).norm() < 1e-12);
        }
    }

    #[test]
    fn law_tangent_basis_is_orthonormal_everywhere() {
        for axis in [Vector3::z(), -Vector3::z(), Vector3::x(), Vector3::new(-0.3, 0.5, -1e-9).normalize()] {
            let (e1, e2) = tangent_basis(&axis);
            let frame = Matrix3::from_columns(&[axis, e1, e2]);
            assert!((frame.transpose() * frame - Matrix3::identity()).abs().max() < 1e-14);
            assert!((frame.determinant() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn law_attitude_from_axis_points_there() {
        for axis in [Vector3::x(), -Vector3::x(), Vector3::y(), Vector3::new(-1.0, 1e-9, 0.0).normalize()] {
            assert!((attitude_from_axis(&axis) * Vector3::x() - axis).norm() < 1e-9);
        }
    }
}
