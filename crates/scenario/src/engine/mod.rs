//! The engine: a capsule, a moving bowel, gravity and time. Truth comes out step by step.
//!
//! One step of length dt:
//!
//! 1. the capsule's centre is projected onto the centre line, near where it was; the lumen is focused there ([`Lumen`]);
//! 2. five rings of the capsule are tested against the lumen ([`wall`](self));
//! 3. weight, buoyancy, drag, the actuators' wrench and the wall make one implicit system for the six velocities at the end of
//!    the step: stable at any step the lumen's motion allows (240 to 1,000 Hz tested);
//! 4. rapier's body takes these velocities; rapier solves its contacts with what is rigid in the tract and moves it
//!    ([`body`](self)).
//!
//! What is loose beside the capsule ([`loose`](self)) takes the same steps; all systems are then one, with the contacts and joints between bodies
//! ([`together`](self)).
//!
//! ```text
//! m dv/dt = m g - ρ V g + F_drag + F_wall + F_wrench
//! F_drag  = -(6π η r + ½ ρ C_d π r² |v|) v        (in fluid; the torque by strips along the capsule)
//! ```
//!
//! Frames: the tract stands still in the gut's frame, in which the engine steps; the torso's and the world's are the same without a
//! [`Patient`]. With one, the gut moves in the torso and the torso in the world ([`crate::patient`]), and
//! the capsule feels, where it is (the terms at the head of [`crate::patient::FrameMotion`]'s file),
//!
//! ```text
//! (m - ρ V) (Rᵀ (g - o'') - ω×(ω×x) - ω'×x) - 2 m ω×v
//! ```
//!
//! taken in the middle of the step. Forces, velocities and poses given out are in the world frame unless their name says else.
//!
//! Time is the number of steps: step n is at `n / step_rate_hz`, to the nanosecond, however long the exam.
//!
//! Determinism: one thread, no clock, no random numbers but those of the motility's named streams. A snapshot holds the
//! exact state of all bodies; the motility is a pure function of time.
//!
//! Neglected: added mass of the fluid, that a long body broadside has more drag than end on, lift, the flow of the contents, the wall's own inertia, and of a moving patient the torque that
//! turns the capsule with the gut.

mod bends;
mod body;
mod config;
mod coupled;
mod events;
mod felt;
mod foot;
mod fuzz;
mod loose;
mod mover;
mod settle;
mod sleep;
mod snapshot;
mod sources;
mod system;
mod together;
mod valve;
mod wall;

pub use body::Obstacle;
pub use config::EngineConfig;
pub use events::{EngineEvent, EventKind};
pub use fuzz::{FuzzReport, TOLERANCE_M, beyond_m, fuzz_inside_lumen};
pub(crate) use loose::DENSITIES_KG_M3;
pub use loose::{Loose, Tether, ends_of};
pub use settle::Settled;

use crate::patient::{Felt, Patient};
use body::Bodies;
use config::check;
use events::Watch;
use lumenav_anatomy::diverticulum::Diverticulum;
use lumenav_anatomy::lumen::Lumen;
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, Tract};
use lumenav_core::pose::attitude_from_axis;
use lumenav_core::{CapsuleBody, SimTime};
use mover::Mover;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sleep::Sleep;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::sync::Arc;
use system::{System, Twist};
use together::Together;
use valve::Valve;
use wall::{Cap, Placement, Reaction};

pub use sources::ENGINE_SOURCES;

/// Index of the capsule among the movers.
const CAPSULE: usize = 0;
/// What no actuator exerts.
const NO_WRENCH: [Vector3<f64>; 2] = [Vector3::new(0.0, 0.0, 0.0); 2];

