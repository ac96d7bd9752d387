//! The engine against closed forms, laws and published behaviour: see the names.

use lumenav_anatomy::generator::{ColonRequest, colon};
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility::fault::{FaultConfig, FaultKind};
use lumenav_anatomy::motility_config::{ColonConfig, MmcConfig, MotilityConfig, WaveConfig};
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, SegmentPoints, Tract, TractDraft};
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_core::config::Node;
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{CapsuleBody, RandomStreams, SimTime};
use lumenav_scenario::engine::{
    Engine, EngineConfig, EngineError, EventKind, Obstacle, TOLERANCE_M, fuzz_inside_lumen,
};
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;
use std::sync::Arc;

mod inside;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
/// Volume of the capsule: a cylinder of 15 mm and two half balls.
const VOLUME_M3: f64 = std::f64::consts::PI * 0.0055 * 0.0055 * (0.015 + 4.0 / 3.0 * 0.0055);

fn tract_through(points_m: Vec<Point3<f64>>, key: SegmentKey, radius_m: f64, ends: (End, End)) -> Arc<Tract> {
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
        ends,
        torso_half_extents_m: None,
        source: "test".into(),
    };
    Arc::new(draft.build().unwrap().0)
}

/// Along z: horizontal for a patient on the back.
fn straight(key: SegmentKey, radius_m: f64, ends: (End, End)) -> Arc<Tract> {
    let points = (0..=20).map(|i| Point3::new(0.0, 0.0, 0.05 * f64::from(i))).collect();
    tract_through(points, key, radius_m, ends)
}

fn closed(key: SegmentKey, radius_m: f64) -> Arc<Tract> {
    straight(key, radius_m, (End::Closed, End::Closed))
}

/// A coil with the median bend radius of the small bowel, 20 mm.
fn coil() -> Arc<Tract> {
    let points = (0..400)
        .map(|i| 0.06 * f64::from(i))
        .map(|a| Point3::new(0.02 * a.cos(), 0.02 * a.sin(), 0.005 * a))
        .collect();
    tract_through(points, SegmentKey::Jejunum, 0.0075, (End::Closed, End::Closed))
}

fn a_colon(seed: u64) -> Arc<Tract> {
    Arc::new(colon(&ColonRequest::default(), &RandomStreams::new(seed, 0, "tract")).unwrap().tract)
}

fn tract_of(file: &Path, segments: &[SegmentKey]) -> Arc<Tract> {
    let options = TractOptions { segments: segments.to_vec(), ..TractOptions::default() };
    Arc::new(load(&Node::open(file).unwrap(), &options).unwrap().0)
}

