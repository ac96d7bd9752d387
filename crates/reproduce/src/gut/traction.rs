//! The force with which contractions of the jejunum pull at a body that is held.
//!
//! A capsule is held at its place along a straight jejunum of 7.5 mm by a spring so stiff that it gives way by less than a millimetre, while the
//! drawn contractions of phase II, phase III or a meal run over it. An event is a stretch of time in which the aboral force is above 20 mN; its
//! value is the peak.

use super::TUNED;
use super::person::CAPSULE;
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility::meal::MealConfig;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::{End, Tract, TractDraft};
use lumenav_core::RandomStreams;
use lumenav_core::config::quantity::{Fraction, NonNegative};
use lumenav_figures::{Axis, Figure, Panel, Series};
use lumenav_scenario::engine::{Engine, EngineConfig};
use nalgebra::Vector3;
use std::sync::Arc;

/// Runs of ten minutes per phase: full and quick.
const RUNS: (usize, usize) = (20, 1);
const RUN_S: f64 = 600.0;
const RADIUS_M: f64 = 0.0075;
const PLACE_M: f64 = 0.4;
/// The spring that holds, N/m and N s/m.
const HOLD_NEWTON_PER_M: f64 = 100.0;
const HOLD_NEWTON_S_PER_M: f64 = 0.3;
/// Above this a pull is an event, N.
const EVENT_N: f64 = 0.02;

/// Part of the full rate in phases II and III, `None` while a meal is digested; published traction, mN.
const STATES: [(&str, Option<f64>, f64); 3] =
    [("phase II", Some(0.2), 74.0), ("phase III", Some(1.0), 91.0), ("fed", None, 58.0)];

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let runs = context.size.pick(RUNS.0, RUNS.1);
    let seed = context.seeds.first().copied().unwrap_or(1);
    table.set("set-up", format!("capsule of 11 x 26 mm held by {HOLD_NEWTON_PER_M} N/m in a straight jejunum of 7.5 mm; {runs} runs of 10 min per state"));
    table.set("event", "aboral force above 20 mN; its peak");
    table.set("tuned", TUNED);
    let mut panel = Panel::new(
        Axis::linear("peak of the aboral force (mN)"),
        Axis::linear("share of the events").at_least(0.0, 1.0),
    );
    for (k, (name, rate, published_mn)) in STATES.into_iter().enumerate() {
        let peaks = context.jobs(name, runs, |run| peaks_n(seed, run as u64, rate))?;
        let mut all_mn: Vec<f64> = peaks.into_iter().flatten().map(|n| 1e3 * n).collect();
        all_mn.sort_by(f64::total_cmp);
        let mean = all_mn.iter().sum::<f64>() / all_mn.len() as f64;
        let per_minute = all_mn.len() as f64 / (runs as f64 * RUN_S / 60.0);
        let quantity = format!("mean traction per event, {name}, {} events", all_mn.len());
        // What was tuned to its number is no test of it.
        table.rows.push(if rate.is_some() {
            let row = Row::new(quantity, "mN", Some(published_mn)).ours("lumenav", mean);
            row.judged("lumenav", Sense::Match, Tolerance::Relative(0.25), "58 to 91 mN over all states")
        } else {
            let row = Row::new(quantity, "mN", None).ours("lumenav", mean);
            row.not_comparable(&format!("tuned to the published {published_mn} mN"))
        });
        let row = Row::new(format!("events, {name}"), "per min", (k == 0).then_some(2.5))
            .ours("lumenav", per_minute);
        table.rows.push(if k == 0 {
            row.judged(
                "lumenav",
                Sense::Match,
                Tolerance::Relative(0.3),
                "the rate of contractions is an input, that of pulls is not",
            )
        } else {
            row.not_comparable("no number given")
        });
        panel = panel.with(Series::ours(k, name).line(k).distribution(&all_mn));
    }
    table.note("published, phase III pulls harder than phase II (91, 74 mN); here every contraction is drawn alike, and in phase III more are cut short");
    table.figures.push(NamedFigure { name: String::new(), svg: Figure::of(panel).to_svg()? });
    Ok(table)
}

fn jejunum() -> Result<Arc<Tract>, ReproduceError> {
    let draft = TractDraft::straight(SegmentKey::Jejunum, RADIUS_M, 0.8, (End::Closed, End::Exit));
    Ok(Arc::new(draft.build().map_err(ReproduceError::of_part("jejunum"))?.0))
}

/// Peaks of the aboral force of all events of a run, N.
fn peaks_n(seed: u64, run: u64, rate: Option<f64>) -> Result<Vec<f64>, ReproduceError> {
    let tract = jejunum()?;
    let mut config = MotilityConfig::default();
    match rate {
        Some(rate) => config.mmc.rate_factor = [Fraction(rate); 3],
        None => config.meal.push(MealConfig::default()),
    }
    let streams = RandomStreams::new(seed, run, "traction");
    let motility = Motility::new(&config, &tract, &streams).map_err(ReproduceError::of_part("jejunum"))?;
    let config =
        EngineConfig { start_arc_length_m: NonNegative(PLACE_M), sleep: false, ..EngineConfig::default() };
    let steps = (RUN_S * f64::from(config.step_rate_hz)) as u64;
    let mut engine =
        Engine::new(config, tract, motility, CAPSULE).map_err(ReproduceError::of_part("jejunum"))?;
    let mut peaks = Vec::new();
    let mut peak: f64 = 0.0;
    for _ in 0..steps {
        engine.step();
        let state = engine.state();
        let away_m = state.world_from_capsule.translation.vector.z - PLACE_M;
        let hold_n = -HOLD_NEWTON_PER_M * away_m - HOLD_NEWTON_S_PER_M * state.velocity_world_m_s.z;
        engine.apply_wrench(&Vector3::new(0.0, 0.0, hold_n), &Vector3::zeros());
        if -hold_n > EVENT_N {
            peak = peak.max(-hold_n);
        } else if peak > 0.0 {
            peaks.push(std::mem::take(&mut peak));
        }
    }
    Ok(peaks)
}
