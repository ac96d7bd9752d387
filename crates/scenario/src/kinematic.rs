//! Truth without forces: a path that is followed, a recorded trajectory, or a draw from a filter's own motion model.
//!
//! - *helix*: the published path of `than2015` (start (-57, 0, -45) mm, end (57, 0, 45) mm, 36 s, 5 mm/s around z and
//!   2.5 mm/s along it), with its speed as a factor;
//! - *line*: from a point to a point and back, at a constant speed;
//! - *tum*: a recorded trajectory, interpolated at constant twist between its rows;
//! - *motion model*: Ornstein-Uhlenbeck velocity and angular rate, as the filters assume them: for consistency tests.
//!
//! The capsule's x axis follows the path's tangent; velocity, angular rate and specific force are derivatives of the pose.

#![expect(clippy::disallowed_types, reason = "world side: kinematic truth")]

use crate::error::ScenarioError;
use crate::world::{TruthHistory, World, WorldNote};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::pose::{attitude_from_axis, exp_so3, log_so3, renormalize};
use lumenav_core::{
    AxisStep, CapsuleTruth, MotionModel, Node, Primitive, RandomStream, RandomStreams, SimTime, TruthView,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// `[truth]` of a scenario with kinematic truth.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TruthTable {
    /// The published helix.
    Helix {
        /// Multiplies both speeds; the path stays.
        #[serde(default = "one")]
        speed_factor: Positive,
    },
    /// Back and forth between two points.
    Line {
        /// One end, mm.
        from_mm: [Finite; 3],
        /// The other end, mm.
        to_mm: [Finite; 3],
        /// Speed, mm/s.
        speed_mm_s: Positive,
    },
    /// A recorded trajectory.
    Tum {
        /// The file, relative to the scenario.
        file: String,
    },
    /// Drawn from a motion model.
    MotionModel {
        /// Start position, mm.
        position_mm: [Finite; 3],
        /// Start attitude as a rotation vector, degrees.
        #[serde(default)]
        rotation_vector_deg: [Finite; 3],
        /// Standard deviation of the start around these, mm per axis.
        #[serde(default)]
        position_sigma_mm: NonNegative,
        /// Standard deviation of the start attitude, degrees per axis.
        #[serde(default)]
        rotation_sigma_deg: NonNegative,
        /// Standard deviation of the start velocity, mm/s per axis.
        #[serde(default)]
        velocity_sigma_mm_s: NonNegative,
        /// Standard deviation of the start rate, rad/s per axis.
        #[serde(default)]
        rate_sigma_rad_s: NonNegative,
        /// Step of the draw, ms: give the sensor's period, so that truth and filter make the same steps.
        step_ms: Positive,
        /// The model.
        motion: MotionModel,
    },
}

fn one() -> Positive {
    Positive(1.0)
}

/// Gravity of a patient lying supine, m/s², in the world.
const GRAVITY: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

/// Half step of the central differences that give velocity and rate of a path, s.
const DIFFERENCE_S: f64 = 1e-4;

/// A pose as a function of time.
trait Path: Send + Sync {
    fn pose(&self, seconds: f64) -> Isometry3<f64>;
    /// Points for the picture.
    fn outline(&self) -> Vec<Vector3<f64>>;
}

struct Helix {
    speed_factor: f64,
}

impl Helix {
    const RADIUS_M: f64 = 0.057;
    const HALF_HEIGHT_M: f64 = 0.045;
    const DURATION_S: f64 = 36.0;
}

impl Path for Helix {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        // 5 mm/s on a radius of 57 mm makes 3.158 rad in 36 s: the half turn between the published ends.
        let progress = seconds * self.speed_factor / Self::DURATION_S;
        let angle = std::f64::consts::PI * (1.0 - progress);
        let (sine, cosine) = angle.sin_cos();
        let position = Vector3::new(
            Self::RADIUS_M * cosine,
            -Self::RADIUS_M * sine,
            Self::HALF_HEIGHT_M * (2.0 * progress - 1.0),
        );
        let around = std::f64::consts::PI * Self::RADIUS_M;
        let tangent = Vector3::new(around * sine, around * cosine, 2.0 * Self::HALF_HEIGHT_M).normalize();
        Isometry3::from_parts(Translation3::from(position), attitude_from_axis(&tangent))
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        (0..=90)
            .map(|i| self.pose(f64::from(i) / 90.0 * 36.0 / self.speed_factor).translation.vector)
            .collect()
    }
}

