//! Table 4.3: the reduced scanner with 284 down to 54 lines per window.
//!
//! Each count comes from its own cylinder of table 4.2, not by thinning: the true share falls with it. The markers' activity is set so
//! that the mean count is the table's (the factor is printed). All estimators see the same windows.

use super::case::{self, Figured, Led, Path, lines_per_window, per_seed};
use super::estimators::{ALONE, Estimators, FILTERED, MotionPrior};
use super::follow::MOST_HELD;
use super::motion::{Helix, Motion};
use super::published::{FEW_LINES, FewLinesRow, HELIX_RUNS, RATES, WINDOW_S};
use super::scoring::{FAILED_3_MM_M, Score};
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_pet::tracking::Budget;

/// Goals of this project for the mean marker error with the motion prior, mm (mean of seeds 1 to 3).
const GOALS_MM: [f64; 5] = [0.32, 0.37, 0.46, 0.52, 0.65];
/// Goals without motion prior in the likelihood, mm; none for fewer lines.
const GOALS_ALONE_MM: [Option<f64>; 5] = [Some(0.50), Some(0.62), None, None, None];
/// Goals at eight times the speed, mm.
const GOALS_FAST_MM: [Option<f64>; 5] = [Some(0.41), None, Some(0.65), None, None];
/// One setting of process noise for the whole table.
const MOTION_PRIOR: MotionPrior = MotionPrior::SLOW;
/// Lines that `fcm` and `rigid` take at most (than2015, section 4.3).
const BUDGET: usize = 210;
/// Times the speed of the helix in the rows for fast motion.
const FAST: f64 = 8.0;
/// Errors are reproduced within this share.
const TOLERANCE: f64 = 0.10;
/// Share of the pilot run in a quick one.
const QUICK_PILOT: f64 = 0.1;
/// Windows of a quick run.
const QUICK_WINDOWS: usize = 40;

const ANSWERED_LATE: &str = "windows of the start answered late, once the first pose was found";

/// A cell: the scores of all estimators for one count, speed and seed.
struct Cell {
    row: usize,
    fast: bool,
    seed: u64,
    led: Led,
    activity_factor: f64,
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let factors = context.jobs("activity", RATES.len(), |row| {
        let set = Set::than2015(context.models, "reduced", RATES[row].phantom)?;
        let helix = Helix { times_faster: 1.0 };
        let pilot = context.size.pick(1.0, QUICK_PILOT);
        set.activity_factor(&helix, f64::from(FEW_LINES[row].lines), WINDOW_S, pilot)
    })?;
    let mut jobs = Vec::new();
    for (row, goal) in GOALS_FAST_MM.iter().enumerate() {
        jobs.extend(context.seeds.iter().map(|seed| (row, false, *seed)));
        if goal.is_some() {
            jobs.extend(context.seeds.iter().map(|seed| (row, true, *seed)));
        }
    }
    let cells = context.jobs("few lines", jobs.len(), |k| cell(context, jobs[k], &factors))?;
    describe(&mut table, &cells);
    for row in 0..FEW_LINES.len() {
        rows(&mut table, &cells, row);
    }
    for row in (0..FEW_LINES.len()).filter(|row| GOALS_FAST_MM[*row].is_some()) {
        fast_rows(&mut table, &cells, row);
    }
    failed_windows(&mut table, &cells);
    table.figures = figures(&cells)?;
    Ok(table)
}

/// Which windows of the filtered mixture failed: a start that is not settled is another thing than a track that is lost.
fn failed_windows(table: &mut Table, cells: &[Cell]) {
    for cell in cells {
        let Some(k) = cell.led.names.iter().position(|name| name == FILTERED) else { continue };
        let score = &cell.led.scores[k];
        let failed = score.worst_m.iter().enumerate().filter(|(_, worst)| **worst > FAILED_3_MM_M);
        let listed: Vec<String> = failed.map(|(w, worst)| format!("{w} ({:.1} mm)", 1e3 * worst)).collect();
        if !listed.is_empty() {
            table.note(format!(
                "`{FILTERED}` failed at {} lines{}, seed {}, {} answered late: windows {}",
                FEW_LINES[cell.row].lines,
                if cell.fast { ", fast" } else { "" },
                cell.seed,
                score.answered_late,
                listed.join(", ")
            ));
        }
    }
}

