//! What a filter does where it refuses: it answers with its prediction, it is lost by one sensor and not by another's
//! faults, and it comes back with what it knew of its sensors.

use crate::models::{
    BiasedModel, Gyro, PositionModel, block, gyro_reading, measurement, normal3, position_fix, values,
};
use lumenav_core::fix::FixModel;
use lumenav_core::pose::{exp_so3, ominus};
use lumenav_core::{
    FixKind, Measurement, ModalityError, MotionInput, MotionSample, PoseEstimate, RandomStreams, Reading,
    SimTime, StateView,
};
use lumenav_fusion::{Eskf, EskfOptions, Filter as _, Refused, Verdict};
use nalgebra::{Isometry3, Matrix6, Translation3, Vector3};
use std::sync::Arc;

fn tenth(k: u64) -> SimTime {
    SimTime(100_000_000 * k as i64)
}

fn fix(sensor: &str, k: u64, x_m: f64) -> Measurement {
    position_fix(sensor, k, tenth(k), &Vector3::new(x_m, 0.0, 0.0), 2e-3)
}

#[test]
fn law_a_refusal_is_answered_with_the_prediction_and_leaves_no_trace() {
    let mut filter = Eskf::new(EskfOptions::default(), vec![block("b", 2, 1.0, 0.1)]);
    (0..5).for_each(|k| drop(filter.offer(fix("s", k, 1e-3 * k as f64))));
    let before = filter.belief().unwrap().clone();
    let predicted = filter.predicted_estimate(tenth(7)).unwrap();
    assert_eq!(predicted.at, tenth(7));
    // The prediction of the belief, covariance and velocity with it.
    let mut expected = before.clone();
    expected.predict(tenth(7), &EskfOptions::default().motion);
    assert_eq!(predicted.pose, expected.pose());
    assert_eq!(predicted.velocity_world_m_s, Some(expected.state.velocity_world_m_s));
    assert!(predicted.pose.covariance[(0, 0)] > before.covariance[(0, 0)]);
    let after = filter.belief().unwrap();
    assert_eq!((after.at, &after.state, &after.covariance), (before.at, &before.state, &before.covariance));
    // A gated one answers with the very same.
    assert!(matches!(filter.offer(fix("s", 7, 0.3)).verdict, Verdict::Refused(Refused::Gate { .. })));
    assert_eq!(filter.predicted_estimate(tenth(7)).unwrap().pose, predicted.pose);
}

#[test]
fn law_the_past_within_the_lag_is_answered_with_what_was_known_then() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    let (mut known, mut at_once) = (Vec::new(), Vec::new());
    for k in 0..30 {
        filter.offer(fix("s", k, 1e-3 * k as f64));
        known.push(filter.predicted_estimate(tenth(k) + 50_000_000).unwrap());
        at_once.push(filter.estimate().unwrap());
    }
    for (k, then) in known.iter().enumerate().skip(9) {
        let again = filter.predicted_estimate(tenth(k as u64) + 50_000_000).unwrap();
        assert_eq!((again.at, &again.pose), (then.at, &then.pose), "{k}");
        assert_eq!(filter.predicted_pose(then.at).unwrap().pose, then.pose);
        // At its own instant a measurement is known.
        if k > 9 {
            assert_eq!(filter.predicted_estimate(tenth(k as u64)).unwrap().pose, at_once[k].pose, "{k}");
        }
    }
    assert!(filter.predicted_pose(tenth(8)).is_none(), "older than the lag");
}

fn pointing(k: u64, at: SimTime, pose: &Isometry3<f64>, sigma: [f64; 2]) -> Measurement {
    let mut covariance = Matrix6::zeros();
    (0..3).for_each(|i| covariance[(i, i)] = sigma[0].powi(2));
    (4..6).for_each(|i| covariance[(i, i)] = sigma[1].powi(2));
    let fix = PoseEstimate { world_from_capsule: *pose, covariance, kind: FixKind::Pointing };
    let mut m = measurement("s", k, at, Arc::new(fix.to_frame()), Arc::new(FixModel));
    m.fix = Some(fix);
    m
}

