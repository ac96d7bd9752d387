//! Recorded magnetometer data.
//!
//! Two layouts. [`wide`]: `t_s,s0x_T,s0y_T,s0z_T,s1x_T,…`, one row per reading; a second file
//! `t_s,sensor,x_m,y_m,z_m,qx,qy,qz,qw` may give every sensor its pose at every reading. [`long`]: one row per sensor and
//! reading, with the columns named in `[files.columns]`, and the sensor's pose in the row. In both an empty cell is a lost
//! channel. Files of [`calibration`] are applied to every reading.
//!
//! The wide layout may place its readings in time by the columns of [`lumenav_records::place`].
//!
//! Bad rows: `strict` stops at the first; `skip` goes on and hands out what it passed over, row by row; a reading that is
//! passed over leaves a gap in the readings' sequence, as a lost one does.

pub mod calibration;
pub mod long;
pub mod wide;

use crate::config::Installed;
use crate::sensor::flux_schema;
use calibration::Calibration;
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::{Frame, ModalityError, Name, Node, Reading, ReadingStream, Schema, Setup, SimTime};
use lumenav_records::place::Place;
use lumenav_records::{BadRows, Table};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

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
    /// Time that becomes 0, s; absent: 0 in the wide layout, the first reading's in the long one (that is, of the first that has a
    /// time, whether the rest of it can be read or not).
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

/// Opens recorded data.
///
/// # Errors
/// [`ModalityError`] with file, line and column.
pub fn open(installed: &Installed, node: &Node, setup: &Setup) -> Result<ReadingStream, ModalityError> {
    let files: FilesTable = node.parse()?;
    let calibration = Calibration::open(installed, node, &files)?;
    let table = Table::open(&node.existing_path("flux_csv", &files.flux_csv)?)?;
    let output = Output {
        sensor: setup.sensor.clone(),
        schema: flux_schema(installed.array.labels()),
        bad_rows: files.bad_rows,
        sequence: 0,
        last: None,
    };
    Ok(if let Some(columns) = &files.columns {
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
    })
}

/// What both layouts do with a reading once its row or rows are read.
struct Output {
    sensor: Name,
    schema: Arc<Schema>,
    bad_rows: BadRows,
    sequence: u64,
    last: Option<(SimTime, Option<u64>)>,
}

impl Output {
    /// Takes the next reading's place in: readings come in order of arrival, and of two that arrive at once (one of them
    /// late) the file must give the order by their counts.
    fn advance(&mut self, place: &Place) -> Result<(), String> {
        let at = place.arrival;
        if let Some((last, sequence)) = self.last {
            let in_order = at > last || (at == last && place.sequence > sequence && sequence.is_some());
            if !in_order {
                return Err(format!("time {} s does not increase", at.seconds()));
            }
        }
        self.last = Some((at, place.sequence));
        Ok(())
    }

    fn reading(
        &mut self,
        place: &Place,
        known_poses: BTreeMap<String, Isometry3<f64>>,
        values: Vec<f64>,
    ) -> Result<Reading, ModalityError> {
        let sequence = place.sequence.unwrap_or(self.sequence);
        self.sequence = sequence.saturating_add(1);
        Ok(Reading {
            sensor: self.sensor.clone(),
            sequence,
            interval: place.interval,
            arrival: place.arrival,
            known_poses,
            payload: Frame::of_values(self.schema.clone(), values)?,
        })
    }

    /// Whether a reading that could not be read may be passed over; if so it leaves a gap in the sequence.
    fn passes_over(&mut self, error: &ModalityError) -> bool {
        let pass = self.bad_rows == BadRows::Skip && matches!(error, ModalityError::Row { .. });
        self.sequence = self.sequence.saturating_add(u64::from(pass));
        pass
    }
}
