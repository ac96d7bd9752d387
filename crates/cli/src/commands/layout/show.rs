//! Tables of layouts: a figure per row, a layout per column.

use super::{Judged, Setting};
use comfy_table::{CellAlignment, presets};
use lumenav::layouts::Posterior;

fn figure(value: Option<f64>) -> String {
    value.map_or_else(|| "infinite".to_owned(), |v| format!("{v:.3}"))
}

fn deaths(judged: &Judged, at: usize) -> String {
    judged.deaths.get(at).map_or_else(|| "-".to_owned(), |d| figure(d.rms_mm))
}

type OfPosterior = fn(&Posterior) -> f64;

/// What a filter can reach along a path.
const POSTERIOR: [(&str, OfPosterior); 3] = [
    ("with a filter, rms mm", |p| p.rms_mm),
    ("with a filter, p95 mm", |p| p.p95_mm),
    ("with a filter, worst mm", |p| p.worst_mm),
];

/// The table of some layouts.
pub(super) fn table(setting: &Setting, layouts: &[(String, &Judged)]) -> String {
    let mut table = crate::table::fitting(presets::UTF8_HORIZONTAL_ONLY);
    table.set_header(std::iter::once(String::new()).chain(layouts.iter().map(|(name, _)| name.clone())));
    let mut row = |name: &str, of: &dyn Fn(&Judged) -> String| {
        table.add_row(std::iter::once(name.to_owned()).chain(layouts.iter().map(|(_, judged)| of(judged))));
    };
    row("elements", &|j| j.summary.elements.to_string());
    row(&format!("cost, {}", setting.cost_unit), &|j| format!("{}", j.summary.cost));
    row("rms mm (A)", &|j| figure(j.summary.rms_mm));
    row("mean mm", &|j| figure(j.summary.mean_mm));
    row("median mm", &|j| figure(j.summary.median_mm));
    row("p95 mm", &|j| figure(j.summary.p95_mm));
    row("worst mm", &|j| figure(j.summary.worst_mm));
    row("worst along a line mm (E)", &|j| figure(j.summary.e_mm));
    row("mean log det (D)", &|j| figure(j.summary.mean_log_det));
    row("angle rms deg", &|j| figure(j.summary.angle_rms_deg));
    row("angle worst deg", &|j| figure(j.summary.angle_worst_deg));
    let wanted = layouts.first().map_or(1.0, |(_, j)| j.summary.wanted_mm);
    row(&format!("within {wanted} mm"), &|j| format!("{:.1} %", 100.0 * j.summary.share_below_wanted));
    row("poses without a bound", &|j| format!("{} of {}", j.summary.poses_without_bound, j.summary.poses));
    if layouts.iter().any(|(_, j)| j.summary.pairs_without_reading > 0) {
        row("saturated or in the magnet", &|j| {
            let of = j.summary.poses * j.summary.elements;
            format!("{} of {of}", j.summary.pairs_without_reading)
        });
    }
    let most = layouts.iter().map(|(_, j)| j.deaths.len()).max().unwrap_or(0);
    for at in 0..most {
        row(&format!("rms mm, worst {} dead", at + 1), &|j| deaths(j, at));
    }
    for (name, of) in POSTERIOR {
        if layouts.iter().any(|(_, judged)| judged.posterior.is_some()) {
            row(name, &|j| figure(j.posterior.as_ref().map(of)));
        }
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.to_string()
}

/// More layouts than this stand in rows.
const MOST_COLUMNS: usize = 4;

/// Several layouts side by side: a column each, or, where they are many, a row each with the figures that tell them apart.
pub(super) fn compared(setting: &Setting, layouts: &[(String, &Judged)]) -> String {
    if layouts.len() <= MOST_COLUMNS {
        return table(setting, layouts);
    }
    let mut table = crate::table::fitting(presets::UTF8_HORIZONTAL_ONLY);
    let has_deaths = layouts.iter().any(|(_, j)| !j.deaths.is_empty());
    let has_posterior = layouts.iter().any(|(_, j)| j.posterior.is_some());
    let wanted = layouts.first().map_or(1.0, |(_, j)| j.summary.wanted_mm);
    let mut head = vec!["layout".to_owned(), setting.cost_unit.clone()];
    head.extend(["rms mm", "p95 mm", "worst mm", "angle deg"].map(str::to_owned));
    head.push(format!("within {wanted} mm"));
    head.extend(has_deaths.then(|| "one dead mm".to_owned()));
    head.extend(has_posterior.then(|| "filtered mm".to_owned()));
    table.set_header(head);
    for (name, j) in layouts {
        let s = &j.summary;
        let mut row = vec![name.clone(), s.cost.to_string()];
        row.extend([s.rms_mm, s.p95_mm, s.worst_mm, s.angle_rms_deg].map(figure));
        row.push(format!("{:.1} %", 100.0 * s.share_below_wanted));
        row.extend(has_deaths.then(|| deaths(j, 0)));
        row.extend(has_posterior.then(|| figure(j.posterior.as_ref().map(|p| p.rms_mm))));
        table.add_row(row);
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.to_string()
}

/// What was judged, in a line or two.
pub(super) fn head(setting: &Setting) -> String {
    let unknown = if setting.unknown.is_empty() {
        "nothing else is unknown".to_owned()
    } else {
        format!("unknown beside them: {}", setting.unknown.join(", "))
    };
    let words: Vec<&str> =
        std::iter::once(unknown.as_str()).chain(setting.assumptions.iter().map(String::as_str)).collect();
    let words = words.join("; ");
    format!(
        "bound of one reading of `{}` ({}) over {} positions x {} directions; {words}",
        setting.sensor, setting.modality, setting.positions, setting.directions
    )
}
