//! Recorded magnetometer data.
//!
//! Two layouts. [`wide`]: `t_s,s0x_T,s0y_T,s0z_T,s1x_T,…`, one row per reading; a second file
//! `t_s,sensor,x_m,y_m,z_m,qx,qy,qz,qw` may give every sensor its pose at every reading. [`long`]: one row per sensor and
//! reading, with the columns named in `[files.columns]`, and the sensor's pose in the row. In both an empty cell is a lost
//! channel. Files of [`calibration`] are applied to every reading.
//!
//! Bad rows: `strict` stops at the first; `skip` goes on, and shows it twice: a skipped reading leaves a gap in the readings'
//! sequence, as a lost one does, and [`open_counted`] hands out the count with the first message.

pub mod calibration;
pub mod long;
pub mod wide;

use crate::config::Installed;
use crate::sensor::flux_schema;
use calibration::Calibration;
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::{Frame, ModalityError, Name, Node, Reading, ReadingStream, Schema, Setup, SimTime};
use lumenav_records::{BadRows, Table};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// `[sensor.files]` of a replay.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilesTable {
    /// The readings.
    pub flux_csv: String,
    /// Poses per sensor and reading, for a flexible array in the wide layout.
    pub poses_csv: Option<String>,
    /// Static background, subtracted from every reading.
    pub background_csv: Option<String>,
    /// Apparent magnetisation of the test magnet per sensor (one row, A/m times `magnetization_unit_a_m`): a calibration of the
    /// sensors' gains. A sensor that sees it 1 % too strong reads 1 % too much and is divided by 1.01.
    pub magnetization_csv: Option<String>,
    /// Unit of that file, A/m per number.
    #[serde(default = "one")]
    pub magnetization_unit_a_m: Positive,
    /// Time that becomes 0, s; absent: 0 in the wide layout, the first reading's in the long one.
    pub time_zero_s: Option<Finite>,
    /// Unit of the background file and of the long layout's flux, T per number (1e-6 for microtesla).
    #[serde(default = "one")]
    pub flux_unit_tesla: Positive,
    /// `strict` or `skip`.
    #[serde(default)]
    pub bad_rows: BadRows,
    /// Present for the long layout.
    pub columns: Option<LongColumns>,
}

fn one() -> Positive {
    Positive(1.0)
}

/// Names of the columns of the long layout.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LongColumns {
    /// Rows with the same entry here, one after another, form one reading; their order is that of the array's sensors.
    pub reading: String,
    /// Time of a row, s; absent: the readings' count times `period_s`. The first row of a reading counts.
    pub time_s: Option<String>,
    /// Period where there is no time column, s.
    pub period_s: Option<Positive>,
    /// Flux along the sensor's axes.
    pub flux: [String; 3],
    /// Sensor position in the world, mm.
    pub position_mm: [String; 3],
    /// Sensor attitude, world from sensor, as a rotation vector, rad.
    pub rotation_vector_rad: [String; 3],
    /// Added to the positions, mm: puts the world's origin near the data.
    #[serde(default)]
    pub origin_mm: [Finite; 3],
}

/// What `bad_rows = "skip"` passed over so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    /// Rows that could not be read.
    pub rows: u64,
    /// Readings that are missing for it.
    pub readings: u64,
    /// The first message, with file and line.
    pub first: Option<String>,
}

/// Counts while a stream is read; clones share the count.
#[derive(Clone, Debug, Default)]
pub struct SkipCount(Arc<Mutex<Skipped>>);

impl SkipCount {
    /// What was passed over so far.
    pub fn get(&self) -> Skipped {
        // A poisoned lock means that another thread panicked while counting; the numbers are still whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn note(&self, error: &ModalityError, rows: u64, readings: u64) {
        let mut skipped = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        skipped.rows += rows;
        skipped.readings += readings;
        skipped.first.get_or_insert_with(|| error.to_string());
    }
}

/// Opens recorded data.
///
/// # Errors
/// [`ModalityError`] with file, line and column.
pub fn open(installed: &Installed, node: &Node, setup: &Setup) -> Result<ReadingStream, ModalityError> {
    open_counted(installed, node, setup).map(|(stream, _)| stream)
}

/// As [`open`], with the count of what `bad_rows = "skip"` passes over.
///
/// # Errors
/// As [`open`].
pub fn open_counted(
    installed: &Installed,
    node: &Node,
    setup: &Setup,
) -> Result<(ReadingStream, SkipCount), ModalityError> {
    let files: FilesTable = node.parse()?;
    let calibration = Calibration::open(installed, node, &files)?;
    let table = Table::open(&node.existing_path("flux_csv", &files.flux_csv)?)?;
    let count = SkipCount::default();
    let output = Output {
        sensor: setup.sensor.clone(),
        schema: flux_schema(installed.array.labels()),
        bad_rows: files.bad_rows,
        count: count.clone(),
        sequence: 0,
        last: None,
    };
    let stream: ReadingStream = if let Some(columns) = &files.columns {
        if files.poses_csv.is_some() {
            let message = "the long layout has the poses in its own rows";
            return Err(node.error_at("poses_csv", message).into());
        }
        if columns.time_s.is_none() && columns.period_s.is_none() {
            return Err(node.error_at("columns", "give `time_s` or `period_s`").into());
        }
        Box::new(long::LongReader::new(table, columns, &files, calibration, output)?)
    } else {
        let poses = match &files.poses_csv {
            Some(name) => {
                let path = node.existing_path("poses_csv", name)?;
                Some(wide::PoseTable::open(&path, installed.array.sensors.len())?)
            }
            None => None,
        };
        Box::new(wide::WideReader::new(table, &installed.array.labels(), poses, &files, calibration, output)?)
    };
    Ok((stream, count))
}

/// What both layouts do with a reading once its row or rows are read.
struct Output {
    sensor: Name,
    schema: Arc<Schema>,
    bad_rows: BadRows,
    count: SkipCount,
    sequence: u64,
    last: Option<SimTime>,
}

/// Times beyond this overflow nanoseconds in 64 bits.
const MAX_TIME_S: f64 = 9e9;

impl Output {
    /// The time of the next reading; it must be later than the last one's.
    fn advance(&mut self, time_s: f64) -> Result<SimTime, String> {
        if time_s.abs() > MAX_TIME_S {
            return Err(format!("time {time_s:e} s is out of range"));
        }
        let at = SimTime::from_seconds(time_s);
        if self.last.is_some_and(|last| at <= last) {
            return Err(format!("time {time_s} s does not increase"));
        }
        self.last = Some(at);
        Ok(at)
    }

    fn reading(
        &mut self,
        at: SimTime,
        known_poses: BTreeMap<String, Isometry3<f64>>,
        values: Vec<f64>,
    ) -> Result<Reading, ModalityError> {
        let sequence = self.sequence;
        self.sequence += 1;
        Ok(Reading {
            sensor: self.sensor.clone(),
            sequence,
            interval: (at, at),
            arrival: at,
            known_poses,
            payload: Frame::of_values(self.schema.clone(), values)?,
        })
    }

    /// Whether a reading that could not be read is passed over; if so it is counted and leaves a gap in the sequence.
    fn passes_over(&mut self, error: &ModalityError, bad_rows: u64) -> bool {
        let pass = self.may_skip(error);
        if pass {
            self.sequence += 1;
            self.count.note(error, bad_rows, 1);
        }
        pass
    }

    fn may_skip(&self, error: &ModalityError) -> bool {
        self.bad_rows == BadRows::Skip && matches!(error, ModalityError::Row { .. })
    }
}
