//! A frame that moves in the world, and what is felt in it.
//!
//! A frame has the origin o(t) and the attitude R(t) in the world, the rate ω in its own axes. What is at x in it, with the velocity v
//! and the acceleration a there (all in its axes), has in the world
//!
//! ```text
//! p = o + R x
//! p' = o' + R (v + ω×x)
//! p'' = o'' + R (a + 2 ω×v + ω×(ω×x) + ω'×x)
//! ```
//!
//! so that Newton's law in the frame is `m a = F + m g_felt - 2 m ω×v` with
//!
//! ```text
//! g_felt(x) = Rᵀ (g - o'') - ω×(ω×x) - ω'×x
//! ```
//!
//! Fluid that rests in the frame carries by the same g_felt (Archimedes), but not by the Coriolis term, which is that of the motion through
//! it. Left out: the torque `-I ω'` on the capsule itself and the gyroscopic one, for I = 2e-7 kg m² and a turn within a second 1e-6 N m,
//! against 1e-4 N m of friction (25 mN on 5 mm).

use super::profile::Jet;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A frame's motion at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameMotion {
    /// Its pose.
    pub world_from_frame: Isometry3<f64>,
    /// Velocity of its origin, world, m/s.
    pub velocity_world_m_s: Vector3<f64>,
    /// Acceleration of its origin, world, m/s².
    pub acceleration_world_m_s2: Vector3<f64>,
    /// Its angular rate in its own axes, rad/s.
    pub rate_frame_rad_s: Vector3<f64>,
    /// The derivative of that, rad/s².
    pub rate_change_frame_rad_s2: Vector3<f64>,
}

/// What acts on a body in a frame beside forces, per kg, in the frame's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Felt {
    /// Gravity and the frame's acceleration where the body is, m/s²: on the body and on the fluid that it displaces.
    pub gravity_m_s2: Vector3<f64>,
    /// Coriolis term, m/s²: on the body alone.
    pub coriolis_m_s2: Vector3<f64>,
}

impl Felt {
    /// Both together, m/s².
    pub fn total_m_s2(&self) -> Vector3<f64> {
        self.gravity_m_s2 + self.coriolis_m_s2
    }
}

impl FrameMotion {
    /// The frame that the attitude `R = Rx(pitch) Rz(roll)` and an origin make.
    ///
    /// `ω = Rz(roll)ᵀ x pitch' + z roll'`.
    pub(super) fn of(roll_rad: &Jet<f64>, pitch_rad: &Jet<f64>, origin_m: &Jet<Vector3<f64>>) -> Self {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), pitch_rad.value)
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad.value);
        let (sin, cos) = roll_rad.value.sin_cos();
        let (axis, axis_change) = (Vector3::new(cos, -sin, 0.0), Vector3::new(-sin, -cos, 0.0));
        Self {
            world_from_frame: Isometry3::from_parts(Translation3::from(origin_m.value), rotation),
            velocity_world_m_s: origin_m.rate,
            acceleration_world_m_s2: origin_m.acceleration,
            rate_frame_rad_s: axis * pitch_rad.rate + Vector3::z() * roll_rad.rate,
            rate_change_frame_rad_s2: axis * pitch_rad.acceleration
                + axis_change * (pitch_rad.rate * roll_rad.rate)
                + Vector3::z() * roll_rad.acceleration,
        }
    }

    /// A frame with the same axes whose origin moves in this one.
    pub(super) fn shifted(&self, origin: &Jet<Vector3<f64>>) -> Self {
        let turn = self.world_from_frame.rotation;
        let translation = self.world_from_frame.translation.vector + turn * origin.value;
        Self {
            world_from_frame: Isometry3::from_parts(Translation3::from(translation), turn),
            velocity_world_m_s: self.velocity_world(&origin.value, &origin.rate),
            acceleration_world_m_s2: self.acceleration_world(origin),
            ..*self
        }
    }

    /// Velocity in the world of what is at `x` and moves with `v` in this frame, m/s.
    pub fn velocity_world(&self, x_m: &Vector3<f64>, v_m_s: &Vector3<f64>) -> Vector3<f64> {
        let turned = v_m_s + self.rate_frame_rad_s.cross(x_m);
        self.velocity_world_m_s + self.world_from_frame.rotation * turned
    }

    /// Acceleration in the world of what moves in this frame, m/s².
    pub fn acceleration_world(&self, point: &Jet<Vector3<f64>>) -> Vector3<f64> {
        let within = point.acceleration + self.carried(&point.value) - self.coriolis(&point.rate);
        self.acceleration_world_m_s2 + self.world_from_frame.rotation * within
    }

    /// What a body at `x` with the velocity `v` in this frame feels beside forces.
    pub fn felt(&self, gravity_world_m_s2: &Vector3<f64>, x_m: &Vector3<f64>, v_m_s: &Vector3<f64>) -> Felt {
        let back = self.world_from_frame.rotation.inverse();
        Felt {
            gravity_m_s2: back * (gravity_world_m_s2 - self.acceleration_world_m_s2) - self.carried(x_m),
            coriolis_m_s2: self.coriolis(v_m_s),
        }
    }

    /// Centripetal and Euler term of a place, m/s².
    fn carried(&self, x_m: &Vector3<f64>) -> Vector3<f64> {
        let rate = &self.rate_frame_rad_s;
        rate.cross(&rate.cross(x_m)) + self.rate_change_frame_rad_s2.cross(x_m)
    }

    fn coriolis(&self, v_m_s: &Vector3<f64>) -> Vector3<f64> {
        self.rate_frame_rad_s.cross(v_m_s) * -2.0
    }
}
