//! One measurement update, whatever the form of the measurement.
//!
//! A measurement touches c of the n error columns. Residual form (r, H, R) and information form (b, A) alike reduce to
//!
//! ```text
//! A = Hᵀ R⁻¹ H  (c x c)        b = Hᵀ R⁻¹ r  (c)
//! ```
//!
//! With P the covariance, P_cc its block of those columns, P_cc = C Cᵀ, W = C⁻¹ P_c: and M = I + Cᵀ A C (symmetric, no
//! eigenvalue below 1, so well conditioned whatever A and P are):
//!
//! ```text
//! δ  = Wᵀ M⁻¹ Cᵀ b
//! P⁺ = (P - Wᵀ W) + Wᵀ M⁻¹ W
//! ```
//!
//! The first bracket is the covariance of the rest given the touched columns, the second what the measurement leaves:
//! both positive semidefinite by construction, which is what the Joseph form is for, at a cost that depends on c and not
//! on the number of readings.
//!
//! Normalised innovation squared: residual form `rᵀ S⁻¹ r = rᵀR⁻¹r - bᵀ C M⁻¹ Cᵀ b` with as many degrees of freedom as
//! readings; information form the squared distance of the peak of the likelihood from the prediction, with the rank of A.
//!
//! A strongly nonlinear model is re-linearised (Gauss-Newton on the posterior: Bell and Cathey 1993): with e the error from
//! the predicted to the current state, b is replaced by b + A e.

use crate::belief::{Belief, POSE, RATE};
use lumenav_core::{Linearization, Measurement, ModalityError, Noise, Part};
use nalgebra::{DMatrix, DVector};

/// A linearised measurement reduced to the columns it touches.
#[derive(Clone, Debug)]
pub struct Compressed {
    /// Touched columns of the error state.
    pub columns: Vec<usize>,
    /// `Hᵀ R⁻¹ H`.
    pub information: DMatrix<f64>,
    /// `Hᵀ R⁻¹ r`.
    pub gradient: DVector<f64>,
    /// `rᵀ R⁻¹ r` and the number of readings; `None` in information form.
    pub residual_square: Option<(f64, usize)>,
}

/// What an update did, before it is accepted.
#[derive(Clone, Debug)]
pub struct Innovation {
    /// Normalised innovation squared.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: f64,
}

/// Largest standardised residuals: which channels speak loudest against the prediction.
pub fn worst_channels(linearization: &Linearization, count: usize) -> Vec<(usize, f64)> {
    let Linearization::Residual { residual, noise: Noise::Diagonal(variances), .. } = linearization else {
        return Vec::new();
    };
    let mut all: Vec<(usize, f64)> =
        residual.iter().zip(variances.iter()).map(|(r, v)| r / v.sqrt()).enumerate().collect();
    all.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    all.truncate(count);
    all
}

/// Reduces a linearization to the belief's columns.
///
/// # Errors
/// [`ModalityError`] where the belief does not hold a part, shapes disagree, or a noise is not positive definite.
pub fn compress(linearization: &Linearization, belief: &Belief) -> Result<Compressed, ModalityError> {
    match linearization {
        Linearization::Residual { residual, jacobian, noise } => {
            compress_residual(residual, jacobian, noise, belief)
        }
        Linearization::Information { parts, gradient, information, .. } => {
            let touched = Touched::by(parts.iter(), belief)?;
            let asked = touched.to_parts.nrows();
            if asked != gradient.len() || information.shape() != (asked, asked) {
                return Err(ModalityError::Undefined("information, gradient and parts disagree in size".into()));
            }
            Ok(Compressed {
                information: touched.to_parts.tr_mul(&(information * &touched.to_parts)),
                gradient: touched.to_parts.tr_mul(gradient),
                columns: touched.columns,
                residual_square: None,
            })
        }
    }
}

/// The filter's columns that a list of parts touches, and how the parts' errors follow from them.
struct Touched {
    columns: Vec<usize>,
    /// Part columns by filter columns: the identity, but for the angular rate (see [`crate::belief`]).
    to_parts: DMatrix<f64>,
    /// Whether it is the identity, so that the product can be left out.
    plain: bool,
}

