//! The rigid motion or similarity that brings an estimate onto its reference with the smallest squared
//! distance of positions (Umeyama 1991).
//!
//! ```text
//! minimise  sum_i || q_i - (s R p_i + t) ||^2,     q reference, p estimate
//! S = (1/n) sum_i (q_i - mean q)(p_i - mean p)^T = U D V^T,   W = diag(1, 1, sign(det U det V))
//! R = U W V^T,   s = trace(D W) / var(p)  (1 for SE(3)),   t = mean q - s R mean p
//! ```
//!
//! Only positions enter; attitudes are turned along. Positions on a line, or a capsule at rest, leave a
//! rotation free: that is an error here, not an arbitrary answer. The rank is judged relative to the largest
//! singular value (evo compares with an absolute 2e-16 m^2, which at the scale of a capsule refuses paths
//! below 15 nm of width; the two agree on every trajectory of a capsule that moves).

use super::AssociatedPoses;
use crate::error::EvaluationError;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A path whose second singular value is below this share of the first is a line: its width is then less than
/// a millionth of its length, below a micrometre in the gut, which is rounding of a file and not a shape.
const DEGENERATE_SHARE: f64 = 1e-12;

/// What may be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlignmentKind {
    /// Rotation and translation.
    Rigid,
    /// Rotation, translation and one scale (tracks of a single camera).
    Similarity,
}

/// `p_reference = scale * R * p_estimate + t`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// Rotation and translation (m), `reference_from_estimate`, applied after the scale.
    pub reference_from_estimate: Isometry3<f64>,
    /// Scale of positions.
    pub scale: f64,
}

impl Alignment {
    /// One pose of the estimate in the frame of the reference.
    pub fn apply(&self, world_from_capsule: &Isometry3<f64>) -> Isometry3<f64> {
        let scaled = Isometry3::from_parts(
            Translation3::from(world_from_capsule.translation.vector * self.scale),
            world_from_capsule.rotation,
        );
        self.reference_from_estimate * scaled
    }
}

/// The best alignment of the estimate to the reference.
///
/// # Errors
/// [`EvaluationError::DegenerateAlignment`] where positions lie on a line or in one point;
/// [`EvaluationError::TooFew`] below 3 pairs.
pub fn fit_alignment(pairs: &AssociatedPoses, kind: AlignmentKind) -> Result<Alignment, EvaluationError> {
    let given = pairs.len();
    if given < 3 {
        return Err(EvaluationError::TooFew { what: "alignment", needed: 3, given });
    }
    let positions = |poses: &[Isometry3<f64>]| poses.iter().map(|p| p.translation.vector).collect::<Vec<_>>();
    let (reference, estimate) = (positions(&pairs.reference), positions(&pairs.estimate));
    let n = given as f64;
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / n;
    let (mean_reference, mean_estimate) = (mean(&reference), mean(&estimate));
    let mut covariance = Matrix3::zeros();
    let mut variance = 0.0;
    for (q, p) in reference.iter().zip(&estimate) {
        covariance += (q - mean_reference) * (p - mean_estimate).transpose() / n;
        variance += (p - mean_estimate).norm_squared() / n;
    }
    let (rotation, singular_values) = rotation_of(&covariance)?;
    let scale = match kind {
        AlignmentKind::Rigid => 1.0,
        AlignmentKind::Similarity => singular_values.sum() / variance,
    };
    let translation = Translation3::from(mean_reference - rotation * mean_estimate * scale);
    Ok(Alignment { reference_from_estimate: Isometry3::from_parts(translation, rotation), scale })
}

/// The estimate moved by its best alignment, and that alignment.
///
/// # Errors
/// As [`fit_alignment`].
pub fn aligned(
    pairs: &AssociatedPoses,
    kind: AlignmentKind,
) -> Result<(AssociatedPoses, Alignment), EvaluationError> {
    let alignment = fit_alignment(pairs, kind)?;
    let estimate = pairs.estimate.iter().map(|pose| alignment.apply(pose)).collect();
    let moved = AssociatedPoses { estimate, ..pairs.clone() };
    Ok((moved, alignment))
}

