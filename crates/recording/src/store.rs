//! Rows per entity, collected into chunks and sent on: what is between the recorder and the file.
//!
//! A chunk (Rerun's unit of storage) costs about 1.5 kB before its first number, so rows are collected until an entity has
//! [`ROWS_PER_CHUNK`] of them or [`BYTES_PER_CHUNK`]. A row by itself is an array per component, one or two kilobytes for a
//! pose; so every [`ROWS_PER_PIECE`] of them are put into columns, where they take no more than their numbers. Identifiers of
//! rows and chunks, which the SDK makes of the wall clock, are counters here: a recording is a function of the run alone.

use crate::error::RecordingError;
use crate::output::Output;
use lumenav_core::SimTime;
use rerun::external::arrow::array::Array as _;
use rerun::external::re_log_types::{
    SetStoreInfo, StoreInfo, StoreSource, TimeCell, TimePoint, external::re_tuid::Tuid,
};
use rerun::log::{Chunk, ChunkId, ChunkResult, LogMsg, RowId};
use rerun::time::TimelineName;
use rerun::{AsComponents, EntityPath, EntityPathPart, StoreId};
use std::collections::BTreeMap;

/// Name of the timeline of simulated time.
pub const SIM_TIME: &str = "sim_time";
/// Name of the timeline that counts a track's updates.
pub const UPDATE: &str = "update";
/// Rows of one entity after which its chunk is written.
const ROWS_PER_CHUNK: usize = 1024;
/// Rows of one entity after which they become columns: the memory of the rest is small against that of a chunk, and columns are
/// made anew sixteen times a chunk.
const ROWS_PER_PIECE: usize = 64;
/// Bytes of one entity after which its chunk is written.
const BYTES_PER_CHUNK: usize = 1 << 18;

/// One store (the recording, or its blueprint) on its way to an output.
pub(crate) struct Store {
    id: StoreId,
    next_row: u64,
    next_chunk: u64,
    pending: BTreeMap<EntityPath, Pending>,
}

/// Rows of one entity that are not written yet.
#[derive(Default)]
struct Pending {
    /// All but the last of them, in columns.
    columns: Option<Chunk>,
    /// The last.
    rows: Vec<(RowId, TimePoint, Vec<rerun::SerializedComponentBatch>)>,
    /// The timelines that they are on.
    timelines: Vec<TimelineName>,
    count: usize,
    bytes: usize,
}

/// `a/b/c` as a path whose parts may hold any character.
pub(crate) fn entity(path: &str) -> EntityPath {
    EntityPath::new(path.split('/').filter(|part| !part.is_empty()).map(EntityPathPart::new).collect())
}

/// A point on the timelines.
pub(crate) fn time_point(at: SimTime, update: Option<u64>) -> TimePoint {
    let mut cells = BTreeMap::new();
    cells.insert(SIM_TIME.into(), TimeCell::from_duration_nanos(at.0));
    if let Some(update) = update {
        cells.insert(UPDATE.into(), TimeCell::from_sequence(i64::try_from(update).unwrap_or(i64::MAX)));
    }
    TimePoint::from(cells)
}

/// Bytes of the numbers in a row, before compression.
pub(crate) fn row_bytes(batches: &[rerun::SerializedComponentBatch]) -> usize {
    // 48: row id and two times.
    48 + batches.iter().map(|batch| batch.array.get_buffer_memory_size()).sum::<usize>()
}

impl Store {
    /// Announces the store to the output.
    pub(crate) fn open(id: StoreId, output: &mut Output) -> Result<Self, RecordingError> {
        let source = StoreSource::Other(format!("lumenav {}", env!("CARGO_PKG_VERSION")));
        let info = StoreInfo::new_unversioned(id.clone(), source);
        output.send(LogMsg::SetStoreInfo(SetStoreInfo { row_id: Tuid::from_nanos_and_inc(0, 1), info }))?;
        Ok(Self { id, next_row: 1, next_chunk: 1, pending: BTreeMap::new() })
    }

    /// The store's identity.
    pub(crate) fn id(&self) -> &StoreId {
        &self.id
    }

    /// Adds a row at a point in time; an empty time point makes it hold for all times.
    pub(crate) fn log(
        &mut self,
        output: &mut Output,
        path: &EntityPath,
        at: TimePoint,
        what: &dyn AsComponents,
    ) -> Result<(), RecordingError> {
        self.log_batches(output, path, at, what.as_serialized_batches())
    }

