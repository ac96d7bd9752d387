//! `truth.parquet`: the capsule's true motion at the rate of `[record]`, with what a TUM file cannot hold: velocity, the place
//! along the tract, the segment, the wall's force.
//!
//! Columns that do not apply (no tract, no segment, no wall) are null. Units are in the fields' metadata (key `unit`).

use crate::error::ReportError;
use crate::parquet_table::{ParquetTable, field};
use arrow::array::{Array, ArrayRef, Float64Array, Int64Array, StringArray};
use arrow::datatypes::{DataType, Schema};
use arrow::error::ArrowError;
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

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

fn schema() -> Schema {
    let mut fields = vec![field("t_ns", DataType::Int64, false, "ns")];
    fields.extend(NUMBERS.iter().map(|(name, unit)| field(name, DataType::Float64, true, unit)));
    fields.push(field("segment", DataType::Utf8, true, "1"));
    Schema::new(fields)
}

/// Rows as columns.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the shape that a table asks for: columns of other files can fail"
)]
fn columns(rows: &[Row]) -> Result<Vec<ArrayRef>, ArrowError> {
    let mut columns: Vec<ArrayRef> =
        vec![Arc::new(Int64Array::from_iter_values(rows.iter().map(|r| r.t_ns)))];
    for i in 0..NUMBERS.len() {
        columns.push(Arc::new(rows.iter().map(|r| r.numbers[i]).collect::<Float64Array>()));
    }
    columns.push(Arc::new(rows.iter().map(|r| r.segment.as_deref()).collect::<StringArray>()));
    Ok(columns)
}

/// Writes `truth.parquet` into a folder, where there is a truth.
pub struct TruthObserver {
    table: ParquetTable<Row>,
    last: Option<i64>,
}

impl TruthObserver {
    /// The file goes into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        Self { table: ParquetTable::new(folder.join("truth.parquet"), schema(), columns), last: None }
    }
}

impl RunObserver for TruthObserver {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        if header.has_truth {
            self.table.open(None).map_err(|e| ObserverError::new("truth", e))
        } else {
            Ok(())
        }
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
        numbers[14] = truth.wall_force_n;
        let segment = truth.segment.as_ref().map(ToString::to_string);
        self.table
            .push(Row { t_ns: truth.at.0, numbers, segment })
            .map_err(|e| ObserverError::new("truth", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.table.close().map_err(|e| ObserverError::new("truth", e))
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
