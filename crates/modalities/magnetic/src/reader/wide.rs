//! Wide layout: `t_s,s0x_T,s0y_T,s0z_T,s1x_T,…`, one row per reading, and the poses of a flexible array in a second file
//! `t_s,sensor,x_m,y_m,z_m,qx,qy,qz,qw` (scalar last, `sensor` as `s3` or `3`).

use super::calibration::Calibration;
use super::{FilesTable, Output};
use crate::array::MAX_DISTANCE_M;
use lumenav_core::{ModalityError, Reading, Recorded, SimTime};
use lumenav_records::place::PlaceColumns;
use lumenav_records::{Row, Table};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

/// One row per reading.
pub(super) struct WideReader {
    table: Table,
    place: PlaceColumns,
    time_zero_s: f64,
    columns: Vec<usize>,
    poses: Option<PoseTable>,
    calibration: Calibration,
    output: Output,
    failed: bool,
}

impl WideReader {
    pub(super) fn new(
        table: Table,
        labels: &[String],
        poses: Option<PoseTable>,
        files: &FilesTable,
        calibration: Calibration,
        output: Output,
    ) -> Result<Self, ModalityError> {
        Ok(Self {
            place: PlaceColumns::of(&table, "t_s")?,
            time_zero_s: files.time_zero_s.map_or(0.0, |v| v.0),
            columns: labels.iter().map(|label| table.column(label)).collect::<Result<_, _>>()?,
            table,
            poses,
            calibration,
            output,
            failed: false,
        })
    }

    fn next_reading(&mut self) -> Option<Result<Reading, ModalityError>> {
        let row = self.table.next_row()?;
        Some(row.and_then(|row| {
            let place = self.place.read(&row, self.time_zero_s)?;
            let mut values = Vec::with_capacity(self.columns.len());
            for (column, place) in self.columns.iter().zip(&self.calibration.channel_axes) {
                let raw = row.optional(*column)?;
                values.push(raw.map_or(f64::NAN, |raw| self.calibration.apply(*place, raw)));
            }
            self.output.advance(&place).map_err(|message| row.error(&message))?;
            let known_poses = match &mut self.poses {
                Some(poses) => {
                    poses.at(SimTime::middle(place.interval).seconds() + self.time_zero_s, &row)?
                }
                None => BTreeMap::new(),
            };
            self.output.reading(&place, known_poses, values)
        }))
    }
}

impl Iterator for WideReader {
    type Item = Result<Recorded, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        Some(match self.next_reading()? {
            Ok(reading) => Ok(Recorded::Reading(reading)),
            Err(error) if self.output.passes_over(&error) => Ok(Recorded::Skipped(error)),
            Err(error) => {
                self.failed = true;
                Err(error)
            }
        })
    }
}

/// A row of the pose file.
struct PoseRow {
    at: SimTime,
    sensor: String,
    pose: Isometry3<f64>,
}

/// Poses per sensor and time, in step with the readings.
pub(super) struct PoseTable {
    table: Table,
    columns: [usize; 9],
    sensors: usize,
    last: Option<SimTime>,
    ahead: Option<PoseRow>,
}

impl PoseTable {
    pub(super) fn open(path: &Path, sensors: usize) -> Result<Self, ModalityError> {
        let table = Table::open(path)?;
        let names = ["t_s", "sensor", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"];
        let mut columns = [0; 9];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = table.column(name)?;
        }
        Ok(Self { table, columns, sensors, last: None, ahead: None })
    }

    fn next(&mut self) -> Result<Option<PoseRow>, ModalityError> {
        if let Some(row) = self.ahead.take() {
            return Ok(Some(row));
        }
        let Some(row) = self.table.next_row() else { return Ok(None) };
        let row = row?;
        let read = pose_row(&row, &self.columns, self.sensors)?;
        if self.last.is_some_and(|last| read.at < last) {
            return Err(row.error("the poses' times go backwards"));
        }
        self.last = Some(read.at);
        Ok(Some(read))
    }

    /// The poses of all sensors at this time; earlier ones are passed over. A sensor without one is an error: where its
    /// model places it is not where it is.
    fn at(
        &mut self,
        time_s: f64,
        reading: &Row<'_>,
    ) -> Result<BTreeMap<String, Isometry3<f64>>, ModalityError> {
        let at = SimTime::from_seconds(time_s);
        let mut poses = BTreeMap::new();
        while let Some(row) = self.next()? {
            if row.at > at {
                self.ahead = Some(row);
                break;
            }
            if row.at == at {
                poses.insert(row.sensor, row.pose);
            }
        }
        match (0..self.sensors).find(|i| !poses.contains_key(&format!("s{i}"))) {
            Some(i) => {
                Err(reading.error(&format!("{} has no pose of sensor s{i} at {time_s} s", self.table.file())))
            }
            None => Ok(poses),
        }
    }
}

fn pose_row(row: &Row<'_>, columns: &[usize; 9], sensors: usize) -> Result<PoseRow, ModalityError> {
    let [t, name, x, y, z, qx, qy, qz, qw] = *columns;
    let position = Vector3::new(row.number(x)?, row.number(y)?, row.number(z)?);
    if position.amax() > MAX_DISTANCE_M {
        return Err(row.error(&format!("a position beyond {MAX_DISTANCE_M} m")));
    }
    let quaternion = Quaternion::new(row.number(qw)?, row.number(qx)?, row.number(qy)?, row.number(qz)?);
    if (quaternion.norm() - 1.0).abs() > 1e-2 {
        return Err(row.error(&format!("the quaternion's norm is {:.4}; it must be 1", quaternion.norm())));
    }
    let text = row.text(name);
    let index = text.strip_prefix('s').unwrap_or(text).parse::<usize>().ok().filter(|i| *i < sensors);
    let Some(index) = index else {
        return Err(row.error(&format!("no sensor `{text}`; the array has s0 to s{}", sensors - 1)));
    };
    Ok(PoseRow {
        at: SimTime::from_seconds(row.number(t)?),
        sensor: format!("s{index}"),
        pose: Isometry3::from_parts(Translation3::from(position), UnitQuaternion::new_normalize(quaternion)),
    })
}
