//! Cylinder against mpmath (50 digits, azimuthal quadrature) and magpylib, 235 points of five sources.

use lumenav_fields::{Cylinder, elliptic};
use nalgebra::{Matrix3, Vector3};

struct Row {
    kind: String,
    cylinder: Cylinder,
    point_source_m: Vector3<f64>,
    flux_tesla: Vector3<f64>,
    gradient_tesla_per_m: Matrix3<f64>,
    magpylib_tesla: Vector3<f64>,
}

impl Row {
    fn distance_in_radii(&self) -> f64 {
        self.point_source_m.norm() / self.cylinder.radius_m()
    }
}

fn rows() -> Vec<Row> {
    let text = include_str!("../../../../tests/cross/fields_reference.csv");
    let rows: Vec<Row> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .skip(1)
        .map(|line| {
            let (kind, rest) = line.split_once(',').unwrap();
            let numbers: Vec<f64> = rest.split(',').skip(1).map(|field| field.parse().unwrap()).collect();
            let [a, b, br, x, y, z, bx, by, bz, xx, xy, xz, yy, yz, zz, mx, my, mz] = numbers[..] else {
                panic!("a row of fields_reference.csv has {} numbers", numbers.len())
            };
            Row {
                kind: kind.to_owned(),
                cylinder: Cylinder::new(a, b, br).unwrap(),
                point_source_m: Vector3::new(x, y, z),
                flux_tesla: Vector3::new(bx, by, bz),
                gradient_tesla_per_m: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
                magpylib_tesla: Vector3::new(mx, my, mz),
            }
        })
        .collect();
    assert!(rows.len() > 200, "the reference file has lost its rows");
    rows
}

/// The largest relative error of the rows that `select` picks, which have to be at least `least`.
fn worst(least: usize, select: impl Fn(&Row) -> bool, error: impl Fn(&Row) -> f64) -> f64 {
    let errors: Vec<f64> = rows().iter().filter(|row| select(row)).map(error).collect();
    assert!(errors.len() >= least, "only {} rows are compared", errors.len());
    assert!(errors.iter().all(|error| error.is_finite()));
    errors.into_iter().fold(0.0, f64::max)
}

fn flux_error(row: &Row) -> f64 {
    let flux = row.cylinder.flux_tesla(&row.point_source_m);
    (flux - row.flux_tesla).norm() / row.flux_tesla.norm()
}

fn gradient_error(row: &Row) -> f64 {
    let gradient = row.cylinder.gradient(&row.point_source_m);
    (gradient - row.gradient_tesla_per_m).norm() / row.gradient_tesla_per_m.norm()
}

fn near_surface(row: &Row) -> bool {
    row.kind == "near_edge"
}

#[test]
fn cross_cylinder_flux_equals_mpmath_to_ten_radii() {
    let error = worst(90, |row| row.distance_in_radii() <= 10.001 && !near_surface(row), flux_error);
    println!("flux, r/a <= 10: {error:.2e}");
    assert!(error < 1e-12, "{error:e}");
}

#[test]
fn cross_cylinder_flux_equals_mpmath_from_ten_to_thirty_radii() {
    let between = |row: &Row| (10.001..=30.001).contains(&row.distance_in_radii());
    let error = worst(20, between, flux_error);
    println!("flux, 10 < r/a <= 30: {error:.2e}");
    assert!(error < 1e-11, "{error:e}");
}

#[test]
fn cross_cylinder_flux_equals_mpmath_beyond_thirty_radii() {
    let error = worst(35, |row| row.distance_in_radii() > 30.001, flux_error);
    println!("flux, r/a > 30: {error:.2e}");
    assert!(error < 1e-12, "{error:e}");
}

#[test]
fn cross_cylinder_flux_equals_mpmath_near_the_edge() {
    // The condition of the problem grows as 1/gap: a gap of 1e-6 radii loses six of sixteen digits.
    let error = worst(20, near_surface, flux_error);
    println!("flux, near the edge: {error:.2e}");
    assert!(error < 1e-10, "{error:e}");
}

