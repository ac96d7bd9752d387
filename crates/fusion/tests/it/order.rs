//! Any order of arrival within the lag gives the same bits; beyond it a measurement is counted, not hidden.

use crate::models::{
    Gyro, RangeModel, RelativeModel, gyro_reading, measurement, normal3, position_fix, values,
};
use lumenav_core::config::quantity::NonNegative;
use lumenav_core::{
    FrontEnd, Measurement, ModalityError, Name, Outcome, PosePrior, PriorUse, RandomStreams, Reading, SimTime,
};
use lumenav_fusion::{Belief, Eskf, EskfOptions, Filter as _, Refused, Verdict};
use nalgebra::Vector3;
use rand::seq::SliceRandom as _;
use std::sync::Arc;

fn tenth(k: u64) -> SimTime {
    SimTime(100_000_000 * k as i64)
}

#[derive(Clone)]
enum Event {
    Measure(Box<Measurement>),
    Motion(Reading),
    Want(SimTime),
}

fn range(sensor: &str, k: u64, at: SimTime, metres: f64) -> Measurement {
    let model = RangeModel { anchor_world_m: Vector3::new(0.3, 0.1, -0.2), sigma_m: 2e-3, iterated: true };
    measurement(sensor, k, at, values("range/1", &[metres]), Arc::new(model))
}

/// Two seconds of fixes, ranges, a gyroscope, an outlier, a clone and a relative pose to it.
fn events() -> Vec<Event> {
    let mut stream = RandomStreams::new(1, 0, "order").stream("noise", 0);
    let mut all = Vec::new();
    for k in 0..20_u64 {
        let position = Vector3::new(0.001 * k as f64, 0.0, 0.0) + 1e-3 * normal3(&mut stream);
        if k % 2 == 1 {
            let position = if k == 9 { position + Vector3::new(0.0, 0.5, 0.0) } else { position };
            all.push(Event::Measure(Box::new(position_fix("fix", k, tenth(k), &position, 2e-3))));
        }
        let metres = (position - Vector3::new(0.3, 0.1, -0.2)).norm();
        all.push(Event::Measure(Box::new(range("range", k, tenth(k) + 20_000_000, metres))));
        let rate = Vector3::new(0.2, 0.1, -0.3) + 0.01 * normal3(&mut stream);
        all.push(Event::Motion(gyro_reading(k, (tenth(k), tenth(k + 1)), &rate)));
    }
    all.push(Event::Want(tenth(6)));
    let mut relative = measurement(
        "odometry",
        0,
        tenth(14),
        values("relative/1", &[0.16, 0.08, -0.24, 8e-3, 1.4e-3, 5e-4]),
        Arc::new(RelativeModel { sigma: 0.02 }),
    );
    relative.since = Some(tenth(6));
    all.push(Event::Measure(Box::new(relative)));
    all
}

fn run(events: &[Event], lag_s: f64) -> (Belief, Eskf) {
    let mut filter =
        Eskf::new(EskfOptions { lag_s: NonNegative(lag_s), ..EskfOptions::default() }, Vec::new());
    let gyro = Arc::new(Gyro { sigma_rad_s: 0.02 });
    for event in events {
        match event {
            Event::Measure(m) => drop(filter.offer(m.as_ref().clone())),
            Event::Motion(reading) => drop(filter.offer_motion(reading.clone(), gyro.clone())),
            Event::Want(at) => filter.want_clones(&Name::from("odometry"), vec![*at]),
        }
    }
    (filter.belief().unwrap().clone(), filter)
}

fn assert_same_bits(a: &Belief, b: &Belief, what: &str) {
    assert_eq!(a.at, b.at, "{what}");
    assert_eq!(a.state, b.state, "{what}");
    let bits = |belief: &Belief| belief.covariance.iter().map(|v| v.to_bits()).collect::<Vec<u64>>();
    assert_eq!(bits(a), bits(b), "{what}");
}

