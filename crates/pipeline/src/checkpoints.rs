//! States of a world in a folder, from which a later run of the same world goes on instead of from zero.
//!
//! A file `<program>-<world>-<nanoseconds>.world` each. *World* is what the world was built from (scenario, seed, trial), *program* the
//! one that stepped it: a state that another program left is another's. A run that starts from one has the same bytes as one from zero,
//! so nothing of it needs to know.

use crate::error::RunError;
use lumenav_core::SimTime;
use lumenav_core::time::NANOSECONDS_PER_SECOND;
use lumenav_scenario::world::{Checkpoint, World};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Where states are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoints {
    folder: PathBuf,
    program: String,
    every_ns: i64,
    /// When the last state was kept, or might have been.
    last: SimTime,
}

impl Checkpoints {
    /// In a folder, which need not be there yet; `program` tells one program from another (letters and digits).
    pub fn new(folder: &Path, program: &str, every_ns: i64) -> Self {
        Self {
            folder: folder.to_owned(),
            program: program.to_owned(),
            every_ns: every_ns.max(1),
            last: SimTime::ZERO,
        }
    }

    fn prefix(&self, world: u64) -> String {
        format!("{}-{world:016x}-", self.program)
    }

    fn failed(path: &Path, why: &dyn std::fmt::Display) -> RunError {
        RunError::Checkpoint { path: path.display().to_string(), why: why.to_string() }
    }

    /// Whether a state is kept at this instant, one of a run's in the order of time: the first in each stretch.
    pub(crate) fn is_due(&mut self, at: SimTime) -> bool {
        let is_due = at.0 / self.every_ns > self.last.0 / self.every_ns;
        self.last = at;
        is_due
    }

    /// Keeps a world's state; the file appears whole or not at all.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`].
    pub(crate) fn keep(&self, at: SimTime, state: &Checkpoint) -> Result<(), RunError> {
        let path = self.folder.join(format!("{}{}.world", self.prefix(state.world), at.0));
        let failed = |error: std::io::Error| Self::failed(&path, &error);
        if path.exists() {
            return Ok(());
        }
        std::fs::create_dir_all(&self.folder).map_err(failed)?;
        let mut file = tempfile::NamedTempFile::new_in(&self.folder).map_err(failed)?;
        file.write_all(&state.bytes).map_err(failed)?;
        file.persist(&path).map(drop).map_err(|error| failed(error.error))
    }

    /// Brings a world to the latest state of it that is not later than `until`; the instant, where there is one.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`]: a file that cannot be read or is damaged.
    pub(crate) fn take_up(
        &mut self,
        world: &mut dyn World,
        until: SimTime,
    ) -> Result<Option<SimTime>, RunError> {
        let Some(now) = world.checkpoint() else { return Ok(None) };
        let Ok(entries) = std::fs::read_dir(&self.folder) else { return Ok(None) };
        let prefix = self.prefix(now.world);
        let names = entries.filter_map(Result::ok).map(|entry| entry.file_name());
        let instants = names.filter_map(|name| {
            let instant = name.to_str()?.strip_prefix(&prefix)?.strip_suffix(".world")?;
            instant.parse().ok().map(SimTime)
        });
        let Some(latest) = instants.filter(|at| *at <= until).max() else { return Ok(None) };
        let path = self.folder.join(format!("{prefix}{}.world", latest.0));
        let bytes = std::fs::read(&path).map_err(|error| Self::failed(&path, &error))?;
        world.restore(&bytes).map_err(|error| Self::failed(&path, &error))?;
        let stands_at = world.truth().interval().end;
        if stands_at < latest || stands_at.0 - latest.0 > NANOSECONDS_PER_SECOND {
            return Err(Self::failed(&path, &format!("it holds the state of {stands_at}")));
        }
        self.last = latest;
        Ok(Some(latest))
    }
}
