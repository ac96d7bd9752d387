//! Where a scanner stands along its axis while a bed moves the patient through it.

use lumenav_core::SimTime;

/// Place along z over time: straight between commands.
#[derive(Clone, Debug)]
pub(crate) struct Rail {
    /// From when on, the place then, m, and the speed, m/s; in the order of time, never empty.
    legs: Vec<(SimTime, f64, f64)>,
}

impl Rail {
    /// Standing at the origin.
    pub(crate) fn resting() -> Self {
        Self { legs: vec![(SimTime(i64::MIN), 0.0, 0.0)] }
    }

    /// Moves with a speed from an instant on; legs that ended before `keep_from` are forgotten.
    pub(crate) fn set(&mut self, at: SimTime, speed_m_s: f64, keep_from: SimTime) {
        let z_m = self.z_m(at.seconds());
        self.legs.push((at, z_m, speed_m_s));
        let first = self.legs.partition_point(|(from, ..)| *from <= keep_from).saturating_sub(1);
        self.legs.drain(..first);
    }

    /// Place at a time, m.
    pub(crate) fn z_m(&self, at_s: f64) -> f64 {
        let begun = self.legs.partition_point(|(from, ..)| from.seconds() <= at_s).max(1);
        let (from, z_m, speed_m_s) = self.legs[begun - 1];
        if speed_m_s == 0.0 { z_m } else { z_m + speed_m_s * (at_s - from.seconds()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_places_of_two_legs() {
        let mut rail = Rail::resting();
        assert_eq!(rail.z_m(7.0), 0.0);
        rail.set(SimTime::from_seconds(1.0), 0.02, SimTime::ZERO);
        rail.set(SimTime::from_seconds(3.0), -0.01, SimTime::ZERO);
        for (at_s, expected) in [(0.5, 0.0), (1.0, 0.0), (2.0, 0.02), (3.0, 0.04), (5.0, 0.02)] {
            assert!((rail.z_m(at_s) - expected).abs() < 1e-12, "{at_s}: {}", rail.z_m(at_s));
        }
        rail.set(SimTime::from_seconds(9.0), 0.0, SimTime::from_seconds(8.0));
        assert_eq!(rail.legs.len(), 2);
        assert!((rail.z_m(8.5) + 0.015).abs() < 1e-12 && (rail.z_m(1e3) + 0.02).abs() < 1e-12);
    }
}
