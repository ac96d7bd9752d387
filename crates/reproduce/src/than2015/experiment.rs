//! Chapter 5, tables 5.2 and 5.3, with what chapter 6 made of them (6.1, 6.2): a triangle pulled through a Jaszczak cylinder.
//!
//! The real experiments are simulated here: three half circles in water of 216 x 186 mm, forward and back at five speeds with six pauses,
//! 480 s; the triangle's sides, activities and cores as measured. The activity is scaled so that the mean count of lines is the
//! published one; the factor is printed.

use super::case::{self, Figured, Led, Path, lines_per_window, per_seed};
use super::estimators::{Estimators, FCM, FILTERED, MotionPrior, RIGID};
use super::motion::{Motion, Track};
use super::published::{ALLEGRO, Experiment, TF64};
use super::scoring::Score;
use super::set_up;
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_pet::tracking::ClassicOptions;

/// Errors are reproduced within this share.
const TOLERANCE: f64 = 0.10;
/// Windows of a quick run, and the share of the pilot run.
const QUICK: (usize, f64) = (12, 0.05);

/// Table 5.2 and 6.1.
pub(crate) fn tf64(context: &Context<'_>, table: Table) -> Result<Table, ReproduceError> {
    run(context, table, &TF64)
}

/// Table 5.3 and 6.2.
pub(crate) fn allegro(context: &Context<'_>, table: Table) -> Result<Table, ReproduceError> {
    run(context, table, &ALLEGRO)
}

fn run(context: &Context<'_>, mut table: Table, published: &Experiment) -> Result<Table, ReproduceError> {
    let water = set_up::phantom(context.models, "water-20")?;
    let markers = set_up::measured_markers(&set_up::markers(context.models)?);
    let mut set = Set::new(context.models, published.scanner, set_up::jaszczak(&water), markers)?;
    let track = Track::than2015()?;
    let pilot = context.size.pick(1.0, QUICK.1);
    let factors = context
        .jobs("activity", 1, |_| set.activity_factor(&track, published.lines, published.window_s, pilot))?;
    set.scale_activity(factors[0]);
    let all = track.windows(published.window_s);
    let windows = context.size.pick(all, QUICK.0);
    let path = Path { motion: &track, window_s: published.window_s, first: 0, windows };
    let seeds = &context.seeds;
    let runs = context.jobs("experiment", seeds.len(), |k| {
        // The adaptive budget of section 5.5 for `fcm` and `rigid`.
        let followers = Estimators::new(&set).all(ClassicOptions::default().budget, MotionPrior::SLOW);
        case::lead(&set, path, published.scanner, seeds[k], followers)
    })?;
    let runs: Vec<&Led> = runs.iter().collect();
    table.set(
        "path",
        format!(
            "three half circles, forward and back at five speeds, {windows} of {all} windows of {} ms",
            1e3 * published.window_s
        ),
    );
    table.set("phantom", "water, 216 mm diameter, 186 mm long");
    table.set("markers", "triangle, activities and cores as measured; estimators know the measured triangle");
    table.set("activity", format!("x {:.3}: {:.0} lines per window", factors[0], lines_per_window(&runs)));
    table.set("simulator", Source::MODE);
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(case::late());
    table.note("the source's lines are measured, ours simulated: how the half circles join, the speeds and the pauses have no record and are chosen");
    rows(&mut table, &runs, published);
    table.figures.push(case::distribution("", &runs)?);
    Ok(table)
}

fn rows(table: &mut Table, runs: &[&Led], published: &Experiment) {
    let lower = Sense::LowerIsBetter;
    let relative = Tolerance::Relative(TOLERANCE);
    let Some(first) = runs.first() else { return };
    let windows = first.scores[0].windows;
    // Every window is accounted for: answered or without a pose.
    let [least, most] = published.mean_mm;
    let middle = 0.5 * (least + most);
    let mean = Row::new(
        format!("mean marker error (published {least} to {most}, its middle given)"),
        "mm",
        Some(middle),
    );
    let mean = per_seed(mean, runs, Score::mean_mm, false).goal(FILTERED, middle);
    table.rows.push(mean.judged(FILTERED, lower, relative, ""));
    for (k, marker) in ["apex", "first base", "second base"].into_iter().enumerate() {
        let row = Row::new(format!("mean error of the {marker} marker"), "mm", Some(most));
        let row = per_seed(row, runs, |s| s.markers_mm()[k], false);
        table.rows.push(row.judged(FILTERED, lower, relative, "published as a range over the markers"));
    }
    let [from, to] = published.orientation_deg;
    let name = format!("mean error of the orientation vector (published {from} to {to})");
    let orientation = per_seed(Row::new(name, "deg", Some(to)), runs, Score::orientation_deg, false);
    table.rows.push(orientation.judged(FILTERED, lower, relative, ""));
    // The published counts are of all runs.
    let share = windows as f64 / published.runs as f64;
    let failures = [("fcm", FCM, published.fcm_failures), ("rigid", RIGID, published.rigid_failures)];
    for (name, judged, count) in failures {
        let row = Row::new(
            format!("windows of {windows} that failed (section 5.5.1), published for {name}, worst seed"),
            "",
            Some(f64::from(count) * share),
        );
        let row = per_seed(row, runs, |s| s.failed_check as f64, true);
        let why = "markers on the rigid body cannot fail by their distances: `rigid` fails by a share or a refusal alone, the mixtures by a refusal";
        table.rows.push(row.judged(judged, lower, Tolerance::Absolute(0.0), why));
    }
    let place = |name: &str| first.names.iter().position(|n| n == name);
    if let (Some(rigid), Some(fcm)) = (place(RIGID), place(FCM)) {
        let more = |led: &&Led| led.scores[rigid].failed_3_mm as f64 - led.scores[fcm].failed_3_mm as f64;
        let more: Vec<f64> = runs.iter().map(more).collect();
        let row = Row::new("failures of rigid less those of fcm (3 mm), worst seed", "", None);
        let row = row.ours_worst("difference", &more).goal("difference", 0.0);
        table.rows.push(row.not_comparable("chapter 6: rigid fails less often"));
    }
    let counted: [(&str, Figured); 3] = [
        ("that failed (3 mm)", |s| s.failed_3_mm as f64),
        ("that failed (5 mm)", |s| s.failed_5_mm as f64),
        ("without a pose", |s| s.without_pose as f64),
    ];
    for (what, value) in counted {
        let row = Row::new(format!("windows of {windows} {what}, worst seed"), "", None);
        let row = per_seed(row, runs, value, true);
        table.rows.push(row.not_comparable("the source counts by section 5.5.1"));
    }
}
