//! The factory of a plugin, and the registry that finds it by name.

use crate::config::{ConfigError, Node};
use crate::frame::Reading;
use crate::front_end::Estimator;
use crate::layout::LayoutModel;
use crate::sensor::Sensor;
use crate::setup::Setup;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Why a plugin could not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum ModalityError {
    /// A file of the user's says something that is not allowed.
    #[error(transparent)]
    Config(#[from] Box<ConfigError>),
    /// A reading does not fit the installed sensor.
    #[error("reading: {0}")]
    Reading(String),
    /// A row of recorded data is bad.
    #[error("{file}:{line}: {message}")]
    Row {
        /// The file.
        file: String,
        /// Line, from 1.
        line: u64,
        /// What is wrong and what is allowed.
        message: String,
    },
    /// A file cannot be read.
    #[error("{file}: {source}")]
    File {
        /// The file.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// The state lacks what the model reads.
    #[error("the state does not hold {0}")]
    MissingState(&'static str),
    /// The state does not hold a block.
    #[error("the state does not hold the block `{0}`")]
    MissingBlock(String),
    /// The model is undefined at this state.
    #[error("undefined: {0}")]
    Undefined(String),
    /// Bytes that are not a snapshot of this front end.
    #[error("these bytes are not a snapshot of this front end")]
    Snapshot,
    /// The sensor cannot be moved.
    #[error("sensors of this modality stay where they are installed")]
    Immovable,
    /// The modality cannot do this at all.
    #[error("modality `{kind}` {what}")]
    Unsupported {
        /// The modality.
        kind: &'static str,
        /// What it cannot do.
        what: &'static str,
    },
}

impl From<ConfigError> for ModalityError {
    fn from(error: ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}

/// What a recorded stream yields.
#[derive(Debug)]
pub enum Recorded {
    /// A reading.
    Reading(Reading),
    /// A reading that could not be read and was passed over (`bad_rows = "skip"`): where, and why. Its sequence number is left
    /// out.
    Skipped(ModalityError),
}

/// Recorded readings, in order of arrival, streamed; an error ends the stream.
pub type ReadingStream = Box<dyn Iterator<Item = Result<Recorded, ModalityError>> + Send>;

/// A localization modality. World and estimator are built by different calls, from different tables.
pub trait Modality: Send + Sync {
    /// The name in scenario files, for example `magnetic`.
    fn kind(&self) -> &'static str;

    /// One line for `lumenav plugins`.
    fn about(&self) -> &'static str;

    /// The front ends that a track can choose, first the default.
    fn front_ends(&self) -> &'static [&'static str];

    /// The simulated sensor: what both sides know (`installed`) and what the world does beyond it (`reality`).
    ///
    /// # Errors
    /// [`ModalityError`] with file, line and key.
    fn sensor(
        &self,
        installed: &Node,
        reality: &Node,
        setup: &Setup,
    ) -> Result<Box<dyn Sensor>, ModalityError>;

    /// The estimator side, once per track and trial: it never sees `reality`.
    ///
    /// # Errors
    /// [`ModalityError`] with file, line and key.
    fn estimator(&self, installed: &Node, options: &Node, setup: &Setup) -> Result<Estimator, ModalityError>;

    /// The sensor as a layout, for `lumenav layout`; `options` is the scenario's `[layout.model]`.
    ///
    /// # Errors
    /// [`ModalityError`] with file, line and key, or where the modality has no layouts.
    fn layout(
        &self,
        _installed: &Node,
        _options: &Node,
        _setup: &Setup,
    ) -> Result<Box<dyn LayoutModel>, ModalityError> {
        Err(ModalityError::Unsupported { kind: self.kind(), what: "has no layouts yet" })
    }

    /// Recorded readings for `lumenav replay`; `files` is the table that names them.
    ///
    /// # Errors
    /// [`ModalityError`] with file, line and key, or where the modality has no reader.
    fn reader(
        &self,
        _installed: &Node,
        _files: &Node,
        _setup: &Setup,
    ) -> Result<ReadingStream, ModalityError> {
        Err(ModalityError::Unsupported { kind: self.kind(), what: "has no reader of recorded data" })
    }
}

/// The modalities a program knows, by name.
#[derive(Clone, Default)]
pub struct Registry {
    modalities: BTreeMap<&'static str, Arc<dyn Modality>>,
}

impl Registry {
    /// An empty registry.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a modality; one of the same name is replaced.
    pub fn with(mut self, modality: impl Modality + 'static) -> Self {
        self.modalities.insert(modality.kind(), Arc::new(modality));
        self
    }

    /// All modalities, by name.
    pub fn modalities(&self) -> impl Iterator<Item = &Arc<dyn Modality>> {
        self.modalities.values()
    }

    /// The modality that a table's `modality` key asks for.
    ///
    /// # Errors
    /// [`ConfigError`] that names the key, its line and the modalities there are.
    pub fn get(&self, kind: &str, asked_by: &Node) -> Result<&Arc<dyn Modality>, ConfigError> {
        self.modalities.get(kind).ok_or_else(|| {
            let known: Vec<_> = self.modalities.keys().copied().collect();
            asked_by.error_at(
                "modality",
                &format!("unknown modality `{kind}`; this program knows: {}", known.join(", ")),
            )
        })
    }
}
