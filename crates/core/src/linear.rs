//! What is left of a linear system some directions of which nothing tells.

use nalgebra::DMatrix;

/// Below this share of the largest eigenvalue, of a matrix scaled to a unit diagonal, a direction is rounding.
const LEAST_EIGENVALUE: f64 = 1e-12;

/// A generalised inverse G of a positive semidefinite matrix N (`N G N = N`) and its rank.
///
/// N is scaled to a unit diagonal, directions without weight are left out, and G is zero there. Of parameters p beside others n with a
/// joint information I, `I_pp - I_pn G I_np` is the information about p with n unknown, also where nothing tells all of n: what does not
/// matter to any reading takes nothing away.
pub fn generalised_inverse(matrix: &DMatrix<f64>) -> (DMatrix<f64>, usize) {
    let scale = matrix.diagonal().map(|d| if d > 0.0 && d.is_finite() { d.sqrt().recip() } else { 0.0 });
    let scaling = DMatrix::from_diagonal(&scale);
    let eigen = (&scaling * matrix * &scaling).symmetric_eigen();
    let least = LEAST_EIGENVALUE * eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let mut inverse = DMatrix::zeros(matrix.nrows(), matrix.ncols());
    let mut rank = 0;
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > least {
            let along = &scaling * vector;
            inverse += &along * along.transpose() / *value;
            rank += 1;
        }
    }
    (inverse, rank)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rank 2 of 4: two rows, one of which is in nanoteslas; and nothing at all.
    #[test]
    fn law_n_g_n_is_n_and_the_rank_is_counted() {
        let rows = DMatrix::from_row_slice(2, 4, &[1.0, 2e9, 0.0, -1.0, 0.5, -1e9, 0.0, 3.0]);
        let matrix = rows.tr_mul(&rows);
        let (inverse, rank) = generalised_inverse(&matrix);
        assert_eq!(rank, 2);
        let again = &matrix * inverse * &matrix;
        for (a, b) in again.iter().zip(matrix.iter()) {
            assert!((a - b).abs() <= 1e-9 * matrix.amax().sqrt() * (1.0 + b.abs().sqrt()), "{a} {b}");
        }
        assert_eq!(generalised_inverse(&DMatrix::zeros(3, 3)), (DMatrix::zeros(3, 3), 0));
    }
}
