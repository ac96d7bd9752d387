//! The analytic wall against rapier's own contacts: a capsule in a static triangle tube.
//!
//! The tube is swept from the same centre line and radius; the capsule is rapier's, of the same mass and inertia, without friction, in air. What
//! differs: the analytic wall is compliant and damped and touches at five rings; a mesh is rigid, and a capsule that slides over its edges loses
//! a fifth of its swing each time. So the way down, the times of passing the lowest place and the depth are compared, and the analytic wall's
//! swings with those of a pendulum.

use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_anatomy::segment::{SegmentKey, Wall};
use lumenav_anatomy::tract::{End, SegmentPoints, Tract, TractDraft};
use lumenav_anatomy::tube_mesh;
use lumenav_core::config::quantity::{Fraction, NonNegative};
use lumenav_core::{CapsuleBody, RandomStreams, SimTime};
use lumenav_scenario::engine::{Engine, EngineConfig};
use nalgebra::{Point3, Vector3};
use rapier3d::math::Vector;
use rapier3d::prelude::{ColliderBuilder, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, TriMeshFlags};
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };
/// A colon's flexure that hangs down: an arc about the x axis, its lowest place in the middle.
const BEND_RADIUS_M: f64 = 0.15;
const HALF_ARC_RAD: f64 = 1.2;
const RADIUS_M: f64 = 0.02;
const GRAVITY_M_S2: f64 = 9.81;
const STEP_HZ: u32 = 960;

/// The place on the arc at an angle from the lowest.
fn on_arc(angle_rad: f64, radius_m: f64) -> Vector3<f64> {
    Vector3::new(0.0, -radius_m * angle_rad.cos(), radius_m * angle_rad.sin())
}

fn flexure() -> Arc<Tract> {
    let key = SegmentKey::Ascending;
    let points_m: Vec<_> = (0..=48)
        .map(|k| HALF_ARC_RAD * (f64::from(k) / 24.0 - 1.0))
        .map(|angle| Point3::from(on_arc(angle, BEND_RADIUS_M)))
        .collect();
    let wall = Wall { friction: 0.0, grip: 0.0, haustra_depth: 0.0, ..key.default_wall() };
    let radii_m = vec![RADIUS_M; points_m.len()];
    let segment = SegmentPoints { key, points_m, radii_m, wall, source: String::new() };
    let draft = TractDraft {
        name: "flexure".into(),
        segments: vec![segment],
        ends: (End::Closed, End::Closed),
        torso_half_extents_m: None,
        source: String::new(),
    };
    Arc::new(draft.build().unwrap().0)
}

/// Angles of the capsule's centre on the arc, rad, at equal times, and its distance from the arc's axis, m.
type Path = Vec<(f64, f64)>;

fn seen(centre_m: Vector3<f64>) -> (f64, f64) {
    (centre_m.z.atan2(-centre_m.y), centre_m.norm())
}

fn by_the_engine(tract: &Arc<Tract>, start_m: f64, samples: u32, every_s: f64) -> Path {
    let config = EngineConfig {
        step_rate_hz: STEP_HZ,
        start_arc_length_m: NonNegative(start_m),
        settle_s: NonNegative(0.0),
        dry_segments: vec![SegmentKey::Ascending],
        coulomb_newton: NonNegative(0.0),
        viscous_newton_s_per_m: NonNegative(0.0),
        ..EngineConfig::default()
    };
    let still = MotilityConfig { amplitude_scale: Fraction(0.0), ..MotilityConfig::default() };
    let motility = Motility::new(&still, tract, &RandomStreams::new(1, 0, "motility")).unwrap();
    let mut engine = Engine::new(config, tract.clone(), motility, CAPSULE).unwrap();
    (1..=samples)
        .map(|k| {
            engine.advance_to(SimTime::from_seconds(every_s * f64::from(k)));
            seen(engine.state().world_from_capsule.translation.vector)
        })
        .collect()
}