/// `models/tracts/colon.toml`.
fn shipped_colon() -> Arc<Tract> {
    tract_of(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tracts/colon.toml"), &[])
}

/// The tract of a real person (EdinGCA_3D_00090), `None` without data.
fn measured(test: &str, segments: &[SegmentKey]) -> Option<Arc<Tract>> {
    let Some(folder) = std::env::var_os("LUMENAV_DATA") else {
        println!("{test}: SKIPPED (LUMENAV_DATA unset)");
        return None;
    };
    println!("REAL-DATA ran {test}");
    Some(tract_of(&Path::new(&folder).join("tracts/gi_tract_edin00090.toml"), segments))
}

const MEASURED_COLON: [SegmentKey; 3] =
    [SegmentKey::Ascending, SegmentKey::Transverse, SegmentKey::Descending];

fn still() -> MotilityConfig {
    MotilityConfig { spontaneous: false, ..MotilityConfig::default() }
}

fn wave(
    start_time_s: f64,
    start_m: f64,
    speed_m_s: f64,
    run_m: f64,
    width_m: f64,
    amplitude: f64,
) -> WaveConfig {
    WaveConfig {
        start_time_s: NonNegative(start_time_s),
        segment: None,
        start_m: Finite(start_m),
        speed_m_s: Finite(speed_m_s),
        run_m: Some(Positive(run_m)),
        duration_s: None,
        width_m: Positive(width_m),
        amplitude: Fraction(amplitude),
        flattens_ahead_m: NonNegative(0.2),
    }
}

/// A propulsive sequence of the colon: 22 mm/s over 0.41 m.
fn mass_movement(start_time_s: f64, start_m: f64) -> WaveConfig {
    let colon = ColonConfig::default();
    wave(
        start_time_s,
        start_m,
        colon.mass_speed_m_s.0,
        colon.mass_run_m.0,
        colon.mass_width_m.0,
        colon.mass_amplitude.0,
    )
}

fn engine_of(tract: &Arc<Tract>, motility: &MotilityConfig, config: EngineConfig, seed: u64) -> Engine {
    let motility = Motility::new(motility, tract, &RandomStreams::new(seed, 0, "motility")).unwrap();
    Engine::new(config, tract.clone(), motility, CAPSULE).unwrap()
}

fn at(start_m: f64) -> EngineConfig {
    EngineConfig { start_arc_length_m: NonNegative(start_m), ..EngineConfig::default() }
}

fn seconds(s: f64) -> SimTime {
    SimTime::from_seconds(s)
}

/// Everything of a state, as bits.
fn bits(engine: &Engine) -> Vec<u64> {
    let state = engine.state();
    let pose = state.world_from_capsule;
    let mut numbers = vec![state.arc_length_m, state.offset_m, state.wall_force_n];
    numbers.extend(pose.translation.vector.iter());
    numbers.extend(pose.rotation.coords.iter());
    numbers.extend(state.velocity_world_m_s.iter());
    numbers.extend(state.angular_rate_capsule_rad_s.iter());
    numbers.extend(state.specific_force_capsule_m_s2.iter());
    numbers.into_iter().map(f64::to_bits).collect()
}

#[test]
fn closed_form_free_fall() {
    // Without air: after n steps of the semi-implicit rule the fall is g dt² n (n + 1) / 2.
    let tract = closed(SegmentKey::Ascending, 0.5);
    let config = EngineConfig { dry_segments: vec![SegmentKey::Ascending], step_rate_hz: 1000, ..at(0.5) };
    let mut engine = engine_of(&tract, &still(), config, 1);
    engine.advance_to(seconds(0.2));
    let state = engine.state();
    let fall_m = 9.81 * 1e-6 * 200.0 * 201.0 / 2.0;
    assert!(
        (state.world_from_capsule.translation.vector + Vector3::y() * fall_m - Vector3::z() * 0.5).norm()
            < 1e-12
    );
    assert!((state.velocity_world_m_s + Vector3::y() * 9.81 * 0.2).norm() < 1e-12);
    assert!(state.specific_force_capsule_m_s2.norm() < 1e-9, "an accelerometer in free fall reads zero");
    assert!(!state.contact);
}

#[test]
fn closed_form_terminal_speed_in_water() {
    // (m - rho V) g = 6 pi eta r v + rho/2 C_d pi r² v².
    let tract = closed(SegmentKey::Ascending, 0.9);
    let mut engine = engine_of(&tract, &still(), at(0.5), 1);
    engine.advance_to(seconds(1.0));
    let weight_n = (CAPSULE.mass_kg - 1000.0 * VOLUME_M3) * 9.81;
    let r = CAPSULE.radius_m;
    let (a, b) = (500.0 * std::f64::consts::PI * r * r, 6.0 * std::f64::consts::PI * 1e-3 * r);
    let speed = (-b + (b * b + 4.0 * a * weight_n).sqrt()) / (2.0 * a);
    let state = engine.state();
    assert!(!state.contact);
    let relative = state.velocity_world_m_s.norm() / speed - 1.0;
    assert!(relative.abs() < 1e-5, "{} is not {speed}", state.velocity_world_m_s.norm());
}

#[test]
fn closed_form_wall_carries_the_net_weight_at_rest() {
    for (radius_m, key) in [(0.0085, SegmentKey::Ileum), (0.02, SegmentKey::Rectum)] {
        let tract = closed(key, radius_m);
        let mut engine = engine_of(&tract, &still(), at(0.5), 1);
        engine.advance_to(seconds(20.0));
        let state = engine.state();
        let weight_n = (CAPSULE.mass_kg - 1000.0 * VOLUME_M3) * 9.81;
        assert!(state.contact);
        assert!(
            (state.wall_force_n / weight_n - 1.0).abs() < 1e-3,
            "{} N not {weight_n}",
            state.wall_force_n
        );
        let up = state.world_from_capsule.rotation * state.specific_force_capsule_m_s2;
        assert!((up - Vector3::y() * 9.81).norm() < 1e-3, "an accelerometer at rest reads +g upwards: {up}");
    }
}

#[test]
fn law_without_waves_nothing_is_transported_in_a_straight_tube() {
    let tract = closed(SegmentKey::Jejunum, 0.0085);
    let motility = MotilityConfig { amplitude_scale: Fraction(0.0), ..MotilityConfig::default() };
    let mut engine = engine_of(&tract, &motility, at(0.5), 1);
    engine.advance_to(seconds(5.0));
    let start_m = engine.state().arc_length_m;
    engine.advance_to(seconds(65.0));
    let moved_m = engine.state().arc_length_m - start_m;
    assert!(moved_m.abs() < 1e-3, "moved {moved_m} m");
}

#[test]
fn law_without_waves_nothing_is_transported_in_the_colon() {
    let tract = a_colon(1);
    let motility = MotilityConfig { amplitude_scale: Fraction(0.0), ..MotilityConfig::default() };
    for i in 0..10 {
        let mut engine = engine_of(&tract, &motility, at(0.05 + 0.14 * f64::from(i)), 1);
        engine.advance_to(seconds(60.0));
        let start_m = engine.state().arc_length_m;
        engine.advance_to(seconds(120.0));
        let moved_m = engine.state().arc_length_m - start_m;
        assert!(moved_m.abs() < 1e-3, "start {i}: moved {moved_m} m");
    }
}

#[test]
fn law_without_waves_energy_does_not_grow() {
    // Kinetic and potential energy stay below what the kick gave; the wall can only lend and damp.
    let tract = coil();
    let mut engine = engine_of(&tract, &still(), at(0.3), 1);
    engine.apply_wrench(&Vector3::new(0.1, 0.2, 0.15), &Vector3::new(1e-4, 2e-4, -1e-4));
    for _ in 0..12 {
        engine.step();
    }
    engine.apply_wrench(&Vector3::zeros(), &Vector3::zeros());
    let energy_j = |engine: &Engine| {
        let state = engine.state();
        let w = state.angular_rate_capsule_rad_s;
        // Moments of the uniform capsule, from above by a solid cylinder of its full size.
        let (axial, across) = (0.5 * 0.0033 * 0.0055 * 0.0055, 0.0033 * (0.026 * 0.026 / 12.0));
        0.5 * CAPSULE.mass_kg * state.velocity_world_m_s.norm_squared()
            + 0.5 * (axial * w.x * w.x + across * (w.y * w.y + w.z * w.z))
            + (CAPSULE.mass_kg - 1000.0 * VOLUME_M3) * 9.81 * state.world_from_capsule.translation.vector.y
    };
    // What the wall holds at the end of the kick: half a force times the way it gave, below 3 mm.
    let start_j = energy_j(&engine) + 0.5 * engine.state().wall_force_n * 3e-3;
    let mut settled_j = f64::INFINITY;
    for i in 0..2400 {
        engine.step();
        let now_j = energy_j(&engine);
        assert!(now_j <= start_j + 1e-9, "step {i}: {now_j} J above {start_j} J");
        settled_j = now_j;
    }
    assert!(settled_j < start_j, "nothing was damped");
    assert!(engine.state().velocity_world_m_s.norm() < 1e-3, "still moving after 10 s");
}

#[test]
fn law_one_wave_ends_at_the_same_place_at_240_and_1000_hz() {
    let cases = [
        (closed(SegmentKey::Ascending, 0.02), mass_movement(2.0, 0.1), 0.2, 0.25),
        (closed(SegmentKey::Ileum, 0.0085), wave(2.0, 0.1, 0.014, 0.12, 0.01, 0.9), 0.14, 0.03),
        (closed(SegmentKey::Jejunum, 0.0085), wave(2.0, 0.1, 0.014, 0.12, 0.01, 0.55), 0.14, 0.001),
    ];
    for (i, (tract, wave, start_m, least_m)) in cases.into_iter().enumerate() {
        let mut motility = still();
        motility.wave.push(wave);
        let end_m = [240, 1000].map(|step_rate_hz| {
            let mut engine = engine_of(&tract, &motility, EngineConfig { step_rate_hz, ..at(start_m) }, 1);
            engine.advance_to(seconds(30.0));
            engine.state().arc_length_m
        });
        assert!(end_m[0] - start_m >= least_m, "case {i}: carried only from {start_m} to {} m", end_m[0]);
        let difference_m = (end_m[0] - end_m[1]).abs();
        println!(
            "figure: 240 against 1000 Hz, case {i}: end points {:.3} mm apart after {:.1} mm",
            1e3 * difference_m,
            1e3 * (end_m[1] - start_m)
        );
        assert!(difference_m < 1e-3 && difference_m < 0.01 * end_m[1], "case {i}: {end_m:?}");
    }
}

/// How far two propulsive sequences, at 60 s and 330 s, carry a capsule within ten minutes.
fn carried_m(tract: &Arc<Tract>, spontaneous: bool, seed: u64) -> f64 {
    let wave = vec![mass_movement(60.0, 0.02), mass_movement(330.0, 0.28)];
    let motility = MotilityConfig { spontaneous, wave, ..busy() };
    let mut engine = engine_of(tract, &motility, at(0.12), seed);
    engine.advance_to(seconds(600.0));
    engine.state().arc_length_m - 0.12
}

#[test]
fn regress_two_mass_movements_carry_the_capsule_half_a_metre() {
    // Propulsive sequences of the colon: 22 ± 3 mm/s over 41 ± 6 cm move content by 25 cm each (doi:10.1152/ajpgi.2000.278.2.G329). `contraction_stiffening`,
    // `mass_amplitude` and `mass_width_m` are tuned to this very target: it is a check of the tuning, not an independent one.
    // The wall alone moves the capsule, from the ascending colon, with and without the haustra's own contractions.
    let shipped = shipped_colon();
    for (tract, spontaneous, seed) in
        [(&a_colon(1), false, 1), (&a_colon(2), true, 2), (&shipped, true, 3), (&shipped, true, 4)]
    {
        let carried_m = carried_m(tract, spontaneous, seed);
        println!("figure: distance in the colon, seed {seed}: {carried_m:.3} m by two mass movements");
        assert!(carried_m >= 0.5, "seed {seed}: {carried_m} m");
    }
}

#[test]
fn regress_two_mass_movements_carry_the_capsule_through_a_measured_colon() {
    let Some(tract) =
        measured("regress_two_mass_movements_carry_the_capsule_through_a_measured_colon", &MEASURED_COLON)
    else {
        return;
    };
    for seed in [1, 2] {
        let carried_m = carried_m(&tract, true, seed);
        println!("figure: distance in a measured colon, seed {seed}: {carried_m:.3} m by two mass movements");
        assert!(carried_m >= 0.3, "seed {seed}: {carried_m} m");
    }
}

/// A wave at the start of phase III, and haustra that never rest.
fn busy() -> MotilityConfig {
    let mmc = MmcConfig { start_phase: Some(Fraction(0.95)), ..MmcConfig::default() };
    let colon = ColonConfig { burst_fraction: Fraction(1.0), ..ColonConfig::default() };
    MotilityConfig { mmc, colon, wave: vec![mass_movement(3.0, 0.02)], ..MotilityConfig::default() }
}

#[test]
fn law_same_scenario_same_bytes() {
    let tract = a_colon(2);
    let run = |seed| {
        let mut engine = engine_of(&tract, &busy(), at(0.1), seed);
        engine.advance_to(seconds(40.0));
        (bits(&engine), engine.snapshot())
    };
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).0, run(6).0, "another seed moves the capsule otherwise");
    println!("figure: seeds: 2 runs of seed 5 agree in every byte, seed 6 differs");
}

