//! Life of a belief: start, gate, loss, re-acquisition, clones.

use crate::models::{Gyro, RelativeModel, gyro_reading, measurement, position_fix, values, white_motion};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{Measurement, MotionEstimate, Name, SimTime};
use lumenav_fusion::{Eskf, EskfOptions, Filter as _, PriorOptions, Refused, Verdict};
use nalgebra::{SMatrix, Vector3};
use std::sync::Arc;

fn tenth(k: u64) -> SimTime {
    SimTime(100_000_000 * k as i64)
}

fn fix(k: u64, x_m: f64) -> Measurement {
    position_fix("fix", k, tenth(k), &Vector3::new(x_m, 0.0, 0.0), 2e-3)
}

fn no_fix(k: u64, x_m: f64) -> Measurement {
    Measurement { fix: None, ..fix(k, x_m) }
}

#[test]
fn law_a_filter_starts_from_a_fix_and_from_nothing_else() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    assert!(
        filter.belief().is_none() && filter.estimate().is_none() && filter.predicted_pose(tenth(1)).is_none()
    );
    assert!(matches!(filter.offer(no_fix(0, 0.1)).verdict, Verdict::Refused(Refused::NotStarted)));
    filter.offer_motion(
        gyro_reading(0, (tenth(0), tenth(1)), &Vector3::x()),
        Arc::new(Gyro { sigma_rad_s: 0.1 }),
    );
    assert!(filter.belief().is_none());
    assert!(matches!(filter.offer(fix(1, 0.1)).verdict, Verdict::Started));
    let belief = filter.belief().unwrap();
    assert_eq!(belief.state.world_from_capsule.translation.vector, Vector3::new(0.1, 0.0, 0.0));
    // The start is the fix itself: it is not used a second time as evidence.
    assert_eq!(belief.covariance[(0, 0)], 2e-3_f64.powi(2));
    assert_eq!(
        (filter.counters().starts, filter.counters().not_started, filter.counters().accepted),
        (1, 1, 0)
    );
}

/// Means and variances of two normal laws of one velocity: precision-weighted; what the fix shares with the velocity moves with it.
#[test]
fn closed_form_a_motion_measured_beside_the_fix_is_joined_with_the_believed_velocity() {
    let options = EskfOptions { initial_velocity_sigma_m_s: Positive(0.02), ..EskfOptions::default() };
    let mut filter = Eskf::new(options, Vec::new());
    let (velocity, rate) = (Vector3::new(0.02, 0.0, 0.0), Vector3::new(0.0, 0.3, 0.0));
    let mut covariance = SMatrix::<f64, 12, 12>::identity() * 1e-4;
    covariance[(0, 0)] = 4e-6;
    (covariance[(0, 6)], covariance[(6, 0)]) = (5e-6, 5e-6);
    let motion =
        MotionEstimate { velocity_world_m_s: velocity, angular_rate_capsule_rad_s: rate, covariance };
    let start = Measurement { motion: Some(motion), ..fix(1, 0.1) };
    assert!(matches!(filter.offer(start).verdict, Verdict::Started));
    let belief = filter.belief().unwrap();
    let near = |here: f64, there: f64| assert!((here - there).abs() < 1e-15, "{here} {there}");
    // 1 / (1/1e-4 + 1/4e-4), and four fifths of the measured velocity.
    near(belief.covariance[(6, 6)], 8e-5);
    near(belief.state.velocity_world_m_s.x, 0.016);
    near(belief.state.world_from_capsule.translation.x, 0.1 - 5e-6 / 5e-4 * 0.02);
    near(belief.covariance[(0, 0)], 4e-6 - 5e-6 * 5e-6 / 5e-4);
    near(belief.covariance[(0, 6)], 5e-6 - 5e-6 * 1e-4 / 5e-4);
    // The rate is taken as it is, its error turned into the world: δω_world = R (δω - [ω]ₓ δθ).
    near(belief.state.angular_rate_capsule_rad_s.y, 0.3);
    near(belief.covariance[(10, 10)], 1e-4);
    near(belief.covariance[(9, 9)], 1e-4 * (1.0 + 0.3 * 0.3));
}

#[test]
fn law_the_gate_refuses_names_the_channel_and_keeps_the_prediction() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    for k in 0..5 {
        filter.offer(fix(k, 0.0));
    }
    let predicted = filter.predicted_pose(tenth(5)).unwrap();
    let verdict = filter.offer(fix(5, 0.3)).verdict;
    let Verdict::Refused(Refused::Gate { innovation, threshold, worst_channels }) = verdict else {
        panic!("{verdict:?}")
    };
    // Chi-square with 3 degrees of freedom at 0.9999: Abramowitz and Stegun table 26.8.
    assert!((threshold - 21.108).abs() < 1e-2, "{threshold}");
    assert!(innovation.chi_square > threshold && innovation.degrees_of_freedom == 3.0);
    assert_eq!(worst_channels[0].0, 0);
    assert!((worst_channels[0].1 - 150.0).abs() < 1.0, "{worst_channels:?}");
    assert_eq!(filter.counters().gated, 1);
    let belief = filter.belief().unwrap();
    assert_eq!(belief.state.world_from_capsule, predicted.pose.world_from_capsule);
    assert!(matches!(filter.offer(fix(6, 0.0)).verdict, Verdict::Accepted(_)));
}