    /// As [`Store::log`] with components already in columns.
    pub(crate) fn log_batches(
        &mut self,
        output: &mut Output,
        path: &EntityPath,
        at: TimePoint,
        batches: Vec<rerun::SerializedComponentBatch>,
    ) -> Result<(), RecordingError> {
        let row = RowId::from_tuid(Tuid::from_nanos_and_inc(0, self.next_row));
        self.next_row += 1;
        // All rows of a chunk are on the same timelines (none: they hold for all times).
        let pending = self.pending.entry(path.clone()).or_default();
        if pending.count > 0 && !pending.timelines.iter().eq(at.timeline_names()) {
            self.flush_entity(output, path)?;
        }
        let pending = self.pending.entry(path.clone()).or_default();
        if pending.count == 0 {
            pending.timelines = at.timeline_names().copied().collect();
        }
        pending.bytes += row_bytes(&batches);
        pending.count += 1;
        pending.rows.push((row, at, batches));
        if pending.count >= ROWS_PER_CHUNK || pending.bytes >= BYTES_PER_CHUNK {
            self.flush_entity(output, path)
        } else if pending.rows.len() >= ROWS_PER_PIECE {
            pending.gather(path).map_err(|e| encode_error(path, &e))
        } else {
            Ok(())
        }
    }

    /// Writes the rows of one entity.
    fn flush_entity(&mut self, output: &mut Output, path: &EntityPath) -> Result<(), RecordingError> {
        let Some(mut pending) = self.pending.remove(path) else { return Ok(()) };
        let id = ChunkId::from_tuid(Tuid::from_nanos_and_inc(1, self.next_chunk));
        self.next_chunk += 1;
        pending.gather(path).map_err(|e| encode_error(path, &e))?;
        let Some(chunk) = pending.columns else { return Ok(()) };
        let message = chunk.with_id(id).to_arrow_msg().map_err(|e| encode_error(path, &e))?;
        output.send(LogMsg::ArrowMsg(self.id.clone(), message))
    }

    /// Writes all rows that wait.
    pub(crate) fn flush(&mut self, output: &mut Output) -> Result<(), RecordingError> {
        let paths: Vec<EntityPath> = self.pending.keys().cloned().collect();
        paths.iter().try_for_each(|path| self.flush_entity(output, path))
    }
}

impl Pending {
    /// Puts the rows into columns, behind those that are there.
    fn gather(&mut self, path: &EntityPath) -> ChunkResult<()> {
        if self.rows.is_empty() {
            return Ok(());
        }
        // Named when it is written: every piece is gone by then.
        let mut builder = Chunk::builder_with_id(ChunkId::ZERO, path.clone());
        for (row, at, batches) in std::mem::take(&mut self.rows) {
            builder = builder.with_serialized_batches(row, at, batches);
        }
        let piece = builder.build()?;
        self.columns = Some(match self.columns.take() {
            Some(before) => Chunk::concat_and_sort(&before, &piece)?,
            None => piece,
        });
        Ok(())
    }
}

fn encode_error(path: &EntityPath, why: &dyn std::fmt::Display) -> RecordingError {
    RecordingError::Encode { target: path.to_string(), why: why.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{inspect, read_scalars};

    /// Rows end in a piece, with one, or between two of them, and so do chunks.
    #[test]
    fn law_rows_are_what_was_logged_however_many_there_are() {
        let folder = tempfile::tempdir().unwrap();
        for count in [1, 63, 64, 65, 128, 1023, 1024, 1025, 2048, 2500] {
            let path = folder.path().join(format!("{count}.rrd"));
            let mut output = Output::file(&path).unwrap();
            let mut store = Store::open(StoreId::recording("lumenav", "rows"), &mut output).unwrap();
            let at = |i: i64| time_point(SimTime(i * 1000), Some(i as u64));
            for i in 0..count {
                let value = rerun::Scalars::single(0.5 * i as f64);
                store.log(&mut output, &entity("plots/a"), at(i), &value).unwrap();
                let waiting = store.pending.get(&entity("plots/a")).map_or(0, |pending| pending.rows.len());
                assert!(waiting < ROWS_PER_PIECE, "{waiting} rows wait by themselves");
            }
            store.flush(&mut output).unwrap();
            output.finish().unwrap();
            let expected: Vec<(i64, f64)> = (0..count).map(|i| (i * 1000, 0.5 * i as f64)).collect();
            assert_eq!(read_scalars(&path, "/plots/a").unwrap(), expected, "{count}");
            assert_eq!(inspect(&path).unwrap().rows["/plots/a"], count as u64);
        }
    }
}
