//! `lumenav run --trials n`: independent trials in parallel, each in a folder of its own.
//!
//! Trial k is the same alone or among others, so that trials that were stopped go on with the same command: those whose
//! folders hold the very same run are used again, the others are computed. A folder with other trials in it is refused, or
//! with `--force` put aside as a whole before the first trial and removed when the new ones stand: old and new trials never stand
//! side by side.

use super::run::Job;
use crate::args::Verbosity;
use crate::exit::{Unexpected, was_stopped};
use crate::progress::Progress;
use crate::table;
use anyhow::{Context as _, bail};
use lumenav::core::SimTime;
use lumenav::pipeline::RunError;
use lumenav::report::{
    Manifest, Metrics, Trials, TrialsCollector, check_replaceable, read_json, write_trials,
};
use rayon::prelude::*;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Runs the trials and says what they add up to.
pub fn run_trials(job: &Job<'_>, out: &Path, verbosity: Verbosity) -> anyhow::Result<()> {
    let count = job.options.trials;
    prepare(job, out)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(job.options.threads.unwrap_or(0)).build()?;
    let bar = indicatif::ProgressBar::new(count);
    if verbosity == Verbosity::Quiet || !std::io::stderr().is_terminal() {
        bar.set_draw_target(indicatif::ProgressDrawTarget::hidden());
    }
    let results: Vec<anyhow::Result<Metrics>> = pool.install(|| {
        (0..count as usize)
            .into_par_iter()
            .with_max_len(1)
            .map(|trial| {
                let done = one(job, out, trial as u64).with_context(|| format!("trial {trial}"));
                bar.inc(1);
                done
            })
            .collect()
    });
    bar.finish_and_clear();
    finish(job, out, results, verbosity)
}

/// `OUT/trials/NNN`.
fn trial_folder(out: &Path, trial: u64) -> PathBuf {
    out.join("trials").join(format!("{trial:03}"))
}

/// The metrics of a trial that is there already and is the one that would be computed.
fn finished(job: &Job<'_>, folder: &Path, trial: u64) -> anyhow::Result<Option<Metrics>> {
    let Ok(manifest) = read_json::<Manifest>(&folder.join("manifest.json")) else { return Ok(None) };
    let same = manifest.first_difference(&job.manifest(trial)?).is_none() && manifest.is_whole(folder);
    Ok(if same { read_json(&folder.join("metrics.json")).ok() } else { None })
}

/// Makes room: nothing there, trials of this very run to go on from, or (forced) what was there is removed.
fn prepare(job: &Job<'_>, out: &Path) -> anyhow::Result<()> {
    if out.symlink_metadata().is_err() {
        return Ok(());
    }
    check_replaceable(out)?;
    if job.options.force {
        return put_aside(out);
    }
    let refuse = |why: &str| -> anyhow::Result<()> {
        bail!("{} {why}; give another --out, or --force to replace it", out.display())
    };
    let mut entries: Vec<PathBuf> = Vec::new();
    for folder in [out.to_path_buf(), out.join("trials")] {
        let Ok(inside) = std::fs::read_dir(&folder) else { continue };
        entries.extend(inside.filter_map(Result::ok).map(|entry| entry.path()));
    }
    for path in entries {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let in_trials = path.parent().is_some_and(|parent| parent.ends_with("trials"));
        if !in_trials {
            if name != "trials" && name != "trials.json" {
                return refuse("exists already and holds something else than trials");
            }
            continue;
        }
        if name.starts_with('.') {
            // What a killed run was filling: it has no name and never will.
            std::fs::remove_dir_all(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            continue;
        }
        match name.parse::<u64>() {
            Ok(trial) if trial >= job.options.trials => {
                return refuse("exists already and holds more trials than are asked for");
            }
            Ok(trial) if finished(job, &path, trial)?.is_some() => {}
            _ => return refuse("exists already and holds other trials"),
        }
    }
    complain!("{} holds trials of this very run; those that are finished are used again", out.display());
    Ok(())
}

/// Where the trials that `--force` replaces wait until the new ones stand.
fn aside(out: &Path) -> PathBuf {
    let name = out.file_name().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!(".{name}.replaced"))
}

/// Renames what is to be replaced; it is removed when the new trials stand, and kept where they fail.
fn put_aside(out: &Path) -> anyhow::Result<()> {
    let aside = aside(out);
    if aside.exists() {
        std::fs::remove_dir_all(&aside).with_context(|| format!("cannot remove {}", aside.display()))?;
    }
    std::fs::rename(out, &aside).with_context(|| format!("cannot put {} aside", out.display()))
}

/// One trial: read where it is finished, else computed.
fn one(job: &Job<'_>, out: &Path, trial: u64) -> anyhow::Result<Metrics> {
    let folder = trial_folder(out, trial);
    if let Some(metrics) = finished(job, &folder, trial)? {
        return Ok(metrics);
    }
    // Before a world is built: thousands of trials may be waiting.
    if job.stop.load(Ordering::Relaxed) {
        return Err(RunError::Stopped { at: SimTime::ZERO }.into());
    }
    job.run(trial, &folder, false, &mut Progress::new(false))?;
    // Read back, as those that were finished before are: a number in JSON may lose its last bit.
    Ok(read_json(&folder.join("metrics.json"))?)
}

fn finish(
    job: &Job<'_>,
    out: &Path,
    results: Vec<anyhow::Result<Metrics>>,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let count = results.len();
    let stopped = results.iter().filter_map(|r| r.as_ref().err()).any(was_stopped);
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
    let done = count - failures.len();
    if stopped {
        complain!(
            "stopped: {done} of {count} trials are finished and kept in {}; the same command goes on from there",
            out.join("trials").display()
        );
    } else if done > 0 {
        let trials = collector.finish()?;
        write_trials(out, &trials)?;
        let old = aside(out);
        if old.exists() {
            std::fs::remove_dir_all(&old).with_context(|| format!("cannot remove {}", old.display()))?;
        }
        print_trials(&trials, out, job.options.json, verbosity)?;
        if failures.is_empty() {
            return as_expected(&trials);
        }
    }
    match failures.into_iter().next() {
        Some(first) => Err(first),
        None => Ok(()),
    }
}

/// What is asked of every trial; the table above has said which trials are not so.
fn as_expected(trials: &Trials) -> anyhow::Result<()> {
    let unmet = trials.expected.iter().filter(|over| !over.unmet.is_empty()).count();
    if unmet == 0 {
        return Ok(());
    }
    let asked = trials.expected.len();
    Err(Unexpected(format!("{unmet} of {asked} expectations are not met in every trial")).into())
}

fn print_trials(trials: &Trials, out: &Path, json: bool, verbosity: Verbosity) -> anyhow::Result<()> {
    if json {
        return crate::output::json(trials);
    }
    if verbosity == Verbosity::Quiet {
        return Ok(());
    }
    say!("{}", table::of_trials(trials))?;
    let last = trials.trials - 1;
    let (seed, failed, out) = (trials.seed, trials.failed, out.display());
    say!("seed {seed}, trials 0 to {last}; {failed} failed; {out}: trials.json  trials/")
}
