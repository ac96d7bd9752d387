//! Transit times of each segment from its entrance, and of whole exams.
//!
//! A capsule that does not pass within the limit counts as slower than all that do: quantiles hold it, means and standard deviations are
//! then not told. First crossing of the segment's end by the capsule's centre, at the sampling of the stage.

use super::TUNED;
use super::person::{Cohort, Leg, Posture, SMALL_BOWEL, STOMACH};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_anatomy::segment::SegmentKey;
use lumenav_evaluation::summary::quantile_of_sorted;
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_scenario::engine::TOLERANCE_M;

const HOUR_S: f64 = 3600.0;
/// Units of transit times, and their length, s.
const SECONDS: (&str, f64) = ("s", 1.0);
const MINUTES: (&str, f64) = ("min", 60.0);
const HOURS: (&str, f64) = ("h", HOUR_S);

/// Persons per segment: full and quick.
const OESOPHAGI: (usize, usize) = (200, 30);
const STOMACHS: (usize, usize) = (200, 3);
const SMALL_BOWELS: (usize, usize) = (200, 1);
const COLONS: (usize, usize) = (20, 1);
const EXAMS: (usize, usize) = (10, 1);

const UPRIGHT: Leg = Leg {
    name: "oesophagus upright",
    posture: Posture::Upright,
    first: SegmentKey::Oesophagus,
    last: Some(SegmentKey::Oesophagus),
    limit_s: 600.0,
    every_s: 0.05,
};
const SUPINE: Leg = Leg { name: "oesophagus supine", posture: Posture::Supine, ..UPRIGHT };
const COLON: Leg = Leg {
    name: "colon",
    posture: Posture::Upright,
    first: SegmentKey::Caecum,
    last: None,
    limit_s: 72.0 * HOUR_S,
    every_s: 10.0,
};
const EXAM: Leg = Leg { name: "whole exam", first: SegmentKey::Oesophagus, limit_s: 96.0 * HOUR_S, ..COLON };

/// Transit times of one stage.
struct Stage {
    name: &'static str,
    unit: &'static str,
    /// Sorted, in `unit`; infinite where the limit came first.
    times: Vec<f64>,
}

