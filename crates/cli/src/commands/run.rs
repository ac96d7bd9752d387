//! `lumenav run`: one run, or many trials of it.

use crate::args::{Record, RunOptions, Verbosity};
use crate::progress::Progress;
use crate::table;
use anyhow::{Context as _, bail};
use lumenav::pipeline::{Observers, RunError, RunObserver, RunSummary, simulate};
use lumenav::recording::{RecorderOptions, RrdRecorder};
use lumenav::report::{
    Metrics, RunWriter, Timing, Trials, TrialsCollector, WriterOptions, read_json, write_trials,
};
use lumenav::scenario::ScenarioFile;
use lumenav::{check, default_registry, open_scenario, stage};
use rayon::prelude::*;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The first Ctrl-C asks the run to stop; the second ends the program.
pub fn stop_on_ctrl_c() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let handler = stop.clone();
    // Without a handler Ctrl-C still ends the program; nothing half-written is left under its final name.
    let _ = ctrlc::set_handler(move || {
        if handler.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    });
    stop
}

/// Runs a scenario.
pub fn run(options: &RunOptions, verbosity: Verbosity) -> anyhow::Result<()> {
    let file = open_scenario(&options.scenario, &options.set, options.models.as_deref())?;
    let seed = options.seed.unwrap_or(file.scenario.seed);
    if options.dry_run {
        check(&file, &default_registry())?;
        if verbosity == Verbosity::Normal {
            println!("{}: nothing wrong found", options.scenario.display());
        }
        return Ok(());
    }
    let out = options.out.clone().unwrap_or_else(|| default_folder(&file, seed));
    let stop = stop_on_ctrl_c();
    if options.trials > 1 {
        return run_trials(&file, seed, &out, options, verbosity, &stop);
    }
    refuse_existing(&out, options.force)?;
    let visible = verbosity == Verbosity::Normal && std::io::stderr().is_terminal();
    let mut progress = Progress::new(visible);
    let (folder, metrics) = one_run(&file, seed, 0, &out, options, &mut progress, &stop)?;
    print_result(&folder, &metrics, options.json, verbosity)
}

/// `out/<scenario>-<seed>`.
pub fn default_folder(file: &ScenarioFile, seed: u64) -> PathBuf {
    Path::new("out").join(format!("{}-{seed}", file.scenario.name))
}

/// Says at once, before hours of work, that a folder is in the way.
pub fn refuse_existing(out: &Path, force: bool) -> anyhow::Result<()> {
    if out.exists() && !force {
        bail!("{} exists already; give another --out, or --force to replace it", out.display());
    }
    Ok(())
}

/// Prints the table (or JSON) and what was written where.
pub fn print_result(
    folder: &Path,
    metrics: &Metrics,
    json: bool,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    if json {
        println!("{}", serde_json::to_string_pretty(metrics)?);
        return Ok(());
    }
    if verbosity == Verbosity::Quiet {
        return Ok(());
    }
    let timing: Option<Timing> = read_json(&folder.join("timing.json")).ok();
    println!("{}", table::of_run(metrics, timing.as_ref()));
    println!("wrote {}:", folder.display());
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .with_context(|| format!("cannot list {}", folder.display()))?
        .filter_map(Result::ok)
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    println!("  {}", names.join("  "));
    Ok(())
}

fn one_run(
    file: &ScenarioFile,
    seed: u64,
    trial: u64,
    out: &Path,
    options: &RunOptions,
    progress: &mut dyn RunObserver,
    stop: &AtomicBool,
) -> anyhow::Result<(PathBuf, Metrics)> {
    let begin = std::time::Instant::now();
    let built = stage(file, seed, trial)?;
    let mut writer = RunWriter::create(
        out,
        WriterOptions {
            replace: options.force,
            save_readings: options.save_readings,
            command_line: std::env::args().collect(),
        },
    )?;
    writer.add_stage("build_world", begin.elapsed());
    let record_options = RecorderOptions { full: options.record == Record::Full };
    let mut recorder = match options.record {
        Record::None => None,
        _ => Some(RrdRecorder::to_file(&writer.path().join("recording.rrd"), record_options)?),
    };
    let mut viewer = match &options.connect {
        Some(address) => Some(RrdRecorder::to_viewer(address, record_options)?),
        None => None,
    };
    simulate_with(file, seed, trial, built, &mut writer, &mut recorder, &mut viewer, progress, stop)?;
    let metrics = writer.metrics().cloned().context("the run left no metrics")?;
    Ok((writer.commit()?, metrics))
}

