//! What no tracker may turn into a pose. (Lines carry no labels: [`law_a_line_tells_nothing_but_when_and_where`].)

use super::support::{Ends, Generator, helix, noise_of, scanner, triangle};
use lumenav_core::time::nanoseconds;
use lumenav_core::{FixKind, FrontEnd, Outcome, PoseEstimate, PosePrior, Reading, SimTime};
use lumenav_pet::Line;
use lumenav_pet::config::Output;
use lumenav_pet::front_end::PetFrontEnd;
use lumenav_pet::model::LinesModel;
use lumenav_pet::tracking::{
    BlockNoise, Budget, ClassicOptions, Failure, Fcm, Likelihood, Mixture, MixtureOptions, Rigid, Tracker,
    Weights,
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

#[test]
fn law_background_alone_gives_no_start_from_several_windows() {
    for seed in 11..=15 {
        let mut generator = generator(seed);
        let options = MixtureOptions { start_windows: 5, ..MixtureOptions::default() };
        let mut tracker = Mixture::new(&triangle(), noise_of(&scanner("reduced")), options);
        for (w, count) in [284, 284, 284, 284, 284, 54, 54, 54, 54, 54, 54, 54].into_iter().enumerate() {
            let (lines, _) = generator.window(&|t| helix(t, 1.0), 0.05 * w as f64, 0, count);
            let answer = tracker.track(&lines, None);
            assert!(answer.is_err(), "seed {seed} window {w}: {answer:?}");
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

/// Lines handed to a filter that knows the pose: a window of background must not be taken for a measurement of it.
#[test]
fn law_background_is_not_handed_to_a_filter_as_lines_of_the_capsule() {
    let (set, scanner) = (triangle(), scanner("reduced"));
    let noise = std::sync::Arc::new(noise_of(&scanner));
    let tracker = Box::new(Mixture::new(&set, (*noise).clone(), MixtureOptions::default()));
    let model = LinesModel {
        likelihood: std::sync::Arc::new(Likelihood::new(set.positions_capsule_m())),
        noise,
        window: std::sync::Arc::default(),
        weights: Weights { shares: vec![1.0 / 3.0; 3], background: 0.1 },
    };
    let mut front_end = PetFrontEnd::new("scanner".into(), set, Output::Lines, tracker, model);
    let mut generator = generator(31);
    let mut handed = [0, 0];
    for w in 0..220_u64 {
        let start_s = 0.05 * w as f64;
        let trues = if w < 20 { 233 } else { 0 };
        let (lines, _) = generator.window(&|t| helix(t, 1.0), start_s, trues, 284 - trues);
        let (start, end) = (SimTime(nanoseconds(start_s)), SimTime(nanoseconds(start_s + 0.05)));
        let reading = Reading {
            sensor: "scanner".into(),
            sequence: w,
            interval: (start, end),
            arrival: end,
            known_poses: std::collections::BTreeMap::new(),
            payload: lumenav_pet::payload::frame(&lines).unwrap(),
        };
        let pose = PoseEstimate {
            world_from_capsule: helix(start_s + 0.025, 1.0),
            covariance: nalgebra::Matrix6::identity() * 1e-6,
            kind: FixKind::Full,
        };
        let prior = PosePrior { at: reading.at(), pose, velocity_world_m_s: None };
        let outcome = front_end.process(&reading, Some(&prior)).unwrap();
        handed[usize::from(w >= 20)] += usize::from(matches!(outcome, Outcome::Measured(_)));
    }
    // All twenty real windows enter; of two hundred without the capsule at most one in a hundred does.
    assert!(handed[0] == 20 && handed[1] <= 2, "{handed:?}");
}

/// A budget limits what is looked at, not what a first pose must explain.
#[test]
fn law_a_budget_of_lines_does_not_hinder_the_first_pose() {
    let set = triangle();
    let ring = scanner("allegro");
    let options = MixtureOptions { budget: Budget::AtMost(210), ..MixtureOptions::default() };
    let mut tracker = Mixture::new(&set, noise_of(&ring), options);
    let mut generator = Generator::new(ring, Ends::Law(BlockNoise::reference()), set, 2);
    let (lines, _) = generator.window(&|t| helix(t, 1.0), 0.0, 1760, 650);
    let tracked = tracker.track(&lines, None).unwrap();
    let off = tracked.world_from_capsule.translation.vector - helix(0.025, 1.0).translation.vector;
    assert!(off.norm() < 3e-3 && tracked.used_lines == 210, "{off} {}", tracked.used_lines);
}
