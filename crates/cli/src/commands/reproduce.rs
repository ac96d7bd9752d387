//! `lumenav reproduce`: published tables and figures, re-run.

use super::run::stop_on_ctrl_c;
use crate::args::{ReproduceOptions, Verbosity};
use crate::table;
use crate::threads::Threads;
use comfy_table::{ColumnConstraint, presets};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lumenav::reproduce::{Context, Progress, Size, all, check_free, find};
use std::io::IsTerminal as _;
use std::path::Path;
use std::sync::atomic::Ordering;

/// Lists reproductions, or runs one.
pub fn reproduce(options: &ReproduceOptions, verbosity: Verbosity) -> anyhow::Result<()> {
    let Some(id) = &options.id else { return list(options.json) };
    let reproduction = find(id).ok_or_else(|| anyhow::anyhow!("no reproduction `{id}`; see --list"))?;
    let (out, size) = (&options.out, if options.quick { Size::Quick } else { Size::Full });
    // Before the work, not after it.
    check_free(out, reproduction.id, options.force)?;
    let asked = options.seed.map_or_else(|| options.seeds.clone(), |seed| vec![seed]);
    let seeds = reproduction.seeds((!asked.is_empty()).then_some(&asked), size);
    let models = lumenav::models_folder(options.models.as_deref(), Path::new("reproduce"));
    let threads = Threads::new(options.threads)?;
    let stop = stop_on_ctrl_c();
    let stopped = || stop.load(Ordering::Relaxed);
    let bar = bar(verbosity);
    let show = |progress: Progress<'_>| {
        bar.set_length(progress.jobs as u64);
        bar.set_position(progress.done as u64);
        bar.set_message(progress.stage.to_owned());
    };
    let context = Context::new(&models, seeds, size, &threads).watched(&show).stoppable(&stopped);
    let table = reproduction.run(&context);
    bar.finish_and_clear();
    let table = table?;
    let files = table.write(out, options.force)?;
    if options.json {
        return crate::output::print(format_args!("{}", table.to_json()?));
    }
    if verbosity == Verbosity::Quiet {
        return Ok(());
    }
    say!("{}", table::of_reproduction(&table))?;
    let files: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    say!("{}", files.join("  "))
}

fn bar(verbosity: Verbosity) -> ProgressBar {
    let bar = ProgressBar::new(0);
    if verbosity == Verbosity::Quiet || !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    // A constant that parses; should it not, the default style does.
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

fn list(json: bool) -> anyhow::Result<()> {
    if json {
        let one = |r: &lumenav::reproduce::Reproduction| serde_json::json!({ "id": r.id, "source": r.source, "about": r.about, "seeds": r.default_seeds });
        return crate::output::json(&all().iter().map(one).collect::<Vec<_>>());
    }
    let mut table = table::fitting(presets::NOTHING);
    table.set_header(["id", "source", "what"]);
    for reproduction in all() {
        table.add_row([reproduction.id, reproduction.source, reproduction.about]);
    }
    // An id is there to be copied.
    if let Some(column) = table.column_mut(0) {
        column.set_constraint(ColumnConstraint::ContentWidth);
    }
    say!("{table}")
}
