//! The capsule as a rigid body, and the border between nalgebra and rapier's math types.
//!
//! Weight, buoyancy, drag and the wall come in one implicit solve ([`super::wall`]) whose velocities this body is given. Then
//!
//! - with rigid obstacles in its world (plates, polyps), rapier solves their contacts, adds the gyroscopic torque and
//!   integrates the pose;
//! - alone, nothing is left for rapier but to integrate, and its pipeline (3 to 4 us a step, half of the engine's time) is
//!   not run: the same integration is written out here, and a test holds the two together.
//!
//! ```text
//! p⁺ = p + v dt     q⁺ = Exp(ω dt) q     ω⁺ = I(q⁺)⁻¹ I(q) ω
//! ```
//!
//! The last line conserves the angular momentum exactly, which is all that the gyroscopic torque does.
//!
//! `length_unit` is 0.01: contact tolerances are then fractions of a centimetre, and rapier's hidden limit of speed
//! (400 length units per second) is 4 m/s, far above anything here. Warm starting and the recycling of contacts are off: they
//! remember earlier steps, and a snapshot could not.

use super::system::Twist;
use lumenav_core::CapsuleBody;
use lumenav_core::pose::{exp_so3, renormalize};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};
use rapier3d::prelude::{ColliderBuilder, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle};
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

impl Inertia {
    /// `I ω` for a capsule along `axis`.
    pub(crate) fn times(&self, axis: &Vector3<f64>, angular: &Vector3<f64>) -> Vector3<f64> {
        angular * self.transverse_kg_m2
            + axis * ((self.axial_kg_m2 - self.transverse_kg_m2) * axis.dot(angular))
    }

