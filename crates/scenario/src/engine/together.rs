//! What bodies in the tract do to each other: contacts and joints, in one implicit step with the wall of all.
//!
//! ```text
//! contact   F_n = max(0, k (p + dt ṗ⁺))      p: overlap, negative where they are apart;  ṗ = n·(v_one - v_other)
//!           f   = -μ F_n tanh(|v_t|/v0)/|v_t| v_t
//! joint     F   = -k (e + dt ė⁺)             e: from the place on the other to the place on the one
//! ```
//!
//! A taut string turns its links within a step: the torque `r x F` goes with the lever r, which turns by `dt ω⁺ x r`. Where F pulls (`r·F > 0`) it is taken at
//! the end of the step, too: `dt² r·F (1 - r̂ r̂ᵀ)` for the angular velocities (a link of 20 mm and 73 mg at 0.3 N swings some 250 times a second).
//!
//! Two limbs of a tight fold lie against each other, and a taut string that hugs the inner side of the bend is in both. What holds it from sliding on between
//! them is the fold's own tissue: bodies that are joined and lie further apart along the tract than
//! their lengths and a bend back spare (by Δs) are drawn together along it, `F = max(0, k (Δs + dt Δṡ⁺))`. The tissue takes the momentum; that feet on the inner
//! side of a bend move faster than the bodies is neglected.
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
use lumenav_anatomy::tract::Tract;
use nalgebra::{Point3, Vector3};
use rapier3d::parry::query::details::closest_points_segment_segment_with_locations_nD as nearest_of_segments;
use rapier3d::prelude::Vector;
use std::f64::consts::PI;

/// Stiffness of a contact between bodies, N/m: at the force of a strong wave, 0.3 N, they enter each other by 3 um (B).
const CONTACT_NEWTON_PER_M: f64 = 1e5;
/// Of a joint, N/m: as a contact's (B).
const JOINT_NEWTON_PER_M: f64 = 1e5;
/// Of the tissue between the limbs of a fold, along the tract, N/m: 0.3 N, the force of a strong wave, moves a string by 1 mm (B).
const FOLD_NEWTON_PER_M: f64 = 300.0;
/// How far a chain has to come through it until that is told, m: at 3 N.
const SHORT_CUT_M: f64 = 0.01;
/// More overlap than this (of what was put in where another lies) does not push harder, m (B): they part within a moment instead of flying apart.
const DEEPEST_M: f64 = 2e-4;
/// Bodies nearer than this may touch within the step, m (B); and those that approach each other, by what they come nearer.
const NEAR_M: f64 = 5e-4;
/// Pairs of nearest points closer together than this are one, m (B).
const SAME_M: f64 = 5e-4;
/// Iterations of friction and of which contacts push; and of those after which no contact begins to push any more. In a heap of bodies contacts may take turns for
/// ever; what matters is that none is left which pulls.
const MOST_ITERATIONS: usize = 64;
const FREE_ITERATIONS: usize = 16;
/// Relative and absolute change (N) of a joint's force at which the iteration ends.
const FORCE_TOLERANCE: f64 = 1e-2;
const FORCE_TOLERANCE_N: f64 = 1e-4;
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
    fold: Option<Fold>,
}

/// What lies between the two limbs of a fold, where a taut chain would take the short cut.
#[derive(Debug, Clone, Copy)]
struct Fold {
    /// How fast both move apart along the tract.
    parting: Relative,
    /// How much further apart they are along the tract than a bend's inner side lets them be, m; below 0: less.
    over_m: f64,
    pushes: bool,
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

