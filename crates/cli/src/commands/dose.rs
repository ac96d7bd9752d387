//! `lumenav dose`: what the markers of a run's capsule leave along the wall of its tract.
//!
//! The transit is the run's own truth; the wall is the tract at rest, and the capsule, with all activity in its centre, on the tract's
//! centre line (a wall that it rests against gets more: at 6 mm from the centre of a lumen of 20 mm radius, 11 times more). Two figures
//! for every place: nothing between source and wall, and water between them.

use crate::args::DoseOptions;
use crate::files;
use anyhow::{Context as _, bail};
use comfy_table::CellAlignment;
use lumenav::anatomy::Tract;
use lumenav::core::{Name, Node};
use lumenav::figures::{Axis, Figure, Panel, Series};
use lumenav::pet::MarkerSet;
use lumenav::pet::planning::dose::{SODIUM_22_SV_M2_PER_H_BQ, TransitPoint, WallDose, WallPoint};
use lumenav::report::{Manifest, read_arc_length, read_json};
use lumenav::scenario::ScenarioFile;
use serde::Serialize;
use std::path::Path;

/// Places around the lumen.
const AROUND: usize = 12;
/// Attenuation of 511 keV in water, 1/m: n_e sigma_KN = 0.3343e24 /cm^3 x 0.2866 b, as in `models/phantoms`.
const WATER_511_PER_M: f64 = 9.58;

/// What is told of a stretch of the wall.
#[derive(Debug, Serialize)]
struct Stretch {
    segment: String,
    from_m: f64,
    to_m: f64,
    /// Mean over the stretch, mSv, nothing between.
    mean_msv: f64,
    /// The largest, mSv, nothing between.
    largest_msv: f64,
    /// Where the largest is, m.
    largest_at_m: f64,
    /// The largest, mSv, water between.
    largest_behind_water_msv: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    run: String,
    markers: usize,
    activity_mbq: f64,
    dose_rate_constant_usv_m2_per_h_mbq: f64,
    duration_s: f64,
    segments: Vec<Stretch>,
}

/// Tells the dose along the wall.
pub fn dose(options: &DoseOptions) -> anyhow::Result<()> {
    let scenario = opened(options)?;
    let table = scenario
        .tract
        .as_ref()
        .context("the run has no [tract], so there is no wall that a dose could be told of")?;
    let (tract, _) = lumenav::scenario::engine_world::read_tract(&scenario, table)?;
    let markers = MarkerSet::from_capsule(&scenario.capsule_model, &Name::from("dose"), 1)?;
    let transit = transit(&options.run)?;
    let wall = WallDose {
        constant_sv_m2_per_h_bq: constant(options, &markers)?,
        total_activity_bq: markers.total_activity_bq(),
        attenuation_per_m: 0.0,
        nearest_m: scenario.body.radius_m,
        stations: stations(&tract, scenario.body.radius_m),
        around: AROUND,
    };
    let along = |wall: WallDose| wall.along(&tract, &transit).context("the run's truth is too short");
    let bound = along(wall)?;
    let behind = along(WallDose { attenuation_per_m: WATER_511_PER_M, ..wall })?;
    let report = Report {
        run: options.run.display().to_string(),
        markers: markers.len(),
        activity_mbq: 1e-6 * markers.total_activity_bq(),
        dose_rate_constant_usv_m2_per_h_mbq: 1e12 * wall.constant_sv_m2_per_h_bq,
        duration_s: transit.last().map_or(0.0, |p| p.t_s) - transit.first().map_or(0.0, |p| p.t_s),
        segments: stretches(&tract, &bound, &behind),
    };
    if let Some(out) = &options.out {
        write(out, options.force, &bound, &behind)?;
    }
    if options.json {
        return crate::output::json(&report);
    }
    say(&report)
}

/// The scenario as it was run, out of the run's manifest.
fn opened(options: &DoseOptions) -> anyhow::Result<ScenarioFile> {
    let path = options.run.join("manifest.json");
    let manifest: Manifest =
        read_json(&path).with_context(|| format!("{} is no run's folder", options.run.display()))?;
    let shown = path.display().to_string();
    let node = Node::parse_text(&manifest.scenario_toml, &shown, &options.run, &[])?;
    let models = lumenav::models_folder(options.models.as_deref(), &path);
    Ok(ScenarioFile::from_node(node, models)?)
}

fn transit(run: &Path) -> anyhow::Result<Vec<TransitPoint>> {
    let path = run.join("truth.parquet");
    if !path.is_file() {
        bail!("{} has no truth.parquet: a replay does not know where the capsule was", run.display());
    }
    let point = |(t_ns, arc_length_m): (i64, f64)| TransitPoint { t_s: 1e-9 * t_ns as f64, arc_length_m };
    Ok(read_arc_length(&path)?.into_iter().map(point).collect())
}

