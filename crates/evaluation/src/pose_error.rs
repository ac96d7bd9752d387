//! The error of one estimated pose against the true pose at the estimate's own time.
//!
//! Both poses are `world_from_capsule`. The error is the one that a filter's covariance speaks of, so that
//! the two can be compared (right perturbation on SO(3) x R^3, truth = estimate (+) error):
//!
//! ```text
//! dp_world      = p_true - p_est                      (m)
//! dtheta_capsule = Log(R_est^T R_true)                (rad, in the axes of the estimated capsule)
//! error         = [dp_world (3), dtheta_capsule (3)]
//! ```
//!
//! Beside the full attitude there are two parts of it. *Heading* is the angle between the capsules' x axes
//! (where it points), *roll* what remains: the turn about the x axis after the shortest rotation that brings
//! the one x axis onto the other (swing and twist of `R_est^T R_true`). A single dipole magnet along the
//! capsule's axis says nothing about roll; then the attitude error is meaningless while the heading error is
//! not.
//!
//! The caller interpolates the truth at the estimate's stamp. Taking the nearest true pose instead hides
//! latency: a shift of 3 ms leaves the figures of a 20 Hz truth unchanged to the last bit.
//!
//! Neglected: nothing; the formulas are exact for errors of any size. Roll is undefined where the headings
//! are opposite.

use nalgebra::{Isometry3, UnitQuaternion, Vector3, Vector5, Vector6};

/// Error of one estimated pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// True minus estimated position, world axes, m.
    pub position_world_m: Vector3<f64>,
    /// Rotation vector from the estimated to the true attitude, axes of the estimated capsule, rad.
    pub attitude_capsule_rad: Vector3<f64>,
    /// Shortest rotation from the estimated to the true x axis, y and z components in the axes of the
    /// estimated capsule, rad (the x component is zero).
    pub pointing_capsule_rad: [f64; 2],
    /// Signed turn about the capsule's x axis that is left after pointing, in (-pi, pi]; `None` where the two
    /// headings are exactly opposite.
    pub roll_rad: Option<f64>,
}

impl PoseError {
    /// The error of `estimate` against `truth`, both `world_from_capsule` and of the same time.
    pub fn between(estimate: &Isometry3<f64>, truth: &Isometry3<f64>) -> Self {
        let estimate_from_truth = estimate.rotation.inverse() * truth.rotation;
        Self {
            position_world_m: truth.translation.vector - estimate.translation.vector,
            attitude_capsule_rad: rotation_vector_rad(&estimate_from_truth),
            pointing_capsule_rad: pointing(&estimate_from_truth),
            roll_rad: roll(&estimate_from_truth),
        }
    }

    /// Distance between the two positions, m.
    pub fn position_m(&self) -> f64 {
        self.position_world_m.norm()
    }

    /// Angle of the rotation between the two attitudes, 0 to pi, rad.
    pub fn attitude_rad(&self) -> f64 {
        self.attitude_capsule_rad.norm()
    }

    /// Angle between the two x axes, 0 to pi, rad.
    pub fn heading_rad(&self) -> f64 {
        self.pointing_capsule_rad[0].hypot(self.pointing_capsule_rad[1])
    }

    /// `[dp_world (3, m), dtheta_capsule (3, rad)]`: the error that a pose covariance of 6 x 6 describes.
    pub fn full_pose(&self) -> Vector6<f64> {
        let (p, a) = (&self.position_world_m, &self.attitude_capsule_rad);
        Vector6::new(p.x, p.y, p.z, a.x, a.y, a.z)
    }

    /// `[dp_world (3, m), pointing about capsule y and z (2, rad)]`: what is left where roll is unobservable.
    pub fn position_and_pointing(&self) -> Vector5<f64> {
        let (p, a) = (&self.position_world_m, &self.pointing_capsule_rad);
        Vector5::new(p.x, p.y, p.z, a[0], a[1])
    }
}

/// Angle of a rotation, 0 to pi, exact near 0 as near pi (the arc cosine of the trace is neither).
pub(crate) fn rotation_angle_rad(rotation: &UnitQuaternion<f64>) -> f64 {
    2.0 * rotation.imag().norm().atan2(rotation.w.abs())
}

/// Rotation vector of the shorter of the two turns that a quaternion stands for.
fn rotation_vector_rad(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let imaginary = rotation.imag();
    let sine = imaginary.norm();
    if sine == 0.0 {
        return Vector3::zeros();
    }
    // q and -q are the same rotation; the one with w >= 0 turns by at most pi.
    imaginary * (rotation_angle_rad(rotation).copysign(rotation.w) / sine)
}

/// Components about y and z of the shortest rotation that takes the x axis to its image.
fn pointing(estimate_from_truth: &UnitQuaternion<f64>) -> [f64; 2] {
    let axis = estimate_from_truth * Vector3::x();
    // x cross axis = (0, -axis.z, axis.y); its length is the sine of the heading error.
    let sine = axis.y.hypot(axis.z);
    let angle = sine.atan2(axis.x);
    if sine == 0.0 {
        // Same heading, or the opposite one: then every axis across x is as short, and y is taken.
        return [angle, 0.0];
    }
    [-axis.z * angle / sine, axis.y * angle / sine]
}

