//! What bodies in the tract do to each other: contacts and joints, in one implicit step with the wall of all.
//!
//! ```text
//! contact   F_n = max(0, k (p + dt ṗ⁺))      p: overlap, negative where they are apart;  ṗ = n·(v_one - v_other)
//!           f   = -μ F_n tanh(|v_t|/v0)/|v_t| v_t
//! joint     F   = -k (e + dt ė⁺)             e: from the place on the other to the place on the one
//! ```
//!
//! A taut string turns its links within a step: the torque `r x F` goes with the lever r, which turns by `dt ω⁺ x r`. Where F pulls (`r·F > 0`) it is taken at
//! the end of the step, too: `dt² r·F (1 - r̂ r̂ᵀ)` for the angular velocities (a link of 40 mg at 0.3 N swings 360 times a second).
//!
//! All this with velocities at the end of the step, found by the same fixed-point iteration as the wall's ([`super::wall`]), of which these are further rows:
//! what a capsule presses against the wall feels both within the step. (Rapier's own contacts and joints come after the wall and know nothing of
//! it: what was wedged between a capsule and a bend went through the wall by 3 to 11 mm, and a taut string cut through loops.)
//!
//! Two capsules touch at the nearest points of their axes, and at the ends of either axis where those are near the other. Places along the tract tell which
//! bodies can touch: a neighbouring loop of the bowel is behind two walls.

use super::EngineConfig;
use super::body::OBSTACLE_FRICTION;
use super::coupled::{Coupled, Relative};
use super::mover::Mover;
use super::system::{Row, Twist};
use nalgebra::{Point3, Vector3};
use rapier3d::parry::query::details::closest_points_segment_segment_with_locations_nD as nearest_of_segments;
use rapier3d::prelude::Vector;

/// Stiffness of a contact between bodies, N/m: at the force of a strong wave, 0.3 N, they enter each other by 3 um (B).
const CONTACT_NEWTON_PER_M: f64 = 1e5;
/// Of a joint, N/m.
const JOINT_NEWTON_PER_M: f64 = 1e5;
/// More overlap than this (of what was put in where another lies) does not push harder, m: they part within a moment instead of flying apart.
const DEEPEST_M: f64 = 2e-4;
/// Bodies nearer than this may touch within the step, m; and those that approach each other, by what they come nearer.
const NEAR_M: f64 = 5e-4;
/// Pairs of nearest points closer together than this are one, m.
const SAME_M: f64 = 5e-4;
/// Iterations of friction and of which contacts push.
const MOST_ITERATIONS: usize = 16;
/// Relative and absolute change of a slip at which the iteration ends.
const SLIP_TOLERANCE: f64 = 2e-2;
const SLIP_TOLERANCE_M_S: f64 = 1e-7;

/// Where a body is tied to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Tie {
    /// To a place of another body, m in its frame.
    Body(usize, Point3<f64>),
    /// To a place in the gut, m.
    Gut(Point3<f64>),
}

/// A place of one body (m, in its frame) that stays where another is; they may turn about it, and do not touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Joint {
    pub(super) body: usize,
    pub(super) place: Point3<f64>,
    pub(super) to: Tie,
}

impl Joint {
    fn joins(&self, one: usize, other: usize) -> bool {
        match self.to {
            Tie::Body(to, _) => (self.body, to) == (one, other) || (self.body, to) == (other, one),
            Tie::Gut(_) => false,
        }
    }
}

/// A joint in the present step.
#[derive(Debug, Clone, Copy)]
struct Held {
    /// Velocity of the one's place relative to the other's, along x, y, z.
    rows: [Relative; 3],
    apart_m: Vector3<f64>,
    /// From the centres of both to the place, m.
    one: (usize, Vector3<f64>),
    other: Option<(usize, Vector3<f64>)>,
    /// On the one, N.
    force_n: Vector3<f64>,
}

/// One place at which two bodies touch or may within the step.
#[derive(Debug, Clone, Copy)]
struct Touch {
    push: Relative,
    slides: [Relative; 2],
    overlap_m: f64,
    pushes: bool,
    slip_m_s: f64,
    friction_n_s_m: f64,
}

/// All of it; kept between steps to allocate nothing.
#[derive(Default)]
pub(super) struct Together {
    joints: Vec<Joint>,
    held: Vec<Held>,
    touches: Vec<Touch>,
    coupled: Coupled,
    twists: Vec<Twist>,
}

impl Together {
    pub(super) fn join(&mut self, joint: Joint) {
        self.joints.push(joint);
    }

