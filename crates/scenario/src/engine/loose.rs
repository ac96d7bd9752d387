//! What is loose in the tract beside the capsule: residue, a second capsule, and a tether that the capsule drags behind it.
//!
//! Each meets the wall as the capsule does ([`super::wall`]), and the others in the same implicit step ([`super::together`]); rapier's bodies carry
//! their poses and meet what is rigid. A ball is a capsule without a cylinder. What the wall does to a capsule (stiffness, damping, friction) it does to
//! others by the ratio of their surfaces; taut tissue is as taut for all.
//!
//! A tether is a chain of links, each a capsule of its own, joined end to end and to the capsule's oral tip; its other end is held where it is, or
//! free. It neither stretches nor resists bending.
//!
//! Neglected: that residue gives way, sticks and dissolves (a ball rolls); the tether's bending stiffness; that a taut tether gathers the bowel up (where two
//! loops lie against each other it may take the short cut between them, which is told: [`super::EventKind::TetherCrossed`]).

use super::mover::Mover;
use super::together::{Joint, Tie};
use super::{CAPSULE, Engine, EngineError};
use lumenav_core::CapsuleBody;
use lumenav_core::pose::attitude_from_axis;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::f64::consts::PI;
use std::fmt::Write as _;

/// Most links of a tether.
const MOST_LINKS: usize = 200;
/// Rounds in which a link's far end is put a link's length away.
const ROUNDS: usize = 30;

/// Something loose in the tract.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loose {
    /// Its size and mass; a ball where the length is twice the radius.
    pub shape: CapsuleBody,
    /// Where it starts, on the centre line, arc length, m.
    pub arc_length_m: f64,
}

/// What the capsule drags behind it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tether {
    /// Length, m: links make it up, the last one as long as the others.
    pub length_m: f64,
    /// Radius, m.
    pub radius_m: f64,
    /// Length of a link, m, more than the diameter.
    pub link_m: f64,
    /// Density, kg/m³.
    pub density_kg_m3: f64,
    /// Its oral end stays where it is.
    pub held: bool,
}

impl Tether {
    fn links(&self) -> usize {
        (self.length_m / self.link_m).ceil().max(1.0) as usize
    }

    /// One link.
    fn link(&self) -> CapsuleBody {
        let (r, length) = (self.radius_m, self.link_m);
        let volume_m3 = PI * r * r * (length - 2.0 * r) + 4.0 / 3.0 * PI * r * r * r;
        CapsuleBody { radius_m: r, length_m: length, mass_kg: self.density_kg_m3 * volume_m3 }
    }
}

impl Engine {
    /// Puts something loose into the tract, its axis along the centre line.
    ///
    /// # Errors
    /// [`EngineError`]: an impossible body, a place outside the tract.
    pub fn insert_loose(&mut self, loose: &Loose) -> Result<(), EngineError> {
        let CapsuleBody { radius_m, length_m, mass_kg } = loose.shape;
        let sound = radius_m > 0.0 && mass_kg > 0.0 && length_m >= 2.0 * radius_m;
        if !(sound && (length_m * mass_kg).is_finite()) {
            return Err(EngineError::LooseShape { radius_m, length_m, mass_kg });
        }
        let high = self.tract.length_m();
        if !(0.0..=high).contains(&loose.arc_length_m) {
            let (name, value, low) = ("the place of a loose thing (m)", loose.arc_length_m, 0.0);
            return Err(EngineError::OutOfRange { name, value, low, high });
        }
        let station = self.tract.centre_line.station(loose.arc_length_m);
        let pose = Isometry3::from_parts(
            Translation3::from(station.position_m.coords),
            attitude_from_axis(&station.tangent),
        );
        let mover = Mover::new(&loose.shape, station, &self.tract, self.surface_of(&loose.shape));
        self.add(mover, &pose);
        // Writing to a string never fails.
        let _ = write!(self.loose, "{loose:?}");
        Ok(())
    }

