//! Where messages go: a file that appears whole or not at all, or a running viewer.
//!
//! The encoder is driven directly, not through the SDK's logging stream: that one writes in a thread of its own, logs a
//! full disk and goes on, and stamps every row with the wall clock. Here a failed write is an error at once, and two
//! equal runs give equal bytes.

use crate::error::RecordingError;
use rerun::external::arrow::datatypes::Schema;
use rerun::external::re_build_info::CrateVersion;
use rerun::external::re_log_encoding::{
    Decodable as _, Encodable as _, Encoder, EncodingOptions, MessageHeader, MessageKind, RawRrdManifest,
    RrdFooter, StreamFooter, ToApplication as _, ToTransport,
};
use rerun::log::LogMsg;
use rerun::sink::{GrpcSink, LogSink as _};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::str::FromStr as _;
use std::time::Duration;

/// How long a viewer may take to answer, and to take the last messages.
const VIEWER_PATIENCE: Duration = Duration::from_secs(10);

/// The receiver of messages.
pub(crate) enum Output {
    /// A file, written under a temporary name beside its own.
    File(FileOutput),
    /// A viewer that is running.
    Viewer {
        /// The connection.
        sink: GrpcSink,
        /// As the user wrote it.
        address: String,
        /// Why it did not get everything.
        lost: Option<String>,
    },
}

/// A file being written.
pub(crate) struct FileOutput {
    /// `None` once finished.
    encoder: Option<Encoder<BufWriter<File>>>,
    temporary: PathBuf,
    target: PathBuf,
}

impl Output {
    /// Opens `<path>.part` for writing; [`Output::finish`] gives it its name.
    pub(crate) fn file(path: &Path) -> Result<Self, RecordingError> {
        let name = path.file_name().ok_or_else(|| RecordingError::NoFileName(path.to_owned()))?;
        let mut part = name.to_owned();
        part.push(".part");
        let temporary = path.with_file_name(part);
        let file = File::create(&temporary).map_err(|source| RecordingError::File {
            action: "cannot create",
            path: temporary.clone(),
            source,
        })?;
        let encoder = Encoder::new_eager(
            CrateVersion::LOCAL,
            EncodingOptions::PROTOBUF_COMPRESSED,
            BufWriter::with_capacity(1 << 18, file),
        )
        .map_err(|e| RecordingError::Encode { target: path.display().to_string(), why: e.to_string() })?;
        Ok(Self::File(FileOutput { encoder: Some(encoder), temporary, target: path.to_owned() }))
    }

    /// Connects to a viewer and waits until it answers.
    pub(crate) fn viewer(address: &str) -> Result<Self, RecordingError> {
        let url = if address.contains("://") {
            address.to_owned()
        } else {
            format!("rerun+http://{address}/proxy")
        };
        let uri = rerun::external::re_uri::ProxyUri::from_str(&url)
            .map_err(|e| RecordingError::Address { address: address.to_owned(), why: e.to_string() })?;
        let sink = GrpcSink::new(uri);
        sink.flush_blocking(VIEWER_PATIENCE)
            .map_err(|e| RecordingError::NoViewer { address: address.to_owned(), why: e.to_string() })?;
        Ok(Self::Viewer { sink, address: address.to_owned(), lost: None })
    }

    /// Whether somebody looks while it is written.
    pub(crate) fn is_live(&self) -> bool {
        matches!(self, Self::Viewer { .. })
    }

    /// Writes or sends one message.
    pub(crate) fn send(&mut self, message: LogMsg) -> Result<(), RecordingError> {
        match self {
            Self::File(file) => file.send(&message),
            Self::Viewer { sink, .. } => {
                sink.send(message);
                Ok(())
            }
        }
    }

    /// Ends the stream; a file gets its name.
    pub(crate) fn finish(&mut self) -> Result<(), RecordingError> {
        match self {
            Self::File(file) => file.finish(),
            // Whoever watched may have gone; what was computed is not lost with the window.
            Self::Viewer { sink, address, lost } => {
                if let Err(error) = sink.flush_blocking(VIEWER_PATIENCE) {
                    *lost = Some(format!(
                        "the viewer at {address} did not take the end of the recording: {error}"
                    ));
                }
                Ok(())
            }
        }
    }

    /// Why a viewer did not get everything; `None` where it did, and for files.
    pub(crate) fn lost(&self) -> Option<&str> {
        match self {
            Self::File(_) => None,
            Self::Viewer { lost, .. } => lost.as_deref(),
        }
    }
}

impl FileOutput {
    fn encode_error(&self, why: &dyn std::fmt::Display) -> RecordingError {
        RecordingError::Encode { target: self.target.display().to_string(), why: why.to_string() }
    }

