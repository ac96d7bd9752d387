//! A tracker that is led to a wrong place by a prediction, and by enough lines there to hold it.

use super::support::{Ends, Generator, WINDOW_S, helix, noise_of, scanner, triangle};
use lumenav_core::PriorUse;
use lumenav_pet::tracking::mixture::{STACK, TEST_EVERY};
use lumenav_pet::tracking::{Failure, Mixture, MixtureOptions, Prior, Tracker};
use nalgebra::{Matrix6, Translation3, Vector3};

/// Lines of a window from the capsule, from the place that the prediction points to, and from nowhere. So few of the capsule's that a window
/// by itself often leaves two attitudes open.
const LINES: [usize; 3] = [28, 14, 6];

/// At the first test the search finds the capsule, at once or, where its attitude is ambiguous, after a doubt of some windows in which nothing
/// is said; whatever the prediction goes on saying.
#[test]
fn law_a_place_that_is_clearly_beaten_is_doubted_until_the_capsule_is_found() {
    let scanner = scanner("reduced");
    let capsule = helix(0.0, 1.0);
    let decoy = Translation3::new(5e-3, 45e-3, -5e-3) * capsule;
    let mut doubts = 0;
    for seed in 201..=224 {
        let mut generator = Generator::new(scanner.clone(), Ends::physics(&scanner), triangle(), seed);
        let mut tracker = Mixture::new(&triangle(), noise_of(&scanner), MixtureOptions::default());
        let prior = Prior {
            world_from_capsule: decoy,
            covariance: Matrix6::identity() * 1e-8,
            velocity_world_m_s: Vector3::zeros(),
            how: PriorUse::StartOnly,
        };
        let first_test = TEST_EVERY as usize - 1;
        let mut found = false;
        for w in 0..first_test + 2 * STACK {
            let start_s = w as f64 * WINDOW_S;
            let mut lines = generator.window(&|_| capsule, start_s, LINES[0], LINES[2]).0;
            lines.extend(generator.window(&|_| decoy, start_s, LINES[1], 0).0);
            let answer = tracker.track(&lines, (!found).then_some(&prior));
            match answer {
                Ok(tracked) => {
                    let place_m = tracked.world_from_capsule.translation.vector;
                    let is_decoy = (place_m - decoy.translation.vector).norm() < 15e-3;
                    // What a test has beaten is never answered again.
                    assert!(!is_decoy || (w < first_test && !found), "seed {seed}, window {w}");
                    found |= !is_decoy;
                }
                Err(Failure::Doubted { .. }) => doubts += 1,
                // So few lines may not be enough for a pose; the next window tells.
                Err(_) => {}
            }
        }
        assert!(found, "seed {seed}: never found");
    }
    println!("{doubts} windows in doubt");
    assert!(doubts > 0, "no window was ambiguous: the test has lost its point");
}