#[expect(clippy::too_many_arguments, reason = "the observers of one run, each of its own type")]
fn simulate_with(
    file: &ScenarioFile,
    seed: u64,
    trial: u64,
    built: lumenav::pipeline::Stage,
    writer: &mut RunWriter,
    recorder: &mut Option<RrdRecorder>,
    viewer: &mut Option<RrdRecorder>,
    progress: &mut dyn RunObserver,
    stop: &AtomicBool,
) -> Result<RunSummary, RunError> {
    let mut all: Vec<&mut dyn RunObserver> = vec![writer];
    all.extend(recorder.iter_mut().map(|r| r as &mut dyn RunObserver));
    all.extend(viewer.iter_mut().map(|r| r as &mut dyn RunObserver));
    all.push(progress);
    let mut observers = Observers::new(all);
    simulate(file, &default_registry(), seed, trial, built, &mut observers, &|| stop.load(Ordering::Relaxed))
}

/// Independent trials in parallel, each in a folder of its own; trial k is the same alone or among others.
fn run_trials(
    file: &ScenarioFile,
    seed: u64,
    out: &Path,
    options: &RunOptions,
    verbosity: Verbosity,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    refuse_existing(out, options.force)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads.unwrap_or(0)).build()?;
    let bar = indicatif::ProgressBar::new(options.trials);
    if verbosity == Verbosity::Quiet || !std::io::stderr().is_terminal() {
        bar.set_draw_target(indicatif::ProgressDrawTarget::hidden());
    }
    // A recording per trial would fill a disk: trials keep numbers, a single run keeps pictures.
    let options = RunOptions { record: Record::None, connect: None, ..options.clone() };
    let results: Vec<anyhow::Result<Metrics>> = pool.install(|| {
        (0..options.trials as usize)
            .into_par_iter()
            .with_max_len(1)
            .map(|trial| {
                let trial = trial as u64;
                let folder = trial_folder(out, trial);
                let done = one_run(file, seed, trial, &folder, &options, &mut Progress::new(false), stop);
                bar.inc(1);
                done.map(|(_, metrics)| metrics).with_context(|| format!("trial {trial}"))
            })
            .collect()
    });
    bar.finish_and_clear();
    let mut collector = TrialsCollector::default();
    let mut failures = Vec::new();
    for (trial, result) in results.into_iter().enumerate() {
        match result {
            Ok(metrics) => collector.push(&metrics, &trial_folder(out, trial as u64))?,
            Err(error) => {
                collector.push_failed();
                failures.push(error);
            }
        }
    }
    if failures.len() < options.trials as usize {
        let trials = collector.finish()?;
        write_trials(out, &trials)?;
        print_trials(&trials, out, options.json, verbosity)?;
    }
    match failures.into_iter().next() {
        Some(first) => Err(first),
        None => Ok(()),
    }
}

/// `OUT/trials/NNN`.
fn trial_folder(out: &Path, trial: u64) -> PathBuf {
    out.join("trials").join(format!("{trial:03}"))
}

fn print_trials(trials: &Trials, out: &Path, json: bool, verbosity: Verbosity) -> anyhow::Result<()> {
    if json {
        println!("{}", serde_json::to_string_pretty(trials)?);
    } else if verbosity == Verbosity::Normal {
        println!("{}", table::of_trials(trials));
        let last = trials.trials - 1;
        let (seed, failed, out) = (trials.seed, trials.failed, out.display());
        println!("seed {seed}, trials 0 to {last}; {failed} failed; wrote {out}: trials.json  trials/");
    }
    Ok(())
}
