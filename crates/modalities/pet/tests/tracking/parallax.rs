//! Where a source beside the axis is seen: the depth at which the ends of lines are told must not move it.

use super::support::{Ends, Generator, scanner, set};
use lumenav_pet::{Line, Scanner};
use nalgebra::{Isometry3, Matrix3, Vector3};

/// Where the source stands, mm from the axis: as far out as a colon's.
const BESIDE_MM: f64 = 57.0;

/// The point that most lines pass: `Σ w (1 - n nᵀ) (c - p) = 0` with `w = 1/(1 + d²/s²)²`, so that photons that scattered from crystal to
/// crystal, which leave a block at its edge and not at its middle, do not count.
fn point_m(lines: &[Line]) -> Vector3<f64> {
    const S_M: f64 = 2.5e-3;
    let mut point = Vector3::new(1e-3 * BESIDE_MM, 0.0, 0.0);
    for _ in 0..30 {
        let (mut squares, mut sums) = (Matrix3::zeros(), Vector3::zeros());
        for line in lines {
            let [a, b] = line.ends_world_m;
            let n = (b - a).normalize();
            let across = Matrix3::identity() - n * n.transpose();
            let squared = (across * (a - point)).norm_squared();
            let weight = (1.0 + squared / (S_M * S_M)).powi(-2);
            squares += across * weight;
            sums += across * a * weight;
        }
        point = squares.try_inverse().unwrap() * sums;
    }
    point
}

/// How far out a source is seen, mm; standard deviation 0.015 mm.
fn outwards_mm(scanner: &Scanner) -> f64 {
    let mut generator =
        Generator::new(scanner.clone(), Ends::physics(scanner), set(&[[BESIDE_MM, 0.0, 0.0]]), 41);
    let (lines, _) = generator.window(&|_| Isometry3::identity(), 0.0, 40_000, 0);
    1e3 * point_m(&lines).x - BESIDE_MM
}

#[test]
fn law_ends_told_at_the_mean_depth_see_a_source_where_it_is() {
    // Not of the reduced scanner: its eight blocks see a source there from so few sides that the crystals' grid itself moves it.
    for name in ["allegro", "tf64"] {
        let scanner = scanner(name);
        let depth_mm = 1e3 * scanner.told_depth_m();
        let bias_mm = outwards_mm(&scanner);
        let mut middle = scanner;
        middle.interaction_depth_m = Some(0.5 * middle.grid.depth_m);
        let at_middle_mm = outwards_mm(&middle);
        println!(
            "figure: {name}: told at {depth_mm:.2} mm {bias_mm:+.3} mm, at the middle {at_middle_mm:+.3} mm"
        );
        assert!(bias_mm.abs() < 0.07, "{name}: {bias_mm}");
        // So the test sees what it is for.
        assert!(at_middle_mm > bias_mm + 0.05, "{name}: {at_middle_mm}");
    }
}