/// What can go wrong with an engine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// A value outside its range.
    #[error("{name} has to be from {low} to {high}, it is {value}")]
    OutOfRange {
        /// Name with its unit.
        name: &'static str,
        /// The value.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// A capsule that is not longer than it is wide, or without size or mass.
    #[error(
        "in a tract ([tract]) the capsule has to be longer than wide, as the wall holds it by its straight part, with a positive mass; kinematic truth and replays take any: radius {radius_m} m, length {length_m} m, mass {mass_kg} kg"
    )]
    CapsuleShape {
        /// Radius, m.
        radius_m: f64,
        /// Length, m.
        length_m: f64,
        /// Mass, kg.
        mass_kg: f64,
    },
    /// A loose body that is shorter than it is wide, or without size or mass.
    #[error(
        "what is loose has to be a ball or longer than wide, with a positive mass: radius {radius_m} m, length {length_m} m, mass {mass_kg} kg"
    )]
    LooseShape {
        /// Radius, m.
        radius_m: f64,
        /// Length, m.
        length_m: f64,
        /// Mass, kg.
        mass_kg: f64,
    },
    /// Something loose would be where another body is.
    #[error("another body is there: at {:.1} mm it would be in the one at {:.1} mm", 1e3 * arc_length_m, 1e3 * other_m)]
    Occupied {
        /// Where it would be, arc length, m.
        arc_length_m: f64,
        /// Where the other one is, m.
        other_m: f64,
    },
    /// The tract has no room for a link.
    #[error(
        "link {} finds no room at {:.1} mm: the tract ends before it, or bends more than so long a link can; a shorter tether, shorter links, or a capsule further on",
        index + 1, 1e3 * arc_length_m
    )]
    TetherRoom {
        /// Its number from the capsule on, from 0.
        index: usize,
        /// Where it begins, m.
        arc_length_m: f64,
    },
    /// A second tether, or one for a capsule that has moved.
    #[error("a tether is tied once, before the first step")]
    TetherTwice,
    /// Nothing would stop links at the tract's oral end.
    #[error("a tether needs a tract whose oral end is closed")]
    TetherOpen,
    /// The wall does not hold the capsule where it was put.
    #[error(
        "the wall does not hold the capsule where it starts: put at {:.1} mm, it is at {:.1} mm and moves at {:.1} mm/s instead of coming to \
         rest within {:.1} mm; start it elsewhere, or on the centre line without rest by `settle_s = 0` of [engine]",
        1e3 * put_m, 1e3 * reached_m, 1e3 * speed_m_s, 1e3 * within_m
    )]
    Unsettled {
        /// Where it was put, arc length, m.
        put_m: f64,
        /// Where it is, arc length, m.
        reached_m: f64,
        /// How far from there it may rest, m.
        within_m: f64,
        /// Speed of its faster end, m/s.
        speed_m_s: f64,
    },
    /// The bytes are no snapshot of this version, or are cut short.
    #[error("not a snapshot of this engine: {reason}")]
    Snapshot {
        /// What is wrong.
        reason: &'static str,
    },
}

/// The capsule's true state at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngineState {
    /// The instant.
    pub at: SimTime,
    /// Pose: origin at the capsule's centre, x along its axis, forward aboral at the start.
    pub world_from_capsule: Isometry3<f64>,
    /// Velocity of the centre, world, m/s.
    pub velocity_world_m_s: Vector3<f64>,
    /// Angular rate, capsule frame, rad/s.
    pub angular_rate_capsule_rad_s: Vector3<f64>,
    /// Acceleration minus gravity, mean over the last step, capsule frame, m/s².
    pub specific_force_capsule_m_s2: Vector3<f64>,
    /// Arc length of the centre's projection, m.
    pub arc_length_m: f64,
    /// Distance of the centre from the centre line, m.
    pub offset_m: f64,
    /// The segment it is in.
    pub segment: SegmentKey,
    /// Norm of the force that the wall exerts, N.
    pub wall_force_n: f64,
    /// Whether the wall touches the capsule.
    pub contact: bool,
    /// Whether the capsule has left the tract: then it rests where it left, with neither velocity nor wall, and feels gravity alone.
    pub left: bool,
}

/// A capsule in a moving tract.
pub struct Engine {
    config: EngineConfig,
    tract: Arc<Tract>,
    lumen: Lumen,
    bodies: Bodies,
    /// The capsule first, then what is loose; in the order of their bodies.
    movers: Vec<Mover>,
    together: Together,
    /// The system of all had no solution: what comes after is no truth.
    broken: bool,
    /// What was put in beside the capsule, in words: part of the fingerprint.
    inserted: String,
    caps: [Option<Cap>; 2],
    /// Without a patient: the torso's axes are the world's.
    gravity_world_m_s2: Vector3<f64>,
    patient: Option<Arc<Patient>>,
    dry: Vec<bool>,
    step_s: f64,
    step_index: u64,
    wrench_world: [Vector3<f64>; 2],
    specific_force_capsule_m_s2: Vector3<f64>,
    wall_force_n: f64,
    touching: usize,
    sleep: Sleep,
    watch: Watch,
    events: Vec<EngineEvent>,
    /// See [`Engine::fingerprint`]: what never changes in it.
    fingerprint: std::sync::OnceLock<u64>,
}

