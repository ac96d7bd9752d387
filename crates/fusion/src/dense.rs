//! Small dense kernels of the update, written out so that every entry is a sum in one fixed order.
//!
//! A general matrix product picks its kernel by the processor (with or without fused multiply-add) and by the matrix's size,
//! so the last bit of a covariance would depend on the machine and on how many clones the state happens to hold. Here an
//! entry depends on nothing but its own row and column. All inner loops run down a column (storage order).

use nalgebra::DMatrix;

/// The lower factor of a symmetric positive *semi*definite matrix, `a = C Cᵀ` (its lower triangle is read).
///
/// A direction without variance (a calibration that is known exactly, a clone taken this very instant) gives a zero column
/// instead of a failure. `None` where a pivot is negative beyond rounding or not finite.
pub(crate) fn cholesky_semidefinite(mut a: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    // Rounding of a pivot: n subtractions from a number of the diagonal's size.
    let rounding = 4.0 * n as f64 * f64::EPSILON;
    for k in 0..n {
        let original = a[(k, k)];
        for l in 0..k {
            let factor = a[(k, l)];
            if factor != 0.0 {
                axpy_below(&mut a, k, l, -factor);
            }
        }
        let pivot = a[(k, k)];
        if pivot > rounding * original {
            let root = pivot.sqrt();
            a[(k, k)] = root;
            (k + 1..n).for_each(|i| a[(i, k)] /= root);
        } else if pivot >= -1e3 * rounding * original {
            (k..n).for_each(|i| a[(i, k)] = 0.0);
        } else {
            return None;
        }
        (0..k).for_each(|i| a[(i, k)] = 0.0);
    }
    a.iter().all(|v| v.is_finite()).then_some(a)
}

/// `a[k.., target] += factor * a[k.., source]` with k = target.
fn axpy_below(a: &mut DMatrix<f64>, target: usize, source: usize, factor: f64) {
    let n = a.nrows();
    let (head, tail) = a.as_mut_slice().split_at_mut(target * n);
    let source = &head[source * n + target..source * n + n];
    for (value, other) in tail[target..n].iter_mut().zip(source) {
        *value += factor * other;
    }
}

/// `x ← x C⁻ᵀ` for a lower factor C; a zero pivot gives a zero column (pseudo-inverse).
pub(crate) fn solve_right_transposed(x: &mut DMatrix<f64>, lower: &DMatrix<f64>) {
    let n = x.nrows();
    for k in 0..x.ncols() {
        let (head, tail) = x.as_mut_slice().split_at_mut(k * n);
        let column = &mut tail[..n];
        let pivot = lower[(k, k)];
        if pivot == 0.0 {
            column.fill(0.0);
            continue;
        }
        for l in 0..k {
            let factor = lower[(k, l)];
            if factor != 0.0 {
                for (value, other) in column.iter_mut().zip(&head[l * n..(l + 1) * n]) {
                    *value -= factor * other;
                }
            }
        }
        for value in column.iter_mut() {
            *value /= pivot;
        }
    }
}

/// Lower triangle of `target += sign * x xᵀ`.
pub(crate) fn add_outer_lower(target: &mut DMatrix<f64>, x: &DMatrix<f64>, sign: f64) {
    let n = target.nrows();
    for j in 0..n {
        let column = &mut target.as_mut_slice()[j * n + j..(j + 1) * n];
        for source in x.as_slice().chunks_exact(n) {
            let factor = sign * source[j];
            for (value, other) in column.iter_mut().zip(&source[j..]) {
                *value += factor * other;
            }
        }
    }
}

/// Copies the lower triangle into the upper one.
pub(crate) fn mirror_lower(a: &mut DMatrix<f64>) {
    a.fill_upper_triangle_with_lower_triangle();
}

/// `Cᵀ A C` for a symmetric A and a lower factor C; both triangles.
pub(crate) fn congruence(a: &DMatrix<f64>, lower: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let mut product = DMatrix::<f64>::zeros(n, n);
    for (k, column) in product.as_mut_slice().chunks_exact_mut(n.max(1)).enumerate() {
        for l in k..n {
            let factor = lower[(l, k)];
            if factor != 0.0 {
                for (value, other) in column.iter_mut().zip(&a.as_slice()[l * n..(l + 1) * n]) {
                    *value += factor * other;
                }
            }
        }
    }
    let mut result = DMatrix::zeros(n, n);
    for j in 0..n {
        for i in j..n {
            let mut sum = 0.0;
            for l in i..n {
                sum += lower[(l, i)] * product[(l, j)];
            }
            result[(i, j)] = sum;
            result[(j, i)] = sum;
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example(n: usize, rank: usize) -> DMatrix<f64> {
        let x = DMatrix::from_fn(n, rank, |i, j| ((3 * i + 7 * j + 5 * i * j + i * i) as f64).sin());
        &x * x.transpose()
    }

    #[test]
    fn cross_factor_equals_nalgebra_where_definite() {
        let a = example(7, 12);
        let ours = cholesky_semidefinite(a.clone()).unwrap();
        assert!((ours - a.cholesky().unwrap().unpack()).amax() < 1e-12);
    }

    #[test]
    fn law_a_direction_without_variance_is_kept_without_variance() {
        let mut a = example(6, 12);
        a.row_mut(2).fill(0.0);
        a.column_mut(2).fill(0.0);
        let ours = cholesky_semidefinite(a.clone()).unwrap();
        assert!((&ours * ours.transpose() - &a).amax() < 1e-12);
        // A copy of another row, as a clone is of the pose.
        let mut b = example(6, 12);
        let row = b.row(1).into_owned();
        b.set_row(4, &row);
        let column = b.column(1).into_owned();
        b.set_column(4, &column);
        let ours = cholesky_semidefinite(b.clone()).unwrap();
        assert!((&ours * ours.transpose() - &b).amax() < 1e-12);
        a[(0, 0)] = -1.0;
        assert!(cholesky_semidefinite(a.clone()).is_none());
        a[(0, 0)] = f64::NAN;
        assert!(cholesky_semidefinite(a).is_none());
    }

    #[test]
    fn cross_products_equal_nalgebra() {
        let (a, c) = (example(8, 20), cholesky_semidefinite(example(8, 30)).unwrap());
        assert!((congruence(&a, &c) - c.transpose() * &a * &c).amax() < 1e-10);
        let x = DMatrix::from_fn(11, 8, |i, j| ((i + 5 * j + 3 * i * j) as f64).cos());
        let mut solved = x.clone();
        solve_right_transposed(&mut solved, &c);
        assert!((&solved * c.transpose() - &x).amax() < 1e-9);
        let mut sum = DMatrix::identity(11, 11);
        add_outer_lower(&mut sum, &x, -1.0);
        mirror_lower(&mut sum);
        assert!((sum - (DMatrix::identity(11, 11) - &x * x.transpose())).amax() < 1e-12);
    }
}
