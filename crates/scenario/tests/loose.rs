//! What is loose in the tract beside the capsule: residue, a second capsule, a tether.

use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::{MotilityConfig, WaveConfig};
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, Tract, TractDraft};
use lumenav_anatomy::tract_file::{self, TractOptions};
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{CapsuleBody, ConfigError, Node, RandomStreams, SimTime};
use lumenav_scenario::engine::{
    Engine, EngineConfig, EngineError, EventKind, Loose, Tether, beyond_m, ends_of, fuzz_inside_lumen,
};
use lumenav_scenario::loose::LooseTable;
use nalgebra::{Isometry3, Point3, Vector3};
use rand::Rng as _;
use std::path::Path;
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
const TETHER: Tether =
    Tether { length_m: 0.05, radius_m: 0.001, link_m: 0.01, density_kg_m3: 1200.0, held: true };

/// A straight ileum along z, open at its anal end.
fn ileum(radius_m: f64) -> Arc<Tract> {
    Arc::new(
        TractDraft::straight(SegmentKey::Ileum, radius_m, 0.4, (End::Closed, End::Exit)).build().unwrap().0,
    )
}

/// A capsule at 100 mm and, unless it is still, a strong wave from 60 mm on that takes it along at 10 mm/s.
fn engine(radius_m: f64, still: bool) -> Engine {
    let tract = ileum(radius_m);
    let wave = WaveConfig {
        start_time_s: NonNegative(1.0),
        segment: None,
        start_m: Finite(0.06),
        speed_m_s: Finite(0.01),
        run_m: Some(Positive(0.3)),
        duration_s: None,
        width_m: Positive(0.01),
        amplitude: Fraction(0.8),
        flattens_ahead_m: NonNegative(0.0),
    };
    let wave = if still { vec![] } else { vec![wave] };
    let motility = MotilityConfig { spontaneous: false, wave, ..MotilityConfig::default() };
    let motility = Motility::new(&motility, &tract, &RandomStreams::new(1, 0, "motility")).unwrap();
    let config = EngineConfig { start_arc_length_m: NonNegative(0.1), ..EngineConfig::default() };
    Engine::new(config, tract, motility, CAPSULE).unwrap()
}

fn ball(radius_m: f64, arc_length_m: f64) -> Loose {
    let mass_kg = 1050.0 * 4.0 / 3.0 * std::f64::consts::PI * radius_m.powi(3);
    Loose { shape: CapsuleBody { radius_m, length_m: 2.0 * radius_m, mass_kg }, arc_length_m }
}

/// Distance of the axes of two capsules less their radii, m, by points along them.
fn gap_m(one: &(CapsuleBody, Isometry3<f64>), other: &(CapsuleBody, Isometry3<f64>)) -> f64 {
    let along = |(shape, pose): &(CapsuleBody, Isometry3<f64>), part: f64| {
        pose * Point3::new((0.5 * shape.length_m - shape.radius_m) * part, 0.0, 0.0)
    };
    let parts = || (-50..=50).map(|k| f64::from(k) / 50.0);
    let nearest = parts()
        .flat_map(|a| parts().map(move |b| (along(one, a) - along(other, b)).norm()))
        .fold(f64::INFINITY, f64::min);
    nearest - one.0.radius_m - other.0.radius_m
}

#[test]
fn law_a_capsule_pushes_residue_before_it() {
    let mut engine = engine(0.0085, false);
    engine.insert_loose(&ball(0.005, 0.16)).unwrap();
    engine.settle().unwrap();
    let start_m = engine.loose().next().unwrap().2;
    assert!((start_m - 0.16).abs() < 0.005, "{start_m}");
    let (mut nearest_m, mut pushed) = (f64::INFINITY, false);
    for k in 1..=120 {
        engine.advance_to(SimTime::from_seconds(0.25 * f64::from(k)));
        let (shape, pose, s_m) = engine.loose().next().unwrap();
        let state = engine.state();
        nearest_m = nearest_m.min(gap_m(&(CAPSULE, state.world_from_capsule), &(shape, pose)));
        pushed |= s_m > 0.25;
        assert!(s_m > state.arc_length_m, "the ball fell behind at {:.1} s", 0.25 * f64::from(k));
    }
    // They touch, and do not enter each other.
    assert!(pushed && (-5e-5..5e-4).contains(&nearest_m), "{pushed}, {nearest_m} m");
}

