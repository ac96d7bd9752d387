use super::*;
use std::f64::consts::{PI, TAU};

fn arc_points(radius: f64, angle: f64, count: u32) -> Vec<Point3<f64>> {
    (0..=count)
        .map(|i| angle * f64::from(i) / f64::from(count))
        .map(|a| Point3::new(radius * a.cos(), radius * a.sin(), 0.0))
        .collect()
}

fn helix_points(radius: f64, pitch: f64, turns: f64, count: u32) -> Vec<Point3<f64>> {
    (0..=count)
        .map(|i| TAU * turns * f64::from(i) / f64::from(count))
        .map(|a| Point3::new(radius * a.cos(), radius * a.sin(), pitch * a / TAU))
        .collect()
}

/// A folded line like a bowel, from sines.
fn folded() -> CentreLine {
    let points: Vec<Point3<f64>> = (0..120)
        .map(|i| 0.01 * f64::from(i))
        .map(|t| {
            Point3::new(0.06 * (9.0 * t).sin(), 0.03 * (4.0 * t).cos(), 0.12 * t + 0.02 * (17.0 * t).cos())
        })
        .collect();
    CentreLine::through(&points).unwrap()
}

#[test]
fn closed_form_circle_length_curvature_and_frame_without_twist() {
    let radius = 0.03;
    let line = CentreLine::through(&arc_points(radius, 1.5 * PI, 200)).unwrap();
    assert!((line.length_m() - 1.5 * PI * radius).abs() < 1e-9, "length {}", line.length_m());
    let out_of_plane = line.station(0.0).normal.z;
    for i in 0..=1000 {
        let s = line.length_m() * f64::from(i) / 1000.0;
        let station = line.station(s);
        let angle = s / radius;
        let exact = Point3::new(radius * angle.cos(), radius * angle.sin(), 0.0);
        assert!((station.position_m - exact).norm() < 2e-9);
        assert!((station.curvature_per_m - 1.0 / radius).abs() < 1e-2 / radius, "at {s}");
        // In a plane the rotation-minimising frame keeps its angle to the plane.
        assert!((station.normal.z - out_of_plane).abs() < 1e-12, "twist at {s}");
    }
}

#[test]
fn closed_form_helix_length_and_twist() {
    // Arc length sqrt((2 pi r)^2 + p^2) per turn. Against Frenet's frame the rotation-minimising one turns by the integral
    // of the torsion, -tau s, with tau = h / (r^2 + h^2), h = p / 2 pi.
    let (radius, pitch, turns) = (0.04, 0.03, 3.0);
    let line = CentreLine::through(&helix_points(radius, pitch, turns, 600)).unwrap();
    let exact = turns * (TAU * radius).hypot(pitch);
    assert!((line.length_m() - exact).abs() < 1e-8, "length {} not {exact}", line.length_m());
    let h = pitch / TAU;
    let torsion = h / (radius * radius + h * h);
    let angle_to_frenet = |s: f64| {
        let station = line.station(s);
        let turn = s / radius.hypot(h);
        let frenet_normal = Vector3::new(-turn.cos(), -turn.sin(), 0.0);
        station.normal.dot(&station.tangent.cross(&frenet_normal)).atan2(station.normal.dot(&frenet_normal))
    };
    let start = angle_to_frenet(0.02);
    for i in 1..100 {
        let s = 0.02 + (exact - 0.04) * f64::from(i) / 100.0;
        let expected = start - torsion * (s - 0.02);
        let difference = (angle_to_frenet(s) - expected).rem_euclid(TAU);
        assert!(difference.min(TAU - difference) < 1e-6, "at {s}: {difference}");
    }
}

#[test]
fn closed_form_straight_line_through_uneven_points() {
    let direction = Vector3::new(1.0, -2.0, 0.5).normalize();
    let points: Vec<Point3<f64>> =
        [0.0, 0.001, 0.13, 0.14, 0.5].iter().map(|d| Point3::from(direction * *d)).collect();
    let line = CentreLine::through(&points).unwrap();
    assert!((line.length_m() - 0.5).abs() < 1e-13);
    for s in [0.0, 0.0005, 0.13, 0.3, 0.5] {
        let station = line.station(s);
        assert!((station.position_m.coords - direction * s).norm() < 1e-14);
        assert!(station.curvature_per_m < 1e-9);
    }
    let off = Point3::from(direction * 0.21 + station_normal(&line) * 0.03);
    let foot = line.project_near(&off, 0.0);
    assert!((foot.arc_length_m - 0.21).abs() < 1e-12 && (foot.distance_m - 0.03).abs() < 1e-14);
}

fn station_normal(line: &CentreLine) -> Vector3<f64> {
    line.station(0.0).normal
}