#[test]
fn law_a_resumed_run_continues_bit_by_bit() {
    let tract = a_colon(2);
    // With a polyp in its way rapier takes part.
    let station = tract.station(0.16);
    let polyp = Obstacle::Ball { centre_torso_m: station.position_m - Vector3::y() * 0.012, radius_m: 0.006 };
    for obstacle in [None, Some(polyp)] {
        let make = || {
            let mut engine = engine_of(&tract, &busy(), at(0.1), 5);
            if let Some(obstacle) = &obstacle {
                engine.insert_obstacle(obstacle);
            }
            engine
        };
        let mut whole = make();
        let mut first = make();
        let (half, end) = (seconds(7.3), seconds(25.0));
        first.advance_to(half);
        let bytes = first.snapshot();
        let mut second = make();
        second.restore(&bytes).unwrap();
        assert_eq!(second.snapshot(), bytes);
        whole.advance_to(end);
        second.advance_to(end);
        assert_eq!(bits(&whole), bits(&second));
        assert_eq!(whole.snapshot(), second.snapshot());
        // And back in time.
        whole.restore(&bytes).unwrap();
        whole.advance_to(end);
        assert_eq!(bits(&whole), bits(&second));
    }
}

#[test]
fn law_foreign_bytes_are_no_snapshot() {
    let tract = closed(SegmentKey::Jejunum, 0.0085);
    let mut engine = engine_of(&tract, &still(), at(0.5), 1);
    engine.advance_to(seconds(1.0));
    let bytes = engine.snapshot();
    let before = bits(&engine);
    for length in 0..bytes.len() {
        assert!(engine.restore(&bytes[..length]).is_err(), "{length} bytes were accepted");
    }
    let longer = [bytes.as_slice(), &[0]].concat();
    assert!(engine.restore(&longer).is_err());
    let mut other =
        engine_of(&tract, &still(), EngineConfig { coulomb_newton: NonNegative(0.0), ..at(0.5) }, 1);
    assert!(other.restore(&bytes).is_err(), "a snapshot of another configuration was accepted");
    assert_eq!(before, bits(&engine), "a refused snapshot changed the engine");
}

