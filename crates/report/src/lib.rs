//! The files of a run: what is written while it goes, and how it is read back.
//!
//! | file | written by | read by |
//! |---|---|---|
//! | `manifest.json` | [`write_manifest`] | [`read_json`] |
//! | `metrics.json` | [`MetricsObserver`] | [`read_json`] |
//! | `timing.json` | [`TimingObserver`] | [`read_json`] |
//! | `tracks.parquet` | [`TracksObserver`] | [`read_tracks`], [`for_each_track_row`] |
//! | `truth.parquet` | [`TruthObserver`] | [`read_arc_length`] |
//! | `truth.tum`, `<track>.tum` | [`TumObserver`] | `lumenav_records::tum::read` |
//! | `events.jsonl` | [`EventsObserver`] | [`read_events`], [`for_each_event`] |
//! | `readings/` | [`ReadingsObserver`] | `lumenav replay` |
//! | `trials.json` | [`write_trials`] | [`read_json`] |
//!
//! [`RunWriter`] is all of them in a [`RunFolder`] that appears whole or not at all. [`write_tum`], [`write_kitti`] and
//! [`write_csv`] export single tracks, [`write_mcap`] truth and tracks in one file. Equal runs give equal bytes, `timing.json` excepted. Memory does not grow with the
//! run, 8 bytes per judged update of a track for the quantiles of its position error excepted.

mod error;
mod expected;
mod file;
mod folder;
mod log;
mod manifest;
mod mcap;
mod metrics;
mod motion;
mod parquet_table;
mod readings;
mod row;
mod timing;
mod tracks;
mod trials;
mod truth;
mod tum;
mod writer;

pub use error::ReportError;
pub use expected::{ExpectVerdict, Expectations, PairDistance, TrackRest};
pub use folder::{RunFolder, check_replaceable};
pub use log::{
    EventsObserver, Logged, LoggedEvent, WorstChannel, for_each_event, read_events, refusal_reason,
};
pub use manifest::{FileEntry, Machine, Manifest, Provenance, fingerprint, read_json, write_manifest};
pub use mcap::write_mcap;
pub use metrics::{
    AxisError, DRIFT_SPAN_M, FRESH_S, Metrics, MetricsObserver, NeesFigures, NisFigures, PerAxis,
    PeriodFigures, RELATIVE_SPAN_S, SensorMetrics, TrackMetrics,
};
pub use motion::{MotionFigures, SPEED_CLASSES_MM_S, SegmentErrors, SegmentMotion};
pub use readings::ReadingsObserver;
pub use row::{COVARIANCE_LENGTH, NUMBERS, TrackRow, write_csv};
pub use timing::{Timing, TimingObserver, TrackTiming};
pub use tracks::{TRACKS_SCHEMA_VERSION, TracksInfo, TracksObserver, for_each_track_row, read_tracks};
pub use trials::{
    Availability, ExpectOverTrials, Instants, NONLINEAR_BAND, NeesOverTrials, PairOfTracks, PeriodOverTrials,
    Trials, TrialsCollector, TrialsOfTrack, write_trials,
};
pub use truth::{TruthObserver, read_arc_length};
pub use tum::{StampedPose, TumObserver, write_kitti, write_tum};
pub use writer::{RunWriter, WriterOptions};
