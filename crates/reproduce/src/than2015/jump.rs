//! Figure 4.11: the capsule jumps by 50 mm at run 300.
//!
//! Full ring, cylinder of 20 cm. `fcm` runs twice, with and without the failure prediction of section 3.4.4; without it the tracker
//! looks for its markers where they were.

use super::estimators::{Estimators, FCM, FILTERED, MotionPrior};
use super::follow::{Alone, Follower, Run};
use super::motion::{Helix, Jump};
use super::published::{HELIX_RUNS, JUMP_MM, JUMP_RUN, STATIC_CYLINDER, WINDOW_S};
use super::scoring::{FAILED_3_MM_M, Score};
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_pet::tracking::{Budget, ClassicOptions, Fcm};
use nalgebra::Vector3;

/// Runs before and after the jump: full size and quick.
const AROUND: [usize; 2] = [60, 10];
const AROUND_AFTER: [usize; 2] = [120, 10];
/// Name of `fcm` without failure prediction.
const BLIND: &str = "fcm, no prediction";

struct Jumped {
    names: Vec<String>,
    scores: Vec<Score>,
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let before = context.size.pick(AROUND[0], AROUND[1]);
    let after = context.size.pick(AROUND_AFTER[0], AROUND_AFTER[1]);
    let seeds = &context.seeds;
    let runs = context.jobs("jump", seeds.len(), |k| one(context, seeds[k], before, after))?;
    table.set("path", format!("helix of 36 s; {JUMP_MM} mm along +y at the start of run {JUMP_RUN}"));
    table.set("runs", format!("{} to {} of {HELIX_RUNS}", JUMP_RUN - before, JUMP_RUN + after - 1));
    table.set("scanner", "full ring, cylinder of 20 cm");
    table.set("simulator", Source::MODE);
    table.set(
        "lines",
        format!("at most {} for each tracker, all for `{FILTERED}`", STATIC_CYLINDER.line_budget),
    );
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(format!(
        "`{FILTERED}` is told of a jump by its lines alone: its motion prior knows of none, so the filter has to give its belief up first"
    ));
    rows(&mut table, &runs, before);
    table.figures.push(figure(&runs, before)?);
    Ok(table)
}

fn one(context: &Context<'_>, seed: u64, before: usize, after: usize) -> Result<Jumped, ReproduceError> {
    let set = Set::than2015(context.models, "allegro", "water-20")?;
    let estimators = Estimators::new(&set);
    let budget = Budget::AtMost(STATIC_CYLINDER.line_budget);
    let blind = ClassicOptions { budget, predict_failures: false, ..ClassicOptions::default() };
    let blind: Box<dyn Follower> = Box::new(Alone::named(Box::new(Fcm::new(&set.markers, blind)), BLIND));
    let mut followers = vec![
        estimators.fcm(budget, true),
        blind,
        estimators.rigid(budget),
        estimators.alone(budget),
        estimators.filtered(Budget::All, MotionPrior::SLOW),
    ];
    let motion = Jump {
        along: Helix { times_faster: 1.0 },
        at_s: JUMP_RUN as f64 * WINDOW_S,
        by_world_m: Vector3::y() * (JUMP_MM * 1e-3),
    };
    let mut source = Source::new(&set, seed, "jump");
    let run = Run {
        motion: &motion,
        window_s: WINDOW_S,
        first: JUMP_RUN - before,
        windows: before + after,
        markers_capsule_m: set.markers_capsule_m()?,
    };
    let names = followers.iter().map(|f| f.name().to_owned()).collect();
    let scores = run.lead(&mut followers, |sequence, start_s, lines| {
        source.window(&motion, start_s, WINDOW_S, sequence, lines);
        Ok(())
    })?;
    Ok(Jumped { names, scores })
}

/// Runs after the jump before all markers are within 3 mm for the first time; all of them where that never happens.
fn lost_for(worst_m: &[f64], before: usize) -> usize {
    let after = &worst_m[before..];
    after.iter().position(|worst| *worst <= FAILED_3_MM_M).unwrap_or(after.len())
}

fn rows(table: &mut Table, runs: &[Jumped], before: usize) {
    let Some(first) = runs.first() else { return };
    let fill = |row: Row, value: &dyn Fn(&Score) -> f64| {
        first.names.iter().enumerate().fold(row, |row, (k, name)| {
            row.ours_worst(name, &runs.iter().map(|run| value(&run.scores[k])).collect::<Vec<_>>())
        })
    };
    let back =
        Row::new("runs from the jump to the first with all markers within 3 mm, worst seed", "", Some(1.0));
    let back = fill(back, &|s| lost_for(&s.worst_m, before) as f64).goal(FCM, 1.0);
    let why = "0: already the first window after the jump is right; the source: back within one run with failure prediction";
    table.rows.push(back.judged(FCM, Sense::LowerIsBetter, Tolerance::Absolute(0.0), why));
    let at_end = |s: &Score| f64::from(u8::from(s.worst_m.last().is_none_or(|worst| *worst > FAILED_3_MM_M)));
    let lost = fill(Row::new("lost at the end (1: yes), without failure prediction", "", Some(1.0)), &at_end);
    let why = "the source: lost without failure prediction; the other estimators are to be 0";
    table.rows.push(lost.judged(BLIND, Sense::Match, Tolerance::Absolute(0.0), why));
    let after_jump =
        |s: &Score| s.worst_m[before..].iter().filter(|worst| **worst <= FAILED_3_MM_M).count() as f64;
    let found = fill(Row::new("windows after the jump that are right, worst seed", "", None), &after_jump);
    table.rows.push(found.goal(BLIND, 0.0).not_comparable("without failure prediction none is to be"));
    let failed =
        |s: &Score| s.worst_m[before..].iter().filter(|worst| **worst > FAILED_3_MM_M).count() as f64;
    let name = format!(
        "windows of {} after the jump that failed (3 mm), worst seed",
        first.scores[0].windows - before
    );
    let after = fill(Row::new(name, "", None), &failed);
    table.rows.push(after.not_comparable("not available: the source shows a curve"));
}

fn figure(runs: &[Jumped], before: usize) -> Result<NamedFigure, ReproduceError> {
    let mut panel =
        Panel::new(Axis::linear("time after the jump (s)"), Axis::logarithmic("worst marker (mm)"));
    if let Some(run) = runs.first() {
        for (k, name) in run.names.iter().enumerate() {
            let at = |(window, worst): (usize, &f64)| {
                ((window as f64 - before as f64 + 0.5) * WINDOW_S, worst * 1e3)
            };
            let points: Vec<(f64, f64)> = run.scores[k].worst_m.iter().enumerate().map(at).collect();
            panel = panel.with(Series::ours(k, name).line(k).points(&points));
        }
    }
    let svg = Figure::of(panel).panel_size(640, 260).to_svg()?;
    Ok(NamedFigure { name: String::new(), svg })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_runs_until_the_capsule_is_found_again() {
        assert_eq!(lost_for(&[0.001, 0.001, 0.050, 0.001], 2), 1);
        assert_eq!(lost_for(&[0.001, 0.001, 0.002, 0.001], 2), 0);
        assert_eq!(lost_for(&[0.001, 0.001, 0.050, f64::INFINITY], 2), 2);
    }
}
