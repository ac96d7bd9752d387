//! `lumenav replay`: recorded measurements through the same front ends, filters and observers.

use super::run::{default_folder, print_result, refuse_existing, stop_on_ctrl_c};
use crate::args::{Record, ReplayOptions, Verbosity};
use crate::progress::Progress;
use anyhow::Context as _;
use lumenav::core::Node;
use lumenav::pipeline::{Observers, RunObserver, TruthAt, replay as replay_run};
use lumenav::recording::{RecorderOptions, RrdRecorder};
use lumenav::report::{RunWriter, WriterOptions};
use lumenav::{default_registry, open_replay};
use std::io::IsTerminal as _;
use std::sync::atomic::Ordering;

/// Replays recorded data.
pub fn replay(options: &ReplayOptions, verbosity: Verbosity) -> anyhow::Result<()> {
    let (file, reference) = open_replay(&options.replay, &options.set, options.models.as_deref())?;
    let out = options.out.clone().unwrap_or_else(|| default_folder(&file, file.scenario.seed));
    refuse_existing(&out, options.force)?;
    let stop = stop_on_ctrl_c();
    let mut writer = RunWriter::create(
        &out,
        WriterOptions {
            replace: options.force,
            save_readings: false,
            command_line: std::env::args().collect(),
        },
    )?;
    let record_options = RecorderOptions { full: options.record == Record::Full };
    let mut recorder = match options.record {
        Record::None => None,
        _ => Some(RrdRecorder::to_file(&writer.path().join("recording.rrd"), record_options)?),
    };
    let mut progress = Progress::new(verbosity == Verbosity::Normal && std::io::stderr().is_terminal());
    let mut all: Vec<&mut dyn RunObserver> = vec![&mut writer];
    all.extend(recorder.iter_mut().map(|r| r as &mut dyn RunObserver));
    all.push(&mut progress);
    let known = |at| reference.as_ref().and_then(|reference| reference.at(at));
    let truth = reference.is_some().then_some(&known as TruthAt<'_>);
    replay_run(&file, &default_registry(), truth, &mut Observers::new(all), &|| {
        stop.load(Ordering::Relaxed)
    })?;
    let metrics = writer.metrics().cloned().context("the replay left no metrics")?;
    let folder = writer.commit()?;
    print_result(&folder, &metrics, options.json, verbosity)
}

/// Whether a file is a replay: its sensors read files.
pub fn is_replay(node: &Node) -> bool {
    node.children("sensor").unwrap_or_default().iter().any(|s| s.child("files").is_some())
}