#[test]
fn law_two_capsules_do_not_enter_each_other() {
    let mut engine = engine(0.0085, false);
    engine.insert_loose(&Loose { shape: CAPSULE, arc_length_m: 0.15 }).unwrap();
    engine.settle().unwrap();
    let mut nearest_m = f64::INFINITY;
    for k in 1..=120 {
        engine.advance_to(SimTime::from_seconds(0.25 * f64::from(k)));
        let (shape, pose, _) = engine.loose().next().unwrap();
        nearest_m = nearest_m.min(gap_m(&(CAPSULE, engine.state().world_from_capsule), &(shape, pose)));
    }
    let second_m = engine.loose().next().unwrap().2;
    assert!(second_m > 0.25 && second_m - engine.state().arc_length_m > 0.02, "{second_m}");
    assert!((-5e-5..5e-4).contains(&nearest_m), "{nearest_m} m");
}

#[test]
fn cross_a_second_capsule_rests_as_the_first_does() {
    // The same body in the same wall, one as the capsule, the other beside it: both sink as far into the wall.
    let mut engine = engine(0.012, true);
    engine.insert_loose(&Loose { shape: CAPSULE, arc_length_m: 0.2 }).unwrap();
    engine.settle().unwrap();
    engine.advance_to(SimTime::from_seconds(5.0));
    let (_, pose, s_m) = engine.loose().next().unwrap();
    let state = engine.state();
    let first = state.world_from_capsule.translation.vector;
    assert!((pose.translation.y - first.y).abs() < 2e-6, "{} {}", pose.translation.y, first.y);
    assert!((s_m - 0.2).abs() < 1e-4 && (state.arc_length_m - 0.1).abs() < 1e-4, "{s_m}");
}

#[test]
fn closed_form_adhesion_goes_with_the_surface() {
    // A small heavy capsule starts to slide where its weight along the tract exceeds mu N + F0 grip (its surface over the capsule's).
    let wall = SegmentKey::Ileum.default_wall();
    let (radius_m, length_m) = (0.004_f64, 0.016);
    let volume_m3 =
        std::f64::consts::PI * radius_m.powi(2) * (length_m - 2.0 * radius_m + 4.0 / 3.0 * radius_m);
    let shape = CapsuleBody { radius_m, length_m, mass_kg: 3000.0 * volume_m3 };
    let (heavy_kg, share) = (2000.0 * volume_m3, 4.0 * 16.0 / (5.5 * 26.0));
    let limit_m_s2 =
        wall.friction * 9.81 + EngineConfig::default().coulomb_newton.0 * wall.grip * share / heavy_kg;
    let slid_m = |part: f64| {
        let mut engine = engine(0.012, true);
        engine.insert_loose(&Loose { shape, arc_length_m: 0.2 }).unwrap();
        engine.settle().unwrap();
        let start_m = engine.loose().next().unwrap().2;
        engine.set_gravity_torso(&Vector3::new(0.0, -9.81, part * limit_m_s2));
        engine.advance_to(SimTime::from_seconds(10.0));
        engine.loose().next().unwrap().2 - start_m
    };
    let (below_m, above_m) = (slid_m(0.9), slid_m(1.1));
    println!("limit {limit_m_s2} m/s2: {below_m} m below, {above_m} m above");
    assert!(below_m < 1e-3 && above_m > 5e-3, "{below_m}, {above_m}");
}

