//! What arrives late may give the belief another life: starts and losses at later instants are told when a replay makes or undoes
//! them.

use crate::models::{Gyro, gyro_reading, position_fix};
use lumenav_core::{Measurement, SimTime};
use lumenav_fusion::{Eskf, EskfOptions, Filter as _, Hindsight, Turn, Verdict};
use nalgebra::Vector3;
use std::sync::Arc;

fn tenth(k: u64) -> SimTime {
    SimTime(100_000_000 * k as i64)
}

fn fix(sensor: &str, k: u64, x_m: f64) -> Measurement {
    position_fix(sensor, k, tenth(k), &Vector3::new(x_m, 0.0, 0.0), 2e-3)
}

fn late(sensor: &str, k: u64, x_m: f64, arrival: SimTime) -> Measurement {
    Measurement { arrival, ..fix(sensor, k, x_m) }
}

/// Half a second of fixes, a hole of more than three, and fixes that agree with what was known before.
fn across_a_hole(last: u64) -> Eskf {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    for k in (0..=5).chain(40..=last) {
        let offered = filter.offer(fix("s", k, 0.0));
        assert!(!matches!(offered.verdict, Verdict::Refused(_)), "{k}: {offered:?}");
    }
    assert!(filter.take_hindsight().is_empty());
    filter
}

fn told(hindsight: &[Hindsight]) -> Vec<(SimTime, &str)> {
    let what = |turn: &Turn| match turn {
        Turn::Lost { .. } => "lost",
        Turn::NotLost => "not lost",
        Turn::Started => "started",
        Turn::NotStarted => "not started",
    };
    hindsight.iter().map(|seen| (seen.at, what(&seen.turn))).collect()
}

/// The belief is so vague before the hole ends that a fix 25 mm off enters; the three after it do not then. Another sensor that
/// agrees with it, later still, vouches for the belief: it was never lost.
#[test]
fn law_a_loss_in_a_replay_is_told_and_one_that_is_undone_as_well() {
    let mut filter = across_a_hole(43);
    let offered = filter.offer(late("s", 39, 0.025, tenth(43)));
    assert!(matches!(offered.verdict, Verdict::Accepted(_)) && offered.lost.is_none(), "{offered:?}");
    let hindsight = filter.take_hindsight();
    assert_eq!(told(&hindsight), [(tenth(42), "lost"), (tenth(43), "started")]);
    assert!(hindsight.iter().all(|seen| &*seen.sensor == "s"));
    let Turn::Lost { why, given_up } = &hindsight[0].turn else { panic!("{hindsight:?}") };
    assert!(why.contains("3 measurements in a row of sensor `s`"), "{why}");
    // What it said last: a prediction from the fix that was off.
    let last = given_up.as_ref().unwrap();
    assert_eq!(last.at, tenth(42));
    assert!((last.pose.world_from_capsule.translation.x - 0.025).abs() < 5e-3, "{last:?}");
    assert_eq!((filter.counters().losses, filter.counters().starts), (1, 2));
    assert!(filter.take_hindsight().is_empty(), "told once");

    let offered = filter.offer(Measurement { at: tenth(41) + 50_000_000, ..late("t", 41, 0.025, tenth(43)) });
    assert!(matches!(offered.verdict, Verdict::Accepted(_)), "{offered:?}");
    assert_eq!(told(&filter.take_hindsight()), [(tenth(42), "not lost"), (tenth(43), "not started")]);
    assert_eq!((filter.counters().losses, filter.counters().starts), (0, 1));
}

/// With the very same measurements in order, the loss is told at once; the counters end the same.
#[test]
fn law_the_counters_of_starts_and_losses_do_not_depend_on_the_order_of_arrival() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    let mut lost = Vec::new();
    for k in (0..=5).chain([39]).chain(40..=43) {
        lost.extend(filter.offer(fix("s", k, if k == 39 { 0.025 } else { 0.0 })).lost.map(|_| k));
    }
    assert_eq!((lost, filter.take_hindsight().len()), (vec![42], 0));
    let mut late_one = across_a_hole(43);
    late_one.offer(late("s", 39, 0.025, tenth(43)));
    assert_eq!((late_one.counters().losses, late_one.counters().starts), (1, 2));
    assert_eq!((filter.counters().losses, filter.counters().starts), (1, 2));
    // The first fix of all comes last.
    let mut backwards = Eskf::new(EskfOptions::default(), Vec::new());
    backwards.offer(fix("s", 1, 0.0));
    let offered = backwards.offer(late("s", 0, 0.0, tenth(1)));
    assert!(matches!(offered.verdict, Verdict::Started), "{offered:?}");
    assert_eq!(told(&backwards.take_hindsight()), [(tenth(1), "not started")]);
    assert_eq!(backwards.counters().starts, 1);
}

/// A turn rate that arrives late can do it as well: it is no measurement and has no answer of its own.
#[test]
fn law_a_late_motion_reading_tells_what_it_did() {
    let directions = |k: u64| {
        let world = [Vector3::z(), Vector3::x()];
        let model = crate::models::DirectionsModel { world, sigma: 0.01, iterated: false };
        let value = crate::models::values("directions/1", &[0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        crate::models::measurement("gravity", k, tenth(k), value, Arc::new(model))
    };
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    filter.offer(fix("s", 0, 0.0));
    (1..=9).for_each(|k| drop(filter.offer(directions(k))));
    assert!(filter.take_hindsight().is_empty());
    let losses = filter.counters().losses;
    // It says that the capsule turned by more than a radian, which nobody saw; and it is sure of it.
    let mut motion = gyro_reading(0, (tenth(5), tenth(6)), &Vector3::new(0.0, 12.0, 0.0));
    motion.arrival = tenth(9);
    assert!(filter.offer_motion(motion, Arc::new(Gyro { sigma_rad_s: 1e-3 })).is_none());
    let hindsight = filter.take_hindsight();
    assert_eq!(told(&hindsight), [(tenth(8), "lost")], "{hindsight:?}");
    assert_eq!(filter.counters().losses, losses + 1);
    assert!(filter.belief().is_none());
}