    fn file_error(&self, action: &'static str, source: std::io::Error) -> RecordingError {
        RecordingError::File { action, path: self.target.clone(), source }
    }

    fn send(&mut self, message: &LogMsg) -> Result<(), RecordingError> {
        let Some(encoder) = self.encoder.as_mut() else {
            return Err(self.encode_error(&"the recording is already finished"));
        };
        encoder.append(message).map(|_| ()).map_err(|e| self.encode_error(&e))
    }

    fn finish(&mut self) -> Result<(), RecordingError> {
        let Some(mut encoder) = self.encoder.take() else { return Ok(()) };
        encoder.finish().map_err(|e| self.encode_error(&e))?;
        let writer = encoder.into_inner().map_err(|e| self.encode_error(&e))?;
        drop(writer.into_inner().map_err(|e| self.file_error("cannot write", e.into_error()))?);
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(&self.temporary)
            .map_err(|e| self.file_error("cannot write", e))?;
        order_footer(&mut file).map_err(|e| self.encode_error(&e))?;
        file.sync_all().map_err(|e| self.file_error("cannot write", e))?;
        std::fs::rename(&self.temporary, &self.target).map_err(|e| self.file_error("cannot rename into", e))
    }
}

/// The transport form of the footer; the SDK does not export its name.
type Footer = <RrdFooter as ToTransport>::Output;

/// Puts the footer (which lists all chunks, once for the recording and once for the blueprint) into a fixed order.
///
/// The encoder collects its parts and their columns in hash maps, so that their order differs from run to run; readers
/// find both by name.
fn order_footer(file: &mut File) -> Result<(), Box<dyn std::error::Error>> {
    let size = StreamFooter::ENCODED_SIZE_BYTES;
    let mut tail = vec![0; size];
    file.seek(SeekFrom::End(-i64::try_from(size)?))?;
    file.read_exact(&mut tail)?;
    let stream_footer = StreamFooter::from_rrd_bytes(&tail)?;
    let Some(entry) = stream_footer.entries.first() else { return Ok(()) };
    let span = entry.rrd_footer_byte_span_from_start_excluding_header;
    let mut payload = vec![0; usize::try_from(span.len)?];
    file.seek(SeekFrom::Start(span.start))?;
    file.read_exact(&mut payload)?;
    let mut footer = Footer::from_rrd_bytes(&payload)?;
    for part in &mut footer.manifests {
        let mut manifest = part.to_application(())?;
        order_columns(&mut manifest)?;
        *part = manifest.to_transport(())?;
    }
    footer.manifests.sort_by_key(|manifest| format!("{:?}", manifest.store_id));
    let mut ordered = Vec::with_capacity(payload.len());
    footer.to_rrd_bytes(&mut ordered)?;
    let header_at = span.start - MessageHeader::ENCODED_SIZE_BYTES as u64;
    let mut end = Vec::with_capacity(ordered.len() + 100);
    MessageHeader { kind: MessageKind::End, len: ordered.len() as u64 }.to_rrd_bytes(&mut end)?;
    end.extend_from_slice(&ordered);
    StreamFooter::from_rrd_footer_bytes(span.start, &ordered).to_rrd_bytes(&mut end)?;
    file.seek(SeekFrom::Start(header_at))?;
    file.write_all(&end)?;
    file.set_len(header_at + end.len() as u64)?;
    Ok(())
}

/// Sorts the columns of one part of the footer by name.
fn order_columns(manifest: &mut RawRrdManifest) -> Result<(), Box<dyn std::error::Error>> {
    let mut fields: Vec<_> = manifest.sorbet_schema.fields().iter().cloned().collect();
    fields.sort_by_key(|field| {
        format!("{} {:?}", field.name(), field.metadata().iter().collect::<BTreeMap<_, _>>())
    });
    let metadata = manifest.sorbet_schema.metadata().clone();
    manifest.sorbet_schema = Schema::new_with_metadata(fields, metadata);
    manifest.sorbet_schema_sha256 = RawRrdManifest::compute_sorbet_schema_sha256(&manifest.sorbet_schema)?;
    let schema = manifest.data.schema();
    let mut order: Vec<usize> = (0..schema.fields().len()).collect();
    order.sort_by_key(|&i| schema.field(i).name().clone());
    manifest.data = manifest.data.project(&order)?;
    Ok(())
}

impl Drop for FileOutput {
    fn drop(&mut self) {
        // Gone after `finish`; what is still there belongs to a run that did not end.
        drop(self.encoder.take());
        std::fs::remove_file(&self.temporary).ok();
    }
}
