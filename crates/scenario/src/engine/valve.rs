//! The ileocaecal valve: two lips that let through what comes from the ileum and close before what would go back.
//!
//! A flap, not a muscle: once the whole capsule has passed, the valve is an end of the lumen behind it ([`super::wall`], as firm as a closed end of the tract).
//! Neglected: its tone, that it lets liquid back, and the force with which it has to be pushed open.

use super::wall::Cap;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;

/// The valve of a tract.
#[derive(Debug, Clone, Copy)]
pub(super) struct Valve {
    end: Cap,
    /// Whether the capsule has passed.
    pub(super) passed: bool,
}

impl Valve {
    /// `None` where no ileum opens into a caecum.
    pub(super) fn of(tract: &Tract) -> Option<Self> {
        let caecum = tract.segments.iter().position(|s| s.key == SegmentKey::Caecum).filter(|at| *at > 0)?;
        let station = tract.station(tract.segments[caecum].start_m);
        let end = Cap {
            position_m: station.position_m,
            outwards: -station.tangent,
            arc_length_m: station.arc_length_m,
        };
        Some(Self { end, passed: false })
    }

    /// The valve as an end of the lumen, where the capsule has passed it.
    pub(super) fn shut(&self) -> Option<Cap> {
        self.passed.then_some(self.end)
    }

    /// Closes behind a capsule that has passed; lets one go that is wholly back on the other side (put there, or pressed through). Between
    /// the two it stays as it was: in a wide caecum the projection onto a bent centre line wanders by a few millimetres.
    pub(super) fn look(&mut self, arc_length_m: f64, half_length_m: f64) {
        let beyond_m = arc_length_m - self.end.arc_length_m;
        self.passed = if self.passed { beyond_m > -half_length_m } else { beyond_m > half_length_m };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn law_it_shuts_behind_the_whole_capsule_and_opens_before_the_whole() {
        let end = Cap { position_m: Point3::origin(), outwards: -Vector3::z(), arc_length_m: 1.0 };
        let mut valve = Valve { end, passed: false };
        let mut shut = |beyond_mm: f64| {
            valve.look(1.0 + 1e-3 * beyond_mm, 0.013);
            valve.shut().is_some()
        };
        let places_mm = [-40.0, 0.0, 12.0, 14.0, 2.0, -12.0, 3.0, -14.0, 0.0, 12.0, 14.0];
        let expected = [false, false, false, true, true, true, true, false, false, false, true];
        assert_eq!(places_mm.map(&mut shut), expected);
    }
}
