//! The capsule and what is loose beside it as rigid bodies, and the border between nalgebra and rapier's math types.
//!
//! Weight, buoyancy, drag, the wall ([`super::wall`]), and what bodies do to each other ([`super::together`]), come in one implicit solve whose
//! velocities these bodies are given; rapier moves them: it solves the contacts with rigid obstacles (plates, polyps), adds the gyroscopic torque and
//! integrates the poses, which live in rapier's bodies alone.
//!
//! Without an obstacle there is nothing for rapier to solve: bodies carry their masses without colliders, and a step is rapier's
//! gyroscopic torque and its integration of a pose, without its pipeline, which took a third of the engine's time. With the first obstacle the
//! bodies get their colliders, which meet obstacles and not each other, and are stepped by the pipeline.
//!
//! `length_unit` is 0.01: contact tolerances are then fractions of a centimetre, and rapier's hidden limit of speed
//! (400 length units per second; its pipeline's, so only among obstacles) is 4 m/s, far above anything here. Warm starting and the recycling of contacts are off: they
//! remember earlier steps, and a snapshot could not.

use super::system::Twist;
use lumenav_core::CapsuleBody;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};
use rapier3d::prelude::{
    ColliderBuilder, Group, InteractionGroups, InteractionTestMode, MassProperties, PhysicsWorld,
    RigidBodyBuilder, RigidBodyHandle,
};
use std::f64::consts::PI;

/// Scale of a typical object, m; see the module's text.
const LENGTH_UNIT_M: f64 = 0.01;

/// Mass and moments of inertia of a uniform capsule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Inertia {
    pub(crate) mass_kg: f64,
    /// About the long axis, kg m².
    pub(crate) axial_kg_m2: f64,
    /// About any axis across it through the centre, kg m².
    pub(crate) transverse_kg_m2: f64,
    pub(crate) volume_m3: f64,
}

impl Inertia {
    /// Cylinder of length `h = L - 2 r` with two half balls, of one density.
    pub(crate) fn of(body: &CapsuleBody) -> Self {
        let (r, h) = (body.radius_m, body.length_m - 2.0 * body.radius_m);
        let cylinder_m3 = PI * r * r * h;
        let ball_m3 = 4.0 / 3.0 * PI * r * r * r;
        let volume_m3 = cylinder_m3 + ball_m3;
        let (cylinder, ball) = (body.mass_kg * cylinder_m3 / volume_m3, body.mass_kg * ball_m3 / volume_m3);
        // A half ball's centroid lies 3/8 r from its flat face; the parallel axis theorem gives the rest.
        let transverse_kg_m2 =
            cylinder * (h * h / 12.0 + r * r / 4.0) + ball * (0.4 * r * r + 0.25 * h * h + 0.375 * h * r);
        Self {
            mass_kg: body.mass_kg,
            axial_kg_m2: cylinder * r * r / 2.0 + ball * 0.4 * r * r,
            transverse_kg_m2,
            volume_m3,
        }
    }
}

/// Something rigid that stands still in the tract, given in the torso frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// A cuboid: a plate, a clip.
    Plate {
        /// Pose of its centre.
        torso_from_plate: Isometry3<f64>,
        /// Half of its edges, m.
        half_extents_m: Vector3<f64>,
    },
    /// A ball: a polyp.
    Ball {
        /// Its centre, m.
        centre_torso_m: Point3<f64>,
        /// Its radius, m.
        radius_m: f64,
    },
}

/// Friction of rigid things. A polished capsule on wet plastic or mucosa, (B).
pub(super) const OBSTACLE_FRICTION: f64 = 0.1;

/// Rapier sees to what stands still; bodies meet each other in [`super::together`].
const MOVED: InteractionGroups =
    InteractionGroups::new(Group::GROUP_1, Group::GROUP_2, InteractionTestMode::And);
const FIXED: InteractionGroups =
    InteractionGroups::new(Group::GROUP_2, Group::GROUP_1, InteractionTestMode::And);

/// The capsule and what is loose beside it, in the rapier world in which they meet what stands still.
pub(crate) struct Bodies {
    world: PhysicsWorld,
    all: Vec<Body>,
    obstacles: usize,
}

/// One of them.
#[derive(Clone, Copy)]
struct Body {
    handle: RigidBodyHandle,
    shape: CapsuleBody,
}

impl Bodies {
    /// Of none, in steps of so many seconds.
    pub(crate) fn new(step_s: f64) -> Self {
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::ZERO;
        world.physics_pipeline.counters.disable();
        let parameters = &mut world.integration_parameters;
        parameters.dt = step_s;
        parameters.length_unit = LENGTH_UNIT_M;
        parameters.warmstart_coefficient = 0.0;
        parameters.contact_recycling = false;
        Self { world, all: Vec::new(), obstacles: 0 }
    }