fn cell(context: &Context<'_>, job: (usize, bool, u64), factors: &[f64]) -> Result<Cell, ReproduceError> {
    let (row, fast, seed) = job;
    let rate = &RATES[row];
    let mut set = Set::than2015(context.models, "reduced", rate.phantom)?;
    set.scale_activity(factors[row]);
    let name = format!("few-lines-{}{}", rate.phantom, if fast { "-fast" } else { "" });
    let helix = Helix { times_faster: if fast { FAST } else { 1.0 } };
    let all = helix.windows(WINDOW_S);
    let path = Path {
        motion: &helix,
        window_s: WINDOW_S,
        first: 0,
        windows: context.size.pick(all, all.min(QUICK_WINDOWS)),
    };
    let followers = Estimators::new(&set).all(Budget::AtMost(BUDGET), MOTION_PRIOR);
    let led = case::lead(&set, path, &name, seed, followers)?;
    Ok(Cell { row, fast, seed, led, activity_factor: factors[row] })
}

/// The seeds of a row.
fn of(cells: &[Cell], row: usize, fast: bool) -> Vec<&Led> {
    cells.iter().filter(|c| c.row == row && c.fast == fast).map(|c| &c.led).collect()
}

fn describe(table: &mut Table, cells: &[Cell]) {
    let windows = cells.iter().find(|c| !c.fast).map_or(0, |c| c.led.scores[0].windows);
    table.set("path", format!("helix of 36 s, {windows} windows of 50 ms of {HELIX_RUNS} per seed"));
    table.set("scanner", "reduced, crystal centres as ends of lines, acollinearity 0.5 degrees");
    table.set("simulator", Source::MODE);
    table.set("motion prior", MOTION_PRIOR.in_words());
    for (row, published) in FEW_LINES.iter().enumerate() {
        let Some(first) = cells.iter().find(|c| c.row == row) else { continue };
        let lines = lines_per_window(&of(cells, row, false));
        let text =
            format!("{}, activity x {:.3}: {lines:.1} lines", RATES[row].phantom, first.activity_factor);
        table.set(&format!("{} lines", published.lines), text);
    }
    table.note(format!(
        "error: distance of a marker from its place in the middle of the window, only the two base markers interchangeable; windows \
         without a pose count as failed and keep the last pose in the means; windows before an estimator's first pose, \
         {MOST_HELD} at most, are answered late, from it"
    ));
    table.note(format!(
        "`{FILTERED}` has the lines as likelihood in a filter with a motion prior, one setting of process noise for the whole table; the \
         other estimators have no motion prior and start from their own last pose"
    ));
}

fn rows(table: &mut Table, cells: &[Cell], row: usize) {
    let FewLinesRow { lines, mean_mm, sd_mm, failures } = FEW_LINES[row];
    let of_row = of(cells, row, false);
    let relative = Tolerance::Relative(TOLERANCE);
    let mean = Row::new(format!("mean marker error at {lines} lines"), "mm", Some(mean_mm));
    let mean = per_seed(mean, &of_row, Score::mean_mm, false).goal(FILTERED, GOALS_MM[row]);
    table.rows.push(mean.judged(FILTERED, Sense::LowerIsBetter, relative, ""));
    if let Some(goal) = GOALS_ALONE_MM[row] {
        let alone = Row::new(format!("the same without motion prior at {lines} lines"), "mm", Some(mean_mm));
        let alone = per_seed(alone, &of_row, Score::mean_mm, false).goal(ALONE, goal);
        let why = "the source's tracker has no motion prior either; its line ends are probably not snapped to crystals";
        table.rows.push(alone.judged(ALONE, Sense::LowerIsBetter, relative, why));
    }
    let sd = Row::new(format!("standard deviation of it at {lines} lines"), "mm", Some(sd_mm));
    let sd = per_seed(sd, &of_row, Score::sd_mm, false);
    table.rows.push(sd.judged(FILTERED, Sense::LowerIsBetter, relative, ""));
    let windows = of_row.first().map_or(0, |led| led.scores[0].windows);
    // The published count is of 720 windows.
    let published = f64::from(failures) * windows as f64 / HELIX_RUNS as f64;
    let failed = Row::new(
        format!("windows of {windows} that failed (3 mm) at {lines} lines, worst seed"),
        "",
        Some(published),
    );
    let failed = per_seed(failed, &of_row, |s| s.failed_3_mm as f64, true).goal(FILTERED, 0.0);
    table.rows.push(failed.judged(FILTERED, Sense::LowerIsBetter, Tolerance::Absolute(0.0), ""));
    let others: [(&str, Figured); 5] = [
        ("windows that failed (5 mm, as chapter 6 counts)", |s| s.failed_5_mm as f64),
        ("windows that failed (section 5.5.1's check, as chapter 5 counts)", |s| s.failed_check as f64),
        ("windows without a pose, all of them among those that failed", |s| s.without_pose as f64),
        ("windows before the first pose, all of them among those that failed", |s| {
            s.before_first_pose as f64
        }),
        (ANSWERED_LATE, |s| s.answered_late as f64),
    ];
    for (what, value) in others {
        let other = Row::new(format!("{what}, at {lines} lines, worst seed"), "", None);
        let other = per_seed(other, &of_row, value, true);
        table.rows.push(other.not_comparable("table 4.3 counts by 3 mm and tells of no start"));
    }
}