/// Twist about the x axis.
fn roll(estimate_from_truth: &UnitQuaternion<f64>) -> Option<f64> {
    let (x, w) = (estimate_from_truth.i, estimate_from_truth.w);
    // Both vanish together when the swing is a half turn; 1e-12 is where rounding of a unit quaternion
    // decides.
    if x.hypot(w) < 1e-12 {
        return None;
    }
    // The sign of the quaternion is free; w >= 0 keeps the result within half a turn.
    let signed_x = if w < 0.0 { -x } else { x };
    Some(2.0 * signed_x.atan2(w.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{Matrix3, Rotation3, Translation3};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn pose(position: [f64; 3], rotation: UnitQuaternion<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::new(position[0], position[1], position[2]), rotation)
    }

    #[test]
    fn closed_form_translation_and_turn_about_z() {
        let estimate = pose([0.01, 0.02, 0.03], UnitQuaternion::identity());
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
        let truth = pose([0.013, 0.016, 0.03], turn);
        let error = PoseError::between(&estimate, &truth);
        assert_relative_eq!(error.position_world_m, Vector3::new(0.003, -0.004, 0.0), epsilon = 1e-15);
        assert_relative_eq!(error.position_m(), 0.005, epsilon = 1e-15);
        assert_relative_eq!(error.attitude_capsule_rad, Vector3::new(0.0, 0.0, 0.3), epsilon = 1e-15);
        assert_relative_eq!(error.heading_rad(), 0.3, epsilon = 1e-15);
        assert_relative_eq!(error.roll_rad.unwrap(), 0.0, epsilon = 1e-15);
        assert_relative_eq!(error.full_pose()[5], 0.3, epsilon = 1e-15);
        assert_relative_eq!(error.position_and_pointing()[4], 0.3, epsilon = 1e-15);
    }

    #[test]
    fn closed_form_pure_roll_leaves_heading_untouched() {
        for angle in [-3.0, -0.2, 1e-9, 0.7, 3.1] {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
            let error = PoseError::between(&Isometry3::identity(), &pose([0.0; 3], turn));
            assert_relative_eq!(error.roll_rad.unwrap(), angle, epsilon = 1e-14);
            assert_relative_eq!(error.heading_rad(), 0.0, epsilon = 1e-15);
            assert_relative_eq!(error.attitude_rad(), angle.abs(), epsilon = 1e-14);
        }
    }

    #[test]
    fn closed_form_opposite_heading_has_no_roll() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
        let error = PoseError::between(&Isometry3::identity(), &pose([0.0; 3], turn));
        assert_relative_eq!(error.heading_rad(), PI, epsilon = 1e-15);
        assert_eq!(error.roll_rad, None);
    }

    #[test]
    fn closed_form_tiny_angle_is_not_lost() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1e-11);
        let error = PoseError::between(&Isometry3::identity(), &pose([0.0; 3], turn));
        assert_relative_eq!(error.attitude_rad(), 1e-11, max_relative = 1e-12);
        assert_relative_eq!(error.heading_rad(), 1e-11, max_relative = 1e-12);
    }

    fn quaternion() -> impl Strategy<Value = UnitQuaternion<f64>> {
        proptest::array::uniform4(-1.0..1.0_f64).prop_filter_map("direction", |q| {
            let quaternion = nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]);
            (quaternion.norm() > 0.1).then(|| UnitQuaternion::from_quaternion(quaternion))
        })
    }

    proptest! {
        /// truth = estimate (+) error, with the matrix exponential as the independent formula.
        #[test]
        fn law_error_leads_from_estimate_to_truth(a in quaternion(), b in quaternion()) {
            let error = PoseError::between(&pose([0.1, 0.2, 0.3], a), &pose([0.3, -0.1, 0.0], b));
            let exponential: Matrix3<f64> = Rotation3::new(error.attitude_capsule_rad).into_inner();
            let reached = a.to_rotation_matrix().into_inner() * exponential;
            prop_assert!((reached - b.to_rotation_matrix().into_inner()).norm() < 1e-12);
            prop_assert!(error.attitude_rad() <= PI + 1e-12);
        }

        /// Swing after twist is the whole rotation; heading is the arc between the axes; both are at most the
        /// whole.
        #[test]
        fn law_pointing_and_roll_compose_to_attitude(a in quaternion(), b in quaternion()) {
            let error = PoseError::between(&pose([0.0; 3], a), &pose([0.0; 3], b));
            let [y, z] = error.pointing_capsule_rad;
            let swing = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, y, z));
            if let Some(roll) = error.roll_rad {
                let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll);
                prop_assert!(rotation_angle_rad(&((a * swing * twist).inverse() * b)) < 1e-7);
            }
            let cosine = (a * Vector3::x()).dot(&(b * Vector3::x())).clamp(-1.0, 1.0);
            prop_assert!((error.heading_rad().cos() - cosine).abs() < 1e-12);
            prop_assert!(error.heading_rad() <= error.attitude_rad() + 1e-12);
        }

        /// The figures do not depend on which of q and -q stands for an attitude.
        #[test]
        fn law_quaternion_sign_is_irrelevant(a in quaternion(), b in quaternion()) {
            let negative = UnitQuaternion::new_unchecked(-b.into_inner());
            let one = PoseError::between(&pose([0.0; 3], a), &pose([0.0; 3], b));
            let other = PoseError::between(&pose([0.0; 3], a), &pose([0.0; 3], negative));
            prop_assert!((one.attitude_capsule_rad - other.attitude_capsule_rad).norm() < 1e-12);
            prop_assert!((one.heading_rad() - other.heading_rad()).abs() < 1e-12);
        }
    }
}
