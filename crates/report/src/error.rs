//! What can go wrong while results are written or read back.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// Everything that can go wrong with the files of a run.
#[derive(Debug, Error)]
pub enum ReportError {
    /// A file or folder could not be created, written, renamed or read.
    #[error("{action} {}: {source}", path.display())]
    File {
        /// What was tried, as in "cannot write".
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// Results are never overwritten unasked.
    #[error("{} exists already; choose another folder or ask to replace it", .0.display())]
    Exists(PathBuf),
    /// Something else stands where a run's folder is to be replaced.
    #[error("{} is not replaced: {why}; remove it yourself or choose another folder", path.display())]
    NotOurs {
        /// What stands there.
        path: PathBuf,
        /// Why it is not ours.
        why: &'static str,
    },
    /// A path that names no folder (`/`, `..`).
    #[error("{} does not name a folder that could be made", .0.display())]
    NoName(PathBuf),
    /// A line of a text file that is not what it should be.
    #[error("{}:{line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// A Parquet file could not be written, or is not what it should be.
    #[error("{}: {what}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A document could not be turned into JSON or back.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: serde_json::Error,
    },
    /// A statistic could not be formed.
    #[error("metrics of track `{track}`: {source}")]
    Metrics {
        /// The track.
        track: String,
        /// Why not.
        source: lumenav_evaluation::EvaluationError,
    },
}

impl ReportError {
    /// For `map_err` on file operations.
    pub(crate) fn file(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::File { action, path, source }
    }

    /// For `map_err` on tables.
    pub(crate) fn table<E: std::fmt::Display>(path: &Path) -> impl FnOnce(E) -> Self {
        let path = path.to_owned();
        move |why| Self::Table { path, what: why.to_string() }
    }
}
