//! Motion model: velocity and angular rate as Ornstein-Uhlenbeck processes (white-noise acceleration as their limit).
//!
//! Per axis, with time constant τ, noise density q (m²/s³) and φ = exp(-Δt/τ):
//!
//! ```text
//! p' = p + τ(1-φ) v            Q_vv = q τ/2 (1-φ²)
//! v' = φ v                     Q_pv = q τ²/2 (1-φ)²
//!                              Q_pp = q τ² (Δt - 2τ(1-φ) + τ/2 (1-φ²))
//! ```
//!
//! and for τ → ∞: `p' = p + Δt v`, `Q = q [Δt³/3, Δt²/2; Δt²/2, Δt]` (Bar-Shalom, Li and Kirubarajan, "Estimation with
//! applications to tracking and navigation", section 6.2). The same holds for rotation vector and angular rate.

use crate::config::quantity::{NonNegative, Positive};
use serde::{Deserialize, Serialize};

/// How a capsule is believed to move between measurements.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionModel {
    /// Random walk of the velocity, (m/s) per √s, per axis. Default 8e-3, tuned (see below).
    pub velocity_random_walk_m_s_per_sqrt_s: NonNegative,
    /// Time constant with which velocity is forgotten, s; absent: never (white-noise acceleration). Default 1 s, chosen:
    /// long against a sensor's period, short against the rest between contractions.
    pub velocity_time_constant_s: Option<Positive>,
    /// Random walk of the angular rate, (rad/s) per √s, per axis. Default 2, tuned.
    pub rate_random_walk_rad_s_per_sqrt_s: NonNegative,
    /// Time constant with which the angular rate is forgotten, s; absent: never. Default 0.5 s, chosen with the walk.
    pub rate_time_constant_s: Option<Positive>,
}

/// Tuned on `scenarios/colon-magnetic.toml`, seeds 101 to 103, for the least mean error among settings whose mean NEES per
/// degree of freedom stays below 1.1. In the long run a velocity has the standard deviation `q √(τ/2)`: 6 mm/s and 1 rad/s here.
/// A capsule in the colon spends most of its time below that and a hundredth of it (contractions that pass, mass movements,
/// turns in bends) at up to 29 mm/s and 4 rad/s: the gate and the restart after it are what the fastest of these are left to.
/// For a sensor of 0.15 mm at 20 Hz a time constant of 0.3 s would be better by 3 %; one that sees centimetres would then lag
/// behind every mass movement.
impl Default for MotionModel {
    fn default() -> Self {
        Self {
            velocity_random_walk_m_s_per_sqrt_s: NonNegative(8e-3),
            velocity_time_constant_s: Some(Positive(1.0)),
            rate_random_walk_rad_s_per_sqrt_s: NonNegative(2.0),
            rate_time_constant_s: Some(Positive(0.5)),
        }
    }
}

/// One axis over one step: transition and noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisStep {
    /// `∂p'/∂v`, s.
    pub gain_s: f64,
    /// `∂v'/∂v`.
    pub decay: f64,
    /// Noise of the position.
    pub noise_pp: f64,
    /// Noise between position and velocity.
    pub noise_pv: f64,
    /// Noise of the velocity.
    pub noise_vv: f64,
}

impl AxisStep {
    /// Over `dt_s`, for a random walk of the velocity (per √s) and an optional time constant.
    pub fn over(dt_s: f64, random_walk: f64, time_constant_s: Option<f64>) -> Self {
        let q = random_walk * random_walk;
        match time_constant_s {
            // Below this ratio the quotients lose more digits than the limit is off.
            Some(tau) if dt_s > 1e-5 * tau => {
                let one_minus = -(-dt_s / tau).exp_m1();
                let decay = 1.0 - one_minus;
                let half_square = 0.5 * one_minus * (1.0 + decay);
                Self {
                    gain_s: tau * one_minus,
                    decay,
                    noise_pp: q * tau * tau * (dt_s - 2.0 * tau * one_minus + tau * half_square),
                    noise_pv: q * 0.5 * (tau * one_minus).powi(2),
                    noise_vv: q * tau * half_square,
                }
            }
            _ => Self {
                gain_s: dt_s,
                decay: time_constant_s.map_or(1.0, |tau| 1.0 - dt_s / tau),
                noise_pp: q * dt_s.powi(3) / 3.0,
                noise_pv: q * dt_s * dt_s / 2.0,
                noise_vv: q * dt_s,
            },
        }
    }
}

impl MotionModel {
    /// Translation over `dt_s`.
    pub fn translation(&self, dt_s: f64) -> AxisStep {
        AxisStep::over(
            dt_s,
            self.velocity_random_walk_m_s_per_sqrt_s.0,
            self.velocity_time_constant_s.map(|tau| tau.0),
        )
    }

    /// Rotation over `dt_s`.
    pub fn rotation(&self, dt_s: f64) -> AxisStep {
        AxisStep::over(
            dt_s,
            self.rate_random_walk_rad_s_per_sqrt_s.0,
            self.rate_time_constant_s.map(|tau| tau.0),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_long_time_constant_is_white_noise_acceleration() {
        let (dt, walk) = (0.1, 0.3);
        let limit = AxisStep::over(dt, walk, None);
        let near = AxisStep::over(dt, walk, Some(1e3));
        assert!((near.gain_s / limit.gain_s - 1.0).abs() < 1e-4);
        assert!((near.noise_pp / limit.noise_pp - 1.0).abs() < 2e-4);
        assert!((near.noise_pv / limit.noise_pv - 1.0).abs() < 2e-4);
        assert!((near.noise_vv / limit.noise_vv - 1.0).abs() < 2e-4);
    }

    #[test]
    fn law_two_half_steps_make_one() {
        let (walk, tau) = (0.3, Some(0.7));
        let (half, full) = (AxisStep::over(0.05, walk, tau), AxisStep::over(0.1, walk, tau));
        // [p v] covariance after two half steps from zero.
        let (g, d) = (half.gain_s, half.decay);
        let pp = half.noise_pp + 2.0 * g * half.noise_pv + g * g * half.noise_vv + half.noise_pp;
        let pv = d * (half.noise_pv + g * half.noise_vv) + half.noise_pv;
        let vv = d * d * half.noise_vv + half.noise_vv;
        assert!((pp / full.noise_pp - 1.0).abs() < 1e-12);
        assert!((pv / full.noise_pv - 1.0).abs() < 1e-12);
        assert!((vv / full.noise_vv - 1.0).abs() < 1e-12);
        assert!((g + d * g - full.gain_s).abs() < 1e-15);
    }
}