#[test]
fn closed_form_a_held_tether_lets_a_capsule_go_as_far_as_it_reaches() {
    // It lies stretched from the capsule's tip to where it is held, so the capsule stays; without, and with a free one, it is carried on.
    let carried_m = |tether: Option<Tether>| {
        let mut engine = engine(0.0085, false);
        if let Some(tether) = tether {
            engine.attach_tether(&tether).unwrap();
        }
        engine.settle().unwrap();
        let start_m = engine.state().arc_length_m;
        let mut links_m: Vec<f64> = Vec::new();
        for k in 1..=100 {
            engine.advance_to(SimTime::from_seconds(0.25 * f64::from(k)));
            let mut end_m = engine.oral_tip_gut_m();
            for (shape, pose, _) in engine.loose() {
                let [aboral, oral] = ends_of(&shape, &pose);
                links_m.push((aboral - end_m).norm());
                end_m = oral;
            }
        }
        let apart_m = links_m.iter().copied().fold(0.0, f64::max);
        (engine.state().arc_length_m - start_m, apart_m)
    };
    let (alone_m, _) = carried_m(None);
    let (held_m, apart_m) = carried_m(Some(TETHER));
    let (free_m, free_apart_m) = carried_m(Some(Tether { held: false, ..TETHER }));
    println!(
        "alone {alone_m} m, held {held_m} m (joints {apart_m} m), free {free_m} m (joints {free_apart_m} m)"
    );
    assert!(alone_m > 0.15 && free_m > 0.15, "{alone_m}, {free_m}");
    // The wave passes under it, and behind the wave it is pushed back a little.
    assert!((-0.015..0.002).contains(&held_m), "{held_m}");
    assert!(apart_m < 5e-5 && free_apart_m < 5e-5, "{apart_m}, {free_apart_m}");
}

#[test]
fn law_a_snapshot_holds_what_is_loose() {
    let make = || {
        let mut engine = engine(0.0085, false);
        engine.insert_loose(&ball(0.004, 0.15)).unwrap();
        engine.insert_loose(&Loose { shape: CAPSULE, arc_length_m: 0.19 }).unwrap();
        engine.attach_tether(&TETHER).unwrap();
        engine.settle().unwrap();
        engine
    };
    let mut whole = make();
    whole.advance_to(SimTime::from_seconds(8.0));
    let snapshot = whole.snapshot();
    let mut resumed = make();
    resumed.restore(&snapshot).unwrap();
    assert_eq!(resumed.snapshot(), snapshot);
    for engine in [&mut whole, &mut resumed] {
        engine.advance_to(SimTime::from_seconds(20.0));
    }
    assert_eq!(whole.snapshot(), resumed.snapshot());
    let mut without = engine(0.0085, false);
    assert!(matches!(without.restore(&snapshot), Err(EngineError::Snapshot { .. })));
}

/// A ball before a capsule, both of which slide out of the tract; the ball has left and the capsule has not.
fn left_by_a_ball(others: &[Loose]) -> Engine {
    let mut engine = sliding(others);
    for k in 1..=600 {
        engine.advance_to(SimTime::from_seconds(0.1 * f64::from(k)));
        let z_m = engine.loose().next().unwrap().1.translation.z;
        if z_m > 0.4 {
            assert!(z_m < 0.41 && !engine.state().left, "{z_m}");
            return engine;
        }
    }
    panic!("the ball did not leave");
}

fn sliding(others: &[Loose]) -> Engine {
    let mut engine = engine(0.0085, true);
    engine.insert_loose(&ball(0.005, 0.395)).unwrap();
    for other in others {
        engine.insert_loose(other).unwrap();
    }
    engine.set_gravity_torso(&Vector3::new(0.0, 0.0, 30.0));
    engine
}

#[test]
fn law_what_has_left_is_in_nobodys_way() {
    let mut engine = left_by_a_ball(&[]);
    let pose = engine.loose().next().unwrap().1;
    // The capsule comes through where it rests.
    let from_s = engine.time().seconds();
    engine.advance_to(SimTime::from_seconds(from_s + 600.0));
    assert!(engine.state().left, "at {} m", engine.state().arc_length_m);
    assert_eq!(engine.loose().next().unwrap().1, pose);
}

#[test]
fn law_a_snapshot_holds_what_has_left() {
    // Alone afterwards, and with another ball, with which the capsule is solved together.
    for others in [vec![], vec![ball(0.004, 0.15)]] {
        let mut whole = left_by_a_ball(&others);
        let mut resumed = sliding(&others);
        resumed.restore(&whole.snapshot()).unwrap();
        let (before_m, from_s) = (resumed.state().arc_length_m, resumed.time().seconds());
        for engine in [&mut whole, &mut resumed] {
            engine.advance_to(SimTime::from_seconds(from_s + 1.0));
            assert!(engine.is_sound());
        }
        assert!(resumed.state().arc_length_m > before_m + 1e-4, "it stands still");
        assert_eq!(whole.snapshot(), resumed.snapshot());
    }
}

