//! The tables that `run`, `replay` and `reproduce` print.

use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use lumenav::evaluation::monte_carlo::bootstrap::MeanInterval;
use lumenav::evaluation::plausibility::SpeedFigures;
use lumenav::report::{
    ExpectOverTrials, ExpectVerdict, Metrics, MotionFigures, PairDistance, PeriodFigures, SensorMetrics,
    Timing, TrackMetrics, TrackRest, Trials,
};
use lumenav::reproduce;
use std::collections::BTreeMap;

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

/// Columns of a terminal that is not known (a pipe, a file).
const USUAL_COLUMNS: u16 = 80;

/// A table that fits the terminal: long cells are folded.
pub fn fitting(preset: &str) -> Table {
    let mut table = Table::new();
    table.load_preset(preset).set_content_arrangement(ContentArrangement::Dynamic);
    if table.width().is_none() {
        table.set_width(USUAL_COLUMNS);
    }
    table
}

/// A figure per row, a track per column: a few tracks fit any terminal, a dozen figures would not.
struct Figures {
    names: Vec<String>,
    rows: Vec<(&'static str, Vec<String>)>,
}

impl Figures {
    fn new(names: Vec<String>, labels: &[&'static str]) -> Self {
        Self { names, rows: labels.iter().map(|label| (*label, Vec::new())).collect() }
    }

    /// The figures of the next track, in the order of the labels.
    fn add<const N: usize>(&mut self, figures: [String; N]) {
        debug_assert_eq!(N, self.rows.len(), "a figure for each label");
        for ((_, row), figure) in self.rows.iter_mut().zip(figures) {
            row.push(figure);
        }
    }

    fn table(self) -> String {
        let mut table = fitting(presets::UTF8_HORIZONTAL_ONLY);
        table.set_header(std::iter::once("track".to_owned()).chain(self.names));
        for (label, row) in self.rows {
            table.add_row(std::iter::once(label.to_owned()).chain(row));
        }
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        table.to_string()
    }
}

/// Below this availability a verdict says of how much of the time it speaks.
const RARELY: f64 = 0.9;

/// A track that is lost is consistent wherever it still says something.
fn limits_of(availability: Option<f64>) -> String {
    let rarely = availability.filter(|a| *a < RARELY);
    rarely.map_or_else(String::new, |a| {
        format!(" (of the {:.0} % of the time for which it has an estimate)", 100.0 * a)
    })
}

/// A column per track: position error, heading, availability, NEES; then the verdicts.
pub fn of_run(metrics: &Metrics, timing: Option<&Timing>) -> String {
    let mut figures = Figures::new(
        metrics.tracks.keys().cloned().collect(),
        &[
            "mean mm",
            "median mm",
            "p95 mm",
            "max mm",
            "heading deg",
            "available",
            "NEES/dof",
            "rmse/bound",
            "updates",
            "us/update",
        ],
    );
    for (name, t) in &metrics.tracks {
        let p = t.position_error_mm.as_ref();
        let per_update =
            timing.and_then(|all| all.tracks.get(name)).and_then(|x| x.update_ms).map(|s| 1e3 * s.mean);
        figures.add([
            number(p.map(|s| s.mean), 3),
            number(p.map(|s| s.median), 3),
            number(p.map(|s| s.p95), 3),
            number(p.map(|s| s.max), 3),
            number(t.heading_error_deg.as_ref().map(|s| s.mean), 3),
            t.availability.map_or_else(|| "-".to_owned(), |a| format!("{:.1} %", 100.0 * a)),
            number(t.nees.as_ref().map(|n| n.mean / n.dof as f64), 2),
            number(t.rmse_over_bound, 3),
            t.updates.to_string(),
            number(per_update, 1),
        ]);
    }
    let mut text = figures.table();
    for (name, t) in &metrics.tracks {
        if let Some(verdict) = &t.verdict {
            text = format!("{text}\n{name}: {verdict}{}", limits_of(t.availability));
        }
        if t.unjudged > 0 {
            let all = t.judged + t.unjudged;
            let hint = if t.judged == 0 { ": do their times agree?" } else { "" };
            text = format!(
                "{text}\n{name}: {} of {all} estimates have a truth at their instant; of the others nothing is said above{hint}",
                t.judged
            );
        }
        if let Some(line) = refusals(t) {
            text = format!("{text}\n{name}: {line}");
        }
    }
    for (name, sensor) in &metrics.sensors {
        if let Some(line) = delivered(sensor) {
            text = format!("{text}\n{name}: {line}");
        }
    }
    for (name, track) in &metrics.tracks {
        for (period, figures) in &track.periods {
            text = format!("{text}\n{name}, {period}: {}", of_period(figures));
        }
    }
    for (name, moved) in &metrics.controllers {
        let [low_mm, high_mm] = moved.range_z_mm;
        text = format!(
            "{text}\n{name}: moved its sensor by {:.0} mm in all, from {low_mm:.0} to {high_mm:.0} mm along z",
            moved.travel_mm
        );
    }
    if let Some(motion) = &metrics.motion {
        text = format!("{text}\n{}", of_segments(motion, &metrics.tracks));
    }
    for line in expectations(metrics) {
        text = format!("{text}\n{line}");
    }
    text
}

/// What a sensor delivered, where that is not simply all of its readings.
fn delivered(sensor: &SensorMetrics) -> Option<String> {
    let mut parts = vec![format!("{} readings", sensor.readings)];
    if sensor.events > 0 {
        let each = sensor.events as f64 / sensor.readings.max(1) as f64;
        parts.push(format!("{each:.1} events in each in the mean"));
    }
    if sensor.missing > 0 {
        parts.push(format!("{} missing or not to be read (events.jsonl says which)", sensor.missing));
    }
    (parts.len() > 1).then(|| parts.join(", "))
}

/// A time in the unit in which it has two or three digits.
fn time(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.2} h", s / 3600.0),
    }
}

