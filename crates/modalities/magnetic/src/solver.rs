//! Maximum likelihood of a magnet's pose from one reading: Levenberg-Marquardt on R³ x S².
//!
//! Minimises `χ² = Σ_k (z_k - h_k)²/σ_k²` over position p and axis u (unit). The axis moves in its tangent plane,
//! `u ← (u + t₁e₁ + t₂e₂)/|…|`, so no pose is singular. Five normal equations per step with Marquardt's scaling (the diagonal
//! of JᵀJ), which makes metres and radians comparable; damping as in Nielsen (1999), with a stronger fall after good steps.
//!
//! From two opposite starts the right pose is reached from every pose of the reference workspace (`moussakhani2012`'s array;
//! 2,000 random poses, see the tests): the axis of a dipole is the one thing a poor start gets wrong.
//!
//! A strength s or an ambient field b that nobody knows enters linearly, `z = s h(p, u) + A b` with the channels' axes as rows of A, and is
//! solved for at every pose (variable projection; Kaufman 1975): with N = [h, A] the columns of what is unknown and W the weights,
//!
//! ```text
//! c = (NᵀWN)⁻¹ NᵀWz        r = z - N c        gradient = s JᵀW r        matrix = s² (JᵀWJ - JᵀWN (NᵀWN)⁻¹ NᵀWJ)
//! ```
//!
//! which is the pose's own Fisher information with the unknown ones beside it. A negative strength is the opposite axis. What is known
//! of them beforehand, `c ~ N([1, 0], Λ⁻¹)`, adds Λ to NᵀWN, its mean times Λ to NᵀWz and its own square to χ²; Λ = 0 leaves differences
//! between channels alone. Directions of b that no channel reads along tell nothing and take nothing: a generalised inverse
//! ([`lumenav_core::linear`]) takes the place of the inverse.
//!
//! Some arrays see two poses that fit equally (single-axis sensors in one plane: the pose and its mirror image; very few
//! channels): [`solve_from_all`] hands the second out as a rival, so that nobody takes a coin's toss for a fix.

use crate::channels::{Channels, MagnetPose, Prediction};
use lumenav_core::linear::generalised_inverse;
use lumenav_core::pose::tangent_basis;
use lumenav_fields::FieldSource;
use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, Vector3};

/// A matrix of the five degrees of freedom.
pub type Matrix5 = SMatrix<f64, 5, 5>;
type Vector5 = SVector<f64, 5>;

/// Degrees of freedom of a magnet's pose.
pub const FREEDOM: usize = 5;
/// The search ends where an undamped step would lower χ² by less than this: a thousandth of a standard deviation.
const CHI_SQUARE_TOLERANCE: f64 = 1e-6;
/// The same as a share of χ²: below it rounding decides.
const CHI_SQUARE_RELATIVE: f64 = 1e-12;
/// Steps before giving up; a good start needs four, a poor one twenty.
const MAX_STEPS: u32 = 100;
/// Damping at the start, as a share of the diagonal.
const FIRST_DAMPING: f64 = 1e-3;
/// A good step divides the damping by ten at most, so that the last steps are nearly Gauss and Newton's.
const MIN_DAMPING_FACTOR: f64 = 0.1;
/// A second pose within this of the best χ² (five standard deviations of one residual) explains the reading as well.
const RIVAL_CHI_SQUARE: f64 = 25.0;

/// What is unknown beside the pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unknown {
    /// The magnet's strength.
    pub strength: bool,
    /// A uniform field beside the magnet's.
    pub ambient: bool,
}

impl Unknown {
    /// How many numbers that are.
    pub fn count(self) -> usize {
        usize::from(self.strength) + 3 * usize::from(self.ambient)
    }

    /// Degrees of freedom with those of the pose.
    pub fn freedom(self) -> usize {
        FREEDOM + self.count()
    }
}

/// What is known before a reading of what is unknown: strength `N(1, 1/information)`, ambient field `N(0, information⁻¹)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearPrior {
    /// Inverse variance of the strength; 0 where nothing is known.
    pub strength: f64,
    /// Inverse covariance of the ambient field, 1/T²; zeros where nothing is known.
    pub ambient: Matrix3<f64>,
}