#[test]
fn cross_cylinder_gradient_equals_mpmath() {
    // In the centre the gradient is zero by symmetry: no relative error.
    let near = |row: &Row| (0.01..=10.001).contains(&row.distance_in_radii());
    let error = worst(100, |row| near(row) && !near_surface(row), gradient_error);
    println!("gradient, r/a <= 10: {error:.2e}");
    assert!(error < 1e-12, "{error:e}");
    let far = |row: &Row| row.distance_in_radii() > 10.001 && !near_surface(row);
    let error = worst(50, far, gradient_error);
    println!("gradient, r/a > 10: {error:.2e}");
    assert!(error < 1e-12, "{error:e}");
    // The condition of the gradient near the edge is that of the flux: 1/gap.
    let error = worst(20, near_surface, gradient_error);
    println!("gradient, near the edge: {error:.2e}");
    assert!(error < 1e-9, "{error:e}");
    for row in rows().iter().filter(|row| row.point_source_m == Vector3::zeros()) {
        let gradient = row.cylinder.gradient(&row.point_source_m);
        assert!(gradient.norm() * row.cylinder.radius_m() < 1e-15 * row.flux_tesla.norm());
    }
}

#[test]
fn cross_cylinder_equals_magpylib() {
    // Far out on the axis magpylib's own closed form cancels: 5e-8 (disc), 9e-9 (coil), 1e-9 (permanent magnet)
    // off mpmath at 300 radii. Those rows are left to the comparison with mpmath above.
    let error = |row: &Row| {
        let flux = row.cylinder.flux_tesla(&row.point_source_m);
        (flux - row.magpylib_tesla).norm() / row.magpylib_tesla.norm()
    };
    let near = worst(90, |row| row.distance_in_radii() <= 10.001 && !near_surface(row), error);
    let valid = |row: &Row| row.distance_in_radii() <= 1000.001 && row.kind != "axis" && !near_surface(row);
    let far = worst(100, valid, error);
    println!("magpylib: r/a <= 10 {near:.2e}, <= 1000 {far:.2e}");
    assert!(near < 1e-12, "{near:e}");
    assert!(far < 1e-9, "{far:e}");
}

/// derby2010 as printed, with `cel`: an independent evaluation in double precision.
fn derby2010(cylinder: &Cylinder, point: &Vector3<f64>) -> Vector3<f64> {
    let (a, b) = (cylinder.radius_m(), cylinder.half_length_m());
    let rho = point.x.hypot(point.y);
    let g = (a - rho) / (a + rho);
    let b0 = cylinder.remanence_tesla() / std::f64::consts::PI;
    let face = |z: f64| {
        let norm = (z * z + (rho + a).powi(2)).sqrt();
        let k = (z * z + (a - rho).powi(2)).sqrt() / norm;
        (a / norm * elliptic::cel(k, 1.0, 1.0, -1.0), z / norm * elliptic::cel(k, g * g, 1.0, g))
    };
    let (plus, minus) = (face(point.z + b), face(point.z - b));
    let radial = b0 * (plus.0 - minus.0);
    let axial = b0 * a / (a + rho) * (plus.1 - minus.1);
    Vector3::new(radial * point.x / rho, radial * point.y / rho, axial)
}

#[test]
fn cross_shared_mean_equals_four_cel_calls() {
    for cylinder in [crate::permanent_magnet(), crate::coil(), crate::capsule_magnet()] {
        for direction in crate::directions(200) {
            for ratio in [0.4, 1.07, 1.6, 2.5, 4.0, 8.0] {
                let point = direction * (ratio * cylinder.radius_m());
                let (ours, printed) = (cylinder.flux_tesla(&point), derby2010(&cylinder, &point));
                let error = (ours - printed).norm() / printed.norm();
                assert!(error < 2e-12, "{error:e} at {point:?}");
            }
        }
    }
}
