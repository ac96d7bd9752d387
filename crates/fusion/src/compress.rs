//! A linearised measurement, reduced to the columns of the belief that it touches.
//!
//! ```text
//! A = Hᵀ R⁻¹ H  (c x c)        b = Hᵀ R⁻¹ r  (c)
//! ```
//!
//! Columns stand in the order of the model's parts. Where a part is the angular rate (kept in the world's frame, see
//! [`crate::belief`]) or stands twice, a matrix takes the filter's columns, sorted, to the parts'.

use crate::belief::{Belief, POSE, RATE, correction_jacobian};
use crate::dense::{dot, mirror_lower};
use lumenav_core::{Linearization, ModalityError, Noise, NominalState, Part};
use nalgebra::{DMatrix, DVector};
use std::ops::AddAssign as _;

/// A linearised measurement reduced to the columns it touches.
#[derive(Clone, Debug)]
pub struct Compressed {
    /// Touched columns of the error state.
    pub columns: Vec<usize>,
    /// `Hᵀ R⁻¹ H`.
    pub information: DMatrix<f64>,
    /// `Hᵀ R⁻¹ r`.
    pub gradient: DVector<f64>,
    /// Where in `columns` the three rotation columns of a pose begin.
    rotations: Vec<usize>,
    /// What goes into neither of them.
    pub(crate) evidence: Evidence,
}

/// What of a measurement does not go into information and gradient.
#[derive(Clone, Debug)]
pub(crate) enum Evidence {
    /// Residual form: `R^(-1/2) [H r]` and `ln det R`.
    Residual { whitened: DMatrix<f64>, noise_log_determinant: f64 },
    /// Information form: `ℓ` at the state of the linearization.
    Information { log_likelihood: f64 },
}

impl Compressed {
    /// Minus the log-likelihood at the state of the linearization, up to a constant of the measurement.
    pub(crate) fn misfit(&self) -> f64 {
        match &self.evidence {
            Evidence::Residual { whitened, .. } => 0.5 * whitened.column(self.columns.len()).norm_squared(),
            Evidence::Information { log_likelihood } => -log_likelihood,
        }
    }

    /// Turns a linearization at the state moved by `error` into one by the error itself: `b + A e` on the columns of e.
    pub(crate) fn seen_from_prior(&mut self, error: &DVector<f64>) {
        for at in &self.rotations {
            let jacobian = correction_jacobian(error, self.columns[*at]);
            let rows = jacobian.transpose() * self.information.fixed_rows::<3>(*at);
            self.information.fixed_rows_mut::<3>(*at).copy_from(&rows);
            let columns = self.information.fixed_columns::<3>(*at) * jacobian;
            self.information.fixed_columns_mut::<3>(*at).copy_from(&columns);
            let gradient = jacobian.transpose() * self.gradient.fixed_rows::<3>(*at);
            self.gradient.fixed_rows_mut::<3>(*at).copy_from(&gradient);
            if let Evidence::Residual { whitened, .. } = &mut self.evidence {
                let columns = whitened.fixed_columns::<3>(*at) * jacobian;
                whitened.fixed_columns_mut::<3>(*at).copy_from(&columns);
            }
        }
        let touched = DVector::from_iterator(self.columns.len(), self.columns.iter().map(|c| error[*c]));
        let curvature = &self.information * &touched;
        match &mut self.evidence {
            // The parabola through the current state, at e = 0.
            Evidence::Information { log_likelihood } => {
                *log_likelihood -= self.gradient.dot(&touched) + 0.5 * curvature.dot(&touched);
            }
            // The line through the current residual, at e = 0: `r + H e`.
            Evidence::Residual { whitened, .. } => {
                let there = whitened.columns(0, touched.len()) * &touched;
                whitened.column_mut(touched.len()).add_assign(&there);
            }
        }
        self.gradient += curvature;
    }
}