impl LinearPrior {
    /// Nothing is known.
    pub const NONE: Self =
        Self { strength: 0.0, ambient: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) };
}

/// Columns of what is unknown at most: strength and ambient field. Those that are known hold a one on the diagonal and nothing beside it.
type Matrix4 = SMatrix<f64, 4, 4>;
type Vector4 = SVector<f64, 4>;

/// What a solve found.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The magnet.
    pub magnet: MagnetPose,
    /// Sum of squared standardised residuals.
    pub chi_square: f64,
    /// Fisher information of `[δp_world, t₁, t₂]` at the solution, with the tangent basis of its axis.
    pub information: Matrix5,
    /// The magnet's strength over that of the source; 1 where it is known.
    pub strength: f64,
    /// The ambient field, T; zero where it is known.
    pub ambient_tesla: Vector3<f64>,
    /// Degrees of freedom, what is unknown beside the pose with them; less what is known of it beforehand.
    pub freedom: usize,
    /// Valid channels.
    pub channels: usize,
    /// Steps taken.
    pub steps: u32,
    /// Whether χ² stopped falling before the steps ran out.
    pub converged: bool,
}

impl Solution {
    /// χ² per degree of freedom; infinite where no channel is left over.
    pub fn reduced_chi_square(&self) -> f64 {
        if self.channels > self.freedom {
            self.chi_square / (self.channels - self.freedom) as f64
        } else {
            f64::INFINITY
        }
    }
}

/// A reading as the solver sees it.
#[derive(Clone, Copy, Debug)]
pub struct Readings<'a> {
    /// Flux per channel, T.
    pub flux_tesla: &'a [f64],
    /// Which channels hold a value.
    pub valid: &'a [bool],
    /// Noise variance per channel, T².
    pub variance_tesla2: &'a [f64],
    /// What is unknown beside the pose.
    pub unknown: Unknown,
    /// What is known of that beforehand.
    pub prior: LinearPrior,
}

/// Buffers of a solver; one per front end.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    prediction: Prediction,
}

/// Normal equations at one pose.
struct Normal {
    matrix: Matrix5,
    gradient: Vector5,
    chi_square: f64,
    strength: f64,
    ambient_tesla: Vector3<f64>,
    /// Unknowns that nothing tells.
    unseen: usize,
}

/// The linear unknowns at one pose, and how the pose's rows lean on them.
struct Linear {
    inverse: Matrix4,
    by_pose: SMatrix<f64, 4, 5>,
    coefficients: Vector4,
    /// Unknowns that nothing tells.
    unseen: usize,
}

/// Square root of the least pivot of a scaled matrix that is not rounding.
const LEAST_PIVOT: f64 = 1e-6;

/// The columns of what is unknown in one channel.
fn column(unknown: Unknown, flux: f64, axis: &Vector3<f64>) -> Vector4 {
    let axis = if unknown.ambient { *axis } else { Vector3::zeros() };
    Vector4::new(if unknown.strength { flux } else { 0.0 }, axis.x, axis.y, axis.z)
}

/// Solves for what is unknown; `None` where the readings do not tell it.
fn solve_linear(
    channels: &Channels,
    prediction: &Prediction,
    readings: Readings<'_>,
    (e1, e2): (&Vector3<f64>, &Vector3<f64>),
) -> Option<Linear> {
    let unknown = readings.unknown;
    let mut normal = Matrix4::zeros();
    let mut by_pose = SMatrix::<f64, 4, 5>::zeros();
    let mut right = Vector4::zeros();
    for k in (0..readings.flux_tesla.len()).filter(|k| readings.valid[*k]) {
        let (p, a) = (&prediction.by_position[k], &prediction.by_axis[k]);
        let n = column(unknown, prediction.flux_tesla[k], &channels.channels[k].axis_world);
        let weighted = n / readings.variance_tesla2[k];
        let known = if unknown.strength { 0.0 } else { prediction.flux_tesla[k] };
        normal += weighted * n.transpose();
        by_pose += weighted * Vector5::from([p.x, p.y, p.z, a.dot(e1), a.dot(e2)]).transpose();
        right += weighted * (readings.flux_tesla[k] - known);
    }
    if unknown.strength {
        normal[(0, 0)] += readings.prior.strength;
        right[0] += readings.prior.strength;
    }
    if unknown.ambient {
        let mut block = normal.fixed_view_mut::<3, 3>(1, 1);
        block += readings.prior.ambient;
    }
    for i in 0..4 {
        if (i == 0 && !unknown.strength) || (i > 0 && !unknown.ambient) {
            normal[(i, i)] = 1.0;
        }
    }
    let (inverse, rank) = inverse_of(&normal)?;
    // Those that are known stand on the diagonal by themselves.
    let unseen = 4 - rank;
    Some(Linear { coefficients: inverse * right, inverse, by_pose, unseen })
}

