//! Absolute pose error: each estimated pose against its reference pose, `E_i = P_i^-1 Q_i`.
//!
//! With [`Relation::TranslationPart`] this is the absolute trajectory error (ATE), the distance of the
//! positions.

use super::{AssociatedPoses, Relation, Statistics};
use crate::error::EvaluationError;

/// The error of every pair of poses, in the relation's unit.
pub fn absolute_errors(pairs: &AssociatedPoses, relation: Relation) -> Vec<f64> {
    let both = pairs.estimate.iter().zip(&pairs.reference);
    both.map(|(estimate, reference)| relation.error(&(estimate.inverse() * reference))).collect()
}

/// The figures of the absolute pose error.
///
/// # Errors
/// No pairs.
pub fn absolute_pose_error(
    pairs: &AssociatedPoses,
    relation: Relation,
) -> Result<Statistics, EvaluationError> {
    Statistics::of(&absolute_errors(pairs, relation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::Isometry3;

    #[test]
    fn closed_form_constant_offset() {
        let reference: Vec<_> =
            (0..5).map(|i| Isometry3::translation(0.01 * f64::from(i), 0.0, 0.0)).collect();
        let estimate =
            reference.iter().map(|pose| Isometry3::translation(0.0, 0.003, 0.004) * pose).collect();
        let pairs = AssociatedPoses { stamps_s: vec![0.0; 5], reference, estimate };
        let statistics = absolute_pose_error(&pairs, Relation::TranslationPart).unwrap();
        assert_relative_eq!(statistics.rmse, 0.005, epsilon = 1e-15);
        assert_relative_eq!(statistics.std, 0.0, epsilon = 1e-15);
        assert_eq!(absolute_pose_error(&pairs, Relation::RotationAngleDeg).unwrap().max, 0.0);
        assert!(absolute_pose_error(&pairs.first(0), Relation::TranslationPart).is_err());
    }
}
