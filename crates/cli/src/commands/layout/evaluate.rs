//! `layout evaluate`: the map of the bound over the workspace.

use super::{Job, Judged, Setting, map, scene, show};
use crate::args::Verbosity;
use crate::files;
use serde::Serialize;

/// Files that appear.
const FILES: [&str; 6] =
    ["evaluation.json", "map.csv", "map.svg", "map.rrd", "posterior.csv", "posterior.svg"];

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    setting: Setting,
    #[serde(flatten)]
    judged: Judged,
}

pub(super) fn evaluate(job: &Job<'_>) -> anyhow::Result<()> {
    let (opened, out) = (job.open()?, job.out());
    files::check_free(&out, &FILES, job.options.force)?;
    let elements = opened.model.elements();
    let (evaluation, judged) = job.judge(&opened, elements)?;
    let report = Report { setting: Setting::of(job, &opened), judged };
    let json = serde_json::to_string_pretty(&report)? + "\n";
    let mut texts = vec![(FILES[0], json.clone()), (FILES[1], map::csv(&opened.workspace, &evaluation))];
    // Positions along a tract are no grid: there is nothing to cut into slices.
    if let Some(svg) = map::svg(&opened.workspace, &evaluation, elements)? {
        texts.push((FILES[2], svg));
    }
    if let Some(posterior) = &report.judged.posterior {
        texts.push((FILES[4], map::posterior_csv(posterior)));
        texts.push((FILES[5], map::posterior_svg(posterior)?));
    }
    let mut written = files::write(&out, &texts)?;
    if let Some(still) = scene::still(&report.setting, &opened.workspace, &evaluation, elements) {
        still.write(&out.join(FILES[3]))?;
        written.push(out.join(FILES[3]));
    }
    if job.options.json {
        return crate::output::print(format_args!("{json}"));
    }
    if job.verbosity == Verbosity::Quiet {
        return Ok(());
    }
    say!("{}", show::head(&report.setting))?;
    say!("{}", show::table(&report.setting, &[("installed".to_owned(), &report.judged)]))?;
    let written: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
    say!("{}", written.join("  "))
}
