//! Section 4.3.2 and table 4.1: full ring, cylinder of 20 cm, the helix, at most 210 of some 2,400 lines per window.

use super::case::{self, Led, lines_per_window};
use super::estimators::{Estimators, FCM, FILTERED, MotionPrior};
use super::follow::Run;
use super::motion::{Helix, Motion};
use super::published::{HELIX_RUNS, STATIC_CYLINDER, WINDOW_S};
use super::scoring::{Score, placed};
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_evaluation::summary::Quantiles;
use lumenav_pet::Line;
use lumenav_pet::tracking::centroid::{Centroid, Weight};
use lumenav_pet::tracking::{Budget, Preparation, Window};
use nalgebra::Vector3;

/// Errors are reproduced within this share.
const TOLERANCE: f64 = 0.10;
/// Failures are reproduced within so many windows of 720.
const FAILURES_TOLERANCE: f64 = 0.0;
/// Windows of a quick run.
const QUICK_WINDOWS: usize = 12;
/// Lines within this of the set are never thrown out, as in the trackers, m: a marker owns a line within it.
const OWNED_M: f64 = 5e-3;
/// The least lines a centroid needs.
const FEWEST_LINES: usize = 10;

/// A seed's scores, and the errors of the centroid alone on the budget and on all lines, mm.
struct Followed {
    led: Led,
    centroid_mm: [f64; 2],
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let seeds = &context.seeds;
    let runs = context.jobs("static cylinder", seeds.len(), |k| one(context, seeds[k]))?;
    let Some(first) = runs.first() else { return Err(ReproduceError::NoSeed) };
    let leds: Vec<&Led> = runs.iter().map(|run| &run.led).collect();
    let lines = lines_per_window(&leds);
    table.set(
        "path",
        format!("helix of 36 s, {} windows of 50 ms of {HELIX_RUNS} per seed", first.led.scores[0].windows),
    );
    table.set("scanner", "full ring, cylinder of 20 cm, crystal centres as ends of lines");
    table.set("simulator", Source::MODE);
    let budget = STATIC_CYLINDER.line_budget;
    table.set(
        "lines",
        format!("{lines:.0} per window; at most {budget} for `fcm` and `rigid`, all for the mixtures"),
    );
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(case::late());
    rows(&mut table, &leds);
    centroid_rows(&mut table, &runs);
    table.figures.push(case::distribution("", &leds)?);
    Ok(table)
}

/// Error of the centroid of a window's lines, m.
fn centroid_error_m(
    lines: &[Line],
    budget: Option<usize>,
    spared_m: f64,
    truth_m: &Vector3<f64>,
) -> Option<f64> {
    let mut window = Window::default();
    // About the scanner's centre, as in the source's first run.
    let how = Preparation { budget, ..Preparation::about(Vector3::zeros()) };
    window.load(lines, &how, FEWEST_LINES).ok()?;
    let centre = Centroid::default().find(&window, Weight::Uniform, spared_m).ok()?;
    Some((centre - truth_m).norm())
}