impl Touched {
    fn by<'a>(parts: impl Iterator<Item = &'a Part> + Clone, belief: &Belief) -> Result<Self, ModalityError> {
        let mut columns = Vec::with_capacity(12);
        let mut width = 0;
        let mut plain = true;
        for part in parts.clone() {
            let (start, count) = belief.columns(part).ok_or_else(|| match part {
                Part::Block(name) => ModalityError::MissingBlock(name.to_string()),
                _ => ModalityError::MissingState("the clone that the measurement refers to"),
            })?;
            plain &= *part != Part::AngularRate && !columns.contains(&start);
            columns.extend(start..start + count);
            width += count;
        }
        if plain {
            return Ok(Self { columns, to_parts: DMatrix::identity(width, width), plain });
        }
        if parts.clone().any(|part| *part == Part::AngularRate) {
            columns.extend(POSE + 3..POSE + 6);
        }
        columns.sort_unstable();
        columns.dedup();
        let mut to_parts = DMatrix::zeros(width, columns.len());
        let place = |column: usize| columns.binary_search(&column).unwrap_or(0);
        let mut row = 0;
        for part in parts {
            // Found above.
            let Some((start, count)) = belief.columns(part) else { continue };
            if *part == Part::AngularRate {
                let (by_angle, by_rate) = belief.rate_by_columns();
                to_parts.fixed_view_mut::<3, 3>(row, place(POSE + 3)).copy_from(&by_angle);
                to_parts.fixed_view_mut::<3, 3>(row, place(RATE)).copy_from(&by_rate);
            } else {
                (0..count).for_each(|i| to_parts[(row + i, place(start + i))] = 1.0);
            }
            row += count;
        }
        Ok(Self { columns, to_parts, plain })
    }
}

fn compress_residual(
    residual: &DVector<f64>,
    jacobian: &[(Part, DMatrix<f64>)],
    noise: &Noise,
    belief: &Belief,
) -> Result<Compressed, ModalityError> {
    let touched = Touched::by(jacobian.iter().map(|(part, _)| part), belief)?;
    let (m, asked) = (residual.len(), touched.to_parts.nrows());
    let mut by_parts = DMatrix::zeros(m, asked + 1);
    let mut column = 0;
    for (_, matrix) in jacobian {
        if matrix.nrows() != m || column + matrix.ncols() > asked {
            return Err(ModalityError::Undefined("a Jacobian's shape disagrees with its residual".into()));
        }
        by_parts.columns_mut(column, matrix.ncols()).copy_from(matrix);
        column += matrix.ncols();
    }
    if column != asked {
        return Err(ModalityError::Undefined("a Jacobian's columns disagree with its part".into()));
    }
    by_parts.set_column(asked, residual);
    whiten(&mut by_parts, noise)?;
    let c = touched.columns.len();
    let whitened = if touched.plain {
        by_parts
    } else {
        let mut product = DMatrix::zeros(m, c + 1);
        product.columns_mut(0, c).copy_from(&(by_parts.columns(0, asked) * &touched.to_parts));
        product.set_column(c, &by_parts.column(asked));
        product
    };
    let mut information = DMatrix::zeros(c, c);
    let mut gradient = DVector::zeros(c);
    for i in 0..c {
        let left = whitened.column(i);
        for j in i..c {
            let value = left.dot(&whitened.column(j));
            information[(i, j)] = value;
            information[(j, i)] = value;
        }
        gradient[i] = left.dot(&whitened.column(c));
    }
    let residual_square = Some((whitened.column(c).norm_squared(), m));
    Ok(Compressed { columns: touched.columns, information, gradient, residual_square })
}