    pub(super) fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Velocities of all bodies at the end of a step, in the order of `movers`, whose walls have been found; `None` if they are not numbers.
    pub(super) fn solve(
        &mut self,
        movers: &mut [Mover],
        tract: &Tract,
        config: &EngineConfig,
        step_s: f64,
    ) -> Option<&[Twist]> {
        self.twists.clear();
        self.twists.extend(movers.iter().map(|mover| mover.twist));
        self.find_held(movers, tract);
        self.find_touches(movers, tract, step_s);
        let slides = self.touches.iter().flat_map(|touch| &touch.slides);
        let rows = self.held.iter().flat_map(|held| &held.rows).chain(slides);
        self.coupled.shape(movers.len(), rows);
        self.update(movers, config, step_s, false);
        for iteration in 0..MOST_ITERATIONS {
            let late = iteration >= FREE_ITERATIONS;
            self.fill(movers, step_s);
            if !self.coupled.solve(&mut self.twists) {
                return None;
            }
            if self.update(movers, config, step_s, late) {
                break;
            }
        }
        Some(&self.twists)
    }

    /// Takes forces from the present velocities; whether they are what the last solve used. `late`: nothing begins to push, and that
    /// nothing pulls is enough.
    fn update(&mut self, movers: &mut [Mover], config: &EngineConfig, step_s: f64, late: bool) -> bool {
        let mut settled = true;
        for (mover, twist) in movers.iter_mut().zip(&self.twists).filter(|(mover, _)| !mover.left) {
            settled &= mover.contacts.update(twist, mover.friction, config, step_s) || late;
        }
        for held in &mut self.held {
            settled &= held.update(&self.twists, step_s, late);
        }
        for touch in &mut self.touches {
            settled &= touch.update(&self.twists, config, step_s, late);
        }
        settled
    }