    /// Adds a body, which gets the next index.
    pub(crate) fn add(&mut self, shape: &CapsuleBody, pose: &Isometry3<f64>) {
        let inertia = Inertia::of(shape);
        let moments = Vector::new(inertia.axial_kg_m2, inertia.transverse_kg_m2, inertia.transverse_kg_m2);
        let body = RigidBodyBuilder::dynamic()
            .pose(to_rapier(pose))
            .additional_mass_properties(MassProperties::new(Vector::ZERO, inertia.mass_kg, moments))
            .can_sleep(false);
        let handle = self.world.insert_body(body);
        // Otherwise the pipeline's first step would, and a body that meets nothing never takes one.
        self.world.bodies[handle].recompute_mass_properties_from_colliders(&self.world.colliders);
        self.all.push(Body { handle, shape: *shape });
        if self.obstacles > 0 {
            self.give_colliders(self.all.len() - 1);
        }
    }

    /// Adds something that stands still.
    pub(crate) fn insert(&mut self, obstacle: &Obstacle) {
        if self.obstacles == 0 {
            self.give_colliders(0);
        }
        let (collider, pose) = match obstacle {
            Obstacle::Plate { torso_from_plate, half_extents_m: h } => {
                (ColliderBuilder::cuboid(h.x, h.y, h.z), *torso_from_plate)
            }
            Obstacle::Ball { centre_torso_m, radius_m } => (
                ColliderBuilder::ball(*radius_m),
                Isometry3::from_parts(Translation3::from(centre_torso_m.coords), UnitQuaternion::identity()),
            ),
        };
        let collider =
            collider.position(to_rapier(&pose)).friction(OBSTACLE_FRICTION).collision_groups(FIXED);
        self.world.insert_collider(collider, None);
        self.obstacles += 1;
    }

    /// Whether others meet a body; one that is not present stays where it is.
    pub(crate) fn set_present(&mut self, index: usize, present: bool) {
        let body = &mut self.world.bodies[self.all[index].handle];
        if body.is_enabled() != present {
            body.set_enabled(present);
        }
    }

    /// Gives the bodies from this one on their colliders.
    fn give_colliders(&mut self, first: usize) {
        for body in &self.all[first..] {
            // They have their masses already.
            let collider = collider_of(&body.shape).density(0.0).friction(OBSTACLE_FRICTION);
            let collider = collider.collision_groups(MOVED);
            self.world.insert_collider(collider, Some(body.handle));
        }
    }

    pub(crate) fn pose(&self, index: usize) -> Isometry3<f64> {
        from_rapier(self.world.bodies[self.all[index].handle].position())
    }

    pub(crate) fn twist(&self, index: usize) -> Twist {
        let body = &self.world.bodies[self.all[index].handle];
        let (v, w) = (body.linvel(), body.angvel());
        Twist { linear: Vector3::new(v.x, v.y, v.z), angular: Vector3::new(w.x, w.y, w.z) }
    }

    pub(crate) fn set_twist(&mut self, index: usize, twist: &Twist) {
        // It never sleeps: there is nothing to wake.
        let body = &mut self.world.bodies[self.all[index].handle];
        body.set_linvel(to_vector(&twist.linear), false);
        body.set_angvel(to_vector(&twist.angular), false);
    }

    pub(crate) fn set_pose(&mut self, index: usize, pose: &Isometry3<f64>) {
        self.world.bodies[self.all[index].handle].set_position(to_rapier(pose), true);
    }

    /// One step with the present velocities.
    pub(crate) fn step(&mut self) {
        if self.obstacles > 0 {
            self.world.step();
        } else {
            self.coast();
        }
    }

    /// What rapier's pipeline does to a body that meets nothing: the gyroscopic torque, then the pose, by rapier's own integration.
    fn coast(&mut self) {
        let step_s = self.world.integration_parameters.dt;
        for body in &self.all {
            let body = &mut self.world.bodies[body.handle];
            if !body.is_enabled() {
                continue;
            }
            body.set_angvel(body.angvel_with_gyroscopic_forces(step_s), false);
            let mut pose = body.vels().integrate(step_s, body.position(), &body.local_center_of_mass());
            pose.rotation = pose.rotation.normalize();
            body.set_position(pose, false);
        }
    }
}

fn collider_of(capsule: &CapsuleBody) -> ColliderBuilder {
    ColliderBuilder::capsule_x(0.5 * capsule.length_m - capsule.radius_m, capsule.radius_m)
}

fn to_vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn to_rapier(pose: &Isometry3<f64>) -> Pose {
    let q = pose.rotation.quaternion();
    Pose {
        rotation: Rotation::from_xyzw(q.i, q.j, q.k, q.w),
        translation: to_vector(&pose.translation.vector),
    }
}