#[test]
fn law_a_snapshot_of_another_tract_or_motility_is_refused() {
    let tract = closed(SegmentKey::Jejunum, 0.0085);
    let make = |tract: &Arc<Tract>, motility: &MotilityConfig| engine_of(tract, motility, at(0.5), 1);
    let motility = MotilityConfig::default();
    let bytes = make(&tract, &motility).snapshot();
    assert!(make(&tract, &motility).restore(&bytes).is_ok());
    // The same length, another radius; the same waves, but for their strength, width or rate.
    let wider = closed(SegmentKey::Jejunum, 0.0086);
    assert_eq!(wider.length_m(), tract.length_m());
    assert!(make(&wider, &motility).restore(&bytes).is_err(), "another radius");
    for (what, change) in [
        ("amplitude_scale", (|m| m.amplitude_scale.0 = 0.9) as fn(&mut MotilityConfig)),
        ("taenia_relief", |m| m.taenia_relief.0 = 0.1),
        ("jejunum.width_m", |m| m.jejunum.width_m.0 = 0.011),
        ("jejunum.amplitude", |m| m.jejunum.amplitude[1].0 = 0.5),
        ("jejunum.rate_hz", |m| m.jejunum.rate_hz[0].0 = 0.2),
    ] {
        let mut other = motility.clone();
        change(&mut other);
        assert!(make(&tract, &other).restore(&bytes).is_err(), "{what}");
    }
    // As many obstacles, elsewhere or of another size.
    let blocked = |x_m: f64, radius_m: f64| {
        let mut engine = make(&tract, &motility);
        engine.insert_obstacle(&Obstacle::Ball { centre_torso_m: Point3::new(x_m, 0.0, 0.9), radius_m });
        engine
    };
    let bytes = blocked(0.006, 0.002).snapshot();
    assert!(blocked(0.006, 0.002).restore(&bytes).is_ok());
    assert!(blocked(0.005, 0.002).restore(&bytes).is_err(), "an obstacle elsewhere");
    assert!(blocked(0.006, 0.003).restore(&bytes).is_err(), "a larger obstacle");
}

