//! The world side of the witnesses: a truth with closed forms, and a sensor per witness.

#![expect(clippy::disallowed_types, reason = "world side: the witnesses' sensors observe the truth")]

use super::lines::LineModel;
use super::{gyro, instant, lines, odometry, ranges, reading};
use lumenav::core::pose::{exp_so3, log_so3};
use lumenav::core::{
    CapsuleTruth, Column, Frame, ModalityError, Observation, RandomStream, RandomStreams, Reading, Sensor,
    SimTime, TruthView,
};
use nalgebra::{Isometry3, Translation3, Vector3};
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use std::f64::consts::TAU;
use std::ops::Range;

/// Turns at a constant rate about a fixed axis while it circles the origin.
struct Circle;

const CIRCLE_RADIUS_M: f64 = 0.03;
const CIRCLE_RATE_RAD_S: f64 = 0.2;
const TURN_RAD_S: Vector3<f64> = Vector3::new(0.1, 0.3, -0.2);

impl TruthView for Circle {
    fn interval(&self) -> Range<SimTime> {
        SimTime::ZERO..SimTime::from_seconds(1e4)
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        let t = at.seconds();
        let (sine, cosine) = (CIRCLE_RATE_RAD_S * t).sin_cos();
        let rotation = exp_so3(&(TURN_RAD_S * t));
        CapsuleTruth {
            at,
            world_from_capsule: Isometry3::from_parts(
                Translation3::new(CIRCLE_RADIUS_M * cosine, CIRCLE_RADIUS_M * sine, 0.0),
                rotation,
            ),
            velocity_world_m_s: Vector3::new(-sine, cosine, 0.0) * (CIRCLE_RADIUS_M * CIRCLE_RATE_RAD_S),
            angular_rate_capsule_rad_s: TURN_RAD_S,
            // The centripetal acceleration of 1.2 mm/s² is below what any of these sensors resolves.
            specific_force_capsule_m_s2: rotation.inverse() * -gyro::GRAVITY_WORLD_M_S2,
            arc_length_m: None,
            segment: None,
            wall_force_n: None,
        }
    }

    fn frame(&self, _name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        None
    }
}

/// Lends the truth to a law.
pub(super) fn with_truth<T>(law: impl FnOnce(&dyn TruthView) -> T) -> T {
    law(&Circle)
}

fn normal3(stream: &mut RandomStream) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(stream))
}

/// Period of every witness's sensor, ns.
const PERIOD_NS: i64 = 50_000_000;

/// What a witness's sensor sees of the truth. `noise` is its own stream of this reading, `sequence` counts readings.
pub(super) trait Look: Send {
    /// Whether it looks at the period that ends now, not at the instant.
    const LOOKS_BACK: bool;

    fn look(
        &self,
        truth: &dyn TruthView,
        at: SimTime,
        sequence: u64,
        noise: RandomStream,
    ) -> Result<Observation, ModalityError>;
}

/// A sensor that looks every [`PERIOD_NS`].
struct Periodic<L> {
    look: L,
    sequence: u64,
}

impl<L: Look> Sensor for Periodic<L> {
    fn next_due(&self) -> SimTime {
        SimTime(PERIOD_NS * (self.sequence as i64 + 1))
    }

    fn skip_to(&mut self, at: SimTime) {
        let periods = at.0.max(0).unsigned_abs().div_ceil(PERIOD_NS.unsigned_abs());
        self.sequence = if L::LOOKS_BACK { periods } else { periods.saturating_sub(1) };
    }

    fn look_back_ns(&self) -> i64 {
        if L::LOOKS_BACK { PERIOD_NS } else { 0 }
    }

    fn observe(
        &mut self,
        truth: &dyn TruthView,
        at: SimTime,
        random: &RandomStreams,
    ) -> Result<Option<Observation>, ModalityError> {
        let sequence = self.sequence;
        self.sequence += 1;
        self.look.look(truth, at, sequence, random.stream("noise", sequence)).map(Some)
    }
}

/// A witness's sensor.
pub(super) fn sensor(look: impl Look + 'static) -> Box<dyn Sensor> {
    Box::new(Periodic { look, sequence: 0 })
}

#[expect(
    clippy::unnecessary_wraps,
    reason = "one of the ways to read that a sensor is given; others can fail"
)]
fn unlabelled(reading: Reading) -> Result<Observation, ModalityError> {
    Ok(Observation { reading, labels: None })
}

/// Ranges of 2 mm to anchors.
pub(super) struct Ranges {
    pub(super) anchors_world_m: Vec<Vector3<f64>>,
}

impl Look for Ranges {
    const LOOKS_BACK: bool = false;

