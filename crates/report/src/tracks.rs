//! `tracks.parquet`: every update of every track, with its errors. The numbers of record.
//!
//! One row is one update. Columns that do not apply (no truth, no velocity, a start without innovation) are null. The unit
//! of each column is in its field's metadata (key `unit`); the file's key-value metadata say schema version, error convention,
//! frame, seed and scenario. `covariance` is the upper triangle, row by row, of the covariance of
//! `[δp_world (m), δθ_capsule (rad)]`: 21 numbers in m², m·rad, rad².

use crate::error::ReportError;
use crate::parquet_table::{ParquetTable, ROWS_PER_BATCH, field};
use crate::row::{COVARIANCE_LENGTH, NUMBERS, TrackRow};
use arrow::array::{
    Array, ArrayRef, BooleanArray, FixedSizeListArray, Float64Array, Int64Array, RecordBatch, StringArray,
    UInt8Array, UInt64Array,
};
use arrow::datatypes::{DataType, Field, Schema};
use arrow::error::ArrowError;
use lumenav_pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::file::metadata::KeyValue;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// Version of the columns; a reader refuses others.
pub const TRACKS_SCHEMA_VERSION: &str = "1";

/// The columns.
fn schema() -> Schema {
    let mut fields = vec![
        field("track", DataType::Utf8, false, "1"),
        field("sensor", DataType::Utf8, false, "1"),
        field("update", DataType::UInt64, false, "1"),
        field("t_ns", DataType::Int64, false, "ns"),
        field("available_ns", DataType::Int64, false, "ns"),
        field("pose_dof", DataType::UInt8, false, "1"),
        field("nees_dof", DataType::UInt8, true, "1"),
        field("started", DataType::Boolean, false, "1"),
        field("accepted", DataType::Boolean, false, "1"),
        field("valid", DataType::Boolean, false, "1"),
    ];
    fields.extend(NUMBERS.iter().map(|(name, unit)| field(name, DataType::Float64, true, unit)));
    let item = Arc::new(Field::new("item", DataType::Float64, false));
    let list = DataType::FixedSizeList(item, COVARIANCE_LENGTH as i32);
    fields.push(field("covariance", list, false, "m^2, m rad, rad^2"));
    Schema::new(fields)
}

/// Rows as columns.
fn columns(rows: &[TrackRow]) -> Result<Vec<ArrayRef>, ArrowError> {
    let mut columns: Vec<ArrayRef> = vec![
        Arc::new(StringArray::from_iter_values(rows.iter().map(|r| &*r.track))),
        Arc::new(StringArray::from_iter_values(rows.iter().map(|r| &*r.sensor))),
        Arc::new(UInt64Array::from_iter_values(rows.iter().map(|r| r.update))),
        Arc::new(Int64Array::from_iter_values(rows.iter().map(|r| r.t_ns))),
        Arc::new(Int64Array::from_iter_values(rows.iter().map(|r| r.available_ns))),
        Arc::new(UInt8Array::from_iter_values(rows.iter().map(|r| r.pose_dof))),
        Arc::new(rows.iter().map(|r| r.nees_dof).collect::<UInt8Array>()),
        Arc::new(rows.iter().map(|r| Some(r.started)).collect::<BooleanArray>()),
        Arc::new(rows.iter().map(|r| Some(r.accepted)).collect::<BooleanArray>()),
        Arc::new(rows.iter().map(|r| Some(r.valid)).collect::<BooleanArray>()),
    ];
    for i in 0..NUMBERS.len() {
        columns.push(Arc::new(rows.iter().map(|r| r.numbers[i]).collect::<Float64Array>()));
    }
    let flat = Float64Array::from_iter_values(rows.iter().flat_map(|r| r.covariance));
    let item = Arc::new(Field::new("item", DataType::Float64, false));
    columns.push(Arc::new(FixedSizeListArray::try_new(
        item,
        COVARIANCE_LENGTH as i32,
        Arc::new(flat),
        None,
    )?));
    Ok(columns)
}

/// Writes `tracks.parquet` into a folder.
pub struct TracksObserver {
    table: ParquetTable<TrackRow>,
}

impl TracksObserver {
    /// The file goes into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        Self { table: ParquetTable::new(folder.join("tracks.parquet"), schema(), columns) }
    }
}

/// What the file says of itself.
fn key_values(header: &RunHeader) -> Vec<KeyValue> {
    let pair = |key: &str, value: String| KeyValue::new(key.to_owned(), value);
    vec![
        pair("schema_version", TRACKS_SCHEMA_VERSION.to_owned()),
        pair(
            "error_convention",
            "estimate minus truth in the world; covariance of [dp_world, dtheta_capsule], right perturbation, \
             upper triangle row by row"
                .to_owned(),
        ),
        pair("frame", "world, RAS: x right, y anterior, z superior; poses world_from_capsule".to_owned()),
        pair("scenario", header.scenario.clone()),
        pair("seed", header.seed.to_string()),
        pair("trial", header.trial.to_string()),
    ]
}

