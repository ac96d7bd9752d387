//! The Cramér-Rao bound against an independent study (`tests/cross/crlb-fixtures.json`) and against moussakhani2012.
//!
//! `cross_`: every number of the file, counted. `published_`: what the paper claims of figures 2 to 5, each with the verdict
//! that its own model gives.

use lumenav_fields::FieldSource;
use lumenav_magnetic::array::SensorArray;
use lumenav_magnetic::bound::{Bound, bound};
use lumenav_magnetic::channels::{Channels, MagnetPose};
use nalgebra::{Isometry3, Matrix3, Vector3};
use serde_json::Value;

const SIGMA_TESLA: f64 = 1.2e-8;
const STRENGTH_T_M3: f64 = 1.125e-8;
/// The file has seven digits.
const ALLOWED: f64 = 1e-6;

fn channels(positions_m: &[Vector3<f64>]) -> Channels {
    SensorArray::of_triads("test", positions_m, SIGMA_TESLA).channels(&Isometry3::identity())
}

/// `side` x `side` sensors on 0.5 x 0.5 m, edges included.
fn grid(side: usize, height_m: f64) -> Vec<Vector3<f64>> {
    let place = |i: usize| i as f64 / (side - 1) as f64 * 0.5 - 0.25;
    (0..side * side).map(|i| Vector3::new(place(i % side), place(i / side), height_m)).collect()
}

fn line(count: usize) -> Vec<Vector3<f64>> {
    (0..count).map(|i| Vector3::new(i as f64 / (count - 1) as f64 * 0.5 - 0.25, 0.0, 0.0)).collect()
}

fn bound_at(positions_m: &[Vector3<f64>], place_m: Vector3<f64>, axis: Vector3<f64>, known: bool) -> Bound {
    let magnet = MagnetPose { position_world_m: place_m, axis_world: axis.normalize() };
    let source = FieldSource::Dipole { strength_t_m3: STRENGTH_T_M3 };
    bound(&channels(positions_m), &source, &magnet, SIGMA_TESLA, known).expect("a finite bound")
}

/// Compares one entry of the file; returns how many numbers it held.
fn agree(bound: &Bound, entry: &Value, what: &str) -> usize {
    let sigma = bound.position_sigma_m();
    let mut pairs = vec![
        (sigma.x, &entry["a"]),
        (sigma.y, &entry["b"]),
        (sigma.z, &entry["c"]),
        (bound.axis_rad[0], &entry["ang"][0]),
        (bound.axis_rad[1], &entry["ang"][1]),
    ];
    if let Some(strength) = bound.strength_relative {
        pairs.push((strength, &entry["mag"]));
    }
    for (ours, theirs) in &pairs {
        let theirs = theirs.as_f64().unwrap_or_else(|| panic!("{what}: a number is missing"));
        assert!((ours / theirs - 1.0).abs() < ALLOWED, "{what}: {ours} is not {theirs}");
    }
    pairs.len()
}

fn numbers(value: &Value) -> usize {
    match value {
        Value::Object(map) => map.values().map(numbers).sum(),
        Value::Array(items) => items.iter().map(numbers).sum(),
        Value::Number(_) => 1,
        _ => 0,
    }
}

fn fixtures() -> Value {
    serde_json::from_str(include_str!("../../../../tests/cross/crlb-fixtures.json"))
        .expect("the file is JSON")
}

fn entries(value: &Value) -> Vec<(&String, &Value)> {
    value.as_object().expect("a table").iter().collect()
}

/// Both variants of an entry.
fn agree_both(
    positions_m: &[Vector3<f64>],
    place_m: Vector3<f64>,
    axis: Vector3<f64>,
    entry: &Value,
    what: &str,
) -> usize {
    let variant =
        |name: &str| agree(&bound_at(positions_m, place_m, axis, name == "known"), &entry[name], what);
    variant("known") + variant("unknown")
}

#[test]
fn cross_every_number_of_the_independent_study() {
    let file = fixtures();
    assert_eq!(file["meta"]["bT"].as_f64(), Some(STRENGTH_T_M3));
    assert_eq!(file["meta"]["sigma"].as_f64(), Some(SIGMA_TESLA));
    let mut compared = 2;
    let above = Vector3::new(0.0, 0.0, 0.25);
    for (count, entry) in entries(&file["N_2D"]) {
        let side = count.parse::<f64>().unwrap().sqrt() as usize;
        compared += agree_both(&grid(side, 0.0), above, Vector3::z(), entry, &format!("grid of {count}"));
    }
    for (count, entry) in entries(&file["N_1D"]) {
        compared += agree_both(
            &line(count.parse().unwrap()),
            above,
            Vector3::z(),
            entry,
            &format!("line of {count}"),
        );
    }
    for (count, heights) in entries(&file["distance_2D"]) {
        let sensors = grid(count.parse::<f64>().unwrap().sqrt() as usize, 0.0);
        for (height, entry) in entries(heights) {
            let place = Vector3::new(0.0, 0.0, height.parse().unwrap());
            compared +=
                agree_both(&sensors, place, Vector3::z(), entry, &format!("grid of {count} at {height} m"));
        }
    }
    for (count, angles) in entries(&file["rotation_2D"]) {
        let sensors = grid(count.parse::<f64>().unwrap().sqrt() as usize, 0.0);
        for (degrees, entry) in entries(angles) {
            let turn = degrees.parse::<f64>().unwrap().to_radians();
            let axis = Vector3::new(0.0, turn.sin(), turn.cos());
            compared +=
                agree_both(&sensors, above, axis, entry, &format!("grid of {count} turned by {degrees}"));
        }
    }
    compared += compare_planes(&file["planes"]);
    println!("figure: CRLB fixtures: {compared} numbers agree within {ALLOWED:e}");
    assert_eq!(compared, numbers(&file), "numbers of the file that were not compared");
    assert_eq!(compared, 1036);
}