/// Multiplies rows by `R^(-1/2)`.
fn whiten(rows: &mut DMatrix<f64>, noise: &Noise) -> Result<(), ModalityError> {
    match noise {
        Noise::Diagonal(variances) => {
            if variances.len() != rows.nrows() || variances.iter().any(|v| v.is_nan() || *v <= 0.0) {
                return Err(noise_not_positive());
            }
            for (mut row, variance) in rows.row_iter_mut().zip(variances.iter()) {
                row /= variance.sqrt();
            }
            Ok(())
        }
        Noise::Full(full) if full.nrows() == rows.nrows() => whiten_block(rows, 0, full),
        Noise::Blocks(blocks) if blocks.iter().map(DMatrix::nrows).sum::<usize>() == rows.nrows() => {
            let mut start = 0;
            for block in blocks {
                whiten_block(rows, start, block)?;
                start += block.nrows();
            }
            Ok(())
        }
        _ => Err(ModalityError::Undefined("a measurement's noise disagrees with its residual in size".into())),
    }
}

fn whiten_block(rows: &mut DMatrix<f64>, start: usize, block: &DMatrix<f64>) -> Result<(), ModalityError> {
    let factor = block.clone().cholesky().ok_or_else(noise_not_positive)?;
    let mut part = rows.rows_mut(start, block.nrows());
    if factor.l_dirty().solve_lower_triangular_mut(&mut part) { Ok(()) } else { Err(noise_not_positive()) }
}

fn noise_not_positive() -> ModalityError {
    ModalityError::Undefined("a measurement's noise is not positive definite".into())
}

/// The gain of an update at one linearization: everything that does not depend on the gradient.
struct Gain {
    /// C of `P_cc = C Cᵀ`.
    root: DMatrix<f64>,
    /// W = C⁻¹ P_c:.
    spread: DMatrix<f64>,
}

impl Gain {
    fn new(belief: &Belief, columns: &[usize]) -> Result<Self, ModalityError> {
        let touched = belief.covariance.select_rows(columns);
        let block = touched.select_columns(columns);
        let root = block
            .cholesky()
            .ok_or_else(|| ModalityError::Undefined("the belief's covariance lost its definiteness".into()))?
            .unpack();
        let mut spread = touched;
        // The diagonal of a Cholesky factor is positive, so this solve succeeds.
        root.solve_lower_triangular_mut(&mut spread);
        Ok(Self { root, spread })
    }

    /// M = I + Cᵀ A C, factored.
    fn factor(&self, information: &DMatrix<f64>) -> Result<nalgebra::Cholesky<f64, nalgebra::Dyn>, ModalityError> {
        let mut m = self.root.tr_mul(&(information * &self.root));
        for i in 0..m.nrows() {
            m[(i, i)] += 1.0;
        }
        m.cholesky().ok_or_else(|| ModalityError::Undefined("a measurement's information is not semidefinite".into()))
    }
}

/// An update worked out but not yet applied.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// How well the prediction foretold the measurement.
    pub innovation: Innovation,
    /// The linearization at the prediction, for explanations.
    pub first: Linearization,
    error: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// Works out an update of `belief`, which must already stand at the measurement's time.
///
/// # Errors
/// [`ModalityError`] where the model cannot be evaluated or the algebra fails; the belief is untouched.
pub fn propose(
    belief: &Belief,
    measurement: &Measurement,
    max_iterations: u32,
) -> Result<Proposal, ModalityError> {
    let first = measurement.model.linearize(measurement, &belief.state)?;
    let compressed = compress(&first, belief)?;
    let gain = Gain::new(belief, &compressed.columns)?;
    let factor = gain.factor(&compressed.information)?;
    let innovation = innovation_of(&compressed, &gain, &factor);
    let mut last = compressed;
    let mut last_factor = factor;
    let mut error = gain.spread.tr_mul(&last_factor.solve(&gain.root.tr_mul(&last.gradient)));
    if measurement.model.strongly_nonlinear() {
        for _ in 1..max_iterations {
            let mut moved = belief.clone();
            moved.inject(&error);
            let again = compress(&measurement.model.linearize(measurement, &moved.state)?, belief)?;
            let from_prior = DVector::from_iterator(again.columns.len(), again.columns.iter().map(|c| error[*c]));
            let target = &again.gradient + &again.information * from_prior;
            let next_factor = gain.factor(&again.information)?;
            let next = gain.spread.tr_mul(&next_factor.solve(&gain.root.tr_mul(&target)));
            let change = change_in_sigmas(&(&next - &error), &again.columns, &gain, &next_factor);
            (error, last, last_factor) = (next, again, next_factor);
            // A hundredth of a standard deviation: below what the next reading can tell.
            if change < 1e-2 {
                break;
            }
        }
    }
    let covariance = posterior(belief, &last.columns, &gain, &last_factor);
    Ok(Proposal { innovation, first, error, covariance })
}

