//! Small dense kernels of the update, written out so that every entry is a sum in one fixed order.
//!
//! A general matrix product picks its kernel by the processor (with or without fused multiply-add) and by the matrix's size,
//! so the last bit of a covariance would depend on the machine and on how many clones the state happens to hold. Here an
//! entry depends on nothing but its own row and column. All inner loops run down a column (storage order).

use crate::belief::CORE;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// The lower factor of a symmetric positive *semi*definite matrix, `a = C Cᵀ` (its lower triangle is read).
///
/// A direction without variance (a calibration that is known exactly, a clone taken this very instant) gives a zero column
/// instead of a failure. `None` where a pivot is negative beyond rounding or not finite.
pub(crate) fn cholesky_semidefinite(mut a: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let done = match n {
        6 => factorise::<6>(a.as_mut_slice(), 6),
        _ => factorise::<0>(a.as_mut_slice(), n),
    };
    done.then_some(a)
}

/// Factorises in place; false where that is not possible. N is the size where the compiler is to know it (a pose), else 0: its
/// loops then have no ends to look for, and whole columns cost less than their lower parts.
fn factorise<const N: usize>(a: &mut [f64], n: usize) -> bool {
    let n = if N == 0 { n } else { N };
    // Rounding of a pivot: n subtractions from a number of the diagonal's size.
    let rounding = 4.0 * n as f64 * f64::EPSILON;
    for k in 0..n {
        let from = if N == 0 { k } else { 0 };
        let (head, tail) = a[..n * n].split_at_mut(k * n);
        let column = &mut tail[..n];
        let original = column[k];
        for source in head.chunks_exact(n) {
            add_multiple(&mut column[from..], &source[from..], -source[k]);
        }
        let pivot = column[k];
        if pivot > rounding * original {
            let root = pivot.sqrt();
            column[from..].iter_mut().for_each(|value| *value /= root);
            column[k] = root;
        } else if pivot >= -1e3 * rounding * original {
            column[k..].fill(0.0);
        } else {
            return false;
        }
        column[..k].fill(0.0);
    }
    a.iter().all(|v| v.is_finite())
}

/// `target += factor * source`.
#[expect(clippy::inline_always, reason = "callers know the length, which unrolls it")]
#[inline(always)]
pub(crate) fn add_multiple(target: &mut [f64], source: &[f64], factor: f64) {
    for (value, other) in target.iter_mut().zip(source) {
        *value += factor * other;
    }
}

/// Sum of products, in the order of nalgebra's own: eight partial sums, then what is left.
#[expect(clippy::inline_always, reason = "callers know the length, which unrolls it")]
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest = a.remainder().iter().zip(b.remainder());
    let mut whole = 0.0;
    if a.len() > 0 {
        let mut partial = [0.0; 8];
        for (a, b) in a.zip(b) {
            partial.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
        }
        whole = (0..4).fold(0.0, |sum, i| sum + (partial[i] + partial[i + 4]));
    }
    rest.fold(whole, |sum, (a, b)| sum + a * b)
}

/// `M v`.
pub(crate) fn times(matrix: &DMatrix<f64>, v: &DVector<f64>) -> DVector<f64> {
    let mut product = DVector::zeros(matrix.nrows());
    for (column, factor) in matrix.as_slice().chunks_exact(matrix.nrows().max(1)).zip(v.iter()) {
        add_multiple(product.as_mut_slice(), column, *factor);
    }
    product
}

/// `Cᵀ v`.
pub(crate) fn transposed_times(matrix: &DMatrix<f64>, v: &DVector<f64>) -> DVector<f64> {
    let columns = matrix.as_slice().chunks_exact(matrix.nrows().max(1));
    DVector::from_iterator(matrix.ncols(), columns.map(|column| dot(column, v.as_slice())))
}

/// `v ← C v` for a lower factor C.
#[inline]
pub(crate) fn lower_times(lower: &DMatrix<f64>, v: &mut DVector<f64>) {
    let n = v.len();
    let (lower, v) = (&lower.as_slice()[..n * n], v.as_mut_slice());
    for i in (0..n).rev() {
        v[i] = (0..=i).map(|l| lower[l * n + i] * v[l]).sum();
    }
}

/// `v ← C⁻¹ v` for a lower factor C without zero pivots.
#[inline]
pub(crate) fn solve_lower(lower: &DMatrix<f64>, v: &mut DVector<f64>) {
    let n = v.len();
    let v = v.as_mut_slice();
    for (i, column) in lower.as_slice().chunks_exact(n.max(1)).enumerate() {
        v[i] /= column[i];
        let solved = v[i];
        add_multiple(&mut v[i + 1..], &column[i + 1..], -solved);
    }
}

/// `v ← C⁻ᵀ v` for a lower factor C without zero pivots.
#[inline]
pub(crate) fn solve_lower_transposed(lower: &DMatrix<f64>, v: &mut DVector<f64>) {
    let n = v.len();
    let v = v.as_mut_slice();
    for (i, column) in lower.as_slice().chunks_exact(n.max(1)).enumerate().rev() {
        v[i] = (v[i] - dot(&column[i + 1..], &v[i + 1..])) / column[i];
    }
}

