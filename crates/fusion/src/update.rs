//! One measurement update, whatever the form of the measurement.
//!
//! A measurement touches c of the n error columns. Residual form (r, H, R) and information form (b, A) alike reduce to
//!
//! ```text
//! A = Hᵀ R⁻¹ H  (c x c)        b = Hᵀ R⁻¹ r  (c)
//! ```
//!
//! With P the covariance, P_cc its block of those columns, P_cc = C Cᵀ, X = P_:c C⁻ᵀ and M = I + Cᵀ A C = L Lᵀ (symmetric,
//! no eigenvalue below 1, so well conditioned whatever A and P are), Y = X L⁻ᵀ, y = L⁻¹ Cᵀ b:
//!
//! ```text
//! δ  = Y y
//! P⁺ = (P - X Xᵀ) + Y Yᵀ
//! ```
//!
//! The first bracket is the covariance of the rest given the touched columns, the second what the measurement leaves:
//! both positive semidefinite by construction, which is what the Joseph form is for, at a cost that depends on c and not
//! on the number of readings.
//!
//! Normalised innovation squared, residual form: `rᵀ S⁻¹ r = |R^(-1/2) (r - H C u)|² + |u|²` with `u = M⁻¹ Cᵀ b`: a sum of
//! squares, where the difference `rᵀR⁻¹r - yᵀy` would lose its digits to a vague prior. As many degrees of freedom as
//! readings. Information form: the squared distance of the peak of the likelihood from the prediction, with the rank of A;
//! of an iterated model by its last linearization, as far from the peak a mixture's curvature says nothing of its width.
//!
//! Log-likelihood of the measurement given all before it, residual form: `-½ (rᵀS⁻¹r + ln det R + ln det M + m ln 2π)`;
//! information form: `ℓ + ½ yᵀy - ½ ln det M` (Laplace), up to a constant of the measurement.
//!
//! A strongly nonlinear model is re-linearised (Gauss-Newton on the posterior: Bell and Cathey 1993): with e the error from
//! the predicted to the current state, derivatives by the current state's error are turned into derivatives by e (rotation
//! columns times the Jacobian G of the correction, see [`crate::belief`]), and b is replaced by b + A e. Steps that lead uphill
//! are halved. The fixed point is the posterior's mode.

use crate::belief::{Belief, POSE, RATE, correction_jacobian};
use crate::dense::{
    add_outer_lower, cholesky_semidefinite, congruence, mirror_lower, solve_right_transposed,
};
use lumenav_core::{Linearization, Measurement, ModalityError, Noise, NominalState, Part};
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
    /// Where in `columns` the three rotation columns of a pose begin.
    rotations: Vec<usize>,
    evidence: Evidence,
}

/// What of a measurement does not go into information and gradient.
#[derive(Clone, Debug)]
enum Evidence {
    /// Residual form: `R^(-1/2) [H r]` and `ln det R`.
    Residual { whitened: DMatrix<f64>, noise_log_determinant: f64 },
    /// Information form: `ℓ` at the state of the linearization.
    Information { log_likelihood: f64 },
}

