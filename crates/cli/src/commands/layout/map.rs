//! The map of a layout as CSV and SVG.

use lumenav::core::LayoutElement;
use lumenav::figures::{Axis, Figure, Map, Maps, Panel, Scale, Series};
use lumenav::layouts::{Evaluation, Posterior, Workspace};
use std::fmt::Write as _;

/// A row per pose; an infinite bound leaves its fields empty.
pub(super) fn csv(workspace: &Workspace, evaluation: &Evaluation) -> String {
    let mut text =
        "x_m,y_m,z_m,axis_x,axis_y,axis_z,error_m,sigma_x_m,sigma_y_m,sigma_z_m,angle_rad\n".to_owned();
    for (i, bound) in evaluation.bounds.iter().enumerate() {
        let pose = workspace.pose(i);
        let (p, u) = (pose.translation.vector, pose.rotation.transform_vector(&[1.0, 0.0, 0.0].into()));
        // Writing to a string cannot fail.
        let _ = write!(text, "{},{},{},{},{},{}", p.x, p.y, p.z, u.x, u.y, u.z);
        let _ = match bound {
            Some(b) => {
                let s = b.position_m2.diagonal().map(|v| v.max(0.0).sqrt());
                writeln!(text, ",{},{},{},{},{}", b.position_m(), s.x, s.y, s.z, b.angle_rad)
            }
            None => writeln!(text, ",,,,,"),
        };
    }
    text
}

/// More slices than these are thinned: a page holds no more.
const MOST_SLICES: usize = 9;

/// Columns added beside a grid at most, so that the sensors around it are in the picture.
const MOST_BESIDE: usize = 12;

/// Coordinates with more of them on both sides, at the grid's own step, until they reach these places; and how many came before.
fn with_room(at: &[f64], places: &[f64]) -> (Vec<f64>, usize) {
    let step = at.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let (Some(first), Some(last)) = (at.first(), at.last()) else { return (Vec::new(), 0) };
    if !step.is_finite() {
        return (at.to_vec(), 0);
    }
    let reach = |beyond: &dyn Fn(f64) -> f64| {
        let most = places.iter().map(|place| beyond(*place)).fold(0.0, f64::max);
        ((most / step).ceil() as usize).min(MOST_BESIDE)
    };
    let (before, behind) = (reach(&|p| first - p), reach(&|p| p - last));
    let lower = (1..=before).rev().map(|k| first - step * k as f64);
    let upper = (1..=behind).map(|k| last + step * k as f64);
    (lower.chain(at.iter().copied()).chain(upper).collect(), before)
}

/// Slices of a grid at constant z, each position's error the root mean square over the directions, with the sensors within half a step
/// of the slice; `None` where there is no grid.
pub(super) fn svg(
    workspace: &Workspace,
    evaluation: &Evaluation,
    elements: &[LayoutElement],
) -> anyhow::Result<Option<String>> {
    let Some(grid) = &workspace.grid else { return Ok(None) };
    let [xs, ys, zs] = &grid.axes_m;
    let directions = workspace.directions.len();
    let errors: Vec<f64> = evaluation.errors_m().collect();
    let mut on_grid = vec![f64::NAN; xs.len() * ys.len() * zs.len()];
    for (of_position, at) in errors.chunks(directions).zip(&grid.kept) {
        on_grid[*at] = 1e3 * (of_position.iter().map(|e| e * e).sum::<f64>() / directions as f64).sqrt();
    }
    let mm = |coordinates: &[f64]| coordinates.iter().map(|v| 1e3 * v).collect::<Vec<_>>();
    let along = |axis: usize| -> Vec<f64> {
        elements.iter().map(|e| e.world_from_element.translation.vector[axis]).collect()
    };
    let ((x_at, x_before), (y_at, y_before)) = (with_room(xs, &along(0)), with_room(ys, &along(1)));
    let values_of = |k: usize| {
        let mut values = vec![f64::NAN; x_at.len() * y_at.len()];
        for (j, row) in
            on_grid[k * xs.len() * ys.len()..(k + 1) * xs.len() * ys.len()].chunks(xs.len()).enumerate()
        {
            let from = (j + y_before) * x_at.len() + x_before;
            values[from..from + xs.len()].copy_from_slice(row);
        }
        values
    };
    let step = zs.len().div_ceil(MOST_SLICES);
    let half_m = zs.windows(2).map(|pair| 0.5 * (pair[1] - pair[0])).fold(0.05, f64::min);
    let slice = |k: usize| Map {
        title: format!("z = {:.0} mm", 1e3 * zs[k]).replace('-', "\u{2212}"),
        x_at: mm(&x_at),
        y_at: mm(&y_at),
        values: values_of(k),
        points: elements
            .iter()
            .map(|e| e.world_from_element.translation.vector)
            .filter(|p| (p.z - zs[k]).abs() <= half_m)
            .map(|p| (1e3 * p.x, 1e3 * p.y))
            .collect(),
    };
    let maps = Maps {
        maps: (0..zs.len()).step_by(step).map(slice).collect(),
        columns: 3,
        labels: ["x (mm)".to_owned(), "y (mm)".to_owned()],
        quantity: "bound, rms over directions (mm)".to_owned(),
        scale: Scale::Logarithmic,
    };
    // A layout that sees nothing anywhere has no picture, and its table says so.
    Ok(errors.iter().any(|e| e.is_finite()).then(|| maps.to_svg()).transpose()?)
}

/// Cost against error, a symbol per layout; `None` where none has a bound.
pub(super) fn pareto_svg(
    cost_unit: &str,
    layouts: &[(&str, f64, Option<f64>)],
) -> anyhow::Result<Option<String>> {
    let mut panel =
        Panel::new(Axis::linear(&format!("cost ({cost_unit})")), Axis::logarithmic("bound, rms (mm)"));
    let known: Vec<(&str, f64, f64)> =
        layouts.iter().filter_map(|(name, cost, error)| Some((*name, *cost, (*error)?))).collect();
    for (k, (name, cost, error)) in known.iter().enumerate() {
        panel = panel.with(Series::ours(k, name).symbols().points(&[(*cost, *error)]));
    }
    if known.is_empty() {
        return Ok(None);
    }
    Ok(Some(Figure::of(panel).panel_size(420, 300).to_svg()?))
}

/// A row per reading of a path; an infinite bound leaves its field empty.
pub(super) fn posterior_csv(posterior: &Posterior) -> String {
    let mut text = "t_s,one_reading_mm,with_a_filter_mm\n".to_owned();
    for at in &posterior.course {
        let one = at.one_reading_mm.map_or_else(String::new, |v| v.to_string());
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{},{one},{}", at.t_s, at.position_mm);
    }
    text
}

/// Both bounds over time.
pub(super) fn posterior_svg(posterior: &Posterior) -> anyhow::Result<String> {
    let one: Vec<(f64, f64)> =
        posterior.course.iter().filter_map(|at| Some((at.t_s, at.one_reading_mm?))).collect();
    let both: Vec<(f64, f64)> = posterior.course.iter().map(|at| (at.t_s, at.position_mm)).collect();
    let panel = Panel::new(Axis::linear("time (s)"), Axis::linear("bound (mm)").at_least(0.0, 0.0))
        .with(Series::ours(0, "of one reading").line(0).points(&one))
        .with(Series::ours(1, "with all before it").line(0).points(&both));
    Ok(Figure::of(panel).panel_size(560, 300).to_svg()?)
}