/// `x ← x C⁻ᵀ` for a lower factor C; a zero pivot gives a zero column (pseudo-inverse).
pub(crate) fn solve_right_transposed(x: &mut DMatrix<f64>, lower: &DMatrix<f64>) {
    let (n, c) = x.shape();
    let lower = &lower.as_slice()[..c * c];
    match n {
        CORE => solve_right::<CORE>(x.as_mut_slice(), lower, n, c),
        _ => solve_right::<0>(x.as_mut_slice(), lower, n, c),
    }
}

/// N as in [`factorise`].
fn solve_right<const N: usize>(x: &mut [f64], lower: &[f64], n: usize, c: usize) {
    let n = if N == 0 { n } else { N };
    for k in 0..c {
        let (head, tail) = x.split_at_mut(k * n);
        let column = &mut tail[..n];
        let pivot = lower[k * c + k];
        if pivot == 0.0 {
            column.fill(0.0);
            continue;
        }
        for (l, source) in head.chunks_exact(n).enumerate() {
            add_multiple(column, source, -lower[l * c + k]);
        }
        column.iter_mut().for_each(|value| *value /= pivot);
    }
}

/// Rows and columns of the tiles of [`add_outer_lower`]: their sums stay in the processor's registers.
const TILE: usize = 4;

/// `target += sign * x xᵀ`, the lower triangle from column `first` on and some entries besides.
pub(crate) fn add_outer_lower(target: &mut DMatrix<f64>, x: &DMatrix<f64>, sign: f64, first: usize) {
    let n = target.nrows();
    let (target, x) = (target.as_mut_slice(), x.as_slice());
    let whole = n - n % TILE;
    for j in (first - first % TILE..whole).step_by(TILE) {
        for i in (j..whole).step_by(TILE) {
            add_outer_tile(target, x, n, (i, j), sign);
        }
    }
    // The last rows, which fill no tile.
    for j in first..if whole < n { n } else { first } {
        let from = j.max(whole);
        for source in x.chunks_exact(n) {
            add_multiple(&mut target[j * n + from..(j + 1) * n], &source[from..], sign * source[j]);
        }
    }
}

fn add_outer_tile(target: &mut [f64], x: &[f64], n: usize, (i, j): (usize, usize), sign: f64) {
    let mut tile = [[0.0; TILE]; TILE];
    for (column, sums) in tile.iter_mut().enumerate() {
        let at = (j + column) * n + i;
        sums.copy_from_slice(&target[at..at + TILE]);
    }
    for source in x.chunks_exact(n) {
        let (rows, factors) = (&source[i..i + TILE], &source[j..j + TILE]);
        for (sums, factor) in tile.iter_mut().zip(factors) {
            let factor = sign * factor;
            sums.iter_mut().zip(rows).for_each(|(sum, row)| *sum += factor * row);
        }
    }
    for (column, sums) in tile.iter().enumerate() {
        let at = (j + column) * n + i;
        target[at..at + TILE].copy_from_slice(sums);
    }
}

/// Replaces every pair of mirrored entries by its mean: rounding leaves a covariance asymmetric by an ulp.
pub(crate) fn symmetrise(a: &mut DMatrix<f64>) {
    let n = a.nrows();
    match n {
        CORE => symmetrise_square::<CORE>(a.as_mut_slice(), n),
        _ => symmetrise_square::<0>(a.as_mut_slice(), n),
    }
}

/// N as in [`factorise`].
fn symmetrise_square<const N: usize>(a: &mut [f64], n: usize) {
    let n = if N == 0 { n } else { N };
    let a = &mut a[..n * n];
    for j in 0..n {
        for i in j + 1..n {
            let mean = 0.5 * (a[j * n + i] + a[i * n + j]);
            a[j * n + i] = mean;
            a[i * n + j] = mean;
        }
    }
}

/// Turns three rows, and then the same three columns, from `at` on: `t a tᵀ` where t is the identity elsewhere.
pub(crate) fn turn(a: &mut DMatrix<f64>, at: usize, t: &Matrix3<f64>) {
    let n = a.nrows();
    for column in a.as_mut_slice().chunks_exact_mut(n) {
        let rows = &mut column[at..at + 3];
        let turned = t * Vector3::new(rows[0], rows[1], rows[2]);
        rows.copy_from_slice(turned.as_slice());
    }
    let (x, rest) = a.as_mut_slice()[at * n..].split_at_mut(n);
    let (y, rest) = rest.split_at_mut(n);
    for ((x, y), z) in x.iter_mut().zip(y).zip(&mut rest[..n]) {
        let turned = t * Vector3::new(*x, *y, *z);
        (*x, *y, *z) = (turned.x, turned.y, turned.z);
    }
}

