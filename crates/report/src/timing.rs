//! `timing.json`: what a run cost. The only file that differs between equal runs, and the only one with a clock in it.

use crate::error::ReportError;
use crate::file::write_json;
use lumenav_core::{Name, SimTime};
use lumenav_evaluation::bounded::BoundedQuantiles;
use lumenav_evaluation::summary::ScalarSummary;
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// `timing.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Version of the keys.
    pub schema: u32,
    /// When the run started, seconds since 1970 (UTC).
    pub started_unix_s: f64,
    /// Wall time from the first to the last event, s.
    pub wall_s: f64,
    /// Processor time of the whole program in that time, s; `null` where the system does not tell.
    pub cpu_s: Option<f64>,
    /// Simulated time that was observed, s.
    pub simulated_s: f64,
    /// Simulated seconds per second of wall time.
    pub realtime_factor: f64,
    /// Stages before the run (reading files, building the tract), s of wall time.
    pub stages_wall_s: BTreeMap<String, f64>,
    /// Cost per track.
    pub tracks: BTreeMap<String, TrackTiming>,
}

/// The cost of one track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackTiming {
    /// Processor time of front end and filter per update.
    pub update_ms: Option<ScalarSummary>,
    /// The same over the run, per simulated second.
    pub ms_per_simulated_s: f64,
    /// Updates.
    pub updates: usize,
}

/// Measures a run; writes `timing.json`.
pub struct TimingObserver {
    path: PathBuf,
    stages: BTreeMap<String, f64>,
    tracks: BTreeMap<Name, BoundedQuantiles>,
    started: Option<(Instant, f64, Option<f64>)>,
    last: SimTime,
    observe_from_s: f64,
}

impl TimingObserver {
    /// The file goes into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        Self {
            path: folder.join("timing.json"),
            stages: BTreeMap::new(),
            tracks: BTreeMap::new(),
            started: None,
            last: SimTime::ZERO,
            observe_from_s: 0.0,
        }
    }

    /// Adds the wall time of a stage; of stages with one name the sum is kept.
    pub fn add_stage(&mut self, name: &str, wall: Duration) {
        *self.stages.entry(name.to_owned()).or_default() += wall.as_secs_f64();
    }

    fn close(&mut self) -> Result<(), ReportError> {
        let Some((clock, started_unix_s, cpu_before)) = self.started.take() else { return Ok(()) };
        let wall_s = clock.elapsed().as_secs_f64();
        let simulated_s = (self.last.seconds() - self.observe_from_s).max(0.0);
        let tracks = self.tracks.iter().map(|(name, ms)| {
            let total_ms = ms.mean().unwrap_or(0.0) * ms.count() as f64;
            let timing = TrackTiming {
                update_ms: ms.summary(),
                ms_per_simulated_s: if simulated_s > 0.0 { total_ms / simulated_s } else { 0.0 },
                updates: ms.count(),
            };
            (name.to_string(), timing)
        });
        let timing = Timing {
            schema: 1,
            started_unix_s,
            wall_s,
            cpu_s: processor_time_s().zip(cpu_before).map(|(now, before)| now - before),
            simulated_s,
            realtime_factor: if wall_s > 0.0 { simulated_s / wall_s } else { 0.0 },
            stages_wall_s: self.stages.clone(),
            tracks: tracks.collect(),
        };
        write_json(&self.path, &timing)
    }
}

impl RunObserver for TimingObserver {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
        self.observe_from_s = header.observe_from_s;
        self.started = Some((Instant::now(), unix, processor_time_s()));
        self.tracks =
            header.tracks.iter().map(|track| (track.name.clone(), BoundedQuantiles::new())).collect();
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        match event {
            RunEvent::Truth(truth) => self.last = self.last.max(truth.at),
            RunEvent::Clock { at } => self.last = self.last.max(*at),
            RunEvent::Update(update) => {
                self.last = self.last.max(update.estimate.at);
                if let Some(track) = self.tracks.get_mut(update.track) {
                    track.push(1e3 * update.compute_s);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.close().map_err(|e| ObserverError::new("timing", e))
    }
}

/// Processor time of this process, s: user and system time of `/proc/self/stat` (proc(5): fields 14 and 15, in ticks
/// of 1/100 s on every Linux). `None` on other systems.
fn processor_time_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the program's name in brackets and may hold spaces.
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_ascii_whitespace().skip(11);
    let user: f64 = fields.next()?.parse().ok()?;
    let system: f64 = fields.next()?.parse().ok()?;
    Some((user + system) / 100.0)
}