impl Stage {
    /// Of so many persons along a leg.
    fn of(
        context: &Context<'_>,
        cohort: &Cohort,
        leg: &Leg,
        persons: usize,
        (unit, unit_s): (&'static str, f64),
    ) -> Result<Self, ReproduceError> {
        let mut times = cohort.pass(context, leg, persons, |_, passage| {
            passage.duration_s.map_or(f64::INFINITY, |duration_s| duration_s / unit_s)
        })?;
        times.sort_by(f64::total_cmp);
        Ok(Self { name: leg.name, unit, times })
    }

    fn mean(&self) -> f64 {
        self.times.iter().sum::<f64>() / self.times.len() as f64
    }

    fn deviation(&self) -> f64 {
        let mean = self.mean();
        let squares: f64 = self.times.iter().map(|t| (t - mean).powi(2)).sum();
        (squares / (self.times.len() as f64 - 1.0)).sqrt()
    }

    fn row(&self, what: &str, value: f64, published: f64, tolerance: Tolerance) -> Row {
        let quantity = format!("{}, {what}", self.name);
        let row = Row::new(quantity, self.unit, Some(published)).ours("lumenav", value);
        row.judged("lumenav", Sense::Match, tolerance, "")
    }

    /// A quantile, which may lie among those that did not pass.
    fn quantile(&self, p: f64) -> f64 {
        quantile_of_sorted(&self.times, p).filter(|q| !q.is_nan()).unwrap_or(f64::INFINITY)
    }

    fn unfinished(&self) -> Row {
        let count = self.times.iter().filter(|t| t.is_infinite()).count();
        let quantity = format!("{}, not passed within the limit, of {}", self.name, self.times.len());
        Row::new(quantity, "", Some(0.0)).ours("lumenav", count as f64).judged(
            "lumenav",
            Sense::LowerIsBetter,
            Tolerance::Absolute(0.02 * self.times.len() as f64),
            "the sources tell of people whose capsule passed",
        )
    }

    /// Slowest passage, for the reader.
    fn worst(&self) -> Row {
        let row = Row::new(format!("{}, slowest", self.name), self.unit, None);
        row.ours("lumenav", self.times.last().copied().unwrap_or(f64::NAN))
            .not_comparable("the sources tell none")
    }
}

/// What holds for all tables of this file.
fn set_up(context: &Context<'_>, table: &mut Table) -> Result<Cohort, ReproduceError> {
    let cohort = Cohort::open(context)?;
    table.set(
        "persons",
        "small woman, average man, large man in turn; each a trial with motility of its own, seeds in turn",
    );
    table.set("capsule", "11 x 26 mm, 3.3 g, starts 20 mm behind the segment's entrance; fasted and upright all the time unless the row says else (no meal, no night)");
    table.set("tuned", TUNED);
    Ok(cohort)
}

/// Oesophagus, stomach and small bowel.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let cohort = set_up(context, &mut table)?;
    let count = |(full, quick): (usize, usize)| context.size.pick(full, quick);
    let stage = |leg: &Leg, persons, unit| Stage::of(context, &cohort, leg, count(persons), unit);
    let upright = stage(&UPRIGHT, OESOPHAGI, SECONDS)?;
    let supine = stage(&SUPINE, OESOPHAGI, SECONDS)?;
    let stomach = stage(&STOMACH, STOMACHS, MINUTES)?;
    let bowel = stage(&SMALL_BOWEL, SMALL_BOWELS, MINUTES)?;
    oesophagus_rows(&mut table, &upright, &supine);
    if context.size.pick(true, false) {
        quartile_rows(&mut table, &stomach, [10.0, 22.0, 48.0], [0.35 * 10.0, 7.0, 0.35 * 48.0]);
        quartile_rows(&mut table, &bowel, [157.0, 198.0, 240.0], [0.2 * 157.0, 25.0, 0.2 * 240.0]);
        table.figures.push(figure(&[&upright, &supine, &stomach, &bowel])?);
    } else {
        for stage in [&stomach, &bowel] {
            few_row(&mut table, stage);
        }
    }
    table.note("colon and whole exams: gut/colon, gut/exam");
    Ok(table)
}

/// The colon.
pub(crate) fn run_colon(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let cohort = set_up(context, &mut table)?;
    let persons = context.size.pick(COLONS.0, COLONS.1);
    let colon = Stage::of(context, &cohort, &COLON, persons, HOURS)?;
    if context.size.pick(true, false) {
        // 16 to 29 h: the middle of it and half of its width.
        table.rows.push(colon.row("median", colon.quantile(0.5), 22.5, Tolerance::Absolute(6.5)));
        table.rows.extend([colon.unfinished(), colon.worst()]);
        table.figures.push(figure(&[&colon])?);
    } else {
        few_row(&mut table, &colon);
    }
    Ok(table)
}

