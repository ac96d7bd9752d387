//! `truth.parquet`: the capsule's true motion at the rate of `[record]`, with what a TUM file cannot hold: velocity, the place
//! along the tract, the segment, the wall's force.
//!
//! Columns that do not apply (no tract, no segment) are null; a world without a wall pushes with 0 N. Units are in the fields' metadata (key `unit`). Equal runs give
//! equal bytes; rows are written in groups as they come.

use crate::error::ReportError;
use crate::tracks::ROWS_PER_GROUP;
use arrow::array::{Array, ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray};
use arrow::datatypes::{DataType, Field, Schema};
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;
use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Rows that are turned into columns at once.
const ROWS_PER_BATCH: usize = 4096;

/// Names and units of the numbers.
const NUMBERS: [(&str, &str); 15] = [
    ("x_m", "m"),
    ("y_m", "m"),
    ("z_m", "m"),
    ("qx", "1"),
    ("qy", "1"),
    ("qz", "1"),
    ("qw", "1"),
    ("vx_m_s", "m/s"),
    ("vy_m_s", "m/s"),
    ("vz_m_s", "m/s"),
    ("wx_rad_s", "rad/s"),
    ("wy_rad_s", "rad/s"),
    ("wz_rad_s", "rad/s"),
    ("arc_length_m", "m"),
    ("wall_force_n", "N"),
];

struct Row {
    t_ns: i64,
    numbers: [Option<f64>; NUMBERS.len()],
    segment: Option<String>,
}

fn schema() -> Arc<Schema> {
    let field = |name: &str, kind: DataType, nullable: bool, unit: &str| {
        Field::new(name, kind, nullable).with_metadata(HashMap::from([("unit".to_owned(), unit.to_owned())]))
    };
    let mut fields = vec![field("t_ns", DataType::Int64, false, "ns")];
    fields.extend(NUMBERS.iter().map(|(name, unit)| field(name, DataType::Float64, true, unit)));
    fields.push(field("segment", DataType::Utf8, true, "1"));
    Arc::new(Schema::new(fields))
}

/// Writes `truth.parquet` into a folder, where there is a truth.
pub struct TruthObserver {
    path: PathBuf,
    schema: Arc<Schema>,
    writer: Option<ArrowWriter<File>>,
    waiting: Vec<Row>,
    last: Option<i64>,
}

impl TruthObserver {
    /// The file goes into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        let waiting = Vec::with_capacity(ROWS_PER_BATCH);
        Self { path: folder.join("truth.parquet"), schema: schema(), writer: None, waiting, last: None }
    }

    fn open(&mut self) -> Result<(), ReportError> {
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(format!("lumenav {}", env!("CARGO_PKG_VERSION")))
            .set_max_row_group_row_count(Some(ROWS_PER_GROUP))
            .build();
        let file = File::create(&self.path).map_err(ReportError::file("cannot create", &self.path))?;
        let writer = ArrowWriter::try_new(file, self.schema.clone(), Some(properties));
        self.writer = Some(writer.map_err(ReportError::table(&self.path))?);
        Ok(())
    }

    fn push(&mut self, row: Row) -> Result<(), ReportError> {
        self.waiting.push(row);
        if self.waiting.len() >= ROWS_PER_BATCH { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ReportError> {
        let Some(writer) = self.writer.as_mut() else { return Ok(()) };
        let rows = &self.waiting;
        let mut columns: Vec<ArrayRef> =
            vec![Arc::new(Int64Array::from_iter_values(rows.iter().map(|r| r.t_ns)))];
        for i in 0..NUMBERS.len() {
            columns.push(Arc::new(rows.iter().map(|r| r.numbers[i]).collect::<Float64Array>()));
        }
        columns.push(Arc::new(rows.iter().map(|r| r.segment.as_deref()).collect::<StringArray>()));
        let batch =
            RecordBatch::try_new(self.schema.clone(), columns).map_err(ReportError::table(&self.path))?;
        self.waiting.clear();
        writer.write(&batch).map_err(ReportError::table(&self.path))
    }

    fn close(&mut self) -> Result<(), ReportError> {
        self.flush()?;
        let Some(writer) = self.writer.take() else { return Ok(()) };
        let file = writer.into_inner().map_err(ReportError::table(&self.path))?;
        file.sync_all().map_err(ReportError::file("cannot write", &self.path))
    }
}

impl RunObserver for TruthObserver {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        if header.has_truth { self.open().map_err(|e| ObserverError::new("truth", e)) } else { Ok(()) }
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        let RunEvent::Truth(truth) = event else { return Ok(()) };
        // Two sensors of a replay ask about the same instants.
        if self.last.is_some_and(|last| truth.at.0 <= last) {
            return Ok(());
        }
        self.last = Some(truth.at.0);
        let (p, q) = (truth.world_from_capsule.translation.vector, truth.world_from_capsule.rotation.coords);
        let (v, w) = (truth.velocity_world_m_s, truth.angular_rate_capsule_rad_s);
        let mut numbers = [None; NUMBERS.len()];
        let known = [p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z];
        for (slot, value) in numbers.iter_mut().zip(known) {
            *slot = Some(value);
        }
        numbers[13] = truth.arc_length_m;
        numbers[14] = Some(truth.wall_force_n);
        let segment = truth.segment.as_ref().map(ToString::to_string);
        self.push(Row { t_ns: truth.at.0, numbers, segment }).map_err(|e| ObserverError::new("truth", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.close().map_err(|e| ObserverError::new("truth", e))
    }
}

/// Times (ns) and arc lengths along the tract (m) of a `truth.parquet`; no rows where the run had no tract.
///
/// # Errors
/// [`ReportError::File`] where it cannot be opened, [`ReportError::Table`] where it is no such table.
pub fn read_arc_length(path: &Path) -> Result<Vec<(i64, f64)>, ReportError> {
    let file = File::open(path).map_err(ReportError::file("cannot open", path))?;
    let reader = ParquetRecordBatchReaderBuilder::try_new(file)
        .and_then(ParquetRecordBatchReaderBuilder::build)
        .map_err(ReportError::table(path))?;
    let mut rows = Vec::new();
    for batch in reader {
        let batch = batch.map_err(ReportError::table(path))?;
        let times = batch.column_by_name("t_ns").and_then(|c| c.as_any().downcast_ref::<Int64Array>());
        let lengths =
            batch.column_by_name("arc_length_m").and_then(|c| c.as_any().downcast_ref::<Float64Array>());
        let (Some(times), Some(lengths)) = (times, lengths) else {
            return Err(ReportError::table(path)(
                "columns `t_ns` and `arc_length_m` are missing or of another kind",
            ));
        };
        rows.extend(
            (0..batch.num_rows())
                .filter(|i| lengths.is_valid(*i))
                .map(|i| (times.value(i), lengths.value(i))),
        );
    }
    Ok(rows)
}