/// The same capsule in a world of rapier's with a triangle tube, friction nowhere.
fn by_a_mesh(tract: &Tract, start_m: f64, samples: u32, every_s: f64) -> Path {
    let mesh = tube_mesh(tract, 360, 96, |_, _| RADIUS_M);
    let vertices = mesh.vertices_m.iter().map(|v| Vector::new(v[0].into(), v[1].into(), v[2].into()));
    let tube = ColliderBuilder::trimesh_with_flags(
        vertices.collect(),
        mesh.triangles.clone(),
        TriMeshFlags::FIX_INTERNAL_EDGES_TWO_SIDED,
    );
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::new(0.0, -GRAVITY_M_S2, 0.0);
    world.integration_parameters.dt = 1.0 / f64::from(STEP_HZ);
    world.integration_parameters.length_unit = 0.01;
    world.insert_collider(tube.unwrap().friction(0.0).restitution(0.0), None);
    let handle = insert_capsule(&mut world, tract, start_m);
    let steps = (every_s * f64::from(STEP_HZ)).round() as u32;
    (0..samples)
        .map(|_| {
            for _ in 0..steps {
                world.step();
            }
            let t = world.bodies[handle].translation();
            seen(Vector3::new(t.x, t.y, t.z))
        })
        .collect()
}

fn insert_capsule(world: &mut PhysicsWorld, tract: &Tract, start_m: f64) -> RigidBodyHandle {
    let station = tract.station(start_m);
    let body = RigidBodyBuilder::dynamic().translation(Vector::new(
        station.position_m.x,
        station.position_m.y,
        station.position_m.z,
    ));
    // Its axis along the tract: x turned about x does nothing, so from x to the tangent by half a turn about their middle.
    let turn = nalgebra::UnitQuaternion::rotation_between(&Vector3::x(), &station.tangent).unwrap();
    let axis_angle = turn.scaled_axis();
    let body = body.rotation(Vector::new(axis_angle.x, axis_angle.y, axis_angle.z)).can_sleep(false);
    let handle = world.insert_body(body);
    let half_m = 0.5 * CAPSULE.length_m - CAPSULE.radius_m;
    let collider = ColliderBuilder::capsule_x(half_m, CAPSULE.radius_m).mass(CAPSULE.mass_kg);
    world.insert_collider(collider.friction(0.0).restitution(0.0), Some(handle));
    handle
}

/// Times at which the capsule goes through the lowest place, s.
fn passes_s(path: &Path, every_s: f64) -> Vec<f64> {
    let crossing = |(k, pair): (usize, &[(f64, f64)])| {
        let (a, b) = (pair[0].0, pair[1].0);
        (a * b < 0.0).then(|| every_s * (k as f64 + 1.0 + a / (a - b)))
    };
    path.windows(2).enumerate().filter_map(crossing).collect()
}

#[test]
fn cross_a_capsule_swings_in_a_mesh_tube_as_in_the_analytic_wall() {
    let tract = flexure();
    // 0.5 rad up the bend.
    let start_m = BEND_RADIUS_M * (HALF_ARC_RAD - 0.5);
    let (samples, every_s) = (480, 1.0 / 240.0);
    let ours = by_the_engine(&tract, start_m, samples, every_s);
    let mesh = by_a_mesh(&tract, start_m, samples, every_s);
    let [a, b] = [&ours, &mesh].map(|path| passes_s(path, every_s));
    let far_mm = |k: usize| 1e3 * (ours[k].0 - mesh[k].0).abs() * BEND_RADIUS_M;
    let depth_mm = |k: usize| 1e3 * (ours[k].1 - mesh[k].1);
    println!("figure: through the lowest place at {a:.3?} and {b:.3?} s");
    assert!(a.len() >= 5 && b.len() >= 5, "{a:?} {b:?}");
    for (ours_s, mesh_s) in a.iter().zip(&b) {
        assert!((ours_s - mesh_s).abs() < 0.02, "{ours_s} and {mesh_s} s");
    }
    // The way down from 0.5 rad takes 0.21 s.
    let far = (0..48).map(far_mm).fold(0.0, f64::max);
    assert!(far < 2.0, "{far} mm apart along the tract on the way down");
    // Its weight and the turn press it less than a millimetre into the compliant wall.
    let deep: Vec<f64> = (60..samples as usize).map(depth_mm).collect();
    assert!(deep.iter().all(|mm| (0.0..1.0).contains(mm)), "{deep:?}");
    // A pendulum from the arc's middle to the capsule's centre; a swing of 0.5 rad is slower by θ²/16.
    let length_m = BEND_RADIUS_M + RADIUS_M - CAPSULE.radius_m;
    let half_period_s = std::f64::consts::PI * (length_m / GRAVITY_M_S2).sqrt() * (1.0 + 0.5 * 0.5 / 16.0);
    for pair in a.windows(2) {
        assert!((pair[1] - pair[0] - half_period_s).abs() < 0.005, "{pair:?}, {half_period_s}");
    }
}
