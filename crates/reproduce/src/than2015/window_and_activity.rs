//! Section 4.5: how long a window, how much activity?
//!
//! Full ring, cylinder of 20 cm, the helix. A longer window and more activity both bring lines; a longer window also smears the
//! capsule's way. The line budget is lifted: it would hide what is asked.

use super::case::{self, Led, Path, lines_per_window, per_seed};
use super::estimators::{Estimators, MotionPrior, START_WINDOWS};
use super::motion::{Helix, Motion};
use super::scoring::Score;
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_pet::tracking::Budget;

/// Windows, ms.
const WINDOWS_MS: [f64; 4] = [10.0, 20.0, 50.0, 100.0];
/// Activity of each marker over 1.85 MBq.
const ACTIVITIES: [f64; 3] = [0.1, 0.3, 1.0];
/// Activity of each marker in table 4.2, MBq.
const NOMINAL_MBQ: f64 = 1.85;
/// At most so many windows of a case: 36 s in windows of 50 ms.
const MOST_WINDOWS: usize = 720;
/// Windows of a quick run: with the fewest lines the mixtures start after as many as they may wait for.
const QUICK_WINDOWS: usize = START_WINDOWS + 4;

struct Cell {
    window: usize,
    activity: usize,
    led: Led,
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let mut jobs = Vec::new();
    for window in 0..WINDOWS_MS.len() {
        for activity in 0..ACTIVITIES.len() {
            jobs.extend(context.seeds.iter().map(|seed| (window, activity, *seed)));
        }
    }
    let cells = context.jobs("window and activity", jobs.len(), |k| cell(context, jobs[k]))?;
    table.set("path", "helix of 36 s, its first 720 windows at most");
    table.set("scanner", "full ring, cylinder of 20 cm, crystal centres as ends of lines");
    table.set("simulator", Source::MODE);
    table.set("lines", "all, no budget");
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(case::late());
    for activity in 0..ACTIVITIES.len() {
        for window in 0..WINDOWS_MS.len() {
            rows(&mut table, &cells, window, activity);
        }
    }
    table.figures.push(figure(&cells)?);
    Ok(table)
}

fn cell(
    context: &Context<'_>,
    (window, activity, seed): (usize, usize, u64),
) -> Result<Cell, ReproduceError> {
    let mut set = Set::than2015(context.models, "allegro", "water-20")?;
    set.scale_activity(ACTIVITIES[activity]);
    let helix = Helix { times_faster: 1.0 };
    let window_s = 1e-3 * WINDOWS_MS[window];
    let all = helix.windows(window_s).min(MOST_WINDOWS);
    let path = Path { motion: &helix, window_s, first: 0, windows: context.size.pick(all, QUICK_WINDOWS) };
    let followers = Estimators::new(&set).all(Budget::All, MotionPrior::SLOW);
    let led = case::lead(&set, path, &format!("window-{window}-{activity}"), seed, followers)?;
    Ok(Cell { window, activity, led })
}

fn of(cells: &[Cell], window: usize, activity: usize) -> Vec<&Led> {
    cells.iter().filter(|c| c.window == window && c.activity == activity).map(|c| &c.led).collect()
}

fn rows(table: &mut Table, cells: &[Cell], window: usize, activity: usize) {
    let seeds = of(cells, window, activity);
    let (ms, mbq) = (WINDOWS_MS[window], NOMINAL_MBQ * ACTIVITIES[activity]);
    let what = format!("{ms} ms, 3 x {mbq:.3} MBq ({:.0} lines)", lines_per_window(&seeds));
    let mean =
        per_seed(Row::new(format!("mean marker error, {what}"), "mm", None), &seeds, Score::mean_mm, false);
    table.rows.push(mean.not_comparable("the source shows curves"));
    let count = seeds.first().map_or(0, |led| led.scores[0].windows);
    let name = format!("windows of {count} that failed (3 mm), {what}, worst seed");
    let failed = per_seed(Row::new(name, "", None), &seeds, |s| s.failed_3_mm as f64, true);
    table.rows.push(failed.not_comparable("the source gives no count"));
}

fn figure(cells: &[Cell]) -> Result<NamedFigure, ReproduceError> {
    let mut panels = Vec::new();
    for (activity, factor) in ACTIVITIES.iter().enumerate() {
        let mut panel = Panel::new(
            Axis::logarithmic("window (ms)"),
            Axis::logarithmic("mean marker error (mm)").at_least(0.1, 5.0),
        )
        .titled(&format!("3 x {:.3} MBq", NOMINAL_MBQ * factor));
        let names = of(cells, 0, activity).first().map(|led| led.names.clone()).unwrap_or_default();
        for (k, name) in names.iter().enumerate() {
            let at = |window: usize| {
                let seeds = of(cells, window, activity);
                let mean = seeds.iter().map(|led| led.scores[k].mean_mm()).sum::<f64>() / seeds.len() as f64;
                (WINDOWS_MS[window], mean)
            };
            let points: Vec<(f64, f64)> =
                (0..WINDOWS_MS.len()).map(at).filter(|(_, mean)| mean.is_finite()).collect();
            panel = panel.with(Series::ours(k, name).line(k).points(&points));
        }
        panels.push(panel);
    }
    Ok(NamedFigure { name: String::new(), svg: Figure::grid(panels, 3).to_svg()? })
}