fn from_rapier(pose: &Pose) -> Isometry3<f64> {
    let (q, t) = (pose.rotation, pose.translation);
    // Taken as it is: normalising here would break the bit-exact way back.
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z));
    Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::pose::exp_so3;

    const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };

    fn spinning(step_s: f64) -> Bodies {
        let mut body = Bodies::new(step_s);
        body.add(&CAPSULE, &Isometry3::translation(0.1, 0.0, 0.2));
        body.set_twist(
            0,
            &Twist { linear: Vector3::new(0.02, -0.01, 0.03), angular: Vector3::new(9.0, 4.0, -2.0) },
        );
        body
    }

    #[test]
    fn cross_inertia_equals_that_of_parry() {
        let inertia = Inertia::of(&CAPSULE);
        let collider = collider_of(&CAPSULE).density(CAPSULE.mass_kg / inertia.volume_m3).build();
        let parry = collider.mass_properties();
        assert!((parry.mass() - CAPSULE.mass_kg).abs() < 1e-12);
        let principal = parry.principal_inertia();
        let mut moments = [principal.x, principal.y, principal.z];
        moments.sort_by(f64::total_cmp);
        assert!((moments[0] / inertia.axial_kg_m2 - 1.0).abs() < 1e-9, "{moments:?} {inertia:?}");
        assert!((moments[1] / inertia.transverse_kg_m2 - 1.0).abs() < 1e-9, "{moments:?} {inertia:?}");
        assert!((moments[2] / inertia.transverse_kg_m2 - 1.0).abs() < 1e-9, "{moments:?} {inertia:?}");
    }

    fn far_ball() -> Obstacle {
        Obstacle::Ball { centre_torso_m: Point3::new(5.0, 5.0, 5.0), radius_m: 0.01 }
    }

    #[test]
    fn closed_form_turning_about_a_principal_axis() {
        // p + v t and Exp(ω t): exact by itself; rapier's pipeline normalises q + ½ ω dt q, which turns by
        // 2 atan(ω dt/2): short by (ω dt)²/12 of the angle, here 8e-6 of 5 rad.
        for crowded in [false, true] {
            for angular in [Vector3::new(10.0, 0.0, 0.0), Vector3::new(0.0, 0.0, -10.0)] {
                let mut body = spinning(1e-3);
                if crowded {
                    body.insert(&far_ball());
                }
                let linear = Vector3::new(0.02, -0.01, 0.03);
                body.set_twist(0, &Twist { linear, angular });
                for _ in 0..500 {
                    body.step();
                }
                let pose = body.pose(0);
                let moved = pose.translation.vector - Vector3::new(0.1, 0.0, 0.2) - linear * 0.5;
                assert!(moved.norm() < 1e-12, "{moved}");
                let angle = pose.rotation.angle_to(&exp_so3(&(angular * 0.5)));
                let most = if crowded { 4.2e-5 } else { 1e-12 };
                assert!(angle < most, "{angular:?}: {angle} rad");
            }
        }
    }

    /// `I ω` in the world.
    fn momentum(body: &Bodies) -> Vector3<f64> {
        let (inertia, angular) = (Inertia::of(&CAPSULE), body.twist(0).angular);
        let axis = body.pose(0).rotation * Vector3::x();
        angular * inertia.transverse_kg_m2
            + axis * ((inertia.axial_kg_m2 - inertia.transverse_kg_m2) * axis.dot(&angular))
    }

    /// How far the axis and the momentum (relative) are after half a second from those of a free symmetric top, whose axis turns
    /// about the angular momentum at the rate |L|/I_transverse.
    fn precession_error(step_s: f64) -> (f64, f64) {
        let mut body = spinning(step_s);
        let axis = |body: &Bodies| body.pose(0).rotation * Vector3::x();
        let (start, before) = (axis(&body), momentum(&body));
        for _ in 0..(0.5 / step_s).round() as u32 {
            body.step();
        }
        let rate = before.norm() / Inertia::of(&CAPSULE).transverse_kg_m2;
        let turn = exp_so3(&(before.normalize() * (rate * 0.5)));
        ((turn * start - axis(&body)).norm(), (momentum(&body) - before).norm() / before.norm())
    }

    #[test]
    fn closed_form_free_precession_of_a_symmetric_top() {
        // Rapier's gyroscopic torque is of the first order in the step.
        let [coarse, fine] = [4e-4, 1e-4].map(precession_error);
        println!("axis and momentum: {coarse:?}, then {fine:?}");
        assert!(fine.0 < 5e-3 && fine.1 < 5e-3, "{fine:?}");
        assert!(fine.0 < 0.3 * coarse.0 && fine.1 < 0.3 * coarse.1, "{coarse:?}, then {fine:?}");
    }

    #[test]
    fn law_a_body_put_back_continues_bit_by_bit() {
        for crowded in [false, true] {
            let make = || {
                let mut body = spinning(1.0 / 240.0);
                if crowded {
                    body.insert(&far_ball());
                }
                body
            };
            let mut whole = make();
            for _ in 0..100 {
                whole.step();
            }
            let mut resumed = make();
            resumed.set_pose(0, &whole.pose(0));
            resumed.set_twist(0, &whole.twist(0));
            for _ in 0..1000 {
                whole.step();
                resumed.step();
            }
            assert_eq!((whole.pose(0), whole.twist(0)), (resumed.pose(0), resumed.twist(0)));
        }
    }
}
