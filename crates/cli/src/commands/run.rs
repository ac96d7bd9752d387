//! `lumenav run`: one run, or many trials of it (see `trials`).

use crate::args::{Record, RunOptions, Verbosity};
use crate::exit::Unexpected;
use crate::progress::Progress;
use crate::provenance;
use crate::table;
use anyhow::{Context as _, bail};
use lumenav::core::Registry;
use lumenav::core::time::NANOSECONDS_PER_SECOND;
use lumenav::pipeline::{Checkpoints, Observers, RunObserver, Stage, build, simulate};
use lumenav::recording::{RecorderOptions, RrdRecorder};
use lumenav::report::{
    Manifest, Metrics, Provenance, RunWriter, Timing, WriterOptions, check_replaceable, fingerprint,
    read_json,
};
use lumenav::scenario::ScenarioFile;
use lumenav::{check, open_scenario, stage};
use std::collections::{BTreeMap, BTreeSet};
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
pub fn run(options: &RunOptions, registry: &Registry, verbosity: Verbosity) -> anyhow::Result<()> {
    let file = open_scenario(&options.scenario, &options.set, options.models.as_deref())?;
    let seed = options.seed.unwrap_or(file.scenario.seed);
    // Everything is built once: what is wrong is said before anything is touched, and every file that is read is known.
    check(&file, registry)?;
    if options.dry_run {
        if verbosity != Verbosity::Quiet {
            say!("{}: nothing wrong found", options.scenario.display())?;
        }
        return Ok(());
    }
    let out = options.out.clone().unwrap_or_else(|| {
        let folder = default_folder(&file, seed);
        // Trials beside the single run, not in its way.
        if options.trials > 1 { folder.with_added_extension("trials") } else { folder }
    });
    let stop = stop_on_ctrl_c();
    // A recording per trial would fill a disk: trials keep numbers, a single run keeps pictures.
    let record = if options.trials > 1 { Record::None } else { options.record };
    let mut provenance = provenance::of_program(record, options.save_readings);
    provenance.inputs = provenance::inputs(&file.node)?;
    say_inputs(&provenance, verbosity);
    let checkpoints = options.checkpoints.as_deref().map(|folder| kept_in(folder, options)).transpose()?;
    let job = Job { file: &file, registry, seed, options, record, provenance, checkpoints, stop: &stop };
    if options.trials > 1 {
        return super::trials::run_trials(&job, &out, verbosity);
    }
    if let Place::Same(metrics) = look_at_place(&out, options.force, &job.manifest(0)?)? {
        return print_result(&out, &metrics, options.json, verbosity);
    }
    let visible = verbosity != Verbosity::Quiet && std::io::stderr().is_terminal();
    let mut progress = Progress::new(visible);
    let (folder, metrics) =
        job.run(0, &out, options.force, &mut progress).inspect_err(|_| say_if_stopped(&stop))?;
    print_result(&folder, &metrics, options.json, verbosity)
}

/// States of worlds in a folder: those of this very program, for another one may step a world otherwise.
fn kept_in(folder: &Path, options: &RunOptions) -> anyhow::Result<Checkpoints> {
    let program = std::env::current_exe().context("this program's own file")?;
    let program = fingerprint(&program).context("this program's own file")?.sha256;
    let every_ns = i64::from(options.checkpoint_every) * NANOSECONDS_PER_SECOND;
    Ok(Checkpoints::new(folder, program.get(..16).unwrap_or(&program), every_ns))
}

/// What a stopped run leaves, and how to start again.
pub fn say_if_stopped(stop: &AtomicBool) {
    if stop.load(Ordering::Relaxed) {
        complain!(
            "stopped: nothing of this run is kept; the same command starts it again from the beginning"
        );
    }
}

/// With `-v`, the files that are read.
pub fn say_inputs(provenance: &Provenance, verbosity: Verbosity) {
    if verbosity == Verbosity::Verbose {
        for (path, sha256) in &provenance.inputs {
            complain!("reads {path} (sha256 {})", sha256.get(..12).unwrap_or(sha256));
        }
    }
}

/// What stands where a run is to be written.
pub enum Place {
    /// Nothing, or something that may be replaced.
    Free,
    /// The very same run, whole.
    Same(Box<Metrics>),
}

