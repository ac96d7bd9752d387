//! Time per solve on the reference array: 16 three-axis sensors on 0.5 x 0.5 m, a 5 x 6 mm magnet, noise 1.2e-8 T.
//!
//! `tests/cross/magnetic_bench.py` times magpylib and SciPy on the same poses. 64 poses of the reference workspace are solved
//! in turn; a warm start is 3 mm and 2 degrees away, a cold one is both reference starts.

use divan::Bencher;
use lumenav_core::fix::PoseEstimate;
use lumenav_core::{
    FixKind, Instant, Measurement, MeasurementModel as _, Name, NominalState, PriorUse, SimTime,
};
use lumenav_fields::{Cylinder, FieldSource};
use lumenav_magnetic::array::SensorArray;
use lumenav_magnetic::channels::{Channels, MagnetPose};
use lumenav_magnetic::model::FluxModel;
use lumenav_magnetic::sensor::flux_schema;
use lumenav_magnetic::solver::{Readings, Workspace, solve, solve_from_all};
use nalgebra::{Isometry3, Matrix6, Vector3};
use std::sync::Arc;

fn main() {
    divan::main();
}

const SIGMA_TESLA: f64 = 1.2e-8;
const POSES: usize = 64;

fn array() -> SensorArray {
    let place = |i: usize| f64::from(i as u32) / 3.0 * 0.5 - 0.25;
    let positions: Vec<Vector3<f64>> =
        (0..16).map(|i| Vector3::new(place(i % 4), place(i / 4), 0.0)).collect();
    SensorArray::of_triads("plane-4x4", &positions, SIGMA_TESLA)
}

fn cylinder() -> FieldSource {
    // The pillcam-magnet of the models folder; its sizes are valid.
    Cylinder::magnet(2.5e-3, 6e-3, 1.29375).map_or(dipole(), FieldSource::Cylinder)
}

fn dipole() -> FieldSource {
    FieldSource::Dipole { strength_t_m3: 1.212891e-8 }
}

/// A low-discrepancy number (additive recurrence): the same poses in the Python script.
fn spread(index: usize, dimension: usize) -> f64 {
    const STEPS: [f64; 7] = [
        0.618033988749895,
        0.754877666246693,
        0.819172513396164,
        0.8566748838545029,
        0.8812714616335696,
        0.8986537126286993,
        0.9115923534820549,
    ];
    (0.5 + STEPS[dimension] * (index + 1) as f64).fract()
}

struct Case {
    truth: MagnetPose,
    warm: MagnetPose,
    flux: Vec<f64>,
}

fn direction(height: f64, turn: f64) -> Vector3<f64> {
    let (z, angle) = (2.0 * height - 1.0, std::f64::consts::TAU * turn);
    let rho = (1.0 - z * z).sqrt();
    Vector3::new(rho * angle.cos(), rho * angle.sin(), z)
}

fn cases(channels: &Channels, source: &FieldSource) -> Vec<Case> {
    (0..POSES)
        .map(|i| {
            let u = |dimension| spread(i, dimension);
            let truth = MagnetPose {
                position_world_m: Vector3::new(0.4 * u(0) - 0.2, 0.4 * u(1) - 0.2, 0.1 + 0.2 * u(2)),
                axis_world: direction(u(3), u(4)),
            };
            let away = direction(u(5), u(6));
            let warm = MagnetPose {
                position_world_m: truth.position_world_m + away * 3e-3,
                axis_world: (truth.axis_world + away * 2.0_f64.to_radians()).normalize(),
            };
            let mut flux = Vec::new();
            channels.flux(source, &truth, &mut flux);
            // Noise of the right size without a generator: a centred uniform number of the same variance.
            for (k, value) in flux.iter_mut().enumerate() {
                *value += SIGMA_TESLA * 12.0_f64.sqrt() * (spread(i * 48 + k, 0) - 0.5);
            }
            Case { truth, warm, flux }
        })
        .collect()
}

