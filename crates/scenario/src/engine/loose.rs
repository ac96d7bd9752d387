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
use super::together::{Joint, Tie, overlap};
use super::{CAPSULE, Engine, EngineError};
use lumenav_core::CapsuleBody;
use lumenav_core::pose::attitude_from_axis;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::f64::consts::PI;
use std::fmt::Write as _;

/// Most links of a tether.
const MOST_LINKS: usize = 200;

/// How densely a link's other end is looked for along the tract, m.
const SEARCHED_M: f64 = 2.5e-4;
/// Halvings of that.
const HALVINGS: usize = 40;
/// Densities of what is loose, kg/m³.
pub(crate) const DENSITIES_KG_M3: [f64; 2] = [100.0, 2e4];

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
    /// Length, m.
    pub length_m: f64,
    /// Radius, m.
    pub radius_m: f64,
    /// Length of a link at most, m, more than the diameter: as many of one length make it up as are needed.
    pub link_m: f64,
    /// Density, kg/m³.
    pub density_kg_m3: f64,
    /// Its oral end stays where it is.
    pub held: bool,
}

impl Tether {
    fn links(&self) -> usize {
        // 140 mm of 20 mm are seven, whatever rounding says.
        (self.length_m / self.link_m - 1e-9).ceil().max(1.0) as usize
    }

    /// One link.
    fn link(&self) -> CapsuleBody {
        let (r, length) = (self.radius_m, self.length_m / self.links() as f64);
        let volume_m3 = PI * r * r * (length - 2.0 * r) + 4.0 / 3.0 * PI * r * r * r;
        CapsuleBody { radius_m: r, length_m: length, mass_kg: self.density_kg_m3 * volume_m3 }
    }
}

impl Engine {
    /// Puts something loose into the tract, its axis along the centre line.
    ///
    /// # Errors
    /// [`EngineError`]: an impossible body, a place outside the tract or where another body is.
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
        let mut mover = Mover::new(&loose.shape, station, &self.tract, self.surface_of(&loose.shape));
        mover.pose = pose;
        self.check_free(&mover, CAPSULE)?;
        self.add(mover);
        // Writing to a string never fails.
        let _ = write!(self.inserted, "{loose:?}");
        Ok(())
    }

    /// Ties a tether to the capsule's oral tip, along the centre line towards the mouth. Before the first step.
    ///
    /// # Errors
    /// [`EngineError`]: a size outside its range, a tract that has no room for it, a second tether.
    pub fn attach_tether(&mut self, tether: &Tether) -> Result<(), EngineError> {
        self.check_tether(tether)?;
        let tip = self.oral_tip();
        let links = self.lay_out(tether)?;
        let half_m = 0.5 * tether.length_m / links.len() as f64;
        let (mut to, mut end_m) = ((CAPSULE, tip), Point3::origin());
        for link in links {
            end_m = link.pose * Point3::new(-half_m, 0.0, 0.0);
            let body = self.add(link);
            let place = Point3::new(half_m, 0.0, 0.0);
            self.together.join(Joint { body, place, to: Tie::Body(to.0, to.1) });
            to = (body, Point3::new(-half_m, 0.0, 0.0));
        }
        if tether.held {
            self.together.join(Joint { body: to.0, place: to.1, to: Tie::Gut(end_m) });
        }
        let _ = write!(self.inserted, "{tether:?}");
        Ok(())
    }

    /// The links end to end along the centre line, from the capsule on.
    fn lay_out(&self, tether: &Tether) -> Result<Vec<Mover>, EngineError> {
        let shape = tether.link();
        let tip = self.oral_tip();
        let mut end_m = self.bodies.pose(CAPSULE) * tip;
        let mut s_m = self.capsule().station.arc_length_m - tip.x.abs();
        let first = Mover::new(&shape, self.capsule().station, &self.tract, self.surface_of(&shape));
        let mut links: Vec<Mover> = Vec::with_capacity(tether.links());
        for index in 0..tether.links() {
            let from_m = s_m;
            let room = EngineError::TetherRoom { index, arc_length_m: from_m };
            s_m = self.a_link_away(&end_m, from_m, shape.length_m).ok_or(room)?;
            let next_m = self.tract.station(s_m).position_m;
            let middle = end_m + (next_m - end_m) * 0.5;
            let station = self.tract.centre_line.project_near(&middle, 0.5 * (s_m + from_m)).station;
            let mut link = first.at(station, &self.tract);
            let attitude = attitude_from_axis(&(end_m - next_m).normalize());
            link.pose = Isometry3::from_parts(Translation3::from(middle.coords), attitude);
            // In a bend the capsule lies across the line: contacts part it and a link.
            self.check_free(&link, CAPSULE + 1)?;
            links.push(link);
            end_m = next_m;
        }
        Ok(links)
    }

    /// Refuses a body where one of the others is, from this index on.
    fn check_free(&self, body: &Mover, first: usize) -> Result<(), EngineError> {
        for (index, other) in self.movers.iter().enumerate().skip(first) {
            let mut other = other.clone();
            other.pose = self.bodies.pose(index);
            if overlap(body, &other) {
                let [arc_length_m, other_m] = [body, &other].map(|mover| mover.station.arc_length_m);
                return Err(EngineError::Occupied { arc_length_m, other_m });
            }
        }
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
        if self.step_index > 0 || !self.together.joints().is_empty() {
            return Err(EngineError::TetherTwice);
        }
        if self.caps[0].is_none() {
            return Err(EngineError::TetherOpen);
        }
        in_range("radius_m", tether.radius_m, 1e-4, self.capsule().shape.radius_m)?;
        in_range("link_m", tether.link_m, 2.5 * tether.radius_m, 0.1)?;
        in_range("density_kg_m3", tether.density_kg_m3, DENSITIES_KG_M3[0], DENSITIES_KG_M3[1])?;
        let free_m = self.capsule().station.arc_length_m - 0.5 * self.capsule().shape.length_m;
        let most_m = free_m.min(MOST_LINKS as f64 * tether.link_m);
        in_range("length_m", tether.length_m, tether.link_m, most_m)
    }

    /// The first place towards the mouth from `from_m` that is a link's length away from `end_m`, if the tract does not end or bend back before.
    fn a_link_away(&self, end_m: &Point3<f64>, from_m: f64, link_m: f64) -> Option<f64> {
        let away = |s_m: f64| (self.tract.station(s_m).position_m - end_m).norm() >= link_m;
        let most_m = link_m + PI * self.tract.radius.radius_m(from_m);
        let places =
            (1..).map(|k| from_m - f64::from(k) * SEARCHED_M).take_while(|s_m| *s_m > from_m - most_m);
        let beyond_m = places.take_while(|s_m| *s_m >= 0.0).find(|s_m| away(*s_m))?;
        let (mut near_m, mut far_m) = (beyond_m + SEARCHED_M, beyond_m);
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (near_m + far_m);
            if away(middle_m) { far_m = middle_m } else { near_m = middle_m }
        }
        Some(far_m)
    }

    /// In the capsule's frame.
    fn oral_tip(&self) -> Point3<f64> {
        Point3::new(-0.5 * self.capsule().shape.length_m, 0.0, 0.0)
    }

    fn surface_of(&self, shape: &CapsuleBody) -> f64 {
        let capsule = &self.capsule().shape;
        shape.radius_m * shape.length_m / (capsule.radius_m * capsule.length_m)
    }

    fn add(&mut self, mover: Mover) -> usize {
        self.bodies.add(&mover.shape, &mover.pose);
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
