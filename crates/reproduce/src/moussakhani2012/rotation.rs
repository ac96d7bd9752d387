//! Figure 4: the bound against the turn of the magnet's axis from the normal (z) towards y, 0.25 m above the middle of the grid.
//!
//! Claimed: with the turn a and b fall and c rises.

use super::network::{Claim, HEIGHT_M, VARIANTS, bound_at, bound_axis, claim, figure, grid, set_up};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::Table;
use lumenav_figures::{Axis, Panel, Series};
use nalgebra::Vector3;

const STEP_DEG: u32 = 15;
const NAMES: [&str; 3] = ["a", "b", "c"];

/// Square roots of the bounds of a, b, c every 15 degrees from 0 to 90, m.
fn curve(side: usize, known: bool) -> Result<Vec<(f64, Vector3<f64>)>, ReproduceError> {
    (0..=90 / STEP_DEG)
        .map(|k| {
            let degrees = f64::from(k * STEP_DEG);
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let axis = Vector3::new(0.0, sine, cosine);
            let bound = bound_at(&grid(side, 0.0), Vector3::new(0.0, 0.0, HEIGHT_M), axis, known)?;
            Ok((degrees, bound.position_sigma_m()))
        })
        .collect()
}

/// Runs it.
pub(crate) fn run(_context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    set_up(&mut table);
    let mut panels = Vec::new();
    for side in [4, 10] {
        let n = side * side;
        for (known, variant) in VARIANTS {
            let curve = curve(side, known)?;
            let end = |i: usize| curve[curve.len() - 1].1[i] / curve[0].1[i];
            for (i, name) in NAMES.into_iter().enumerate() {
                let named = format!("{name} at 90 degrees over {name} at 0, N = {n}, {variant}");
                let claimed = if i < 2 { Claim::AtMost(1.0) } else { Claim::AtLeast(1.0) };
                table.rows.push(claim(named, "", claimed, end(i), ""));
                let wrong = curve.windows(2).filter(|pair| (pair[1].1[i] > pair[0].1[i]) == (i < 2)).count();
                let highest = curve.iter().max_by(|p, q| p.1[i].total_cmp(&q.1[i])).map_or(0.0, |p| p.0);
                let why = if wrong > 0 { format!("largest at {highest} degrees") } else { String::new() };
                table.rows.push(claim(
                    format!("steps of 15 degrees in which {name} goes the other way, N = {n}, {variant}"),
                    "",
                    Claim::AtMost(0.0),
                    wrong as f64,
                    &why,
                ));
            }
            panels.push(panel(&format!("{n} sensors, {variant}"), &curve));
        }
    }
    table.figures.push(figure(panels)?);
    Ok(table)
}

fn panel(title: &str, curve: &[(f64, Vector3<f64>)]) -> Panel {
    let mut panel = Panel::new(Axis::linear("turn towards y (degrees)"), bound_axis()).titled(title);
    for (i, name) in NAMES.into_iter().enumerate() {
        let points: Vec<(f64, f64)> =
            curve.iter().map(|(degrees, sigma)| (*degrees, 1e3 * sigma[i])).collect();
        panel = panel.with(Series::ours(i, name).points(&points));
    }
    panel
}