    /// `I⁻¹ L`.
    fn inverse_times(&self, axis: &Vector3<f64>, momentum: &Vector3<f64>) -> Vector3<f64> {
        momentum / self.transverse_kg_m2
            + axis * ((1.0 / self.axial_kg_m2 - 1.0 / self.transverse_kg_m2) * axis.dot(momentum))
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

/// Friction of rigid obstacles. A polished capsule on wet plastic or mucosa, [B].
const OBSTACLE_FRICTION: f64 = 0.1;

/// The capsule's pose and velocities, and the rapier world it meets obstacles in.
pub(crate) struct Body {
    pose: Isometry3<f64>,
    twist: Twist,
    step_s: f64,
    world: PhysicsWorld,
    handle: RigidBodyHandle,
    obstacles: usize,
    pub(crate) inertia: Inertia,
}

impl Body {
    pub(crate) fn new(capsule: &CapsuleBody, pose: &Isometry3<f64>, step_s: f64) -> Self {
        let inertia = Inertia::of(capsule);
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::ZERO;
        let parameters = &mut world.integration_parameters;
        parameters.dt = step_s;
        parameters.length_unit = LENGTH_UNIT_M;
        parameters.warmstart_coefficient = 0.0;
        parameters.contact_recycling = false;
        let body = RigidBodyBuilder::dynamic().pose(to_rapier(pose)).can_sleep(false);
        // The collider's density makes rapier's own inertia that of the uniform capsule.
        let half_height_m = 0.5 * capsule.length_m - capsule.radius_m;
        let collider = ColliderBuilder::capsule_x(half_height_m, capsule.radius_m)
            .density(capsule.mass_kg / inertia.volume_m3)
            .friction(OBSTACLE_FRICTION);
        let (handle, _) = world.insert(body, collider);
        let twist = Twist { linear: Vector3::zeros(), angular: Vector3::zeros() };
        Self { pose: *pose, twist, step_s, world, handle, obstacles: 0, inertia }
    }

    pub(crate) fn insert(&mut self, obstacle: &Obstacle) {
        let (collider, pose) = match obstacle {
            Obstacle::Plate { torso_from_plate, half_extents_m: h } => {
                (ColliderBuilder::cuboid(h.x, h.y, h.z), *torso_from_plate)
            }
            Obstacle::Ball { centre_torso_m, radius_m } => (
                ColliderBuilder::ball(*radius_m),
                Isometry3::from_parts(Translation3::from(centre_torso_m.coords), UnitQuaternion::identity()),
            ),
        };
        self.world.insert_collider(collider.position(to_rapier(&pose)).friction(OBSTACLE_FRICTION), None);
        self.obstacles += 1;
    }

    pub(crate) fn obstacles(&self) -> usize {
        self.obstacles
    }

    pub(crate) fn pose(&self) -> Isometry3<f64> {
        self.pose
    }

    pub(crate) fn twist(&self) -> Twist {
        self.twist
    }

    pub(crate) fn set_twist(&mut self, twist: &Twist) {
        self.twist = *twist;
    }

    pub(crate) fn set_pose(&mut self, pose: &Isometry3<f64>) {
        self.pose = *pose;
    }

    /// One step with the present velocities.
    pub(crate) fn step(&mut self) {
        if self.obstacles == 0 { self.step_alone() } else { self.step_among_obstacles() }
    }

    fn step_alone(&mut self) {
        let axis = self.pose.rotation * Vector3::x();
        let momentum = self.inertia.times(&axis, &self.twist.angular);
        self.pose.translation.vector += self.twist.linear * self.step_s;
        self.pose.rotation = renormalize(exp_so3(&(self.twist.angular * self.step_s)) * self.pose.rotation);
        let axis = self.pose.rotation * Vector3::x();
        self.twist.angular = self.inertia.inverse_times(&axis, &momentum);
    }

    fn step_among_obstacles(&mut self) {
        let body = &mut self.world.bodies[self.handle];
        body.set_position(to_rapier(&self.pose), true);
        body.set_linvel(to_vector(&self.twist.linear), true);
        body.set_angvel(to_vector(&self.twist.angular), true);
        self.world.step();
        let body = &self.world.bodies[self.handle];
        let (v, w) = (body.linvel(), body.angvel());
        self.pose = from_rapier(body.position());
        self.twist = Twist { linear: Vector3::new(v.x, v.y, v.z), angular: Vector3::new(w.x, w.y, w.z) };
    }
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

    const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };

    fn spinning(step_s: f64) -> Body {
        let mut body = Body::new(&CAPSULE, &Isometry3::translation(0.1, 0.0, 0.2), step_s);
        body.set_twist(&Twist {
            linear: Vector3::new(0.02, -0.01, 0.03),
            angular: Vector3::new(9.0, 4.0, -2.0),
        });
        body
    }

    #[test]
    fn cross_inertia_equals_that_of_parry() {
        let body = spinning(1e-3);
        let inertia = Inertia::of(&CAPSULE);
        let parry = body.world.bodies[body.handle].mass_properties().local_mprops;
        assert!((parry.mass() - CAPSULE.mass_kg).abs() < 1e-12);
        let principal = parry.principal_inertia();
        let mut moments = [principal.x, principal.y, principal.z];
        moments.sort_by(f64::total_cmp);
        assert!((moments[0] / inertia.axial_kg_m2 - 1.0).abs() < 1e-9, "{moments:?} {inertia:?}");
        assert!((moments[1] / inertia.transverse_kg_m2 - 1.0).abs() < 1e-9, "{moments:?} {inertia:?}");
        assert!((moments[2] / inertia.transverse_kg_m2 - 1.0).abs() < 1e-9, "{moments:?} {inertia:?}");
    }

    /// Angle between the two integrations after half a second at about 10 rad/s.
    fn disagreement_rad(angular: Vector3<f64>, step_s: f64) -> f64 {
        let [mut alone, mut rapier] = [spinning(step_s), spinning(step_s)];
        // A far obstacle makes rapier's pipeline run without a contact.
        rapier.insert(&Obstacle::Ball { centre_torso_m: Point3::new(5.0, 5.0, 5.0), radius_m: 0.01 });
        for body in [&mut alone, &mut rapier] {
            body.set_twist(&Twist { linear: Vector3::new(0.02, -0.01, 0.03), angular });
            for _ in 0..(0.5 / step_s).round() as u32 {
                body.step();
            }
        }
        let (a, b) = (alone.pose(), rapier.pose());
        assert!((a.translation.vector - b.translation.vector).norm() < 1e-12);
        a.rotation.angle_to(&b.rotation)
    }

    #[test]
    fn cross_integration_alone_equals_that_of_rapier() {
        // About a principal axis there is no gyroscopic torque.
        for angular in [Vector3::new(10.0, 0.0, 0.0), Vector3::new(0.0, 0.0, -10.0)] {
            let angle = disagreement_rad(angular, 1e-3);
            assert!(angle < 1e-5, "{angular:?}: {angle} rad");
        }
        // Else the two treat it differently to first order in the step, and converge.
        let tumbling = Vector3::new(9.0, 4.0, -2.0);
        let [coarse, fine] = [1e-3, 2.5e-4].map(|step_s| disagreement_rad(tumbling, step_s));
        assert!(coarse < 0.03 && fine < 0.3 * coarse, "{coarse} then {fine} rad");
    }

    #[test]
    fn closed_form_free_precession_of_a_symmetric_top() {
        // The axis turns about the angular momentum at the rate |L|/I_transverse.
        let mut body = spinning(1e-4);
        let inertia = body.inertia;
        let axis = |body: &Body| body.pose().rotation * Vector3::x();
        let momentum = inertia.times(&axis(&body), &body.twist().angular);
        let start = axis(&body);
        let n = 5000;
        for _ in 0..n {
            body.step();
        }
        let rate = momentum.norm() / inertia.transverse_kg_m2;
        let turn = exp_so3(&(momentum.normalize() * (rate * 1e-4 * f64::from(n))));
        assert!((turn * start - axis(&body)).norm() < 2e-3, "{}", (turn * start - axis(&body)).norm());
        let after = inertia.times(&axis(&body), &body.twist().angular);
        assert!((after - momentum).norm() < 1e-9 * momentum.norm());
    }
}
