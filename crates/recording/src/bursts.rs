//! Events of one kind that come in bursts: the first is told, the rest is counted.
//!
//! A burst ends when two seconds have passed without another of its kind; then one line tells how many there were and
//! what the last one was. Memory: one entry per kind (track, sensor and reason), whatever the length of the run.

use lumenav_core::SimTime;
use std::collections::BTreeMap;

/// Silence that ends a burst, ns.
const SILENCE_NS: i64 = 2_000_000_000;

/// A line for the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Line {
    /// Its time.
    pub(crate) at: SimTime,
    /// Its text.
    pub(crate) text: String,
}

/// A burst that has not ended.
#[derive(Debug)]
struct Burst {
    first: SimTime,
    last: SimTime,
    count: u64,
    last_text: String,
}

/// The bursts that have not ended, by kind.
#[derive(Debug, Default)]
pub(crate) struct Bursts {
    open: BTreeMap<String, Burst>,
}

impl Bursts {
    /// An event; the line to tell at once if it is the first of its burst.
    pub(crate) fn push(&mut self, kind: &str, at: SimTime, text: String) -> Option<Line> {
        if let Some(burst) = self.open.get_mut(kind) {
            burst.last = burst.last.max(at);
            burst.count += 1;
            burst.last_text = text;
            return None;
        }
        let burst = Burst { first: at, last: at, count: 1, last_text: String::new() };
        self.open.insert(kind.to_owned(), burst);
        Some(Line { at, text })
    }

    /// Lines of the bursts that have ended by now.
    pub(crate) fn ended(&mut self, now: SimTime) -> Vec<Line> {
        let mut lines = Vec::new();
        self.open.retain(|kind, burst| {
            let open = now - burst.last < SILENCE_NS;
            if !open {
                lines.extend(burst.closing_line(kind));
            }
            open
        });
        lines.sort_by_key(|line| line.at);
        lines
    }

    /// Lines of all bursts, at the end of the run.
    pub(crate) fn all(&mut self) -> Vec<Line> {
        let mut lines: Vec<Line> =
            std::mem::take(&mut self.open).iter().filter_map(|(kind, b)| b.closing_line(kind)).collect();
        lines.sort_by_key(|line| line.at);
        lines
    }
}

impl Burst {
    /// `None` where the first was the only one.
    fn closing_line(&self, kind: &str) -> Option<Line> {
        (self.count > 1).then(|| Line {
            at: self.last,
            text: format!(
                "{kind}: {} in all from {} to {}; the last: {}",
                self.count, self.first, self.last, self.last_text
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_a_burst_of_a_thousand_makes_two_lines() {
        let mut bursts = Bursts::default();
        let mut lines = Vec::new();
        for i in 0..1000 {
            let at = SimTime(i * 10_000_000);
            lines.extend(bursts.ended(at));
            lines.extend(bursts.push("gate", at, format!("refusal {i}")));
        }
        lines.extend(bursts.ended(SimTime::from_seconds(11.98)));
        assert_eq!(lines.len(), 1);
        lines.extend(bursts.ended(SimTime::from_seconds(12.0)));
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0], Line { at: SimTime(0), text: "refusal 0".into() });
        assert_eq!(lines[1].at, SimTime::from_seconds(9.99));
        assert_eq!(lines[1].text, "gate: 1000 in all from 0.000 s to 9.990 s; the last: refusal 999");
        assert!(bursts.all().is_empty());
    }

    #[test]
    fn closed_form_two_kinds_do_not_hide_each_other() {
        let mut bursts = Bursts::default();
        assert!(bursts.push("a", SimTime(0), "x".into()).is_some());
        assert!(bursts.push("b", SimTime(0), "y".into()).is_some());
        assert!(bursts.push("a", SimTime(1), "z".into()).is_none());
        let lines = bursts.all();
        assert_eq!(lines.len(), 1);
        assert!(lines[0].text.starts_with("a: 2 in all"));
    }
}
