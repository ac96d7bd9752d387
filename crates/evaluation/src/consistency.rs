//! Does a filter know how wrong it is? NEES, NIS, credible regions, whiteness, and a verdict in words.
//!
//! ```text
//! NEES = e^T P^-1 e     e true error of the estimate, P the covariance the filter claims      (needs truth)
//! NIS  = y^T S^-1 y     y innovation (measured minus predicted), S its claimed covariance     (needs no truth)
//! ```
//!
//! If the claims are right and errors Gaussian, both are chi-square distributed, with mean equal to their
//! degrees of freedom (dof). Error vectors are `[dp_world (3, m), dtheta_capsule (3, rad)]` with the right
//! perturbation of [`crate::pose_error`]; another convention gives another NEES. [`ErrorBlock`] says which
//! part is judged.
//!
//! What may be tested with what:
//!
//! - NIS is white over time, so it may be summed over one run and compared with one chi-square band
//!   ([`one_run::NisAccumulator`]).
//! - NEES is not: errors persist, so its sum over one run rejects a perfect filter five to eight times too
//!   often (25 % at a nominal 5 % with the filter of `tests/linear_filter.rs`). Over one run its mean is
//!   *reported* ([`one_run::NeesAccumulator`]); the *test* compares the mean over Monte-Carlo runs at each
//!   step with its band ([`across_runs::NeesAcrossRuns`]).
//! - A NIS inside its band does not prove the state consistent (unobserved directions): both are shown.
//! - Innovations of a good filter carry nothing of the past: [`whiteness`].
//!
//! Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.
//!
//! Neglected: the band of NIS assumes that gating cut nothing off; push innovations before the gate.

pub mod across_runs;
pub mod one_run;
pub mod verdict;
pub mod whiteness;

use crate::error::EvaluationError;
use crate::pose_error::PoseError;
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, Matrix3, Matrix5, Matrix6, OMatrix, OVector};
use serde::{Deserialize, Serialize};

/// Which part of the pose error is judged against which part of the covariance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorBlock {
    /// Position, 3 dof.
    Position,
    /// Position and the direction of the capsule's axis, 5 dof: where roll is unobservable.
    PositionAndPointing,
    /// Position and attitude, 6 dof.
    FullPose,
}

impl ErrorBlock {
    /// Degrees of freedom.
    pub fn dof(self) -> usize {
        match self {
            Self::Position => 3,
            Self::PositionAndPointing => 5,
            Self::FullPose => 6,
        }
    }
}

/// `v^T C^-1 v` by the Cholesky factor of `C` (its lower triangle is read; no inverse is formed).
///
/// # Errors
/// `C` is not positive definite, sizes differ, or the result is not finite.
pub fn quadratic_form<D: Dim>(
    vector: &OVector<f64, D>,
    covariance: &OMatrix<f64, D, D>,
) -> Result<f64, EvaluationError>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    let form = whitened(vector, covariance)?.norm_squared();
    if form.is_finite() {
        Ok(form)
    } else {
        Err(EvaluationError::NotFinite { what: "quadratic form", index: 0 })
    }
}

/// `L^-1 v` with `C = L L^T`: uncorrelated with unit variance if `v` has the covariance `C`.
///
/// # Errors
/// `C` is not positive definite, or sizes differ.
pub fn whitened<D: Dim>(
    vector: &OVector<f64, D>,
    covariance: &OMatrix<f64, D, D>,
) -> Result<OVector<f64, D>, EvaluationError>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    let (size, columns) = covariance.shape();
    for (first, second) in [(vector.nrows(), size), (size, columns)] {
        if first != second {
            return Err(EvaluationError::ShapeMismatch { what: "vector and covariance", first, second });
        }
    }
    let not_positive = EvaluationError::NotPositiveDefinite { size };
    let factor = covariance.clone().cholesky().ok_or(not_positive.clone())?;
    let mut white = vector.clone();
    if factor.l_dirty().solve_lower_triangular_mut(&mut white) { Ok(white) } else { Err(not_positive) }
}

