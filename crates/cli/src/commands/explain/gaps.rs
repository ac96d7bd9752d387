//! Stretches without updates: before the first, between two, after the last, or the whole run.

use super::seconds;
use super::words::{self, Weakness, count};
use lumenav::report::{Logged, LoggedEvent, TrackRow};
use serde::Serialize;
use std::collections::BTreeMap;

/// A gap is this many times the usual period, and at least [`MIN_GAP_S`].
const GAP_PERIODS: f64 = 5.0;
/// Shorter silences are no gap.
const MIN_GAP_S: f64 = 0.5;

/// From when to when there could have been updates.
#[derive(Clone, Copy)]
pub struct Span {
    pub from_s: f64,
    pub to_s: f64,
}

/// Where in the run a gap lies.
#[derive(Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// There is no update at all.
    WholeRun,
    /// Before the first update.
    BeforeFirst,
    /// Between two updates.
    Between,
    /// After the last update.
    AfterLast,
}

/// A stretch without updates.
#[derive(Serialize)]
pub struct Gap {
    pub place: Place,
    pub from_s: f64,
    pub to_s: f64,
    /// Reasons with their counts.
    pub reasons: BTreeMap<String, u64>,
    /// The last update before it.
    pub before: Option<Weakness>,
    /// The first update after it.
    pub after: Option<Weakness>,
}

/// The gaps of a track whose rows are in order of time; `sensors` are those it may use.
pub fn gaps(
    track: &str,
    rows: &[&TrackRow],
    events: &[LoggedEvent],
    sensors: &[String],
    span: Span,
) -> Vec<Gap> {
    let weakness = |row: Option<&&TrackRow>| row.and_then(|row| Weakness::of(row));
    let gap =
        |place: Place, from_s: f64, to_s: f64, before: Option<&&TrackRow>, after: Option<&&TrackRow>| Gap {
            place,
            from_s,
            to_s,
            reasons: reasons(track, events, sensors, place, from_s, to_s),
            before: weakness(before),
            after: weakness(after),
        };
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return vec![gap(Place::WholeRun, span.from_s, span.to_s, None, None)];
    };
    let limit = limit_s(rows);
    let mut all = vec![gap(Place::BeforeFirst, span.from_s, seconds(first.t_ns), None, Some(first))];
    all.extend(
        rows.windows(2)
            .filter(|w| seconds(w[1].t_ns - w[0].t_ns) > limit)
            .map(|w| gap(Place::Between, seconds(w[0].t_ns), seconds(w[1].t_ns), Some(&w[0]), Some(&w[1]))),
    );
    all.push(gap(Place::AfterLast, seconds(last.t_ns), span.to_s, Some(last), None));
    all.retain(|gap| gap.to_s - gap.from_s > limit);
    all
}

/// Longer silences are gaps.
fn limit_s(rows: &[&TrackRow]) -> f64 {
    let mut steps: Vec<f64> = rows.windows(2).map(|w| seconds(w[1].t_ns - w[0].t_ns)).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map_or(MIN_GAP_S, |usual| (GAP_PERIODS * usual).max(MIN_GAP_S))
}

/// Why nothing came: readings of its own sensors that are missing, and its own refusals.
fn reasons(
    track: &str,
    events: &[LoggedEvent],
    sensors: &[String],
    place: Place,
    from_s: f64,
    to_s: f64,
) -> BTreeMap<String, u64> {
    // An update at the edge has used its reading; where there is no update the edge belongs to the gap.
    let open_start = matches!(place, Place::Between | Place::AfterLast);
    let open_end = matches!(place, Place::Between | Place::BeforeFirst);
    let mut why: BTreeMap<String, u64> = BTreeMap::new();
    for event in events {
        let t = seconds(event.t_ns);
        if t < from_s || t > to_s || (open_start && t <= from_s) || (open_end && t >= to_s) {
            continue;
        }
        match &event.what {
            Logged::Missing { sensor, text } if sensors.contains(sensor) => {
                *why.entry(missing(sensor, text)).or_default() += 1;
            }
            // Their burst says more of them.
            Logged::Refused { track: of, sensor, reason, .. } if of == track => {
                let said = words::refusal(reason);
                *why.entry(format!("of `{sensor}` refused {said}")).or_default() += 1;
            }
            _ => {}
        }
    }
    why
}

/// A missing reading in words; a fault's text names the sensor itself.
fn missing(sensor: &str, text: &str) -> String {
    let text = text.strip_prefix(&format!("sensor `{sensor}`: ")).unwrap_or(text);
    format!("of `{sensor}` missing ({text})")
}

impl Gap {
    /// Lines with the time they are sorted by.
    pub fn lines(&self) -> Vec<(f64, String)> {
        let length = self.to_s - self.from_s;
        let what = match self.place {
            Place::WholeRun => format!("no update at all in {length:.1} s"),
            Place::BeforeFirst => {
                format!("no update for {length:.1} s, from the start until {:.2} s", self.to_s)
            }
            Place::Between => format!("no update for {length:.1} s, until {:.2} s", self.to_s),
            Place::AfterLast => format!("no update for {length:.1} s, until the end"),
        };
        let reasons: Vec<String> =
            self.reasons.iter().map(|(why, n)| format!("{} {why}", count(*n, "reading"))).collect();
        let reasons = if reasons.is_empty() {
            "no reading of its sensors was missing or refused; none was due".to_owned()
        } else {
            reasons.join("; ")
        };
        let mut lines = vec![format!("{:8.2} s  {what}: {reasons}", self.from_s)];
        let before = self.before.as_ref().map(|w| format!("            weakest before: {}", w.text()));
        let after = self.after.as_ref().map(|w| format!("            weakest after:  {}", w.text()));
        lines.extend(before.into_iter().chain(after));
        lines.into_iter().map(|line| (self.from_s, line)).collect()
    }
}
