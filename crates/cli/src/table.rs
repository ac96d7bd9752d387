//! The tables that `run` and `replay` print.

use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use lumenav::core::RandomStreams;
use lumenav::evaluation::monte_carlo::bootstrap::{BootstrapSettings, mean_with_interval};
use lumenav::report::{Metrics, Timing, TrackMetrics};

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

/// Means over trials with 95 % intervals.
pub fn of_trials(all: &[Metrics]) -> String {
    let mut table = new_table(&[
        "track",
        "trials",
        "mean mm (95 %)",
        "rmse mm (95 %)",
        "worst mm",
        "NEES/dof",
        "available",
    ]);
    let Some(first) = all.first() else { return table.to_string() };
    for name in first.tracks.keys() {
        let tracks: Vec<&TrackMetrics> = all.iter().filter_map(|m| m.tracks.get(name)).collect();
        let values = |f: &dyn Fn(&TrackMetrics) -> Option<f64>| -> Vec<f64> {
            tracks.iter().filter_map(|t| f(t)).collect()
        };
        let mut random = RandomStreams::new(0, 0, "table").stream("bootstrap", 0);
        let mut with_interval =
            |values: &[f64]| match mean_with_interval(values, &BootstrapSettings::default(), &mut random) {
                Ok(m) => format!("{:.3} ({:.3} to {:.3})", m.mean, m.lower, m.upper),
                Err(_) => values.first().map_or_else(|| "-".to_owned(), |v| format!("{v:.3}")),
            };
        let mean =
            |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        let position = |f: fn(&lumenav::evaluation::summary::ScalarSummary) -> f64| {
            values(&|t| t.position_error_mm.as_ref().map(f))
        };
        table.add_row(vec![
            name.clone(),
            tracks.len().to_string(),
            with_interval(&position(|s| s.mean)),
            with_interval(&position(|s| s.rmse)),
            number(position(|s| s.max).into_iter().reduce(f64::max), 3),
            number(mean(values(&|t| t.nees.as_ref().map(|n| n.mean / n.dof as f64))), 2),
            number(mean(values(&|t| t.availability.map(|a| 100.0 * a))), 1) + " %",
        ]);
    }
    table.to_string()
}