/// A capsule that has turned round while nobody looked. A residual that shrinks beyond 90° would pull the filter to the reversed
/// heading and make it certain of it.
#[test]
fn regress_a_capsule_turned_round_in_a_dropout_is_found_again() {
    let sigma = [2e-3, 0.02];
    for (seed, degrees) in [60.0_f64, 100.0, 150.0, 170.0, 179.0, 180.0].into_iter().enumerate() {
        let mut stream = RandomStreams::new(seed as u64, 0, "turned").stream("noise", 0);
        let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
        let start = exp_so3(&Vector3::new(0.4, 0.2, -0.5));
        let after = start * exp_so3(&(Vector3::new(0.0, 0.6, 0.8) * degrees.to_radians()));
        let mut nees = Vec::new();
        for k in 0..50 {
            let (at, truth) = if k < 20 { (tenth(k), start) } else { (tenth(k + 200), after) };
            let n = normal3(&mut stream) * sigma[1];
            let seen = truth * exp_so3(&Vector3::new(0.0, n.y, n.z));
            let place = Translation3::from(normal3(&mut stream) * sigma[0]);
            let offered = filter.offer(pointing(k, at, &Isometry3::from_parts(place, seen), sigma));
            assert!(!matches!(offered.verdict, Verdict::Refused(_)), "{degrees}, {k}: {offered:?}");
            let belief = filter.belief().unwrap();
            let heading = belief.state.world_from_capsule.rotation * Vector3::x();
            let off = heading.angle(&(truth * Vector3::x()));
            assert!(off < 4.0 * sigma[1], "{degrees} degrees, fix {k}: {:.1} off", off.to_degrees());
            let variance = belief.covariance.view((4, 4), (2, 2)).trace() / 2.0;
            // One fix knows the heading no better than it says, in any direction; so near the antipode that the prior reaches
            // it from all sides the chart has a seam, and the first belief is too sure across it.
            if k == 20 && degrees < 175.0 {
                let block = belief.covariance.view((4, 4), (2, 2)).into_owned().symmetric_eigen();
                assert!(block.eigenvalues.min() > 0.3 * sigma[1].powi(2), "{degrees}: {}", block.eigenvalues);
            }
            nees.push(off * off / variance / 2.0);
        }
        // Certain of what is so: the mean over 28 fixes (correlated, so the bound is wide) is near 1 per degree of freedom.
        let mean = nees[22..].iter().sum::<f64>() / 28.0;
        assert!(mean < 2.5, "{degrees}: {mean}");
    }
}

#[test]
fn law_one_broken_sensor_does_not_lose_what_another_vouches_for() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    for k in 0..60 {
        // One outlier of the good sensor takes nothing back.
        filter.offer(fix("good", k, if k == 30 { 0.4 } else { 0.0 }));
        // A start alone vouches for nothing: the broken one could have made it.
        for i in (1..=12).filter(|_| k > 0) {
            let at = tenth(k) + 7_000_000 * i;
            let broken = position_fix("broken", 12 * k + i as u64, at, &Vector3::new(0.5, 0.0, 0.0), 2e-3);
            assert!(filter.offer(broken).lost.is_none(), "at {k}");
        }
    }
    assert_eq!((filter.counters().losses, filter.counters().starts), (0, 1));
    assert_eq!(filter.counters().gated, 12 * 59 + 1);
}

/// A capsule that was thrown: both sensors see it elsewhere, and neither's word of a moment ago keeps the belief.
#[test]
fn law_sensors_that_are_all_refused_vouch_for_nothing() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    let mut lost_at = None;
    for k in 0..30 {
        let x_m = if k < 20 { 0.0 } else { 0.4 };
        let second = position_fix("second", k, tenth(k) + 7_000_000, &Vector3::new(x_m, 0.0, 0.0), 2e-3);
        for offered in [filter.offer(fix("first", k, x_m)), filter.offer(second)] {
            lost_at = lost_at.or(offered.lost.map(|_| k));
        }
    }
    // Three refusals of each, a third of a second; the lag within which an accepted word counts is two seconds.
    assert_eq!(lost_at, Some(22));
    assert_eq!(filter.counters().losses, 1);
}

