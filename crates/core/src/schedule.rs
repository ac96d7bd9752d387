//! When a sensor reads and when its reading arrives: the `[sensor.schedule]` table, the same for every modality.
//!
//! Allowed are rates of 1e-6 to 1e6 Hz (a reading in eleven days to one in a microsecond), a first reading up to 1e9 s (thirty
//! years) and a latency up to 1e9 ms (eleven days): whatever lies outside is a slip of units. Times saturate at the end of
//! [`SimTime`] (292 years) instead of wrapping round.

use crate::config::quantity::{Fraction, NonNegative, Positive};
use crate::time::{SimTime, nanoseconds};
use serde::{Deserialize, Deserializer, Serialize, de};

/// Rate, offset, latency and random losses of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Readings per second, 1e-6 to 1e6.
    #[serde(deserialize_with = "rate")]
    pub rate_hz: Positive,
    /// Time of the first reading, s, at most 1e9.
    #[serde(default, deserialize_with = "start")]
    pub start_s: NonNegative,
    /// Delay between the end of a reading's interval and its arrival at the estimator, ms, at most 1e9.
    #[serde(default, deserialize_with = "latency")]
    pub latency_ms: NonNegative,
    /// Share of readings that are lost on the way, each independently.
    #[serde(default)]
    pub loss: Fraction,
}

impl Schedule {
    /// The instant of the reading with this sequence number.
    pub fn due(&self, sequence: u64) -> SimTime {
        // From the sequence and not by summing periods: no drift over eight hours. The conversion to i64 saturates, too.
        let since_start_ns = (sequence as f64 * 1e9 / self.rate_hz.0).round() as i64;
        SimTime(nanoseconds(self.start_s.0)) + since_start_ns
    }

    /// The sequence number of the first reading that is due at `at` or later.
    pub fn first_from(&self, at: SimTime) -> u64 {
        // Rounded to nanoseconds an instant may lie to either side of its neighbour's: the nearest whole number, put right.
        let since_start_s = at.since_s(SimTime(nanoseconds(self.start_s.0)));
        let mut sequence = (since_start_s * self.rate_hz.0).round().max(0.0) as u64;
        while sequence > 0 && self.due(sequence - 1) >= at {
            sequence -= 1;
        }
        while self.due(sequence) < at {
            sequence += 1;
        }
        sequence
    }

    /// When a reading whose interval ends at `end` arrives.
    pub fn arrival(&self, end: SimTime) -> SimTime {
        end + nanoseconds(self.latency_ms.0 * 1e-3)
    }
}

fn within(value: f64, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(format!("{value} is not allowed here; it must be from {low:e} to {high:e} {unit}"))
    }
}

fn rate<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Positive, D::Error> {
    let rate = Positive::deserialize(deserializer)?;
    within(rate.0, 1e-6, 1e6, "Hz").map(Positive).map_err(de::Error::custom)
}

fn start<'de, D: Deserializer<'de>>(deserializer: D) -> Result<NonNegative, D::Error> {
    let start = NonNegative::deserialize(deserializer)?;
    within(start.0, 0.0, 1e9, "s").map(NonNegative).map_err(de::Error::custom)
}

fn latency<'de, D: Deserializer<'de>>(deserializer: D) -> Result<NonNegative, D::Error> {
    let latency = NonNegative::deserialize(deserializer)?;
    within(latency.0, 0.0, 1e9, "ms").map(NonNegative).map_err(de::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Node;
    use std::path::Path;

    fn read(text: &str) -> Result<Schedule, String> {
        let node = Node::parse_text(text, "s.toml", Path::new(""), &[]).unwrap();
        node.parse().map_err(|error| error.to_string())
    }

    #[test]
    fn law_rates_and_times_outside_their_range_are_refused_at_their_line() {
        for (text, said) in [
            (
                "rate_hz = 1e-12",
                "s.toml:1:11: `rate_hz`: 0.000000000001 is not allowed here; it must be from 1e-6 to 1e6 Hz",
            ),
            ("rate_hz = 2e6", "s.toml:1:11: `rate_hz`"),
            (
                "rate_hz = 1\nstart_s = 2e9",
                "s.toml:2:11: `start_s`: 2000000000 is not allowed here; it must be from 0e0 to 1e9 s",
            ),
            ("rate_hz = 1\nlatency_ms = 1e10", "s.toml:2:14: `latency_ms`"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
        let slowest = read("rate_hz = 1e-6\nstart_s = 1e9\nlatency_ms = 1e9\nloss = 1").unwrap();
        assert_eq!(slowest.due(0), SimTime(1_000_000_000_000_000_000));
    }

    #[test]
    fn regress_times_saturate_instead_of_wrapping() {
        // A table made by hand passes no reader: it still must neither panic nor come round to negative times.
        let schedule = Schedule {
            rate_hz: Positive(1e-12),
            start_s: NonNegative(1.0),
            latency_ms: NonNegative(f64::MAX),
            loss: Fraction(0.0),
        };
        assert_eq!(schedule.due(1), SimTime(i64::MAX));
        assert_eq!(schedule.arrival(schedule.due(u64::MAX)), SimTime(i64::MAX));
    }

    #[test]
    fn law_the_first_reading_from_an_instant_is_the_first_that_is_due_there() {
        for (rate_hz, start_s) in [(3.0, 0.5), (20.0, 0.0), (7.0, 0.1), (1e-3, 0.0), (1e6, 2.0)] {
            let schedule = Schedule {
                rate_hz: Positive(rate_hz),
                start_s: NonNegative(start_s),
                latency_ms: NonNegative(0.0),
                loss: Fraction(0.0),
            };
            for at_s in [0.0, 0.5, 1.0, 7.0 / 3.0, 1234.567, 28_800.0] {
                let at = SimTime::from_seconds(at_s);
                let first = schedule.first_from(at);
                assert!(schedule.due(first) >= at, "{rate_hz} {at_s}");
                assert!(first == 0 || schedule.due(first - 1) < at, "{rate_hz} {at_s}");
            }
            for sequence in [0, 1, 17, 100_003] {
                assert_eq!(schedule.first_from(schedule.due(sequence)), sequence, "{rate_hz}");
            }
        }
    }

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
