//! A run made of closed forms: a capsule on a helix in a tube, 16 magnetometers below it, one track with a known error.
//! Shared by the tests of the observers (`recording`, `report`), which depend on this crate.

use lumenav_core::{
    CapsuleBody, CapsuleTruth, FixKind, Name, PoseEstimate, Primitive, PublishedEstimate, SimTime,
};
use lumenav_pipeline::{
    ObserverError, Refusal, RunEvent, RunHeader, RunObserver, SceneOwner, SensorHeader, TrackHeader,
    TrackUpdate, UpdateError,
};
use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3};

/// Radius of the helix, m; turns a minute; rise, m/s.
const RADIUS_M: f64 = 0.06;
const RATE_RAD_S: f64 = 0.35;
const RISE_M_S: f64 = 0.0022;

/// The true capsule at a time.
pub fn truth(at: SimTime) -> CapsuleTruth {
    let t = at.seconds();
    let (sine, cosine) = (RATE_RAD_S * t).sin_cos();
    let position = Vector3::new(RADIUS_M * cosine, RADIUS_M * sine, 0.12 + RISE_M_S * t);
    let velocity = Vector3::new(-RADIUS_M * RATE_RAD_S * sine, RADIUS_M * RATE_RAD_S * cosine, RISE_M_S);
    let rotation = lumenav_core::pose::attitude_from_axis(&velocity.normalize());
    CapsuleTruth {
        at,
        world_from_capsule: Isometry3::from_parts(Translation3::from(position), rotation),
        velocity_world_m_s: velocity,
        angular_rate_capsule_rad_s: Vector3::zeros(),
        specific_force_capsule_m_s2: Vector3::new(0.0, 9.81, 0.0),
        arc_length_m: Some(velocity.norm() * t),
        segment: Some("jejunum".into()),
        wall_force_n: None,
    }
}

/// What the run says of itself.
pub fn header(duration_s: f64, tracks: &[&str]) -> RunHeader {
    RunHeader {
        observe_from_s: 0.0,
        scenario: "helix".into(),
        seed: 7,
        trial: 0,
        duration_s: Some(duration_s),
        tracks: tracks
            .iter()
            .map(|name| TrackHeader {
                name: Name::from(*name),
                sensors: vec!["belt".into()],
                filter: "eskf".into(),
                front_ends: vec!["dipole".into()],
            })
            .collect(),
        sensors: vec![SensorHeader { name: "belt".into(), modality: "magnetic".into() }],
        capsule: CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.004 },
        has_truth: true,
        expect: lumenav_pipeline::events::ExpectTable::default(),
        periods: Vec::new(),
        scenario_toml: "name = \"helix\"\n".into(),
    }
}

/// A smooth error of a few millimetres, different per track.
fn error_world_m(t: f64, track: usize) -> Vector3<f64> {
    let scale = 1e-3 * (1.0 + 2.0 * track as f64);
    let phase = track as f64;
    Vector3::new((1.7 * t + phase).sin(), (2.9 * t).cos(), (0.8 * t + 2.0 * phase).sin()) * scale
}