#[test]
fn law_the_step_of_advancing_does_not_matter() {
    let tract = a_colon(3);
    let mut at_once = engine_of(&tract, &busy(), at(0.1), 3);
    let mut in_pieces = engine_of(&tract, &busy(), at(0.1), 3);
    at_once.advance_to(seconds(12.0));
    for i in 1..=1200 {
        in_pieces.advance_to(seconds(0.01 * f64::from(i)));
    }
    assert_eq!(bits(&at_once), bits(&in_pieces));
}

#[test]
fn law_a_closed_end_holds_and_an_exit_lets_go() {
    for ends in [(End::Closed, End::Closed), (End::Closed, End::Exit)] {
        let tract = straight(SegmentKey::Ileum, 0.0085, ends);
        let mut engine = engine_of(&tract, &still(), at(0.9), 1);
        engine.apply_wrench(&Vector3::new(0.0, 0.0, 0.3), &Vector3::zeros());
        let mut kinds = Vec::new();
        for i in 1..=600 {
            engine.advance_to(seconds(0.1 * f64::from(i)));
            kinds.extend(engine.events().iter().map(|event| event.kind));
        }
        let state = engine.state();
        if ends.1 == End::Exit {
            assert!(state.left && kinds.contains(&EventKind::Left), "{kinds:?}");
            // Outside it rests: an estimator is not to be judged by a velocity that leads nowhere.
            assert_eq!(state.velocity_world_m_s, Vector3::zeros());
            assert_eq!(state.angular_rate_capsule_rad_s, Vector3::zeros());
            let felt = state.world_from_capsule.rotation * state.specific_force_capsule_m_s2;
            assert!((felt - Vector3::new(0.0, 9.81, 0.0)).norm() < 1e-12, "{felt}");
            assert_eq!((state.wall_force_n, state.contact), (0.0, false));
            let frozen = bits(&engine);
            engine.advance_to(seconds(70.0));
            assert_eq!(frozen, bits(&engine), "truth moves after the capsule left");
            assert_eq!(engine.state().at, seconds(70.0), "time goes on");
        } else {
            assert!(!state.left);
            let z = state.world_from_capsule.translation.vector.z;
            assert!((z - (1.0 - 0.013)).abs() < 3e-3, "the capsule rests at z = {z} m");
        }
    }
}