impl Proposal {
    /// Applies the update.
    pub fn apply(self, belief: &mut Belief) {
        belief.covariance = self.covariance;
        belief.inject(&self.error);
        // Rounding leaves P asymmetric by an ulp; the mean of both halves keeps it exactly symmetric.
        let n = belief.dimension();
        for i in 0..n {
            for j in 0..i {
                let mean = 0.5 * (belief.covariance[(i, j)] + belief.covariance[(j, i)]);
                belief.covariance[(i, j)] = mean;
                belief.covariance[(j, i)] = mean;
            }
        }
    }
}

/// Distance between two iterations in posterior standard deviations: `|Lᵀ C⁻¹ d|` with `M = L Lᵀ`, d on the touched columns.
fn change_in_sigmas(
    change: &DVector<f64>,
    columns: &[usize],
    gain: &Gain,
    factor: &nalgebra::Cholesky<f64, nalgebra::Dyn>,
) -> f64 {
    let mut touched = DVector::from_iterator(columns.len(), columns.iter().map(|c| change[*c]));
    // The diagonal of a Cholesky factor is positive, so this solve succeeds.
    gain.root.solve_lower_triangular_mut(&mut touched);
    factor.l_dirty().lower_triangle().tr_mul(&touched).norm()
}

fn innovation_of(
    compressed: &Compressed,
    gain: &Gain,
    factor: &nalgebra::Cholesky<f64, nalgebra::Dyn>,
) -> Innovation {
    let projected = gain.root.tr_mul(&compressed.gradient);
    match compressed.residual_square {
        Some((square, readings)) => Innovation {
            chi_square: square - projected.dot(&factor.solve(&projected)),
            degrees_of_freedom: readings as f64,
        },
        None => {
            // In the basis where Cᵀ A C = diag(λ): Σ b'²/(λ(1 + λ)) over the directions that A speaks about.
            let eigen = gain.root.tr_mul(&(&compressed.information * &gain.root)).symmetric_eigen();
            let largest = eigen.eigenvalues.max().max(0.0);
            let (mut chi_square, mut rank) = (0.0, 0.0);
            for (i, lambda) in eigen.eigenvalues.iter().enumerate() {
                if *lambda > 1e-12 * largest {
                    let along = eigen.eigenvectors.column(i).dot(&projected);
                    chi_square += along * along / (lambda * (1.0 + lambda));
                    rank += 1.0;
                }
            }
            Innovation { chi_square, degrees_of_freedom: rank }
        }
    }
}

/// `P⁺ = (P - WᵀW) + Wᵀ M⁻¹ W`, the bracket exactly zero on the touched columns.
fn posterior(
    belief: &Belief,
    columns: &[usize],
    gain: &Gain,
    factor: &nalgebra::Cholesky<f64, nalgebra::Dyn>,
) -> DMatrix<f64> {
    let mut given = belief.covariance.clone();
    given.gemm_tr(-1.0, &gain.spread, &gain.spread, 1.0);
    for column in columns {
        given.column_mut(*column).fill(0.0);
        given.row_mut(*column).fill(0.0);
    }
    let mut left = gain.spread.clone();
    // The factor's diagonal is at least 1, so this solve succeeds.
    factor.l_dirty().solve_lower_triangular_mut(&mut left);
    given.gemm_tr(1.0, &left, &left, 1.0);
    given
}
