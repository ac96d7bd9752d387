//! `layout compare`: the scenario's own layout and its alternatives, cost against accuracy.

use super::{Job, Judged, Setting, map, show};
use crate::args::Verbosity;
use crate::files;
use anyhow::Context as _;
use lumenav::open_scenario;
use serde::Serialize;

const FILES: [&str; 2] = ["comparison.json", "pareto.svg"];

#[derive(Serialize)]
struct Compared {
    name: String,
    /// What it replaces in the scenario.
    set: Vec<String>,
    /// Whether no other layout is as cheap and as accurate (rms), and better in one of them.
    on_the_pareto_front: bool,
    #[serde(flatten)]
    judged: Judged,
}

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    setting: Setting,
    layouts: Vec<Compared>,
}

pub(super) fn compare(job: &Job<'_>) -> anyhow::Result<()> {
    let (opened, out) = (job.open()?, job.out());
    files::check_free(&out, &FILES, job.options.force)?;
    let mut layouts =
        vec![(opened.sensor.to_string(), Vec::new(), job.judge(&opened, opened.model.elements())?.1)];
    for alternative in &opened.study.alternatives {
        let set: Vec<String> = job.options.set.iter().chain(&alternative.set).cloned().collect();
        let named = || {
            format!("in [[layout.alternative]] `{}` of {}", alternative.name, job.options.scenario.display())
        };
        let file =
            open_scenario(&job.options.scenario, &set, job.options.models.as_deref()).with_context(named)?;
        let other = job.open_of(&file).with_context(named)?;
        let judged = job.judge(&other, other.model.elements())?.1;
        layouts.push((alternative.name.clone(), alternative.set.clone(), judged));
    }
    let front = pareto(&layouts.iter().map(|(.., j)| (j.summary.cost, j.summary.rms_mm)).collect::<Vec<_>>());
    let layouts: Vec<Compared> = layouts
        .into_iter()
        .zip(front)
        .map(|((name, set, judged), on_the_pareto_front)| Compared { name, set, on_the_pareto_front, judged })
        .collect();
    let report = Report { setting: Setting::of(job, &opened), layouts };
    let json = serde_json::to_string_pretty(&report)? + "\n";
    let points: Vec<(&str, f64, Option<f64>)> = report
        .layouts
        .iter()
        .map(|l| (l.name.as_str(), l.judged.summary.cost, l.judged.summary.rms_mm))
        .collect();
    let mut texts = vec![(FILES[0], json.clone())];
    if let Some(svg) = map::pareto_svg(&report.setting.cost_unit, &points)? {
        texts.push((FILES[1], svg));
    }
    let written = files::write(&out, &texts)?;
    if job.options.json {
        return crate::output::print(format_args!("{json}"));
    }
    if job.verbosity == Verbosity::Quiet {
        return Ok(());
    }
    say!("{}", show::head(&report.setting))?;
    let columns: Vec<(String, &Judged)> = report
        .layouts
        .iter()
        .map(|l| (if l.on_the_pareto_front { format!("{} *", l.name) } else { l.name.clone() }, &l.judged))
        .collect();
    say!("{}", show::compared(&report.setting, &columns))?;
    say!("* no other layout is as cheap and as accurate (rms)")?;
    let written: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    say!("{}", written.join("  "))
}

/// Which of the pairs of cost and error no other one beats; an infinite error is on no front.
fn pareto(layouts: &[(f64, Option<f64>)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let known = |l: &(f64, Option<f64>)| l.1.map(|error| (l.0, error));
    layouts
        .iter()
        .map(|l| known(l).is_some_and(|l| !layouts.iter().filter_map(known).any(|other| beats(&other, &l))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_front() {
        let layouts =
            [(16.0, Some(2.0)), (16.0, Some(1.0)), (32.0, Some(1.5)), (48.0, Some(0.5)), (8.0, None)];
        assert_eq!(pareto(&layouts), [false, true, false, true, false]);
        assert_eq!(pareto(&[(1.0, Some(1.0)), (1.0, Some(1.0))]), [true, true]);
    }
}
