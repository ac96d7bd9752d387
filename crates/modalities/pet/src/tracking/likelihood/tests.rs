use super::super::membership;
use super::super::noise::{BlockNoise, LineNoise, SourceNoise};
use super::super::window::{Preparation, Rays, ToNarrow};
use super::*;
use crate::line::Line;
use crate::scanner::Scanner;
use lumenav_core::{Node, RandomStreams};
use nalgebra::{Isometry3, UnitQuaternion};
use rand::RngExt as _;
use std::path::Path;

fn noise() -> LineNoise {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models/scanners/allegro.toml");
    let scanner = Scanner::from_node(&Node::open(&path).unwrap()).unwrap();
    LineNoise::of_law(&scanner, &BlockNoise::reference(), &SourceNoise::default())
}

/// Markers within 12 mm of the capsule's origin.
fn markers(count: usize) -> Vec<Vector3<f64>> {
    let mut random = RandomStreams::new(3, 0, "narrow").stream("markers", 0);
    (0..count).map(|_| Vector3::from_fn(|_, _| 12e-3 * (2.0 * random.random::<f64>() - 1.0))).collect()
}

/// Lines that pass the markers at some millimetres, and one in four anywhere within 25 mm.
fn lines(count: usize, markers_m: &[Vector3<f64>], pose: &Isometry3<f64>) -> Vec<Line> {
    let mut random = RandomStreams::new(4, count as u64, "narrow").stream("lines", 0);
    (0..count)
        .map(|i| {
            let mut spread = |half: f64| Vector3::from_fn(|_, _| half * (2.0 * random.random::<f64>() - 1.0));
            let marker = pose.transform_point(&markers_m[i % markers_m.len()].into()).coords;
            let through =
                if i % 4 == 3 { pose.translation.vector + spread(0.025) } else { marker + spread(2e-3) };
            let direction = spread(1.0).normalize();
            Line { t_s: 0.0, ends_world_m: [through - direction * 0.42, through + direction * 0.44] }
        })
        .collect()
}

fn pose() -> Isometry3<f64> {
    Isometry3::from_parts(
        Vector3::new(0.07, -0.05, 0.03).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.7, 0.2)),
    )
}

/// Odd numbers of packs, few lines and many, one marker to as many as there may be: value to two millionths per line, gradient and
/// information to thousandths of a standard deviation.
#[test]
fn cross_single_precision_is_double_precision() {
    let noise = noise();
    for count in [5, 9, 28, 210, 2400] {
        for used in [1, 3, 5, MAX_MARKERS] {
            let (pose, markers_m) = (pose(), markers(used));
            let lines = lines(count, &markers_m, &pose);
            let mut window = Window::default();
            let how = Preparation::about(pose.translation.vector + Vector3::new(3e-3, -2e-3, 1e-3));
            window.prepare(&lines, &noise, &how, 3).unwrap();
            let likelihood = Likelihood::new(markers_m);
            let weights = Weights { shares: vec![1.0 / used as f64; used], background: 0.2 };
            let (mut double, mut narrow) = (Evaluation::default(), Evaluation::default());
            likelihood.evaluate(&window, &pose, &weights, &mut double);
            likelihood.evaluate_narrow(&window, &pose, &weights, &mut narrow);
            let what = format!("{count} lines, {used} markers");
            let off = (double.log_likelihood - narrow.log_likelihood).abs();
            assert!(off < 2e-6 * window.near() as f64, "{what}: {off}");
            let scale = double.information.diagonal().map(|v| v.abs().sqrt());
            for i in 0..6 {
                let off = (double.gradient[i] - narrow.gradient[i]).abs() / scale[i];
                assert!(off < 1e-3, "{what}: gradient {i}: {off}");
                for k in 0..6 {
                    let off = (double.information - narrow.information)[(i, k)].abs() / (scale[i] * scale[k]);
                    assert!(off < 1e-3, "{what}: information {i} {k}: {off}");
                }
            }
            for (a, b) in double.lines_of_marker.iter().zip(&narrow.lines_of_marker) {
                assert!((a - b).abs() < 1e-5 * count as f64, "{what}: {a} {b}");
            }
        }
    }
}

/// The sums of fuzzy memberships, against the formulas in double precision, line by line.
#[test]
fn closed_form_memberships_of_a_window() {
    for (count, used) in [(5, 3), (33, 3), (210, 3), (210, 5), (600, 12)] {
        let (pose, markers_m) = (pose(), markers(used));
        let lines = lines(count, &markers_m, &pose);
        let mut window = Window::default();
        window.load(&lines, &Preparation::about(pose.translation.vector), 3).unwrap();
        let mut narrow: Vec<Rays<Eight>> = Vec::new();
        ToNarrow { packs: &window.rays, narrow: &mut narrow }.run();
        let places_m: Vec<_> = markers_m.iter().map(|m| pose.rotation * m).collect();
        let shares: Vec<_> = (0..used).map(|k| 1.0 + k as f64).collect();
        let total: f64 = shares.iter().sum();
        let shares: Vec<_> = shares.iter().map(|share| share / total).collect();
        let mut found = vec![membership::Share::default(); used];
        let cost_m2 = membership::pass(&narrow, &places_m, &shares, &mut found);
        let mut wanted = vec![membership::Share::default(); used];
        let mut wanted_cost_m2 = 0.0;
        for line in &lines {
            let n = (line.ends_world_m[1] - line.ends_world_m[0]).normalize();
            let from = line.ends_world_m[0] - pose.translation.vector;
            let foot = from - n * n.dot(&from);
            let distance_m = |at: &Vector3<f64>| {
                let v = foot - at;
                (v - n * n.dot(&v)).norm().max(1e-6)
            };
            let own =
                |k: usize| shares[k] * distance_m(&places_m[k]).powf(-2.0 / (membership::FUZZINESS - 1.0));
            let all: f64 = (0..used).map(own).sum();
            for k in 0..used {
                if distance_m(&places_m[k]) >= membership::REACH_M {
                    continue;
                }
                let u = own(k) / all;
                let w = u.powf(membership::FUZZINESS);
                wanted[k].members += u;
                wanted[k].weight += w;
                wanted[k].side_m += foot * w;
                wanted[k].matrix += (Matrix3::identity() - n * n.transpose()) * w;
                wanted_cost_m2 += w * distance_m(&places_m[k]).powi(2);
            }
        }
        let what = format!("{count} lines, {used} markers");
        assert!((cost_m2 / wanted_cost_m2 - 1.0).abs() < 1e-4, "{what}: {cost_m2} {wanted_cost_m2}");
        for (a, b) in found.iter().zip(&wanted) {
            let scale = 1e-4 * (b.weight + 1e-3);
            assert!((a.members - b.members).abs() < scale && (a.weight - b.weight).abs() < scale, "{what}");
            assert!((a.side_m - b.side_m).amax() < 0.02 * scale, "{what}: {} {}", a.side_m, b.side_m);
            assert!((a.matrix - b.matrix).amax() < scale, "{what}: {} {}", a.matrix, b.matrix);
        }
    }
}
