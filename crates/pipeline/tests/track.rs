//! A track from outside: what it publishes where readings are refused or late, and how it is built from a file.

use lumenav_core::fix::FixModel;
use lumenav_core::{
    FixKind, Frame, FrontEnd, Measurement, ModalityError, MotionInput, MotionSample, Name, Node, Outcome,
    PoseEstimate, PosePrior, Reading, Schema, SimTime, StateView,
};
use lumenav_fusion::{FilterSetup, Turn};
use lumenav_pipeline::Refusal;
use lumenav_pipeline::track::{Input, Step, Track, blocks};
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

fn tenth(k: i64) -> SimTime {
    SimTime(100_000_000 * k)
}

/// Reads a position along x, mm, 2 mm wide; a reading of 999 is one it refuses.
struct Line;

impl FrontEnd for Line {
    fn process(&mut self, reading: &Reading, _prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        let x_mm = reading.payload.f64("value")?[0];
        if x_mm > 998.0 {
            return Ok(Outcome::Refused { why: "saturated".into() });
        }
        let mut covariance = Matrix6::zeros();
        (0..3).for_each(|i| covariance[(i, i)] = 4e-6);
        let pose = Isometry3::translation(x_mm * 1e-3, 0.0, 0.0);
        let fix = PoseEstimate { world_from_capsule: pose, covariance, kind: FixKind::Position };
        Ok(Outcome::Measured(vec![Measurement {
            value: Arc::new(fix.to_frame()),
            fix: Some(fix),
            ..Measurement::of_reading(reading, Arc::new(FixModel))
        }]))
    }
}

fn reading(sensor: &str, k: i64, arrival: SimTime, x_mm: f64) -> Reading {
    let schema = Schema::channels("line/1", "value", vec!["x_mm".to_owned()]);
    Reading {
        sensor: Name::from(sensor),
        sequence: k as u64,
        interval: (tenth(k), tenth(k)),
        arrival,
        known_poses: BTreeMap::new(),
        payload: Frame::of_values(schema, vec![x_mm]).unwrap(),
    }
}

fn node(text: &str) -> Node {
    Node::parse_text(text, "test.toml", Path::new("."), &[]).unwrap()
}

fn track(filter: &str) -> Track {
    let input = |name: &str| Input {
        sensor: Name::from(name),
        front_end: Some(Box::new(Line)),
        motion_input: None,
        taken: None,
    };
    let inputs = vec![input("fast"), input("slow")];
    let setup = FilterSetup { blocks: blocks(&inputs), ..FilterSetup::default() };
    let filter = lumenav_fusion::build(&node(filter), &setup).unwrap();
    Track::new(Name::from("t"), inputs, filter, &node("")).unwrap()
}

fn one(track: &mut Track, reading: &Reading) -> Step {
    let mut steps = track.process(reading).unwrap();
    assert_eq!(steps.len(), 1);
    steps.remove(0)
}

/// A filter that refuses what contradicts it is judged there as well: every instant has an estimate, the gated ones the
/// prediction with the covariance it had then. Left out, its mean error would be that of its good moments.
#[test]
fn law_a_gating_filter_is_judged_at_every_instant() {
    let mut track = track("kind = \"eskf\"\nreacquire_after = 10");
    let (mut published, mut gated) = (Vec::new(), 0);
    for k in 0..60 {
        let jumped = (20..26).contains(&k);
        let x_mm = if k == 30 {
            999.0
        } else if jumped {
            300.0
        } else {
            0.5 * k as f64
        };
        let step = one(&mut track, &reading("fast", k, tenth(k) + 5, x_mm));
        // Also where it gives the belief up.
        let estimate = step.estimate.unwrap_or_else(|| panic!("nothing to judge at {k}"));
        assert!(!step.revision);
        match &step.refusal {
            Some(Refusal::Gate { .. }) => gated += 1,
            Some(Refusal::FrontEnd { why }) => assert!(k == 30 && why == "saturated"),
            Some(other) => panic!("{k}: {other:?}"),
            None => assert!(!jumped && step.nis.is_some() != step.started),
        }
        let off_mm = (estimate.pose.world_from_capsule.translation.x * 1e3 - 0.5 * k as f64).abs();
        assert!(off_mm < 2.0, "{k}: {off_mm}");
        published.push((estimate.at, estimate.available, estimate.pose.covariance[(0, 0)]));
    }
    assert_eq!(gated, 6);
    let expected: Vec<_> = (0..60).map(|k| (tenth(k), tenth(k) + 5)).collect();
    assert_eq!(published.iter().map(|p| (p.0, p.1)).collect::<Vec<_>>(), expected);
    // The longer it refuses, the less sure it is.
    assert!((20..25).all(|k| published[k + 1].2 > published[k].2));
    assert!(published[26].2 < published[25].2);
    assert_eq!(track.filter().unwrap().counters().gated, 6);
}

