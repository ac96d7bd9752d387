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
//! readings. Information form: the squared distance of the peak of the likelihood from the prediction, with the rank of A.
//! Of an iterated model by its last linearization, seen from the prediction (r + H e): far from the peak a mixture's curvature says nothing of
//! its width, and a prediction that is vague over a curved model would be refused for the curve.
//!
//! Log-likelihood of the measurement given all before it, residual form: `-½ (rᵀS⁻¹r + ln det R + ln det M + m ln 2π)`;
//! information form: `ℓ + ½ yᵀy - ½ ln det M` (Laplace), up to a constant of the measurement.
//!
//! A strongly nonlinear model is re-linearised (Gauss-Newton on the posterior: Bell and Cathey 1993): with e the error from
//! the predicted to the current state, derivatives by the current state's error are turned into derivatives by e (rotation
//! columns times the Jacobian G of the correction, see [`crate::belief`]), and b is replaced by b + A e. Steps that lead uphill
//! are halved. The fixed point is the posterior's mode. What is applied was seen to lead downhill, but for a last step below a
//! hundredth of a standard deviation; where no step does, the covariance of the first linearization has nothing to do with
//! the posterior and the update fails.

use crate::belief::Belief;
use crate::compress::{Compressed, Evidence, compress, log_of_product};
use crate::dense::{
    add_multiple, add_outer_lower, cholesky_semidefinite, clear, columns_of, congruence, lower_times,
    mirror_lower, rows_of, solve_lower, solve_lower_transposed, solve_right_transposed, symmetrise, times,
    transposed_times,
};
use lumenav_core::{Linearization, Measurement, ModalityError, Noise};
use nalgebra::{DMatrix, DVector};

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

/// The part of an update that depends on the belief and the touched columns alone.
struct Gain {
    /// C of `P_cc = C Cᵀ`.
    root: DMatrix<f64>,
    /// X = P_:c C⁻ᵀ.
    spread: DMatrix<f64>,
}

impl Gain {
    fn new(belief: &Belief, columns: &[usize]) -> Result<Self, ModalityError> {
        let mut spread = columns_of(&belief.covariance, columns);
        let root = cholesky_semidefinite(rows_of(&spread, columns)).ok_or_else(|| {
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
        let mut weight = transposed_times(&self.root, gradient);
        // The pivots are positive by the lines above.
        solve_lower(&factor, &mut weight);
        let mut spread = self.spread.clone();
        solve_right_transposed(&mut spread, &factor);
        let error = times(&spread, &weight);
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
    if measurement.model.strongly_nonlinear() && max_iterations > 1 {
        let task = Iteration { belief, measurement, first: &compressed, gain: &gain };
        let last = task.run(&mut solution, max_iterations)?;
        innovation = innovation_of(&last, &gain, &solution);
    }
    let covariance = posterior(belief, &compressed.columns, &gain, &solution);
    Ok(Proposal { innovation, first, error: solution.error, covariance })
}

/// How often a step is halved before its direction counts as leading uphill: a thousandth of it is left.
const MAX_HALVINGS: u32 = 10;

/// Gauss-Newton on the posterior of one measurement.
struct Iteration<'a> {
    belief: &'a Belief,
    measurement: &'a Measurement,
    /// The linearization at the prediction.
    first: &'a Compressed,
    gain: &'a Gain,
}

impl Iteration<'_> {
    /// From the first solution on; the last linearization that was solved. `solution` ends at an error that was seen to lead
    /// downhill (or is a hundredth of a standard deviation from one), with the covariance of the linearization there.
    fn run(&self, solution: &mut Solution, max_iterations: u32) -> Result<Compressed, ModalityError> {
        let mut accepted = DVector::zeros(self.belief.dimension());
        let mut cost = self.first.misfit();
        let mut last = None;
        for _ in 1..max_iterations {
            let Some((mut again, lower)) = self.downhill(&accepted, &mut solution.error, cost)? else {
                solution.error = accepted;
                return last.ok_or_else(uphill);
            };
            again.seen_from_prior(&solution.error);
            let next = self.gain.solve(&again.information, &again.gradient)?;
            let step = self.gain.standardised(&(&next.error - &solution.error), &again.columns);
            // In posterior standard deviations: |Lᵀ C⁻¹ step|.
            let change = next.factor.tr_mul(&step.transpose()).norm();
            accepted = std::mem::replace(solution, next).error;
            cost = lower;
            last = Some(again);
            // A hundredth of a standard deviation: below what the next reading can tell.
            if change < 1e-2 {
                return last.ok_or_else(uphill);
            }
        }
        // Not converged: the last step counts as far as it leads downhill.
        if self.downhill(&accepted, &mut solution.error, cost)?.is_none() {
            solution.error = accepted;
        }
        last.ok_or_else(uphill)
    }

    /// Halves the way from `accepted` to `error` until it leads downhill: the linearization there and its cost.
    fn downhill(
        &self,
        accepted: &DVector<f64>,
        error: &mut DVector<f64>,
        accepted_cost: f64,
    ) -> Result<Option<(Compressed, f64)>, ModalityError> {
        for _ in 0..=MAX_HALVINGS {
            let moved = self.belief.moved_state(error);
            let linearization = self.measurement.model.linearize(self.measurement, &moved)?;
            let again = compress(&linearization, self.belief, &moved)?;
            if again.columns != self.first.columns {
                return Err(ModalityError::Undefined("a model changed its parts between iterations".into()));
            }
            let cost = again.misfit() + 0.5 * self.gain.standardised(error, &again.columns).norm_squared();
            // Differences below a billionth are rounding.
            if cost <= accepted_cost + 1e-9 * (1.0 + accepted_cost.abs()) {
                return Ok(Some((again, cost)));
            }
            *error = (accepted + &*error) * 0.5;
        }
        Ok(None)
    }
}

fn uphill() -> ModalityError {
    ModalityError::Undefined("no step of the iterated update leads downhill".into())
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
        symmetrise(&mut belief.covariance);
    }
}

fn innovation_of(compressed: &Compressed, gain: &Gain, solution: &Solution) -> Innovation {
    let log_determinant = 2.0 * log_of_product(solution.factor.diagonal().iter().copied());
    match &compressed.evidence {
        Evidence::Residual { whitened, noise_log_determinant } => {
            let (m, c) = (whitened.nrows(), compressed.columns.len());
            // u = L⁻ᵀ y, then C u; the pivots of L are positive.
            let mut explained = solution.weight.clone();
            solve_lower_transposed(&solution.factor, &mut explained);
            let of_state = explained.norm_squared();
            lower_times(&gain.root, &mut explained);
            let mut left = whitened.column(c).into_owned();
            for (column, factor) in whitened.as_slice().chunks_exact(m.max(1)).zip(explained.iter()) {
                add_multiple(left.as_mut_slice(), column, -factor);
            }
            let chi_square = left.norm_squared() + of_state;
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
    // The pose stands before the rest: what is cleared next need not be worked out.
    let first = (0..covariance.ncols()).find(|column| !columns.contains(column)).unwrap_or(0);
    add_outer_lower(&mut covariance, &gain.spread, -1.0, first);
    clear(&mut covariance, columns);
    add_outer_lower(&mut covariance, &solution.spread, 1.0, 0);
    mirror_lower(&mut covariance);
    covariance
}
