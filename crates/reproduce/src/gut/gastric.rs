//! What the stomach's contractions do to a capsule that lies before the pylorus.
//!
//! Contractions are counted where they pass the middle of the antrum. Per period of their rate: the largest distance of two positions of the
//! capsule in that time, and the largest angle between two directions of its axis; of capsules within 60 mm of the pylorus.

use super::TUNED;
use super::person::{Cohort, Passage, STOMACH, end_m};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_anatomy::motility::Wave;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_evaluation::summary::quantile_of_sorted;

/// Persons: full and quick.
const PERSONS: (usize, usize) = (60, 3);
/// Where the motion is looked at, m before the pylorus.
const ANTRUM_M: f64 = 0.06;
/// Period of the contractions, in samples of a second: 3.1 per minute.
const PERIOD: usize = 19;
/// How long waves are counted, s.
const COUNTED_S: f64 = 3600.0;

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let cohort = Cohort::open(context)?;
    let persons = context.size.pick(PERSONS.0, PERSONS.1);
    let motions = cohort.pass(context, &STOMACH, persons, |person, passage| {
        motions(passage, end_m(cohort.tract(person), SegmentKey::Stomach))
    })?;
    let rates = context.jobs("contractions", persons, |person| rate_per_minute(&cohort, person))?;
    table.set("persons", format!("{persons} of the cohort of gut/transit, upright"));
    table.set("tuned", TUNED);
    let (ways_mm, turns_deg): (Vec<_>, Vec<_>) = motions.into_iter().unzip();
    let (mut ways_mm, mut turns_deg) = (ways_mm.concat(), turns_deg.concat());
    for values in [&mut ways_mm, &mut turns_deg] {
        values.sort_by(f64::total_cmp);
    }
    let rate = rates.iter().sum::<f64>() / rates.len() as f64;
    table.rows.push(Row::new("contractions", "per min", Some(3.1)).ours("lumenav", rate).judged(
        "lumenav",
        Sense::Match,
        Tolerance::Relative(0.1),
        "the rate is an input",
    ));
    let row = |name: String, unit: &str, values: &[f64], published: f64, tolerance: f64| {
        let ours = quantile_of_sorted(values, 0.5).unwrap_or(f64::NAN);
        Row::new(name, unit, Some(published)).ours("lumenav", ours).judged(
            "lumenav",
            Sense::Match,
            Tolerance::Absolute(tolerance),
            "",
        )
    };
    let n = ways_mm.len();
    // About 11 mm, 6 to 31 across people; 35 degrees, 4 to 85.
    table.rows.push(row(format!("motion per contraction, median of {n}"), "mm", &ways_mm, 11.0, 5.0));
    table.rows.push(row(format!("turn per contraction, median of {n}"), "deg", &turns_deg, 35.0, 31.0));
    Ok(table)
}

/// Largest distance (mm) and turn (degrees) per period while the capsule lies in the antrum.
fn motions(passage: &Passage, pylorus_m: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut ways_mm, mut turns_deg) = (Vec::new(), Vec::new());
    for period in passage.samples.chunks_exact(PERIOD) {
        if period.iter().any(|s| s.arc_length_m < pylorus_m - ANTRUM_M || s.arc_length_m > pylorus_m) {
            continue;
        }
        let (mut way_m, mut turn_rad) = (0.0_f64, 0.0_f64);
        for (k, a) in period.iter().enumerate() {
            for b in &period[k + 1..] {
                way_m = way_m.max((a.position_m - b.position_m).norm());
                turn_rad = turn_rad.max(a.axis.angle(&b.axis));
            }
        }
        ways_mm.push(1e3 * way_m);
        turns_deg.push(turn_rad.to_degrees());
    }
    (ways_mm, turns_deg)
}

/// Waves that pass the middle of the antrum, per minute.
fn rate_per_minute(cohort: &Cohort, person: usize) -> Result<f64, ReproduceError> {
    let mut motility = cohort.motility(person)?;
    let place_m = end_m(cohort.tract(person), SegmentKey::Stomach) - 0.5 * ANTRUM_M;
    let mut passes = 0;
    let mut time_s = 0.0;
    while time_s < COUNTED_S {
        let next_s = time_s + 1.0;
        motility.advance_to(time_s);
        let crosses = |wave: &&Wave| {
            let at = |t: f64| wave.at(t).centre_m;
            at(time_s) < place_m && at(next_s) >= place_m && wave.end_time_s() > next_s
        };
        passes += motility.active().iter().filter(crosses).count();
        time_s = next_s;
    }
    Ok(60.0 * passes as f64 / COUNTED_S)
}
