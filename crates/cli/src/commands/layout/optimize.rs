//! `layout optimize`: a layout that is better, as a file that `run` takes.

use super::{Job, Judged, Setting, command, show};
use crate::args::Verbosity;
use crate::files;
use anyhow::bail;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lumenav::OpenedLayout;
use lumenav::core::Node;
use lumenav::layouts::LayoutError;
use lumenav::layouts::optimize::exchange::choose;
use lumenav::layouts::optimize::moving::shift;
use lumenav::layouts::optimize::relaxation::lower_bound;
use lumenav::layouts::optimize::{Found, Question};
use serde::Serialize;
use std::io::IsTerminal as _;

const FILES: [&str; 2] = ["array.toml", "optimization.json"];

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    setting: Setting,
    criterion: String,
    unit: String,
    seed: u64,
    /// Starts that ended, and where the best one stood among them.
    starts: usize,
    best_start: usize,
    /// The criterion at the end of every start.
    of_starts: Vec<f64>,
    /// Candidates that could be chosen; absent where elements moved.
    #[serde(skip_serializing_if = "Option::is_none")]
    candidates: Option<usize>,
    /// Candidates left out because they give no reading at some pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    unusable_candidates: Option<usize>,
    /// Candidates left out because a mirror image of them is missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    unpaired_candidates: Option<usize>,
    /// The criterion of the layout as installed; absent: infinite.
    installed: Option<f64>,
    /// That of the layout found.
    found: f64,
    /// What no choice of as many candidates can beat; absent where there is no such bound.
    #[serde(skip_serializing_if = "Option::is_none")]
    lower_bound: Option<f64>,
    /// Whether it was stopped before all starts had ended.
    stopped: bool,
    before: Judged,
    after: Judged,
}

/// A layout, and how good any could be.
struct Result {
    found: Found,
    /// Candidates that could be chosen; those that could not, and those without a mirror image.
    candidates: Option<[usize; 3]>,
    lower_bound: Option<f64>,
}

pub(super) fn optimize(job: &Job<'_>) -> anyhow::Result<()> {
    let (opened, out) = (job.open()?, job.out());
    files::check_free(&out, &FILES, job.options.force)?;
    let search = &opened.study.search;
    let question = Question {
        sites: search.sites.clone(),
        seed: search.seed,
        starts: search.starts,
        ..Question::new(&*opened.model, &opened.workspace, search.criterion)
    };
    let result = search_for(job, &opened, &question)?;
    let stopped = job.is_stopped();
    // Judged to the end even if the search was stopped: a layout without its figures is of no use.
    job.stop.store(false, std::sync::atomic::Ordering::Relaxed);
    let report = report(job, &opened, &question, &result, stopped)?;
    let name = format!("{}-optimized", job.file.scenario.name);
    let source = format!("`{}` ({} = {:.4} {})", command(), report.criterion, report.found, report.unit);
    let Some(array) = opened.model.to_toml(&name, &source, &result.found.elements) else {
        bail!("layouts of modality `{}` have no file of their own", report.setting.modality);
    };
    let json = serde_json::to_string_pretty(&report)? + "\n";
    let written = files::write(&out, &[(FILES[0], array), (FILES[1], json.clone())])?;
    if job.options.json {
        crate::output::print(format_args!("{json}"))?;
    } else if job.verbosity != Verbosity::Quiet {
        tell(&report)?;
        let written: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
        say!("{}", written.join("  "))?;
    }
    if stopped { Err(LayoutError::Interrupted.into()) } else { Ok(()) }
}