impl Engine {
    /// A capsule without velocity on the centre line at the configured arc length, its x axis along the tangent; see
    /// [`Engine::settle`].
    ///
    /// # Errors
    /// [`EngineError`]: a start outside the tract, a step rate out of range, an impossible capsule.
    pub fn new(
        config: EngineConfig,
        tract: Arc<Tract>,
        motility: Motility,
        capsule: CapsuleBody,
    ) -> Result<Self, EngineError> {
        check(&config, &tract, &capsule)?;
        let start_m = config.start_arc_length_m.0;
        let station = tract.centre_line.station(start_m);
        let attitude = attitude_from_axis(&station.tangent)
            * UnitQuaternion::from_scaled_axis(Vector3::x() * config.start_roll_rad.0);
        let pose = Isometry3::from_parts(Translation3::from(station.position_m.coords), attitude);
        let step_s = 1.0 / f64::from(config.step_rate_hz);
        let mut bodies = Bodies::new(step_s);
        bodies.add(&capsule, &pose);
        let dry = tract.segments.iter().map(|segment| config.dry_segments.contains(&segment.key)).collect();
        let mover = Mover::new(&capsule, station, &tract, 1.0);
        let watch = Watch::new(start_m, mover.segment_index);
        Ok(Self {
            lumen: Lumen::new(tract.clone(), motility),
            bodies,
            movers: vec![mover],
            together: Together::default(),
            broken: false,
            inserted: String::new(),
            caps: caps(&tract),
            gravity_world_m_s2: Vector3::from(config.gravity_torso_m_s2.map(|g| g.0)),
            patient: None,
            dry,
            step_s,
            step_index: 0,
            wrench_world: [Vector3::zeros(); 2],
            specific_force_capsule_m_s2: Vector3::zeros(),
            wall_force_n: 0.0,
            touching: 0,
            sleep: Sleep::AWAKE,
            watch,
            events: Vec::with_capacity(16),
            fingerprint: std::sync::OnceLock::new(),
            config,
            tract,
        })
    }

    /// The instant it stands at.
    pub fn time(&self) -> SimTime {
        self.time_of(self.step_index)
    }

    fn time_of(&self, step_index: u64) -> SimTime {
        let nanoseconds = u128::from(step_index) * 1_000_000_000 / u128::from(self.config.step_rate_hz);
        // 292 years of nanoseconds fit.
        SimTime(nanoseconds as i64)
    }

    /// Force (N) and torque about the capsule's centre (N m), world frame, from now on until the next call.
    pub fn apply_wrench(&mut self, force_world_n: &Vector3<f64>, torque_world_n_m: &Vector3<f64>) {
        let wrench = [*force_world_n, *torque_world_n_m];
        if wrench != self.wrench_world {
            (self.wrench_world, self.sleep) = (wrench, Sleep::AWAKE);
        }
    }

    /// Gravity in the torso frame from now on, m/s². With a patient it is that of the room: in the torso as it lies supine.
    pub fn set_gravity_torso(&mut self, gravity_torso_m_s2: &Vector3<f64>) {
        if *gravity_torso_m_s2 != self.gravity_world_m_s2 {
            (self.gravity_world_m_s2, self.sleep) = (*gravity_torso_m_s2, Sleep::AWAKE);
        }
    }

    /// Puts something rigid into the tract; a capsule that already overlaps it is pushed out.
    pub fn insert_obstacle(&mut self, obstacle: &Obstacle) {
        self.bodies.insert(obstacle);
        // Writing to a text never fails.
        let _ = write!(self.inserted, "{obstacle:?}");
        self.sleep = Sleep::AWAKE;
    }

    /// Adds a pouch to the wall.
    pub fn insert_diverticulum(&mut self, diverticulum: Diverticulum) {
        self.lumen.insert(diverticulum);
        self.sleep = Sleep::AWAKE;
    }

    /// The tract.
    pub fn tract(&self) -> &Arc<Tract> {
        &self.tract
    }

    /// The lumen at the present time.
    pub fn lumen(&self) -> &Lumen {
        &self.lumen
    }

    /// Whether all bodies are where numbers say, and every step had a solution.
    pub fn is_sound(&self) -> bool {
        let finite = |index: usize| self.bodies.pose(index).translation.vector.iter().all(|v| v.is_finite());
        !self.broken && (0..self.movers.len()).all(finite)
    }

    /// What happened during the last [`Engine::step`] or [`Engine::advance_to`].
    pub fn events(&self) -> &[EngineEvent] {
        &self.events
    }

    /// One step.
    pub fn step(&mut self) {
        self.events.clear();
        self.step_once();
    }

    /// All steps that end at or before `time`.
    pub fn advance_to(&mut self, time: SimTime) {
        self.events.clear();
        let last_step = self.last_step_at(time);
        while self.step_index < last_step {
            self.step_index = self.undisturbed_until(last_step);
            if self.step_index < last_step {
                self.step_once();
            }
        }
        // Whoever asks for the lumen finds it as it is now, although nobody had to look while the capsule slept.
        self.lumen.advance_to(self.step_index as f64 * self.step_s);
    }