fn compare_planes(planes: &Value) -> usize {
    let mut compared = 0;
    for (axis_name, places) in entries(planes) {
        let axis = if axis_name == "z" { Vector3::z() } else { Vector3::new(1.0, 1.0, 1.0) };
        for (t, cases) in entries(places) {
            let t = t.parse().unwrap();
            for (case, entry) in entries(cases) {
                let sensors = plane_case(case);
                let what = format!("planes {case}, axis {axis_name}, t = {t}");
                compared += agree_both(&sensors, Vector3::new(t, t, 0.3), axis, entry, &what);
            }
        }
    }
    compared
}

fn plane_case(case: &str) -> Vec<Vector3<f64>> {
    match case {
        "case1" => [grid(4, 0.0), grid(4, 0.6)].concat(),
        "case2" => [grid(4, 0.0), grid(4, 0.0)].concat(),
        _ => grid(4, 0.0),
    }
}

/// Elements of the Fisher matrix of (position, three components of the axis) by the corrected equations 10 to 14.
#[test]
fn published_moussakhani2012_equations_10_to_14_corrected() {
    let d: Vector3<f64> = Vector3::new(0.2, -0.1, -0.25);
    let h: Vector3<f64> = Vector3::new(0.6, 0.48, 0.64);
    let (x, y, z) = (d.x, d.y, d.z);
    let (m, k, p) = (h.x, h.y, h.z);
    let (q, u, v, w) = (m * x + k * y + p * z, m * y + k * x, m * z + p * x, k * z + p * y);
    let r = d.norm();
    let s = x * (q + 2.0 * m * x) + y * u + z * v;
    let t = x * u + y * (q + 2.0 * k * y) + z * w;
    let (r6, r8, r10, r12) = (r.powi(6), r.powi(8), r.powi(10), r.powi(12));
    let formulas = [
        9.0 * ((q + 2.0 * m * x).powi(2) + u * u + v * v) / r10 - 90.0 * q * x * s / r12
            + 225.0 * q * q * x * x / r12,
        9.0 * (2.0 * u * (q + m * x + k * y) + v * w) / r10 - 45.0 * q * (y * s + x * t) / r12
            + 225.0 * q * q * x * y / r12,
        3.0 * (q + 2.0 * m * x) / r8 - 9.0 * x * s / r10 + 30.0 * q * x * x / r10,
        3.0 * u / r8 - 9.0 * y * s / r10 + 30.0 * q * x * y / r10,
        3.0 * x * x / r8 + 1.0 / r6,
        3.0 * x * y / r8,
    ];
    let study = [72044.2068, 5919.53817, -6239.62120, 5217.44206, 1451.48605, -374.577046];
    // The derivative by the axis as a free vector: the formula linear in it.
    let field = lumenav_fields::dipole::flux_and_jacobian(1.0, &h, &d);
    let (by_position, by_axis): (Matrix3<f64>, Matrix3<f64>) = (-field.d_flux_d_offset, field.d_flux_d_axis);
    let (pp, pa, aa) =
        (by_position.tr_mul(&by_position), by_position.tr_mul(&by_axis), by_axis.tr_mul(&by_axis));
    let ours = [pp[(0, 0)], pp[(0, 1)], pa[(0, 0)], pa[(0, 1)], aa[(0, 0)], aa[(0, 1)]];
    for i in 0..6 {
        assert!(
            (ours[i] / formulas[i] - 1.0).abs() < 1e-12,
            "element {i}: {} is not {}",
            ours[i],
            formulas[i]
        );
        assert!((ours[i] / study[i] - 1.0).abs() < 1e-8, "element {i}: {} is not {}", ours[i], study[i]);
    }
    let printed = [41134.706, -9584.229, 995.366, 4366.311, 4448.102];
    for i in 0..5 {
        assert!((ours[i] / printed[i] - 1.0).abs() > 0.1, "element {i}: the paper's print would be right");
    }
}