/// The inverse of the unknowns' normal matrix, or a generalised one, and its rank; `None` where numbers are not finite.
fn inverse_of(normal: &Matrix4) -> Option<(Matrix4, usize)> {
    // Tesla and a relative strength differ by orders of magnitude.
    let scale = normal.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
    let scaling = Matrix4::from_diagonal(&scale);
    let scaled = scaling * normal * scaling;
    if let Some(factor) =
        scaled.cholesky().filter(|f| f.l_dirty().diagonal().iter().all(|p| *p > LEAST_PIVOT))
    {
        return Some((scaling * factor.inverse() * scaling, 4));
    }
    if !normal.iter().all(|v| v.is_finite()) {
        return None;
    }
    let (inverse, rank) = generalised_inverse(&DMatrix::from_column_slice(4, 4, normal.as_slice()));
    Some((Matrix4::from_column_slice(inverse.as_slice()), rank))
}

fn normal_equations(
    channels: &Channels,
    source: &FieldSource,
    magnet: &MagnetPose,
    readings: Readings<'_>,
    workspace: &mut Workspace,
) -> Normal {
    let prediction = &mut workspace.prediction;
    channels.predict(source, magnet, prediction);
    let (e1, e2) = tangent_basis(&magnet.axis_world);
    let mut normal = Normal {
        matrix: Matrix5::zeros(),
        gradient: Vector5::zeros(),
        chi_square: 0.0,
        strength: 1.0,
        ambient_tesla: Vector3::zeros(),
        unseen: 0,
    };
    let mut linear = None;
    if readings.unknown != Unknown::default() {
        match solve_linear(channels, prediction, readings, (&e1, &e2)) {
            Some(solved) => {
                let c = &solved.coefficients;
                normal.strength = if readings.unknown.strength { c[0] } else { 1.0 };
                normal.ambient_tesla = Vector3::new(c[1], c[2], c[3]);
                normal.unseen = solved.unseen;
                linear = Some(solved);
            }
            // Nothing tells what is unknown: as far away as any pose can be.
            None => normal.chi_square = f64::INFINITY,
        }
    }
    let (strength, ambient) = (normal.strength, normal.ambient_tesla);
    if readings.unknown.strength {
        normal.chi_square += readings.prior.strength * (strength - 1.0).powi(2);
    }
    if readings.unknown.ambient {
        normal.chi_square += ambient.dot(&(readings.prior.ambient * ambient));
    }
    let rows = prediction.flux_tesla.iter().zip(&prediction.by_position).zip(&prediction.by_axis);
    let observed = readings.flux_tesla.iter().zip(readings.valid).zip(readings.variance_tesla2);
    for ((((flux, p), a), ((seen, valid), variance)), channel) in rows.zip(observed).zip(&channels.channels) {
        if !valid {
            continue;
        }
        let weight = 1.0 / variance;
        let residual = seen - strength * flux - ambient.dot(&channel.axis_world);
        let row = [p.x, p.y, p.z, a.dot(&e1), a.dot(&e2)].map(|v| strength * v);
        normal.chi_square += weight * residual * residual;
        for j in 0..5 {
            let scaled = weight * row[j];
            normal.gradient[j] += scaled * residual;
            for (i, element) in row.iter().enumerate().take(j + 1) {
                normal.matrix[(i, j)] += scaled * element;
            }
        }
    }
    normal.matrix.fill_lower_triangle_with_upper_triangle();
    if let Some(linear) = linear {
        normal.matrix -= linear.by_pose.transpose() * linear.inverse * linear.by_pose * strength.powi(2);
    }
    normal
}

