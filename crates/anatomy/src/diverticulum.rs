//! Diverticula: pouches of the wall.
//!
//! ```text
//! R(s, φ, t) += d G((s - s_d)/w) exp(κ (cos(φ - φ_d) - 1))        G(u) = exp(-u²/2),  κ = (R0(s_d)/w)²
//! ```
//!
//! On the wall it is as long as it is wide: for small angles the second factor is `G(R0 (φ - φ_d)/w)`. The mouth is told as the width at half of
//! the depth, `m = 2 sqrt(2 ln 2) w`. A pouch has no muscle (a false diverticulum is mucosa that has come through it): waves narrow the lumen
//! beside it and leave it as it is.
//!
//! Neglected: necks. A radius can tell no pouch that is wider than its mouth, nor one that bends.

use nalgebra::Vector3;

/// Width at half maximum of a Gaussian of standard width 1.
const FULL_WIDTH: f64 = 2.354_820_045_030_949_3;
/// Beyond this many widths there is none.
const REACH_WIDTHS: f64 = 7.0;

/// A pouch of the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Diverticulum {
    arc_length_m: f64,
    angle_rad: f64,
    depth_m: f64,
    per_width_per_m: f64,
    concentration: f64,
}

impl Diverticulum {
    /// At an arc length and an angle from the station's normal towards its binormal, where the lumen has the resting radius `radius_m`.
    pub fn new(arc_length_m: f64, angle_rad: f64, depth_m: f64, mouth_m: f64, radius_m: f64) -> Self {
        let per_width_per_m = FULL_WIDTH / mouth_m;
        let concentration = (radius_m * per_width_per_m).powi(2);
        Self { arc_length_m, angle_rad, depth_m, per_width_per_m, concentration }
    }

    /// What it adds to the radius, m, and the derivatives by arc length and angle (m/rad).
    #[inline]
    pub(crate) fn at(&self, s_m: f64, angle_rad: f64) -> Vector3<f64> {
        let u = (s_m - self.arc_length_m) * self.per_width_per_m;
        if u.abs() >= REACH_WIDTHS {
            return Vector3::zeros();
        }
        let (sine, cosine) = (angle_rad - self.angle_rad).sin_cos();
        let bulge_m = self.depth_m * (-0.5 * u * u + self.concentration * (cosine - 1.0)).exp();
        Vector3::new(bulge_m, -u * self.per_width_per_m * bulge_m, -self.concentration * sine * bulge_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_depth_and_mouth() {
        let pouch = Diverticulum::new(0.5, 1.0, 0.02, 0.024, 0.05);
        assert_eq!(pouch.at(0.5, 1.0), Vector3::new(0.02, 0.0, 0.0));
        // Half of the depth half a mouth away, along the tract and, in a wide lumen, around it.
        assert!((pouch.at(0.512, 1.0).x - 0.01).abs() < 1e-15);
        assert!((pouch.at(0.5, 1.0 - 0.012 / 0.05).x - 0.01).abs() < 1e-4);
        assert_eq!(pouch.at(0.6, 1.0), Vector3::zeros());
        assert!(pouch.at(0.5, 1.0 + std::f64::consts::PI).x < 1e-20);
    }
}
