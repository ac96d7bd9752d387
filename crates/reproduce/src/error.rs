//! What keeps a reproduction from ending.

use lumenav_core::ConfigError;
use lumenav_figures::FigureError;

/// Why a reproduction did not end.
#[derive(Debug, thiserror::Error)]
pub enum ReproduceError {
    /// A model file is not right.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Somebody asked to stop.
    #[error("stopped: {done} of {jobs} parts were done")]
    Stopped {
        /// Parts that were done.
        done: usize,
        /// Parts there are.
        jobs: usize,
    },
    /// No seed was given.
    #[error("a reproduction needs one seed at least")]
    NoSeed,
    /// A figure could not be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// A simulator, tracker or filter refused what this reproduction asked of it.
    #[error("{part}: {why}")]
    Part {
        /// What was being done.
        part: String,
        /// What it said.
        why: String,
    },
}

impl ReproduceError {
    /// Wraps what a part said.
    pub fn of_part<E: std::fmt::Display>(part: &str) -> impl FnOnce(E) -> Self + use<'_, E> {
        move |error| Self::Part { part: part.to_owned(), why: error.to_string() }
    }
}