fn moved(magnet: &MagnetPose, step: &Vector5) -> MagnetPose {
    let (e1, e2) = tangent_basis(&magnet.axis_world);
    MagnetPose {
        position_world_m: magnet.position_world_m + Vector3::new(step[0], step[1], step[2]),
        axis_world: (magnet.axis_world + e1 * step[3] + e2 * step[4]).normalize(),
    }
}

/// Solves from one start. Allocates nothing once the workspace has grown to the array.
pub fn solve(
    channels: &Channels,
    source: &FieldSource,
    readings: Readings<'_>,
    start: &MagnetPose,
    workspace: &mut Workspace,
) -> Solution {
    let mut magnet = *start;
    let mut normal = normal_equations(channels, source, &magnet, readings, workspace);
    let (mut damping, mut growth) = (FIRST_DAMPING, 2.0);
    let mut steps = 0;
    let mut converged = normal.is_minimum();
    while !converged && steps < MAX_STEPS && damping.is_finite() {
        steps += 1;
        // Nearly every trial is taken, so its derivatives are evaluated at once with its χ².
        let step = normal.damped_step(damping);
        let trial = step.map(|step| {
            let magnet = moved(&magnet, &step);
            (step, magnet, normal_equations(channels, source, &magnet, readings, workspace))
        });
        match trial {
            Some((step, trial, next)) if next.chi_square < normal.chi_square => {
                let ratio = (normal.chi_square - next.chi_square) / normal.expected_fall(&step);
                damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).clamp(MIN_DAMPING_FACTOR, 0.5);
                growth = 2.0;
                (magnet, normal) = (trial, next);
                converged = normal.is_minimum();
            }
            _ => {
                damping *= growth;
                growth *= 2.0;
            }
        }
    }
    // The opposite axis with the opposite strength is the same field.
    if normal.strength < 0.0 {
        magnet.axis_world = -magnet.axis_world;
        normal = normal_equations(channels, source, &magnet, readings, workspace);
    }
    // A prior is an observation of each unknown that it is of.
    let told = |unknown: bool, is_flat: bool, count: usize| if unknown && !is_flat { count } else { 0 };
    let prior = told(readings.unknown.strength, readings.prior.strength == 0.0, 1)
        + told(readings.unknown.ambient, readings.prior.ambient == Matrix3::zeros(), 3);
    Solution {
        magnet,
        strength: normal.strength,
        ambient_tesla: normal.ambient_tesla,
        freedom: readings.unknown.freedom() - prior - normal.unseen,
        chi_square: normal.chi_square,
        information: normal.matrix,
        channels: readings.valid.iter().filter(|v| **v).count(),
        steps,
        converged,
    }
}

impl Normal {
    /// `(JᵀJ + λ diag(JᵀJ)) step = Jᵀr`; `None` where even that is not positive definite.
    fn damped_step(&self, damping: f64) -> Option<Vector5> {
        let mut damped = self.matrix;
        for i in 0..5 {
            damped[(i, i)] += damping * self.matrix[(i, i)].max(f64::MIN_POSITIVE);
        }
        damped.cholesky().map(|factor| factor.solve(&self.gradient))
    }

    /// By how much χ² falls with a step if the model were linear.
    fn expected_fall(&self, step: &Vector5) -> f64 {
        2.0 * step.dot(&self.gradient) - step.dot(&(self.matrix * step))
    }

    /// Whether an undamped step has nothing left to gain. Asked of the undamped step, because a strongly damped one gains
    /// little anywhere.
    fn is_minimum(&self) -> bool {
        let tolerance = CHI_SQUARE_TOLERANCE + CHI_SQUARE_RELATIVE * self.chi_square;
        self.damped_step(0.0).is_some_and(|step| step.dot(&self.gradient) < tolerance)
    }
}

