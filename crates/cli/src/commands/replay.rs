//! `lumenav replay`: recorded measurements through the same front ends, filters and observers.

use super::run::{
    Place, default_folder, look_at_place, print_result, say_if_stopped, say_inputs, stop_on_ctrl_c,
};
use crate::args::{Record, ReplayOptions, Verbosity};
use crate::progress::Progress;
use crate::provenance;
use anyhow::Context as _;
use lumenav::core::{Node, Registry};
use lumenav::open_replay;
use lumenav::pipeline::{Observers, RunObserver, TruthAt, build, replay as replay_run};
use lumenav::recording::{RecorderOptions, RrdRecorder};
use lumenav::report::{Manifest, RunWriter, WriterOptions};
use std::io::IsTerminal as _;
use std::sync::atomic::Ordering;

/// Replays recorded data.
pub fn replay(options: &ReplayOptions, registry: &Registry, verbosity: Verbosity) -> anyhow::Result<()> {
    let (file, reference) = open_replay(&options.replay, &options.set, options.models.as_deref())?;
    let out = options.out.clone().unwrap_or_else(|| default_folder(&file, file.scenario.seed));
    // Built once to see every file that is read; readers and tracks are made anew for the run.
    build::readers(&file, registry)?;
    build::tracks(&file, registry, None)?;
    let mut provenance = provenance::of_program(options.record, false);
    provenance.inputs = provenance::inputs(&file.node)?;
    say_inputs(&provenance, verbosity);
    let header = build::header(&file, file.scenario.seed, 0, reference.is_some())?;
    if let Place::Same(metrics) = look_at_place(&out, options.force, &Manifest::of(&header, &provenance))? {
        return print_result(&out, &metrics, options.json, verbosity);
    }
    let stop = stop_on_ctrl_c();
    let mut writer =
        RunWriter::create(&out, WriterOptions { replace: options.force, save_readings: false, provenance })?;
    let record_options = RecorderOptions { full: options.record == Record::Full };
    let mut recorder = match options.record {
        Record::None => None,
        _ => Some(RrdRecorder::to_file(&writer.path().join("recording.rrd"), record_options)?),
    };
    let mut progress = Progress::new(verbosity != Verbosity::Quiet && std::io::stderr().is_terminal());
    let mut all: Vec<&mut dyn RunObserver> = vec![&mut writer];
    all.extend(recorder.iter_mut().map(|r| r as &mut dyn RunObserver));
    all.push(&mut progress);
    let known = |at| reference.as_ref().and_then(|reference| reference.at(at));
    let truth = reference.is_some().then_some(&known as TruthAt<'_>);
    replay_run(&file, registry, truth, &mut Observers::new(all), &|| stop.load(Ordering::Relaxed))
        .inspect_err(|_| say_if_stopped(&stop))?;
    let metrics = writer.metrics().cloned().context("the replay left no metrics")?;
    let folder = writer.commit()?;
    print_result(&folder, &metrics, options.json, verbosity)
}

/// Whether a file is a replay: its sensors read files.
pub fn is_replay(node: &Node) -> bool {
    node.children("sensor").unwrap_or_default().iter().any(|s| s.child("files").is_some())
}
