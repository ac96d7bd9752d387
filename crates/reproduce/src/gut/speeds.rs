//! Speeds of a capsule in the small bowel: it rests most of the time and moves in bursts.
//!
//! Way in a second along the centre line, of all seconds of a passage. The share of the way that the fastest twentieth of the seconds makes
//! was tuned to nothing.

use super::TUNED;
use super::person::{Cohort, Passage, SMALL_BOWEL};
use crate::ReproduceError;
use crate::context::Context;
use crate::table::{NamedFigure, Row, Table};
use crate::verdict::{Sense, Tolerance};
use lumenav_evaluation::summary::Quantiles;
use lumenav_figures::{Axis, Figure, Panel, Series};

/// Persons: full and quick.
const PERSONS: (usize, usize) = (30, 1);
/// Part of the time that makes the bursts.
const BURSTS: f64 = 0.05;

struct Speeds {
    /// Part of the way, to and fro, that the fastest part of the seconds makes.
    burst_share: f64,
    /// Part of the way that goes back.
    backward_share: f64,
    /// All speeds, mm/s.
    each_mm_s: Vec<f64>,
}

impl Speeds {
    fn of(passage: &Passage) -> Self {
        let steps: Vec<f64> = passage
            .samples
            .windows(2)
            .map(|pair| 1e3 * (pair[1].arc_length_m - pair[0].arc_length_m))
            .collect();
        let each_mm_s: Vec<f64> = steps.iter().map(|step| step.abs()).collect();
        let all: f64 = each_mm_s.iter().sum();
        let back: f64 = steps.iter().filter(|step| **step < 0.0).map(|step| -step).sum();
        let burst_share = each_mm_s.iter().copied().collect::<Quantiles>().share_of_largest(BURSTS);
        Self { burst_share: burst_share.unwrap_or(f64::NAN), backward_share: back / all, each_mm_s }
    }
}

/// Runs it.
pub(crate) fn run(context: &Context<'_>, mut table: Table) -> Result<Table, ReproduceError> {
    let cohort = Cohort::open(context)?;
    let persons = context.size.pick(PERSONS.0, PERSONS.1);
    let speeds = cohort.pass(context, &SMALL_BOWEL, persons, |_, passage| Speeds::of(passage))?;
    table.set("persons", format!("{persons} of the cohort of gut/transit"));
    table.set("speed", "way along the centre line in each second");
    table.set("tuned", TUNED);
    let mean = |of: &dyn Fn(&Speeds) -> f64| speeds.iter().map(of).sum::<f64>() / speeds.len() as f64;
    let least = speeds.iter().map(|s| s.burst_share).fold(f64::INFINITY, f64::min);
    let share = |name: &str, ours: f64| {
        Row::new(name, "", Some(0.5)).ours("lumenav", ours).claimed(
            "lumenav",
            Sense::HigherIsBetter,
            Tolerance::Absolute(0.0),
            "less than 5 % of the time makes more than half of the way",
        )
    };
    table
        .rows
        .push(share("part of the way that the fastest 5 % of the time make, mean", mean(&|s| s.burst_share)));
    table.rows.push(share("the same, least of all persons", least));
    let all: Vec<f64> = speeds.iter().flat_map(|s| s.each_mm_s.iter().copied()).collect();
    let resting = all.iter().filter(|v| **v < 0.05).count() as f64 / all.len() as f64;
    let open = |name: &str, unit: &str, ours: f64, why: &str| {
        Row::new(name, unit, None).ours("lumenav", ours).not_comparable(why)
    };
    table.rows.push(open(
        "part of the way that goes back",
        "",
        mean(&|s| s.backward_share),
        "believed: 0.1 to 0.2 of slow steps",
    ));
    table.rows.push(open("part of the time below 0.05 mm/s", "", resting, "no number given"));
    let thinned: Vec<f64> = thin(all);
    let panel =
        Panel::new(Axis::logarithmic("speed (mm/s)"), Axis::linear("share of the time").at_least(0.0, 1.0))
            .with(Series::ours(0, "lumenav, small bowel").line(0).distribution(&thinned));
    table.figures.push(NamedFigure { name: String::new(), svg: Figure::of(panel).to_svg()? });
    Ok(table)
}

/// A thousand quantiles, above zero: what a logarithmic axis can show.
fn thin(mut each_mm_s: Vec<f64>) -> Vec<f64> {
    each_mm_s.sort_by(f64::total_cmp);
    let step = (each_mm_s.len() / 1000).max(1);
    each_mm_s.into_iter().step_by(step).map(|v| v.max(1e-4)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::person::Sample;
    use super::super::stalls::StallAudit;
    use super::*;
    use lumenav_scenario::engine::EngineConfig;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn closed_form_one_burst_among_rests() {
        // 95 seconds of 0.1 mm, 5 seconds of 10 mm of which one goes back.
        let mut s = 0.0;
        let mut samples = Vec::new();
        for k in 0..=100 {
            samples.push(Sample {
                arc_length_m: s,
                position_m: Point3::origin(),
                axis: Vector3::x(),
                excess_m: 0.0,
            });
            s += match k {
                20 => -0.010,
                40 | 41 | 60 | 80 => 0.010,
                _ => 0.0001,
            };
        }
        let stalls = StallAudit::new(&EngineConfig::default(), 0.0);
        let speeds = Speeds::of(&Passage { duration_s: Some(100.0), samples, stalls });
        let all = 50.0 + 95.0 * 0.1;
        assert!((speeds.burst_share - 50.0 / all).abs() < 1e-9, "{}", speeds.burst_share);
        assert!((speeds.backward_share - 10.0 / all).abs() < 1e-9);
    }
}