struct Line {
    from_m: Vector3<f64>,
    to_m: Vector3<f64>,
    speed_m_s: f64,
}

impl Path for Line {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        let along = self.to_m - self.from_m;
        let length = along.norm();
        let travelled = (seconds * self.speed_m_s).rem_euclid(2.0 * length);
        let forward = travelled.min(2.0 * length - travelled);
        let rotation = attitude_from_axis(&(along / length));
        Isometry3::from_parts(Translation3::from(self.from_m + along / length * forward), rotation)
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        vec![self.from_m, self.to_m]
    }
}

struct Recorded {
    poses: Vec<(SimTime, Isometry3<f64>)>,
}

impl Path for Recorded {
    fn pose(&self, seconds: f64) -> Isometry3<f64> {
        let at = SimTime::from_seconds(seconds);
        let after = self.poses.partition_point(|(t, _)| *t < at);
        // The reader refuses an empty file, so the first and last rows exist.
        match (after.checked_sub(1).and_then(|i| self.poses.get(i)), self.poses.get(after)) {
            (Some((ta, a)), Some((tb, b))) => {
                lumenav_core::pose::interpolate(a, b, at.since_s(*ta) / tb.since_s(*ta))
            }
            (Some((_, a)), None) => *a,
            (None, Some((_, b))) => *b,
            (None, None) => Isometry3::identity(),
        }
    }

    fn outline(&self) -> Vec<Vector3<f64>> {
        let step = (self.poses.len() / 2000).max(1);
        self.poses.iter().step_by(step).map(|(_, p)| p.translation.vector).collect()
    }
}

/// Truth along a [`Path`]: exact at every instant, nothing to remember.
struct PathWorld {
    path: Box<dyn Path>,
    now: SimTime,
}

impl TruthView for PathWorld {
    fn interval(&self) -> Range<SimTime> {
        SimTime::ZERO..self.now
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        let s = at.seconds();
        let pose = self.path.pose(s);
        let (before, after) = (self.path.pose(s - DIFFERENCE_S), self.path.pose(s + DIFFERENCE_S));
        let (pb, pa) = (before.translation.vector, after.translation.vector);
        let acceleration = (pa - pose.translation.vector * 2.0 + pb) / DIFFERENCE_S.powi(2);
        CapsuleTruth {
            at,
            world_from_capsule: pose,
            velocity_world_m_s: (pa - pb) / (2.0 * DIFFERENCE_S),
            angular_rate_capsule_rad_s: log_so3(&(before.rotation.inverse() * after.rotation))
                / (2.0 * DIFFERENCE_S),
            specific_force_capsule_m_s2: pose.rotation.inverse() * (acceleration - GRAVITY),
            arc_length_m: None,
            segment: None,
            wall_force_n: 0.0,
        }
    }

    fn frame(&self, name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        (name == "torso").then(Isometry3::identity)
    }
}

impl World for PathWorld {
    fn advance_to(&mut self, to: SimTime) -> Result<(), ScenarioError> {
        self.now = self.now.max(to);
        Ok(())
    }

    fn truth(&self) -> &dyn TruthView {
        self
    }

    fn forget_before(&mut self, _at: SimTime) {}

    fn take_notes(&mut self) -> Vec<WorldNote> {
        Vec::new()
    }

    fn static_scene(&self, out: &mut Vec<Primitive>) {
        let strip = self.path.outline().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        out.push(Primitive::Lines {
            path: "planned_path".into(),
            strips_world_m: vec![strip],
            rgba: vec![0xBBBB_BBFF],
        });
    }

    fn gravity_world_m_s2(&self) -> Vector3<f64> {
        GRAVITY
    }
}

/// Truth drawn from the motion model of a filter.
struct DrawnWorld {
    motion: MotionModel,
    step_ns: i64,
    streams: RandomStreams,
    step: u64,
    history: TruthHistory,
    state: CapsuleTruth,
}