/// Reduces a linearization, made at `state`, to the belief's columns.
///
/// # Errors
/// [`ModalityError`] where the belief does not hold a part, shapes disagree, or a noise is not positive definite.
pub fn compress(
    linearization: &Linearization,
    belief: &Belief,
    state: &NominalState,
) -> Result<Compressed, ModalityError> {
    match linearization {
        Linearization::Residual { residual, jacobian, noise } => {
            compress_residual(residual, jacobian, noise, belief, state)
        }
        Linearization::Information { parts, gradient, information, log_likelihood, .. } => {
            let touched = Touched::by(parts.iter(), belief, state)?;
            if touched.width != gradient.len() || information.shape() != (touched.width, touched.width) {
                return Err(ModalityError::Undefined(
                    "information, gradient and parts disagree in size".into(),
                ));
            }
            let (information, gradient) = match &touched.to_parts {
                None => (information.clone(), gradient.clone()),
                Some(to_parts) => (to_parts.tr_mul(&(information * to_parts)), to_parts.tr_mul(gradient)),
            };
            let evidence = Evidence::Information { log_likelihood: *log_likelihood };
            let Touched { columns, rotations, .. } = touched;
            Ok(Compressed { columns, information, gradient, rotations, evidence })
        }
    }
}

/// The filter's columns that a list of parts touches, and how the parts' errors follow from them.
struct Touched {
    columns: Vec<usize>,
    /// Where in `columns` the three rotation columns of a pose begin.
    rotations: Vec<usize>,
    /// Columns of all parts together.
    width: usize,
    /// Part columns by filter columns; `None` for the identity, which it is but for the angular rate (see [`crate::belief`])
    /// and a part that stands twice.
    to_parts: Option<DMatrix<f64>>,
}

impl Touched {
    fn by<'a>(
        parts: impl Iterator<Item = &'a Part> + Clone,
        belief: &Belief,
        state: &NominalState,
    ) -> Result<Self, ModalityError> {
        let mut columns = Vec::with_capacity(18);
        // Columns at first, then where they stand.
        let mut rotations = Vec::with_capacity(2);
        let mut width = 0;
        let mut plain = true;
        for part in parts.clone() {
            let (start, count) = belief.columns(part).ok_or_else(|| match part {
                Part::Block(name) => ModalityError::MissingBlock(name.to_string()),
                _ => ModalityError::MissingState("the clone that the measurement refers to"),
            })?;
            plain &= *part != Part::AngularRate && !columns.contains(&start);
            match part {
                Part::Pose(_) => rotations.push(start + 3),
                Part::AngularRate => rotations.push(POSE + 3),
                Part::Velocity | Part::Block(_) => {}
            }
            columns.extend(start..start + count);
            width += count;
        }
        let to_parts = (!plain).then(|| {
            if parts.clone().any(|part| *part == Part::AngularRate) {
                columns.extend(POSE + 3..POSE + 6);
            }
            columns.sort_unstable();
            columns.dedup();
            rotations.sort_unstable();
            rotations.dedup();
            mixed_parts(parts, belief, state, &columns, width)
        });
        // Every one of them was put among the columns above.
        for rotation in &mut rotations {
            *rotation = columns.iter().position(|column| column == rotation).unwrap_or_default();
        }
        Ok(Self { columns, rotations, width, to_parts })
    }
}

/// Part columns (`width` rows) by filter columns (sorted).
fn mixed_parts<'a>(
    parts: impl Iterator<Item = &'a Part>,
    belief: &Belief,
    state: &NominalState,
    columns: &[usize],
    width: usize,
) -> DMatrix<f64> {
    let mut to_parts = DMatrix::zeros(width, columns.len());
    // Every column looked for here was put there by the caller.
    let place = |column: usize| columns.binary_search(&column).unwrap_or(0);
    let mut row = 0;
    for part in parts {
        let Some((start, count)) = belief.columns(part) else { continue };
        if *part == Part::AngularRate {
            let (by_angle, by_rate) = Belief::rate_by_columns(state);
            to_parts.fixed_view_mut::<3, 3>(row, place(POSE + 3)).copy_from(&by_angle);
            to_parts.fixed_view_mut::<3, 3>(row, place(RATE)).copy_from(&by_rate);
        } else {
            (0..count).for_each(|i| to_parts[(row + i, place(start + i))] = 1.0);
        }
        row += count;
    }
    to_parts
}