    fn fill(&mut self, movers: &[Mover], step_s: f64) {
        self.coupled.clear();
        for (index, mover) in movers.iter().enumerate() {
            if mover.left {
                self.coupled.add_absent(index);
                continue;
            }
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

    /// Where a chain of bodies skips more of the tract than a bend's inner side saves, m: it has gone through two walls that lie against
    /// each other.
    pub(super) fn short_cut_m(&self, movers: &[Mover], tract: &Tract) -> Option<f64> {
        self.joints.iter().find_map(|joint| {
            let Tie::Body(to, _) = joint.to else { return None };
            let (a, b) = (&movers[joint.body], &movers[to]);
            let from_m = a.station.arc_length_m.min(b.station.arc_length_m);
            let skipped_m = (a.station.arc_length_m - b.station.arc_length_m).abs();
            (!a.left && !b.left && skipped_m > spared_m(a, b, tract) + SHORT_CUT_M).then_some(from_m)
        })
    }

    fn find_held(&mut self, movers: &[Mover], tract: &Tract) {
        self.held.clear();
        self.held.extend(self.joints.iter().filter_map(|joint| Held::of(joint, movers, tract)));
    }

    fn find_touches(&mut self, movers: &[Mover], tract: &Tract, step_s: f64) {
        self.touches.clear();
        for other in 1..movers.len() {
            for one in 0..other {
                let (a, b) = (&movers[one], &movers[other]);
                if a.left
                    || b.left
                    || !may_meet(a, b, tract)
                    || self.joints.iter().any(|j| j.joins(one, other))
                {
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
    fn of(joint: &Joint, movers: &[Mover], tract: &Tract) -> Option<Self> {
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
        let fold = other.map(|(index, _)| Fold::of((joint.body, index), movers, tract));
        Some(Self { rows, apart_m: place - to, one, other, force_n: Vector3::zeros(), fold })
    }

    /// Takes the forces from `twists`; whether the fold pushes as it did.
    fn update(&mut self, twists: &[Twist], step_s: f64, late: bool) -> bool {
        let parting_m_s = Vector3::from(self.rows.map(|row| row.velocity(twists)));
        let force_n = -JOINT_NEWTON_PER_M * (self.apart_m + step_s * parting_m_s);
        let changed_n = (force_n - self.force_n).norm();
        self.force_n = force_n;
        let settled = late || changed_n <= FORCE_TOLERANCE * force_n.norm() + FORCE_TOLERANCE_N;
        self.fold.as_mut().is_none_or(|fold| fold.update(twists, step_s, late)) && settled
    }

    fn add_to(&self, coupled: &mut Coupled, step_s: f64) {
        let stiffness = step_s * JOINT_NEWTON_PER_M;
        for (row, apart_m) in self.rows.iter().zip(&self.apart_m) {
            coupled.add_row(row, step_s * stiffness, -stiffness * apart_m);
        }
        if let Some(fold) = self.fold.as_ref().filter(|fold| fold.pushes) {
            fold.add_to(coupled, step_s);
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

impl Fold {
    /// Of a body and the one that it is tied to.
    fn of((body, to): (usize, usize), movers: &[Mover], tract: &Tract) -> Self {
        let place = |index: usize| movers[index].station.arc_length_m;
        let (anal, oral) = if place(body) >= place(to) { (body, to) } else { (to, body) };
        let row = |index: usize| (index, Row::new(&movers[index].station.tangent, &Vector3::zeros()));
        let over_m = place(anal) - place(oral) - spared_m(&movers[body], &movers[to], tract);
        Self { parting: Relative { one: row(anal), other: Some(row(oral)) }, over_m, pushes: true }
    }

    fn update(&mut self, twists: &[Twist], step_s: f64, late: bool) -> bool {
        let pushed = self.pushes;
        self.pushes = (pushed || !late) && self.over_m + step_s * self.parting.velocity(twists) > 0.0;
        pushed == self.pushes
    }

    fn add_to(&self, coupled: &mut Coupled, step_s: f64) {
        let stiffness = step_s * FOLD_NEWTON_PER_M;
        coupled.add_row(&self.parting, step_s * stiffness, -stiffness * self.over_m);
    }
}

/// How far apart along the tract two bodies that touch are at most, m: their lengths, and what the inner side of a bend back spares, π R in one as tight as
/// the lumen is wide.
fn spared_m(a: &Mover, b: &Mover, tract: &Tract) -> f64 {
    let radius_m = tract.radius.radius_m(a.station.arc_length_m.min(b.station.arc_length_m));
    0.5 * (a.shape.length_m + b.shape.length_m) + PI * radius_m
}

/// Whether two bodies are in each other, where they are in this step.
pub(super) fn overlap(a: &Mover, b: &Mover) -> bool {
    let [p, q] = nearest(a.axis_m(), b.axis_m());
    (q - p).norm() < a.shape.radius_m + b.shape.radius_m
}

/// Whether they are at the same place of the tract, or about one bend.
fn may_meet(a: &Mover, b: &Mover, tract: &Tract) -> bool {
    let apart_m = (a.station.arc_length_m - b.station.arc_length_m).abs();
    apart_m < spared_m(a, b, tract)
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
        // Axes that cross part along the tract, the one further on aborally.
        let order = (b.station.arc_length_m - a.station.arc_length_m).signum();
        let normal = if apart_m > 0.0 { way / apart_m } else { b.station.tangent * order };
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

    fn update(&mut self, twists: &[Twist], config: &EngineConfig, step_s: f64, late: bool) -> bool {
        let normal_n = CONTACT_NEWTON_PER_M * (self.overlap_m + step_s * self.push.velocity(twists));
        let pushes = (self.pushes || !late) && normal_n > 0.0;
        let slip_m_s = self.slides[0].velocity(twists).hypot(self.slides[1].velocity(twists));
        let slips_alike = (slip_m_s - self.slip_m_s).abs() <= SLIP_TOLERANCE * slip_m_s + SLIP_TOLERANCE_M_S;
        let settled = pushes == self.pushes && (slips_alike || late);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::system::System;
    use lumenav_anatomy::segment::SegmentKey;
    use lumenav_anatomy::tract::{End, TractDraft};
    use lumenav_core::CapsuleBody;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};

    const STEP_S: f64 = 1.0 / 240.0;

    fn tract() -> Tract {
        TractDraft::straight(SegmentKey::Ileum, 0.02, 0.2, (End::Closed, End::Exit)).build().unwrap().0
    }

    /// Two capsules far from any wall, which no force acts upon.
    fn movers(poses: [Isometry3<f64>; 2], twists: [Twist; 2]) -> Vec<Mover> {
        let tract = tract();
        let shapes = [(0.0055, 0.026, 0.0033), (0.003, 0.010, 0.0004)];
        let all = shapes.into_iter().zip(poses).zip(twists);
        all.map(|(((radius_m, length_m, mass_kg), pose), twist)| {
            let shape = CapsuleBody { radius_m, length_m, mass_kg };
            let mut mover = Mover::new(&shape, tract.station(pose.translation.z), &tract, 1.0);
            let axis = pose.rotation * Vector3::x();
            let inertia = &mover.inertia;
            mover.system = System::new(mass_kg, inertia.axial_kg_m2, inertia.transverse_kg_m2, &axis, &twist);
            (mover.pose, mover.twist) = (pose, twist);
            mover
        })
        .collect()
    }

    /// Momentum and angular momentum about the origin of all.
    fn momenta(movers: &[Mover], twists: &[Twist]) -> [Vector3<f64>; 2] {
        let mut sum = [Vector3::zeros(); 2];
        for (mover, twist) in movers.iter().zip(twists) {
            let (inertia, axis) = (&mover.inertia, mover.pose.rotation * Vector3::x());
            let momentum = twist.linear * inertia.mass_kg;
            let spin = twist.angular * inertia.transverse_kg_m2
                + axis * ((inertia.axial_kg_m2 - inertia.transverse_kg_m2) * axis.dot(&twist.angular));
            sum[0] += momentum;
            sum[1] += mover.pose.translation.vector.cross(&momentum) + spin;
        }
        sum
    }

    fn apart(way_m: Vector3<f64>) -> [Isometry3<f64>; 2] {
        let place = Vector3::new(0.001, -0.002, 0.1);
        let turned = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 1.2, -0.4));
        [
            Isometry3::from_parts(Translation3::from(place), turned),
            Isometry3::from_parts(Translation3::from(place + way_m), UnitQuaternion::identity()),
        ]
    }

    const MEETING: [Twist; 2] = [
        Twist { linear: Vector3::new(0.02, 0.01, 0.05), angular: Vector3::new(1.0, -2.0, 0.5) },
        Twist { linear: Vector3::new(-0.03, 0.0, -0.09), angular: Vector3::new(-4.0, 1.0, 3.0) },
    ];

    #[test]
    fn law_a_contact_keeps_the_momenta() {
        let mut movers = movers(apart(Vector3::new(0.002, 0.006, 0.008)), MEETING);
        let before = momenta(&movers, &MEETING);
        let mut together = Together::default();
        let after = together.solve(&mut movers, &tract(), &EngineConfig::default(), STEP_S).unwrap().to_vec();
        assert!(together.touches.iter().any(|touch| touch.pushes && touch.friction_n_s_m > 0.0));
        let changed = (after[1].linear - MEETING[1].linear).norm();
        assert!(changed > 0.01, "{changed} m/s");
        for (before, after) in before.iter().zip(momenta(&movers, &after)) {
            assert!((before - after).norm() < 1e-12, "{before} {after}");
        }
    }

    #[test]
    fn law_a_joint_keeps_the_momentum_and_its_places_together() {
        let poses = apart(Vector3::new(0.0, 0.012, 0.02));
        let mut movers = movers(poses, MEETING);
        let meeting_m = poses[0] * Point3::new(0.013, 0.0, 0.0);
        let place = poses[1].inverse() * meeting_m;
        let mut together = Together::default();
        together.join(Joint { body: 1, place, to: Tie::Body(0, Point3::new(0.013, 0.0, 0.0)) });
        let before = momenta(&movers, &MEETING);
        let after = together.solve(&mut movers, &tract(), &EngineConfig::default(), STEP_S).unwrap().to_vec();
        assert!(together.touches.is_empty(), "what is joined does not touch");
        // The turn of the levers within the step is a torque on one body alone: the angular momentum changes where a joint jerks.
        let changed = (momenta(&movers, &after)[0] - before[0]).norm();
        assert!(changed < 1e-12, "{changed}");
        let velocity = |index: usize| {
            let lever = meeting_m - Point3::from(movers[index].pose.translation.vector);
            after[index].linear + after[index].angular.cross(&lever)
        };
        let parting_m_s = (velocity(0) - velocity(1)).norm();
        assert!(parting_m_s < 1e-3, "{parting_m_s} m/s, 0.1 m/s before");
    }

    #[test]
    fn closed_form_a_fold_draws_together_what_is_too_far_apart_along_the_tract() {
        // Lengths of 18 mm in the mean and π 20 mm of a bend. Bodies of the reduced mass µ under k: µ v = -dt k (Δs + dt v).
        let spared_m = 0.018 + 0.02 * PI;
        let reduced_kg = 0.0033 * 0.0004 / 0.0037;
        for over_m in [-0.005, 0.004, 0.012] {
            let poses = apart(Vector3::new(0.0, 0.0, spared_m + over_m));
            let movers = movers(poses, [Twist::REST; 2]);
            let mut fold = Fold::of((1, 0), &movers, &tract());
            assert!((fold.over_m - over_m).abs() < 1e-9, "{} for {over_m}", fold.over_m);
            let mut twists = [Twist::REST; 2];
            fold.update(&twists, STEP_S, false);
            assert_eq!(fold.pushes, over_m > 0.0);
            let mut together = Together::default();
            let origin = Point3::origin();
            together.join(Joint { body: 1, place: origin, to: Tie::Body(0, origin) });
            assert_eq!(together.short_cut_m(&movers, &tract()).is_some(), over_m > SHORT_CUT_M);
            if !fold.pushes {
                continue;
            }
            let mut coupled = Coupled::default();
            coupled.shape(2, std::iter::once(&fold.parting));
            for (index, mover) in movers.iter().enumerate() {
                coupled.add_body(index, &mover.system);
            }
            fold.add_to(&mut coupled, STEP_S);
            assert!(coupled.solve(&mut twists));
            let apart_m_s = twists[1].linear.z - twists[0].linear.z;
            let k = FOLD_NEWTON_PER_M;
            let expected_m_s = -STEP_S * k * over_m / (reduced_kg + STEP_S * STEP_S * k);
            assert!((apart_m_s / expected_m_s - 1.0).abs() < 1e-9, "{apart_m_s}, expected {expected_m_s}");
        }
    }

    #[test]
    fn closed_form_a_pull_stretches_a_joint_by_its_stiffness() {
        // A capsule tied to the gut by its middle, under 0.05 N times the step: held at F/k.
        let rest = [Twist::REST; 2];
        let mut movers = movers(apart(Vector3::new(0.0, 0.0, 0.06)), rest);
        let centre = Point3::from(movers[0].pose.translation.vector);
        let mut together = Together::default();
        together.join(Joint { body: 0, place: Point3::origin(), to: Tie::Gut(centre) });
        for _ in 0..2000 {
            let mover = &mut movers[0];
            let axis = mover.pose.rotation * Vector3::x();
            let inertia = &mover.inertia;
            let (axial, transverse) = (inertia.axial_kg_m2, inertia.transverse_kg_m2);
            mover.system = System::new(inertia.mass_kg, axial, transverse, &axis, &mover.twist);
            mover.system.add_impulse(&Vector3::new(0.0, 0.05 * STEP_S, 0.0), &Vector3::zeros());
            let twist = together.solve(&mut movers, &tract(), &EngineConfig::default(), STEP_S).unwrap()[0];
            movers[0].twist = twist;
            movers[0].pose.translation.vector += twist.linear * STEP_S;
        }
        let moved = movers[0].pose.translation.vector - centre.coords;
        let expected_m = 0.05 / JOINT_NEWTON_PER_M;
        assert!((moved - Vector3::y() * expected_m).norm() < 1e-3 * expected_m, "{moved}");
    }
}