fn search_for(job: &Job<'_>, opened: &OpenedLayout, question: &Question<'_>) -> anyhow::Result<Result> {
    // Before anything is asked for that such a sensor cannot have.
    question.check_independent()?;
    let bar = bar(job.verbosity, question.starts);
    let criterion = question.criterion;
    let watch = |done: usize, f: f64| {
        bar.set_position(done as u64);
        bar.set_message(format!("best {:.4} {}", criterion.shown(f), criterion.unit()));
    };
    let stopped = || job.is_stopped();
    let search = &opened.study.search;
    let table = opened.study.node.child_or_empty("optimize");
    if let Some(ranges) = &search.ranges {
        let found =
            shift(question, ranges, &job.threads, &watch, &stopped).map_err(|e| in_table(e, &table))?;
        bar.finish_and_clear();
        return Ok(Result { found, candidates: None, lower_bound: None });
    }
    if opened.model.candidates().is_empty() {
        let message = "nothing to choose from and nothing that moves; give `candidates` in [layout.model], or a range such as x_mm = [-250, 250] here";
        return Err(table.error(message).into());
    }
    let count = search.count.unwrap_or(opened.model.elements().len());
    let chosen = choose(question, count, &job.threads, &watch, &stopped).map_err(|e| in_table(e, &table))?;
    let bound = lower_bound(&chosen.table, &opened.model.prior(), chosen.orbits, criterion, &stopped);
    bar.finish_and_clear();
    Ok(Result {
        found: chosen.found,
        candidates: Some([chosen.candidates, chosen.unusable, chosen.unpaired]),
        lower_bound: bound,
    })
}

/// What cannot be, with the table that asks for it.
fn in_table(error: LayoutError, table: &Node) -> LayoutError {
    match error {
        LayoutError::Impossible(why) => table.error(&why).into(),
        other => other,
    }
}

fn report(
    job: &Job<'_>,
    opened: &OpenedLayout,
    question: &Question<'_>,
    result: &Result,
    stopped: bool,
) -> anyhow::Result<Report> {
    let criterion = question.criterion;
    let shown = |f: f64| Some(criterion.shown(f)).filter(|v| v.is_finite());
    Ok(Report {
        setting: Setting::of(job, opened),
        criterion: criterion.name().to_owned(),
        unit: criterion.unit().to_owned(),
        seed: question.seed,
        starts: result.found.all_f.len(),
        best_start: result.found.start,
        of_starts: result.found.all_f.iter().map(|f| criterion.shown(*f)).collect(),
        candidates: result.candidates.map(|[usable, ..]| usable),
        unusable_candidates: result.candidates.map(|[_, unusable, _]| unusable),
        unpaired_candidates: result.candidates.map(|[.., unpaired]| unpaired),
        installed: shown(question.value(opened.model.elements())),
        found: criterion.shown(result.found.f),
        lower_bound: result.lower_bound,
        stopped,
        before: job.judge(opened, opened.model.elements())?.1,
        after: job.judge(opened, &result.found.elements)?.1,
    })
}

fn tell(report: &Report) -> anyhow::Result<()> {
    say!("{}", show::head(&report.setting))?;
    let columns = [("installed".to_owned(), &report.before), ("found".to_owned(), &report.after)];
    say!("{}", show::table(&report.setting, &columns))?;
    let stopped = if report.stopped { "; stopped, the best so far" } else { "" };
    say!(
        "{} {:.4} {} (start {}, {} starts came to a layout{stopped})",
        report.criterion,
        report.found,
        report.unit,
        report.best_start + 1,
        report.starts
    )?;
    if let Some(unusable) = report.unusable_candidates.filter(|n| *n > 0) {
        say!(
            "{unusable} candidates left out: they give no reading at some pose (saturated, or in the magnet) or stand where nothing may"
        )?;
    }
    if let Some(unpaired) = report.unpaired_candidates.filter(|n| *n > 0) {
        say!(
            "{unpaired} candidates left out: they have no full set of mirror images (missing, nearer than the spacing, or themselves on the plane)"
        )?;
    }
    match report.lower_bound {
        Some(bound) if report.unit == "mm" => say!(
            "no choice of as many of the {} candidates gets below {bound:.4} mm: at most {:.1} % to gain",
            report.candidates.unwrap_or_default(),
            100.0 * (1.0 - bound / report.found)
        ),
        Some(bound) => say!("no choice of as many candidates gets below {bound:.4} {}", report.unit),
        None => say!("how far from optimal this is, is not known: no lower bound for this search"),
    }
}

fn bar(verbosity: Verbosity, starts: usize) -> ProgressBar {
    let bar = ProgressBar::new(starts as u64);
    if verbosity == Verbosity::Quiet || !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let style = ProgressStyle::with_template("{pos}/{len} starts {wide_bar} {msg}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