    fn look(
        &self,
        truth: &dyn TruthView,
        at: SimTime,
        sequence: u64,
        mut noise: RandomStream,
    ) -> Result<Observation, ModalityError> {
        let position = truth.capsule(at).world_from_capsule.translation.vector;
        let mut range_m = |anchor: &Vector3<f64>| {
            let error: f64 = StandardNormal.sample(&mut noise);
            (position - anchor).norm() + 2e-3 * error
        };
        let values: Vec<f64> = self.anchors_world_m.iter().map(&mut range_m).collect();
        unlabelled(instant("ranges", sequence, at, &ranges::schema(values.len()), &values))
    }
}

/// Relative pose since the last reading.
pub(super) struct Odometry;

impl Look for Odometry {
    const LOOKS_BACK: bool = true;

    fn look(
        &self,
        truth: &dyn TruthView,
        at: SimTime,
        sequence: u64,
        mut noise: RandomStream,
    ) -> Result<Observation, ModalityError> {
        let since = at - PERIOD_NS;
        let relative =
            truth.capsule(since).world_from_capsule.inverse() * truth.capsule(at).world_from_capsule;
        let turn = log_so3(&(relative.rotation * exp_so3(&(0.01 * normal3(&mut noise)))));
        let moved = relative.translation.vector + 5e-4 * normal3(&mut noise);
        let values: Vec<f64> = turn.iter().chain(moved.iter()).copied().collect();
        let mut reading = instant("odometry", sequence, at, &odometry::schema(), &values);
        reading.interval.0 = since;
        unlabelled(reading)
    }
}

/// A line drawn from the model: background uniform over the disc across its direction, else a marker blurred across it.
pub(super) fn draw_line(
    model: &LineModel,
    pose: &Isometry3<f64>,
    stream: &mut RandomStream,
) -> (Vector3<f64>, Vector3<f64>, u32) {
    let direction = normal3(stream).normalize();
    let (e1, e2) = lumenav::core::pose::tangent_basis(&direction);
    let markers = model.markers_capsule_m.len() as u32;
    if stream.random::<f64>() < model.background {
        let radius_m = model.disc_radius_m * stream.random::<f64>().sqrt();
        let (sine, cosine) = (TAU * stream.random::<f64>()).sin_cos();
        return ((e1 * cosine + e2 * sine) * radius_m, direction, markers);
    }
    let marker = stream.random_range(0..markers);
    let blur = normal3(stream) * model.sigma_m;
    let at = pose.rotation * model.markers_capsule_m[marker as usize] + pose.translation.vector;
    (at + e1 * blur.x + e2 * blur.y, direction, marker)
}

/// Lines of response of a window, and beside them which marker each came from.
pub(super) struct Lines {
    pub(super) model: LineModel,
    pub(super) count: usize,
}

impl Look for Lines {
    const LOOKS_BACK: bool = true;

    fn look(
        &self,
        truth: &dyn TruthView,
        at: SimTime,
        sequence: u64,
        mut noise: RandomStream,
    ) -> Result<Observation, ModalityError> {
        let interval = (at - PERIOD_NS, at);
        let pose = truth.capsule(SimTime::middle(interval)).world_from_capsule;
        let drawn: Vec<_> = (0..self.count).map(|_| draw_line(&self.model, &pose, &mut noise)).collect();
        let lines: Vec<_> = drawn.iter().map(|(point, direction, _)| (*point, *direction)).collect();
        let markers = vec![Column::U32(drawn.iter().map(|line| line.2).collect())];
        let labels = Frame::new(lines::label_schema(), markers, vec![true; self.count])?;
        let reading = reading("lines", sequence, interval, lines::frame(&lines));
        Ok(Observation { reading, labels: Some(labels) })
    }
}

/// A gyroscope's mean rate over the period.
pub(super) struct Gyro;

impl Look for Gyro {
    const LOOKS_BACK: bool = true;

    fn look(
        &self,
        truth: &dyn TruthView,
        at: SimTime,
        sequence: u64,
        mut noise: RandomStream,
    ) -> Result<Observation, ModalityError> {
        let rate = truth.capsule(at - PERIOD_NS / 2).angular_rate_capsule_rad_s + 0.02 * normal3(&mut noise);
        let mut reading = instant("gyro", sequence, at, &gyro::gyro_schema(), rate.as_slice());
        reading.interval.0 = at - PERIOD_NS;
        unlabelled(reading)
    }
}

/// An accelerometer's specific force.
pub(super) struct Accelerometer;

impl Look for Accelerometer {
    const LOOKS_BACK: bool = false;

    fn look(
        &self,
        truth: &dyn TruthView,
        at: SimTime,
        sequence: u64,
        mut noise: RandomStream,
    ) -> Result<Observation, ModalityError> {
        let force = truth.capsule(at).specific_force_capsule_m_s2 + 0.05 * normal3(&mut noise);
        unlabelled(instant("accelerometer", sequence, at, &gyro::accelerometer_schema(), force.as_slice()))
    }
}