fn constant(options: &DoseOptions, markers: &MarkerSet) -> anyhow::Result<f64> {
    if let Some(constant) = options.dose_rate_constant {
        if !(constant > 0.0 && constant.is_finite()) {
            bail!("--dose-rate-constant {constant}: give uSv m2/(h MBq) above 0");
        }
        return Ok(1e-12 * constant);
    }
    match markers.markers.iter().find(|marker| &*marker.isotope != "na-22") {
        None => Ok(SODIUM_22_SV_M2_PER_H_BQ),
        Some(marker) => bail!(
            "the dose rate constant of `{}` is not known here (that of na-22 is 0.362); give --dose-rate-constant in uSv m2/(h MBq)",
            marker.isotope
        ),
    }
}

/// A place every capsule's radius.
fn stations(tract: &Tract, step_m: f64) -> usize {
    (tract.length_m() / step_m).ceil().max(1.0) as usize + 1
}

fn stretches(tract: &Tract, bound: &[WallPoint], behind: &[WallPoint]) -> Vec<Stretch> {
    let of = |segment: &lumenav::anatomy::Segment| {
        let inside = |point: &&WallPoint| (segment.start_m..=segment.end_m).contains(&point.arc_length_m);
        let points: Vec<&WallPoint> = bound.iter().filter(inside).collect();
        let largest = points.iter().max_by(|a, b| a.largest_sv.total_cmp(&b.largest_sv))?;
        let water = behind.iter().filter(inside).map(|p| p.largest_sv).fold(0.0, f64::max);
        Some(Stretch {
            segment: segment.key.as_str().to_owned(),
            from_m: segment.start_m,
            to_m: segment.end_m,
            mean_msv: 1e3 * points.iter().map(|p| p.mean_sv).sum::<f64>() / points.len() as f64,
            largest_msv: 1e3 * largest.largest_sv,
            largest_at_m: largest.arc_length_m,
            largest_behind_water_msv: 1e3 * water,
        })
    };
    tract.segments.iter().filter_map(of).collect()
}

fn say(report: &Report) -> anyhow::Result<()> {
    let mut table = crate::table::fitting(comfy_table::presets::UTF8_HORIZONTAL_ONLY);
    table.set_header([
        "segment",
        "from m",
        "to m",
        "mean mSv",
        "largest mSv",
        "at m",
        "largest, water between",
    ]);
    for s in &report.segments {
        let number = |value: f64| format!("{value:.3}");
        table.add_row([
            s.segment.clone(),
            number(s.from_m),
            number(s.to_m),
            number(s.mean_msv),
            number(s.largest_msv),
            number(s.largest_at_m),
            number(s.largest_behind_water_msv),
        ]);
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    say!("{table}")?;
    say!(
        "{} markers of {:.2} MBq together, {:.0} s; dose rate constant {:.3} uSv m2/(h MBq); all activity in the capsule's centre",
        report.markers,
        report.activity_mbq,
        report.duration_s,
        report.dose_rate_constant_usv_m2_per_h_mbq
    )
}

fn write(out: &Path, force: bool, bound: &[WallPoint], behind: &[WallPoint]) -> anyhow::Result<()> {
    files::check_free(out, &["dose.csv", "dose.svg"], force)?;
    let row = |(b, w): (&WallPoint, &WallPoint)| {
        format!("{},{},{},{},{}", b.arc_length_m, b.mean_sv, b.largest_sv, w.mean_sv, w.largest_sv)
    };
    let head = "arc_length_m,mean_sv,largest_sv,mean_water_between_sv,largest_water_between_sv".to_owned();
    let rows: Vec<String> = std::iter::once(head).chain(bound.iter().zip(behind).map(row)).collect();
    let csv = rows.join("\n") + "\n";
    let curve = |points: &[WallPoint]| -> Vec<(f64, f64)> {
        points.iter().map(|p| (p.arc_length_m, 1e3 * p.largest_sv)).collect()
    };
    let panel =
        Panel::new(Axis::linear("along the tract (m)"), Axis::linear("largest dose of the wall (mSv)"))
            .with(Series::ours(0, "nothing between").line(0).points(&curve(bound)))
            .with(Series::ours(1, "water between").line(1).points(&curve(behind)));
    let svg = Figure::of(panel).to_svg()?;
    files::write(out, &[("dose.csv", csv), ("dose.svg", svg)])?;
    Ok(())
}