/// The rotation nearest to a cross covariance, and its singular values with the sign of the last one.
fn rotation_of(covariance: &Matrix3<f64>) -> Result<(UnitQuaternion<f64>, Vector3<f64>), EvaluationError> {
    let svd = covariance.svd(true, true);
    let (largest_m2, second_m2) = (svd.singular_values[0], svd.singular_values[1]);
    let degenerate = EvaluationError::DegenerateAlignment { largest_m2, second_m2 };
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(degenerate) };
    // Written so that NaN counts as degenerate; a largest value of zero is a capsule at rest.
    let determined = largest_m2 > 0.0 && second_m2 > DEGENERATE_SHARE * largest_m2;
    if !determined {
        return Err(degenerate);
    }
    let mut singular_values = svd.singular_values;
    let mut u = u;
    if u.determinant() * v_t.determinant() < 0.0 {
        singular_values[2] = -singular_values[2];
        u.column_mut(2).neg_mut();
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t));
    Ok((rotation, singular_values))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn helix(count: usize) -> Vec<Isometry3<f64>> {
        (0..count)
            .map(|i| {
                let s = 0.1 * i as f64;
                Isometry3::from_parts(
                    Translation3::new(0.05 * s.cos(), 0.03 * s.sin(), 0.01 * s),
                    UnitQuaternion::from_euler_angles(0.3 * s, 0.1 * s, -0.2 * s),
                )
            })
            .collect()
    }

    fn moved(reference: &[Isometry3<f64>], scale: f64) -> (AssociatedPoses, Alignment) {
        let truth = Alignment {
            reference_from_estimate: Isometry3::from_parts(
                Translation3::new(0.2, -0.1, 0.4),
                UnitQuaternion::from_euler_angles(0.5, -1.0, 2.0),
            ),
            scale,
        };
        let undo = truth.reference_from_estimate.inverse();
        let estimate = reference.iter().map(|pose| {
            let back = undo * pose;
            Isometry3::from_parts(Translation3::from(back.translation.vector / scale), back.rotation)
        });
        let estimate = estimate.collect();
        (
            AssociatedPoses { stamps_s: vec![0.0; reference.len()], reference: reference.to_vec(), estimate },
            truth,
        )
    }

    #[test]
    fn closed_form_known_motion_is_found() {
        for (kind, scale) in [(AlignmentKind::Rigid, 1.0), (AlignmentKind::Similarity, 0.7)] {
            let (pairs, truth) = moved(&helix(40), scale);
            let (aligned_pairs, found) = aligned(&pairs, kind).unwrap();
            assert_relative_eq!(found.scale, truth.scale, epsilon = 1e-12);
            assert_relative_eq!(
                found.reference_from_estimate,
                truth.reference_from_estimate,
                epsilon = 1e-12
            );
            for (a, b) in aligned_pairs.estimate.iter().zip(&pairs.reference) {
                assert_relative_eq!(a, b, epsilon = 1e-12);
            }
        }
    }

    #[test]
    fn closed_form_planar_path_is_enough() {
        let flat: Vec<_> =
            helix(30).iter().map(|p| Isometry3::translation(p.translation.x, p.translation.y, 0.0)).collect();
        let (pairs, truth) = moved(&flat, 1.0);
        let found = fit_alignment(&pairs, AlignmentKind::Rigid).unwrap();
        assert_relative_eq!(found.reference_from_estimate, truth.reference_from_estimate, epsilon = 1e-12);
    }

    #[test]
    fn closed_form_line_rest_and_two_poses_are_refused() {
        let line: Vec<_> =
            (0..20).map(|i| Isometry3::translation(0.1 * f64::from(i), 0.2 * f64::from(i), 0.0)).collect();
        let (pairs, _) = moved(&line, 1.0);
        let refused = fit_alignment(&pairs, AlignmentKind::Rigid);
        assert!(matches!(refused, Err(EvaluationError::DegenerateAlignment { .. })), "{refused:?}");
        let (pairs, _) = moved(&[Isometry3::translation(0.1, 0.2, 0.3); 20], 1.0);
        let refused = fit_alignment(&pairs, AlignmentKind::Similarity);
        assert!(matches!(refused, Err(EvaluationError::DegenerateAlignment { .. })), "{refused:?}");
        let (pairs, _) = moved(&helix(2), 1.0);
        assert!(matches!(fit_alignment(&pairs, AlignmentKind::Rigid), Err(EvaluationError::TooFew { .. })));
    }

    /// The optimum: no small extra motion makes the squared distances smaller, with a noisy estimate as with
    /// a mirrored one, whose best orthogonal matrix is no rotation.
    #[test]
    fn law_no_neighbouring_motion_fits_better() {
        let (mut noisy, _) = moved(&helix(40), 1.0);
        for (i, pose) in noisy.estimate.iter_mut().enumerate() {
            let k = i as f64;
            pose.translation.vector +=
                Vector3::new((7.0 * k).sin(), (11.0 * k).cos(), (13.0 * k).sin()) * 1e-3;
        }
        let mut mirrored = noisy.clone();
        for pose in &mut mirrored.estimate {
            pose.translation.x = -pose.translation.x;
        }
        for pairs in [noisy, mirrored] {
            let best = fit_alignment(&pairs, AlignmentKind::Similarity).unwrap();
            let rotation = best.reference_from_estimate.rotation.to_rotation_matrix();
            assert_relative_eq!(rotation.matrix().determinant(), 1.0, epsilon = 1e-12);
            assert_optimal(&pairs, &best);
        }
    }

    fn assert_optimal(pairs: &AssociatedPoses, best: &Alignment) {
        let cost = |alignment: &Alignment| -> f64 {
            let both = pairs.estimate.iter().zip(&pairs.reference);
            both.map(|(e, r)| (alignment.apply(e).translation.vector - r.translation.vector).norm_squared())
                .sum()
        };
        for axis in 0..7 {
            for step in [-1e-4, 1e-4] {
                let mut other = *best;
                let mut direction = Vector3::zeros();
                direction[axis % 3] = step;
                match axis {
                    0..3 => other.reference_from_estimate.translation.vector += direction,
                    3..6 => {
                        let turn = UnitQuaternion::from_scaled_axis(direction);
                        other.reference_from_estimate.rotation = turn * best.reference_from_estimate.rotation;
                    }
                    _ => other.scale += step,
                }
                assert!(cost(&other) > cost(best), "axis {axis}, step {step}");
            }
        }
    }
}