impl RunObserver for TracksObserver {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        self.table.open(Some(key_values(header))).map_err(|e| ObserverError::new("tracks", e))
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        let RunEvent::Update(update) = event else { return Ok(()) };
        self.table.push(TrackRow::of(update)).map_err(|e| ObserverError::new("tracks", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        self.table.close().map_err(|e| ObserverError::new("tracks", e))
    }
}

/// What the file says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TracksInfo {
    /// Scenario.
    pub scenario: String,
    /// Seed.
    pub seed: String,
    /// Number of rows.
    pub rows: u64,
}

/// Calls `see` for each row of a `tracks.parquet`, in the file's order, a few thousand in memory at a time.
///
/// # Errors
/// [`ReportError::File`] where it cannot be opened, [`ReportError::Table`] where it is no such table.
pub fn for_each_track_row(path: &Path, mut see: impl FnMut(TrackRow)) -> Result<TracksInfo, ReportError> {
    let file = File::open(path).map_err(ReportError::file("cannot open", path))?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(ReportError::table(path))?;
    let metadata = builder.metadata().file_metadata();
    let value = |key: &str| -> Option<String> {
        metadata.key_value_metadata()?.iter().find(|pair| pair.key == key)?.value.clone()
    };
    let version = value("schema_version").unwrap_or_default();
    if version != TRACKS_SCHEMA_VERSION {
        let what = format!("schema version `{version}`, this program reads {TRACKS_SCHEMA_VERSION}");
        return Err(ReportError::Table { path: path.to_owned(), what });
    }
    let info = TracksInfo {
        scenario: value("scenario").unwrap_or_default(),
        seed: value("seed").unwrap_or_default(),
        rows: metadata.num_rows() as u64,
    };
    let reader = builder.with_batch_size(ROWS_PER_BATCH).build().map_err(ReportError::table(path))?;
    for batch in reader {
        let batch = batch.map_err(ReportError::table(path))?;
        let columns = Columns::of(&batch).map_err(|column| ReportError::Table {
            path: path.to_owned(),
            what: format!("column `{column}` is missing or of another kind"),
        })?;
        (0..batch.num_rows()).for_each(|i| see(columns.row(i)));
    }
    Ok(info)
}

/// All rows of a `tracks.parquet`.
///
/// # Errors
/// As [`for_each_track_row`].
pub fn read_tracks(path: &Path) -> Result<Vec<TrackRow>, ReportError> {
    let mut rows = Vec::new();
    for_each_track_row(path, |row| rows.push(row))?;
    Ok(rows)
}

/// The columns of a batch, found by name.
struct Columns<'a> {
    track: &'a StringArray,
    sensor: &'a StringArray,
    update: &'a UInt64Array,
    t_ns: &'a Int64Array,
    available_ns: &'a Int64Array,
    pose_dof: &'a UInt8Array,
    nees_dof: &'a UInt8Array,
    started: &'a BooleanArray,
    accepted: &'a BooleanArray,
    valid: &'a BooleanArray,
    numbers: Vec<&'a Float64Array>,
    covariance: &'a Float64Array,
}

/// A column by name and kind; its name where it is not there.
fn column<'a, A: Array + 'static>(batch: &'a RecordBatch, name: &str) -> Result<&'a A, String> {
    batch.column_by_name(name).and_then(|c| c.as_any().downcast_ref::<A>()).ok_or_else(|| name.to_owned())
}

impl<'a> Columns<'a> {
    fn of(batch: &'a RecordBatch) -> Result<Self, String> {
        let list: &FixedSizeListArray = column(batch, "covariance")?;
        let covariance = list.values().as_any().downcast_ref::<Float64Array>();
        let sound = list.value_length() as usize == COVARIANCE_LENGTH && list.offset() == 0;
        Ok(Self {
            track: column(batch, "track")?,
            sensor: column(batch, "sensor")?,
            update: column(batch, "update")?,
            t_ns: column(batch, "t_ns")?,
            available_ns: column(batch, "available_ns")?,
            pose_dof: column(batch, "pose_dof")?,
            nees_dof: column(batch, "nees_dof")?,
            started: column(batch, "started")?,
            accepted: column(batch, "accepted")?,
            valid: column(batch, "valid")?,
            numbers: NUMBERS.iter().map(|(name, _)| column(batch, name)).collect::<Result<_, _>>()?,
            covariance: covariance.filter(|_| sound).ok_or("covariance")?,
        })
    }

    fn row(&self, i: usize) -> TrackRow {
        let mut numbers = [None; NUMBERS.len()];
        for (number, column) in numbers.iter_mut().zip(&self.numbers) {
            *number = column.is_valid(i).then(|| column.value(i));
        }
        let mut covariance = [0.0; COVARIANCE_LENGTH];
        for (j, value) in covariance.iter_mut().enumerate() {
            *value = self.covariance.value(i * COVARIANCE_LENGTH + j);
        }
        TrackRow {
            track: self.track.value(i).into(),
            sensor: self.sensor.value(i).into(),
            update: self.update.value(i),
            t_ns: self.t_ns.value(i),
            available_ns: self.available_ns.value(i),
            pose_dof: self.pose_dof.value(i),
            nees_dof: self.nees_dof.is_valid(i).then(|| self.nees_dof.value(i)),
            started: self.started.value(i),
            accepted: self.accepted.value(i),
            valid: self.valid.value(i),
            numbers,
            covariance,
        }
    }
}