#[test]
fn closed_form_projection_of_points_off_a_circle() {
    let radius = 0.03;
    let line = CentreLine::through(&arc_points(radius, 1.5 * PI, 400)).unwrap();
    for i in 1..40 {
        let angle = 1.4 * PI * f64::from(i) / 40.0;
        for (out, up) in [(0.005, 0.0), (-0.012, 0.004), (0.02, -0.01)] {
            let point = Point3::new((radius + out) * angle.cos(), (radius + out) * angle.sin(), up);
            for hint in [radius * angle - 0.02, radius * angle, radius * angle + 0.02] {
                let foot = line.project_near(&point, hint);
                assert!((foot.arc_length_m - radius * angle).abs() < 3e-9, "angle {angle} out {out}");
                assert!((foot.distance_m - out.hypot(up)).abs() < 3e-9);
            }
            assert_eq!(line.nearest(&point, 1).len(), 1);
            assert!((line.nearest(&point, 1)[0].arc_length_m - radius * angle).abs() < 3e-9);
        }
    }
}

#[test]
fn law_a_quick_foot_is_the_projection() {
    // In folds with bend radii down to some 5 mm; from good hints, and from those a loop of bowel may give.
    let line = folded();
    let (mut worst_m, mut worst_turn, mut seen) = (0.0_f64, 0.0_f64, 0);
    for i in 1..2000 {
        let s = line.length_m() * f64::from(i) / 2000.0;
        let station = line.station(s);
        let side =
            station.normal * (0.9 * f64::from(i)).cos() + station.binormal * (0.9 * f64::from(i)).sin();
        let out_m = (0.5 / station.curvature_per_m.max(1.0)).min(0.005);
        let point = station.position_m + side * out_m;
        for off_m in [0.0, 1e-7, -3e-6, 2e-5, -1e-4, 1e-3] {
            let (exact, quick) = (line.project_near(&point, s + off_m), line.quick_foot(&point, s + off_m));
            worst_m = worst_m
                .max((quick.arc_length_m - exact.arc_length_m).abs())
                .max((quick.position_m - exact.station.position_m).norm());
            worst_turn = worst_turn.max((quick.tangent - exact.station.tangent).norm());
            seen += 1;
        }
    }
    println!("{seen} feet: {worst_m:e} m, {worst_turn:e} rad");
    assert!(worst_m < 2e-8 && worst_turn < 1e-5, "{worst_m:e} m, {worst_turn:e} rad");
    // Beyond the ends the foot is the end.
    let end = line.station(line.length_m());
    let beyond = line.quick_foot(&(end.position_m + end.tangent * 0.01), line.length_m());
    assert!((beyond.arc_length_m - line.length_m()).abs() < 1e-9);
    assert!(line.quick_foot(&Point3::new(f64::NAN, 0.0, 0.0), 0.1).arc_length_m.is_finite());
}

#[test]
fn law_arc_length_is_the_integral_of_speed() {
    // Position differences by s are unit vectors, and chords of 10 um add up to the length.
    let line = folded();
    let n = 200_000;
    let mut sum = 0.0;
    let mut last = line.station(0.0).position_m;
    for i in 1..=n {
        let next = line.station(line.length_m() * f64::from(i) / f64::from(n)).position_m;
        let step = (next - last).norm();
        assert!((step / (line.length_m() / f64::from(n)) - 1.0).abs() < 1e-5);
        sum += step;
        last = next;
    }
    assert!((sum - line.length_m()).abs() < 1e-8 * line.length_m());
    assert!(line.knots_m().windows(2).all(|pair| pair[0] < pair[1]));
}

#[test]
fn law_the_line_is_twice_differentiable_across_knots() {
    let line = folded();
    let knots = line.knots_m().to_vec();
    for knot in &knots[1..knots.len() - 1] {
        let (a, b) = (line.station(knot - 1e-10), line.station(knot + 1e-10));
        // A step of 2e-10 m turns tangent and normal by no more than the curvature says.
        let turn = 2.1e-10 * a.curvature_per_m + 1e-11;
        assert!((a.tangent - b.tangent).norm() < turn);
        assert!((a.normal - b.normal).norm() < turn);
        let jump = (a.curvature_per_m - b.curvature_per_m).abs();
        assert!(jump < 1e-5 * a.curvature_per_m.max(1.0), "curvature jumps by {jump} at {knot}");
    }
}

#[test]
fn law_the_frame_is_orthonormal_right_handed_and_does_not_spin() {
    let line = folded();
    let h = 1e-6;
    for i in 1..5000 {
        let s = line.length_m() * f64::from(i) / 5000.0;
        let station = line.station(s);
        let frame = nalgebra::Matrix3::from_columns(&[station.tangent, station.normal, station.binormal]);
        assert!((frame.transpose() * frame - nalgebra::Matrix3::identity()).abs().max() < 1e-12);
        assert!((frame.determinant() - 1.0).abs() < 1e-12);
        // Rotation minimising: the derivative of the normal has no part along the binormal.
        let (before, after) = (line.station(s - h), line.station(s + h));
        let spin = (after.normal - before.normal).dot(&station.binormal) / (2.0 * h);
        assert!(spin.abs() < 1e-3, "spin {spin} rad/m at {s}");
    }
}