fn one(context: &Context<'_>, seed: u64) -> Result<Followed, ReproduceError> {
    let set = Set::than2015(context.models, "allegro", "water-20")?;
    let markers_capsule_m = set.markers_capsule_m()?;
    let helix = Helix { times_faster: 1.0 };
    let windows = context.size.pick(HELIX_RUNS, QUICK_WINDOWS);
    let mut followers =
        Estimators::new(&set).all(Budget::AtMost(STATIC_CYLINDER.line_budget), MotionPrior::SLOW);
    let mut source = Source::new(&set, seed, "static-cylinder");
    let run = Run { motion: &helix, window_s: WINDOW_S, first: 0, windows, markers_capsule_m };
    let names = followers.iter().map(|f| f.name().to_owned()).collect();
    let mut centroids = [Quantiles::new(), Quantiles::new()];
    let centre = markers_capsule_m.iter().sum::<Vector3<f64>>() / 3.0;
    let spared_m =
        markers_capsule_m.iter().map(|m| (m - centre).norm()).fold(OWNED_M, |r, m| r.max(m + OWNED_M));
    let scores = run.lead(&mut followers, |sequence, start_s, lines| {
        source.window(&helix, start_s, WINDOW_S, sequence, lines);
        let middle = helix.world_from_capsule(start_s + 0.5 * WINDOW_S);
        let truth = placed(&middle, &markers_capsule_m).iter().sum::<Vector3<f64>>() / 3.0;
        for (budget, errors) in [Some(STATIC_CYLINDER.line_budget), None].into_iter().zip(&mut centroids) {
            if let Some(error) = centroid_error_m(lines, budget, spared_m, &truth) {
                errors.push(error);
            }
        }
        Ok(())
    })?;
    let centroid_mm = centroids.map(|errors| errors.mean().map_or(f64::NAN, |mean| mean * 1e3));
    Ok(Followed { led: Led { names, scores, tally: source.tally() }, centroid_mm })
}

fn rows(table: &mut Table, runs: &[&Led]) {
    let per_seed =
        |row: Row, value: &dyn Fn(&Score) -> f64, worst: bool| case::per_seed(row, runs, value, worst);
    let published = STATIC_CYLINDER;
    let relative = Tolerance::Relative(TOLERANCE);
    let lower = Sense::LowerIsBetter;
    let mean = per_seed(Row::new("mean marker error", "mm", Some(published.mean_mm)), &Score::mean_mm, false);
    let why =
        "`mixture` looks at all lines and has a motion prior; fcm and rigid have neither, as the source";
    table.rows.push(mean.judged(FILTERED, lower, relative, why));
    let sd =
        per_seed(Row::new("standard deviation of it", "mm", Some(published.sd_mm)), &Score::sd_mm, false);
    table.rows.push(sd.judged(FILTERED, lower, relative, ""));
    let orientation =
        Row::new("mean error of the orientation vector", "deg", Some(published.orientation_deg));
    let orientation = per_seed(orientation, &Score::orientation_deg, false);
    table.rows.push(orientation.judged(FILTERED, lower, relative, ""));
    let windows = runs.first().map_or(0, |led| led.scores[0].windows);
    let failed = Row::new(
        format!("windows of {windows} that failed (3 mm), worst seed"),
        "",
        Some(f64::from(published.failures)),
    );
    let failed = per_seed(failed, &|s| s.failed_3_mm as f64, true);
    table.rows.push(failed.judged(FCM, lower, Tolerance::Absolute(FAILURES_TOLERANCE), ""));
    let definition =
        "mean absolute error here; whether the source's is that or a root mean square is not recorded";
    let across = Row::new("error along x and y", "mm", Some(published.across_mm));
    table.rows.push(per_seed(across, &Score::across_mm, false).not_comparable(definition));
    let [low, high] = published.axial_mm;
    let axial = Row::new(
        format!("error along z (published {low} to {high}, its middle given)"),
        "mm",
        Some(0.5 * (low + high)),
    );
    table.rows.push(per_seed(axial, &Score::axial_mm, false).not_comparable(definition));
}

fn centroid_rows(table: &mut Table, runs: &[Followed]) {
    let (lower, relative) = (Sense::LowerIsBetter, Tolerance::Relative(TOLERANCE));
    let published = STATIC_CYLINDER;
    let centroids = [
        ("centroid alone, 210 lines", published.centroid_mm, 0),
        ("centroid alone, all lines", published.centroid_all_lines_mm, 1),
    ];
    for (what, value, which) in centroids {
        let values: Vec<f64> = runs.iter().map(|run| run.centroid_mm[which]).collect();
        let row =
            Row::new(format!("mean error of the {what}"), "mm", Some(value)).ours_mean("centroid", &values);
        let why = "uniform weight, one line thrown out at a time; scattered lines pull it towards the scanner's middle";
        table.rows.push(row.judged("centroid", lower, relative, why));
    }
}
