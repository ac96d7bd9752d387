//! Section 3.6, figure 3.10: the dose of a resting capsule, an upper bound, and the smallest activity for a wanted rate of poses.

use super::published::{DOSE_BOUND_MSV, GAMMA_NA22_USV_H_PER_MBQ, RATES};
use super::set_up;
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_pet::planning::activity::{Geometry, smallest_activity_bq};
use lumenav_pet::planning::dose::{SODIUM_22_SV_M2_PER_H_BQ, dose_bound_sv, dose_rate_sv_per_h};

/// The case of section 3.6: 10 h at 50 mm.
const HOURS: f64 = 10.0;
const DISTANCE_M: f64 = 0.050;
/// Soft tissue between capsule and place, where there is some: the phantoms' water.
const PHANTOM: &str = "water-20";
/// The published figure has three digits.
const TOLERANCE: f64 = 0.005;
/// Distances of the figure, mm.
const DISTANCES_MM: [f64; 2] = [20.0, 200.0];
const CURVE_POINTS: usize = 46;
/// Rate of poses of the simulations, Hz.
const RATE_HZ: f64 = 20.0;
const GEOMETRIES: [(Geometry, &str); 2] =
    [(Geometry::FullRing, "full ring"), (Geometry::Reduced, "reduced scanner")];

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let markers = set_up::markers(context.models)?;
    let attenuation_per_m = set_up::phantom(context.models, PHANTOM)?.largest_attenuation_511_per_m();
    let total_bq = markers.total_activity_bq();
    let bound_msv = |hours: f64, distance_m: f64| {
        dose_bound_sv(SODIUM_22_SV_M2_PER_H_BQ, total_bq, hours * 3600.0, distance_m) * 1e3
    };
    let behind_msv = |hours: f64, distance_m: f64| {
        let rate =
            dose_rate_sv_per_h(SODIUM_22_SV_M2_PER_H_BQ, total_bq, attenuation_per_m, distance_m, distance_m);
        rate * hours * 1e3
    };
    table.set("markers", format!("{} of Na-22, {:.2} MBq together", markers.len(), total_bq * 1e-6));
    table.set("dose rate constant", format!("{} uSv/h per MBq at 1 m", SODIUM_22_SV_M2_PER_H_BQ * 1e12));
    table.set("tissue", format!("attenuation of water at 511 keV, {attenuation_per_m:.2} /m, no build-up"));
    table.rows.push(
        Row::new("dose rate constant of Na-22", "uSv m2/(h MBq)", Some(GAMMA_NA22_USV_H_PER_MBQ))
            .ours("formula", SODIUM_22_SV_M2_PER_H_BQ * 1e12)
            .judged("formula", Sense::Match, Tolerance::Relative(TOLERANCE), "taken from the source"),
    );
    table.rows.push(
        Row::new("dose at 50 mm in 10 h, nothing between", "mSv", Some(DOSE_BOUND_MSV))
            .ours("formula", bound_msv(HOURS, DISTANCE_M))
            .judged("formula", Sense::Match, Tolerance::Relative(TOLERANCE), "n Gamma A t / d^2"),
    );
    for hours in [1.0, 5.0, HOURS] {
        table.rows.push(
            Row::new(format!("dose at 50 mm in {hours} h behind 50 mm of water"), "mSv", None)
                .ours("formula", behind_msv(hours, DISTANCE_M))
                .not_comparable("not available: of figure 3.10 this project has no numbers"),
        );
    }
    for (geometry, name) in GEOMETRIES {
        for published in RATES {
            let Some(activity_bq) = smallest_activity_bq(geometry, published.diameter_cm * 1e-2, RATE_HZ)
            else {
                continue;
            };
            let quantity =
                format!("smallest activity per marker at {RATE_HZ} Hz, {name}, {} cm", published.diameter_cm);
            table.rows.push(
                Row::new(quantity, "MBq", None).ours("formula", activity_bq * 1e-6).not_comparable(
                    "not available: the source states the formula, of its values this project has none",
                ),
            );
        }
    }
    table.note(
        "a bound for a capsule at rest with all activity in one point; what a transit leaves along the wall of a tract is a matter of \
         planning, not of this table",
    );
    table.figures.push(figure(&bound_msv, &behind_msv)?);
    Ok(table)
}

type Dose<'a> = &'a dyn Fn(f64, f64) -> f64;

fn figure(bound_msv: Dose<'_>, behind_msv: Dose<'_>) -> Result<NamedFigure, ReproduceError> {
    let [nearest, furthest] = DISTANCES_MM;
    let along = |dose: Dose<'_>| -> Vec<(f64, f64)> {
        let at = |k: usize| nearest + (furthest - nearest) * k as f64 / (CURVE_POINTS - 1) as f64;
        (0..CURVE_POINTS).map(|k| (at(k), dose(HOURS, at(k) * 1e-3))).collect()
    };
    let panel = Panel::new(Axis::linear("distance (mm)"), Axis::logarithmic("dose in 10 h (mSv)"))
        .with(Series::ours(0, "nothing between").line(0).points(&along(bound_msv)))
        .with(Series::ours(1, "water between").line(1).points(&along(behind_msv)))
        .with(
            Series::published("than2015, section 3.6")
                .symbols()
                .points(&[(DISTANCE_M * 1e3, DOSE_BOUND_MSV)]),
        );
    let mut activity = Panel::new(
        Axis::linear("diameter of the body (cm)"),
        Axis::logarithmic(&format!("activity per marker at {RATE_HZ} Hz (MBq)")),
    );
    for (k, (geometry, name)) in GEOMETRIES.into_iter().enumerate() {
        let at = |step: u32| 20.0 + f64::from(step) * 0.5;
        let curve: Vec<(f64, f64)> = (0..=40)
            .filter_map(|step| {
                Some((at(step), smallest_activity_bq(geometry, at(step) * 1e-2, RATE_HZ)? * 1e-6))
            })
            .collect();
        activity = activity.with(Series::ours(k + 2, name).line(k).points(&curve));
    }
    Ok(NamedFigure { name: String::new(), svg: Figure::grid(vec![panel, activity], 2).to_svg()? })
}
