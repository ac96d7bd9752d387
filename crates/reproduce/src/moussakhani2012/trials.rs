//! Maximum likelihood against the bound: noise is drawn, the magnet's pose solved for, its errors compared with the bound.

use super::network::{SIGMA_TESLA, bound_at, channels, grid, source};
use crate::ReproduceError;
use crate::context::Context;
use lumenav_core::{RandomStream, RandomStreams};
use lumenav_magnetic::channels::{Channels, MagnetPose};
use lumenav_magnetic::solver::{Readings, Search, Workspace, solve_from_all};
use nalgebra::Vector3;
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal, UnitSphere};

/// Trials of one job.
const TRIALS_PER_JOB: usize = 250;
/// Where both starts of a solve stand, m.
const START_M: Vector3<f64> = Vector3::new(0.0, 0.0, 0.2);
/// A solution within so many standard deviations is the right one.
const RIGHT: f64 = 6.0;

/// A network and a magnet in front of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Case {
    /// Sensors along a side of the grid.
    pub(super) side: usize,
    /// The magnet's place, m.
    pub(super) place_m: Vector3<f64>,
    /// Its axis, any length.
    pub(super) axis: Vector3<f64>,
}

/// Root mean square errors, and these over the bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Efficiency {
    /// Root mean square errors of a, b, c, m.
    pub(super) rms_m: Vector3<f64>,
    /// Over the bound, along a, b, c.
    pub(super) axes: [f64; 3],
    /// Over the bound, of the norm.
    pub(super) norm: f64,
}

fn streams(seed: u64) -> RandomStreams {
    RandomStreams::new(seed, 0, "moussakhani2012")
}

fn search(
    channels: &Channels,
    truth: &MagnetPose,
    random: &mut RandomStream,
    space: &mut Workspace,
) -> Option<Search> {
    let mut flux = Vec::new();
    channels.flux(&source(), truth, &mut flux);
    for value in &mut flux {
        let noise: f64 = StandardNormal.sample(random);
        *value += SIGMA_TESLA * noise;
    }
    let (valid, variance) = (vec![true; flux.len()], vec![SIGMA_TESLA.powi(2); flux.len()]);
    let readings = Readings {
        flux_tesla: &flux,
        valid: &valid,
        variance_tesla2: &variance,
        unknown: lumenav_magnetic::solver::Unknown::default(),
        prior: lumenav_magnetic::solver::LinearPrior::NONE,
    };
    let starts =
        [Vector3::z(), -Vector3::z()].map(|axis_world| MagnetPose { position_world_m: START_M, axis_world });
    solve_from_all(channels, &source(), readings, &starts, space)
}

/// Errors of `trials` readings over the bound.
pub(super) fn efficiency(
    context: &Context<'_>,
    case: &Case,
    trials: usize,
    seed: u64,
) -> Result<Efficiency, ReproduceError> {
    let sensors = grid(case.side, 0.0);
    let (channels, truth) = (
        channels(&sensors),
        MagnetPose { position_world_m: case.place_m, axis_world: case.axis.normalize() },
    );
    let purpose = format!("efficiency {} {:?} {:?}", case.side, case.place_m, case.axis);
    let parts = context.jobs("maximum likelihood", trials.div_ceil(TRIALS_PER_JOB), |job| {
        let mut space = Workspace::default();
        let mut squares = Vector3::zeros();
        for trial in job * TRIALS_PER_JOB..trials.min((job + 1) * TRIALS_PER_JOB) {
            let mut random = streams(seed).stream(&purpose, trial as u64);
            let found = search(&channels, &truth, &mut random, &mut space)
                .ok_or_else(|| ReproduceError::of_part("solver")("no solution of a full reading"))?;
            let error = found.best.magnet.position_world_m - truth.position_world_m;
            squares += error.component_mul(&error);
        }
        Ok(squares)
    })?;
    let mean: Vector3<f64> = parts.iter().sum::<Vector3<f64>>() / trials as f64;
    let bound = bound_at(&sensors, case.place_m, case.axis, true)?;
    let sigma = bound.position_sigma_m();
    Ok(Efficiency {
        rms_m: mean.map(f64::sqrt),
        axes: [0, 1, 2].map(|i| mean[i].sqrt() / sigma[i]),
        norm: mean.sum().sqrt() / bound.position_norm_m(),
    })
}

/// Of `poses` random poses of the reference workspace (|x|, |y| up to 0.2 m, z from 0.1 to 0.3 m, any direction), above 16 sensors: how
/// many a solve from two starts does not find.
pub(super) fn not_found(context: &Context<'_>, poses: usize, seed: u64) -> Result<usize, ReproduceError> {
    let sensors = grid(4, 0.0);
    let channels = channels(&sensors);
    let parts = context.jobs("starts", poses.div_ceil(TRIALS_PER_JOB), |job| {
        let mut space = Workspace::default();
        let mut missed = 0;
        for pose in job * TRIALS_PER_JOB..poses.min((job + 1) * TRIALS_PER_JOB) {
            let mut random = streams(seed).stream("starts", pose as u64);
            let place_m = Vector3::new(
                random.random_range(-0.2..0.2),
                random.random_range(-0.2..0.2),
                random.random_range(0.1..0.3),
            );
            let axis = Vector3::from(UnitSphere.sample(&mut random));
            let truth = MagnetPose { position_world_m: place_m, axis_world: axis };
            let reach_m = RIGHT * bound_at(&sensors, place_m, axis, true)?.position_norm_m();
            let is_right = |found: Search| {
                found.best.converged
                    && found.best.magnet.axis_world.dot(&axis) > 0.0
                    && (found.best.magnet.position_world_m - place_m).norm() < reach_m
            };
            let found = search(&channels, &truth, &mut random, &mut space);
            missed += usize::from(!found.is_some_and(is_right));
        }
        Ok(missed)
    })?;
    Ok(parts.iter().sum())
}
