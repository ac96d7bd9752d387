//! Truth without forces: a path that is followed, a recorded trajectory, or a draw from a filter's own motion model.
//!
//! - *helix*: the published path of `than2015`, with its speed as a factor, and with a jump where one is asked for;
//! - *three half circles*: the track of `than2015` at a constant speed, with rests;
//! - *line*: from a point to a point and back, at a constant speed;
//! - *tum*: a recorded trajectory, interpolated at constant twist between its rows;
//! - *motion model*: Ornstein-Uhlenbeck velocity and angular rate, as the filters assume them: for consistency tests.
//!
//! A path has an end (its formula is at the head of [`crate::path`]): a scenario that lasts longer is refused, unless
//! `after_end = "hold"` says that the capsule rests there.
//!
//! The capsule's x axis follows the path's tangent; velocity, angular rate and specific force are derivatives of the pose, by
//! differences over ±0.1 ms. So within 0.1 ms of a corner (a turn of the line, a row of a recording, the ends of a rest)
//! velocity and rate are means over both sides, and the specific force is a spike of that width; between the rows of a
//! recording it is that of a constant twist, without the acceleration that happened at the rows. A jump is no motion: it enters
//! the position alone.
//!
//! A `[patient]` carries a path with the gut ([`crate::patient`]); derivatives are then those of the path, and the patient's in closed
//! form. A motion model is drawn in the world, and no patient moves it.

#![expect(clippy::disallowed_types, reason = "world side: kinematic truth")]

use crate::error::ScenarioError;
use crate::file::check_range;
use crate::path::{AfterEnd, HalfCircles, Helix, Line, Path, Recorded};
use crate::patient::{Jet, Patient, calibrated_frame, frame_of};
use crate::world::{TruthHistory, World, WorldNote};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::pose::{exp_so3, log_so3, renormalize};
use lumenav_core::{
    AxisStep, CapsuleTruth, MotionModel, Node, Primitive, RandomStream, RandomStreams, SimTime, TruthView,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// `[truth]` of a scenario with kinematic truth.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TruthTable {
    /// The published helix.
    Helix {
        /// Multiplies both speeds; the path stays. Default 1; published: 1 to 8. Allowed: 1e-3 to 1e3.
        #[serde(default = "one")]
        speed_factor: Positive,
        /// What happens behind its 36 s / `speed_factor`.
        #[serde(default)]
        after_end: AfterEnd,
        /// A jump, where one is asked for (published: 50 mm at run 300 of 50 ms, that is at 15 s).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        jump: Option<JumpTable>,
    },
    /// The published track of three half circles.
    ThreeHalfCircles {
        /// Speed, mm/s. Published: 7.5, 12, 17, 21, 27. Allowed: 1e-3 to 1e4.
        speed_mm_s: Positive,
        /// Rest at each of the two joints, s. Default 0 (that there are rests is published, how long and where is not); at most 1e6.
        #[serde(default)]
        pause_s: NonNegative,
        /// What happens behind its end.
        #[serde(default)]
        after_end: AfterEnd,
    },
    /// Back and forth between two points.
    Line {
        /// One end, mm.
        from_mm: [Finite; 3],
        /// The other end, mm.
        to_mm: [Finite; 3],
        /// Speed, mm/s. Allowed: 1e-3 to 1e4.
        speed_mm_s: Positive,
    },
    /// A recorded trajectory.
    Tum {
        /// The file, relative to the scenario.
        file: String,
        /// What happens before its first and behind its last row.
        #[serde(default)]
        after_end: AfterEnd,
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
        /// Step of the draw, ms: give the sensor's period, so that truth and filter make the same steps. Allowed: 0.1 to 1e6.
        step_ms: Positive,
        /// The model.
        motion: MotionModel,
    },
}

/// `[truth.jump]`: the capsule is suddenly elsewhere, and goes on from there.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JumpTable {
    /// When, s.
    pub at_s: NonNegative,
    /// By what, mm in the world.
    pub by_mm: [Finite; 3],
}

fn one() -> Positive {
    Positive(1.0)
}