/// What an update did, before it is accepted.
#[derive(Clone, Debug)]
pub struct Innovation {
    /// Normalised innovation squared.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: f64,
    /// Natural logarithm of the measurement's probability density given all before it; information form: up to a constant of
    /// the measurement.
    pub log_likelihood: f64,
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
        let mut turning = Vec::with_capacity(2);
        let mut width = 0;
        let mut plain = true;
        for part in parts.clone() {
            let (start, count) = belief.columns(part).ok_or_else(|| match part {
                Part::Block(name) => ModalityError::MissingBlock(name.to_string()),
                _ => ModalityError::MissingState("the clone that the measurement refers to"),
            })?;
            plain &= *part != Part::AngularRate && !columns.contains(&start);
            match part {
                Part::Pose(_) => turning.push(start + 3),
                Part::AngularRate => turning.push(POSE + 3),
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
            turning.sort_unstable();
            turning.dedup();
            mixed_parts(parts, belief, state, &columns, width)
        });
        // Every turning column was put among the columns above.
        let rotations = turning.iter().filter_map(|first| columns.iter().position(|c| c == first)).collect();
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
    whitened.set_column(asked, residual);
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
    for i in 0..c {
        let left = whitened.column(i);
        for j in i..c {
            let value = left.dot(&whitened.column(j));
            information[(i, j)] = value;
            information[(j, i)] = value;
        }
        gradient[i] = left.dot(&whitened.column(c));
    }
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
fn log_of_product(mut factors: impl Iterator<Item = f64>) -> f64 {
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

/// The part of an update that depends on the belief and the touched columns alone.
struct Gain {
    /// C of `P_cc = C Cᵀ`.
    root: DMatrix<f64>,
    /// X = P_:c C⁻ᵀ.
    spread: DMatrix<f64>,
}

impl Gain {
    fn new(belief: &Belief, columns: &[usize]) -> Result<Self, ModalityError> {
        let mut spread = belief.covariance.select_columns(columns);
        let root = cholesky_semidefinite(spread.select_rows(columns)).ok_or_else(|| {
            ModalityError::Undefined("the belief's covariance lost its definiteness".into())
        })?;
        solve_right_transposed(&mut spread, &root);
        Ok(Self { root, spread })
    }

    /// `(C⁻¹ e)ᵀ` on the touched columns: an error in standard deviations of the prior.
    fn standardised(&self, error: &DVector<f64>, columns: &[usize]) -> DMatrix<f64> {
        let mut touched = DMatrix::from_iterator(1, columns.len(), columns.iter().map(|c| error[*c]));
        solve_right_transposed(&mut touched, &self.root);
        touched
    }

    /// L of `M = I + Cᵀ A C = L Lᵀ`, and what follows from it.
    fn solve(&self, information: &DMatrix<f64>, gradient: &DVector<f64>) -> Result<Solution, ModalityError> {
        let mut m = congruence(information, &self.root);
        (0..m.nrows()).for_each(|i| m[(i, i)] += 1.0);
        // Every pivot of I + (semidefinite) is at least 1, but for rounding.
        let factor = cholesky_semidefinite(m)
            .filter(|factor| factor.diagonal().iter().all(|pivot| *pivot > 0.5))
            .ok_or_else(|| {
                ModalityError::Undefined("a measurement's information is not semidefinite".into())
            })?;
        let mut weight = self.root.tr_mul(gradient);
        // The pivots are positive by the line above, so this solve succeeds.
        factor.solve_lower_triangular_mut(&mut weight);
        let mut spread = self.spread.clone();
        solve_right_transposed(&mut spread, &factor);
        let error = &spread * &weight;
        Ok(Solution { factor, weight, spread, error })
    }
}

/// One linearization's update.
struct Solution {
    /// L.
    factor: DMatrix<f64>,
    /// y = L⁻¹ Cᵀ b.
    weight: DVector<f64>,
    /// Y = X L⁻ᵀ.
    spread: DMatrix<f64>,
    /// δ.
    error: DVector<f64>,
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
    let compressed = compress(&first, belief, &belief.state)?;
    let gain = Gain::new(belief, &compressed.columns)?;
    let mut solution = gain.solve(&compressed.information, &compressed.gradient)?;
    let mut innovation = innovation_of(&compressed, &gain, &solution);
    if measurement.model.strongly_nonlinear() {
        let last = iterate(belief, measurement, &compressed, &gain, &mut solution, max_iterations)?;
        if let Some(last) = last.filter(|last| matches!(last.evidence, Evidence::Information { .. })) {
            innovation = innovation_of(&last, &gain, &solution);
        }
    }
    let covariance = posterior(belief, &compressed.columns, &gain, &solution);
    Ok(Proposal { innovation, first, error: solution.error, covariance })
}

/// Gauss-Newton from the first solution on; steps that lead uphill are halved. The last linearization that was solved.
fn iterate(
    belief: &Belief,
    measurement: &Measurement,
    first: &Compressed,
    gain: &Gain,
    solution: &mut Solution,
    max_iterations: u32,
) -> Result<Option<Compressed>, ModalityError> {
    let mut accepted = DVector::zeros(belief.dimension());
    let mut accepted_cost = first.misfit();
    let mut last = None;
    for _ in 1..max_iterations {
        let moved = belief.moved_state(&solution.error);
        let mut again = compress(&measurement.model.linearize(measurement, &moved)?, belief, &moved)?;
        if again.columns != first.columns {
            return Err(ModalityError::Undefined("a model changed its parts between iterations".into()));
        }
        let start = gain.standardised(&solution.error, &again.columns);
        let cost = again.misfit() + 0.5 * start.norm_squared();
        // Differences below a billionth are rounding.
        if cost.is_nan() || cost > accepted_cost + 1e-9 * (1.0 + accepted_cost.abs()) {
            solution.error = (&accepted + &solution.error) * 0.5;
            continue;
        }
        again.seen_from_prior(&solution.error);
        let next = gain.solve(&again.information, &again.gradient)?;
        let step = gain.standardised(&(&next.error - &solution.error), &again.columns);
        // In posterior standard deviations: |Lᵀ C⁻¹ step|.
        let change = next.factor.tr_mul(&step.transpose()).norm();
        accepted = std::mem::replace(solution, next).error;
        accepted_cost = cost;
        last = Some(again);
        // A hundredth of a standard deviation: below what the next reading can tell.
        if change < 1e-2 {
            break;
        }
    }
    Ok(last)
}

impl Compressed {
    /// Minus the log-likelihood at the state of the linearization, up to a constant of the measurement.
    fn misfit(&self) -> f64 {
        match &self.evidence {
            Evidence::Residual { whitened, .. } => 0.5 * whitened.column(self.columns.len()).norm_squared(),
            Evidence::Information { log_likelihood } => -log_likelihood,
        }
    }

    /// Turns a linearization at the state moved by `error` into one by the error itself: `b + A e` on the columns of e.
    fn seen_from_prior(&mut self, error: &DVector<f64>) {
        for at in &self.rotations {
            let jacobian = correction_jacobian(error, self.columns[*at]);
            let rows = jacobian.transpose() * self.information.fixed_rows::<3>(*at);
            self.information.fixed_rows_mut::<3>(*at).copy_from(&rows);
            let columns = self.information.fixed_columns::<3>(*at) * jacobian;
            self.information.fixed_columns_mut::<3>(*at).copy_from(&columns);
            let gradient = jacobian.transpose() * self.gradient.fixed_rows::<3>(*at);
            self.gradient.fixed_rows_mut::<3>(*at).copy_from(&gradient);
        }
        let touched = DVector::from_iterator(self.columns.len(), self.columns.iter().map(|c| error[*c]));
        let curvature = &self.information * &touched;
        if let Evidence::Information { log_likelihood } = &mut self.evidence {
            // The parabola through the current state, at e = 0.
            *log_likelihood -= self.gradient.dot(&touched) + 0.5 * curvature.dot(&touched);
        }
        self.gradient += curvature;
    }
}

impl Proposal {
    /// Whether every number of the update is finite and no variance negative.
    pub fn is_sound(&self) -> bool {
        self.error.iter().all(|v| v.is_finite())
            && self.covariance.iter().all(|v| v.is_finite())
            && self.covariance.diagonal().iter().all(|v| *v >= 0.0)
    }

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

fn innovation_of(compressed: &Compressed, gain: &Gain, solution: &Solution) -> Innovation {
    let log_determinant = 2.0 * log_of_product(solution.factor.diagonal().iter().copied());
    match &compressed.evidence {
        Evidence::Residual { whitened, noise_log_determinant } => {
            let (m, c) = (whitened.nrows(), compressed.columns.len());
            // u = L⁻ᵀ y; the pivots of L are positive, so this solve succeeds.
            let mut start = solution.weight.clone();
            solution.factor.tr_solve_lower_triangular_mut(&mut start);
            let explained = &gain.root * &start;
            let mut left = whitened.column(c).into_owned();
            left.gemv(-1.0, &whitened.columns(0, c), &explained, 1.0);
            let chi_square = left.norm_squared() + start.norm_squared();
            let normalisation = noise_log_determinant + m as f64 * std::f64::consts::TAU.ln();
            Innovation {
                chi_square,
                degrees_of_freedom: m as f64,
                log_likelihood: -0.5 * (chi_square + log_determinant + normalisation),
            }
        }
        Evidence::Information { log_likelihood } => {
            // In the basis where Cᵀ A C = diag(λ): Σ b'²/(λ(1 + λ)) over the directions that A speaks about.
            let projected = gain.root.tr_mul(&compressed.gradient);
            let eigen = congruence(&compressed.information, &gain.root).symmetric_eigen();
            let largest = eigen.eigenvalues.max().max(0.0);
            let (mut chi_square, mut rank) = (0.0, 0.0);
            for (i, lambda) in eigen.eigenvalues.iter().enumerate() {
                if *lambda > 1e-12 * largest {
                    let along = eigen.eigenvectors.column(i).dot(&projected);
                    chi_square += along * along / (lambda * (1.0 + lambda));
                    rank += 1.0;
                }
            }
            Innovation {
                chi_square,
                degrees_of_freedom: rank,
                log_likelihood: log_likelihood + 0.5 * (solution.weight.norm_squared() - log_determinant),
            }
        }
    }
}

/// `P⁺ = (P - X Xᵀ) + Y Yᵀ`, the bracket exactly zero on the touched columns.
fn posterior(belief: &Belief, columns: &[usize], gain: &Gain, solution: &Solution) -> DMatrix<f64> {
    let mut covariance = belief.covariance.clone();
    add_outer_lower(&mut covariance, &gain.spread, -1.0);
    for column in columns {
        covariance.column_mut(*column).fill(0.0);
        covariance.row_mut(*column).fill(0.0);
    }
    add_outer_lower(&mut covariance, &solution.spread, 1.0);
    mirror_lower(&mut covariance);
    covariance
}