#[test]
fn law_a_capsule_falls_to_the_other_side_when_gravity_turns() {
    let mut engine = engine_of(&closed(SegmentKey::Ascending, 0.02), &still(), at(0.5), 1);
    for up in [1.0, -1.0, 1.0] {
        engine.set_gravity_torso(&Vector3::new(0.0, -9.81 * up, 0.0));
        let later_s = engine.time().seconds() + 10.0;
        engine.advance_to(seconds(later_s));
        let state = engine.state();
        assert!(state.world_from_capsule.translation.vector.y * up < -0.005, "{state:?}");
        let felt = state.world_from_capsule.rotation * state.specific_force_capsule_m_s2;
        assert!((felt - Vector3::y() * 9.81 * up).norm() < 0.05, "{felt}");
    }
}

/// A capsule 40 mm behind the pylorus comes back into the stomach while contents come back, and not otherwise.
#[test]
fn law_reflux_brings_a_capsule_back_into_the_stomach() {
    let shipped =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tracts/whole-gut-average-man.toml");
    let tract = tract_of(&shipped, &[SegmentKey::Stomach, SegmentKey::Duodenum, SegmentKey::Jejunum]);
    let pylorus_m = tract.segments[0].end_m;
    let furthest_back_m = |reflux: bool, seed: u64| {
        let mut motility = MotilityConfig::default();
        // Phase II, and then phase III.
        motility.mmc.start_phase = Some(Fraction(0.8));
        if reflux {
            motility.fault.push(FaultConfig {
                kind: FaultKind::Reflux,
                start_s: NonNegative(0.0),
                end_s: None,
                remaining: Fraction(0.0),
            });
        }
        let mut engine = engine_of(&tract, &motility, at(pylorus_m + 0.04), seed);
        let mut least_m = f64::INFINITY;
        for minute in 1..=15 {
            engine.advance_to(seconds(60.0 * f64::from(minute)));
            least_m = least_m.min(engine.state().arc_length_m);
        }
        least_m - pylorus_m
    };
    for seed in 1..=3 {
        let (back_m, usual_m) = (furthest_back_m(true, seed), furthest_back_m(false, seed));
        assert!(back_m < -0.013, "seed {seed}: {back_m} m from the pylorus");
        assert!(usual_m > 0.0, "seed {seed}, without reflux: {usual_m} m from the pylorus");
    }
}

