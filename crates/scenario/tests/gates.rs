//! Sleep, the pylorus, the ileocaecal valve and the collapsed oesophagus.

use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::{MotilityConfig, WaveConfig};
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, SegmentPoints, Tract, TractDraft};
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{CapsuleBody, RandomStreams, SimTime};
use lumenav_scenario::engine::{Engine, EngineConfig, EventKind};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };

/// Two segments of 0.4 m along z, horizontal for a patient on the back.
fn two(keys: [SegmentKey; 2], radii_m: [f64; 2]) -> Arc<Tract> {
    let segment = |k: usize| SegmentPoints {
        key: keys[k],
        points_m: (0..=20).map(|i| Point3::new(0.0, 0.0, 0.4 * k as f64 + 0.02 * f64::from(i))).collect(),
        radii_m: vec![radii_m[k]; 21],
        wall: keys[k].default_wall(),
        source: "test".into(),
    };
    let draft = TractDraft {
        name: "test".into(),
        segments: vec![segment(0), segment(1)],
        ends: (End::Closed, End::Closed),
        torso_half_extents_m: None,
        source: "test".into(),
    };
    Arc::new(draft.build().unwrap().0)
}

fn engine(tract: &Arc<Tract>, motility: &MotilityConfig, config: EngineConfig) -> Engine {
    let motility = Motility::new(motility, tract, &RandomStreams::new(5, 0, "motility")).unwrap();
    Engine::new(config, tract.clone(), motility, CAPSULE).unwrap()
}

fn at(start_m: f64) -> EngineConfig {
    EngineConfig { start_arc_length_m: NonNegative(start_m), ..EngineConfig::default() }
}

fn seconds(s: f64) -> SimTime {
    SimTime::from_seconds(s)
}

/// Waves that come by at 100 and 1000 s, and none of the bowel's own.
fn two_waves() -> MotilityConfig {
    let wave = |start_time_s, start_m| WaveConfig {
        start_time_s: NonNegative(start_time_s),
        segment: None,
        start_m: Finite(start_m),
        speed_m_s: Finite(0.008),
        run_m: Some(Positive(0.3)),
        duration_s: None,
        width_m: Positive(0.01),
        amplitude: Fraction(0.6),
        flattens_ahead_m: NonNegative(0.0),
    };
    MotilityConfig {
        spontaneous: false,
        wave: vec![wave(100.0, 0.05), wave(1000.0, 0.25)],
        ..MotilityConfig::default()
    }
}

fn ileum() -> Arc<Tract> {
    two([SegmentKey::Jejunum, SegmentKey::Ileum], [0.0075; 2])
}