impl DrawnWorld {
    fn step(&mut self) {
        let dt_s = self.step_ns as f64 * 1e-9;
        self.step += 1;
        let mut stream = self.streams.stream("motion", self.step);
        let (translation, rotation) = (self.motion.translation(dt_s), self.motion.rotation(dt_s));
        let (dp, dv) = draw_pair(&translation, &mut stream);
        let (dr, dw) = draw_pair(&rotation, &mut stream);
        let s = &mut self.state;
        s.at = s.at + self.step_ns;
        s.world_from_capsule.translation.vector += s.velocity_world_m_s * translation.gain_s + dp;
        s.velocity_world_m_s = s.velocity_world_m_s * translation.decay + dv;
        // The filter turns by Exp(g ω) and adds its noise in the new capsule frame: the same here.
        let turn = exp_so3(&(s.angular_rate_capsule_rad_s * rotation.gain_s)) * exp_so3(&dr);
        s.world_from_capsule.rotation = renormalize(s.world_from_capsule.rotation * turn);
        s.angular_rate_capsule_rad_s = s.angular_rate_capsule_rad_s * rotation.decay + dw;
        self.history.push(s.clone());
    }
}

/// Correlated noise of value and rate, three axes.
fn draw_pair(step: &AxisStep, stream: &mut RandomStream) -> (Vector3<f64>, Vector3<f64>) {
    let a = step.noise_pp.max(0.0).sqrt();
    let b = if a > 0.0 { step.noise_pv / a } else { 0.0 };
    let c = (step.noise_vv - b * b).max(0.0).sqrt();
    let mut normals = || Vector3::from_fn(|_, _| stream.sample::<f64, _>(StandardNormal));
    let (n1, n2) = (normals(), normals());
    (n1 * a, n1 * b + n2 * c)
}

impl TruthView for DrawnWorld {
    fn interval(&self) -> Range<SimTime> {
        self.history.interval()
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        self.history.at(at).unwrap_or_else(|| self.state.clone())
    }

    fn frame(&self, name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        (name == "torso").then(Isometry3::identity)
    }
}

impl World for DrawnWorld {
    fn advance_to(&mut self, to: SimTime) -> Result<(), ScenarioError> {
        while self.state.at < to {
            self.step();
        }
        Ok(())
    }

    fn truth(&self) -> &dyn TruthView {
        self
    }

    fn forget_before(&mut self, at: SimTime) {
        self.history.forget_before(at);
    }

    fn take_notes(&mut self) -> Vec<WorldNote> {
        Vec::new()
    }

    fn static_scene(&self, _out: &mut Vec<Primitive>) {}

    fn gravity_world_m_s2(&self) -> Vector3<f64> {
        GRAVITY
    }
}

fn vector_m(mm: &[Finite; 3]) -> Vector3<f64> {
    Vector3::from(mm.map(|v| v.0)) * 1e-3
}

/// Builds the world of a `[truth]` table.
///
/// # Errors
/// [`ScenarioError`] with file, line and key.
pub fn build(
    table: &TruthTable,
    node: &Node,
    streams: &RandomStreams,
) -> Result<Box<dyn World>, ScenarioError> {
    let path: Box<dyn Path> = match table {
        TruthTable::Helix { speed_factor } => Box::new(Helix { speed_factor: speed_factor.0 }),
        TruthTable::Line { from_mm, to_mm, speed_mm_s } => {
            let (from_m, to_m) = (vector_m(from_mm), vector_m(to_mm));
            if (to_m - from_m).norm() < 1e-6 {
                return Err(node.error_at("to_mm", "the ends coincide; a line needs two points").into());
            }
            Box::new(Line { from_m, to_m, speed_m_s: speed_mm_s.0 * 1e-3 })
        }
        TruthTable::Tum { file } => {
            let poses = lumenav_records::tum::read(&node.existing_path("file", file)?)?;
            if poses.len() < 2 {
                return Err(node.error_at("file", "a trajectory needs two poses at least").into());
            }
            Box::new(Recorded { poses })
        }
        TruthTable::MotionModel { .. } => return Ok(Box::new(drawn(table, streams))),
    };
    Ok(Box::new(PathWorld { path, now: SimTime::ZERO }))
}

