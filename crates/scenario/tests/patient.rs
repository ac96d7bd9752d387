//! A patient who moves, around the engine and around kinematic truth.

#![expect(clippy::disallowed_types, reason = "world side: these tests look at the truth")]

use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, SegmentPoints, Tract, TractDraft};
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_core::config::Node;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::pose::log_so3;
use lumenav_core::{CapsuleBody, ModelFolder, Primitive, RandomStreams, SimTime};
use lumenav_scenario::engine::{Engine, EngineConfig, TOLERANCE_M};
use lumenav_scenario::patient::{
    Cough, PATIENT_EVENT_SOURCES, PATIENT_SOURCES, Patient, PatientConfig, PatientEvent, Posture, Ride, Turn,
    Walk,
};
use lumenav_scenario::{ScenarioFile, World, build_world};
use nalgebra::{Point3, Vector3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
const GRAVITY: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// Along z.
fn tube(key: SegmentKey, radius_m: f64) -> Arc<Tract> {
    let points_m: Vec<Point3<f64>> = (0..=20).map(|i| Point3::new(0.0, 0.0, 0.05 * f64::from(i))).collect();
    let segment = SegmentPoints {
        key,
        radii_m: vec![radius_m; points_m.len()],
        points_m,
        wall: key.default_wall(),
        source: "test".into(),
    };
    let draft = TractDraft {
        name: "test".into(),
        segments: vec![segment],
        ends: (End::Closed, End::Closed),
        torso_half_extents_m: None,
        source: "test".into(),
    };
    Arc::new(draft.build().unwrap().0)
}

fn colon() -> Arc<Tract> {
    let node = Node::open(&models().join("tracts/colon.toml")).unwrap();
    Arc::new(load(&node, &TractOptions::default()).unwrap().0)
}

fn engine(tract: &Arc<Tract>, spontaneous: bool, config: EngineConfig) -> Engine {
    let motility = MotilityConfig { spontaneous, ..MotilityConfig::default() };
    let motility = Motility::new(&motility, tract, &RandomStreams::new(3, 0, "motility")).unwrap();
    Engine::new(config, tract.clone(), motility, CAPSULE).unwrap()
}

fn at(start_m: f64) -> EngineConfig {
    EngineConfig { start_arc_length_m: NonNegative(start_m), ..EngineConfig::default() }
}

fn seconds(s: f64) -> SimTime {
    SimTime::from_seconds(s)
}

/// A patient who holds the breath.
fn holding(event: Vec<PatientEvent>) -> PatientConfig {
    PatientConfig { breathing_amplitude_mm: NonNegative(0.0), event, ..PatientConfig::default() }
}

fn turn(at_s: f64, to: Posture, duration_s: f64) -> PatientEvent {
    PatientEvent::Posture(Turn { at_s: NonNegative(at_s), to, duration_s: Positive(duration_s) })
}

fn cough(at_s: f64, acceleration_m_s2: f64, direction: [f64; 3]) -> PatientEvent {
    PatientEvent::Cough(Cough {
        at_s: NonNegative(at_s),
        acceleration_m_s2: NonNegative(acceleration_m_s2),
        duration_s: Positive(0.3),
        direction: direction.map(Finite),
    })
}

fn walk(from_s: f64, to_s: f64, speed_m_s: f64) -> PatientEvent {
    PatientEvent::Walk(Walk {
        from_s: NonNegative(from_s),
        to_s: Positive(to_s),
        step_frequency_hz: Positive(1.85),
        amplitude_mm: NonNegative(22.0),
        speed_m_s: NonNegative(speed_m_s),
    })
}

fn within(engine: Engine, config: PatientConfig) -> Engine {
    engine.within(Arc::new(Patient::new(config)))
}

fn bits(engine: &Engine) -> Vec<u64> {
    let state = engine.state();
    let pose = state.world_from_capsule;
    let numbers = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
    let more = state.velocity_world_m_s.iter().chain(state.specific_force_capsule_m_s2.iter());
    numbers.chain(more).map(|v| v.to_bits()).collect()
}

fn scenario(text: &str) -> Result<Box<dyn World>, String> {
    let node = Node::parse_text(text, "s.toml", Path::new(""), &[]).map_err(|e| e.to_string())?;
    let file = ScenarioFile::from_node(node, ModelFolder::new(models())).map_err(|e| e.to_string())?;
    build_world(&file, 1, 0).map(|built| built.world).map_err(|e| e.to_string())
}

/// A capsule in the shipped colon, with `[patient]` and more from line 12 on.
fn in_the_colon(more: &str) -> String {
    format!(
        "[scenario]\nname = \"t\"\nduration_s = 30.0\n[capsule]\nmodel = \"pillcam-magnet\"\nstart_arc_length_mm = 100.0\n[tract]\n\
         model = \"colon\"\n[motility]\nspontaneous = false\n[patient]\n{more}"
    )
}

/// How far a capsule that falls freely in a turning, walking, coughing patient is from its parabola in the world after 0.2 s, m.
fn parabola_error_m(step_rate_hz: u32) -> f64 {
    let tract = tube(SegmentKey::Transverse, 0.4);
    let dry_segments = vec![SegmentKey::Transverse];
    let config = EngineConfig { step_rate_hz, settle_s: NonNegative(0.0), dry_segments, ..at(0.5) };
    let table = PatientEvent::Table(Ride {
        at_s: NonNegative(0.0),
        by_mm: [200.0, 0.0, 300.0].map(Finite),
        duration_s: Positive(0.5),
    });
    let event = vec![turn(0.0, Posture::LeftLateral, 0.5), cough(0.0, 30.0, [1.0, 0.0, 1.0]), table];
    let mut engine = within(engine(&tract, false, config), holding(event));
    let start = engine.state();
    engine.advance_to(seconds(0.2));
    let expected = start.world_from_capsule.translation.vector + GRAVITY * (0.5 * 0.2 * 0.2);
    let in_gut = engine.state_in_gut().world_from_capsule.translation.vector;
    let straight = Vector3::new(0.0, -0.5 * 9.81 * 0.04, 0.5);
    assert!((in_gut - straight).norm() > 0.05, "{in_gut}: the patient did not matter");
    (engine.state().world_from_capsule.translation.vector - expected).norm()
}

#[test]
fn closed_form_a_free_fall_is_a_parabola_in_the_world() {
    let [coarse, fine] = [2000, 8000].map(parabola_error_m);
    println!("figure: off the parabola {:.3} mm at 2 kHz, {:.3} mm at 8 kHz", 1e3 * coarse, 1e3 * fine);
    // The integrator is of the first order: g t dt / 2 is 0.49 mm and 0.12 mm.
    assert!(coarse < 6e-4 && fine < 0.3 * coarse, "{coarse} {fine}");
}

#[test]
fn law_a_patient_who_does_not_move_changes_nothing() {
    let tract = colon();
    let [mut alone, mut inside] = [false, true].map(|patient| {
        let engine = engine(&tract, true, at(0.1));
        let mut engine = if patient { within(engine, holding(Vec::new())) } else { engine };
        engine.settle().unwrap();
        engine
    });
    for i in 1..=30 {
        for engine in [&mut alone, &mut inside] {
            engine.advance_to(seconds(f64::from(i)));
        }
        assert_eq!(bits(&alone), bits(&inside), "{i} s");
    }
    // And their snapshots are not taken for one another's.
    assert!(inside.restore(&alone.snapshot()).is_err());
}

/// Everything that may happen, within 20 s.
const RESTLESS: &str = "breathing_period_s = 3.0\n\
     [[patient.event]]\nkind = \"cough\"\nat_s = 1.0\nacceleration_m_s2 = 12.0\n\
     [[patient.event]]\nkind = \"table\"\nat_s = 2.0\nby_mm = [0, 0, 250]\nduration_s = 5.0\n\
     [[patient.event]]\nkind = \"posture\"\nat_s = 3.0\nto = \"left-lateral\"\nduration_s = 3.0\n\
     [[patient.event]]\nkind = \"posture\"\nat_s = 7.0\nto = \"upright\"\nduration_s = 3.0\n\
     [[patient.event]]\nkind = \"walk\"\nfrom_s = 11.0\nto_s = 18.0\nspeed_m_s = 1.2\n";

#[test]
fn law_truth_is_consistent_with_differences_of_the_pose() {
    let mut world = scenario(&in_the_colon(&format!("{RESTLESS}[engine]\nstep_rate_hz = 1000\n"))).unwrap();
    world.advance_to(seconds(20.0)).unwrap();
    let truth = |t: f64| world.truth().capsule(seconds(t));
    let h = 1e-3;
    let (mut way, mut turned) = (Vector3::zeros(), 0.0);
    let (mut gained, mut way_m) = (Vector3::zeros(), 0.0);
    let steps = 19_000;
    for i in 0..steps {
        let t = 0.2 + h * f64::from(i);
        let [a, b] = [truth(t), truth(t + h)];
        let moved = b.world_from_capsule.translation.vector - a.world_from_capsule.translation.vector;
        let mean = (a.velocity_world_m_s + b.velocity_world_m_s) * 0.5;
        way += mean * h - moved;
        way_m += moved.norm();
        let turn = log_so3(&(a.world_from_capsule.rotation.inverse() * b.world_from_capsule.rotation)) / h;
        let rate = (a.angular_rate_capsule_rad_s + b.angular_rate_capsule_rad_s) * 0.5;
        turned += (turn - rate).norm() * h;
        let felt = |s: &lumenav_core::CapsuleTruth| {
            s.world_from_capsule.rotation * s.specific_force_capsule_m_s2 + GRAVITY
        };
        // The force of a step is that of its end.
        gained += felt(&b) * h;
        let error = a.velocity_world_m_s + felt(&b) * h - b.velocity_world_m_s;
        assert!(error.norm() < 0.02, "{t} s: {error}");
    }
    let change = truth(0.2 + h * f64::from(steps)).velocity_world_m_s - truth(0.2).velocity_world_m_s;
    println!(
        "figure: over {way_m:.2} m: velocity off by {:.3} mm, rate by {:.4} rad, force by {:.2} mm/s",
        1e3 * way.norm(),
        turned,
        1e3 * (gained - change).norm()
    );
    assert!(way_m > 5.0, "{way_m} m: nothing moved");
    assert!(way.norm() < 1e-4 && turned < 0.2, "{way} {turned}");
    assert!((gained - change).norm() < 2e-3, "{gained} {change}");
}

#[test]
fn closed_form_a_resting_capsule_feels_the_place_it_is_carried_along() {
    // In a bowel that holds it a capsule is carried: what it feels is gravity minus the acceleration of its place in the gut.
    let mut world =
        scenario(&in_the_colon(RESTLESS).replace("\"colon\"\n[mot", "\"colon\"\nradius_scale = 0.2\n[mot"))
            .unwrap();
    world.advance_to(seconds(20.0)).unwrap();
    let config = Node::parse_text(&in_the_colon(RESTLESS), "s.toml", Path::new(""), &[]).unwrap();
    let patient = Patient::of_file(&config).unwrap().unwrap();
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for i in 0..1800 {
        let t = 1.0 + 0.01 * f64::from(i);
        let truth = world.truth().capsule(seconds(t));
        let gut = patient.gut(t);
        let x = gut
            .world_from_frame
            .inverse_transform_point(&Point3::from(truth.world_from_capsule.translation.vector));
        let felt = gut.felt(&GRAVITY, &x.coords, &Vector3::zeros()).gravity_m_s2;
        let expected = gut.world_from_frame.rotation * -felt;
        let found = truth.world_from_capsule.rotation * truth.specific_force_capsule_m_s2;
        worst = worst.max((found - expected).norm());
        largest = largest.max((found - GRAVITY * -1.0).norm());
    }
    println!("figure: held capsule: {worst:.2} of {largest:.2} m/s2");
    assert!(largest > 5.0 && worst < 0.02 * largest, "{worst} {largest}");
}

#[test]
fn law_a_turn_to_the_left_moves_the_capsule_to_the_new_lowest_wall() {
    let tract = tube(SegmentKey::Transverse, 0.025);
    let event = vec![turn(1.0, Posture::LeftLateral, 3.0)];
    let mut engine = within(engine(&tract, false, at(0.5)), holding(event));
    engine.settle().unwrap();
    let across = |engine: &Engine| engine.state_in_gut().world_from_capsule.translation.vector.xy();
    let before = across(&engine);
    assert!(before.x.abs() < 2e-3 && before.y < -0.015, "{before}");
    engine.advance_to(seconds(8.0));
    let after = across(&engine);
    println!("figure: from {:.1} mm below the line to {:.1} mm left of it", -1e3 * before.y, -1e3 * after.x);
    assert!(after.y.abs() < 2e-3 && after.x < -0.015, "{after}");
    // Lowest in the world as well.
    let patient = engine.patient().unwrap().clone();
    let line = patient.gut(8.0).world_from_frame * Point3::new(0.0, 0.0, 0.5);
    assert!(engine.state().world_from_capsule.translation.vector.y < line.y - 0.015);
}

#[test]
fn law_the_centre_stays_inside_the_lumen_through_coughs_turns_and_steps() {
    let tract = colon();
    for (start_m, seed) in [(0.1, 0), (0.5, 1), (0.9, 2)] {
        let way = |i: u32| {
            let angle = 2.4 * f64::from(i + seed);
            [angle.cos(), angle.sin(), (0.7 * angle).cos()]
        };
        let mut event: Vec<PatientEvent> =
            (0..12).map(|i| cough(0.5 + 0.7 * f64::from(i), 50.0, way(i))).collect();
        event.push(turn(2.0, Posture::Upright, 0.5));
        event.push(walk(4.0, 8.0, 1.5));
        event.push(turn(8.5, Posture::Prone, 0.5));
        let mut engine =
            within(engine(&tract, true, at(start_m)), PatientConfig { event, ..PatientConfig::default() });
        engine.settle().unwrap();
        let (mut fastest, mut deepest) = (0.0_f64, f64::MIN);
        while engine.time() < seconds(10.0) {
            engine.step();
            let state = engine.state_in_gut();
            let rest_m = tract.radius.radius_m(state.arc_length_m);
            deepest = deepest.max(state.offset_m - (rest_m - CAPSULE.radius_m).max(0.0));
            fastest = fastest.max(state.velocity_world_m_s.norm());
        }
        println!("figure: from {start_m} m: {:.2} mm into the wall, up to {fastest:.2} m/s", 1e3 * deepest);
        assert!(deepest < TOLERANCE_M, "{deepest}");
        assert!(fastest > 0.2, "{fastest}: nothing was shaken");
    }
}

#[test]
fn law_steps_jumps_and_snapshots_are_the_same_within_a_patient() {
    let tract = tube(SegmentKey::Jejunum, 0.0075);
    let events = || {
        let mut event = vec![turn(20.0, Posture::LeftLateral, 4.0), cough(61.003, 20.0, [0.0, 0.3, 1.0])];
        event.push(turn(80.0017, Posture::Upright, 3.0));
        event.push(walk(100.0, 104.0, 1.0));
        event
    };
    let make = || {
        let mut engine = within(engine(&tract, false, at(0.3)), holding(events()));
        engine.settle().unwrap();
        engine
    };
    let (mut steps, mut jumps, mut resumed) = (make(), make(), make());
    let mut stepped = 0;
    for until_s in [0.9, 19.7, 21.0, 60.99, 62.0, 79.0, 99.0, 102.2, 160.0, 200.0] {
        while steps.time() < seconds(until_s) {
            steps.step();
            stepped += 1;
        }
        jumps.advance_to(steps.time());
        let bytes = resumed.snapshot();
        resumed = make();
        resumed.restore(&bytes).unwrap();
        resumed.advance_to(steps.time());
        assert_eq!(bits(&steps), bits(&jumps), "{until_s} s");
        assert_eq!(bits(&steps), bits(&resumed), "{until_s} s");
    }
    assert!(stepped > 38_000);
    // From 160 s on nothing ever moves again, and a snapshot of that wakes no sooner and hangs nowhere.
    // A patient who coughs at another time is another scenario.
    let mut other = within(engine(&tract, false, at(0.3)), holding(vec![cough(61.0, 20.0, [0.0, 0.3, 1.0])]));
    assert!(other.restore(&steps.snapshot()).is_err());
}

#[test]
fn law_a_moving_patient_wakes_a_sleeper_and_changes_little_by_sleep() {
    let tract = tube(SegmentKey::Jejunum, 0.0075);
    let run = |sleep: bool, event: Vec<PatientEvent>| {
        let mut engine = within(engine(&tract, false, EngineConfig { sleep, ..at(0.3) }), holding(event));
        engine.settle().unwrap();
        engine.advance_to(seconds(12.0));
        engine.state_in_gut().world_from_capsule.translation.vector
    };
    // Head up: the capsule presses on another side of the wall, whether it slept before or not.
    let turned = || vec![turn(5.0, Posture::LeftLateral, 1.0), cough(9.0, 20.0, [1.0, 0.0, 0.0])];
    let [resting, slept, awake] = [run(true, Vec::new()), run(true, turned()), run(false, turned())];
    println!(
        "figure: sleep changes {:.4} mm, the turn {:.2} mm",
        1e3 * (slept - awake).norm(),
        1e3 * (slept - resting).norm()
    );
    assert!((slept - awake).norm() < 1e-5, "{slept} {awake}");
    assert!((slept - resting).norm() > 1e-4, "{slept} {resting}");
}

#[test]
fn law_a_path_is_carried_by_the_patient() {
    let text = format!(
        "[scenario]\nname = \"t\"\nduration_s = 20.0\n[capsule]\nmodel = \"pillcam-magnet\"\n[truth]\nkind = \"helix\"\n[patient]\n{RESTLESS}"
    );
    let world = scenario(&text).unwrap();
    let h = 1e-4;
    let truth = |t: f64| world.truth().capsule(seconds(t));
    let mut largest = 0.0_f64;
    for i in 1..190 {
        let t = 0.0123 + 0.1 * f64::from(i);
        let [a, now, b] = [truth(t - h), truth(t), truth(t + h)];
        let place = |s: &lumenav_core::CapsuleTruth| s.world_from_capsule.translation.vector;
        let velocity = (place(&b) - place(&a)) / (2.0 * h);
        let acceleration = (place(&b) - place(&now) * 2.0 + place(&a)) / (h * h);
        let turned = a.world_from_capsule.rotation.inverse() * b.world_from_capsule.rotation;
        assert!((now.velocity_world_m_s - velocity).norm() < 1e-5, "{t} s");
        assert!((now.angular_rate_capsule_rad_s - log_so3(&turned) / (2.0 * h)).norm() < 1e-5, "{t} s");
        let force = now.world_from_capsule.rotation.inverse() * (acceleration - GRAVITY);
        assert!((now.specific_force_capsule_m_s2 - force).norm() < 1e-3, "{t} s");
        largest = largest.max(acceleration.norm());
    }
    assert!(largest > 2.0, "{largest}");
    let told = |name: &str| world.truth().told_frame(name, seconds(1.5)).unwrap();
    let real = |name: &str| world.truth().frame(name, seconds(1.5)).unwrap();
    assert_eq!(told("abdomen"), real("torso"));
    assert!((real("abdomen").translation.vector - real("torso").translation.vector).norm() > 0.004);
    assert!(world.truth().frame("knee", seconds(1.5)).is_none());
}

#[test]
fn law_bad_patients_are_refused_at_their_line() {
    let event = |text: &str| format!("[[patient.event]]\n{text}");
    for (more, said) in [
        (
            "breathing_depth = 3".to_owned(),
            "s.toml:12:1: `patient.breathing_depth`: unknown field `breathing_depth`, expected one of `posture`, `breathing_amplitude_mm`, `breathing_period_s`, `surface_amplitude_mm`, `organ_shift_mm`, `organ_shift_s`, `event`",
        ),
        (
            "posture = \"sitting\"".to_owned(),
            "s.toml:12:11: `patient.posture`: unknown variant `sitting`, expected one of `supine`, `prone`, `left-lateral`, `right-lateral`, `upright`",
        ),
        (
            "breathing_amplitude_mm = 101".to_owned(),
            "s.toml:12:26: `patient.breathing_amplitude_mm`: 1.01e2 is not allowed here; it must be from 0e0 to 1e2",
        ),
        (
            "breathing_amplitude_mm = -1".to_owned(),
            "s.toml:12:26: `patient.breathing_amplitude_mm`: -1 is not allowed here; it must be a finite number, 0 or above",
        ),
        ("breathing_period_s = 0.1".to_owned(), "s.toml:12:22: `patient.breathing_period_s`"),
        ("surface_amplitude_mm = 1e3".to_owned(), "s.toml:12:24: `patient.surface_amplitude_mm`"),
        ("organ_shift_mm = 1e3".to_owned(), "s.toml:12:18: `patient.organ_shift_mm`"),
        ("organ_shift_s = 1e300".to_owned(), "s.toml:12:17: `patient.organ_shift_s`"),
        ("event = 3".to_owned(), "`patient.event`: expected an array of tables"),
        (
            event("kind = \"sneeze\"\nat_s = 1"),
            "s.toml:13:8: `patient.event[0].kind`: unknown variant `sneeze`, expected one of `posture`, `cough`, `walk`, `table`",
        ),
        (event("kind = \"cough\""), "`patient.event[0]`: missing field `at_s`"),
        (
            event("kind = \"cough\"\nat_s = 1\nforce_n = 3"),
            "s.toml:15:1: `patient.event[0].force_n`: unknown field `force_n`, expected one of `at_s`, `acceleration_m_s2`, `duration_s`, `direction`",
        ),
        (
            event("kind = \"cough\"\nat_s = -1"),
            "s.toml:14:8: `patient.event[0].at_s`: -1 is not allowed here",
        ),
        (event("kind = \"cough\"\nat_s = 1e300"), "s.toml:14:8: `patient.event[0].at_s`"),
        (
            event("kind = \"cough\"\nat_s = 1\nacceleration_m_s2 = 1e3"),
            "s.toml:15:21: `patient.event[0].acceleration_m_s2`",
        ),
        (
            event("kind = \"cough\"\nat_s = 1\nduration_s = 1e-9"),
            "s.toml:15:14: `patient.event[0].duration_s`",
        ),
        (
            event("kind = \"cough\"\nat_s = 1\ndirection = [0, 0, 0]"),
            "s.toml:15:13: `patient.event[0].direction`: has the length 0e0; give a vector such as [0, 0, 1]",
        ),
        (
            event("kind = \"cough\"\nat_s = 1\n[[patient.event]]\nkind = \"cough\"\nat_s = 1.1"),
            "s.toml:17:8: `patient.event[1].at_s`: begins at 1.1 s, while the cough before it lasts until 1.3",
        ),
        (
            event("kind = \"table\"\nat_s = 1\nby_mm = [3000, 0, 4000]\nduration_s = 0.5"),
            "s.toml:16:14: `patient.event[0].duration_s`: 5.00 m in 0.5 s are 10.0 m/s; allowed: up to 1",
        ),
        (
            "breathing_amplitude_mm = 90\nbreathing_period_s = 0.5".to_owned(),
            "s.toml:12:26: `patient.breathing_amplitude_mm`: 90 mm every 0.5 s is more than 5 m/s²; allowed: up to 31.7",
        ),
        (
            event("kind = \"posture\"\nat_s = 1\nto = \"left-lateral\"\nduration_s = 0.01"),
            "s.toml:16:14: `patient.event[0].duration_s`",
        ),
        (event("kind = \"table\"\nat_s = 1\nby_mm = [0, 0, 1e9]"), "s.toml:15:9: `patient.event[0].by_mm`"),
        (
            event("kind = \"walk\"\nfrom_s = 1\nto_s = 9"),
            "s.toml:14:10: `patient.event[0].from_s`: the patient is supine then and cannot walk; allowed: after a `posture` event to \"upright\"",
        ),
        (
            format!("posture = \"upright\"\n{}", event("kind = \"walk\"\nfrom_s = 5\nto_s = 5.5")),
            "`patient.event[0].to_s`: the walk ends at 5.5 s and begins at 5 s; allowed: 1 s later",
        ),
        (
            format!(
                "posture = \"upright\"\n{}",
                event("kind = \"walk\"\nfrom_s = 1\nto_s = 9\nspeed_m_s = 9")
            ),
            "`patient.event[0].speed_m_s`",
        ),
        (
            format!(
                "{}\n{}",
                event("kind = \"posture\"\nat_s = 1\nto = \"prone\""),
                event("kind = \"posture\"\nat_s = 3\nto = \"supine\"")
            ),
            "s.toml:18:8: `patient.event[1].at_s`: begins at 3 s, while the turn or walk before it lasts until 5 s; allowed: from 5 on",
        ),
    ] {
        let message = scenario(&in_the_colon(&more)).map(|_| ()).unwrap_err();
        assert!(message.contains(said), "{more}\n{message}\n{said}");
    }
    let drawn = "[scenario]\nname = \"t\"\nduration_s = 1.0\n[capsule]\nmodel = \"pillcam-magnet\"\n[truth]\nkind = \"motion-model\"\n\
                 position_mm = [0, 0, 0]\nstep_ms = 10\n[truth.motion]\n[patient]\n";
    let message = scenario(drawn).map(|_| ()).unwrap_err();
    assert!(message.contains("s.toml:7:8: `truth.kind`: a motion model is drawn in the world"), "{message}");
}

#[test]
fn law_every_default_of_a_patient_has_a_source() {
    let events = "[[patient.event]]\nkind = \"cough\"\nat_s = 1\n[[patient.event]]\nkind = \"table\"\nat_s = 1\nby_mm = [0, 0, 1]\n\
         [[patient.event]]\nkind = \"posture\"\nat_s = 1\nto = \"upright\"\n[[patient.event]]\nkind = \"walk\"\nfrom_s = 9\nto_s = 12\n";
    let node = Node::parse_text(&format!("[patient]\n{events}"), "s.toml", Path::new(""), &[]).unwrap();
    let patient = Patient::of_file(&node).unwrap().unwrap();
    assert_eq!(patient.config().event.len(), 4);
    let mut sourced = std::collections::BTreeSet::new();
    for entry in node.log().entries() {
        for row in entry.rows().into_iter().filter(|row| !row.set) {
            assert!(row.source.is_some(), "{}.{} has no source", entry.path, row.key);
            sourced.insert(row.key.clone());
        }
    }
    let keys: std::collections::BTreeSet<String> =
        PATIENT_SOURCES.iter().chain(&PATIENT_EVENT_SOURCES).map(|(key, _)| (*key).to_owned()).collect();
    assert_eq!(sourced, keys);
}

#[test]
fn law_the_drawn_tract_follows_the_patient() {
    let mut world = scenario(&in_the_colon(RESTLESS)).unwrap();
    let mut still = Vec::new();
    world.static_scene(&mut still);
    for at_s in [0.0, 4.0, 8.5, 14.0] {
        world.advance_to(seconds(at_s)).unwrap();
        let mut moving = Vec::new();
        world.moving_scene(&mut moving);
        let placed = moving.iter().find_map(|primitive| match primitive {
            Primitive::Placement { path, world_from_path } if path == "tract" => Some(*world_from_path),
            _ => None,
        });
        let gut = world.truth().frame("gut", seconds(at_s)).unwrap();
        assert!((placed.unwrap().to_homogeneous() - gut.to_homogeneous()).norm() < 0.02, "{at_s} s");
    }
    let drawn: Vec<&str> = still
        .iter()
        .map(|primitive| match primitive {
            Primitive::Mesh { path, .. } | Primitive::Lines { path, .. } => path.as_str(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert!(drawn.iter().all(|path| path.starts_with("tract/")), "{drawn:?}");
    let notes: Vec<String> = world.take_notes().into_iter().map(|note| note.text).collect();
    assert!(notes.iter().any(|text| text == "patient: turns to left-lateral until 6 s"), "{notes:?}");
}
