//! Evaluations per second and core of every field function (`cargo bench -p lumenav-fields`).
//!
//! The points are those of `tests/cross/fields_bench.py` (magpylib): 16,384 directions of a golden spiral,
//! distances spread evenly over 2 to 8 radii of the permanent magnet of taddese2018.

use std::fmt;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use lumenav_fields::{Cylinder, FieldSource, FluxJacobian, GradientSlices, dipole};
use nalgebra::Vector3;

const COUNT: usize = 16_384;

fn main() {
    divan::main();
}

fn permanent_magnet() -> Cylinder {
    // The sizes are constants of this file: positive and finite.
    Cylinder::magnet(0.0508, 0.1016, 1.48).expect("valid sizes")
}

/// The points, `nearest` to `farthest` radii from the centre.
fn points(nearest: f64, farthest: f64) -> Vec<Vector3<f64>> {
    (0..COUNT)
        .map(|index| {
            let z = 1.0 - (2.0 * index as f64 + 1.0) / COUNT as f64;
            let turn = 2.399_963_229_728_653 * index as f64;
            let rho = (1.0 - z * z).sqrt();
            // A stride that shares no factor with the count: distance and direction are unrelated.
            let share = (index * 6_151 % COUNT) as f64 / COUNT as f64;
            let radius_m = 0.0508 * (nearest + (farthest - nearest) * share);
            Vector3::new(rho * turn.cos(), rho * turn.sin(), z) * radius_m
        })
        .collect()
}

fn coordinates(points: &[Vector3<f64>]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| points.iter().map(|point| point[axis]).collect())
}

#[divan::bench]
fn cylinder_flux_scalar(bencher: Bencher) {
    let (magnet, points) = (permanent_magnet(), points(2.0, 8.0));
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        for point in &points {
            black_box(magnet.flux_tesla(point));
        }
    });
}

#[divan::bench]
fn cylinder_flux_and_gradient_scalar(bencher: Bencher) {
    let (magnet, points) = (permanent_magnet(), points(2.0, 8.0));
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        for point in &points {
            black_box(magnet.flux_and_gradient(point));
        }
    });
}

/// Distances from the centre in radii, nearest and farthest.
struct Distances(f64, f64);

impl fmt::Display for Distances {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} to {} radii", self.0, self.1)
    }
}

/// Usual distances, near the surface (more than four means), beyond the switch to the series.
const RANGES: [Distances; 3] = [Distances(2.0, 8.0), Distances(1.05, 1.5), Distances(12.0, 100.0)];

#[divan::bench(args = RANGES)]
fn cylinder_flux_batch(bencher: Bencher, distances: &Distances) {
    let Distances(nearest, farthest) = *distances;
    let (magnet, points) = (permanent_magnet(), points(nearest, farthest));
    let [x, y, z] = coordinates(&points);
    let [mut bx, mut by, mut bz] = [vec![0.0; COUNT], vec![0.0; COUNT], vec![0.0; COUNT]];
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        magnet.flux_batch(black_box(&x), &y, &z, &mut bx, &mut by, &mut bz).expect("equal lengths");
        black_box(&bx);
    });
}

#[divan::bench(args = RANGES)]
fn cylinder_flux_and_gradient_batch(bencher: Bencher, distances: &Distances) {
    let Distances(nearest, farthest) = *distances;
    let (magnet, points) = (permanent_magnet(), points(nearest, farthest));
    let [x, y, z] = coordinates(&points);
    let mut out: [Vec<f64>; 9] = std::array::from_fn(|_| vec![0.0; COUNT]);
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        let [bx, by, bz, xx, xy, xz, yy, yz, zz] = &mut out;
        let gradient = GradientSlices { xx, xy, xz, yy, yz, zz };
        magnet.gradient_batch(black_box(&x), &y, &z, [bx, by, bz], gradient).expect("equal lengths");
        black_box(&out);
    });
}

#[divan::bench(args = [6, 16, 48])]
fn source_jacobian_batch_cylinder(bencher: Bencher, sensors: usize) {
    jacobian_batch(bencher, FieldSource::Cylinder(permanent_magnet()), sensors);
}

#[divan::bench(args = [16])]
fn source_jacobian_batch_dipole(bencher: Bencher, sensors: usize) {
    jacobian_batch(bencher, FieldSource::Dipole { strength_t_m3: 1.2e-8 }, sensors);
}

fn jacobian_batch(bencher: Bencher, source: FieldSource, sensors: usize) {
    let points = points(2.0, 8.0);
    let axis = Vector3::new(0.6, -0.48, 0.64);
    let mut out = vec![FluxJacobian::default(); sensors];
    let used = points.len() / sensors * sensors;
    bencher.counter(ItemsCount::new(used)).bench_local(|| {
        for offsets in points.chunks_exact(sensors) {
            source.flux_and_jacobian_batch(black_box(&axis), offsets, &mut out).expect("equal lengths");
            black_box(&out);
        }
    });
}

#[divan::bench]
fn dipole_flux_batch(bencher: Bencher) {
    let points = points(2.0, 8.0);
    let mut out = vec![Vector3::zeros(); COUNT];
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        dipole::flux_batch(1.2e-8, black_box(&Vector3::z()), &points, &mut out).expect("equal lengths");
        black_box(&out);
    });
}

#[divan::bench]
fn dipole_flux_and_jacobian_batch(bencher: Bencher) {
    let points = points(2.0, 8.0);
    let mut out = vec![FluxJacobian::default(); COUNT];
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        dipole::flux_and_jacobian_batch(1.2e-8, black_box(&Vector3::z()), &points, &mut out)
            .expect("equal lengths");
        black_box(&out);
    });
}