/// The tube about the helix, as a mesh of two colours.
pub fn tube(duration_s: f64) -> Primitive {
    let (rings, sides) = (240_usize, 20_usize);
    let (mut vertices, mut rgba, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for ring in 0..rings {
        let along = ring as f64 / (rings - 1) as f64;
        let pose = truth(SimTime::from_seconds(along * duration_s)).world_from_capsule;
        let radius = 0.014 + 0.003 * (along * 60.0).sin();
        for side in 0..sides {
            let (sine, cosine) = (std::f64::consts::TAU * side as f64 / sides as f64).sin_cos();
            // Radial and rising directions of the helix: a frame without twist.
            let centre = pose.translation.vector;
            let radial = Vector3::new(centre.x, centre.y, 0.0).normalize();
            let point = centre + radial * (radius * cosine) + Vector3::z() * (radius * sine);
            vertices.push(point.cast::<f32>().into());
            rgba.push(if along < 0.4 { 0xd98c8cff } else { 0x8cb3d9ff });
        }
    }
    for ring in 0..rings - 1 {
        for side in 0..sides {
            let next = (side + 1) % sides;
            let [a, b, c, d] = [
                ring * sides + side,
                ring * sides + next,
                (ring + 1) * sides + side,
                (ring + 1) * sides + next,
            ];
            triangles.push([a as u32, c as u32, b as u32]);
            triangles.push([b as u32, c as u32, d as u32]);
        }
    }
    Primitive::Mesh { path: "tract/lumen".into(), vertices_world_m: vertices, triangles, rgba }
}

/// The centre line of the tube.
fn centre_line(duration_s: f64) -> Primitive {
    let strip = (0..=200)
        .map(|i| truth(SimTime::from_seconds(f64::from(i) / 200.0 * duration_s)))
        .map(|truth| truth.world_from_capsule.translation.vector.cast::<f32>().into())
        .collect();
    Primitive::Lines { path: "tract/centre_line".into(), strips_world_m: vec![strip], rgba: vec![0xffffff60] }
}

/// Sixteen sensors in a plane behind the patient, with the field of a dipole as arrows.
fn sensors(at: SimTime) -> Vec<Primitive> {
    let truth = truth(at);
    let source = truth.world_from_capsule.translation.vector;
    let moment = truth.world_from_capsule.rotation * Vector3::x();
    let (mut origins, mut vectors) = (Vec::new(), Vec::new());
    for i in 0..16 {
        let (x, z) = (f64::from(i % 4), f64::from(i / 4));
        let place = Vector3::new(0.05 * (x - 1.5), -0.14, 0.05 * z + 0.11);
        let r = place - source;
        let u = r.normalize();
        let field = (3.0 * u * u.dot(&moment) - moment) / r.norm().powi(3);
        origins.push(place.cast::<f32>().into());
        vectors.push((field.normalize() * 0.03).cast::<f32>().into());
    }
    vec![
        Primitive::Points {
            path: "places".into(),
            positions_world_m: origins.clone(),
            rgba: vec![0xb8b8b8ff],
            radius_m: 0.004,
        },
        Primitive::Arrows {
            path: "flux".into(),
            origins_world_m: origins,
            vectors_m: vectors,
            rgba: vec![0x7fb8e6ff],
        },
    ]
}

/// Plays the run into an observer: truth and scene at 100 Hz, updates of each track at `rate_hz`.
pub fn play(
    observer: &mut dyn RunObserver,
    duration_s: f64,
    rate_hz: f64,
    tracks: &[&str],
) -> Result<(), ObserverError> {
    let header = header(duration_s, tracks);
    observer.start(&header)?;
    observer.on(&RunEvent::Scene {
        at: SimTime::ZERO,
        owner: &SceneOwner::World,
        primitives: &[tube(duration_s), centre_line(duration_s)],
    })?;
    observer.on(&RunEvent::Note { at: SimTime::ZERO, source: "world", text: "enters the jejunum" })?;
    let steps = (duration_s * rate_hz) as u64;
    for step in 0..steps {
        let at = SimTime::from_seconds(step as f64 / rate_hz);
        let truth = truth(at);
        observer.on(&RunEvent::Truth(&truth))?;
        let belt: Name = "belt".into();
        observer.on(&RunEvent::Scene {
            at,
            owner: &SceneOwner::Sensor(belt.clone()),
            primitives: &sensors(at),
        })?;
        for (index, name) in tracks.iter().enumerate() {
            step_track(observer, &truth, index, name, step, &belt)?;
        }
        if step % rate_hz as u64 == 0 {
            observer.on(&RunEvent::Clock { at })?;
        }
    }
    observer.finish()
}

/// One update of one track, or a refusal between 20 and 22 s.
fn step_track(
    observer: &mut dyn RunObserver,
    truth: &CapsuleTruth,
    index: usize,
    name: &str,
    step: u64,
    belt: &Name,
) -> Result<(), ObserverError> {
    let t = truth.at.seconds();
    let name = Name::from(name);
    if (20.0..22.0).contains(&t) {
        let why = Refusal::Gate {
            chi_square: 100.0 + t,
            degrees_of_freedom: 48.0,
            threshold: 84.0,
            worst_channels: vec![(3, 7.0)],
        };
        return observer.on(&RunEvent::Refused {
            track: &name,
            sensor: belt,
            sequence: step,
            at: truth.at,
            measurement: None,
            why: &why,
        });
    }
    let error_m = error_world_m(t, index);
    let sigma_m = [1.0e-3, 1.4e-3, 2.2e-3].map(|s| s * (1.0 + 2.0 * index as f64));
    let mut covariance = Matrix6::zeros();
    for axis in 0..3 {
        covariance[(axis, axis)] = sigma_m[axis].powi(2);
    }
    covariance[(4, 4)] = 0.05_f64.powi(2);
    covariance[(5, 5)] = 0.05_f64.powi(2);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.04 * (0.9 * t).sin());
    let mut pose = truth.world_from_capsule;
    pose.translation.vector += error_m;
    pose.rotation *= turn;
    let estimate = PublishedEstimate {
        at: truth.at,
        available: truth.at + 20_000_000,
        pose: PoseEstimate { world_from_capsule: pose, covariance, kind: FixKind::Pointing },
        velocity_world_m_s: Some(truth.velocity_world_m_s),
    };
    let nees = (0..3).map(|axis| (error_m[axis] / sigma_m[axis]).powi(2)).sum::<f64>()
        + (0.04 * (0.9 * t).sin() / 0.05).powi(2);
    let error = UpdateError {
        position_world_m: error_m,
        heading_rad: Some((0.04 * (0.9 * t).sin()).abs()),
        attitude_rad: None,
        nees: Some(nees),
        nees_degrees_of_freedom: 5,
        along_tract_m: Some(error_m.y),
        bound_position_m2: Some(1e-6),
    };
    observer.on(&RunEvent::Update(&TrackUpdate {
        track: &name,
        sensor: belt,
        update: step,
        estimate: &estimate,
        nis: (step > 0).then_some((46.0 + t.sin(), 48.0)),
        weakest: (sigma_m[2], Vector3::z()),
        started: step == 0,
        accepted: true,
        revision: false,
        truth: Some(truth),
        error: Some(&error),
        compute_s: 1e-4,
    }))
}