    /// Velocities of all bodies at the end of a step, in the order of `movers`, whose walls have been found.
    pub(super) fn solve(&mut self, movers: &mut [Mover], config: &EngineConfig, step_s: f64) -> &[Twist] {
        self.twists.clear();
        self.twists.extend(movers.iter().map(|mover| mover.twist));
        self.find_held(movers);
        self.find_touches(movers, step_s);
        let slides = self.touches.iter().flat_map(|touch| &touch.slides);
        let rows = self.held.iter().flat_map(|held| &held.rows).chain(slides);
        self.coupled.shape(movers.len(), rows);
        self.update(movers, config, step_s);
        for _ in 0..MOST_ITERATIONS {
            self.fill(movers, step_s);
            // It always is positive definite: masses are.
            if !self.coupled.solve(&mut self.twists) || self.update(movers, config, step_s) {
                break;
            }
        }
        &self.twists
    }

    /// Takes forces from the present velocities; whether they are what the last solve used.
    fn update(&mut self, movers: &mut [Mover], config: &EngineConfig, step_s: f64) -> bool {
        let mut settled = true;
        for (mover, twist) in movers.iter_mut().zip(&self.twists) {
            settled &= mover.contacts.update(twist, mover.friction, config, step_s);
        }
        for held in &mut self.held {
            held.update(&self.twists, step_s);
        }
        for touch in &mut self.touches {
            settled &= touch.update(&self.twists, config, step_s);
        }
        settled
    }

    fn fill(&mut self, movers: &[Mover], step_s: f64) {
        self.coupled.clear();
        for (index, mover) in movers.iter().enumerate() {
            let mut system = mover.system;
            mover.contacts.add_to(&mut system, step_s);
            self.coupled.add_body(index, &system);
        }
        for held in &self.held {
            held.add_to(&mut self.coupled, step_s);
        }
        for touch in self.touches.iter().filter(|touch| touch.pushes) {
            touch.add_to(&mut self.coupled, step_s);
        }
    }

    fn find_held(&mut self, movers: &[Mover]) {
        self.held.clear();
        self.held.extend(self.joints.iter().filter_map(|joint| Held::of(joint, movers)));
    }

    fn find_touches(&mut self, movers: &[Mover], step_s: f64) {
        self.touches.clear();
        for other in 1..movers.len() {
            for one in 0..other {
                let (a, b) = (&movers[one], &movers[other]);
                if a.left || b.left || !may_meet(a, b) || self.joints.iter().any(|j| j.joins(one, other)) {
                    continue;
                }
                let approach_m = step_s * (a.fastest_m_s() + b.fastest_m_s());
                for [p, q] in nearest_points(a, b) {
                    self.touches.extend(Touch::of((one, a, p), (other, b, q), NEAR_M + approach_m));
                }
            }
        }
    }
}

impl Held {
    /// `None` if either body has left.
    fn of(joint: &Joint, movers: &[Mover]) -> Option<Self> {
        let place = movers[joint.body].pose * joint.place;
        let (to, other) = match joint.to {
            Tie::Gut(to) => (to, None),
            Tie::Body(index, at) => (movers[index].pose * at, Some(index)),
        };
        if movers[joint.body].left || other.is_some_and(|index| movers[index].left) {
            return None;
        }
        let lever =
            |index: usize, at: &Point3<f64>| (index, at.coords - movers[index].pose.translation.vector);
        let one = lever(joint.body, &place);
        let other = other.map(|index| lever(index, &to));
        let rows = [Vector3::x(), Vector3::y(), Vector3::z()].map(|direction| {
            let row = |(index, lever): (usize, Vector3<f64>)| (index, Row::new(&direction, &lever));
            Relative { one: row(one), other: other.map(row) }
        });
        Some(Self { rows, apart_m: place - to, one, other, force_n: Vector3::zeros() })
    }

    fn update(&mut self, twists: &[Twist], step_s: f64) {
        let parting_m_s = Vector3::from(self.rows.map(|row| row.velocity(twists)));
        self.force_n = -JOINT_NEWTON_PER_M * (self.apart_m + step_s * parting_m_s);
    }

    fn add_to(&self, coupled: &mut Coupled, step_s: f64) {
        let stiffness = step_s * JOINT_NEWTON_PER_M;
        for (row, apart_m) in self.rows.iter().zip(&self.apart_m) {
            coupled.add_row(row, step_s * stiffness, -stiffness * apart_m);
        }
        let mut turns = |(body, lever): (usize, Vector3<f64>), force_n: Vector3<f64>| {
            coupled.add_turning(body, &lever, step_s * step_s * force_n.dot(&lever));
        };
        turns(self.one, self.force_n);
        if let Some(other) = self.other {
            turns(other, -self.force_n);
        }
    }
}