    fn step_once(&mut self) {
        let time_s = self.step_index as f64 * self.step_s;
        self.step_index += 1;
        if self.capsule().left {
            return;
        }
        if !self.sleeps_through(time_s) {
            self.step_at(time_s, self.step_s);
            self.doze(time_s);
        }
        self.look();
    }

    /// Whether nothing loose is in the tract (any more).
    fn is_alone(&self) -> bool {
        self.movers[CAPSULE + 1..].iter().all(|mover| mover.left)
    }

    fn capsule(&self) -> &Mover {
        &self.movers[CAPSULE]
    }

    /// Moves all by one step, with the wall as it is at `time_s` and the patient as in the `clock_s` from then on (0: the clock
    /// stands still).
    fn step_at(&mut self, time_s: f64, clock_s: f64) {
        let before = self.bodies.twist(CAPSULE);
        let wrench = self.wrench_gut(time_s);
        self.meet_wall(CAPSULE, time_s, clock_s, &wrench);
        for index in CAPSULE + 1..self.movers.len() {
            if !self.movers[index].left {
                self.meet_wall(index, time_s, clock_s, &NO_WRENCH);
            }
        }
        let reaction = if self.is_alone() { self.solve_alone() } else { self.solve_together() };
        self.bodies.step();
        self.take_state(&before, &reaction, time_s + clock_s);
        self.follow_loose();
    }

    /// Finds what a mover feels in this step: weight, drag, wrench, and where the wall touches it.
    fn meet_wall(&mut self, index: usize, time_s: f64, clock_s: f64, wrench: &[Vector3<f64>; 2]) {
        let (twist, pose) = (self.bodies.twist(index), self.bodies.pose(index));
        let axis = pose.rotation * Vector3::x();
        let mover = &self.movers[index];
        self.lumen.focus_on(mover.station.arc_length_m, mover.contacts.rings().reach_m(), time_s);
        let centre_m = pose.translation.vector;
        let felt = self.felt_at(time_s + 0.5 * clock_s, &centre_m, &twist.linear);
        let (system, force) = self.forces(mover, &axis, &twist, &felt, wrench);
        let placement = Placement {
            centre_m: Point3::from(centre_m),
            axis,
            station: mover.station,
            free_way_m: (twist.linear + force * (self.step_s / mover.inertia.mass_kg)) * self.step_s,
        };
        let friction = self.find_contacts(index, &placement);
        let mover = &mut self.movers[index];
        (mover.pose, mover.twist, mover.system, mover.friction) = (pose, twist, system, friction);
    }

    /// Gives the capsule its velocities at the end of the step.
    fn solve_alone(&mut self) -> Reaction {
        let Mover { contacts, system, twist, friction, .. } = &mut self.movers[CAPSULE];
        let reaction = contacts.solve(system, twist, *friction, &self.config, self.step_s);
        self.bodies.set_twist(CAPSULE, &reaction.twist);
        reaction
    }

    /// Gives all their velocities at the end of the step; returns what the wall does to the capsule.
    fn solve_together(&mut self) -> Reaction {
        let Some(twists) = self.together.solve(&mut self.movers, &self.tract, &self.config, self.step_s)
        else {
            self.broken = true;
            return self.movers[CAPSULE].contacts.reaction(Twist::REST);
        };
        for (index, twist) in twists.iter().enumerate() {
            if !self.movers[index].left {
                self.bodies.set_twist(index, twist);
            }
        }
        self.movers[CAPSULE].contacts.reaction(twists[CAPSULE])
    }

    fn find_contacts(&mut self, index: usize, placement: &Placement) -> f64 {
        let mover = &mut self.movers[index];
        // The index is that of the segment at the station (see `Mover::move_on`).
        let wall = &self.tract.segments[mover.segment_index].wall;
        let shut = mover.valve.as_ref().and_then(Valve::shut);
        let ends = self.caps.iter().flatten().chain(shut.as_ref());
        mover.contacts.find(&self.lumen, placement, wall, &self.config, ends);
        wall.friction
    }