fn fast_rows(table: &mut Table, cells: &[Cell], row: usize) {
    let lines = FEW_LINES[row].lines;
    let of_row = of(cells, row, true);
    let why = "the source gives no number for few lines and fast motion";
    let mean = Row::new(format!("mean marker error at {lines} lines, {FAST} times the speed"), "mm", None);
    let mut mean = per_seed(mean, &of_row, Score::mean_mm, false);
    if let Some(goal) = GOALS_FAST_MM[row] {
        mean = mean.goal(FILTERED, goal);
    }
    table.rows.push(mean.not_comparable(why));
    let windows = of_row.first().map_or(0, |led| led.scores[0].windows);
    let name = format!(
        "windows of {windows} that failed (3 mm) at {lines} lines, {FAST} times the speed, worst seed"
    );
    let failed = per_seed(Row::new(name, "", None), &of_row, |s| s.failed_3_mm as f64, true);
    table.rows.push(failed.goal(FILTERED, 0.0).not_comparable(why));
    let late = format!("{ANSWERED_LATE}, at {lines} lines, {FAST} times the speed, worst seed");
    let late = per_seed(Row::new(late, "", None), &of_row, |s| s.answered_late as f64, true);
    table.rows.push(late.not_comparable(why));
}

fn figures(cells: &[Cell]) -> Result<Vec<NamedFigure>, ReproduceError> {
    let slow = |row: usize| of(cells, row, false);
    let names = cells.first().map(|c| c.led.names.clone()).unwrap_or_default();
    let places = || Axis::categories("lines per window", FEW_LINES.iter().map(|r| r.lines.to_string()));
    let published: Vec<(f64, f64)> =
        FEW_LINES.iter().enumerate().map(|(k, r)| (k as f64, r.mean_mm)).collect();
    let mut errors = Panel::new(places(), Axis::logarithmic("mean marker error (mm)").at_least(0.2, 2.0))
        .with(Series::published("than2015, table 4.3").bars().points(&published));
    let failures: Vec<(f64, f64)> = FEW_LINES
        .iter()
        .enumerate()
        .map(|(k, r)| (k as f64, 100.0 * f64::from(r.failures) / HELIX_RUNS as f64))
        .collect();
    let mut failed = Panel::new(places(), Axis::linear("windows failed, 3 mm (%)"))
        .with(Series::published("than2015, table 4.3").bars().points(&failures));
    for (k, name) in names.iter().enumerate() {
        let over = |value: &dyn Fn(&Score) -> f64| -> Vec<(f64, f64)> {
            let one = |row: usize| {
                let values: Vec<f64> = slow(row).iter().map(|led| value(&led.scores[k])).collect();
                (row as f64, values.iter().sum::<f64>() / values.len() as f64)
            };
            (0..FEW_LINES.len()).map(one).collect()
        };
        errors = errors.with(Series::ours(k, name).bars().points(&over(&Score::mean_mm)));
        let share = |s: &Score| 100.0 * s.failed_3_mm as f64 / s.windows as f64;
        failed = failed.with(Series::ours(k, name).bars().points(&over(&share)));
    }
    let last = FEW_LINES.len() - 1;
    let fewest = format!("distribution-{}", FEW_LINES[last].lines);
    let bars = Figure::grid(vec![errors, failed], 2).to_svg()?;
    Ok(vec![NamedFigure { name: String::new(), svg: bars }, case::distribution(&fewest, &slow(last))?])
}