/// Whether they are at the same place of the tract.
fn may_meet(a: &Mover, b: &Mover) -> bool {
    let apart_m = (a.station.arc_length_m - b.station.arc_length_m).abs();
    apart_m < a.shape.length_m + b.shape.length_m
}

/// Pairs of points of the axes of two bodies between which they may touch.
fn nearest_points(a: &Mover, b: &Mover) -> impl Iterator<Item = [Point3<f64>; 2]> {
    let (of_a, of_b) = (a.axis_m(), b.axis_m());
    let pairs = [
        nearest(of_a, of_b),
        nearest([of_a[0]; 2], of_b),
        nearest([of_a[1]; 2], of_b),
        nearest(of_a, [of_b[0]; 2]),
        nearest(of_a, [of_b[1]; 2]),
    ];
    let same = |one: &[Point3<f64>; 2], other: &[Point3<f64>; 2]| {
        (one[0] - other[0]).norm_squared() < SAME_M * SAME_M
            && (one[1] - other[1]).norm_squared() < SAME_M * SAME_M
    };
    (0..pairs.len())
        .filter(move |k| !pairs[..*k].iter().any(|before| same(before, &pairs[*k])))
        .map(move |k| pairs[k])
}

/// The nearest points of two line segments.
fn nearest(one: [Point3<f64>; 2], other: [Point3<f64>; 2]) -> [Point3<f64>; 2] {
    let parry = |p: &Point3<f64>| Vector::new(p.x, p.y, p.z);
    let ([a, b], [c, d]) = (one.map(|p| parry(&p)), other.map(|p| parry(&p)));
    let (on_one, on_other) = nearest_of_segments((&a, &b), (&c, &d));
    let at = |ends: &[Point3<f64>; 2], part: [f64; 2]| {
        Point3::from(ends[0].coords * part[0] + ends[1].coords * part[1])
    };
    [at(&one, on_one.barycentric_coordinates()), at(&other, on_other.barycentric_coordinates())]
}

impl Touch {
    /// Of two bodies at these points of their axes, if their surfaces are nearer than `near_m` there.
    fn of(
        (one, a, p): (usize, &Mover, Point3<f64>),
        (other, b, q): (usize, &Mover, Point3<f64>),
        near_m: f64,
    ) -> Option<Self> {
        let way = q - p;
        let apart_m = way.norm();
        let overlap_m = a.shape.radius_m + b.shape.radius_m - apart_m;
        if overlap_m < -near_m {
            return None;
        }
        // Axes that cross part along the tract.
        let normal = if apart_m > 0.0 { way / apart_m } else { b.station.tangent };
        let sideways = a.station.normal - normal * normal.dot(&a.station.normal);
        let sideways =
            sideways.try_normalize(1e-6).unwrap_or_else(|| normal.cross(&a.station.tangent).normalize());
        let point = p + normal * (a.shape.radius_m - 0.5 * overlap_m);
        let relative = |direction: &Vector3<f64>| {
            let row = |mover: &Mover| Row::new(direction, &(point.coords - mover.pose.translation.vector));
            Relative { one: (one, row(a)), other: Some((other, row(b))) }
        };
        Some(Self {
            push: relative(&normal),
            slides: [relative(&sideways), relative(&normal.cross(&sideways))],
            overlap_m: overlap_m.min(DEEPEST_M),
            pushes: true,
            slip_m_s: 0.0,
            friction_n_s_m: 0.0,
        })
    }

    fn update(&mut self, twists: &[Twist], config: &EngineConfig, step_s: f64) -> bool {
        let normal_n = CONTACT_NEWTON_PER_M * (self.overlap_m + step_s * self.push.velocity(twists));
        let pushes = normal_n > 0.0;
        let slip_m_s = self.slides[0].velocity(twists).hypot(self.slides[1].velocity(twists));
        let settled = pushes == self.pushes
            && (slip_m_s - self.slip_m_s).abs() <= SLIP_TOLERANCE * slip_m_s + SLIP_TOLERANCE_M_S;
        (self.pushes, self.slip_m_s) = (pushes, slip_m_s);
        let v0 = config.regularisation_m_s.0;
        let secant = if slip_m_s < 1e-8 * v0 { 1.0 / v0 } else { (slip_m_s / v0).tanh() / slip_m_s };
        self.friction_n_s_m = OBSTACLE_FRICTION * normal_n.max(0.0) * secant;
        settled
    }

    fn add_to(&self, coupled: &mut Coupled, step_s: f64) {
        let stiffness = step_s * CONTACT_NEWTON_PER_M;
        coupled.add_row(&self.push, step_s * stiffness, -stiffness * self.overlap_m);
        for slide in &self.slides {
            coupled.add_row(slide, step_s * self.friction_n_s_m, 0.0);
        }
    }
}