#[test]
fn law_any_order_of_arrival_within_the_lag_gives_the_same_bits() {
    let mut events = events();
    let key = |event: &Event| match event {
        Event::Measure(m) => (m.at, 1),
        Event::Motion(reading) => (reading.interval.1, 0),
        Event::Want(at) => (*at, 2),
    };
    events.sort_by_key(key);
    let (in_order, filter) = run(&events, 10.0);
    // The sequence is worth permuting: the outlier is refused, the clone used, ranges before the first fix are lost.
    let counters = filter.counters().clone();
    assert_eq!((counters.starts, counters.gated, counters.not_started, counters.failed), (1, 1, 1, 0));
    assert!(in_order.state.clones.contains_key(&tenth(6)));
    let mut stream = RandomStreams::new(2, 0, "order").stream("shuffle", 0);
    for trial in 0..60 {
        let mut shuffled = events.clone();
        shuffled.shuffle(&mut stream);
        let (belief, filter) = run(&shuffled, 10.0);
        assert_same_bits(&belief, &in_order, &format!("trial {trial}"));
        let seen = filter.counters();
        assert_eq!((seen.starts, seen.losses), (counters.starts, counters.losses), "trial {trial}");
    }
    events.reverse();
    assert_same_bits(&run(&events, 10.0).0, &in_order, "backwards: the start arrives last");
}

/// A clone that fell out of use comes back with a replay; it must not stay, nor change a bit of the rest.
#[test]
fn regress_a_dropped_clone_does_not_come_back_with_a_replay() {
    let odometry = Name::from("odometry");
    let fix = |k: u64| position_fix("fix", k, tenth(k), &Vector3::new(1e-3 * k as f64, 0.0, 0.0), 2e-3);
    let run = |late: bool| {
        let mut filter =
            Eskf::new(EskfOptions { lag_s: NonNegative(0.5), ..EskfOptions::default() }, Vec::new());
        for k in 0..8 {
            if !(late && k == 6) {
                filter.offer(fix(k));
            }
            filter.want_clones(&odometry, if k < 7 { vec![tenth(2)] } else { Vec::new() });
        }
        if late {
            assert!(matches!(filter.offer(fix(6)).verdict, Verdict::Accepted(_)));
        }
        filter.belief().unwrap().clone()
    };
    let (in_order, late) = (run(false), run(true));
    assert!(in_order.state.clones.contains_key(&tenth(2)), "it is inside the lag still");
    assert_same_bits(&late, &in_order, "late");
    let beyond = |late: bool| {
        let mut filter =
            Eskf::new(EskfOptions { lag_s: NonNegative(0.5), ..EskfOptions::default() }, Vec::new());
        for k in 0..12 {
            if !(late && k == 9) {
                filter.offer(fix(k));
            }
            filter.want_clones(&odometry, if k < 11 { vec![tenth(2)] } else { Vec::new() });
        }
        if late {
            filter.offer(fix(9));
        }
        filter.belief().unwrap().clone()
    };
    let (in_order, late) = (beyond(false), beyond(true));
    assert!(in_order.state.clones.is_empty() && late.state.clones.is_empty());
    assert_same_bits(&late, &in_order, "beyond the lag");
}

#[test]
fn law_too_late_is_counted_and_leaves_no_trace() {
    let mut events = events();
    events.retain(|event| matches!(event, Event::Measure(m) if m.since.is_none()));
    let (without, _) = run(&events, 0.5);
    events.push(Event::Measure(Box::new(range("late", 0, tenth(3), 0.4))));
    let (with, filter) = run(&events, 0.5);
    assert_eq!(filter.counters().too_late, 1);
    assert_same_bits(&with, &without, "late");
    let mut filter = filter;
    let newest = tenth(19) + 20_000_000;
    let verdict = filter.offer(range("late", 1, newest - 600_000_000, 0.4)).verdict;
    let Verdict::Refused(Refused::TooLate { by_s }) = verdict else { panic!("{verdict:?}") };
    assert!((by_s - 0.1).abs() < 1e-12, "{by_s}");
    filter.offer_motion(
        gyro_reading(0, (tenth(0), tenth(1)), &Vector3::zeros()),
        Arc::new(Gyro { sigma_rad_s: 0.1 }),
    );
    assert_eq!(filter.counters().too_late, 3);
    assert_same_bits(filter.belief().unwrap(), &without, "late motion");
}