/// What three columns from `from` on add to those from `to` on (`to < from`), each `to_i += Σ factors_ik from_k`; then those from
/// `from` on times `decay`. And the same with rows: `t a tᵀ` with t the identity but for these blocks.
pub(crate) fn carry(a: &mut DMatrix<f64>, to: usize, from: usize, factors: &Matrix3<f64>, decay: f64) {
    let n = a.nrows();
    for column in a.as_mut_slice().chunks_exact_mut(n) {
        let source = Vector3::new(column[from], column[from + 1], column[from + 2]);
        let added = factors * source;
        for i in 0..3 {
            column[to + i] += added[i];
            column[from + i] = source[i] * decay;
        }
    }
    let (targets, sources) = a.as_mut_slice().split_at_mut(from * n);
    let sources = &mut sources[..3 * n];
    for (i, target) in targets[to * n..(to + 3) * n].chunks_exact_mut(n).enumerate() {
        let (x, y, z) = (&sources[..n], &sources[n..2 * n], &sources[2 * n..]);
        let [a, b, c] = [factors[(i, 0)], factors[(i, 1)], factors[(i, 2)]];
        for (((value, x), y), z) in target.iter_mut().zip(x).zip(y).zip(z) {
            *value += a * x + b * y + c * z;
        }
    }
    sources.iter_mut().for_each(|value| *value *= decay);
}

/// These columns, in this order.
pub(crate) fn columns_of(a: &DMatrix<f64>, numbers: &[usize]) -> DMatrix<f64> {
    let n = a.nrows();
    let mut columns = DMatrix::zeros(n, numbers.len());
    for (column, i) in columns.as_mut_slice().chunks_exact_mut(n).zip(numbers) {
        column.copy_from_slice(&a.as_slice()[i * n..(i + 1) * n]);
    }
    columns
}

/// These rows, in this order.
pub(crate) fn rows_of(a: &DMatrix<f64>, numbers: &[usize]) -> DMatrix<f64> {
    let n = a.nrows();
    let mut rows = DMatrix::zeros(numbers.len(), a.ncols());
    for (row, column) in
        rows.as_mut_slice().chunks_exact_mut(numbers.len().max(1)).zip(a.as_slice().chunks_exact(n))
    {
        row.iter_mut().zip(numbers).for_each(|(value, i)| *value = column[*i]);
    }
    rows
}

/// Sets these columns and the rows of the same numbers to zero.
#[inline]
pub(crate) fn clear(a: &mut DMatrix<f64>, numbers: &[usize]) {
    let n = a.nrows();
    for column in a.as_mut_slice().chunks_exact_mut(n) {
        numbers.iter().for_each(|i| column[*i] = 0.0);
    }
    numbers.iter().for_each(|i| a.as_mut_slice()[i * n..(i + 1) * n].fill(0.0));
}

/// Copies the lower triangle into the upper one.
pub(crate) fn mirror_lower(a: &mut DMatrix<f64>) {
    let n = a.nrows();
    match n {
        6 => mirror::<6>(a.as_mut_slice(), n),
        CORE => mirror::<CORE>(a.as_mut_slice(), n),
        _ => mirror::<0>(a.as_mut_slice(), n),
    }
}

/// N as in [`factorise`].
fn mirror<const N: usize>(a: &mut [f64], n: usize) {
    let n = if N == 0 { n } else { N };
    let a = &mut a[..n * n];
    for j in 0..n {
        for i in j + 1..n {
            a[i * n + j] = a[j * n + i];
        }
    }
}

/// `Cᵀ A C` for a symmetric A and a lower factor C; both triangles.
pub(crate) fn congruence(a: &DMatrix<f64>, lower: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let mut result = DMatrix::zeros(n, n);
    match n {
        6 => congruence_into::<6>(result.as_mut_slice(), a.as_slice(), lower.as_slice(), 6),
        _ => congruence_into::<0>(result.as_mut_slice(), a.as_slice(), lower.as_slice(), n),
    }
    result
}

/// N as in [`factorise`].
fn congruence_into<const N: usize>(result: &mut [f64], a: &[f64], lower: &[f64], n: usize) {
    let n = if N == 0 { n } else { N };
    let (result, a, lower) = (&mut result[..n * n], &a[..n * n], &lower[..n * n]);
    // First A C, then what Cᵀ makes of it: an entry needs those of its column from its own row on, so it can take its place.
    for j in 0..n {
        let column = &mut result[j * n..(j + 1) * n];
        for l in j..n {
            add_multiple(column, &a[l * n..(l + 1) * n], lower[j * n + l]);
        }
        for i in j..n {
            let factors = &lower[i * n..(i + 1) * n];
            column[i] = (i..n).map(|l| factors[l] * column[l]).sum();
        }
    }
    mirror::<N>(result, n);
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
        add_outer_lower(&mut sum, &x, -1.0, 0);
        mirror_lower(&mut sum);
        assert!((sum - (DMatrix::identity(11, 11) - &x * x.transpose())).amax() < 1e-12);
    }
}