    /// Everything but the wall; with the force (N) that does not depend on the velocities.
    fn forces(
        &self,
        mover: &Mover,
        axis: &Vector3<f64>,
        twist: &Twist,
        felt: &Felt,
        [force, torque]: &[Vector3<f64>; 2],
    ) -> (System, Vector3<f64>) {
        let inertia = &mover.inertia;
        let mut system =
            System::new(inertia.mass_kg, inertia.axial_kg_m2, inertia.transverse_kg_m2, axis, twist);
        let mut weight_kg = inertia.mass_kg;
        if !self.dry[mover.segment_index] {
            let config = &self.config;
            let (density, viscosity) = (config.fluid_density_kg_m3.0, config.fluid_viscosity_pa_s.0);
            weight_kg -= density * inertia.volume_m3;
            let (r, length) = (mover.shape.radius_m, mover.shape.length_m);
            let pressure = 0.5 * density * config.drag_coefficient.0;
            let speed = twist.linear.norm_squared().sqrt();
            let spin = twist.angular.norm_squared().sqrt();
            // Stokes plus pressure drag on the frontal area; strips of the width 2r at a distance x turn with ω x.
            let linear = 6.0 * PI * viscosity * r + pressure * PI * r * r * speed;
            let angular =
                8.0 * PI * viscosity * r * r * r + pressure * 2.0 * r * length.powi(4) / 32.0 * spin;
            system.add_damping(self.step_s * linear, self.step_s * angular);
        }
        let wall = &self.tract.segments[mover.segment_index].wall;
        if wall.collapsed {
            let viscous = self.config.viscous_newton_s_per_m.0 * wall.grip * mover.contacts.surface();
            let half_m = mover.contacts.rings().dome;
            // Evenly along the cylinder: a turn moves its parts by ω x.
            system.add_damping(self.step_s * viscous, self.step_s * viscous * half_m * half_m / 3.0);
        }
        let mut force = force + felt.gravity_m_s2 * weight_kg;
        if self.patient.is_some() {
            force += felt.coriolis_m_s2 * inertia.mass_kg;
        }
        system.add_impulse(&(force * self.step_s), &(torque * self.step_s));
        (system, force)
    }

    fn take_state(&mut self, before: &Twist, reaction: &Reaction, time_s: f64) {
        let pose = self.bodies.pose(CAPSULE);
        let after = self.bodies.twist(CAPSULE);
        let acceleration = (after.linear - before.linear) / self.step_s;
        // As felt where and when the step ended, for that is the state's instant.
        let felt = self.felt_at(time_s, &pose.translation.vector, &after.linear);
        self.specific_force_capsule_m_s2 = pose.rotation.inverse() * (acceleration - self.felt_total(&felt));
        self.wall_force_n = reaction.force_world_n.norm_squared().sqrt();
        self.touching = reaction.touching;
        let centre = Point3::from(pose.translation.vector);
        self.movers[CAPSULE].move_on(&centre, &after, &self.tract, self.step_s);
        if self.is_outside(CAPSULE, &centre) {
            self.movers[CAPSULE].left = true;
            self.rest(time_s);
        }
    }

    /// Tells what has happened by the end of the step.
    fn look(&mut self) {
        let seen = events::Seen {
            at: self.time(),
            arc_length_m: self.capsule().station.arc_length_m,
            segment_index: self.capsule().segment_index,
            touching: self.touching > 0,
            left: self.capsule().left,
            crossed_m: self.together.short_cut_m(&self.movers, &self.tract),
        };
        self.watch.look(&seen, &self.tract, &self.config, &mut self.events);
    }

    /// What has left rests where the tract ends: outside there is nothing that this engine could follow it through.
    fn rest(&mut self, time_s: f64) {
        self.bodies.set_twist(CAPSULE, &Twist { linear: Vector3::zeros(), angular: Vector3::zeros() });
        self.specific_force_capsule_m_s2 = self.specific_force_at_rest(time_s);
        self.wall_force_n = 0.0;
        self.touching = 0;
    }

    /// Whether a mover's centre is beyond an open end.
    fn is_outside(&self, index: usize, centre: &Point3<f64>) -> bool {
        let station = &self.movers[index].station;
        let (s, length_m) = (station.arc_length_m, self.tract.length_m());
        let beyond = (centre - station.position_m).dot(&station.tangent);
        (self.caps[0].is_none() && s <= 0.0 && beyond < 0.0)
            || (self.caps[1].is_none() && s >= length_m && beyond > 0.0)
    }
}

fn caps(tract: &Tract) -> [Option<Cap>; 2] {
    let line = &tract.centre_line;
    let (first, last) = (line.station(0.0), line.station(tract.length_m()));
    let (oral, anal) = tract.ends;
    [
        (oral == End::Closed).then_some(Cap {
            position_m: first.position_m,
            outwards: -first.tangent,
            arc_length_m: 0.0,
        }),
        (anal == End::Closed).then_some(Cap {
            position_m: last.position_m,
            outwards: last.tangent,
            arc_length_m: tract.length_m(),
        }),
    ]
}
