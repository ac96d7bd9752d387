//! All files of a run by one observer.

use crate::error::ReportError;
use crate::folder::RunFolder;
use crate::log::EventsObserver;
use crate::manifest::{Provenance, write_manifest};
use crate::metrics::{Metrics, MetricsObserver};
use crate::readings::ReadingsObserver;
use crate::timing::TimingObserver;
use crate::tracks::TracksObserver;
use crate::truth::TruthObserver;
use crate::tum::TumObserver;
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What a run's folder is to hold besides what it always holds.
#[derive(Clone, Debug, Default)]
pub struct WriterOptions {
    /// Replace a folder that exists.
    pub replace: bool,
    /// Write `readings/`.
    pub save_readings: bool,
    /// Program, command and inputs, for the manifest.
    pub provenance: Provenance,
}

/// Writes a run's folder: trajectories, `tracks.parquet`, `events.jsonl`, `metrics.json`, `timing.json`, and readings.
///
/// Other observers (the recording) may write into [`RunWriter::path`] as well; when they have finished too,
/// [`RunWriter::commit`] adds the manifest and gives the folder its name.
pub struct RunWriter {
    folder: RunFolder,
    options: WriterOptions,
    header: Option<RunHeader>,
    metrics: MetricsObserver,
    timing: TimingObserver,
    others: Vec<Box<dyn RunObserver + Send>>,
}

impl RunWriter {
    /// Makes the hidden folder that will become `target`.
    ///
    /// # Errors
    /// As [`RunFolder::create`].
    pub fn create(target: &Path, options: WriterOptions) -> Result<Self, ReportError> {
        let folder = RunFolder::create(target, options.replace)?;
        let path = folder.path();
        let mut others: Vec<Box<dyn RunObserver + Send>> = vec![
            Box::new(TumObserver::new(path)),
            Box::new(TracksObserver::new(path)),
            Box::new(TruthObserver::new(path)),
            Box::new(EventsObserver::new(path)),
        ];
        if options.save_readings {
            others.push(Box::new(ReadingsObserver::new(path)));
        }
        let (metrics, timing) = (MetricsObserver::new(path), TimingObserver::new(path));
        Ok(Self { folder, options, header: None, metrics, timing, others })
    }

    /// Where files go until the folder gets its name.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Adds the wall time of a stage before the run to `timing.json`.
    pub fn add_stage(&mut self, name: &str, wall: Duration) {
        self.timing.add_stage(name, wall);
    }

    /// The figures, once the run has finished.
    pub fn metrics(&self) -> Option<&Metrics> {
        self.metrics.metrics()
    }

    /// Adds the manifest and gives the folder its name; to be called once all observers have finished.
    ///
    /// # Errors
    /// As [`write_manifest`] and [`RunFolder::commit`]; the folder then does not appear.
    pub fn commit(self) -> Result<PathBuf, ReportError> {
        if let Some(header) = &self.header {
            write_manifest(self.folder.path(), header, &self.options.provenance)?;
        }
        self.folder.commit()
    }
}

impl RunObserver for RunWriter {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        self.header = Some(header.clone());
        self.timing.start(header)?;
        self.metrics.start(header)?;
        self.others.iter_mut().try_for_each(|observer| observer.start(header))
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        self.timing.on(event)?;
        self.metrics.on(event)?;
        self.others.iter_mut().try_for_each(|observer| observer.on(event))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.others.iter_mut().try_for_each(|observer| observer.finish())?;
        self.metrics.finish()?;
        self.timing.finish()
    }
}
