//! Closed forms of the figures.

use super::*;
use crate::segment::SegmentKey;
use crate::tract::{End, SegmentPoints, TractDraft};
use nalgebra::Point3;

fn tract(points_m: Vec<Point3<f64>>, radius_m: f64) -> (Tract, TractReport) {
    let key = SegmentKey::Jejunum;
    let radii_m = vec![radius_m; points_m.len()];
    let segment = SegmentPoints { key, points_m, radii_m, wall: key.default_wall(), source: String::new() };
    TractDraft {
        name: "test".to_owned(),
        segments: vec![segment],
        ends: (End::Closed, End::Exit),
        torso_half_extents_m: None,
        source: String::new(),
    }
    .build()
    .unwrap()
}

/// A helix of radius `r` and pitch `2πc` has curvature r / (r² + c²); smoothing by σ shrinks its radius by exp(-σ²ω²/2).
#[test]
fn closed_form_bends_of_a_smoothed_helix() {
    let (r, c) = (0.030, 0.012_f64);
    let points = (0..=400)
        .map(|i| f64::from(i) * 0.05)
        .map(|t| Point3::new(r * t.cos(), r * t.sin(), c * t))
        .collect();
    let (tract, report) = tract(points, 0.008);
    let statistics = TractStatistics::of(&tract, &report);
    let part = statistics.part("jejunum").unwrap();
    let omega = 1.0 / (r * r + c * c).sqrt();
    let shrunk = r * (-0.5 * (SMOOTHING_M * omega).powi(2)).exp();
    let curvature = shrunk / (shrunk * shrunk + c * c);
    assert!((part.bend_radius_median_m * curvature - 1.0).abs() < 2e-3, "{part:?} {}", 1.0 / curvature);
    assert!((part.length_m - 20.0 / omega).abs() < 1e-4);
    assert!((part.radius_median_m - 0.008).abs() < 1e-12 && (part.radius_p90_m - 0.008).abs() < 1e-12);
    // The tangent turns by 120 degrees where sin²(θ/2) r² = 3/4 (r² + c²): 64 mm on this helix (smoothed: longer), so never in 60.
    assert_eq!(part.sharp_turns, 0);
    // |x(a + t) - x(a)|² = 2 r² (1 - cos t) + c² t², least for t more than 60 mm on.
    let distance = |t: f64| (2.0 * r * r * (1.0 - t.cos()) + (c * t).powi(2)).sqrt();
    let least =
        (0..4000).map(|i| 0.06 * omega + f64::from(i) * 1e-3).map(distance).fold(f64::INFINITY, f64::min);
    assert!(
        (statistics.closest_approach_m - least).abs() < 1e-3,
        "{} {least}",
        statistics.closest_approach_m
    );
}

/// Three half circles of 14 mm radius, 44 mm long each, joined by straights of 60 mm: three turns, whatever is in between.
#[test]
fn closed_form_serpentine_has_a_turn_per_bend() {
    let mut points = Vec::new();
    for lane in 0..4 {
        let (x, up) = (f64::from(lane) * 0.028, lane % 2 == 0);
        for i in 0..=12 {
            let along = f64::from(i) * 0.005;
            points.push(Point3::new(x, if up { along } else { 0.06 - along }, 0.0));
        }
        if lane < 3 {
            for i in 1..12 {
                let angle = std::f64::consts::PI * (1.0 - f64::from(i) / 12.0);
                let y = if up { 0.06 + 0.014 * angle.sin() } else { -0.014 * angle.sin() };
                points.push(Point3::new(x + 0.014 + 0.014 * angle.cos(), y, 0.0));
            }
        }
    }
    let (tract, report) = tract(points, 0.008);
    let statistics = TractStatistics::of(&tract, &report);
    let part = statistics.part("jejunum").unwrap();
    assert_eq!(part.sharp_turns, 3);
    let bend = part.bend_radius_p5_m;
    assert!((0.011..0.0145).contains(&bend), "{bend}");
    assert!((statistics.closest_approach_m - 0.028).abs() < 1e-4, "{}", statistics.closest_approach_m);
    assert_eq!(statistics.overlaps, 0);
}

#[test]
fn closed_form_quantiles() {
    assert!((quantile(&[1.0, 2.0, 3.0, 4.0], 0.5) - 2.5).abs() < 1e-15);
    assert!((quantile(&[1.0, 2.0, 3.0], 0.9) - 2.8).abs() < 1e-15);
    assert!((quantile(&[7.0], 0.9) - 7.0).abs() < 1e-15);
}

#[test]
fn law_verdicts_name_parts_that_exist_and_say_outside() {
    for measured in MEASURED {
        assert!(PARTS.iter().any(|part| part.name == measured.part), "{}", measured.part);
        assert!(measured.low < measured.high && !measured.source.is_empty());
    }
    let (tract, report) = tract(vec![Point3::origin(), Point3::new(0.3, 0.0, 0.0)], 0.0075);
    let verdicts = TractStatistics::of(&tract, &report).verdicts();
    assert_eq!(verdicts.len(), 2);
    let length = verdicts.iter().find(|v| v.measured.quantity == Quantity::Length).unwrap();
    assert!(!length.inside() && length.to_string().contains("OUTSIDE"));
    let radius = verdicts.iter().find(|v| v.measured.quantity == Quantity::RadiusMedian).unwrap();
    assert!(radius.inside() && !radius.to_string().contains("OUTSIDE"));
}