#[test]
fn law_a_plate_stops_what_a_wave_carries() {
    let tract = closed(SegmentKey::Ascending, 0.02);
    let mut motility = still();
    motility.wave.push(mass_movement(2.0, 0.1));
    let mut engine = engine_of(&tract, &motility, at(0.2), 1);
    engine.insert_obstacle(&Obstacle::Plate {
        torso_from_plate: Isometry3::translation(0.0, 0.0, 0.3),
        half_extents_m: Vector3::new(0.03, 0.03, 0.001),
    });
    for _ in 0..7200 {
        engine.step();
        let z = engine.state().world_from_capsule.translation.vector.z;
        assert!(z < 0.3 - 0.001 - CAPSULE.radius_m + 1e-3, "through the plate: z = {z}");
    }
    assert!(engine.state().arc_length_m > 0.25, "never reached the plate");
}

#[test]
fn law_events_tell_borders_and_rest() {
    let tract = a_colon(1);
    let mut motility = still();
    motility.wave.push(mass_movement(5.0, 0.02));
    let config =
        EngineConfig { stalled_after_s: Positive(60.0), retained_after_s: Positive(90.0), ..at(0.1) };
    let mut engine = engine_of(&tract, &motility, config, 1);
    let mut kinds = Vec::new();
    for i in 1..=1500 {
        engine.advance_to(seconds(0.1 * f64::from(i)));
        kinds.extend(engine.events().iter().map(|event| event.kind));
    }
    let flexure = EventKind::LandmarkPassed { name: "hepatic_flexure", aboral: true };
    let place = |kind| kinds.iter().position(|k| *k == kind);
    assert!(place(flexure).is_some(), "{kinds:?}");
    assert!(place(EventKind::SegmentEntered(SegmentKey::Transverse)) > place(flexure), "{kinds:?}");
    assert!(place(EventKind::Retained) > place(EventKind::Stalled), "{kinds:?}");
    assert_eq!(kinds.iter().filter(|k| **k == EventKind::Stalled).count(), 1, "{kinds:?}");
}

/// The largest speed of the centre in the first 0.2 s, m/s.
fn first_speed_m_s(engine: &mut Engine) -> f64 {
    let mut fastest_m_s: f64 = 0.0;
    while engine.time() < seconds(0.2) {
        engine.step();
        fastest_m_s = fastest_m_s.max(engine.state().velocity_world_m_s.norm());
    }
    fastest_m_s
}

