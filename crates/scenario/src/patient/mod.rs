//! `[patient]`: how the torso moves in the room and the gut in the torso, as pure functions of time.
//!
//! ```text
//! world_from_torso  R = Rx(pitch) Rz(roll),  p = table + walk
//! torso_from_gut    a translation d: breath, cough, and how the gut hangs
//! torso_from_abdomen    a translation: the belly's surface lifts with each breath
//!
//! breath   d_z = -A sin⁴(π t/T)          caudally; the belly rises by B sin⁴(π t/T)
//! cough    d = n̂ (a T_c²/24) p(τ)        the largest acceleration is a
//! hanging  d = D (ĝ_torso(posture) - ĝ_torso(start)),  from posture to posture by a step that lasts longer than the turn
//! turn     roll and pitch from posture to posture by a step, by the shorter way (supine to prone: by the left side)
//! walk     up by A w(t) sin 2πf(t - from), forwards by v ∫w, w a step up within the first second and down within the last
//! table    by a step
//! ```
//!
//! The courses stand at the head of `profile.rs`; their sum is twice continuously differentiable, so velocity and acceleration of
//! everything are closed forms ([`FrameMotion`]), and no step size enters. There is no random number in it.
//!
//! Frames: `torso` is the trunk's skeleton, to which what is worn is calibrated; `abdomen` is the belly's surface, where it may be worn;
//! `gut` is the frame in which the tract stands still. All three are the world's at the start of a supine patient.
//!
//! Neglected: that breath and cough move the upper abdomen farther than the pelvis, that posture deforms the gut beside shifting it, that a
//! cough lifts the belly and shakes the trunk, sway and roll of a walking trunk, one breath differing from the next.

mod config;
mod frame;
mod profile;
mod sources;

pub use config::{Cough, PatientConfig, PatientEvent, Posture, Ride, Turn, Walk};
pub use frame::{Felt, FrameMotion};
pub use profile::Jet;
pub use sources::{PATIENT_EVENT_SOURCES, PATIENT_SOURCES};

use lumenav_core::{ConfigError, Node};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use profile::{PULSE_PEAK, breath, pulse, step, step_integral, swing};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Within this time a walk comes to its full swing, and ends, s.
const WALK_RAMP_S: f64 = 1.0;
/// Up and forwards in the world, for a patient who stands.
const UP: Vector3<f64> = Vector3::new(0.0, 1.0, 0.0);
const FORWARDS: Vector3<f64> = Vector3::new(0.0, 0.0, -1.0);

/// A step of something by an amount.
#[derive(Clone, Debug)]
struct StepBy<T> {
    start_s: f64,
    duration_s: f64,
    by: T,
}

impl<T> StepBy<T> {
    fn at(&self, time_s: f64) -> Jet<f64> {
        step(time_s, self.start_s, self.duration_s)
    }
}

/// A patient who moves.
#[derive(Clone, Debug)]
pub struct Patient {
    config: PatientConfig,
    /// Roll and pitch at the start, rad.
    start_rad: [f64; 2],
    /// By how much roll and pitch change, rad.
    turns: Vec<StepBy<[f64; 2]>>,
    /// By how much the gut shifts in the torso, m.
    shifts: Vec<StepBy<Vector3<f64>>>,
    /// When something else than breath moves, s, in order.
    busy_s: Vec<[f64; 2]>,
}

impl Patient {
    /// The patient of a scenario file with a `[patient]`.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line, key and what is allowed.
    pub fn of_file(file: &Node) -> Result<Option<Arc<Self>>, ConfigError> {
        let Some(node) = file.child("patient") else { return Ok(None) };
        Ok(Some(Arc::new(Self::new(PatientConfig::from_node(&node)?))))
    }

    /// The patient of a table that has been checked.
    pub fn new(config: PatientConfig) -> Self {
        let turn_of = |event: &PatientEvent| match event {
            PatientEvent::Posture(turn) => Some(*turn),
            _ => None,
        };
        let mut postures: Vec<Turn> = config.event.iter().filter_map(turn_of).collect();
        postures.sort_by(|a, b| a.at_s.0.total_cmp(&b.at_s.0));
        let start_rad = config.posture.angles_rad();
        let (mut before_rad, mut hanging) = (start_rad, hangs(config.posture));
        let (mut turns, mut shifts) = (Vec::new(), Vec::new());
        let depth_m = 1e-3 * config.organ_shift_mm.0;
        for Turn { at_s, to, duration_s } in postures {
            let (start_s, duration_s) = (at_s.0, duration_s.0);
            let [roll, pitch] = to.angles_rad();
            let by = [shorter_way(before_rad[0], roll), pitch - before_rad[1]];
            before_rad = [before_rad[0] + by[0], pitch];
            turns.push(StepBy { start_s, duration_s, by });
            let duration_s = duration_s + config.organ_shift_s.0;
            shifts.push(StepBy { start_s, duration_s, by: (hangs(to) - hanging) * depth_m });
            hanging = hangs(to);
        }
        let moving = |event: &PatientEvent| {
            let [from_s, to_s] = event.interval_s();
            let settles = matches!(event, PatientEvent::Posture(_));
            [from_s, to_s + if settles { config.organ_shift_s.0 } else { 0.0 }]
        };
        let mut busy_s: Vec<[f64; 2]> = config.event.iter().map(moving).collect();
        busy_s.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self { config, start_rad, turns, shifts, busy_s }
    }

    /// Its table.
    pub fn config(&self) -> &PatientConfig {
        &self.config
    }

