//! What can go wrong while a recording is written or read.

use std::path::PathBuf;
use thiserror::Error;

/// Everything that can go wrong with a recording.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// A file could not be created, written, renamed or read.
    #[error("{action} {}: {source}", path.display())]
    File {
        /// What was tried, as in "cannot create".
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The stream could not be encoded, or the bytes could not be written.
    #[error("cannot write {target}: {why}")]
    Encode {
        /// The file or the viewer's address.
        target: String,
        /// In words.
        why: String,
    },
    /// The file is not a recording, or is cut short.
    #[error("{} is not a readable recording: {why}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// In words.
        why: String,
    },
    /// The address of a viewer cannot be understood.
    #[error("`{address}` is not a viewer's address (write host:port or rerun+http://host:port/proxy): {why}")]
    Address {
        /// As given.
        address: String,
        /// In words.
        why: String,
    },
    /// Nothing answers at the address.
    #[error("no viewer answers at {address} (start one with `rerun --bind 127.0.0.1 --port PORT`): {why}")]
    NoViewer {
        /// The address.
        address: String,
        /// In words.
        why: String,
    },
    /// Two recordings cannot share one name.
    #[error("{} has no file name", .0.display())]
    NoFileName(PathBuf),
}