/// Windows that overlap are independent to nobody: a filter takes every one that begins behind the last it took. Without a filter each answers
/// for itself.
#[test]
fn law_a_filter_counts_what_two_windows_share_once() {
    let overlapping = |k: i64| {
        let reading = reading("fast", k, tenth(k) + 200_000_000, 0.5 * k as f64);
        Reading { interval: (tenth(k), tenth(k) + 200_000_000), ..reading }
    };
    let mut filtered = track("kind = \"eskf\"");
    let mut alone = track("kind = \"none\"");
    for k in 0..20 {
        let step = one(&mut filtered, &overlapping(k));
        let refused = matches!(&step.refusal, Some(Refusal::FrontEnd { why }) if why.contains("overlaps"));
        assert_eq!(refused, k % 2 == 1, "{k}: {:?}", step.refusal);
        assert!(one(&mut alone, &overlapping(k)).refusal.is_none(), "{k}");
    }
}

/// Windows that follow each other are all taken, though a rounded end may lie a nanosecond behind the next start.
#[test]
fn law_a_filter_takes_windows_that_follow_each_other_at_any_rate() {
    for rate_hz in [7.0, 13.0, 15.0, 18.0, 24.0, 60.0] {
        let due = |k: i64| SimTime((k as f64 * 1e9 / rate_hz).round() as i64);
        let length_ns = (1e9 / rate_hz).round() as i64;
        let mut track = track("kind = \"eskf\"");
        for k in 0..60 {
            let reading = reading("fast", k, due(k) + length_ns, 0.01 * k as f64);
            let reading = Reading { interval: (due(k), due(k) + length_ns), ..reading };
            let step = one(&mut track, &reading);
            assert!(step.refusal.is_none(), "{rate_hz} Hz, {k}: {:?}", step.refusal);
        }
    }
}

/// A window that said nothing has not been counted: the next one that shares time with it is taken.
#[test]
fn law_a_window_that_was_refused_bars_no_other() {
    let mut track = track("kind = \"eskf\"");
    let overlapping = |k: i64, x_mm: f64| {
        let reading = reading("fast", k, tenth(k) + 150_000_000, x_mm);
        Reading { interval: (tenth(k), tenth(k) + 150_000_000), ..reading }
    };
    assert!(one(&mut track, &overlapping(0, 0.0)).refusal.is_none());
    // Not looked at, since it overlaps; behind it one that the front end refuses, and one that overlaps that.
    assert!(one(&mut track, &overlapping(1, 0.5)).refusal.is_some());
    let saturated = one(&mut track, &overlapping(2, 999.0));
    assert!(matches!(&saturated.refusal, Some(Refusal::FrontEnd { why }) if why == "saturated"));
    assert!(one(&mut track, &overlapping(3, 1.5)).refusal.is_none());
}

/// The instant at which a belief is given up has its last prediction: the worst moment is judged as well.
#[test]
fn law_a_belief_that_is_given_up_has_a_last_word() {
    let mut track = track("kind = \"eskf\"\nreacquire_after = 3");
    for k in 0..20 {
        one(&mut track, &reading("fast", k, tenth(k) + 5, 0.5 * k as f64));
    }
    for k in 20..23 {
        let step = one(&mut track, &reading("fast", k, tenth(k) + 5, 300.0));
        assert_eq!(step.lost.is_some(), k == 22);
        let last = step.estimate.unwrap_or_else(|| panic!("nothing to judge at {k}"));
        assert_eq!((last.at, last.available), (tenth(k), tenth(k) + 5));
        assert!((last.pose.world_from_capsule.translation.x - 0.5e-3 * k as f64).abs() < 2e-3);
    }
    assert!(one(&mut track, &reading("fast", 23, tenth(23) + 5, 300.0)).started);
}