/// The folded jejunum of a shipped gut with phase III all along it.
fn folded() -> Engine {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tracts/whole-gut-average-man.toml");
    let options = TractOptions { segments: vec![SegmentKey::Jejunum], length_scale: 1.0, radius_scale: 1.0 };
    let tract = Arc::new(tract_file::load(&Node::open(&model).unwrap(), &options).unwrap().0);
    let mut motility = MotilityConfig::default();
    motility.mmc.rate_factor = [Fraction(1.0); 3];
    let motility = Motility::new(&motility, &tract, &RandomStreams::new(1, 0, "motility")).unwrap();
    let config = EngineConfig {
        start_arc_length_m: NonNegative(0.25),
        settle_s: NonNegative(0.0),
        ..EngineConfig::default()
    };
    Engine::new(config, tract, motility, CAPSULE).unwrap()
}

/// How far the centres come beyond where they lie against the resting wall, m, within so many seconds: of the capsule, of all others; and when the tether was
/// told to take a short cut, s, at which it ends.
fn excess_m(engine: &mut Engine, seconds: u32) -> ([f64; 2], Option<f64>) {
    let mut worst_m = [0.0_f64; 2];
    for k in 1..=10 * seconds {
        let time_s = 0.1 * f64::from(k);
        engine.advance_to(SimTime::from_seconds(time_s));
        if engine.events().iter().any(|event| matches!(event.kind, EventKind::TetherCrossed { .. })) {
            return (worst_m, Some(time_s));
        }
        let state = engine.state();
        let centre = Point3::from(state.world_from_capsule.translation.vector);
        worst_m[0] = worst_m[0].max(beyond_m(engine.lumen(), &centre, state.arc_length_m, CAPSULE.radius_m));
        for (shape, pose, s_m) in engine.loose() {
            let centre = Point3::from(pose.translation.vector);
            worst_m[1] = worst_m[1].max(beyond_m(engine.lumen(), &centre, s_m, shape.radius_m));
        }
    }
    (worst_m, None)
}

#[test]
fn law_nothing_loose_leaves_the_lumen() {
    // 3 mm is the engine's own tolerance.
    let mut engine = folded();
    engine.insert_loose(&ball(0.004, 0.30)).unwrap();
    engine.insert_loose(&ball(0.003, 0.33)).unwrap();
    engine.insert_loose(&Loose { shape: CAPSULE, arc_length_m: 0.37 }).unwrap();
    let (loose, _) = excess_m(&mut engine, 240);
    println!("loose {loose:?}");
    assert!(loose.iter().all(|excess_m| *excess_m < 0.003), "{loose:?}");
}

#[test]
fn law_a_taut_tether_stays_in_the_lumen() {
    let mut engine = folded();
    engine.attach_tether(&Tether { length_m: 0.2, link_m: 0.02, ..TETHER }).unwrap();
    let (tethered, crossed) = excess_m(&mut engine, 240);
    println!("tethered {tethered:?} at {}", engine.state().arc_length_m);
    assert_eq!(crossed, None);
    assert!(tethered.iter().all(|excess_m| *excess_m < 0.003), "{tethered:?}");
}

fn place(text: &str) -> Result<Loose, ConfigError> {
    let text = format!("[[tract.loose]]\n{text}");
    let node = Node::parse_text(&text, "scenario.toml", Path::new(""), &[]).unwrap();
    let node = node.child_or_empty("tract").children("loose").unwrap().remove(0);
    node.parse::<LooseTable>()?.place(&ileum(0.0085), &CAPSULE, &node)
}