fn compress_residual(
    residual: &DVector<f64>,
    jacobian: &[(Part, DMatrix<f64>)],
    noise: &Noise,
    belief: &Belief,
    state: &NominalState,
) -> Result<Compressed, ModalityError> {
    let touched = Touched::by(jacobian.iter().map(|(part, _)| part), belief, state)?;
    let (m, asked) = (residual.len(), touched.width);
    let mut whitened = DMatrix::zeros(m, asked + 1);
    let mut column = 0;
    for (_, matrix) in jacobian {
        if matrix.nrows() != m || column + matrix.ncols() > asked {
            return Err(ModalityError::Undefined("a Jacobian's shape disagrees with its residual".into()));
        }
        whitened.columns_mut(column, matrix.ncols()).copy_from(matrix);
        column += matrix.ncols();
    }
    if column != asked {
        return Err(ModalityError::Undefined("a Jacobian's columns disagree with its part".into()));
    }
    whitened.column_mut(asked).copy_from(residual);
    let noise_log_determinant = whiten(&mut whitened, noise)?;
    let c = touched.columns.len();
    if let Some(to_parts) = &touched.to_parts {
        let mut product = DMatrix::zeros(m, c + 1);
        product.columns_mut(0, c).copy_from(&(whitened.columns(0, asked) * to_parts));
        product.set_column(c, &whitened.column(asked));
        whitened = product;
    }
    let mut information = DMatrix::zeros(c, c);
    let mut gradient = DVector::zeros(c);
    let column = |i: usize| &whitened.as_slice()[i * m..(i + 1) * m];
    let residual = column(c);
    for i in 0..c {
        let left = column(i);
        for j in i..c {
            information[(j, i)] = dot(left, column(j));
        }
        gradient[i] = dot(left, residual);
    }
    mirror_lower(&mut information);
    let evidence = Evidence::Residual { whitened, noise_log_determinant };
    let Touched { columns, rotations, .. } = touched;
    Ok(Compressed { columns, information, gradient, rotations, evidence })
}

/// Multiplies rows by `R^(-1/2)`; `ln det R`.
fn whiten(rows: &mut DMatrix<f64>, noise: &Noise) -> Result<f64, ModalityError> {
    match noise {
        Noise::Diagonal(variances) => whiten_diagonal(rows, variances.as_slice()),
        Noise::Full(full) if full.nrows() == rows.nrows() => whiten_block(rows, 0, full),
        Noise::Blocks(blocks) if blocks.iter().map(DMatrix::nrows).sum::<usize>() == rows.nrows() => {
            let (mut start, mut log_determinant) = (0, 0.0);
            for block in blocks {
                log_determinant += whiten_block(rows, start, block)?;
                start += block.nrows();
            }
            Ok(log_determinant)
        }
        _ => {
            Err(ModalityError::Undefined("a measurement's noise disagrees with its residual in size".into()))
        }
    }
}

fn whiten_diagonal(rows: &mut DMatrix<f64>, variances: &[f64]) -> Result<f64, ModalityError> {
    if variances.len() != rows.nrows() || variances.iter().any(|v| v.is_nan() || *v <= 0.0) {
        return Err(noise_not_positive());
    }
    if variances.is_empty() {
        return Ok(0.0);
    }
    let weights: Vec<f64> = variances.iter().map(|v| 1.0 / v.sqrt()).collect();
    for column in rows.as_mut_slice().chunks_exact_mut(variances.len()) {
        column.iter_mut().zip(&weights).for_each(|(value, weight)| *value *= weight);
    }
    Ok(log_of_product(variances.iter().copied()))
}

/// Sum of logarithms, four factors per logarithm: variances of any unit (1e-30 for a flux in tesla squared) stay in range.
pub(crate) fn log_of_product(mut factors: impl Iterator<Item = f64>) -> f64 {
    let mut sum = 0.0;
    while let Some(first) = factors.next() {
        sum += factors.by_ref().take(3).fold(first, |product, factor| product * factor).ln();
    }
    sum
}

fn whiten_block(rows: &mut DMatrix<f64>, start: usize, block: &DMatrix<f64>) -> Result<f64, ModalityError> {
    let factor = block.clone().cholesky().ok_or_else(noise_not_positive)?;
    let mut part = rows.rows_mut(start, block.nrows());
    if factor.l_dirty().solve_lower_triangular_mut(&mut part) {
        Ok(2.0 * log_of_product(factor.l_dirty().diagonal().iter().copied()))
    } else {
        Err(noise_not_positive())
    }
}

fn noise_not_positive() -> ModalityError {
    ModalityError::Undefined("a measurement's noise is not positive definite".into())
}
