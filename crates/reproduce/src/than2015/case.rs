//! A case: a set-up, a path and estimators, run once per seed; and its scores as rows of a table.

use super::follow::{Follower, MOST_HELD, Run};
use super::motion::Motion;
use super::scoring::Score;
use super::source::{Set, Source, Tally};
use crate::ReproduceError;
use crate::table::{NamedFigure, Row};
use lumenav_figures::{Axis, Figure, Panel, Series};

/// Where a case goes, in windows of which length, and how many of them are looked at.
#[derive(Clone, Copy)]
pub struct Path<'a> {
    /// Where the capsule goes.
    pub motion: &'a dyn Motion,
    /// Length of a window, s.
    pub window_s: f64,
    /// The first window that is looked at.
    pub first: usize,
    /// How many windows are looked at.
    pub windows: usize,
}

/// What came of one seed.
pub struct Led {
    /// The estimators.
    pub names: Vec<String>,
    /// Their scores, in the same order.
    pub scores: Vec<Score>,
    /// What the lines were.
    pub tally: Tally,
}

/// What every table of followed windows must say.
pub fn late() -> String {
    format!(
        "up to {MOST_HELD} windows before an estimator's first pose are answered late, from that pose; windows without a pose count as failed"
    )
}

/// A figure of a score.
pub type Figured = fn(&Score) -> f64;

/// Leads estimators along a path. `stream` names the random streams: cases of different names see different decays.
///
/// # Errors
/// What an estimator says.
pub fn lead(
    set: &Set,
    path: Path<'_>,
    stream: &str,
    seed: u64,
    mut followers: Vec<Box<dyn Follower>>,
) -> Result<Led, ReproduceError> {
    let mut source = Source::new(set, seed, stream);
    let run = Run {
        motion: path.motion,
        window_s: path.window_s,
        first: path.first,
        windows: path.windows,
        markers_capsule_m: set.markers_capsule_m()?,
    };
    let names = followers.iter().map(|f| f.name().to_owned()).collect();
    let scores = run.lead(&mut followers, |sequence, start_s, lines| {
        source.window(path.motion, start_s, path.window_s, sequence, lines);
        Ok(())
    })?;
    Ok(Led { names, scores, tally: source.tally() })
}

/// A figure of all estimators per seed: the row shows its mean, or its worst.
pub fn per_seed(row: Row, seeds: &[&Led], value: impl Fn(&Score) -> f64, worst: bool) -> Row {
    let Some(first) = seeds.first() else { return row };
    first.names.iter().enumerate().fold(row, |row, (k, name)| {
        let values: Vec<f64> = seeds.iter().map(|led| value(&led.scores[k])).collect();
        if worst { row.ours_worst(name, &values) } else { row.ours_mean(name, &values) }
    })
}

/// Lines per window over the seeds.
pub fn lines_per_window(seeds: &[&Led]) -> f64 {
    let windows: usize = seeds.iter().map(|led| led.scores[0].windows).sum();
    seeds.iter().map(|led| led.tally.lines as f64).sum::<f64>() / windows as f64
}

/// True lines of a hundred, over the seeds.
pub fn true_percent(seeds: &[&Led]) -> f64 {
    let lines: u64 = seeds.iter().map(|led| led.tally.lines).sum();
    100.0 * seeds.iter().map(|led| led.tally.true_lines as f64).sum::<f64>() / lines as f64
}

/// Distribution of the worst marker of each window, all seeds together.
///
/// # Errors
/// A figure that cannot be drawn.
pub fn distribution(name: &str, seeds: &[&Led]) -> Result<NamedFigure, ReproduceError> {
    let mut panel = Panel::new(
        Axis::logarithmic("worst marker of a window (mm)"),
        Axis::linear("share of windows").at_least(0.0, 1.0),
    );
    for (k, estimator) in seeds.first().map(|led| led.names.clone()).unwrap_or_default().iter().enumerate() {
        // Beyond 20 mm a capsule is lost; how far does not matter.
        let shown: Vec<f64> = seeds
            .iter()
            .flat_map(|led| led.scores[k].worst_m.iter().map(|e| e * 1e3))
            .map(|e| if e < 20.0 { e } else { f64::INFINITY })
            .collect();
        panel = panel.with(Series::ours(k, estimator).line(k).distribution(&shown));
    }
    Ok(NamedFigure { name: name.to_owned(), svg: Figure::of(panel).to_svg()? })
}