/// Says at once, before hours of work, that a folder is in the way; or that the work is done already.
pub fn look_at_place(out: &Path, force: bool, planned: &Manifest) -> anyhow::Result<Place> {
    if out.symlink_metadata().is_err() {
        return Ok(Place::Free);
    }
    if force {
        check_replaceable(out)?;
        return Ok(Place::Free);
    }
    let why = match (read_json::<Manifest>(&out.join("manifest.json")), read_json(&out.join("metrics.json")))
    {
        (Ok(manifest), Ok(metrics)) => match manifest.first_difference(planned) {
            None if manifest.is_whole(out) => {
                complain!("{} holds this very run already; nothing was computed again", out.display());
                return Ok(Place::Same(Box::new(metrics)));
            }
            None => " (this very run, but some of its files are missing or changed)".to_owned(),
            Some(difference) => match differing_keys(&manifest, planned) {
                Some(keys) => format!(" (a run with another scenario: {keys})"),
                None => format!(" (a run with {difference})"),
            },
        },
        _ => String::new(),
    };
    bail!(
        "{} exists already{why}; keep it and give this run another --out, or replace it with --force",
        out.display()
    );
}

/// Keys told where two scenarios differ; the others are counted.
const MOST_KEYS: usize = 5;

/// In which keys the scenario of the run that is there differs from the one that is wanted; `None` where it does not.
fn differing_keys(there: &Manifest, wanted: &Manifest) -> Option<String> {
    let flat = |manifest: &Manifest| {
        let mut keys = BTreeMap::new();
        let table: toml::Table = manifest.scenario_toml.parse().ok()?;
        flatten("", &toml::Value::Table(table), &mut keys);
        Some(keys)
    };
    let (there, wanted) = (flat(there)?, flat(wanted)?);
    let all: BTreeSet<&String> = there.keys().chain(wanted.keys()).collect();
    let said = |keys: &BTreeMap<String, String>, key: &str| {
        keys.get(key).map_or("not set", String::as_str).to_owned()
    };
    let mut differing: Vec<String> = all
        .into_iter()
        .filter(|key| there.get(*key) != wanted.get(*key))
        .map(|key| format!("{key} is {} there, {} now", said(&there, key), said(&wanted, key)))
        .collect();
    let more = differing.len().saturating_sub(MOST_KEYS);
    differing.truncate(MOST_KEYS);
    if more > 0 {
        differing.push(format!("and {more} more keys"));
    }
    (!differing.is_empty()).then(|| differing.join("; "))
}

/// Every value of a table under its dotted key; entries of an array of tables by their name, or else by their place.
fn flatten(path: &str, value: &toml::Value, keys: &mut BTreeMap<String, String>) {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        toml::Value::Table(table) => {
            table.iter().for_each(|(key, inner)| flatten(&below(key), inner, keys));
        }
        toml::Value::Array(items) if items.iter().any(toml::Value::is_table) => {
            for (i, item) in items.iter().enumerate() {
                let name = item.get("name").and_then(toml::Value::as_str);
                flatten(&name.map_or_else(|| below(&i.to_string()), &below), item, keys);
            }
        }
        _ => drop(keys.insert(path.to_owned(), value.to_string())),
    }
}

/// `out/<scenario>-<seed>`.
pub fn default_folder(file: &ScenarioFile, seed: u64) -> PathBuf {
    Path::new("out").join(format!("{}-{seed}", file.scenario.name))
}

/// Prints the table (or JSON) and what was written where.
pub fn print_result(
    folder: &Path,
    metrics: &Metrics,
    json: bool,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    if json {
        crate::output::json(metrics)?;
    } else if verbosity != Verbosity::Quiet {
        print_table(folder, metrics)?;
    }
    let (unmet, asked) = (metrics.expected.unmet().count(), metrics.expected.verdicts.len());
    if unmet == 0 {
        return Ok(());
    }
    // Which, the table has said; where none was printed, it is said here.
    let which: Vec<String> = if json || verbosity == Verbosity::Quiet {
        metrics.expected.unmet().map(table::verdict).collect()
    } else {
        Vec::new()
    };
    let which = if which.is_empty() { String::new() } else { format!(": {}", which.join("; ")) };
    Err(Unexpected(format!("{unmet} of {asked} expectations are not met{which}")).into())
}

