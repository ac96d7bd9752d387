//! Maximum likelihood of a magnet's pose from one reading: Levenberg-Marquardt on R³ x S².
//!
//! Minimises `χ² = Σ_k (z_k - h_k)²/σ_k²` over position p and axis u (unit). The axis moves in its tangent plane,
//! `u ← (u + t₁e₁ + t₂e₂)/|…|`, so no pose is singular. Five normal equations per step with Marquardt's scaling (the diagonal
//! of JᵀJ), which makes metres and radians comparable; damping as in Nielsen (1999).
//!
//! From two opposite starts the right pose is reached from every pose of the reference workspace (`moussakhani2012`'s array;
//! 2,000 random poses, see the tests): the axis of a dipole is the one thing a poor start gets wrong.

use crate::channels::{Channels, MagnetPose, Prediction};
use lumenav_core::pose::tangent_basis;
use lumenav_fields::FieldSource;
use nalgebra::{SMatrix, SVector, Vector3};

type Matrix5 = SMatrix<f64, 5, 5>;
type Vector5 = SVector<f64, 5>;

/// A step is the last when it would lower χ² by less than this: a thousandth of a standard deviation.
const CHI_SQUARE_TOLERANCE: f64 = 1e-6;
/// Steps before giving up; a good start needs five, a poor one twenty.
const MAX_STEPS: u32 = 100;

/// What a solve found.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The magnet.
    pub magnet: MagnetPose,
    /// Sum of squared standardised residuals.
    pub chi_square: f64,
    /// Fisher information of `[δp_world, t₁, t₂]` at the solution, with the tangent basis of its axis.
    pub information: Matrix5,
    /// Valid channels.
    pub channels: usize,
    /// Steps taken.
    pub steps: u32,
    /// Whether χ² stopped falling before the steps ran out.
    pub converged: bool,
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
    let mut normal = Normal { matrix: Matrix5::zeros(), gradient: Vector5::zeros(), chi_square: 0.0 };
    for k in 0..channels.len() {
        if !readings.valid[k] {
            continue;
        }
        let weight = 1.0 / readings.variance_tesla2[k];
        let residual = readings.flux_tesla[k] - prediction.flux_tesla[k];
        let (p, a) = (&prediction.by_position[k], &prediction.by_axis[k]);
        let row = Vector5::from([p.x, p.y, p.z, a.dot(&e1), a.dot(&e2)]);
        normal.chi_square += weight * residual * residual;
        normal.gradient += row * (weight * residual);
        for j in 0..5 {
            let scaled = weight * row[j];
            for i in 0..=j {
                normal.matrix[(i, j)] += scaled * row[i];
            }
        }
    }
    normal.matrix.fill_lower_triangle_with_upper_triangle();
    normal
}

/// χ² alone, for a trial step.
fn chi_square(
    channels: &Channels,
    source: &FieldSource,
    magnet: &MagnetPose,
    readings: Readings<'_>,
    workspace: &mut Workspace,
) -> f64 {
    channels.flux(source, magnet, &mut workspace.prediction.flux_tesla);
    let mut sum = 0.0;
    for (k, flux) in workspace.prediction.flux_tesla.iter().enumerate() {
        if readings.valid[k] {
            let residual = readings.flux_tesla[k] - flux;
            sum += residual * residual / readings.variance_tesla2[k];
        }
    }
    sum
}

fn moved(magnet: &MagnetPose, step: &Vector5) -> MagnetPose {
    let (e1, e2) = tangent_basis(&magnet.axis_world);
    MagnetPose {
        position_world_m: magnet.position_world_m + Vector3::new(step[0], step[1], step[2]),
        axis_world: (magnet.axis_world + e1 * step[3] + e2 * step[4]).normalize(),
    }
}

/// Solves from one start.
pub fn solve(
    channels: &Channels,
    source: &FieldSource,
    readings: Readings<'_>,
    start: &MagnetPose,
    workspace: &mut Workspace,
) -> Solution {
    let mut magnet = *start;
    let mut normal = normal_equations(channels, source, &magnet, readings, workspace);
    let (mut damping, mut growth) = (1e-3, 2.0);
    let mut converged = false;
    let mut steps = 0;
    while steps < MAX_STEPS {
        steps += 1;
        let Some(step) = damped_step(&normal, damping) else {
            damping *= growth;
            growth *= 2.0;
            continue;
        };
        let expected = step.dot(&normal.gradient) * 2.0 - step.dot(&(normal.matrix * step));
        let trial = moved(&magnet, &step);
        let value = chi_square(channels, source, &trial, readings, workspace);
        let fell = normal.chi_square - value;
        if fell > 0.0 {
            magnet = trial;
            let ratio = fell / expected;
            damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).clamp(0.1, 0.5);
            growth = 2.0;
            normal = normal_equations(channels, source, &magnet, readings, workspace);
        } else {
            damping *= growth;
            growth *= 2.0;
        }
        if expected < CHI_SQUARE_TOLERANCE + 1e-12 * normal.chi_square {
            converged = true;
            break;
        }
        if !damping.is_finite() {
            break;
        }
    }
    Solution {
        magnet,
        chi_square: normal.chi_square,
        information: normal.matrix,
        channels: readings.valid.iter().filter(|v| **v).count(),
        steps,
        converged,
    }
}

/// `(JᵀJ + λ diag(JᵀJ)) step = Jᵀr`; `None` where even that is not positive definite.
fn damped_step(normal: &Normal, damping: f64) -> Option<Vector5> {
    let mut damped = normal.matrix;
    for i in 0..5 {
        damped[(i, i)] += damping * normal.matrix[(i, i)].max(f64::MIN_POSITIVE);
    }
    damped.cholesky().map(|factor| factor.solve(&normal.gradient))
}

/// Solves from every start and keeps the best (lowest χ², converged before not).
pub fn solve_from_all(
    channels: &Channels,
    source: &FieldSource,
    readings: Readings<'_>,
    starts: &[MagnetPose],
    workspace: &mut Workspace,
) -> Option<Solution> {
    let mut best: Option<Solution> = None;
    for start in starts {
        let found = solve(channels, source, readings, start, workspace);
        if !found.chi_square.is_finite() {
            continue;
        }
        let better = best.as_ref().is_none_or(|b| {
            (found.converged, -found.chi_square) > (b.converged, -b.chi_square)
        });
        if better {
            best = Some(found);
        }
    }
    best
}