fn drawn(table: &TruthTable, streams: &RandomStreams) -> DrawnWorld {
    let TruthTable::MotionModel {
        position_mm,
        rotation_vector_deg,
        position_sigma_mm,
        rotation_sigma_deg,
        velocity_sigma_mm_s,
        rate_sigma_rad_s,
        step_ms,
        motion,
    } = table
    else {
        unreachable!("called for this kind only")
    };
    let mut stream = streams.stream("start", 0);
    let mut normals = |sigma: f64| Vector3::from_fn(|_, _| sigma * stream.sample::<f64, _>(StandardNormal));
    let position = vector_m(position_mm) + normals(position_sigma_mm.0 * 1e-3);
    let nominal = exp_so3(&Vector3::from(rotation_vector_deg.map(|v| v.0.to_radians())));
    let rotation: UnitQuaternion<f64> = nominal * exp_so3(&normals(rotation_sigma_deg.0.to_radians()));
    let state = CapsuleTruth {
        at: SimTime::ZERO,
        world_from_capsule: Isometry3::from_parts(Translation3::from(position), rotation),
        velocity_world_m_s: normals(velocity_sigma_mm_s.0 * 1e-3),
        angular_rate_capsule_rad_s: normals(rate_sigma_rad_s.0),
        specific_force_capsule_m_s2: Vector3::zeros(),
        arc_length_m: None,
        segment: None,
        wall_force_n: 0.0,
    };
    let mut history = TruthHistory::default();
    history.push(state.clone());
    let step_ns = ((step_ms.0 * 1e6).round() as i64).max(1);
    DrawnWorld { motion: *motion, step_ns, streams: streams.clone(), step: 0, history, state }
}

/// The name under which kinematic truth draws its random numbers.
pub const COMPONENT: &str = "truth";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_helix_meets_its_ends_and_speeds() {
        // than2015: start (-57, 0, -45) mm, end (57, 0, 45) mm, 36 s, 5 mm/s around z, 2.5 mm/s along.
        let helix = Helix { speed_factor: 1.0 };
        let (start, end) = (helix.pose(0.0).translation.vector, helix.pose(36.0).translation.vector);
        assert!((start - Vector3::new(-0.057, 0.0, -0.045)).norm() < 1e-12);
        assert!((end - Vector3::new(0.057, 0.0, 0.045)).norm() < 1e-12);
        let world = PathWorld { path: Box::new(helix), now: SimTime::ZERO };
        let truth = world.capsule(SimTime::from_seconds(10.0));
        let v = truth.velocity_world_m_s;
        assert!((v.z - 0.0025).abs() < 1e-9);
        // π · 57 mm / 36 s = 4.974 mm/s: the published 5 mm/s is rounded.
        assert!((v.xy().norm() - 0.004974).abs() < 1e-6);
        let forward = truth.world_from_capsule.rotation * Vector3::x();
        assert!((forward - v.normalize()).norm() < 1e-6);
    }

    #[test]
    fn law_rate_and_specific_force_are_derivatives_of_the_pose() {
        let world = PathWorld { path: Box::new(Helix { speed_factor: 8.0 }), now: SimTime::ZERO };
        let (a, b) = (SimTime::from_seconds(2.0), SimTime::from_seconds(2.001));
        let (ta, tb) = (world.capsule(a), world.capsule(b));
        let turned = ta.world_from_capsule.rotation * exp_so3(&(ta.angular_rate_capsule_rad_s * 1e-3));
        assert!(turned.angle_to(&tb.world_from_capsule.rotation) < 1e-6);
        let acceleration = (tb.velocity_world_m_s - ta.velocity_world_m_s) / 1e-3;
        let felt = ta.world_from_capsule.rotation * ta.specific_force_capsule_m_s2;
        assert!((felt + GRAVITY - acceleration).norm() < 1e-3);
    }

    #[test]
    fn law_drawn_truth_has_the_variance_of_its_model() {
        let motion = MotionModel::default();
        let step = motion.translation(1.0);
        let n = 4000;
        let mut sum = 0.0;
        for seed in 0..n {
            let mut stream = RandomStreams::new(seed, 0, COMPONENT).stream("motion", 1);
            let (dp, _) = draw_pair(&step, &mut stream);
            sum += dp.norm_squared() / 3.0;
        }
        // Standard error of a variance of 3 n draws: sqrt(2 / 3n) = 1.3 %.
        assert!((sum / n as f64 / step.noise_pp - 1.0).abs() < 0.05);
    }
}
