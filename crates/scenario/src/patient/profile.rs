//! Courses in time, each with its first two derivatives: steps, pulses, breaths.
//!
//! ```text
//! step    s(τ) = 10 τ³ - 15 τ⁴ + 6 τ⁵,  τ = (t - start)/duration        (least jerk: Flash and Hogan 1985)
//! pulse   p(τ) = 64 τ³ (1 - τ)³,  1 at τ = ½; its second derivative is -24/duration² there, its largest
//! breath  b(t) = sin⁴(π t/T)                                            (Lujan 1999, n = 2; 0 at the end of expiration)
//! ```
//!
//! All are twice continuously differentiable, so that nothing jumps in an accelerometer.

use nalgebra::Vector3;
use std::f64::consts::PI;
use std::ops::{Add, Mul, Sub};

/// A course at an instant: value, rate and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet<T> {
    /// The value.
    pub value: T,
    /// Its derivative, per s.
    pub rate: T,
    /// Its second derivative, per s².
    pub acceleration: T,
}

impl<T: Add<Output = T>> Add for Jet<T> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            rate: self.rate + other.rate,
            acceleration: self.acceleration + other.acceleration,
        }
    }
}

impl<T: Sub<Output = T>> Sub for Jet<T> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self {
            value: self.value - other.value,
            rate: self.rate - other.rate,
            acceleration: self.acceleration - other.acceleration,
        }
    }
}

/// The product of two courses.
impl Mul for Jet<f64> {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self {
            value: self.value * other.value,
            rate: self.rate * other.value + self.value * other.rate,
            acceleration: self.acceleration * other.value
                + 2.0 * self.rate * other.rate
                + self.value * other.acceleration,
        }
    }
}

impl Jet<f64> {
    /// What does not move.
    pub(super) fn resting(value: f64) -> Self {
        Self { value, rate: 0.0, acceleration: 0.0 }
    }

    /// This course times a constant.
    pub(super) fn scaled(self, factor: f64) -> Self {
        Self {
            value: factor * self.value,
            rate: factor * self.rate,
            acceleration: factor * self.acceleration,
        }
    }

    /// This course along a direction.
    pub(super) fn along(self, direction: &Vector3<f64>) -> Jet<Vector3<f64>> {
        Jet {
            value: direction * self.value,
            rate: direction * self.rate,
            acceleration: direction * self.acceleration,
        }
    }
}

/// From 0 to 1.
pub(super) fn step(time_s: f64, start_s: f64, duration_s: f64) -> Jet<f64> {
    let x = (time_s - start_s) / duration_s;
    if x <= 0.0 {
        return Jet::resting(0.0);
    }
    if x >= 1.0 {
        return Jet::resting(1.0);
    }
    Jet {
        value: x * x * x * (10.0 + x * (-15.0 + 6.0 * x)),
        rate: 30.0 * x * x * (1.0 - x) * (1.0 - x) / duration_s,
        acceleration: 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (duration_s * duration_s),
    }
}

/// The integral of [`step`], s.
pub(super) fn step_integral(time_s: f64, start_s: f64, duration_s: f64) -> Jet<f64> {
    let x = (time_s - start_s) / duration_s;
    let inside = x.clamp(0.0, 1.0);
    let ramp_s = duration_s * inside.powi(4) * (2.5 + inside * (-3.0 + inside));
    let behind_s = (time_s - start_s - duration_s).max(0.0);
    let rate = step(time_s, start_s, duration_s);
    Jet { value: ramp_s + behind_s, rate: rate.value, acceleration: rate.rate }
}

/// There and back: 0 outside, 1 in the middle.
pub(super) fn pulse(time_s: f64, start_s: f64, duration_s: f64) -> Jet<f64> {
    let x = (time_s - start_s) / duration_s;
    if !(0.0..=1.0).contains(&x) {
        return Jet::resting(0.0);
    }
    let u = x * (1.0 - x);
    Jet {
        value: 64.0 * u * u * u,
        rate: 192.0 * u * u * (1.0 - 2.0 * x) / duration_s,
        acceleration: 384.0 * u * (1.0 - 5.0 * u) / (duration_s * duration_s),
    }
}

/// Largest second derivative of [`pulse`], times its duration squared.
pub(super) const PULSE_PEAK: f64 = 24.0;

/// Breaths from the end of an expiration on: 0 there, 1 at the end of the inspiration.
pub(super) fn breath(time_s: f64, period_s: f64) -> Jet<f64> {
    // sin⁴ = (3 - 4 cos 2θ + cos 4θ)/8; the phase within the breath, so that hours do not cost digits.
    let per_s = 2.0 * PI / period_s;
    let phase = per_s * time_s.rem_euclid(period_s);
    let ([s1, c1], [s2, c2]) = ([phase.sin(), phase.cos()], [(2.0 * phase).sin(), (2.0 * phase).cos()]);
    Jet {
        value: (3.0 - 4.0 * c1 + c2) / 8.0,
        rate: per_s * (4.0 * s1 - 2.0 * s2) / 8.0,
        acceleration: per_s * per_s * (4.0 * c1 - 4.0 * c2) / 8.0,
    }
}

/// `sin 2π f (t - start)`.
pub(super) fn swing(time_s: f64, start_s: f64, frequency_hz: f64) -> Jet<f64> {
    let per_s = 2.0 * PI * frequency_hz;
    let (sin, cos) = (per_s * (time_s - start_s)).sin_cos();
    Jet { value: sin, rate: per_s * cos, acceleration: -per_s * per_s * sin }
}
