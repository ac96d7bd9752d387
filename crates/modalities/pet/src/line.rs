//! A line of response as everything in this crate hands it on.

use nalgebra::{UnitVector3, Vector3};
use serde::{Deserialize, Serialize};

/// One coincidence: when, and where its two photons were detected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Seconds since the scenario's start.
    pub t_s: f64,
    /// Where the two photons were detected, world, m: centres of the crystals that fired, or the places themselves where the
    /// detector tells them.
    pub ends_world_m: [Vector3<f64>; 2],
}

/// Ends nearer to each other than this make no line: a tenth of the smallest crystal there is (0.5 mm).
pub const SHORTEST_LINE_M: f64 = 5e-5;

impl Line {
    /// Unit vector from the first end to the second; `None` where the ends are one place or not finite.
    pub fn direction(&self) -> Option<UnitVector3<f64>> {
        let along = self.ends_world_m[1] - self.ends_world_m[0];
        UnitVector3::try_new(along, SHORTEST_LINE_M).filter(|n| n.iter().all(|v| v.is_finite()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_line_of_length_zero_has_no_direction() {
        let at = |x: f64| Vector3::new(x, 0.1, 0.0);
        let line = |b: f64| Line { t_s: 0.0, ends_world_m: [at(0.0), at(b)] };
        assert!(line(0.0).direction().is_none());
        assert!(line(1e-6).direction().is_none());
        assert!(line(f64::NAN).direction().is_none());
        assert!(line(f64::INFINITY).direction().is_none());
        assert_eq!(line(0.5).direction().map(nalgebra::Unit::into_inner), Some(Vector3::x()));
    }
}