fn print_table(folder: &Path, metrics: &Metrics) -> anyhow::Result<()> {
    let timing: Option<Timing> = read_json(&folder.join("timing.json")).ok();
    say!("{}", table::of_run(metrics, timing.as_ref()))?;
    say!("{}:", folder.display())?;
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .with_context(|| format!("cannot list {}", folder.display()))?
        .filter_map(Result::ok)
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    say!("  {}", names.join("  "))
}

/// What one run and every trial share.
pub struct Job<'j> {
    pub file: &'j ScenarioFile,
    pub registry: &'j Registry,
    pub seed: u64,
    pub options: &'j RunOptions,
    pub record: Record,
    pub provenance: Provenance,
    pub checkpoints: Option<Checkpoints>,
    pub stop: &'j AtomicBool,
}

impl Job<'_> {
    /// The manifest that a trial will have, but for the files that come out.
    pub fn manifest(&self, trial: u64) -> anyhow::Result<Manifest> {
        let header = build::header(self.file, self.seed, trial, true)?;
        Ok(Manifest::of(&header, &self.provenance))
    }

    /// Runs a trial into a folder that appears whole or not at all.
    pub fn run(
        &self,
        trial: u64,
        out: &Path,
        replace: bool,
        progress: &mut dyn RunObserver,
    ) -> anyhow::Result<(PathBuf, Metrics)> {
        let begin = std::time::Instant::now();
        let built = Stage { checkpoints: self.checkpoints.clone(), ..stage(self.file, self.seed, trial)? };
        let writer_options = WriterOptions {
            replace,
            save_readings: self.options.save_readings,
            provenance: self.provenance.clone(),
        };
        if trial == 0 && built.checkpoints.is_some() && built.world.checkpoint().is_none() {
            complain!(
                "--checkpoints: this world keeps no states (a path, or a tract with obstacles); it runs from zero"
            );
        }
        let mut writer = RunWriter::create(out, writer_options)?;
        writer.add_stage("build_world", begin.elapsed());
        let record_options = RecorderOptions { full: self.record == Record::Full };
        let mut recorder = match self.record {
            Record::None => None,
            _ => Some(RrdRecorder::to_file(&writer.path().join("recording.rrd"), record_options)?),
        };
        let mut viewer = match &self.options.connect {
            Some(address) if self.options.trials == 1 => {
                Some(RrdRecorder::to_viewer(address, record_options)?)
            }
            _ => None,
        };
        let mut all: Vec<&mut dyn RunObserver> = vec![&mut writer];
        all.extend(recorder.iter_mut().chain(viewer.iter_mut()).map(|r| r as &mut dyn RunObserver));
        all.push(progress);
        let stop = || self.stop.load(Ordering::Relaxed);
        let mut observers = Observers::new(all);
        let summary = simulate(self.file, self.registry, self.seed, trial, built, &mut observers, &stop)?;
        if let Some(why) = summary.not_kept {
            complain!("{why}; this run lacks nothing");
        }
        if let Some(why) = viewer.as_ref().and_then(RrdRecorder::lost_viewer) {
            complain!("{why}; the files are whole");
        }
        let metrics = writer.metrics().cloned().context("the run left no metrics")?;
        Ok((writer.commit()?, metrics))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_scenarios_differ_in_these_keys() {
        let flat = |text: &str| {
            let mut keys = BTreeMap::new();
            flatten("", &toml::Value::Table(text.parse().unwrap()), &mut keys);
            keys.into_iter().map(|(key, value)| format!("{key}={value}")).collect::<Vec<_>>()
        };
        assert_eq!(
            flat(
                "a = 1\n[[sensor]]\nname = \"belt\"\n[sensor.schedule]\nrate_hz = 2.0\n[[fault]]\nx = [1, 2]\n"
            ),
            ["a=1", "fault.0.x=[1, 2]", "sensor.belt.name=\"belt\"", "sensor.belt.schedule.rate_hz=2.0"]
        );
    }
}
