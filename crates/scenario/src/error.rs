//! What can go wrong while a scenario is read or its world is stepped.

use lumenav_core::{ConfigError, ModalityError};

/// An error of the scenario crate.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// A user's file says something that is not allowed.
    #[error(transparent)]
    Config(#[from] Box<ConfigError>),
    /// A recorded trajectory cannot be read.
    #[error(transparent)]
    Records(#[from] ModalityError),
    /// A world's state does not fit it.
    #[error("no checkpoint of this world: {why}")]
    Checkpoint {
        /// Why not.
        why: &'static str,
    },
    /// The engine's world broke a law of its own.
    #[error("engine at {at_s:.3} s: {what}")]
    Engine {
        /// Simulated time.
        at_s: f64,
        /// What happened.
        what: String,
    },
}

impl From<ConfigError> for ScenarioError {
    fn from(error: ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}
