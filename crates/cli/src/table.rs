//! The tables that `run`, `replay` and `reproduce` print.

use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use lumenav::evaluation::monte_carlo::bootstrap::MeanInterval;
use lumenav::report::{Metrics, Timing, TrackMetrics, Trials};
use lumenav::reproduce;

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

fn new_table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY).set_content_arrangement(ContentArrangement::Dynamic);
    table.set_header(header);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// A row per track: position error, heading, availability, NEES, verdict.
pub fn of_run(metrics: &Metrics, timing: Option<&Timing>) -> String {
    let mut table = new_table(&[
        "track",
        "mean mm",
        "median",
        "p95",
        "max",
        "heading deg",
        "available",
        "NEES/dof",
        "rmse/bound",
        "updates",
        "us/update",
    ]);
    for (name, t) in &metrics.tracks {
        let p = t.position_error_mm.as_ref();
        let per_update =
            timing.and_then(|all| all.tracks.get(name)).and_then(|x| x.update_ms).map(|s| 1e3 * s.mean);
        table.add_row(vec![
            name.clone(),
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
    let mut text = table.to_string();
    for (name, t) in &metrics.tracks {
        if let Some(verdict) = &t.verdict {
            text = format!("{text}\n{name}: {verdict}");
        }
        if let Some(line) = refusals(t) {
            text = format!("{text}\n{name}: {line}");
        }
    }
    text
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
    let mut table = new_table(&[
        "track",
        "trials",
        "mean mm (95 %)",
        "rmse mm (95 %)",
        "worst mm",
        "available (worst)",
        "NEES/dof",
        "steps in band",
        "in 90 % region",
    ]);
    let with_interval = |m: &Option<MeanInterval>| {
        m.as_ref()
            .map_or_else(|| "-".to_owned(), |m| format!("{:.3} ({:.3} to {:.3})", m.mean, m.lower, m.upper))
    };
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let dash = || "-".to_owned();
    for (name, t) in &trials.tracks {
        let across = t.nees.as_ref().map(|n| &n.across);
        table.add_row(vec![
            name.clone(),
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
    let mut text = table.to_string();
    for (name, t) in &trials.tracks {
        if let Some(verdict) = &t.verdict {
            text = format!("{text}\n{name}: {verdict}");
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
    let mut table = new_table(&head.iter().map(String::as_str).collect::<Vec<_>>());
    for cells in reproduced.cells() {
        table.add_row(cells);
    }
    for left in [1, head.len() - 2, head.len() - 1] {
        if let Some(column) = table.column_mut(left) {
            column.set_cell_alignment(CellAlignment::Left);
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
