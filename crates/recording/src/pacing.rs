//! How much of a run is kept: the rule that holds a recording within its size.
//!
//! After a row of `b` bytes a stream rests for
//!
//! ```text
//! rest = max(0.1 s, b T / B)
//! ```
//!
//! with `T` the length of the run and `B` the stream's share of the size budget. A stream therefore keeps at most 10 rows
//! a second and at most `B` bytes (plus one row) over the run, spread evenly. `B` is the budget of the stream's class over
//! the number of streams of that class:
//!
//! | class | T <= 10 min | longer |
//! |---|---|---|
//! | poses, paths, plots | 6 MB | 18 MB |
//! | scenes, readings, images | 10 MB | 30 MB |
//!
//! Bytes are counted before compression, so a file is smaller than the sum. In a replay `T` is unknown: `T = max(60 s, 2 t)`
//! is used with a fifth of `B`, where `t` is the time so far: up to 8 h the sum then stays near
//! `B/5 (1/2 + ln(8 h / 30 s) / 2) = 0.8 B`. With `full` nothing rests.

/// Poses and plots are kept at most this often.
pub(crate) const SHORTEST_REST_S: f64 = 0.1;
/// Below this a run is short, and the recording is to be below 20 MB.
const SHORT_RUN_S: f64 = 600.0;

/// What a stream is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// Poses, paths and plots.
    Track,
    /// What sensors and front ends draw.
    Scene,
}

/// The rule for one run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    /// Keep everything.
    pub(crate) full: bool,
    /// Length of the run, s.
    pub(crate) duration_s: Option<f64>,
}

impl Pace {
    /// Bytes that all streams of a class may use.
    fn class_budget_bytes(&self, class: Class) -> f64 {
        let long = self.duration_s.is_none_or(|duration| duration > SHORT_RUN_S);
        match (class, long) {
            (Class::Track, false) => 6e6,
            (Class::Scene, false) => 10e6,
            (Class::Track, true) => 18e6,
            (Class::Scene, true) => 30e6,
        }
    }

    /// How long a stream rests after a row, s.
    pub(crate) fn rest_s(&self, class: Class, streams: usize, row_bytes: usize, elapsed_s: f64) -> f64 {
        if self.full {
            return 0.0;
        }
        let share = self.class_budget_bytes(class) / streams.max(1) as f64;
        let (length, share) = match self.duration_s {
            Some(duration) => (duration, share),
            None => (f64::max(60.0, 2.0 * elapsed_s), share / 5.0),
        };
        f64::max(SHORTEST_REST_S, row_bytes as f64 * length / share)
    }
}

/// When a stream may keep its next row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gate {
    next_s: f64,
}

impl Gate {
    /// Open.
    pub(crate) fn new() -> Self {
        Self { next_s: f64::NEG_INFINITY }
    }

    /// Whether a row at this time is kept. Half a nanosecond of slack, so that a 10 Hz stream keeps every row.
    pub(crate) fn is_open(self, at_s: f64) -> bool {
        at_s >= self.next_s - 0.5e-9
    }

    /// Closes for a while after a row that was kept.
    pub(crate) fn close(&mut self, at_s: f64, rest_s: f64) {
        self.next_s = at_s + rest_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that one stream keeps, offered at a rate.
    fn kept_bytes(pace: Pace, class: Class, streams: usize, row: usize, rate_hz: f64, until_s: f64) -> f64 {
        let mut gate = Gate::new();
        let mut bytes = 0.0;
        for i in 0..(until_s * rate_hz) as usize {
            let at = i as f64 / rate_hz;
            if gate.is_open(at) {
                bytes += row as f64;
                gate.close(at, pace.rest_s(class, streams, row, at));
            }
        }
        bytes
    }

    #[test]
    fn closed_form_a_short_pose_stream_is_kept_at_10_hz() {
        let pace = Pace { full: false, duration_s: Some(60.0) };
        assert_eq!(kept_bytes(pace, Class::Track, 20, 100, 100.0, 60.0), 600.0 * 100.0);
        assert_eq!(kept_bytes(pace, Class::Track, 20, 100, 10.0, 60.0), 600.0 * 100.0);
    }

    #[test]
    fn law_an_exam_of_eight_hours_stays_within_the_budget() {
        for duration_s in [Some(28_800.0), None] {
            let pace = Pace { full: false, duration_s };
            for (class, budget) in [(Class::Track, 18e6), (Class::Scene, 30e6)] {
                for row in [100, 5_000, 20_000] {
                    let all = 12.0 * kept_bytes(pace, class, 12, row, 20.0, 28_800.0);
                    assert!(all <= budget * 1.02, "{duration_s:?} {class:?} {row}: {all}");
                }
            }
        }
    }

    #[test]
    fn closed_form_full_keeps_everything() {
        let pace = Pace { full: true, duration_s: Some(60.0) };
        assert_eq!(kept_bytes(pace, Class::Scene, 1, 1_000_000, 100.0, 60.0), 6e9);
    }
}
