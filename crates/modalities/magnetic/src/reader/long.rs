//! Long layout: one row per sensor and reading, with the sensor's pose in the row.

use super::calibration::Calibration;
use super::{FilesTable, LongColumns, Output};
use crate::array::MAX_DISTANCE_M;
use lumenav_core::pose::exp_so3;
use lumenav_core::{ModalityError, Reading, Recorded, SimTime};
use lumenav_records::place::{MAX_TIME_S, Place};
use lumenav_records::{Row, Table};
use nalgebra::{Isometry3, Translation3, Vector3};

/// Column indices of the long layout.
struct LongIndices {
    reading: usize,
    time_s: Option<usize>,
    flux: [usize; 3],
    position: [usize; 3],
    rotation: [usize; 3],
}

/// One row per sensor and reading.
pub(super) struct LongReader {
    table: Table,
    indices: LongIndices,
    period_s: Option<f64>,
    origin_m: Vector3<f64>,
    unit_tesla: f64,
    calibration: Calibration,
    output: Output,
    start_s: Option<f64>,
    /// First row of the next reading.
    ahead: Option<LongRow>,
    /// The last row that could not be read.
    bad_row: Option<ModalityError>,
    failed: bool,
}

struct LongRow {
    key: String,
    time_s: Option<f64>,
    /// Not a number where the cell is empty.
    flux_tesla: [f64; 3],
    pose: Isometry3<f64>,
    line: u64,
}

/// Rotation vectors longer than this many radians are another unit (degrees) or a wrong column: 2π says it all.
const MAX_TURN_RAD: f64 = 2.0 * std::f64::consts::PI;

impl LongReader {
    pub(super) fn new(
        table: Table,
        columns: &LongColumns,
        files: &FilesTable,
        calibration: Calibration,
        output: Output,
    ) -> Result<Self, ModalityError> {
        let three = |names: &[String; 3]| -> Result<[usize; 3], ModalityError> {
            Ok([table.column(&names[0])?, table.column(&names[1])?, table.column(&names[2])?])
        };
        let indices = LongIndices {
            reading: table.column(&columns.reading)?,
            time_s: columns.time_s.as_ref().map(|name| table.column(name)).transpose()?,
            flux: three(&columns.flux)?,
            position: three(&columns.position_mm)?,
            rotation: three(&columns.rotation_vector_rad)?,
        };
        Ok(Self {
            indices,
            table,
            period_s: columns.period_s.map(|v| v.0),
            origin_m: Vector3::from(columns.origin_mm.map(|v| v.0)) * 1e-3,
            unit_tesla: files.flux_unit_tesla.0,
            calibration,
            output,
            start_s: files.time_zero_s.map(|v| v.0),
            ahead: None,
            bad_row: None,
            failed: false,
        })
    }

    /// The next good row; a bad one is an error, or counted and passed over.
    fn next_row(&mut self) -> Result<Option<LongRow>, ModalityError> {
        if let Some(row) = self.ahead.take() {
            return Ok(Some(row));
        }
        while let Some(row) = self.table.next_row() {
            match row.and_then(|row| long_row(&row, &self.indices, &self.origin_m, self.unit_tesla)) {
                Ok(row) => return Ok(Some(row)),
                // The reading it belongs to lacks a row now and is passed over as a whole, with this as the reason.
                Err(error) if self.output.may_skip(&error) => self.bad_row = Some(error),
                Err(error) => return Err(error),
            }
        }
        Ok(None)
    }

    fn next_rows(&mut self) -> Result<Option<Vec<LongRow>>, ModalityError> {
        let Some(first) = self.next_row()? else { return Ok(None) };
        let mut rows = vec![first];
        while let Some(row) = self.next_row()? {
            // One more than expected is enough to know that it is wrong; the rest need not be held.
            if row.key != rows[0].key {
                self.ahead = Some(row);
                break;
            }
            if rows.len() <= self.calibration.sensors() {
                rows.push(row);
            }
        }
        Ok(Some(rows))
    }

    fn reading_of(&mut self, rows: &[LongRow]) -> Result<Reading, ModalityError> {
        let (first, sensors) = (&rows[0], self.calibration.sensors());
        let refuse = |message: String| ModalityError::Row {
            file: self.table.file().to_owned(),
            line: first.line,
            message,
        };
        if rows.len() != sensors {
            let count = if rows.len() > sensors { "too many".to_owned() } else { rows.len().to_string() };
            return Err(refuse(format!(
                "reading `{}` has {count} rows, the array has {sensors} sensors",
                first.key
            )));
        }
        let period_s = self.period_s.unwrap_or_default();
        let time_s = match first.time_s {
            Some(time) => time - *self.start_s.get_or_insert(time),
            None => self.output.sequence as f64 * period_s,
        };
        if time_s.abs() > MAX_TIME_S {
            return Err(refuse(format!("time {time_s:e} s is out of range")));
        }
        let at = SimTime::from_seconds(time_s);
        let place = Place { interval: (at, at), arrival: at, sequence: None };
        self.output.advance(&place).map_err(refuse)?;
        let calibrated =
            |place: &(usize, usize)| self.calibration.apply(*place, rows[place.0].flux_tesla[place.1]);
        let values = self.calibration.channel_axes.iter().map(calibrated).collect();
        let known_poses = rows.iter().enumerate().map(|(i, row)| (format!("s{i}"), row.pose)).collect();
        self.output.reading(&place, known_poses, values)
    }
}

fn long_row(
    row: &Row<'_>,
    indices: &LongIndices,
    origin_m: &Vector3<f64>,
    unit_tesla: f64,
) -> Result<LongRow, ModalityError> {
    let three = |columns: &[usize; 3]| -> Result<Vector3<f64>, ModalityError> {
        Ok(Vector3::new(row.number(columns[0])?, row.number(columns[1])?, row.number(columns[2])?))
    };
    let position = three(&indices.position)? * 1e-3 + origin_m;
    if position.amax() > MAX_DISTANCE_M {
        return Err(row.error(&format!("a position beyond {MAX_DISTANCE_M} m of the world's origin")));
    }
    let turn_rad = three(&indices.rotation)?;
    if turn_rad.amax() > MAX_TURN_RAD {
        return Err(row.error("a rotation vector of more than a full turn; it must be in radians"));
    }
    let mut flux_tesla = [f64::NAN; 3];
    for (value, column) in flux_tesla.iter_mut().zip(indices.flux) {
        *value = row.optional(column)?.map_or(f64::NAN, |raw| raw * unit_tesla);
    }
    Ok(LongRow {
        key: row.text(indices.reading).to_owned(),
        time_s: indices.time_s.map(|c| row.number(c)).transpose()?,
        flux_tesla,
        pose: Isometry3::from_parts(Translation3::from(position), exp_so3(&turn_rad)),
        line: row.line(),
    })
}

impl Iterator for LongReader {
    type Item = Result<Recorded, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let reading = match self.next_rows() {
            Ok(None) => return self.bad_row.take().map(|error| Ok(Recorded::Skipped(error))),
            Ok(Some(rows)) => self.reading_of(&rows),
            Err(error) => Err(error),
        };
        Some(match reading {
            Ok(reading) => Ok(Recorded::Reading(reading)),
            Err(error) if self.output.passes_over(&error) => {
                Ok(Recorded::Skipped(self.bad_row.take().unwrap_or(error)))
            }
            Err(error) => {
                self.failed = true;
                Err(error)
            }
        })
    }
}