#[test]
fn law_a_value_that_contains_the_prior_is_refused() {
    let (before, mut filter) = run(&events(), 10.0);
    let mut again = range("tracker", 0, tenth(20), 0.358);
    again.prior_use = PriorUse::Contained;
    assert!(matches!(filter.offer(again.clone()).verdict, Verdict::Refused(Refused::ContainsPrior)));
    assert_eq!(filter.counters().contained_prior, 1);
    assert_same_bits(filter.belief().unwrap(), &before, "contained");
    again.prior_use = PriorUse::StartOnly;
    assert!(matches!(filter.offer(again).verdict, Verdict::Accepted(_)));
}

/// A ruler that repeats every 10 mm, with a wide fix every tenth reading: only a prediction tells which stretch is meant.
struct Ruler;

impl FrontEnd for Ruler {
    fn process(&mut self, reading: &Reading, prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        let seen = Vector3::from_column_slice(reading.payload.f64("value")?);
        let mut m = position_fix("ruler", reading.sequence, reading.at(), &seen, 1e-3);
        if !reading.sequence.is_multiple_of(10) {
            let Some(prior) = prior else { return Ok(Outcome::Refused { why: "no prediction".into() }) };
            let predicted = prior.pose.world_from_capsule.translation.vector;
            let placed = seen
                .map(|v| v % PERIOD_M)
                .zip_map(&predicted, |v, p| v + PERIOD_M * ((p - v) / PERIOD_M).round());
            m = position_fix("ruler", reading.sequence, reading.at(), &placed, 1e-3);
            m.fix = None;
            m.prior_use = PriorUse::StartOnly;
        }
        m.arrival = reading.arrival;
        Ok(Outcome::Measured(vec![m]))
    }
}

const PERIOD_M: f64 = 0.01;

/// A front end is told of a late reading what it would have been told in order, so both give the same track.
#[test]
fn law_late_readings_through_a_front_end_give_the_same_bits() {
    let mut stream = RandomStreams::new(4, 0, "order").stream("ruler", 0);
    let readings: Vec<Reading> = (0..40)
        .map(|k| {
            let at = tenth(k);
            let place = Vector3::new(2e-3 * k as f64, 0.0, 1e-3 * k as f64) + 2e-4 * normal3(&mut stream);
            gyro_reading(k, (at, at), &place)
        })
        .collect();
    let run = |order: &[usize]| {
        let mut filter = Eskf::new(EskfOptions::default(), Vec::new());
        for k in order {
            let prior = filter.predicted_pose(readings[*k].at());
            let outcome = Ruler.process(&readings[*k], prior.as_ref()).unwrap();
            let Outcome::Measured(all) = outcome else { panic!("reading {k}: {outcome:?}") };
            for mut m in all {
                m.arrival = tenth(40);
                filter.offer(m);
            }
        }
        assert_eq!((filter.counters().gated, filter.counters().accepted), (0, 39));
        filter.belief().unwrap().clone()
    };
    let in_order: Vec<usize> = (0..40).collect();
    let expected = run(&in_order);
    assert!((expected.state.world_from_capsule.translation.x - 0.078).abs() < 1e-3);
    for first in [1, 2, 7, 17, 33] {
        for by in [1, 2, 4] {
            let mut order = in_order.clone();
            order[first..=first + by].rotate_left(1);
            assert_same_bits(&run(&order), &expected, &format!("reading {first} comes {by} later"));
        }
    }
}
