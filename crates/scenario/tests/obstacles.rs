//! Rigid things in the tract, from a table to what they do to a capsule.

use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::{MotilityConfig, WaveConfig};
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, Tract, TractDraft};
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{CapsuleBody, ConfigError, Node, RandomStreams, SimTime};
use lumenav_scenario::engine::{Engine, EngineConfig, Obstacle};
use lumenav_scenario::obstacles::ObstacleTable;
use nalgebra::{Point3, Vector3};
use std::path::Path;
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
const RADIUS_M: f64 = 0.0085;

/// A straight ileum along z.
fn ileum() -> Arc<Tract> {
    let ends = (End::Closed, End::Closed);
    Arc::new(TractDraft::straight(SegmentKey::Ileum, RADIUS_M, 0.4, ends).build().unwrap().0)
}

fn place(text: &str) -> Result<Vec<Obstacle>, ConfigError> {
    let text = format!("[[tract.obstacle]]\n{text}");
    let node = Node::parse_text(&text, "scenario.toml", Path::new(""), &[]).unwrap();
    let node = node.child_or_empty("tract").children("obstacle").unwrap().remove(0);
    node.parse::<ObstacleTable>()?.place(&ileum(), &node)
}

/// How far a strong wave from 60 mm to 300 mm carries a capsule that starts at 100 mm, m.
fn reached_m(obstacles: &[Obstacle]) -> f64 {
    let tract = ileum();
    let wave = WaveConfig {
        start_time_s: NonNegative(1.0),
        segment: None,
        start_m: Finite(0.06),
        speed_m_s: Finite(0.01),
        run_m: Some(Positive(0.28)),
        duration_s: None,
        width_m: Positive(0.01),
        amplitude: Fraction(0.8),
        flattens_ahead_m: NonNegative(0.0),
    };
    let motility = MotilityConfig { spontaneous: false, wave: vec![wave], ..MotilityConfig::default() };
    let motility = Motility::new(&motility, &tract, &RandomStreams::new(1, 0, "motility")).unwrap();
    let config = EngineConfig { start_arc_length_m: NonNegative(0.1), ..EngineConfig::default() };
    let mut engine = Engine::new(config, tract, motility, CAPSULE).unwrap();
    for obstacle in obstacles {
        engine.insert_obstacle(obstacle);
    }
    engine.settle().unwrap();
    engine.advance_to(SimTime::from_seconds(40.0));
    engine.state().arc_length_m
}

#[test]
fn closed_form_a_stricture_leaves_its_opening() {
    let parts =
        place("kind = \"stricture\"\nsegment = \"ileum\"\nat_mm = 200\nradius_mm = 4\nthickness_mm = 3")
            .unwrap();
    // Balls of the radius t = 1.5 mm that stand t apart: between two of them the edge is at most t (1 - sqrt(3)/2) = 0.20 mm further out.
    for k in 0..360 {
        let angle = f64::from(k).to_radians();
        let way = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let enters = |part: &Obstacle| {
            let Obstacle::Ball { centre_torso_m, radius_m } = part else { panic!("{part:?}") };
            // Where the ray from the axis meets the ball.
            let centre = centre_torso_m - Point3::new(0.0, 0.0, 0.2);
            let (along, square) = (centre.dot(&way), centre.norm_squared() - radius_m * radius_m);
            let root = along * along - square;
            if root >= 0.0 && along > 0.0 { along - root.sqrt() } else { f64::INFINITY }
        };
        let edge_m = parts.iter().map(enters).fold(f64::INFINITY, f64::min);
        assert!((0.004 - 1e-12..0.0042).contains(&edge_m), "{edge_m} m at {k} degrees");
    }
}

