//! When a sensor reads and when its reading arrives: the `[sensor.schedule]` table, the same for every modality.

use crate::config::quantity::{Fraction, NonNegative, Positive};
use crate::time::{SimTime, nanoseconds};
use serde::{Deserialize, Serialize};

/// Rate, offset, latency and random losses of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Readings per second.
    pub rate_hz: Positive,
    /// Time of the first reading, s.
    #[serde(default)]
    pub start_s: NonNegative,
    /// Delay between the end of a reading's interval and its arrival at the estimator, ms.
    #[serde(default)]
    pub latency_ms: NonNegative,
    /// Share of readings that are lost on the way, each independently.
    #[serde(default)]
    pub loss: Fraction,
}

impl Schedule {
    /// The instant of the reading with this sequence number.
    pub fn due(&self, sequence: u64) -> SimTime {
        // From the sequence and not by summing periods: no drift over eight hours.
        SimTime(nanoseconds(self.start_s.0) + (sequence as f64 * 1e9 / self.rate_hz.0).round() as i64)
    }

    /// When a reading whose interval ends at `end` arrives.
    pub fn arrival(&self, end: SimTime) -> SimTime {
        end + nanoseconds(self.latency_ms.0 * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_a_rate_of_three_hertz_does_not_drift() {
        let schedule = Schedule {
            rate_hz: Positive(3.0),
            start_s: NonNegative(0.5),
            latency_ms: NonNegative(20.0),
            loss: Fraction(0.0),
        };
        assert_eq!(schedule.due(0), SimTime(500_000_000));
        assert_eq!(schedule.due(3 * 28_800), SimTime(28_800_500_000_000));
        assert_eq!(schedule.arrival(SimTime(5)), SimTime(20_000_005));
    }
}
