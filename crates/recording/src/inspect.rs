//! What is in a recording, read back: entities with their rows, and timelines.

use crate::error::RecordingError;
use rerun::StoreKind;
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// The content of a recording in numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RrdSummary {
    /// Application identifier.
    pub application: String,
    /// Recording identifier.
    pub recording: String,
    /// Rows per entity path of the recording.
    pub rows: BTreeMap<String, u64>,
    /// Names of the timelines.
    pub timelines: BTreeSet<String>,
    /// Rows of the blueprint; 0 where there is none.
    pub blueprint_rows: u64,
    /// Chunks of the recording.
    pub chunks: u64,
}

/// Reads a recording from its first to its last byte.
///
/// # Errors
/// [`RecordingError::File`] where it cannot be opened, [`RecordingError::Decode`] where it is no recording or damaged.
pub fn inspect(path: &Path) -> Result<RrdSummary, RecordingError> {
    let mut summary = RrdSummary::default();
    visit(path, |message| match message {
        Message::Store { kind: StoreKind::Recording, application, recording } => {
            summary.application = application;
            summary.recording = recording;
        }
        Message::Store { .. } => {}
        Message::Chunk { kind: StoreKind::Blueprint, chunk } => {
            summary.blueprint_rows += chunk.num_rows() as u64;
        }
        Message::Chunk { chunk, .. } => {
            summary.chunks += 1;
            *summary.rows.entry(chunk.entity_path().to_string()).or_default() += chunk.num_rows() as u64;
            summary.timelines.extend(chunk.timelines().keys().map(ToString::to_string));
        }
    })?;
    Ok(summary)
}

/// The numbers of a plot, as times (ns) and values.
///
/// # Errors
/// As [`inspect`].
pub fn read_scalars(path: &Path, entity: &str) -> Result<Vec<(i64, f64)>, RecordingError> {
    let mut out = Vec::new();
    visit(path, |message| {
        let Message::Chunk { kind: StoreKind::Recording, chunk } = message else { return };
        if chunk.entity_path().to_string() != entity {
            return;
        }
        let component = rerun::Scalars::descriptor_scalars().component;
        let values = chunk.iter_slices::<f64>(component);
        let times = chunk.iter_component_indices(crate::store::SIM_TIME.into(), component);
        out.extend(times.zip(values).filter_map(|((at, _), row)| Some((at.as_i64(), *row.first()?))));
    })?;
    out.sort_by_key(|(at, _)| *at);
    Ok(out)
}

/// One message of a recording.
enum Message {
    Store { kind: StoreKind, application: String, recording: String },
    Chunk { kind: StoreKind, chunk: Chunk },
}

/// Calls `see` for each store and chunk.
fn visit(path: &Path, mut see: impl FnMut(Message)) -> Result<(), RecordingError> {
    let decode = |why: String| RecordingError::Decode { path: path.to_owned(), why };
    let file = File::open(path).map_err(|source| RecordingError::File {
        action: "cannot open",
        path: path.to_owned(),
        source,
    })?;
    let messages = DecoderApp::decode_eager(BufReader::new(file)).map_err(|e| decode(e.to_string()))?;
    let mut any = false;
    for message in messages {
        match message.map_err(|e| decode(e.to_string()))? {
            LogMsg::SetStoreInfo(store) => {
                any = true;
                see(Message::Store {
                    kind: store.info.store_id.kind(),
                    application: store.info.application_id().to_string(),
                    recording: store.info.recording_id().as_str().to_owned(),
                });
            }
            LogMsg::ArrowMsg(store, arrow) => {
                let chunk = Chunk::from_arrow_msg(&arrow).map_err(|e| decode(e.to_string()))?;
                see(Message::Chunk { kind: store.kind(), chunk });
            }
            LogMsg::BlueprintActivationCommand(_) => {}
        }
    }
    if any { Ok(()) } else { Err(decode("no recording starts in it".into())) }
}