    /// Ties a tether to the capsule's oral tip, along the centre line towards the mouth. Before the capsule settles.
    ///
    /// # Errors
    /// [`EngineError`]: a size outside its range, or a tract that is too short behind the capsule.
    pub fn attach_tether(&mut self, tether: &Tether) -> Result<(), EngineError> {
        self.check_tether(tether)?;
        let shape = tether.link();
        let (half_m, tip) = (0.5 * shape.length_m, self.oral_tip());
        let mut joint = (CAPSULE, tip);
        let mut end_m = self.bodies.pose(CAPSULE) * tip;
        let mut s_m = self.capsule().station.arc_length_m - tip.x.abs();
        let mut template: Option<Mover> = None;
        for _ in 0..tether.links() {
            s_m = self.a_link_away(&end_m, s_m, tether.link_m);
            let next_m = self.tract.station(s_m).position_m;
            let middle = end_m + (next_m - end_m) * 0.5;
            let attitude = attitude_from_axis(&(end_m - next_m).normalize());
            let pose = Isometry3::from_parts(Translation3::from(middle.coords), attitude);
            let station = self.tract.centre_line.project_near(&middle, s_m + half_m).station;
            // The bends of a tract are looked at once for all links.
            let mover = match &template {
                Some(mover) => mover.at(station, &self.tract),
                None => Mover::new(&shape, station, &self.tract, self.surface_of(&shape)),
            };
            template.get_or_insert_with(|| mover.clone());
            let index = self.add(mover, &pose);
            let to = Tie::Body(joint.0, joint.1);
            self.together.join(Joint { body: index, place: Point3::new(half_m, 0.0, 0.0), to });
            (joint, end_m) = ((index, Point3::new(-half_m, 0.0, 0.0)), next_m);
        }
        if tether.held {
            let (body, place) = joint;
            self.together.join(Joint { body, place, to: Tie::Gut(end_m) });
        }
        let _ = write!(self.loose, "{tether:?}");
        Ok(())
    }

    fn check_tether(&self, tether: &Tether) -> Result<(), EngineError> {
        let in_range = |name, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(EngineError::OutOfRange { name, value, low, high })
            }
        };
        in_range("radius_m", tether.radius_m, 1e-4, self.capsule().shape.radius_m)?;
        in_range("link_m", tether.link_m, 2.5 * tether.radius_m, 0.1)?;
        in_range("density_kg_m3", tether.density_kg_m3, 1.0, 2e4)?;
        // Room for the links, with a bit to spare where the line bends.
        let free_m = self.capsule().station.arc_length_m - 0.5 * self.capsule().shape.length_m;
        let most_m = (free_m - tether.link_m).min(MOST_LINKS as f64 * tether.link_m);
        in_range("length_m", tether.length_m, tether.link_m, most_m)
    }

    /// Arc length towards the mouth from `from_m` that is a link's length away from `end_m`.
    fn a_link_away(&self, end_m: &Point3<f64>, from_m: f64, link_m: f64) -> f64 {
        let mut s_m = from_m - link_m;
        for _ in 0..ROUNDS {
            s_m -= link_m - (self.tract.station(s_m).position_m - end_m).norm();
        }
        s_m
    }

    /// In the capsule's frame.
    fn oral_tip(&self) -> Point3<f64> {
        Point3::new(-0.5 * self.capsule().shape.length_m, 0.0, 0.0)
    }

    fn surface_of(&self, shape: &CapsuleBody) -> f64 {
        let capsule = &self.capsule().shape;
        shape.radius_m * shape.length_m / (capsule.radius_m * capsule.length_m)
    }

    fn add(&mut self, mover: Mover, pose: &Isometry3<f64>) -> usize {
        self.bodies.add(&mover.shape, pose);
        self.movers.push(mover);
        self.sleep = super::Sleep::AWAKE;
        self.movers.len() - 1
    }

    /// Takes on where the loose things are after a step. What has left the tract stays there, and meets nothing.
    pub(super) fn follow_loose(&mut self) {
        for index in CAPSULE + 1..self.movers.len() {
            if self.movers[index].left {
                continue;
            }
            let centre = Point3::from(self.bodies.pose(index).translation.vector);
            let twist = self.bodies.twist(index);
            self.movers[index].move_on(&centre, &twist, &self.tract, self.step_s);
            if self.is_outside(index, &centre) {
                self.movers[index].left = true;
                self.bodies.set_present(index, false);
            }
        }
    }

    /// What is loose, in the order in which it was put in (a tether's links from the capsule on): its shape, its pose in the gut's frame, and its
    /// arc length, m.
    pub fn loose(&self) -> impl Iterator<Item = (CapsuleBody, Isometry3<f64>, f64)> {
        let all = self.movers.iter().enumerate().skip(CAPSULE + 1);
        all.map(|(index, mover)| (mover.shape, self.bodies.pose(index), mover.station.arc_length_m))
    }

    /// The oral tip of the capsule, gut frame: where a tether begins.
    pub fn oral_tip_gut_m(&self) -> Point3<f64> {
        self.bodies.pose(CAPSULE) * self.oral_tip()
    }
}

/// Both ends of a body, aboral first.
pub fn ends_of(shape: &CapsuleBody, pose: &Isometry3<f64>) -> [Point3<f64>; 2] {
    let half = Vector3::new(0.5 * shape.length_m, 0.0, 0.0);
    [pose * Point3::from(half), pose * Point3::from(-half)]
}
