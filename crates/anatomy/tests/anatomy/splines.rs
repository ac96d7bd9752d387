//! Our splines against SciPy's (`tests/cross/splines.py`).

use lumenav_anatomy::{CentreLine, RadiusProfile};
use nalgebra::Point3;

const EXPECTED: &str = include_str!("../cross/splines.csv");

fn rows(kind: &str) -> Vec<[f64; 4]> {
    EXPECTED
        .lines()
        .filter_map(|line| line.strip_prefix(kind)?.strip_prefix(','))
        .map(|line| {
            let values: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            [values[0], values[1], values[2], values[3]]
        })
        .collect()
}

#[test]
fn cross_centre_line_runs_through_scipys_not_a_knot_spline() {
    let points = [
        [0.00, 0.00, 0.00],
        [0.01, 0.004, 0.001],
        [0.016, 0.013, 0.004],
        [0.014, 0.026, 0.003],
        [0.001, 0.031, -0.006],
        [-0.012, 0.024, -0.010],
        [-0.015, 0.012, -0.008],
    ]
    .map(Point3::from);
    let line = CentreLine::through(&points).unwrap();
    let expected = rows("spline");
    assert_eq!(expected.len(), 29);
    for [_, x, y, z] in expected {
        let distance = line.nearest(&Point3::new(x, y, z), 1)[0].distance_m;
        assert!(distance < 1e-15, "SciPy's point ({x}, {y}, {z}) is {distance} m off");
    }
}

#[test]
fn cross_radius_profile_equals_scipys_pchip() {
    let entries = [(0.0, 0.010), (0.01, 0.020), (0.03, 0.022), (0.04, 0.015), (0.07, 0.016)];
    let profile = RadiusProfile::through(&entries).unwrap();
    let expected = rows("pchip");
    assert_eq!(expected.len(), 27);
    for [s, radius, slope, _] in expected {
        assert!((profile.radius_m(s) - radius).abs() < 1e-16, "radius at {s}");
        assert!((profile.slope(s) - slope).abs() < 1e-13, "slope at {s}");
    }
}