#[test]
fn published_sixteen_sensors_reach_two_millimetres_with_the_strength_that_pins_it() {
    let scale = STRENGTH_T_M3 / 1.212891e-8;
    let sigma =
        bound_at(&grid(4, 0.0), Vector3::new(0.0, 0.0, 0.25), Vector3::z(), true).position_sigma_m() * scale;
    assert!((sigma.x - 2e-3).abs() < 1e-9 && (sigma.y - 2e-3).abs() < 1e-9, "{sigma:?}");
}

#[test]
fn published_line_falls_with_the_root_of_n_and_the_grid_drifts() {
    let a_root_n = |sensors: Vec<Vector3<f64>>| {
        let root = (sensors.len() as f64).sqrt();
        bound_at(&sensors, Vector3::new(0.0, 0.0, 0.25), Vector3::z(), true).position_sigma_m().x * root
    };
    let (first, last) = (a_root_n(line(9)), a_root_n(line(100)));
    assert!((first / last - 1.0).abs() < 0.004, "line {first} {last}");
    let (first, last) = (a_root_n(grid(3, 0.0)), a_root_n(grid(32, 0.0)));
    assert!((first / last - 1.18).abs() < 0.01, "grid {first} {last}");
}

#[test]
fn published_grid_beats_line_for_b_and_the_norm_but_not_for_a() {
    let above = Vector3::new(0.0, 0.0, 0.25);
    let (g, l) =
        (bound_at(&grid(4, 0.0), above, Vector3::z(), true), bound_at(&line(16), above, Vector3::z(), true));
    assert!(g.position_sigma_m().y < l.position_sigma_m().y);
    assert!(g.position_norm_m() < l.position_norm_m());
    assert!(g.position_sigma_m().x > l.position_sigma_m().x, "the paper's claim would hold for a");
}

#[test]
fn published_c_never_crosses_a_with_three_axis_sensors() {
    for side in [4, 10] {
        for known in [true, false] {
            for step in 1..100 {
                let place = Vector3::new(0.0, 0.0, 0.05 * f64::from(step));
                let sigma = bound_at(&grid(side, 0.0), place, Vector3::z(), known).position_sigma_m();
                assert!(sigma.z < sigma.x, "crossing at {place:?}");
            }
        }
    }
}

#[test]
fn published_rotation_towards_y_lowers_a_and_b_and_raises_c() {
    let at = |degrees: f64, known| {
        let turn = degrees.to_radians();
        let axis = Vector3::new(0.0, turn.sin(), turn.cos());
        bound_at(&grid(4, 0.0), Vector3::new(0.0, 0.0, 0.25), axis, known).position_sigma_m()
    };
    for known in [true, false] {
        let (upright, flat) = (at(0.0, known), at(90.0, known));
        assert!(flat.x < upright.x && flat.y < upright.y && flat.z > upright.z);
    }
    // With unknown strength c of the flat magnet equals a of the upright one.
    assert!((at(90.0, false).z / at(0.0, false).x - 1.0).abs() < 1e-12);
    // With known strength c has its highest value on the way.
    assert!(at(60.0, true).z > at(90.0, true).z);
}

#[test]
fn published_two_facing_planes_beat_two_coincident_ones_beat_one() {
    for axis in [Vector3::z(), Vector3::new(1.0, 1.0, 1.0)] {
        for t in [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3] {
            let b = |case: &str, t: f64| {
                bound_at(&plane_case(case), Vector3::new(t, t, 0.3), axis, true).position_sigma_m().y
            };
            assert!((b("one", t) / b("case2", t) - 2.0_f64.sqrt()).abs() < 1e-12);
            let gain = b("case2", t) / b("case1", t);
            assert!((1.6..3.1).contains(&gain), "gain {gain} at {t}");
            assert!((b("case1", t) / b("case1", -t) - 1.0).abs() < 1e-11, "case 1 is symmetric");
        }
    }
}

#[test]
fn closed_form_a_singular_geometry_has_no_bound() {
    let source = FieldSource::Dipole { strength_t_m3: STRENGTH_T_M3 };
    let magnet = MagnetPose { position_world_m: Vector3::new(0.0, 0.0, 0.25), axis_world: Vector3::z() };
    // One triad: three readings for five unknowns.
    assert!(bound(&channels(&grid(2, 0.0)[..1]), &source, &magnet, SIGMA_TESLA, true).is_none());
    // Four triads at one place read the same three numbers.
    let same = vec![Vector3::new(0.1, 0.0, 0.0); 4];
    assert!(bound(&channels(&same), &source, &magnet, SIGMA_TESLA, true).is_none());
    // A magnet at a sensor has no finite field.
    let inside = MagnetPose { position_world_m: grid(4, 0.0)[0], ..magnet };
    assert!(bound(&channels(&grid(4, 0.0)), &source, &inside, SIGMA_TESLA, true).is_none());
}
