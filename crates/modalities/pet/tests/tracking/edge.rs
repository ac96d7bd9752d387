//! A capsule at the axial end of the scanner, where one marker is seen by twice as many pairs of crystals as the next.

use super::support::{
    Ends, Generator, WINDOW_S, capsule, marker_errors, model, noise_of, noise_of_drawn, scanner, scintillator,
};
use lumenav_core::Node;
use lumenav_pet::tracking::{Mixture, MixtureOptions, Tracker};
use lumenav_pet::{Line, Scanner};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::fmt::Write as _;
use std::path::Path;

const LINES: usize = 90;
const BACKGROUND: usize = 30;
const WINDOWS: usize = 20;

/// Lengthwise in the scanner, 13 mm from the end of the blocks: the markers lie at 66, 78 and 81 mm of 91.
fn at_the_end() -> Isometry3<f64> {
    let along = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
    Isometry3::from_parts(Translation3::new(5e-3, -8e-3, 78e-3), along)
}

#[test]
fn law_markers_are_as_bright_as_the_scanner_sees_them() {
    let (set, scanner, pose) = (capsule("pet-scalene"), scanner("reduced"), at_the_end());
    let (mut counted, mut told, mut error_m, mut given) = ([0.0; 3], [0.0; 3], 0.0, 0);
    for seed in 301..=306 {
        let mut generator = Generator::new(scanner.clone(), Ends::physics(&scanner), set.clone(), seed);
        let mut tracker = Mixture::new(&set, noise_of_drawn(&scanner), MixtureOptions::default());
        for w in 0..WINDOWS {
            let (lines, origins) = generator.window(&|_| pose, w as f64 * WINDOW_S, LINES, BACKGROUND);
            let Ok(tracked) = tracker.track(&lines, None) else { continue };
            for marker in origins.into_iter().flatten() {
                counted[marker] += 1.0 / LINES as f64;
            }
            (0..3).for_each(|j| told[j] += tracked.shares[j]);
            error_m += marker_errors(&tracked.markers_world_m, &pose, &set).0;
            given += 1;
        }
    }
    let n = f64::from(given);
    let (counted, told, error_mm) = (counted.map(|c| c / n), told.map(|t| t / n), 1e3 * error_m / n);
    println!("figure: {given} windows, shares {counted:.3?}, told {told:.3?}, mean error {error_mm:.3} mm");
    assert!(given as usize > 6 * WINDOWS - 12, "{given} windows");
    assert!(counted[0] > 0.45, "the place is no edge: {counted:?}");
    for (c, t) in counted.iter().zip(told) {
        assert!((c - t).abs() < 0.03, "{counted:?} {told:?}");
    }
    assert!(error_mm < 1.1, "{error_mm} mm");
}

/// Four sides of two blocks each, one above the other, both tilted towards the middle: which block tells an end hangs on its height.
fn tilted() -> Scanner {
    let (sine, cosine) = 12_f64.to_radians().sin_cos();
    let mut text = std::fs::read_to_string(model("scanners", "reduced").file()).unwrap();
    let (ring, crystals) = (text.find("[ring]").unwrap(), text.find("[crystals]").unwrap());
    text.replace_range(ring..crystals, "");
    let pairs = text.find("[coincidence]").unwrap();
    text.truncate(pairs);
    for angle in [0.0, 90.0, 180.0, 270.0_f64] {
        let (x, y) = angle.to_radians().sin_cos();
        for up in [-1.0, 1.0] {
            let _ = writeln!(
                text,
                "[[block]]\ncentre_mm = [{:.6}, {:.6}, {:.6}]\noutward = [{:.9}, {:.9}, {:.9}]\ntangential = [{y:.9}, {:.9}, 0.0]",
                440.0 * x,
                440.0 * y,
                95.0 * up,
                cosine * x,
                cosine * y,
                sine * up,
                -x,
            );
        }
    }
    let scanner = Scanner::from_node(&Node::parse_text(&text, "tilted.toml", Path::new(""), &[]).unwrap());
    scanner.unwrap().with_interaction_depth(&scintillator(&super::support::scanner("reduced")))
}

/// A bed that has moved the scanner by some way moves what it sees by the same.
#[test]
fn law_a_moved_scanner_sees_what_it_saw() {
    for scanner in [scanner("reduced"), tilted()] {
        sees_what_it_saw_when_moved(&scanner);
    }
}

fn sees_what_it_saw_when_moved(scanner: &Scanner) {
    let (set, pose) = (capsule("pet-scalene"), at_the_end());
    let way = Vector3::new(0.0, 0.0, 0.15);
    let mut generator = Generator::new(scanner.clone(), Ends::physics(scanner), set.clone(), 311);
    let (mut here, mut moved) =
        [(); 2].map(|()| Mixture::new(&set, noise_of(scanner), MixtureOptions::default())).into();
    moved.scanner_at(&way);
    let mut compared = 0;
    for w in 0..4 {
        let lines = generator.window(&|_| pose, f64::from(w) * WINDOW_S, LINES, BACKGROUND).0;
        let shifted: Vec<Line> = lines
            .iter()
            .map(|line| Line { ends_world_m: line.ends_world_m.map(|end| end + way), ..*line })
            .collect();
        let (Ok(one), Ok(other)) = (here.track(&lines, None), moved.track(&shifted, None)) else { continue };
        for (a, b) in one.shares.iter().zip(&other.shares) {
            assert!((a - b).abs() < 1e-6, "{:?} {:?}", one.shares, other.shares);
        }
        let off = other.world_from_capsule.translation.vector - one.world_from_capsule.translation.vector;
        assert!((off - way).norm() < 1e-6, "{off}");
        let differs = (other.covariance - one.covariance).norm() / one.covariance.norm();
        assert!(differs < 1e-4, "{}: {differs}", scanner.name);
        compared += 1;
    }
    assert!(compared >= 3, "{compared} of 4 windows have a pose");
}
