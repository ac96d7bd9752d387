//! Pouches of the wall, from a table to what they do to a capsule.

use lumenav_anatomy::diverticulum::Diverticulum;
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::{MotilityConfig, WaveConfig};
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, Tract, TractDraft};
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{CapsuleBody, ConfigError, Node, RandomStreams, SimTime};
use lumenav_scenario::diverticula::DiverticulumTable;
use lumenav_scenario::engine::{Engine, EngineConfig, TOLERANCE_M};
use nalgebra::Vector3;
use std::path::Path;
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
const RADIUS_M: f64 = 0.02;

/// A straight, wide duodenum along z, of a patient on the back.
fn duodenum() -> Arc<Tract> {
    let ends = (End::Closed, End::Closed);
    Arc::new(TractDraft::straight(SegmentKey::Duodenum, RADIUS_M, 0.4, ends).build().unwrap().0)
}

fn place(text: &str) -> Result<Diverticulum, ConfigError> {
    let text = format!("[[tract.diverticulum]]\n{text}");
    let node = Node::parse_text(&text, "scenario.toml", Path::new(""), &[]).unwrap();
    let node = node.child_or_empty("tract").children("diverticulum").unwrap().remove(0);
    node.parse::<DiverticulumTable>()?.place(&duodenum(), &node)
}

/// At 200 mm, on the side that is `turn_deg` from the one that gravity points to.
fn pouch(turn_deg: f64) -> Diverticulum {
    let station = duodenum().station(0.2);
    let down = Vector3::from(EngineConfig::default().gravity_torso_m_s2.map(|g| g.0));
    let angle_deg = down.dot(&station.binormal).atan2(down.dot(&station.normal)).to_degrees() + turn_deg;
    place(&format!(
        "segment = \"duodenum\"\nat_mm = 200\nangle_deg = {angle_deg:?}\ndepth_mm = 20\nmouth_mm = 32"
    ))
    .unwrap()
}

fn engine(start_m: f64, wave: Option<WaveConfig>, pouches: &[Diverticulum]) -> Engine {
    let tract = duodenum();
    let motility =
        MotilityConfig { spontaneous: false, wave: wave.into_iter().collect(), ..MotilityConfig::default() };
    let motility = Motility::new(&motility, &tract, &RandomStreams::new(1, 0, "motility")).unwrap();
    let config = EngineConfig { start_arc_length_m: NonNegative(start_m), ..EngineConfig::default() };
    let mut engine = Engine::new(config, tract, motility, CAPSULE).unwrap();
    for pouch in pouches {
        engine.insert_diverticulum(*pouch);
    }
    engine.settle().unwrap();
    engine
}

/// How far the capsule's centre is beyond where the resting wall, with its pouches, would touch it, m.
fn excess_m(engine: &Engine) -> f64 {
    let state = engine.state();
    let centre = state.world_from_capsule.translation.vector;
    let station = engine.tract().station(state.arc_length_m);
    let away = centre - station.position_m.coords;
    let angle = away.dot(&station.binormal).atan2(away.dot(&station.normal));
    let resting_m = engine.lumen().outermost(state.arc_length_m, angle).x;
    state.offset_m - (resting_m - CAPSULE.radius_m).max(0.0)
}

#[test]
fn law_a_capsule_sinks_into_a_pouch_below_it_and_into_no_other() {
    let offset_m = |pouches: &[Diverticulum]| {
        let mut engine = engine(0.2, None, pouches);
        engine.advance_to(SimTime::from_seconds(10.0));
        assert!(excess_m(&engine) < TOLERANCE_M);
        engine.state().offset_m
    };
    let free_m = RADIUS_M - CAPSULE.radius_m;
    let (without_m, beside_m, below_m) = (offset_m(&[]), offset_m(&[pouch(180.0)]), offset_m(&[pouch(0.0)]));
    assert!((without_m - free_m).abs() < 5e-4, "{without_m}");
    // Half around the lumen 1.3 % of the 20 mm are left.
    assert!((beside_m - without_m).abs() < 4e-4, "{beside_m}");
    // It lies along the lumen: where its ends touch, 10 to 13 mm from the middle, the pouch is 13 to 15 mm deep.
    assert!((0.010..0.016).contains(&(below_m - free_m)), "{below_m}");
}

#[test]
fn law_whatever_pulls_it_stays_in_the_pouch() {
    let mut engine = engine(0.2, None, &[pouch(0.0)]);
    let mut deepest_m = 0.0_f64;
    for k in 0..60 {
        // Half a newton, round and round, and along.
        let way = 0.7 * f64::from(k);
        let force = Vector3::new(way.cos(), way.sin(), 0.3 * (0.2 * f64::from(k)).sin()) * 0.5;
        engine.apply_wrench(&force, &Vector3::zeros());
        for _ in 0..60 {
            engine.step();
            assert!(excess_m(&engine) < TOLERANCE_M, "{} at {:?}", excess_m(&engine), engine.state());
            deepest_m = deepest_m.max(engine.state().offset_m);
        }
    }
    assert!(deepest_m > RADIUS_M, "it was never in the pouch: {deepest_m}");
}

#[test]
fn law_a_wave_that_carries_a_capsule_past_leaves_it_in_a_pouch() {
    let wave = WaveConfig {
        start_time_s: NonNegative(1.0),
        segment: None,
        start_m: Finite(0.10),
        speed_m_s: Finite(0.008),
        run_m: Some(Positive(0.22)),
        duration_s: None,
        width_m: Positive(0.02),
        amplitude: Fraction(0.9),
        flattens_ahead_m: NonNegative(0.0),
    };
    let reached = |pouches: &[Diverticulum]| {
        let mut engine = engine(0.14, Some(wave.clone()), pouches);
        engine.advance_to(SimTime::from_seconds(60.0));
        engine.state()
    };
    let (without, with) = (reached(&[]), reached(&[pouch(0.0)]));
    assert!(without.arc_length_m > 0.27, "{without:?}");
    // Within the mouth, and its centre beyond the lumen's wall.
    assert!((with.arc_length_m - 0.2).abs() < 0.016 && with.offset_m > RADIUS_M, "{with:?}");
}

#[test]
fn law_mistakes_name_the_key_and_what_is_allowed() {
    for (text, key, said) in [
        ("at_mm = 500\ndepth_mm = 10\nmouth_mm = 20", "at_mm", "0 to 400"),
        ("segment = \"caecum\"\nat_mm = 5\ndepth_mm = 10\nmouth_mm = 20", "segment", "duodenum"),
        ("at_mm = 200\ndepth_mm = 25\nmouth_mm = 20", "depth_mm", "to 20"),
        ("at_mm = 200\ndepth_mm = 5\nmouth_mm = 6", "mouth_mm", "10 to 33.3"),
        ("at_mm = 200\ndepth_mm = 5\nmouth_mm = 60", "mouth_mm", "10 to 33.3"),
        ("at_mm = 200\ndepth_mm = -5\nmouth_mm = 20", "depth_mm", "above 0"),
        ("at_mm = 200\nmouth_mm = 20", "depth_mm", "missing"),
        ("at_mm = 200\ndepth_mm = 5\nmouth_mm = 20\nneck_mm = 3", "neck_mm", "mouth_mm"),
    ] {
        let error = place(text).unwrap_err().to_string();
        assert!(error.contains("scenario.toml:") && error.contains(key) && error.contains(said), "{error}");
    }
}