/// Normalised estimation error squared of one pose.
///
/// `covariance` is that of `[dp_world (3, m), dtheta_capsule (3, rad)]`; of it, the part that belongs to
/// `block` is used (the marginal: position is the upper left 3 x 3, pointing leaves out the row and column of
/// roll).
///
/// # Errors
/// As [`quadratic_form`].
pub fn nees(error: &PoseError, covariance: &Matrix6<f64>, block: ErrorBlock) -> Result<f64, EvaluationError> {
    match block {
        ErrorBlock::Position => {
            let position: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
            quadratic_form(&error.position_world_m, &position)
        }
        ErrorBlock::PositionAndPointing => {
            let kept = [0, 1, 2, 4, 5];
            let marginal = Matrix5::from_fn(|i, j| covariance[(kept[i], kept[j])]);
            quadratic_form(&error.position_and_pointing(), &marginal)
        }
        ErrorBlock::FullPose => quadratic_form(&error.full_pose(), covariance),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{
        DMatrix, DVector, Isometry3, Matrix2, Translation3, UnitQuaternion, Vector2, Vector3, Vector6,
    };

    #[test]
    fn closed_form_diagonal_and_correlated() {
        let diagonal = Matrix2::new(4.0, 0.0, 0.0, 9.0);
        assert_relative_eq!(
            quadratic_form(&Vector2::new(2.0, 3.0), &diagonal).unwrap(),
            2.0,
            epsilon = 1e-15
        );
        // (x^2 - 2 r x y + y^2) / (1 - r^2) for unit variances
        let correlated = Matrix2::new(1.0, 0.5, 0.5, 1.0);
        let form = quadratic_form(&Vector2::new(1.0, -2.0), &correlated).unwrap();
        assert_relative_eq!(form, 7.0 / 0.75, epsilon = 1e-14);
    }

    #[test]
    fn closed_form_bad_covariances_are_refused() {
        let v = Vector2::new(1.0, 1.0);
        for bad in [
            Matrix2::new(1.0, 1.0, 1.0, 1.0),
            Matrix2::zeros(),
            Matrix2::new(1.0, 0.0, 0.0, -1.0),
            Matrix2::repeat(f64::NAN),
        ] {
            assert_eq!(
                quadratic_form(&v, &bad),
                Err(EvaluationError::NotPositiveDefinite { size: 2 }),
                "{bad}"
            );
        }
        let mismatch = quadratic_form(&DVector::zeros(3), &DMatrix::identity(2, 2));
        assert!(matches!(mismatch, Err(EvaluationError::ShapeMismatch { .. })));
        let lost = quadratic_form(&Vector2::new(f64::NAN, 0.0), &Matrix2::identity());
        assert!(matches!(lost, Err(EvaluationError::NotFinite { .. })));
    }

    #[test]
    fn closed_form_blocks_of_a_pose() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.1);
        let truth = Isometry3::from_parts(Translation3::new(0.001, 0.002, 0.0), turn);
        let error = PoseError::between(&Isometry3::identity(), &truth);
        let covariance = Matrix6::from_diagonal(&Vector6::new(1e-6, 1e-6, 1e-6, 1e-2, 1e-2, 1e-2));
        assert_relative_eq!(nees(&error, &covariance, ErrorBlock::Position).unwrap(), 5.0, epsilon = 1e-12);
        let pointing = nees(&error, &covariance, ErrorBlock::PositionAndPointing).unwrap();
        assert_relative_eq!(pointing, 6.0, epsilon = 1e-12);
        assert_relative_eq!(nees(&error, &covariance, ErrorBlock::FullPose).unwrap(), 6.0, epsilon = 1e-12);
    }

    /// A full turn of unknown roll changes the 6-dof figure and leaves the 5-dof one alone.
    #[test]
    fn law_pointing_block_ignores_roll() {
        let covariance = Matrix6::from_diagonal(&Vector6::new(1e-6, 1e-6, 1e-6, 1.0, 1e-2, 2e-2));
        let truth = Isometry3::new(Vector3::new(0.001, 0.0, 0.002), Vector3::new(0.0, 0.05, -0.08));
        let rolled = truth * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 2.5);
        let block = ErrorBlock::PositionAndPointing;
        let plain = nees(&PoseError::between(&Isometry3::identity(), &truth), &covariance, block).unwrap();
        let after = nees(&PoseError::between(&Isometry3::identity(), &rolled), &covariance, block).unwrap();
        assert_relative_eq!(plain, after, max_relative = 1e-12);
    }

    /// The form does not depend on the frame in which error and covariance are written.
    #[test]
    fn law_invariant_under_change_of_basis() {
        let basis = Matrix3::new(1.0, 0.3, -0.2, 0.1, 2.0, 0.4, 0.0, -0.7, 0.5);
        let covariance = Matrix3::new(2.0, 0.3, 0.1, 0.3, 1.0, -0.2, 0.1, -0.2, 0.5);
        let v = Vector3::new(0.3, -1.0, 0.7);
        let moved = quadratic_form(&(basis * v), &(basis * covariance * basis.transpose())).unwrap();
        assert_relative_eq!(quadratic_form(&v, &covariance).unwrap(), moved, max_relative = 1e-12);
    }
}