#[test]
fn law_tables_say_what_is_loose() {
    let residue = place("kind = \"residue\"\nsegment = \"ileum\"\nat_mm = 200\nradius_mm = 5").unwrap();
    let Loose { shape, arc_length_m } = residue;
    assert_eq!((shape.radius_m, shape.length_m, arc_length_m), (0.005, 0.01, 0.2));
    // 0.55 g: 1050 kg/m³ times 4/3 pi r³.
    assert!((shape.mass_kg - 0.5498e-3).abs() < 1e-7, "{}", shape.mass_kg);
    assert_eq!(place("kind = \"capsule\"\nat_mm = 200").unwrap().shape, CAPSULE);
    let other = place("kind = \"capsule\"\nat_mm = 200\nlength_mm = 24\nradius_mm = 6\nmass_g = 2").unwrap();
    assert_eq!(other.shape, CapsuleBody { radius_m: 0.006, length_m: 0.024, mass_kg: 0.002 });
    for (text, at, what) in [
        ("kind = \"residue\"\nat_mm = 200", ":2:", "radius_mm"),
        ("kind = \"residue\"\nat_mm = 200\nradius_mm = 30", ":4:", "0.5 to 20"),
        ("kind = \"residue\"\nat_mm = 200\nradius_mm = 3\nmass_g = 2", ":5:", "density_kg_m3"),
        ("kind = \"residue\"\nat_mm = 900\nradius_mm = 3", ":3:", "0 to 400"),
        ("kind = \"capsule\"\nat_mm = 200\ndensity_kg_m3 = 2", ":4:", "mass_g"),
        ("kind = \"capsule\"\nat_mm = 200\nradius_mm = 14", ":4:", "26.0 mm"),
        ("kind = \"capsule\"\nat_mm = 200\nlength_mm = 9", ":4:", "9.0 mm"),
        ("kind = \"residue\"\nat_mm = 200\nradius_mm = 3\ndensity_kg_m3 = 1e300", ":5:", "20000"),
        ("kind = \"capsule\"\nat_mm = 200\nlength_mm = 1e6", ":4:", "1000"),
        ("kind = \"capsule\"\nat_mm = 200\nmass_g = 1e-9", ":4:", "10000"),
        ("kind = \"worm\"\nat_mm = 200", ":2:", "residue"),
    ] {
        let error = place(text).unwrap_err().to_string();
        assert!(error.contains(at) && error.contains(what), "{text}: {error}");
    }
}

#[test]
fn law_impossible_bodies_are_refused() {
    let mut engine = engine(0.0085, true);
    let flat = CapsuleBody { length_m: 0.005, ..CAPSULE };
    assert!(matches!(
        engine.insert_loose(&Loose { shape: flat, arc_length_m: 0.2 }),
        Err(EngineError::LooseShape { .. })
    ));
    assert!(matches!(engine.insert_loose(&ball(0.004, 0.5)), Err(EngineError::OutOfRange { .. })));
    for tether in [
        Tether { length_m: 0.09, ..TETHER },
        Tether { link_m: 0.002, ..TETHER },
        Tether { radius_m: 0.006, ..TETHER },
        Tether { density_kg_m3: f64::NAN, ..TETHER },
    ] {
        assert!(matches!(engine.attach_tether(&tether), Err(EngineError::OutOfRange { .. })), "{tether:?}");
    }
    let longest = Tether { length_m: 0.0868, ..TETHER };
    assert!(engine.attach_tether(&longest).is_ok());
    assert!(matches!(engine.attach_tether(&longest), Err(EngineError::TetherTwice)));
    let links = engine.loose().count();
    assert_eq!(links, 9);
    // In the capsule, in a link, beside both.
    for (place_m, free) in [(0.105, false), (0.06, false), (0.15, true), (0.152, false)] {
        let inserted = engine.insert_loose(&ball(0.004, place_m));
        assert_eq!(inserted.is_ok(), free, "{place_m}: {inserted:?}");
        assert!(free || matches!(inserted, Err(EngineError::Occupied { .. })), "{inserted:?}");
    }
    assert_eq!(engine.loose().count(), links + 1);
    // Links of 10 cm find no room in the folds of a jejunum.
    let stiff = Tether { length_m: 0.2, link_m: 0.1, ..TETHER };
    assert!(matches!(folded().attach_tether(&stiff), Err(EngineError::TetherRoom { .. })));
    // 140 mm of 20 mm are seven.
    let mut engine = folded();
    engine.attach_tether(&Tether { length_m: 0.14, link_m: 0.02, ..TETHER }).unwrap();
    assert_eq!(engine.loose().count(), 7);
}

/// All of the shipped gut of an average man.
fn whole_gut() -> Arc<Tract> {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tracts/whole-gut-average-man.toml");
    let options = TractOptions { segments: vec![], length_scale: 1.0, radius_scale: 1.0 };
    Arc::new(tract_file::load(&Node::open(&model).unwrap(), &options).unwrap().0)
}

/// A number in [0, 1) for a seed and a use of it.
fn drawn(seed: u64, which: u64) -> f64 {
    let bits = RandomStreams::new(seed, which, "crowd").stream("number", 0).next_u64() >> 11;
    bits as f64 / (1_u64 << 53) as f64
}