#[test]
fn law_a_stricture_reaches_the_wall() {
    // Nothing of the disc between opening and wall is further from a ball than half of its radius.
    for (radius_mm, thickness_mm) in [(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)] {
        let parts = place(&format!(
            "kind = \"stricture\"\nat_mm = 200\nradius_mm = {radius_mm}\nthickness_mm = {thickness_mm}"
        ))
        .unwrap();
        let mut r_m = 1e-3 * radius_mm;
        while r_m < RADIUS_M {
            for k in 0..90 {
                let angle = f64::from(4 * k).to_radians();
                let point = Point3::new(r_m * angle.cos(), r_m * angle.sin(), 0.2);
                let gap_m = |part: &Obstacle| {
                    let Obstacle::Ball { centre_torso_m, radius_m } = part else { panic!("{part:?}") };
                    (centre_torso_m - point).norm() - radius_m
                };
                let gap_m = parts.iter().map(gap_m).fold(f64::INFINITY, f64::min);
                assert!(gap_m < 0.25e-3 * thickness_mm, "{gap_m} m at {r_m} m and {k}");
            }
            r_m += 0.2e-3;
        }
    }
}

#[test]
fn law_a_stricture_holds_back_what_is_wider_than_it() {
    let free_m = reached_m(&[]);
    assert!(free_m > 0.25, "carried to {free_m} m only");
    let ring = |radius_mm: f64| {
        place(&format!("kind = \"stricture\"\nat_mm = 200\nradius_mm = {radius_mm}")).unwrap()
    };
    let held_m = reached_m(&ring(4.0));
    // It lies with its dome in the opening: a centre short of the ring by less than half of its length and more than its cylinder.
    assert!((0.175..0.2).contains(&held_m), "{held_m}");
    let passed_m = reached_m(&ring(7.5));
    assert!((passed_m - free_m).abs() < 0.01, "{passed_m} m through a wide ring, {free_m} m without");
}

#[test]
fn law_a_plate_across_the_lumen_holds_a_capsule_back() {
    let plate =
        place("kind = \"plate\"\nat_mm = 200\nangle_deg = 90\nheight_mm = 14\nthickness_mm = 2").unwrap();
    let held_m = reached_m(&plate);
    assert!(held_m < 0.2, "{held_m}");
    // A polyp of 3 mm is passed by.
    let polyp = place("kind = \"polyp\"\nat_mm = 200\nangle_deg = 90\nradius_mm = 3").unwrap();
    assert!(reached_m(&polyp) > 0.22);
}

#[test]
fn law_bad_obstacles_are_refused_at_their_line() {
    for (text, said) in [
        ("kind = \"clip\"\nat_mm = 1", "scenario.toml:2:8"),
        ("kind = \"polyp\"\nat_mm = 1\nradius_mm = 2\ncolour = 1", "scenario.toml:5:1"),
        ("kind = \"polyp\"\nat_mm = 1", "this kind needs `radius_mm`"),
        ("kind = \"plate\"\nat_mm = 1\nheight_mm = 2\nradius_mm = 2", "scenario.toml:5:13"),
        ("kind = \"polyp\"\nat_mm = 900\nradius_mm = 2", "allowed: 0 to 400"),
        ("kind = \"polyp\"\nsegment = \"caecum\"\nat_mm = 9\nradius_mm = 2", "allowed: ileum"),
        ("kind = \"stricture\"\nat_mm = 9\nradius_mm = 8.6", "allowed: below 8.5"),
        ("kind = \"stricture\"\nat_mm = 9\nradius_mm = 4\nangle_deg = 40", "this kind has none"),
        ("kind = \"stricture\"\nat_mm = 9\nradius_mm = 4\nthickness_mm = 1e-5", "allowed: 1 to 30"),
        ("kind = \"polyp\"\nat_mm = 9\nradius_mm = 4\nthickness_mm = 4", "scenario.toml:5:16"),
        (
            "kind = \"polyp\"\nsegment = \"ileum\"\nat_mm = 401\nradius_mm = 2",
            "the end of the ileum; allowed: 0 to 400",
        ),
        ("kind = \"stricture\"\nat_mm = 9\nradius_mm = 4\nthickness_mm = 40", "scenario.toml:5:16"),
    ] {
        let error = place(text).unwrap_err().to_string();
        assert!(error.contains(said), "{error}, wanted {said}");
    }
}