fn bits(engine: &Engine) -> Vec<u64> {
    let state = engine.state();
    let pose = state.world_from_capsule;
    let mut numbers = vec![state.arc_length_m, state.offset_m, state.wall_force_n];
    numbers.extend(pose.translation.vector.iter().chain(pose.rotation.coords.iter()));
    numbers.extend(state.velocity_world_m_s.iter().chain(state.specific_force_capsule_m_s2.iter()));
    numbers.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn law_sleep_changes_nothing_measurable() {
    let tract = ileum();
    let mut ends = Vec::new();
    for sleep in [true, false] {
        let mut engine = engine(&tract, &two_waves(), EngineConfig { sleep, ..at(0.2) });
        engine.settle().unwrap();
        let mut places = Vec::new();
        for time_s in [50.0, 90.0, 300.0, 900.0, 1300.0] {
            engine.advance_to(seconds(time_s));
            places.push(engine.state().arc_length_m);
        }
        ends.push(places);
    }
    // Both waves carry it on by centimetres.
    assert!(ends[0][2] - ends[0][0] > 0.03 && ends[0][4] - ends[0][3] > 0.03, "{ends:?}");
    // Asleep it does not creep at all; awake by no more than the regularised friction lets it.
    assert_eq!(ends[0][0].to_bits(), ends[0][1].to_bits());
    for (asleep, awake) in ends[0].iter().zip(&ends[1]) {
        assert!((asleep - awake).abs() < 1e-3, "{ends:?}");
    }
}

#[test]
fn law_sleep_by_steps_by_jumps_and_across_a_snapshot_is_the_same() {
    let tract = ileum();
    let make = || {
        let mut engine = engine(&tract, &two_waves(), at(0.2));
        engine.settle().unwrap();
        engine
    };
    let (mut jumps, mut steps, mut pieces) = (make(), make(), make());
    jumps.advance_to(seconds(1100.0));
    for _ in 0..1100 * 240 {
        steps.step();
    }
    assert_eq!(bits(&jumps), bits(&steps));
    // Asleep at 700 s.
    pieces.advance_to(seconds(700.0));
    let snapshot = pieces.snapshot();
    let mut resumed = make();
    resumed.restore(&snapshot).unwrap();
    for engine in [&mut pieces, &mut resumed] {
        engine.advance_to(seconds(1100.0));
        assert_eq!(bits(&jumps), bits(engine));
    }
}

#[test]
fn law_a_sleeper_is_told_as_stalled_and_retained_in_time() {
    let config =
        EngineConfig { stalled_after_s: Positive(200.0), retained_after_s: Positive(500.0), ..at(0.2) };
    let motility = MotilityConfig { spontaneous: false, ..MotilityConfig::default() };
    let mut engine = engine(&ileum(), &motility, config);
    engine.settle().unwrap();
    engine.advance_to(seconds(3600.0));
    let told: Vec<(f64, EventKind)> = engine.events().iter().map(|e| (e.at.seconds(), e.kind)).collect();
    let of = |kind| told.iter().find(|(_, k)| *k == kind).map(|(at, _)| *at).unwrap();
    assert!((of(EventKind::Stalled) - 200.0).abs() < 0.01, "{told:?}");
    assert!((of(EventKind::Retained) - 500.0).abs() < 0.01, "{told:?}");
}

#[test]
fn law_gravity_and_a_pull_wake_a_sleeper() {
    let make = || {
        let mut engine =
            engine(&ileum(), &MotilityConfig { spontaneous: false, ..MotilityConfig::default() }, at(0.2));
        engine.settle().unwrap();
        engine.advance_to(seconds(60.0));
        engine
    };
    let rested = make().state().world_from_capsule.translation.vector;
    let mut turned = make();
    turned.set_gravity_torso(&Vector3::new(9.81, 0.0, 0.0));
    turned.advance_to(seconds(70.0));
    assert!(turned.state().world_from_capsule.translation.vector.x - rested.x > 1e-3);
    let mut pulled = make();
    pulled.apply_wrench(&Vector3::new(0.0, 0.0, 0.2), &Vector3::zeros());
    pulled.advance_to(seconds(70.0));
    assert!(pulled.state().arc_length_m > 0.22);
}

#[test]
fn law_the_ileocaecal_valve_lets_through_and_not_back() {
    let tract = two([SegmentKey::TerminalIleum, SegmentKey::Caecum], [0.008, 0.012]);
    let motility = MotilityConfig { spontaneous: false, ..MotilityConfig::default() };
    let mut engine = engine(&tract, &motility, at(0.35));
    let pull = |engine: &mut Engine, newton: f64, until_s: f64| {
        engine.apply_wrench(&Vector3::new(0.0, 0.0, newton), &Vector3::zeros());
        engine.advance_to(seconds(until_s));
        engine.state().arc_length_m
    };
    assert!(pull(&mut engine, 0.1, 60.0) > 0.45, "it does not come in");
    let shut = engine.snapshot();
    let back_m = pull(&mut engine, -0.1, 120.0);
    assert!((0.4..0.42).contains(&back_m), "pulled back to {back_m} m");
    // A resumed run knows that it has passed.
    engine.restore(&shut).unwrap();
    assert!((0.4..0.42).contains(&pull(&mut engine, -0.1, 120.0)));
}

/// Where a capsule that starts 60 mm before the pylorus is after five minutes.
fn after_five_minutes_m(opening_fraction: f64) -> f64 {
    let tract = two([SegmentKey::Stomach, SegmentKey::Duodenum], [0.012, 0.01]);
    let mut motility = MotilityConfig::default();
    motility.pylorus.opening_fraction = Fraction(opening_fraction);
    // The duodenum at rest, phase I.
    motility.mmc.start_phase = Some(Fraction(0.05));
    let mut engine = engine(&tract, &motility, at(0.34));
    engine.advance_to(seconds(300.0));
    engine.state().arc_length_m
}

#[test]
fn law_the_pylorus_holds_until_a_wave_opens_it() {
    let shut_m = after_five_minutes_m(0.0);
    assert!((0.34..0.395).contains(&shut_m), "closed, the capsule is at {shut_m} m");
    let open_m = after_five_minutes_m(1.0);
    assert!(open_m > 0.4, "opened by every wave, the capsule is at {open_m} m");
}

#[test]
fn closed_form_a_capsule_sinks_in_a_collapsed_oesophagus_at_weight_over_friction() {
    // Along the axis, touching nothing: v = m g / (grip c_v), 3.3 g over 0.04 x 15 N s/m: 54 mm/s.
    let tract = two([SegmentKey::Oesophagus, SegmentKey::Stomach], [0.007, 0.015]);
    let motility = MotilityConfig { spontaneous: false, ..MotilityConfig::default() };
    let down = [0.0, 0.0, 9.81].map(Finite);
    // Swallowed long after it is looked at: no wave.
    let motility = MotilityConfig {
        oesophagus: lumenav_anatomy::motility_config::OesophagusConfig {
            swallow_time_s: NonNegative(1e4),
            ..Default::default()
        },
        ..motility
    };
    let mut engine = engine(&tract, &motility, EngineConfig { gravity_torso_m_s2: down, ..at(0.05) });
    engine.advance_to(seconds(1.0));
    let before_m = engine.state().arc_length_m;
    engine.advance_to(seconds(3.0));
    let speed_m_s = (engine.state().arc_length_m - before_m) / 2.0;
    let expected_m_s = 0.0033 * 9.81 / (0.04 * 15.0);
    assert!((speed_m_s / expected_m_s - 1.0).abs() < 1e-3, "{speed_m_s}, not {expected_m_s} m/s");
}
