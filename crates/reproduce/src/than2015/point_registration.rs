//! Section 6.5: a rigid fit to the free markers of `fcm`, against the pose by least squares over the lines themselves.
//!
//! Free markers that sit wrong pull a rigid fit along; chapter 6 argues that the rigid body should enter where lines are shared out.
//! Reduced scanner, where lines are few, and the full ring.

use super::case::{self, Led, Path, per_seed};
use super::estimators::{Estimators, MotionPrior, REGISTERED, RIGID};
use super::motion::{Helix, Motion};
use super::published::WINDOW_S;
use super::scoring::Score;
use super::source::{Set, Source};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_pet::tracking::Budget;

/// Scanner, phantom, and what they are called.
const CASES: [(&str, &str, &str); 3] = [
    ("allegro", "water-20", "full ring, 20 cm"),
    ("reduced", "water-20", "reduced, 20 cm"),
    ("reduced", "water-30", "reduced, 30 cm"),
];
/// Lines that `fcm` and `rigid` take at most (than2015, section 4.3).
const BUDGET: usize = 210;
/// Windows of a quick run.
const QUICK_WINDOWS: usize = 12;

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let mut jobs = Vec::new();
    for case in 0..CASES.len() {
        jobs.extend(context.seeds.iter().map(|seed| (case, *seed)));
    }
    let helix = Helix { times_faster: 1.0 };
    let windows = context.size.pick(helix.windows(WINDOW_S), QUICK_WINDOWS);
    let path = Path { motion: &helix, window_s: WINDOW_S, first: 0, windows };
    let cells = context.jobs("point registration", jobs.len(), |k| one(context, path, jobs[k]))?;
    table.set("path", format!("helix of 36 s, {windows} windows of 50 ms per seed"));
    table.set("simulator", Source::MODE);
    table.set("lines", format!("at most {BUDGET} for `fcm` and `rigid`, all for the mixtures"));
    table.set("motion prior", MotionPrior::SLOW.in_words());
    table.note(case::late());
    for (case, (_, _, what)) in CASES.iter().enumerate() {
        let of_case: Vec<&Led> =
            jobs.iter().zip(&cells).filter(|((c, _), _)| *c == case).map(|(_, led)| led).collect();
        rows(&mut table, &of_case, what);
        table.figures.push(case::distribution(&what.replace([',', ' '], ""), &of_case)?);
    }
    Ok(table)
}

fn one(context: &Context<'_>, path: Path<'_>, (case, seed): (usize, u64)) -> Result<Led, ReproduceError> {
    let (scanner, phantom, _) = CASES[case];
    let set = Set::than2015(context.models, scanner, phantom)?;
    let estimators = Estimators::new(&set);
    let budget = Budget::AtMost(BUDGET);
    let mut followers = estimators.all(budget, MotionPrior::SLOW);
    followers.insert(1, estimators.registered(budget)?);
    case::lead(&set, path, &format!("registration-{scanner}-{phantom}"), seed, followers)
}

fn rows(table: &mut Table, runs: &[&Led], what: &str) {
    let mean =
        per_seed(Row::new(format!("mean marker error, {what}"), "mm", None), runs, Score::mean_mm, false);
    table.rows.push(mean.not_comparable("the source gives no number for this case"));
    let Some(first) = runs.first() else { return };
    let windows = first.scores[0].windows;
    let failed = Row::new(format!("windows of {windows} that failed (3 mm), {what}, worst seed"), "", None);
    let failed = per_seed(failed, runs, |s| s.failed_3_mm as f64, true);
    table.rows.push(failed.not_comparable("the source gives no number for this case"));
    // The claim: the ratio is below one.
    let place = |name: &str| first.names.iter().position(|n| n == name);
    let (Some(rigid), Some(registered)) = (place(RIGID), place(REGISTERED)) else { return };
    let ratios: Vec<f64> =
        runs.iter().map(|led| led.scores[rigid].mean_mm() / led.scores[registered].mean_mm()).collect();
    let claim =
        Row::new(format!("error of rigid over error of the registered points, {what}"), "", Some(1.0))
            .ours_mean("ratio", &ratios);
    let why = "the source argues that it is below 1";
    table.rows.push(claim.judged("ratio", Sense::LowerIsBetter, Tolerance::Absolute(0.0), why));
}