#[test]
fn law_projection_inverts_station_plus_offset() {
    let line = folded();
    for i in 1..2000 {
        let s = line.length_m() * f64::from(i) / 2000.0;
        let station = line.station(s);
        let reach = (0.4 / station.curvature_per_m.max(1.0)).min(0.006);
        let angle = 0.7 * f64::from(i);
        let point =
            station.position_m + (station.normal * angle.cos() + station.binormal * angle.sin()) * reach;
        for hint in [s - 0.002, s, s + 0.002] {
            let foot = line.project_near(&point, hint);
            assert!((foot.arc_length_m - s).abs() < 1e-9, "s {s} hint {hint} found {}", foot.arc_length_m);
            assert!((foot.distance_m - reach).abs() < 1e-12);
        }
        let all = line.nearest(&point, 4);
        assert!(all.iter().any(|foot| (foot.arc_length_m - s).abs() < 1e-9));
        assert!(all.windows(2).all(|pair| pair[0].distance_m <= pair[1].distance_m));
    }
}

#[test]
fn cross_global_nearest_equals_brute_force() {
    let line = folded();
    for i in 0..60 {
        let t = f64::from(i);
        let point =
            Point3::new(0.08 * (1.3 * t).sin(), 0.05 * (2.1 * t).cos(), 0.08 + 0.09 * (0.7 * t).sin());
        let distance = |s: f64| (line.station(s).position_m - point).norm();
        let n = 60_000;
        let samples: Vec<f64> =
            (0..=n).map(|k| distance(line.length_m() * f64::from(k) / f64::from(n))).collect();
        let mut minima: Vec<f64> = (0..samples.len())
            .filter(|k| {
                let left = k.checked_sub(1).is_none_or(|l| samples[l] > samples[*k]);
                let right = samples.get(k + 1).is_none_or(|r| *r >= samples[*k]);
                left && right
            })
            .map(|k| samples[k])
            .collect();
        minima.sort_by(f64::total_cmp);
        let found = line.nearest(&point, minima.len() + 3);
        assert_eq!(found.len(), minima.len());
        for (foot, brute) in found.iter().zip(&minima) {
            assert!((foot.distance_m - brute).abs() < 1e-7, "{} not {brute}", foot.distance_m);
        }
        let three = line.nearest(&point, 3);
        assert_eq!(three[..], found[..3.min(found.len())]);
    }
}

#[test]
fn law_arc_lengths_outside_are_clamped_and_never_nan() {
    let line = folded();
    for s in [-1.0, f64::NAN, f64::NEG_INFINITY] {
        assert_eq!(line.station(s), line.station(0.0));
    }
    assert_eq!(line.station(f64::INFINITY), line.station(line.length_m()));
    let far = Point3::new(50.0, -70.0, 1e6);
    assert!(line.project_near(&far, f64::NAN).distance_m.is_finite());
    assert!(line.project_near(&Point3::new(f64::NAN, 0.0, 0.0), 0.1).arc_length_m.is_finite());
    assert!(line.nearest(&Point3::new(f64::NAN, 0.0, 0.0), 2).is_empty());
    assert!(line.nearest(&far, 0).is_empty());
}

#[test]
fn law_bad_points_are_refused() {
    let p = |x: f64| Point3::new(x, 0.0, 0.0);
    assert!(matches!(CentreLine::through(&[p(0.0)]), Err(AnatomyError::TooFewPoints { count: 1 })));
    assert!(matches!(
        CentreLine::through(&[p(0.0), p(f64::NAN)]),
        Err(AnatomyError::PointNotFinite { index: 1 })
    ));
    assert!(matches!(CentreLine::through(&[p(0.0), p(1e300)]), Err(AnatomyError::PointTooFar { .. })));
    assert!(matches!(
        CentreLine::through(&[p(0.0), p(0.1), p(0.1)]),
        Err(AnatomyError::RepeatedPoint { index: 2, .. })
    ));
    assert!(matches!(CentreLine::through(&[p(0.0), p(0.1), p(0.01)]), Err(AnatomyError::Cusp { .. })));
    let zigzag: Vec<Point3<f64>> = (0..5).map(|i| p(if i % 2 == 0 { 0.0 } else { 90.0 })).collect();
    assert!(matches!(CentreLine::through(&zigzag), Err(AnatomyError::TooLong { .. })));
}
