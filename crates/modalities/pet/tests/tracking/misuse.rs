//! What no tracker may turn into a pose. (Lines carry no labels: [`law_a_line_tells_nothing_but_when_and_where`].)

use super::support::{Ends, Generator, helix, noise_of, scanner, triangle};
use lumenav_pet::Line;
use lumenav_pet::tracking::{
    BlockNoise, ClassicOptions, Failure, Fcm, Mixture, MixtureOptions, Rigid, Tracker,
};
use nalgebra::Vector3;

fn trackers() -> Vec<Box<dyn Tracker>> {
    let (set, noise) = (triangle(), noise_of(&scanner("reduced")));
    vec![
        Box::new(Fcm::new(&set, ClassicOptions::default())),
        Box::new(Rigid::new(&set, ClassicOptions::default())),
        Box::new(Mixture::new(&set, noise, MixtureOptions::default())),
    ]
}

fn generator(seed: u64) -> Generator {
    Generator::new(scanner("reduced"), Ends::Law(BlockNoise::reference()), triangle(), seed)
}

#[test]
fn law_a_line_tells_nothing_but_when_and_where() {
    let line = Line { t_s: 0.0, ends_world_m: [Vector3::zeros(), Vector3::x()] };
    // A further field would not compile here: what a line came from is known to the world alone.
    let Line { t_s: _, ends_world_m: _ } = line;
}

#[test]
fn law_two_lines_are_too_few() {
    let (lines, _) = generator(3).window(&|t| helix(t, 1.0), 0.0, 2, 0);
    for mut tracker in trackers() {
        let failure = tracker.track(&lines, None).unwrap_err();
        assert!(matches!(failure, Failure::TooFewLines { usable: 2, .. }), "{}: {failure}", tracker.name());
    }
    for mut tracker in trackers() {
        assert!(matches!(tracker.track(&[], None), Err(Failure::TooFewLines { given: 0, .. })));
    }
}

#[test]
fn law_a_thousand_parallel_lines_fix_no_point() {
    let line = |i: usize| {
        let across = Vector3::new((i % 40) as f64 * 1e-3, (i / 40) as f64 * 1e-3, 0.0);
        Line { t_s: 0.0, ends_world_m: [across - Vector3::z() * 0.4, across + Vector3::z() * 0.4] }
    };
    let lines: Vec<Line> = (0..1000).map(line).collect();
    for mut tracker in trackers() {
        let failure = tracker.track(&lines, None).unwrap_err();
        assert!(matches!(failure, Failure::Parallel { .. }), "{}: {failure}", tracker.name());
    }
}

#[test]
fn law_background_alone_gives_no_pose() {
    for seed in 1..=5 {
        for mut tracker in trackers() {
            let mut generator = generator(seed);
            for w in 0..20 {
                let (lines, _) = generator.window(&|t| helix(t, 1.0), 0.05 * f64::from(w), 0, 284);
                let answer = tracker.track(&lines, None);
                assert!(answer.is_err(), "{} seed {seed} window {w}: {answer:?}", tracker.name());
            }
        }
    }
}

/// The capsule is carried out of sight: a tracker that knew it well must say that it is gone, not go on claiming a place.
#[test]
fn law_a_known_capsule_that_leaves_is_reported_lost() {
    for mut tracker in trackers() {
        let mut generator = generator(9);
        for w in 0..12 {
            let lines = generator.poisson_window(&|t| helix(t, 1.0), 0.05 * f64::from(w), 284.0, 0.819);
            let _ = tracker.track(&lines, None);
        }
        for w in 12..32 {
            let (lines, _) = generator.window(&|t| helix(t, 1.0), 0.05 * f64::from(w), 0, 284);
            let answer = tracker.track(&lines, None);
            assert!(answer.is_err(), "{} window {w}: {answer:?}", tracker.name());
        }
    }
}