/// A segment per row: how long and how fast the capsule went through it, and what each track knew of it there.
fn of_segments(motion: &MotionFigures, tracks: &BTreeMap<String, TrackMetrics>) -> String {
    let mut table = fitting(presets::UTF8_HORIZONTAL_ONLY);
    let head = ["segment", "time", "way mm", "p95 mm/s", "in bursts"].map(str::to_owned);
    table.set_header(head.into_iter().chain(tracks.keys().map(|name| format!("{name} mean (p95) mm"))));
    for segment in &motion.segments {
        let more = if segment.is_transit { "" } else { "*" };
        let cells = [
            segment.segment.clone(),
            format!("{}{more}", time(segment.time_s)),
            number(Some(segment.way_mm), 0),
            number(segment.speed_mm_s.map(|s| s.p95), 2),
            segment.burst_share.map_or_else(|| "-".to_owned(), |share| format!("{:.0} %", 100.0 * share)),
        ];
        let errors = tracks.values().map(|track| {
            let found = track.segments.iter().find(|one| one.segment == segment.segment);
            let error = found.and_then(|one| one.position_error_mm);
            error.map_or_else(|| "-".to_owned(), |e| format!("{:.2} ({:.2})", e.mean, e.p95))
        });
        table.add_row(cells.into_iter().chain(errors));
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    let left = motion.left_s.map_or_else(String::new, |left_s| {
        format!("\nthe capsule left the tract at {}: errors from then on are those of a capsule at rest at its end", time(left_s))
    });
    format!(
        "{table}\nin bursts: part of the way that the fastest twentieth of the time makes; *: no transit time, the run began or ended there{left}"
    )
}

/// The errors of a stretch of the run, in words.
fn of_period(period: &PeriodFigures) -> String {
    let when = format!("{} to {} s", period.from_s, period.to_s);
    let available = period.availability.map_or(f64::NAN, |share| 100.0 * share);
    match &period.position_error_mm {
        Some(error) => format!(
            "{when}: mean {:.3}, p95 {:.3}, max {:.3} mm, available {available:.1} %",
            error.mean, error.p95, error.max
        ),
        None => format!("{when}: no estimate"),
    }
}

/// What the scenario expects of the motion, in words.
fn expectations(metrics: &Metrics) -> Vec<String> {
    let expected = &metrics.expected;
    let speed = |(name, s): (&String, &SpeedFigures)| {
        format!(
            "{name}: {:.1} % of {} steps within {} m/s (median {:.3}, p95 {:.3}, fastest {:.3} m/s)",
            100.0 * s.share_within,
            s.steps,
            s.limit_m_s,
            s.speed_m_s.median,
            s.speed_m_s.p95,
            s.speed_m_s.max
        )
    };
    let distance = |pair: &PairDistance| {
        let [a, b] = &pair.tracks;
        pair.figures.map_or_else(
            || format!("distance {a} - {b}: no instant with an estimate of both"),
            |d| {
                format!(
                    "distance {a} - {b}: {:.2} mm (median {:.2}, robust sd {:.2}; {} of {} instants outliers; mean of all {:.2})",
                    d.mean_without_outliers_mm, d.median_mm, d.robust_sd_mm, d.outliers, d.instants, d.mean_mm
                )
            },
        )
    };
    let rest = |rest: &TrackRest| {
        rest.figures.map_or_else(
            || format!("rest of {}: no estimate", rest.track),
            |r| {
                let [x, y, z] = r.median_mm;
                let [sx, sy, sz] = r.robust_sd_mm;
                format!(
                    "rest of {}: at {x:.2}, {y:.2}, {z:.2} mm (robust sd {sx:.2}, {sy:.2}, {sz:.2}; {} of {} instants outliers, farthest {:.2} mm)",
                    rest.track, r.outliers, r.instants, r.farthest_mm
                )
            },
        )
    };
    let mut lines: Vec<String> = expected.speed.iter().map(speed).collect();
    lines.extend(expected.distance.iter().map(distance));
    lines.extend(expected.rest.iter().map(rest));
    lines.extend(expected.verdicts.iter().map(verdict));
    lines
}

/// So many trials that are not as expected are named.
const MOST_NAMED: usize = 8;

/// Four digits behind the point at most.
fn short(v: f64) -> String {
    format!("{v:.4}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// What a figure may be, in words.
fn allowed(ends: [Option<f64>; 2]) -> String {
    match ends.map(|end| end.map(short)) {
        [Some(least), Some(most)] => format!("{least} to {most}"),
        [Some(least), None] => format!("{least} or more"),
        [None, Some(most)] => format!("{most} or less"),
        [None, None] => "any".to_owned(),
    }
}

/// What was asked of all trials and what came, in words.
pub fn verdict_over_trials(over: &ExpectOverTrials) -> String {
    let met = if over.unmet.is_empty() { "as expected" } else { "NOT AS EXPECTED" };
    let figures = over.range.map_or_else(
        || "nothing to tell it from".to_owned(),
        |[least, most]| format!("{} to {}", short(least), short(most)),
    );
    let count = over.trials - over.unmet.len() as u64;
    let which = if over.unmet.is_empty() {
        String::new()
    } else {
        let first: Vec<String> = over.unmet.iter().take(MOST_NAMED).map(u64::to_string).collect();
        let more = if over.unmet.len() > MOST_NAMED { ", …" } else { "" };
        format!("; not in trial {}{more}", first.join(", "))
    };
    format!(
        "{met} in {count} of {} trials: {}: {figures} (expected: {}){which}",
        over.trials,
        over.quantity,
        allowed(over.allowed)
    )
}

/// What was asked and what came, in words.
pub fn verdict(verdict: &ExpectVerdict) -> String {
    let figure = verdict.figure.map_or_else(|| "nothing to tell it from".to_owned(), short);
    let met = if verdict.met { "as expected" } else { "NOT AS EXPECTED" };
    format!("{met}: {}: {figure} (expected: {})", verdict.quantity, allowed(verdict.allowed))
}

/// Refusals in words; `None` where there were none.
fn refusals(track: &TrackMetrics) -> Option<String> {
    if track.refused.is_empty() {
        return None;
    }
    let all: Vec<String> = track.refused.iter().map(|(why, count)| format!("{count} {why}")).collect();
    Some(format!("refused: {}", all.join(", ")))
}

/// Means over trials with 95 % intervals, then the comparisons in words.
pub fn of_trials(trials: &Trials) -> String {
    let mut figures = Figures::new(
        trials.tracks.keys().cloned().collect(),
        &[
            "trials",
            "mean mm (95 %)",
            "rmse mm (95 %)",
            "worst mm",
            "available (worst)",
            "NEES/dof",
            "steps in band",
            "in 90 % region",
        ],
    );
    let with_interval = |m: &Option<MeanInterval>| {
        m.as_ref()
            .map_or_else(|| "-".to_owned(), |m| format!("{:.3} ({:.3} to {:.3})", m.mean, m.lower, m.upper))
    };
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let dash = || "-".to_owned();
    for t in trials.tracks.values() {
        let across = t.nees.as_ref().map(|n| &n.across);
        figures.add([
            t.trials.to_string(),
            with_interval(&t.mean_error_mm),
            with_interval(&t.rmse_mm),
            number(t.worst_mm, 3),
            t.availability.map_or_else(dash, |a| format!("{} ({})", percent(a.mean), percent(a.worst))),
            number(across.map(|a| a.mean_per_dof), 2),
            across.map_or_else(dash, |a| percent(a.share_inside_95)),
            across.map_or_else(dash, |a| percent(a.coverage_90)),
        ]);
    }
    let mut text = figures.table();
    for over in &trials.expected {
        text = format!("{text}\n{}", verdict_over_trials(over));
    }
    for (name, t) in &trials.tracks {
        if let Some(verdict) = &t.verdict {
            text = format!("{text}\n{name}: {verdict}{}", limits_of(t.availability.map(|a| a.mean)));
        }
    }
    for (name, track) in &trials.tracks {
        for (period, t) in &track.periods {
            text = format!(
                "{text}\n{name}, {period}: mean {} mm, p95 {} mm (worst trial {}), worst {} mm, available {}",
                with_interval(&t.mean_error_mm),
                with_interval(&t.p95_mm),
                number(t.worst_p95_mm, 3),
                number(t.worst_mm, 3),
                t.availability.map_or_else(dash, |a| format!("{} ({})", percent(a.mean), percent(a.worst))),
            );
        }
    }
    for pair in &trials.comparisons {
        text = format!("{text}\n{}", pair.sentence);
    }
    text
}

/// A reproduction: settings, a row per published number, the reasons, the notes.
pub fn of_reproduction(reproduced: &reproduce::Table) -> String {
    let head = reproduced.head();
    let mut table = fitting(presets::UTF8_HORIZONTAL_ONLY);
    let text_columns = [0, 1, head.len() - 2, head.len() - 1];
    table.set_header(head);
    for cells in reproduced.cells() {
        table.add_row(cells);
    }
    for (index, column) in table.column_iter_mut().enumerate() {
        if !text_columns.contains(&index) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    let mut text = format!("{} ({})", reproduced.id, reproduced.source);
    for (name, value) in &reproduced.settings {
        text = format!("{text}\n  {name}: {value}");
    }
    text = format!("{text}\n{table}\n{}", reproduced.tally());
    for row in reproduced.rows.iter().filter(|row| !row.why.is_empty()) {
        text = format!("{text}\n{}: {}: {}", row.verdict, row.quantity, row.why);
    }
    for note in &reproduced.notes {
        text = format!("{text}\nnote: {note}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_tables_fit_eighty_columns_where_the_terminal_is_unknown() {
        let names = ["magnetic", "magnetic-eskf", "a-track-with-a-long-name"].map(str::to_owned);
        let mut figures = Figures::new(names.to_vec(), &["mean mm (95 %)", "available (worst)"]);
        for _ in &names {
            figures.add(["0.281 (0.279 to 0.283)".to_owned(), "100.0 % (99.9 %)".to_owned()]);
        }
        let table = figures.table();
        assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
        let mut list = fitting(presets::NOTHING);
        let sentence = "a long sentence ".repeat(20);
        list.add_row(["tracts/colon", sentence.as_str()]);
        assert!(list.to_string().lines().all(|line| line.chars().count() <= 80), "{list}");
    }
}