#[test]
fn law_a_settled_capsule_starts_at_rest_where_it_was_put() {
    let tract = shipped_colon();
    let mut motility = still();
    motility.amplitude_scale = Fraction(0.0);
    let (mut moved_m, mut slowest_s, mut refused): (f64, f64, u32) = (0.0, 0.0, 0);
    for i in 0..50 {
        let mut engine = engine_of(&tract, &motility, at(0.02 + 0.028 * f64::from(i)), 1);
        match engine.settle() {
            Ok(settled) => {
                assert_eq!((engine.time(), engine.events().len()), (SimTime::ZERO, 0));
                let state = engine.state();
                assert!(state.contact && settled.moved_m.abs() <= 0.013, "{settled:?}, {state:?}");
                assert!((settled.moved_m - (state.arc_length_m - 0.02 - 0.028 * f64::from(i))).abs() < 1e-12);
                let speed_m_s = first_speed_m_s(&mut engine);
                assert!(speed_m_s < 5e-3, "start {i}: {speed_m_s} m/s");
                (moved_m, slowest_s) = (moved_m.max(settled.moved_m.abs()), slowest_s.max(settled.took_s));
            }
            // The crest of a fold or a steep stretch: nothing holds a capsule there.
            Err(error) => {
                println!("{error}");
                refused += 1;
            }
        }
    }
    println!(
        "figure: settling, 50 starts in the shipped colon: {refused} refused, worst {:.2} mm along the tract, {slowest_s:.1} s",
        1e3 * moved_m
    );
    assert!(refused <= 6, "{refused} of 50 starts were refused, measured: 6");
    // The shipped scenarios' starts; without settling the capsule falls.
    for start_m in [0.06, 0.1] {
        let mut engine = engine_of(&tract, &motility, at(start_m), 1);
        let settled = engine.settle().unwrap();
        assert!(settled.moved_m.abs() < 3e-3, "{settled:?}");
        assert!(first_speed_m_s(&mut engine) < 2.5e-3);
        assert!(first_speed_m_s(&mut engine_of(&tract, &motility, at(start_m), 1)) > 0.05);
    }
}

#[test]
fn law_a_settled_run_resumes_and_repeats_bit_by_bit() {
    let tract = a_colon(2);
    let settled = || {
        let mut engine = engine_of(&tract, &busy(), at(0.1), 5);
        engine.settle().unwrap();
        engine
    };
    let (mut whole, mut first) = (settled(), settled());
    assert_eq!(whole.snapshot(), first.snapshot());
    // At the start, and later: an engine that never settled takes on the state as well.
    for half_s in [0.0, 3.3] {
        first.advance_to(seconds(half_s));
        let mut resumed = engine_of(&tract, &busy(), at(0.1), 5);
        resumed.restore(&first.snapshot()).unwrap();
        whole.advance_to(seconds(10.0));
        resumed.advance_to(seconds(10.0));
        assert_eq!(bits(&whole), bits(&resumed));
    }
}

#[test]
fn law_a_start_that_nothing_holds_is_refused() {
    // Upright in a wide tube: it falls.
    let points = (0..=20).map(|i| Point3::new(0.0, 0.05 * f64::from(i), 0.0)).collect();
    let tract = tract_through(points, SegmentKey::Ascending, 0.03, (End::Closed, End::Closed));
    let error = engine_of(&tract, &still(), at(0.5), 1).settle().unwrap_err().to_string();
    for words in ["put at 500.0 mm", "within 13.0 mm", "settle_s = 0"] {
        assert!(error.contains(words), "{error}");
    }
    let mut falling = engine_of(&tract, &still(), EngineConfig { settle_s: NonNegative(0.0), ..at(0.5) }, 1);
    let before = bits(&falling);
    assert_eq!(falling.settle().map(|settled| settled.took_s), Ok(0.0));
    assert_eq!(bits(&falling), before);
}