#[test]
fn law_a_late_measurement_revises_and_does_not_count_an_instant_twice() {
    for late_x_mm in [2.0, 300.0] {
        let mut track = track("kind = \"eskf\"");
        let mut instants = Vec::new();
        for k in 0..20 {
            let step = one(&mut track, &reading("fast", k, tenth(k), 0.5 * k as f64));
            assert!(!step.revision);
            instants.push(step.estimate.unwrap().at);
            if k == 10 {
                // About the instant 4, four tenths of a second later.
                let step = one(&mut track, &reading("slow", 4, tenth(10), late_x_mm));
                assert_eq!(step.refusal.is_some(), late_x_mm > 100.0);
                let estimate = step.estimate.unwrap();
                assert_eq!((estimate.at, step.revision), (tenth(10), true), "{late_x_mm}");
            }
        }
        instants.dedup();
        assert_eq!(instants.len(), 20);
    }
}

/// A late reading that changes the life of the belief after it says so, and what is published then is a revision: of the belief
/// that was started anew, or the last word of one that is gone.
#[test]
fn law_what_a_late_reading_does_to_later_instants_is_told() {
    for last in [42, 43] {
        let mut track = track("kind = \"eskf\"");
        for k in (0..=5).chain(40..=last) {
            let step = one(&mut track, &reading("fast", k, tenth(k), 0.0));
            assert!(step.refusal.is_none() && step.hindsight.is_empty());
        }
        let step = one(&mut track, &reading("fast", 39, tenth(last), 25.0));
        assert!(step.refusal.is_none() && step.lost.is_none() && !step.started);
        let seen: Vec<_> = step.hindsight.iter().map(|seen| seen.at).collect();
        assert!(matches!(&step.hindsight[0].turn, Turn::Lost { why, .. } if why.contains("sensor `fast`")));
        let estimate = step.estimate.as_ref().unwrap();
        assert_eq!((estimate.at, step.revision), (tenth(last), true));
        let x_m = estimate.pose.world_from_capsule.translation.x;
        if last == 43 {
            assert!(matches!(step.hindsight[1].turn, Turn::Started));
            assert_eq!((seen, step.starts_anew()), (vec![tenth(42), tenth(43)], true));
            assert!(x_m.abs() < 1e-9, "{x_m}");
        } else {
            assert_eq!((seen, step.starts_anew()), (vec![tenth(42)], false));
            assert!((x_m - 0.025).abs() < 5e-3, "{x_m}");
            assert!(track.filter().unwrap().estimate().is_none());
        }
    }
}

struct Still;

impl MotionInput for Still {
    fn sample(&self, _reading: &Reading, _state: &dyn StateView) -> Result<MotionSample, ModalityError> {
        let (rate, covariance) = (Vector3::zeros(), Matrix3::identity() * 1e-4);
        Ok(MotionSample { angular_rate_capsule_rad_s: rate, covariance, bias: None })
    }
}

/// A gyroscope is always ahead of a sensor with latency; what that sensor says is published for the gyroscope's instant, for
/// which nothing was published before.
#[test]
fn law_a_measurement_behind_the_gyroscope_is_no_revision() {
    let mut track = track("kind = \"eskf\"");
    let motion: Arc<dyn MotionInput> = Arc::new(Still);
    track.inputs.push(Input {
        sensor: Name::from("gyro"),
        front_end: None,
        motion_input: Some(motion),
        taken: None,
    });
    for k in 1..30 {
        let mut rate = reading("gyro", k, tenth(k), 0.0);
        rate.interval.0 = tenth(k - 1);
        assert!(track.process(&rate).unwrap().is_empty());
        // Half a period old when it arrives.
        let mut seen = reading("slow", k, tenth(k), if k == 20 { 300.0 } else { 0.0 });
        seen.interval = (tenth(k) - 50_000_000, tenth(k) - 50_000_000);
        let step = one(&mut track, &seen);
        assert_eq!(
            (step.estimate.unwrap().at, step.revision, step.refusal.is_some()),
            (tenth(k), false, k == 20)
        );
    }
}

