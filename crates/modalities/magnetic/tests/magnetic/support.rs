//! What the tests share: models of this repository, readings without files, random poses.

use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use lumenav_core::pose::exp_so3;
use lumenav_core::{
    CapsuleBody, CapsuleTruth, ModelFolder, Name, Node, RandomStream, RandomStreams, Reading, Schedule,
    Setup, SimTime, TruthView,
};
use lumenav_fields::FieldSource;
use lumenav_magnetic::array::SensorArray;
use lumenav_magnetic::channels::{Channels, MagnetPose};
use lumenav_magnetic::config::Installed;
use lumenav_magnetic::sensor::flux_schema;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

pub const SIGMA_TESLA: f64 = 1.2e-8;

pub fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models")
}

pub fn node(text: &str) -> Node {
    Node::parse_text(text, "test.toml", Path::new(""), &[]).unwrap()
}

/// The pillcam-magnet with another place of the magnet, mm.
pub fn setup(offset_mm: [f64; 3]) -> Setup {
    let text = format!(
        "[magnet]\ndiameter_mm = 5.0\nlength_mm = 6.0\nremanence_tesla = 1.29375\noffset_mm = {offset_mm:?}\nsource = \"\"\n"
    );
    Setup {
        sensor: Name::from("array"),
        schedule: Some(schedule()),
        capsule: CapsuleBody { radius_m: 5.5e-3, length_m: 26e-3, mass_kg: 3.3e-3 },
        capsule_model: node(&text),
        models: ModelFolder::new(models()),
        map: None,
    }
}

pub fn schedule() -> Schedule {
    Schedule {
        rate_hz: Positive(10.0),
        start_s: NonNegative(0.0),
        latency_ms: NonNegative(5.0),
        loss: Fraction(0.0),
    }
}

pub fn installed(text: &str, offset_mm: [f64; 3]) -> Installed {
    Installed::from_node(&node(text), &setup(offset_mm)).unwrap()
}

/// `count` triads on a square of 0.5 m, edges included.
pub fn grid(side: u32) -> SensorArray {
    let place = |i: u32| f64::from(i) / f64::from(side - 1) * 0.5 - 0.25;
    let positions: Vec<Vector3<f64>> =
        (0..side * side).map(|i| Vector3::new(place(i % side), place(i / side), 0.0)).collect();
    SensorArray::of_triads("grid", &positions, SIGMA_TESLA)
}

pub fn dipole() -> FieldSource {
    FieldSource::Dipole { strength_t_m3: 1.212891e-8 }
}

pub fn stream(purpose: &str, sequence: u64) -> RandomStream {
    RandomStreams::new(1, 0, "test").stream(purpose, sequence)
}

pub fn uniform(random: &mut RandomStream, range: Range<f64>) -> f64 {
    range.start + (range.end - range.start) * random.random::<f64>()
}

pub fn normal(random: &mut RandomStream) -> f64 {
    random.sample(StandardNormal)
}

pub fn direction(random: &mut RandomStream) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(random)).normalize()
}

pub fn attitude(random: &mut RandomStream) -> UnitQuaternion<f64> {
    let angle = uniform(random, 0.0..std::f64::consts::PI);
    exp_so3(&(direction(random) * angle))
}

/// A pose of the reference workspace: 0.4 x 0.4 m, 0.1 to 0.3 m above the plane.
pub fn workspace_pose(random: &mut RandomStream) -> Isometry3<f64> {
    let place =
        Vector3::new(uniform(random, -0.2..0.2), uniform(random, -0.2..0.2), uniform(random, 0.1..0.3));
    Isometry3::from_parts(Translation3::from(place), attitude(random))
}

pub fn magnet_of(pose: &Isometry3<f64>) -> MagnetPose {
    MagnetPose::of_capsule(pose, &Vector3::zeros())
}

/// Flux at the channels with independent noise.
pub fn noisy(
    channels: &Channels,
    source: &FieldSource,
    magnet: &MagnetPose,
    sigma: f64,
    random: &mut RandomStream,
) -> Vec<f64> {
    let mut flux = Vec::new();
    channels.flux(source, magnet, &mut flux);
    for z in &mut flux {
        *z += sigma * normal(random);
    }
    flux
}

/// A reading of these values; what is not finite is masked.
pub fn reading(array: &SensorArray, values: Vec<f64>) -> Reading {
    Reading {
        sensor: Name::from("array"),
        sequence: 0,
        interval: (SimTime::ZERO, SimTime::ZERO),
        arrival: SimTime::ZERO,
        known_poses: BTreeMap::new(),
        payload: lumenav_core::Frame::of_values(flux_schema(array.labels()), values).unwrap(),
    }
}

/// A capsule at rest, and a torso that turns about z.
pub struct AtRest(pub Isometry3<f64>);

impl TruthView for AtRest {
    fn interval(&self) -> Range<SimTime> {
        SimTime::ZERO..SimTime(i64::MAX)
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        CapsuleTruth {
            at,
            world_from_capsule: self.0,
            velocity_world_m_s: Vector3::zeros(),
            angular_rate_capsule_rad_s: Vector3::zeros(),
            specific_force_capsule_m_s2: Vector3::z() * 9.81,
            arc_length_m: None,
            segment: None,
            wall_force_n: None,
        }
    }

    fn frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        let turn = Vector3::z() * (0.3 * at.seconds());
        (name == "torso").then(|| Isometry3::new(Vector3::new(0.01, 0.0, 0.02), turn))
    }
}