/// Gravity of a patient lying supine, m/s², in the world.
const GRAVITY: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

/// Half step of the central differences that give velocity and rate of a path, s.
const DIFFERENCE_S: f64 = 1e-4;

/// Truth along a [`Path`]: exact at every instant, nothing to remember.
struct PathWorld {
    path: Box<dyn Path>,
    /// Carries the path with the gut.
    patient: Option<Arc<Patient>>,
    now: SimTime,
}

impl PathWorld {
    /// Velocity and acceleration in the world, rate in the capsule; zero beyond the path's ends.
    fn derivatives(&self, seconds: f64) -> [Vector3<f64>; 3] {
        let [begin_s, end_s] = self.path.times_s();
        if seconds < begin_s || seconds > end_s {
            return [Vector3::zeros(); 3];
        }
        // At an end the motion is still that of the path, and not the mean with the rest beyond.
        let middle_s = seconds.min(end_s - DIFFERENCE_S).max(begin_s + DIFFERENCE_S);
        let [before, pose, after] =
            [-DIFFERENCE_S, 0.0, DIFFERENCE_S].map(|off_s| self.path.pose(middle_s + off_s));
        let [pb, p, pa] = [&before, &pose, &after].map(|pose| pose.translation.vector);
        [
            (pa - pb) / (2.0 * DIFFERENCE_S),
            (pa - p * 2.0 + pb) / DIFFERENCE_S.powi(2),
            log_so3(&(before.rotation.inverse() * after.rotation)) / (2.0 * DIFFERENCE_S),
        ]
    }
}

impl TruthView for PathWorld {
    fn interval(&self) -> Range<SimTime> {
        SimTime::ZERO..self.now
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        let [begin_s, end_s] = self.path.times_s();
        let inside_s = at.seconds().min(end_s).max(begin_s);
        let mut pose = self.path.pose(inside_s);
        pose.translation.vector += self.path.jumped_m(at.seconds());
        let [mut velocity, mut acceleration, mut rate] = self.derivatives(at.seconds());
        if let Some(patient) = &self.patient {
            let gut = patient.gut(at.seconds());
            let point = Jet { value: pose.translation.vector, rate: velocity, acceleration };
            velocity = gut.velocity_world(&point.value, &velocity);
            acceleration = gut.acceleration_world(&point);
            rate += pose.rotation.inverse() * gut.rate_frame_rad_s;
            pose = gut.world_from_frame * pose;
        }
        CapsuleTruth {
            at,
            world_from_capsule: pose,
            velocity_world_m_s: velocity,
            angular_rate_capsule_rad_s: rate,
            specific_force_capsule_m_s2: pose.rotation.inverse() * (acceleration - GRAVITY),
            arc_length_m: None,
            segment: None,
            wall_force_n: None,
        }
    }