/// A capsule in phase III, or what its segment has instead.
fn busy(seed: u64, start_m: f64, tract: &Arc<Tract>) -> Result<Engine, EngineError> {
    let mut motility = MotilityConfig::default();
    motility.mmc.rate_factor = [Fraction(1.0); 3];
    let streams = RandomStreams::new(seed, 0, "motility");
    let motility = Motility::new(&motility, tract, &streams).unwrap();
    let config = EngineConfig {
        start_arc_length_m: NonNegative(start_m),
        settle_s: NonNegative(0.0),
        ..EngineConfig::default()
    };
    Engine::new(config, tract.clone(), motility, CAPSULE)
}

/// Runs and their length, s: `LUMENAV_FULL=1` for those of the acceptance.
fn size(full: (u64, u32), short: (u64, u32)) -> (u64, u32) {
    if std::env::var("LUMENAV_FULL").is_ok_and(|v| v == "1") { full } else { short }
}

/// Leaves out what a bend brings into another body.
fn insert_where_free(engine: &mut Engine, loose: &Loose) -> Result<(), EngineError> {
    match engine.insert_loose(loose) {
        Err(EngineError::Occupied { .. }) => Ok(()),
        other => other,
    }
}

/// Of a seed: some residue of any size, now and then a second capsule before the capsule.
fn crowded(seed: u64, start_m: f64, tract: &Arc<Tract>) -> Result<Engine, EngineError> {
    let drawn = |which: u64| drawn(seed, which);
    let mut engine = busy(seed, start_m, tract)?;
    let mut place_m = start_m + 0.03;
    for k in 0..3 {
        let radius_m = 0.001 + 0.006 * drawn(k);
        place_m += radius_m + 0.01 * drawn(10 + k);
        if place_m < tract.length_m() {
            insert_where_free(&mut engine, &ball(radius_m, place_m))?;
        }
        place_m += radius_m;
    }
    if drawn(20) < 0.5 && place_m + 0.02 < tract.length_m() {
        insert_where_free(&mut engine, &Loose { shape: CAPSULE, arc_length_m: place_m + 0.015 })?;
    }
    Ok(engine)
}

#[test]
fn law_what_is_loose_stays_in_the_lumen_of_a_whole_gut() {
    let tract = whole_gut();
    let (runs, seconds) = size((60, 300), (6, 10));
    let build = |seed, start_m| crowded(seed, start_m, &tract);
    let report = fuzz_inside_lumen(0..runs, f64::from(seconds), &tract, &CAPSULE, build).unwrap();
    println!(
        "figure: crowded: {runs} runs of {seconds} s, capsule {:.3} mm, loose {:.3} mm into the wall at most",
        1e3 * report.worst_excess_m,
        1e3 * report.worst_loose_m
    );
    assert!(report.inside() && report.worst_loose_m > 0.0, "{report:?}");
}

#[test]
fn law_a_tether_stays_in_the_lumen_or_is_told_to_leave_it() {
    let tract = whole_gut();
    let (runs, seconds) = size((30, 300), (4, 10));
    let (mut worst_m, mut short_cuts) = ([0.0_f64; 2], 0);
    for seed in 0..runs {
        // From the duodenum on.
        let start_m = 0.75 + (seed as f64 + 0.5) / runs as f64 * (tract.length_m() - 0.8);
        let mut engine = busy(seed, start_m, &tract).unwrap();
        let (length_m, held) = (0.05 + 0.1 * drawn(seed, 22), drawn(seed, 23) < 0.5);
        engine.attach_tether(&Tether { length_m, held, ..TETHER }).unwrap();
        let (excess_m, crossed_s) = excess_m(&mut engine, seconds);
        println!("{seed}: {length_m:.3} m, held {held}: {excess_m:?} m, short cut {crossed_s:?}");
        short_cuts += u32::from(crossed_s.is_some());
        worst_m = [0, 1].map(|k| worst_m[k].max(excess_m[k]));
    }
    println!(
        "figure: tethered: {runs} runs of {seconds} s, {worst_m:?} m into the wall at most, {short_cuts} short cuts"
    );
    assert!(worst_m.iter().all(|excess_m| *excess_m < 0.003), "{worst_m:?}");
}