/// Whole exams.
pub(crate) fn run_exam(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let cohort = set_up(context, &mut table)?;
    let persons = context.size.pick(EXAMS.0, EXAMS.1);
    let passages = cohort.pass(context, &EXAM, persons, |_, passage| {
        // A NaN is larger than all.
        let excess_m = passage.samples.iter().map(|sample| sample.excess_m);
        let worst_m = excess_m.max_by(f64::total_cmp).unwrap_or(f64::NAN);
        let time_h = passage.duration_s.map_or(f64::INFINITY, |duration_s| duration_s / HOUR_S);
        (time_h, worst_m, [passage.stalls.told, passage.stalls.untold])
    })?;
    let mut times: Vec<f64> = passages.iter().map(|passage| passage.0).collect();
    times.sort_by(f64::total_cmp);
    let exam = Stage { name: EXAM.name, unit: HOURS.0, times };
    let row = Row::new("whole exam, median", "h", None).ours("lumenav", exam.quantile(0.5));
    table.rows.push(row.not_comparable("the sum of the segments is no row of a source"));
    table.rows.extend([exam.unfinished(), exam.worst()]);
    let worst_m = passages.iter().map(|passage| passage.1).max_by(f64::total_cmp).unwrap_or(f64::NAN);
    table.rows.push(
        Row::new("furthest into the wall, every 10 s of all exams", "mm", Some(1e3 * TOLERANCE_M))
            .ours("lumenav", 1e3 * worst_m)
            .judged(
                "lumenav",
                Sense::LowerIsBetter,
                Tolerance::Absolute(0.0),
                "the wall gives way by 2 to 3 mm by design",
            ),
    );
    let [told, untold] = [0, 1].map(|k| passages.iter().map(|passage| passage.2[k]).sum::<u64>() as f64);
    let stalls = Row::new("stalls told", "", None).ours("lumenav", told);
    table.rows.push(stalls.not_comparable("the sources tell none"));
    table.rows.push(
        Row::new("stalls that nobody told (20 min within 5 mm), of all exams", "", Some(0.0))
            .ours("lumenav", untold)
            .judged("lumenav", Sense::LowerIsBetter, Tolerance::Absolute(0.0), "every stall is an event"),
    );
    Ok(table)
}

/// The median of too few to compare.
fn few_row(table: &mut Table, stage: &Stage) {
    let row = Row::new(format!("{}, median of {}", stage.name, stage.times.len()), stage.unit, None);
    table.rows.push(row.ours("lumenav", stage.quantile(0.5)).not_comparable("a few persons"));
}

fn oesophagus_rows(table: &mut Table, upright: &Stage, supine: &Stage) {
    table.rows.push(upright.row("mean", upright.mean(), 5.2, Tolerance::Absolute(1.0)));
    // 0.5 to 2 s and 5 to 14 s: the middle of it and half of its width.
    table.rows.push(upright.row("standard deviation", upright.deviation(), 1.25, Tolerance::Absolute(0.75)));
    table.rows.push(supine.row("mean", supine.mean(), 23.6, Tolerance::Absolute(4.0)));
    table.rows.push(supine.row("standard deviation", supine.deviation(), 9.5, Tolerance::Absolute(4.5)));
    table.rows.extend([upright.unfinished(), upright.worst(), supine.unfinished(), supine.worst()]);
}

fn quartile_rows(table: &mut Table, stage: &Stage, published: [f64; 3], tolerances: [f64; 3]) {
    let names = ["first quartile", "median", "third quartile"];
    for (k, name) in names.iter().enumerate() {
        let ours = stage.quantile(0.25 * (k + 1) as f64);
        table.rows.push(stage.row(name, ours, published[k], Tolerance::Absolute(tolerances[k])));
    }
    table.rows.extend([stage.unfinished(), stage.worst()]);
}

fn figure(stages: &[&Stage]) -> Result<NamedFigure, ReproduceError> {
    let panels = stages.iter().map(|stage| {
        let passed: Vec<f64> = stage.times.iter().copied().filter(|t| t.is_finite()).collect();
        let time = Axis::linear(&format!("transit time ({})", stage.unit));
        Panel::new(time, Axis::linear("share of persons").at_least(0.0, 1.0))
            .titled(stage.name)
            .with(Series::published("published").points(published(stage.name)))
            .with(Series::ours(0, "lumenav").line(0).distribution(&passed))
    });
    let svg = Figure::grid(panels.collect(), 2).to_svg()?;
    Ok(NamedFigure { name: String::new(), svg })
}

/// Published means, medians and quartiles of a leg, with the share of persons below.
fn published(leg: &str) -> &'static [(f64, f64)] {
    match leg {
        "oesophagus upright" => &[(5.2, 0.5)],
        "oesophagus supine" => &[(23.6, 0.5)],
        "stomach" => &[(10.0, 0.25), (22.0, 0.5), (48.0, 0.75)],
        "small bowel" => &[(157.0, 0.25), (198.0, 0.5), (240.0, 0.75)],
        // Medians of studies.
        "colon" => &[(16.0, 0.5), (29.0, 0.5)],
        _ => &[],
    }
}