    fn frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        frame_of(self.patient.as_deref(), name, at.seconds())
    }

    fn told_frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        self.frame(calibrated_frame(name), at)
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
        // A patient who moves carries the path: its placement stands above it.
        let path = if self.patient.is_some() { "planned_path/line" } else { "planned_path" };
        out.push(Primitive::Lines {
            path: path.into(),
            strips_world_m: vec![strip],
            rgba: vec![0xBBBB_BBFF],
        });
    }

    fn moving_scene(&self, out: &mut Vec<Primitive>) {
        if let Some(patient) = &self.patient {
            let world_from_path = patient.gut(self.now.seconds()).world_from_frame;
            out.push(Primitive::Placement { path: "planned_path".into(), world_from_path });
        }
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

    fn frame(&self, name: &str, at: SimTime) -> Option<Isometry3<f64>> {
        frame_of(None, name, at.seconds())
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
}

fn vector_m(mm: &[Finite; 3]) -> Vector3<f64> {
    Vector3::from(mm.map(|v| v.0)) * 1e-3
}

/// Builds the world of a `[truth]` table. `scenario` is the table that holds `duration_s`, s: what a path has to last for.
///
/// # Errors
/// [`ScenarioError`] with file, line and key.
pub fn build(
    table: &TruthTable,
    node: &Node,
    scenario: (&Node, Option<f64>),
    patient: Option<Arc<Patient>>,
    streams: &RandomStreams,
) -> Result<Box<dyn World>, ScenarioError> {
    let (path, after_end): (Box<dyn Path>, AfterEnd) = match table {
        TruthTable::Helix { speed_factor, after_end, jump } => {
            check_range(node, "speed_factor", speed_factor.0, 1e-3, 1e3)?;
            let jump = jump.map(|jump| (jump.at_s.0, vector_m(&jump.by_mm)));
            (Box::new(Helix { speed_factor: speed_factor.0, jump }), *after_end)
        }
        TruthTable::ThreeHalfCircles { speed_mm_s, pause_s, after_end } => {
            check_range(node, "speed_mm_s", speed_mm_s.0, 1e-3, 1e4)?;
            check_range(node, "pause_s", pause_s.0, 0.0, 1e6)?;
            (Box::new(HalfCircles { speed_m_s: speed_mm_s.0 * 1e-3, pause_s: pause_s.0 }), *after_end)
        }
        TruthTable::Line { from_mm, to_mm, speed_mm_s } => {
            check_range(node, "speed_mm_s", speed_mm_s.0, 1e-3, 1e4)?;
            let (from_m, to_m) = (vector_m(from_mm), vector_m(to_mm));
            if (to_m - from_m).norm() < 1e-6 {
                return Err(node.error_at("to_mm", "the ends coincide; a line needs two points").into());
            }
            (Box::new(Line { from_m, to_m, speed_m_s: speed_mm_s.0 * 1e-3 }), AfterEnd::Hold)
        }
        TruthTable::Tum { file, after_end } => {
            let poses = lumenav_records::tum::read(&node.existing_path("file", file)?)?;
            if poses.len() < 2 {
                return Err(node.error_at("file", "a trajectory needs two poses at least").into());
            }
            (Box::new(Recorded { poses }), *after_end)
        }
        TruthTable::MotionModel { step_ms, .. } => {
            check_range(node, "step_ms", step_ms.0, 0.1, 1e6)?;
            if patient.is_some() {
                let message = "a motion model is drawn in the world, where no [patient] carries it; allowed with one: `helix`, `three-half-circles`, `line`, `tum`, or a [tract]";
                return Err(node.error_at("kind", message).into());
            }
            return Ok(Box::new(drawn(table, streams)));
        }
    };
    if after_end == AfterEnd::Refuse {
        check_end(&*path, node, scenario)?;
    }
    Ok(Box::new(PathWorld { path, patient, now: SimTime::ZERO }))
}

/// Refuses a scenario that outlasts its path, or begins before it.
fn check_end(path: &dyn Path, node: &Node, scenario: (&Node, Option<f64>)) -> Result<(), ScenarioError> {
    const INSTEAD: &str = "or `after_end = \"hold\"` in [truth], to let the capsule rest there";
    let [begin_s, end_s] = path.times_s();
    if begin_s > 0.0 {
        let message = format!(
            "the trajectory begins at {begin_s} s, the scenario at 0; allowed: a first row at or before 0 s, {INSTEAD}"
        );
        return Err(node.error_at("file", &message).into());
    }
    let (scenario, duration_s) = scenario;
    // Half a nanosecond: the path's end itself is part of it.
    if let Some(duration_s) = duration_s.filter(|duration_s| *duration_s > end_s + 5e-10) {
        let message = format!(
            "{duration_s} s is longer than the path of [truth], which ends at {end_s} s; allowed: up to {end_s}, {INSTEAD}"
        );
        return Err(scenario.error_at("duration_s", &message).into());
    }
    Ok(())
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
        wall_force_n: None,
    };
    let mut history = TruthHistory::default();
    history.push(state.clone());
    let step_ns = ((step_ms.0 * 1e6).round() as i64).max(1);
    DrawnWorld { motion: *motion, step_ns, streams: streams.clone(), step: 0, history, state }
}

/// The name under which kinematic truth draws its random numbers.
pub const COMPONENT: &str = "truth";

#[cfg(test)]
mod tests;