/// Late, but newer than anything published: the first word about its instant.
#[test]
fn law_a_delayed_sensor_alone_revises_nothing() {
    let mut track = track("kind = \"eskf\"");
    for k in 0..10 {
        let step = one(&mut track, &reading("slow", k, tenth(k + 3), 0.0));
        let estimate = step.estimate.unwrap();
        assert_eq!((estimate.at, estimate.available, step.revision), (tenth(k), tenth(k + 3), false));
    }
    // Beyond the lag there is nothing to say.
    one(&mut track, &reading("fast", 60, tenth(60), 0.0));
    let step = one(&mut track, &reading("slow", 11, tenth(61), 0.0));
    assert!(step.estimate.is_none() && matches!(step.refusal, Some(Refusal::TooLate { .. })));
}

#[test]
fn law_a_filter_table_is_refused_with_what_is_allowed() {
    let message = |filter: &str, prior: Option<&str>| {
        let prior = prior.map(node);
        let setup = FilterSetup { prior: prior.as_ref(), ..FilterSetup::default() };
        lumenav_fusion::build(&node(filter), &setup).err().map(|error| error.to_string()).unwrap_or_default()
    };
    for (filter, prior, words) in [
        ("kind = \"ukf\"", None, "unknown filter `ukf`; allowed: none, eskf"),
        ("kind = 3", None, "expected a name in quotes; allowed: none, eskf"),
        ("kind = \"none\"\nlag_s = 1.0", None, "a track without a filter has no options of one"),
        ("kind = \"none\"", Some("position_mm = [0, 0, 0]"), "a track without a filter takes no prior"),
        ("lag_s = -1.0", None, "lag_s"),
    ] {
        let message = message(filter, prior);
        assert!(message.contains(words), "{filter}: {message}");
    }
    assert_eq!(lumenav_fusion::kind_of(&node("")).unwrap().name, "eskf");
    let mut alone = track("kind = \"none\"");
    let step = one(&mut alone, &reading("fast", 0, tenth(0), 7.0));
    assert!(alone.filter().is_none() && step.estimate.is_some());
    let inputs = vec![Input { sensor: Name::from("gyro"), front_end: None, motion_input: None, taken: None }];
    let refused = Track::new(Name::from("t"), inputs, None, &node("")).err().unwrap().to_string();
    assert!(refused.contains("every sensor needs a front end"), "{refused}");
}

/// Reads a full pose but says that its sensor cannot tell the roll.
struct WithoutRoll;

impl FrontEnd for WithoutRoll {
    fn process(&mut self, reading: &Reading, prior: Option<&PosePrior>) -> Result<Outcome, ModalityError> {
        let Outcome::Measured(mut all) = Line.process(reading, prior)? else { return Ok(Outcome::Nothing) };
        for measurement in &mut all {
            let full = PoseEstimate {
                kind: FixKind::Full,
                covariance: Matrix6::identity() * 1e-6,
                ..measurement.fix.clone().unwrap()
            };
            measurement.value = Arc::new(full.to_frame());
            measurement.fix = Some(full);
        }
        Ok(Outcome::Measured(all))
    }

    fn resolves(&self) -> FixKind {
        FixKind::Pointing
    }
}

/// What no sensor of a track can tell apart is not claimed, by the filter neither; one sensor that can tell is enough.
#[test]
fn law_a_track_claims_no_more_than_its_sensors_resolve() {
    let input = |name: &str, front_end: Box<dyn FrontEnd>| Input {
        sensor: Name::from(name),
        front_end: Some(front_end),
        motion_input: None,
        taken: None,
    };
    for filter in ["kind = \"none\"", "kind = \"eskf\""] {
        let one_sensor = vec![input("fast", Box::new(WithoutRoll))];
        let setup = FilterSetup { blocks: blocks(&one_sensor), ..FilterSetup::default() };
        let build = || lumenav_fusion::build(&node(filter), &setup).unwrap();
        let mut alone = Track::new(Name::from("t"), one_sensor, build(), &node("")).unwrap();
        let pose = one(&mut alone, &reading("fast", 0, tenth(0), 1.0)).estimate.unwrap().pose;
        assert_eq!(pose.kind, FixKind::Pointing);
        assert_eq!(pose.covariance[(3, 3)], 0.0);
        assert!(pose.covariance[(4, 4)] > 0.0);
        let two = vec![input("fast", Box::new(WithoutRoll)), input("slow", Box::new(Line))];
        let mut both = Track::new(Name::from("t"), two, build(), &node("")).unwrap();
        let pose = one(&mut both, &reading("fast", 0, tenth(0), 1.0)).estimate.unwrap().pose;
        assert_eq!(pose.kind, FixKind::Full);
    }
}
