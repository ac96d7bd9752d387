//! Figure 3: the bound against the magnet's height c above the middle of the grid, h along z.
//!
//! Claimed: it grows with a power of the height between the third and the fifth, and far away c becomes harder to tell than a. The
//! local exponent is d log(bound)/d log(c).

use super::network::{Claim, VARIANTS, bound_at, bound_axis, claim, figure, grid, set_up};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::Table;
use lumenav_figures::{Axis, Panel, Series};
use nalgebra::Vector3;

/// Heights of the figure, m.
const HEIGHTS_M: [f64; 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
/// Heights at which a crossing is looked for, m.
const FAR_M: [f64; 2] = [0.05, 5.0];
const FAR_STEPS: usize = 200;
/// Share of the height that the exponent's difference is taken over.
const DIFFERENCE: f64 = 1e-4;

/// Square roots of the bounds of a and c, m.
fn a_and_c(side: usize, height_m: f64, known: bool) -> Result<[f64; 2], ReproduceError> {
    let sigma =
        bound_at(&grid(side, 0.0), Vector3::new(0.0, 0.0, height_m), Vector3::z(), known)?.position_sigma_m();
    Ok([sigma.x, sigma.z])
}

/// Local exponents of a and c.
fn exponents(side: usize, height_m: f64, known: bool) -> Result<[f64; 2], ReproduceError> {
    let up = a_and_c(side, height_m * (1.0 + DIFFERENCE), known)?;
    let down = a_and_c(side, height_m * (1.0 - DIFFERENCE), known)?;
    let way = (1.0 + DIFFERENCE).ln() - (1.0 - DIFFERENCE).ln();
    Ok([0, 1].map(|i| (up[i] / down[i]).ln() / way))
}

/// Runs it.
pub(crate) fn run(_context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    set_up(&mut table);
    for side in [4, 10] {
        let n = side * side;
        for (known, variant) in VARIANTS {
            // The exponents of a are the same in both.
            let of: &[(usize, &str)] = if known { &[(0, "a"), (1, "c")] } else { &[(1, "c")] };
            for (index, name) in of {
                let all: Result<Vec<f64>, _> =
                    HEIGHTS_M.iter().map(|h| exponents(side, *h, known).map(|e| e[*index])).collect();
                let all = all?;
                let least = all.iter().copied().fold(f64::INFINITY, f64::min);
                let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let from = HEIGHTS_M.iter().zip(&all).find(|(_, e)| **e >= 3.0).map(|(h, _)| *h);
                let why = from.map_or_else(
                    || "below 3 everywhere from 0.1 to 1 m".to_owned(),
                    |h| format!("3 and more from {h} m on"),
                );
                let named =
                    |what: &str| format!("{what} exponent of {name} from 0.1 to 1 m, N = {n}, {variant}");
                table.rows.push(claim(named("smallest"), "", Claim::AtLeast(3.0), least, &why));
                table.rows.push(claim(named("largest"), "", Claim::AtMost(5.0), most, ""));
            }
            let largest = largest_ratio(side, known)?;
            let why = if largest < 1.0 { "c stays below a at every height" } else { "c rises above a" };
            table.rows.push(claim(
                format!("largest c/a from 0.05 to 5 m, N = {n}, {variant} (a crossing claimed)"),
                "",
                Claim::AtLeast(1.0),
                largest,
                why,
            ));
        }
    }
    table.figures.push(figure(vec![panel(4)?, panel(10)?])?);
    Ok(table)
}

fn largest_ratio(side: usize, known: bool) -> Result<f64, ReproduceError> {
    let mut largest: f64 = 0.0;
    for k in 0..=FAR_STEPS {
        let height_m = FAR_M[0] * (FAR_M[1] / FAR_M[0]).powf(k as f64 / FAR_STEPS as f64);
        let [a, c] = a_and_c(side, height_m, known)?;
        largest = largest.max(c / a);
    }
    Ok(largest)
}

fn panel(side: usize) -> Result<Panel, ReproduceError> {
    let mut panel = Panel::new(Axis::logarithmic("height c (m)"), bound_axis())
        .titled(&format!("{} sensors", side * side));
    for (k, (known, variant, index, name)) in
        [(true, "both", 0, "a"), (true, "strength known", 1, "c"), (false, "strength unknown", 1, "c")]
            .into_iter()
            .enumerate()
    {
        let points: Result<Vec<(f64, f64)>, ReproduceError> =
            HEIGHTS_M.iter().map(|h| Ok((*h, 1e3 * a_and_c(side, *h, known)?[index]))).collect();
        panel = panel.with(Series::ours(k, &format!("{name}, {variant}")).points(&points?));
    }
    Ok(panel)
}
