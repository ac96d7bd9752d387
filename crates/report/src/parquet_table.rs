//! A Parquet file written row by row: rows wait until a batch is full, a batch becomes columns, batches become row groups.
//!
//! Compression is Snappy, memory is constant, equal rows give equal bytes.

use crate::error::ReportError;
use arrow::array::{ArrayRef, RecordBatch};
use arrow::datatypes::{DataType, Field, Schema};
use arrow::error::ArrowError;
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use std::collections::HashMap;
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;

/// Rows that are turned into columns at once, and read at once.
pub(crate) const ROWS_PER_BATCH: usize = 512;
/// Rows of a group: what a reader loads at once, and what the writer holds in memory (about 1,300 bytes a row of `tracks.parquet` with its
/// dictionaries, so one megabyte).
const ROWS_PER_GROUP: usize = 1024;

/// A column; its unit stands in its metadata (key `unit`).
pub(crate) fn field(name: &str, kind: DataType, nullable: bool, unit: &str) -> Field {
    Field::new(name, kind, nullable).with_metadata(HashMap::from([("unit".to_owned(), unit.to_owned())]))
}

/// A table of rows `R` on its way into a file.
pub(crate) struct ParquetTable<R> {
    path: PathBuf,
    schema: Arc<Schema>,
    /// Rows as columns, in the schema's order.
    columns: fn(&[R]) -> Result<Vec<ArrayRef>, ArrowError>,
    writer: Option<ArrowWriter<File>>,
    waiting: Vec<R>,
}

impl<R> ParquetTable<R> {
    /// A table that is not open yet.
    pub(crate) fn new(
        path: PathBuf,
        schema: Schema,
        columns: fn(&[R]) -> Result<Vec<ArrayRef>, ArrowError>,
    ) -> Self {
        Self {
            path,
            schema: Arc::new(schema),
            columns,
            writer: None,
            waiting: Vec::with_capacity(ROWS_PER_BATCH),
        }
    }

    /// Creates the file, with what it says of itself.
    pub(crate) fn open(&mut self, metadata: Option<Vec<KeyValue>>) -> Result<(), ReportError> {
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(format!("lumenav {}", env!("CARGO_PKG_VERSION")))
            .set_max_row_group_row_count(Some(ROWS_PER_GROUP))
            .set_key_value_metadata(metadata)
            .build();
        let file = File::create(&self.path).map_err(ReportError::file("cannot create", &self.path))?;
        let writer = ArrowWriter::try_new(file, self.schema.clone(), Some(properties));
        self.writer = Some(writer.map_err(ReportError::table(&self.path))?);
        Ok(())
    }

    /// Adds a row; nothing happens while the file is not open.
    pub(crate) fn push(&mut self, row: R) -> Result<(), ReportError> {
        if self.writer.is_none() {
            return Ok(());
        }
        self.waiting.push(row);
        if self.waiting.len() >= ROWS_PER_BATCH { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ReportError> {
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        let batch = (self.columns)(&self.waiting)
            .and_then(|columns| RecordBatch::try_new(self.schema.clone(), columns))
            .map_err(ReportError::table(&self.path))?;
        self.waiting.clear();
        writer.write(&batch).map_err(ReportError::table(&self.path))
    }

    /// Writes what waits and closes the file, if it was open.
    pub(crate) fn close(&mut self) -> Result<(), ReportError> {
        self.flush()?;
        let Some(writer) = self.writer.take() else { return Ok(()) };
        let file = writer.into_inner().map_err(ReportError::table(&self.path))?;
        file.sync_all().map_err(ReportError::file("cannot write", &self.path))
    }
}