fn run(bencher: Bencher<'_, '_>, source: FieldSource, starts: impl Fn(&Case) -> Vec<MagnetPose>) {
    let channels = array().channels(&Isometry3::identity());
    let cases: Vec<(Case, Vec<MagnetPose>)> = cases(&channels, &source)
        .into_iter()
        .map(|c| {
            let s = starts(&c);
            (c, s)
        })
        .collect();
    let (valid, variance) = (vec![true; 48], vec![SIGMA_TESLA.powi(2); 48]);
    let mut workspace = Workspace::default();
    bencher.counter(POSES).bench_local(|| {
        let mut worst: f64 = 0.0;
        for (case, starts) in &cases {
            let readings = Readings {
                flux_tesla: &case.flux,
                valid: &valid,
                variance_tesla2: &variance,
                unknown: lumenav_magnetic::solver::Unknown::default(),
                prior: lumenav_magnetic::solver::LinearPrior::NONE,
            };
            let found = match starts.as_slice() {
                [one] => Some(solve(&channels, &source, readings, one, &mut workspace)),
                all => solve_from_all(&channels, &source, readings, all, &mut workspace).map(|s| s.best),
            };
            let error = found
                .map_or(f64::INFINITY, |s| (s.magnet.position_world_m - case.truth.position_world_m).norm());
            worst = worst.max(error);
        }
        // The farthest pose has a bound of 6 mm: a wrong basin would show.
        assert!(worst < 0.04, "a solve went wrong: {worst} m");
        worst
    });
}

fn two_starts(_: &Case) -> Vec<MagnetPose> {
    let position_world_m = Vector3::new(0.0, 0.0, 0.2);
    [Vector3::z(), -Vector3::z()].map(|axis_world| MagnetPose { position_world_m, axis_world }).to_vec()
}

#[divan::bench]
fn warm_dipole(bencher: Bencher<'_, '_>) {
    run(bencher, dipole(), |case| vec![case.warm]);
}

#[divan::bench]
fn warm_cylinder(bencher: Bencher<'_, '_>) {
    run(bencher, cylinder(), |case| vec![case.warm]);
}

#[divan::bench]
fn cold_dipole_two_starts(bencher: Bencher<'_, '_>) {
    run(bencher, dipole(), two_starts);
}

#[divan::bench]
fn cold_cylinder_two_starts(bencher: Bencher<'_, '_>) {
    run(bencher, cylinder(), two_starts);
}

fn linearize(bencher: Bencher<'_, '_>, source: FieldSource) {
    let array = array();
    let channels = array.channels(&Isometry3::identity());
    let pose = Isometry3::new(Vector3::new(0.05, -0.03, 0.2), Vector3::new(0.3, 1.2, -0.4));
    let mut flux = Vec::new();
    channels.flux(&source, &MagnetPose::of_capsule(&pose, &Vector3::zeros()), &mut flux);
    let Ok(frame) = lumenav_core::Frame::of_values(flux_schema(array.labels()), flux) else { return };
    let model = Arc::new(FluxModel {
        channels: Arc::new(channels),
        source,
        offset_capsule_m: Vector3::zeros(),
        noise_tesla: SIGMA_TESLA,
        relative_error: 0.0,
        unknown: lumenav_magnetic::solver::Unknown::default(),
        prior: lumenav_magnetic::solver::LinearPrior::NONE,
        nuisance: Arc::default(),
    });
    let measurement = Measurement {
        sensor: Name::from("plane"),
        sequence: 0,
        at: SimTime::ZERO,
        arrival: SimTime::ZERO,
        since: None,
        value: Arc::new(frame),
        model: model.clone(),
        prior_use: PriorUse::None,
        motion: None,
        fix: Some(PoseEstimate {
            world_from_capsule: pose,
            covariance: Matrix6::zeros(),
            kind: FixKind::Pointing,
        }),
    };
    let state = NominalState::at_rest(pose);
    assert!(lumenav_core::StateView::world_from_capsule(&state, Instant::Now).is_some());
    bencher.bench_local(|| model.linearize(&measurement, &state).is_ok());
}

#[divan::bench]
fn linearize_48_dipole(bencher: Bencher<'_, '_>) {
    linearize(bencher, dipole());
}

#[divan::bench]
fn linearize_48_cylinder(bencher: Bencher<'_, '_>) {
    linearize(bencher, cylinder());
}