    /// The trunk's motion in the world.
    pub fn torso(&self, time_s: f64) -> FrameMotion {
        let [mut roll, mut pitch] = self.start_rad.map(Jet::resting);
        for turn in &self.turns {
            let done = turn.at(time_s);
            (roll, pitch) = (roll + done.scaled(turn.by[0]), pitch + done.scaled(turn.by[1]));
        }
        FrameMotion::of(&roll, &pitch, &self.place(time_s))
    }

    /// The gut's motion in the world.
    pub fn gut(&self, time_s: f64) -> FrameMotion {
        self.torso(time_s).shifted(&self.gut_in_torso(time_s))
    }

    /// The motion of the belly's surface in the world.
    pub fn abdomen(&self, time_s: f64) -> FrameMotion {
        let lift = breath(time_s, self.config.breathing_period_s.0)
            .scaled(1e-3 * self.config.surface_amplitude_mm.0)
            .along(&Vector3::y());
        self.torso(time_s).shifted(&lift)
    }

    /// Pose of a frame by its name: `torso`, `abdomen` or `gut`.
    pub fn frame(&self, name: &str, time_s: f64) -> Option<Isometry3<f64>> {
        let motion = match name {
            "torso" => self.torso(time_s),
            "abdomen" => self.abdomen(time_s),
            "gut" => self.gut(time_s),
            _ => return None,
        };
        Some(motion.world_from_frame)
    }

    /// Where the gut is in the torso, m.
    pub fn gut_in_torso(&self, time_s: f64) -> Jet<Vector3<f64>> {
        let mut sum = breath(time_s, self.config.breathing_period_s.0)
            .scaled(-1e-3 * self.config.breathing_amplitude_mm.0)
            .along(&Vector3::z());
        for shift in &self.shifts {
            sum = sum + shift.at(time_s).along(&shift.by);
        }
        for event in &self.config.event {
            if let PatientEvent::Cough(cough) = event {
                let (at_s, lasts_s) = (cough.at_s.0, cough.duration_s.0);
                let size_m = cough.acceleration_m_s2.0 * lasts_s * lasts_s / PULSE_PEAK;
                let way = Vector3::from(cough.direction.map(|d| d.0)).normalize();
                sum = sum + pulse(time_s, at_s, lasts_s).scaled(size_m).along(&way);
            }
        }
        sum
    }

    /// Where the torso's origin is in the world, m.
    fn place(&self, time_s: f64) -> Jet<Vector3<f64>> {
        let mut sum = Jet::default();
        for event in &self.config.event {
            match event {
                PatientEvent::Table(ride) => {
                    let by_m = Vector3::from(ride.by_mm.map(|by| 1e-3 * by.0));
                    sum = sum + step(time_s, ride.at_s.0, ride.duration_s.0).along(&by_m);
                }
                PatientEvent::Walk(walk) => sum = sum + walked(walk, time_s),
                PatientEvent::Posture(_) | PatientEvent::Cough(_) => {}
            }
        }
        sum
    }

    /// Until when nothing of the patient moves that was still at `time_s`, s; `time_s` itself where something moves.
    pub fn still_until_s(&self, time_s: f64) -> f64 {
        if self.config.breathing_amplitude_mm.0 > 0.0 {
            return time_s;
        }
        let mut until_s = f64::INFINITY;
        for &[from_s, to_s] in &self.busy_s {
            if time_s < to_s {
                until_s = f64::min(until_s, from_s.max(time_s));
            }
        }
        until_s
    }

    /// All that it is made of, for fingerprints.
    pub(crate) fn fingerprint_text(&self) -> String {
        format!("{:?}", self.config)
    }

    /// Events with their times, s, in words.
    pub(crate) fn notes(&self) -> impl Iterator<Item = (f64, String)> + '_ {
        self.config
            .event
            .iter()
            .map(|event| (event.interval_s()[0], format!("patient: {}", event.describe())))
    }
}

/// Where a walk carries the trunk, m in the world.
fn walked(walk: &Walk, time_s: f64) -> Jet<Vector3<f64>> {
    let (from_s, to_s) = (walk.from_s.0, walk.to_s.0);
    let ramp_s = WALK_RAMP_S.min(0.5 * (to_s - from_s));
    let ends_s = to_s - ramp_s;
    let walking = step(time_s, from_s, ramp_s) - step(time_s, ends_s, ramp_s);
    let up = swing(time_s, from_s, walk.step_frequency_hz.0).scaled(1e-3 * walk.amplitude_mm.0);
    let way = step_integral(time_s, from_s, ramp_s) - step_integral(time_s, ends_s, ramp_s);
    (walking * up).along(&UP) + way.scaled(walk.speed_m_s.0).along(&FORWARDS)
}

/// Which way gravity points in the torso of a posture.
fn hangs(posture: Posture) -> Vector3<f64> {
    let [roll, pitch] = posture.angles_rad();
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), pitch)
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
    rotation.inverse() * -UP
}

/// From one angle to another that may be told with full turns, rad: above -π, at most π.
fn shorter_way(from_rad: f64, to_rad: f64) -> f64 {
    let by = (to_rad - from_rad).rem_euclid(TAU);
    // A hair more than half a turn is rounding, and goes by the left side as half a turn does.
    if by > PI + 1e-9 { by - TAU } else { by }
}

/// Pose of a frame of the patient, or of none: then all frames of a patient are the world's.
pub(crate) fn frame_of(patient: Option<&Patient>, name: &str, time_s: f64) -> Option<Isometry3<f64>> {
    match patient {
        Some(patient) => patient.frame(name, time_s),
        None => ["torso", "abdomen", "gut"].contains(&name).then(Isometry3::identity),
    }
}

/// The frame to which what is worn on another is calibrated: nobody follows the belly's surface.
pub(crate) fn calibrated_frame(name: &str) -> &str {
    if name == "abdomen" { "torso" } else { name }
}

#[cfg(test)]
mod tests;
