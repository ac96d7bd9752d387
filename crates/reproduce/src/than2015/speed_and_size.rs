//! Figure 4.12: faster capsules, thicker bodies.
//!
//! Full ring, the helix at one to eight times its speed (5 to 40 mm/s around), cylinders of 20, 30 and 40 cm.

use super::case::{self, Led, Path, per_seed};
use super::estimators::{ALONE, Estimators, FCM, FILTERED, MotionPrior, RIGID};
use super::motion::{Helix, Motion};
use super::published::{SPEEDS_MM_S, STATIC_CYLINDER, WINDOW_S};
use super::scoring::Score;
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_pet::tracking::Budget;

/// The bodies: name of the phantom and diameter, cm.
const BODIES: [(&str, u32); 3] = [("water-20", 20), ("water-30", 30), ("water-40", 40)];
/// Times the speed of the helix: 5, 10, 20, 40 mm/s around.
const TIMES: [u32; 4] = [1, 2, 4, 8];
/// Windows of a quick run.
const QUICK_WINDOWS: usize = 8;

struct Cell {
    body: usize,
    times: u32,
    led: Led,
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let mut jobs = Vec::new();
    for body in 0..BODIES.len() {
        for times in TIMES {
            jobs.extend(context.seeds.iter().map(|seed| (body, times, *seed)));
        }
    }
    let cells = context.jobs("speed and size", jobs.len(), |k| cell(context, jobs[k]))?;
    let budget = STATIC_CYLINDER.line_budget;
    table.set("path", "helix of 36 s, at one to eight times its speed, windows of 50 ms");
    table.set("scanner", "full ring, crystal centres as ends of lines");
    table.set("simulator", Source::MODE);
    table.set("lines", format!("at most {budget} for `fcm` and `rigid`, all for the mixtures"));
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(case::late());
    table.note("the source shows curves; what it states of them in words is judged: never lost, more error with size than with speed");
    for body in 0..BODIES.len() {
        for times in TIMES {
            rows(&mut table, &cells, body, times);
        }
    }
    claims(&mut table, &cells);
    table.figures.push(figure(&cells)?);
    Ok(table)
}

fn cell(context: &Context<'_>, (body, times, seed): (usize, u32, u64)) -> Result<Cell, ReproduceError> {
    let set = Set::than2015(context.models, "allegro", BODIES[body].0)?;
    let helix = Helix { times_faster: f64::from(times) };
    let all = helix.windows(WINDOW_S);
    let path = Path {
        motion: &helix,
        window_s: WINDOW_S,
        first: 0,
        windows: context.size.pick(all, all.min(QUICK_WINDOWS)),
    };
    let followers = Estimators::new(&set).all(Budget::AtMost(STATIC_CYLINDER.line_budget), MotionPrior::SLOW);
    let led = case::lead(&set, path, &format!("speed-{}-{times}", BODIES[body].0), seed, followers)?;
    Ok(Cell { body, times, led })
}

fn of(cells: &[Cell], body: usize, times: u32) -> Vec<&Led> {
    cells.iter().filter(|c| c.body == body && c.times == times).map(|c| &c.led).collect()
}

fn rows(table: &mut Table, cells: &[Cell], body: usize, times: u32) {
    let seeds = of(cells, body, times);
    let (speed, size) = (SPEEDS_MM_S[0] * f64::from(times), BODIES[body].1);
    let mean = Row::new(format!("mean marker error, {size} cm, {speed} mm/s"), "mm", None);
    let mean = per_seed(mean, &seeds, Score::mean_mm, false);
    table.rows.push(mean.not_comparable("the source shows a curve"));
    let windows = seeds.first().map_or(0, |led| led.scores[0].windows);
    let name = format!("windows of {windows} that failed (3 mm), {size} cm, {speed} mm/s, worst seed");
    let failed = per_seed(Row::new(name, "", None), &seeds, |s| s.failed_3_mm as f64, true);
    table.rows.push(failed.not_comparable("the source gives no count"));
}

/// What the source says in words.
fn claims(table: &mut Table, cells: &[Cell]) {
    let all: Vec<&Led> = cells.iter().map(|c| &c.led).collect();
    let lost = Row::new("runs that end lost (last window failed, 3 mm)", "", Some(0.0));
    let Some(first) = all.first() else { return };
    let lost = first.names.iter().enumerate().fold(lost, |row, (k, name)| {
        let ends = all.iter().filter(|led| led.scores[k].worst_m.last().is_none_or(|w| *w > 3e-3)).count();
        row.ours(name, ends as f64)
    });
    let why = "the source: never lost; all runs and seeds counted";
    table.rows.push(lost.judged(FCM, Sense::LowerIsBetter, Tolerance::Absolute(0.0), why));
    let times_over = |numerator: (usize, u32), denominator: (usize, u32), what: &str| {
        let (n, d) = (of(cells, numerator.0, numerator.1), of(cells, denominator.0, denominator.1));
        let names = [FCM, RIGID, ALONE, FILTERED];
        names.iter().enumerate().fold(Row::new(what, "", None), |row, (k, name)| {
            let mean =
                |all: &[&Led]| all.iter().map(|led| led.scores[k].mean_mm()).sum::<f64>() / all.len() as f64;
            row.ours(name, mean(&n) / mean(&d))
        })
    };
    let slow = TIMES[0];
    let fast = TIMES[TIMES.len() - 1];
    let by_speed = times_over((0, fast), (0, slow), "error at 40 over error at 5 mm/s, 20 cm");
    table.rows.push(by_speed.not_comparable("the source: slightly more error with speed"));
    let by_size = times_over((2, slow), (0, slow), "error at 40 cm over error at 20 cm, 5 mm/s");
    table.rows.push(by_size.not_comparable("the source: more error with size"));
}

fn figure(cells: &[Cell]) -> Result<NamedFigure, ReproduceError> {
    let mut panels = Vec::new();
    for (body, (_, size)) in BODIES.iter().enumerate() {
        let mut panel = Panel::new(
            Axis::linear("speed (mm/s)").at_least(0.0, SPEEDS_MM_S[1]),
            Axis::logarithmic("mean marker error (mm)").at_least(0.2, 2.0),
        )
        .titled(&format!("{size} cm"));
        let names = of(cells, body, TIMES[0]).first().map(|led| led.names.clone()).unwrap_or_default();
        for (k, name) in names.iter().enumerate() {
            let at = |times: &u32| {
                let seeds = of(cells, body, *times);
                let mean = seeds.iter().map(|led| led.scores[k].mean_mm()).sum::<f64>() / seeds.len() as f64;
                (SPEEDS_MM_S[0] * f64::from(*times), mean)
            };
            let points: Vec<(f64, f64)> = TIMES.iter().map(at).collect();
            panel = panel.with(Series::ours(k, name).line(k).points(&points));
        }
        panels.push(panel);
    }
    Ok(NamedFigure { name: String::new(), svg: Figure::grid(panels, 3).to_svg()? })
}
