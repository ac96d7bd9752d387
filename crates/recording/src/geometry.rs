//! Shapes and rotations as the viewer wants them: `f32`, metres.

use lumenav_core::{CapsuleBody, FixKind};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rerun::{AsComponents, SerializedComponentBatch};

/// Square root of the 95 % quantile of chi-square with 3 degrees of freedom (7.814727903251178): the 95 % region of a position is
/// the ellipsoid of this many standard deviations.
const REGION_95_SIGMA: f64 = 2.795_483_482_915_108;

/// A point in the viewer's precision.
pub(crate) fn point_m(v: &Vector3<f64>) -> [f32; 3] {
    v.cast::<f32>().into()
}

fn quaternion(q: &UnitQuaternion<f64>) -> rerun::Quaternion {
    rerun::Quaternion::from_xyzw([q.i as f32, q.j as f32, q.k as f32, q.w as f32])
}

/// The transform of a pose; a position alone keeps the world's axes.
pub(crate) fn transform(world_from_capsule: &Isometry3<f64>, kind: FixKind) -> rerun::Transform3D {
    let transform =
        rerun::Transform3D::update_fields().with_translation(point_m(&world_from_capsule.translation.vector));
    match kind {
        FixKind::Position => transform,
        FixKind::Pointing | FixKind::Full => {
            transform.with_quaternion(quaternion(&world_from_capsule.rotation))
        }
    }
}

/// The capsule's solid about the origin of its own frame, x along its axis; a ball where the attitude is unknown.
pub(crate) fn solid(
    body: &CapsuleBody,
    kind: FixKind,
    rgba: u32,
    mode: rerun::FillMode,
) -> Vec<SerializedComponentBatch> {
    let radius = body.radius_m as f32;
    let length =
        if kind == FixKind::Position { 0.0 } else { (body.length_m - 2.0 * body.radius_m).max(0.0) as f32 };
    // The viewer's capsule starts at the origin and runs along z: turned onto x, and back by half its length.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    rerun::Capsules3D::from_lengths_and_radii([length], [radius])
        .with_quaternions([quaternion(&turn)])
        .with_translations([[-0.5 * length, 0.0, 0.0]])
        .with_colors([rerun::Color::from_u32(rgba)])
        .with_line_radii([rerun::Radius::new_ui_points(0.6)])
        .with_fill_mode(mode)
        .as_serialized_batches()
}

/// Half axes (m) and orientation of the 95 % region of a position; `None` where the covariance is no covariance.
pub(crate) fn region_95(covariance_m2: &Matrix3<f64>) -> Option<(Vector3<f64>, UnitQuaternion<f64>)> {
    if !covariance_m2.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = covariance_m2.symmetric_eigen();
    if eigen.eigenvalues.iter().any(|&variance| variance < 0.0) {
        return None;
    }
    let mut axes = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        // Left-handed: the sign of an axis is free, a rotation needs the other one.
        axes.column_mut(2).neg_mut();
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Some((eigen.eigenvalues.map(|variance| REGION_95_SIGMA * variance.sqrt()), rotation))
}

/// The ellipsoid of a position's 95 % region.
pub(crate) fn ellipsoid(
    centre_world_m: &Vector3<f64>,
    covariance_m2: &Matrix3<f64>,
) -> Option<rerun::Ellipsoids3D> {
    let (half_m, rotation) = region_95(covariance_m2)?;
    Some(
        rerun::Ellipsoids3D::update_fields()
            .with_half_sizes([rerun::HalfSize3D::from(point_m(&half_m))])
            .with_centers([point_m(centre_world_m)])
            .with_quaternions([quaternion(&rotation)]),
    )
}

/// Lower end, degrees of freedom and upper end of the 95 % band of a chi-square variable (2.5 % and 97.5 % quantiles,
/// NIST/SEMATECH e-Handbook of Statistical Methods, table 1.3.6.7.4).
pub(crate) fn band_95(degrees_of_freedom: usize) -> Option<[f64; 3]> {
    match degrees_of_freedom {
        3 => Some([0.216, 3.0, 9.348]),
        5 => Some([0.831, 5.0, 12.833]),
        6 => Some([1.237, 6.0, 14.449]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_region_of_a_turned_covariance() {
        for angles in [[0.3, -1.2, 2.5], [3.0, 0.1, 0.0], [0.0, 0.0, 0.0]] {
            let turn = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner();
            let covariance =
                turn * Matrix3::from_diagonal(&Vector3::new(1e-6, 4e-6, 9e-6)) * turn.transpose();
            let (half, rotation) = region_95(&covariance).unwrap();
            let mut sorted: Vec<f64> = half.iter().copied().collect();
            sorted.sort_by(f64::total_cmp);
            for (h, sigma) in sorted.iter().zip([1e-3, 2e-3, 3e-3]) {
                assert!((h - sigma * 7.814_727_903_251_178_f64.sqrt()).abs() < 1e-9);
            }
            // The axes with the half lengths give the covariance back: nothing was mirrored or swapped.
            let axes = rotation.to_rotation_matrix().into_inner();
            let again =
                axes * Matrix3::from_diagonal(&(half / REGION_95_SIGMA).map(|h| h * h)) * axes.transpose();
            assert!((again - covariance).abs().max() < 1e-15);
            assert!((axes.determinant() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn law_what_is_no_covariance_is_not_drawn() {
        assert!(region_95(&Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0))).is_none());
        assert!(region_95(&Matrix3::from_element(f64::NAN)).is_none());
    }
}
