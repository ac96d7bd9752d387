//! Why a run could not start, or stopped.

use crate::events::ObserverError;
use lumenav_core::{ConfigError, ModalityError, SimTime};
use lumenav_scenario::ScenarioError;

/// An error of a run.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A user's file says something that is not allowed.
    #[error(transparent)]
    Config(#[from] Box<ConfigError>),
    /// The world could not be built or stepped.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A plugin failed.
    #[error(transparent)]
    Modality(#[from] ModalityError),
    /// A plugin failed during the run.
    #[error("sensor `{sensor}` at {at}: {source}")]
    Sensor {
        /// The sensor.
        sensor: String,
        /// When.
        at: SimTime,
        /// Why.
        source: ModalityError,
    },
    /// A fault does not fit the readings it is to befall.
    #[error("fault on {fault}: {why}")]
    Fault {
        /// The fault in words.
        fault: String,
        /// What is wrong and what is allowed.
        why: String,
    },
    /// A state of the world cannot be kept, read or used.
    #[error("checkpoint {path}: {why} (states may be removed at any time)")]
    Checkpoint {
        /// The file.
        path: String,
        /// Why.
        why: String,
    },
    /// An observer failed.
    #[error(transparent)]
    Observer(#[from] ObserverError),
    /// The user asked to stop.
    #[error("stopped at {at} on request")]
    Stopped {
        /// The simulated time.
        at: SimTime,
    },
}

impl From<ConfigError> for RunError {
    fn from(error: ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}