/// What a search from several starts found.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// The pose of the highest likelihood.
    pub best: Solution,
    /// Another pose that explains the reading nearly as well and is more than a standard deviation away.
    pub rival: Option<Solution>,
}

impl Search {
    /// Ranks solutions: the best is the converged one of the lowest χ², an unconverged one only where none converged. `None`
    /// where there is none.
    pub fn of(mut found: Vec<Solution>) -> Option<Self> {
        found.sort_by(|a, b| b.converged.cmp(&a.converged).then(a.chi_square.total_cmp(&b.chi_square)));
        let mut found = found.into_iter();
        let best = found.next()?;
        let rival = found.find(|other| is_rival(&best, other));
        Some(Self { best, rival })
    }
}

/// Solves from every start and adds what has a finite likelihood to `found`.
pub fn solve_each(
    channels: &Channels,
    source: &FieldSource,
    readings: Readings<'_>,
    starts: &[MagnetPose],
    workspace: &mut Workspace,
    found: &mut Vec<Solution>,
) {
    for start in starts {
        let solution = solve(channels, source, readings, start, workspace);
        if solution.chi_square.is_finite() {
            found.push(solution);
        }
    }
}

/// Solves from every start; `None` where no start led to a finite likelihood.
pub fn solve_from_all(
    channels: &Channels,
    source: &FieldSource,
    readings: Readings<'_>,
    starts: &[MagnetPose],
    workspace: &mut Workspace,
) -> Option<Search> {
    let mut found = Vec::with_capacity(starts.len());
    solve_each(channels, source, readings, starts, workspace, &mut found);
    Search::of(found)
}

fn is_rival(best: &Solution, other: &Solution) -> bool {
    let (e1, e2) = tangent_basis(&best.magnet.axis_world);
    let moved = other.magnet.position_world_m - best.magnet.position_world_m;
    let turned = other.magnet.axis_world - best.magnet.axis_world;
    let apart = Vector5::from([moved.x, moved.y, moved.z, turned.dot(&e1), turned.dot(&e2)]);
    let opposite = other.magnet.axis_world.dot(&best.magnet.axis_world) < 0.0;
    other.converged
        && other.chi_square - best.chi_square < RIVAL_CHI_SQUARE * best.reduced_chi_square().max(1.0)
        && (opposite || apart.dot(&(best.information * apart)) > 1.0)
}

/// Largest factor by which the covariance changes within two standard deviations of the solution, along its five principal
/// directions (in the scale of the information's diagonal). Near 1 the reading is linear over its own uncertainty; where it
/// is large, the covariance at the solution says little about the error. Infinite where the covariance does not exist.
pub fn covariance_growth(
    channels: &Channels,
    source: &FieldSource,
    readings: Readings<'_>,
    solution: &Solution,
    workspace: &mut Workspace,
) -> f64 {
    let Some(factor) = solution.information.cholesky() else { return f64::INFINITY };
    let scale = solution.information.diagonal().map(|v| 1.0 / v.sqrt());
    let scaled = Matrix5::from_diagonal(&scale) * solution.information * Matrix5::from_diagonal(&scale);
    let eigen = scaled.symmetric_eigen();
    let mut worst: f64 = 1.0;
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        for sign in [-2.0, 2.0] {
            let step = vector.component_mul(&scale) * (sign / value.max(f64::MIN_POSITIVE).sqrt());
            let there =
                normal_equations(channels, source, &moved(&solution.magnet, &step), readings, workspace);
            let Some(moved_factor) = there.matrix.cholesky() else { return f64::INFINITY };
            // Largest eigenvalue of Lᵀ C' L with I = L Lᵀ: the new variance in units of the old one.
            let change = factor.l().transpose() * moved_factor.solve(&factor.l());
            let growth = change.symmetric_eigenvalues().max();
            if growth.is_nan() {
                return f64::INFINITY;
            }
            worst = worst.max(growth);
        }
    }
    worst
}