/// An attitude that agrees says nothing of a position that does not: the refusals of the position count all the same.
#[test]
fn law_an_attitude_does_not_vouch_for_a_position() {
    let mut filter = Eskf::new(EskfOptions { reacquire_after: 10, ..EskfOptions::default() }, Vec::new());
    (0..20).for_each(|k| drop(filter.offer(fix("s", k, 0.0))));
    let attitude = |k: u64| {
        let world = [Vector3::z(), Vector3::x()];
        let model = crate::models::DirectionsModel { world, sigma: 0.05, iterated: false };
        let value = values("directions/1", &[0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        measurement("gravity", k, tenth(k) + 1, value, Arc::new(model))
    };
    let mut lost = Vec::new();
    for k in 50..70 {
        lost.extend(filter.offer(fix("s", k, 0.5)).lost.map(|why| (k, why)));
        let offered = filter.offer(attitude(k));
        assert!(lost.len() == 1 || matches!(offered.verdict, Verdict::Accepted(_)), "{offered:?}");
        if lost.len() == 1 {
            break;
        }
    }
    assert_eq!(lost[0].0, 59);
    assert!(lost[0].1.contains("10 measurements in a row of sensor `s`"), "{}", lost[0].1);
}

/// A position reading with a bias that a block holds.
fn biased(k: u64, x_m: f64) -> Measurement {
    let model = Arc::new(BiasedModel { sigma_m: 2e-3 });
    measurement("biased", k, tenth(k), values("position/1", &[x_m, 0.0, 0.0]), model)
}

#[test]
fn law_blocks_outlive_a_loss_with_their_own_covariance() {
    let blocks = vec![block("bias_m", 3, 0.05, 1e-4)];
    let mut filter = Eskf::new(EskfOptions { reacquire_after: 10, ..EskfOptions::default() }, blocks.clone());
    for k in 0..30 {
        filter.offer(fix("s", k, 0.0));
        filter.offer(biased(k, 0.03));
    }
    let learnt = filter.belief().unwrap().clone();
    assert!((learnt.state.blocks["bias_m"][0] - 0.03).abs() < 2e-3 && learnt.covariance[(12, 12)] < 9e-6);
    // Away beyond the lag and somewhere else: lost, and found by the tenth and the eleventh.
    let lost = (80..90).filter(|k| filter.offer(fix("s", *k, 0.8)).lost.is_some()).count();
    assert_eq!(lost, 1);
    assert!(filter.belief().is_none());
    assert!(matches!(filter.offer(fix("s", 95, 0.8)).verdict, Verdict::Started));
    let found = filter.belief().unwrap();
    assert_eq!(found.state.blocks, learnt.state.blocks);
    let walked = learnt.covariance[(12, 12)] + 1e-8 * (9.5 - 2.9);
    assert!((found.covariance[(12, 12)] / walked - 1.0).abs() < 1e-9, "{}", found.covariance[(12, 12)]);
    assert_eq!(found.covariance[(0, 12)], 0.0, "independent of the new pose");
    // A belief that is lost again before it has held comes back with nothing.
    for k in 100..110 {
        filter.offer(fix("s", k, -0.8));
    }
    filter.offer(fix("s", 111, -0.8));
    let fresh = filter.belief().unwrap();
    assert_eq!((fresh.state.blocks["bias_m"][0], fresh.covariance[(12, 12)]), (0.0, 0.05 * 0.05));
}

#[test]
fn law_what_claims_to_come_from_the_future_is_refused() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    (0..5).for_each(|k| drop(filter.offer(fix("s", k, 0.0))));
    let model = Arc::new(PositionModel { sigma_m: 2e-3 });
    let mut wrong = measurement("clock", 0, tenth(600), values("position/1", &[0.0; 3]), model);
    wrong.arrival = tenth(5);
    let verdict = filter.offer(wrong.clone()).verdict;
    let Verdict::Refused(Refused::Failed(why)) = verdict else { panic!("{verdict:?}") };
    assert!(why.contains("59.500 s after its arrival"), "{why}");
    // Nothing is too late because of it.
    assert!(matches!(filter.offer(fix("s", 5, 0.0)).verdict, Verdict::Accepted(_)));
    let mut motion = gyro_reading(0, (tenth(6), tenth(700)), &Vector3::zeros());
    motion.arrival = tenth(6);
    assert!(filter.offer_motion(motion, Arc::new(Gyro { sigma_rad_s: 0.1 })).is_some());
    assert!(matches!(filter.offer(fix("s", 6, 0.0)).verdict, Verdict::Accepted(_)));
    assert_eq!((filter.counters().failed, filter.counters().too_late), (2, 0));
    // What has arrived sets the clock, whoever brought it.
    filter.offer(fix("s", 605, 0.0));
    assert!(!matches!(filter.offer(wrong).verdict, Verdict::Refused(Refused::Failed(_))));
}

struct BrokenGyro;

impl MotionInput for BrokenGyro {
    fn sample(&self, _reading: &Reading, _state: &dyn StateView) -> Result<MotionSample, ModalityError> {
        Err(ModalityError::Reading("a saturated axis".to_owned()))
    }
}

#[test]
fn law_a_motion_reading_without_a_sample_is_counted_once_and_predicted_over() {
    let run = |broken: bool| {
        let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
        filter.offer(fix("s", 0, 0.0));
        filter.offer(fix("s", 1, 0.0));
        if broken {
            let reading = gyro_reading(0, (tenth(1), tenth(2)), &Vector3::x());
            let why = filter.offer_motion(reading, Arc::new(BrokenGyro));
            assert!(matches!(&why, Some(Refused::Failed(why)) if why.contains("saturated")), "{why:?}");
        }
        filter.offer(fix("s", 3, 0.0));
        // A replay samples again and does not count again.
        filter.offer(position_fix("late", 0, tenth(1) + 1, &Vector3::zeros(), 2e-3));
        assert_eq!(filter.counters().failed, u64::from(broken));
        filter.belief().unwrap().clone()
    };
    let (with, without) = (run(true), run(false));
    let apart = ominus(&with.state.world_from_capsule, &without.state.world_from_capsule);
    assert!(apart.norm() < 1e-12 && (&with.covariance - &without.covariance).amax() < 1e-12);
}