#[test]
fn law_ten_refusals_in_a_row_lose_the_belief_and_the_next_fix_finds_it() {
    let mut filter = Eskf::new(EskfOptions { reacquire_after: 10, ..EskfOptions::default() }, Vec::new());
    (0..5).for_each(|k| drop(filter.offer(fix(k, 0.0))));
    // Nine refusals, then a good one: the streak is over.
    for k in 5..14 {
        assert!(filter.offer(fix(k, 5.0)).lost.is_none());
    }
    assert!(matches!(filter.offer(fix(14, 0.0)).verdict, Verdict::Accepted(_)));
    let mut lost = Vec::new();
    for k in 15..25 {
        lost.extend(filter.offer(fix(k, 5.0)).lost.map(|why| (k, why)));
    }
    assert_eq!(lost.len(), 1);
    assert_eq!(lost[0].0, 24);
    assert!(lost[0].1.contains("10 measurements in a row"), "{}", lost[0].1);
    assert!(filter.belief().is_none() && filter.predicted_pose(tenth(25)).is_none());
    assert!(matches!(filter.offer(fix(25, 5.0)).verdict, Verdict::Started));
    assert_eq!(filter.belief().unwrap().state.world_from_capsule.translation.x, 5.0);
    let counters = filter.counters();
    assert_eq!((counters.gated, counters.losses, counters.starts), (19, 1, 2));
}

#[test]
fn law_a_belief_that_has_become_vague_is_given_up() {
    let options = EskfOptions {
        motion: white_motion(0.1, 0.1),
        lost_position_sigma_m: Positive(0.05),
        ..EskfOptions::default()
    };
    let mut filter = Eskf::new(options, Vec::new());
    filter.offer(fix(0, 0.0));
    assert!(filter.predicted_pose(tenth(3)).is_some());
    assert!(filter.predicted_pose(tenth(50)).is_none(), "a start point that vague helps nobody");
    let offered = filter.offer(fix(50, 0.7));
    assert!(matches!(offered.verdict, Verdict::Started));
    assert!(offered.lost.is_some_and(|why| why.contains("limit 50 mm")));
    assert_eq!((filter.counters().losses, filter.counters().starts), (1, 2));
}

fn relative(k: u64, since: u64) -> Measurement {
    let value = values("relative/1", &[0.0, 0.0, 0.0, 1e-3 * (k - since) as f64, 0.0, 0.0]);
    let mut m = measurement("odometry", k, tenth(k), value, Arc::new(RelativeModel { sigma: 1e-3 }));
    m.since = Some(tenth(since));
    m
}

#[test]
fn law_clones_survive_a_replay() {
    let odometry = Name::from("odometry");
    let run = |late: bool| {
        let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
        for k in 0..4 {
            filter.offer(fix(k, 1e-3 * k as f64));
        }
        filter.want_clones(&odometry, vec![tenth(3)]);
        if !late {
            filter.offer(position_fix("other", 0, tenth(2) + 1, &Vector3::new(2.2e-3, 1e-3, 0.0), 1e-3));
        }
        filter.offer(no_fix(4, 4e-3));
        if late {
            // From before the clone: the replay takes it again, of the corrected pose.
            filter.offer(position_fix("other", 0, tenth(2) + 1, &Vector3::new(2.2e-3, 1e-3, 0.0), 1e-3));
        }
        let offered = filter.offer(relative(6, 3));
        assert!(matches!(offered.verdict, Verdict::Accepted(_)), "{offered:?}");
        filter.belief().unwrap().clone()
    };
    let (in_order, late) = (run(false), run(true));
    assert_eq!(in_order.state, late.state);
    assert_eq!(in_order.covariance, late.covariance);
    assert_eq!(in_order.state.clones.len(), 1);
}

#[test]
fn law_a_relative_pose_without_its_clone_fails_and_is_counted() {
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
    filter.offer(fix(0, 0.0));
    let verdict = filter.offer(relative(6, 3)).verdict;
    assert!(matches!(verdict, Verdict::Refused(Refused::Failed(_))), "{verdict:?}");
    assert_eq!(filter.counters().failed, 1);
}

#[test]
fn law_a_clone_older_than_the_lag_is_not_taken() {
    let mut filter = Eskf::new(EskfOptions { lag_s: NonNegative(0.5), ..EskfOptions::default() }, Vec::new());
    (0..20).for_each(|k| drop(filter.offer(fix(k, 0.0))));
    filter.want_clones(&Name::from("odometry"), vec![tenth(3)]);
    assert!(filter.belief().unwrap().state.clones.is_empty());
    assert!(matches!(filter.offer(relative(20, 3)).verdict, Verdict::Refused(Refused::Failed(_))));
}

#[test]
fn regress_a_measurement_from_before_the_prior_is_too_late() {
    let prior = PriorOptions {
        position_mm: [Finite(0.0); 3],
        position_sigma_mm: Positive(5.0),
        rotation_vector_deg: [Finite(0.0); 3],
        rotation_sigma_deg: Positive(10.0),
        velocity_mm_s: [Finite(1.0), Finite(0.0), Finite(0.0)],
    };
    let mut filter = Eskf::new(EskfOptions::default(), Vec::new()).with_prior(&prior, SimTime::ZERO);
    let early = position_fix("fix", 0, SimTime(-100_000_000), &Vector3::zeros(), 2e-3);
    assert!(matches!(filter.offer(early).verdict, Verdict::Refused(Refused::TooLate { .. })));
    let belief = filter.belief().unwrap();
    assert_eq!(belief.at, SimTime::ZERO);
    assert!((belief.covariance[(0, 0)] - 25e-6).abs() < 1e-18);
    assert!((belief.state.velocity_world_m_s.x - 1e-3).abs() < 1e-18);
    assert!(matches!(filter.offer(fix(1, 1e-4)).verdict, Verdict::Accepted(_)));
}
