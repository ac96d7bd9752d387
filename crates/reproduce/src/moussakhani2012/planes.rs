//! Figure 5: the bound of b along the diagonal (t, t, 0.3 m) for 16 sensors in one plane, 16 + 16 in two coincident planes (case 2), and
//! 16 + 16 in two facing planes 0.6 m apart (case 1); the magnet along z and along (1, 1, 1).
//!
//! Claimed: two facing planes are better than two coincident ones, those better than one, and the facing ones see both sides alike.

use super::network::{Claim, bound_at, bound_axis, claim, figure, grid, set_up};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::Table;
use lumenav_figures::{Axis, Panel, Series};
use nalgebra::Vector3;

const HEIGHT_M: f64 = 0.3;
const APART_M: f64 = 0.6;
const STEPS: i32 = 6;

/// Square roots of the bound of b along the diagonal, m, for each t.
struct Curve {
    axis: &'static str,
    t_m: Vec<f64>,
    facing: Vec<f64>,
    coincident: Vec<f64>,
    one: Vec<f64>,
}

impl Curve {
    fn new(name: &'static str, axis: Vector3<f64>) -> Result<Self, ReproduceError> {
        let t_m: Vec<f64> = (-STEPS..=STEPS).map(|k| 0.3 * f64::from(k) / f64::from(STEPS)).collect();
        let of = |sensors: Vec<Vector3<f64>>| -> Result<Vec<f64>, ReproduceError> {
            let at = |t: &f64| {
                Ok(bound_at(&sensors, Vector3::new(*t, *t, HEIGHT_M), axis, true)?.position_sigma_m().y)
            };
            t_m.iter().map(at).collect()
        };
        Ok(Self {
            axis: name,
            facing: of([grid(4, 0.0), grid(4, APART_M)].concat())?,
            coincident: of([grid(4, 0.0), grid(4, 0.0)].concat())?,
            one: of(grid(4, 0.0))?,
            t_m,
        })
    }

    fn asymmetry(curve: &[f64]) -> f64 {
        let ratios = curve.iter().zip(curve.iter().rev()).map(|(a, b)| (a / b - 1.0).abs());
        100.0 * ratios.fold(0.0, f64::max)
    }

    fn panel(&self) -> Panel {
        let mut panel = Panel::new(Axis::linear("t (mm)"), bound_axis())
            .titled(&format!("b, magnet along {}", self.axis));
        let curves =
            [("two facing planes", &self.facing), ("two coincident", &self.coincident), ("one", &self.one)];
        for (k, (name, curve)) in curves.into_iter().enumerate() {
            let points: Vec<(f64, f64)> =
                self.t_m.iter().zip(curve).map(|(t, b)| (1e3 * t, 1e3 * b)).collect();
            panel = panel.with(Series::ours(k, name).points(&points));
        }
        panel
    }
}

fn least_and_most(above: &[f64], below: &[f64]) -> [f64; 2] {
    let ratios = above.iter().zip(below).map(|(a, b)| a / b);
    ratios.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], r| [low.min(r), high.max(r)])
}

/// Runs it.
pub(crate) fn run(_context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    set_up(&mut table);
    table.set("strength", "known");
    let curves = [Curve::new("z", Vector3::z())?, Curve::new("(1, 1, 1)", Vector3::new(1.0, 1.0, 1.0))?];
    for curve in &curves {
        let of = |what: &str| format!("{what}, magnet along {}", curve.axis);
        let [low, high] = least_and_most(&curve.one, &curve.coincident);
        let why = format!("from {low:.6} to {high:.6}: twice the readings, the square root of two");
        table.rows.push(claim(
            of("b above one plane over two coincident"),
            "",
            Claim::AtLeast(1.0),
            low,
            &why,
        ));
        let [low, high] = least_and_most(&curve.coincident, &curve.facing);
        let why = format!("from {low:.2} to {high:.2} along the diagonal");
        table.rows.push(claim(
            of("b above two coincident planes over two facing, least"),
            "",
            Claim::AtLeast(1.0),
            low,
            &why,
        ));
        table.rows.push(claim(
            of("asymmetry of two facing planes, t against -t"),
            "%",
            Claim::Equals(0.0, 1e-9),
            Curve::asymmetry(&curve.facing),
            "the array is its own point reflection",
        ));
    }
    // Of h along (1, 1, 1) the paper says that coincident planes do not see both sides alike.
    table.rows.push(claim(
        "asymmetry of two coincident planes, magnet along (1, 1, 1)",
        "%",
        Claim::AtLeast(1.0),
        Curve::asymmetry(&curves[1].coincident),
        "",
    ));
    table.figures.push(figure(curves.iter().map(Curve::panel).collect())?);
    Ok(table)
}
