//! Long layout: one row per sensor and reading, with the sensor's pose in the row.
//!
//! Where readings are placed in time by their count, one that is passed over must count as well, else all that follow are
//! early. A bad row belongs to the reading that it names. One that names none (cells are missing or the text is none) belongs
//! to the reading around it; between two readings it fills what the first lacks, then what the second lacks, and of what is
//! left every array-full of rows (rounded: half of one is one) is a reading of which nothing can be read.

use super::calibration::Calibration;
use super::{FilesTable, LongColumns, Output};
use crate::array::MAX_DISTANCE_M;
use lumenav_core::pose::exp_so3;
use lumenav_core::{ModalityError, Reading, Recorded, SimTime};
use lumenav_records::place::{MAX_TIME_S, Place};
use lumenav_records::{BadRows, Row, Table};
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
    /// Rows before it that name no reading and that the last reading does not lack.
    nameless: Nameless,
    /// A reading that waits until what was lost before it is told.
    waiting: Option<Group>,
    /// How many readings were lost before it, and why: none where a stray row names nothing.
    lost: Option<(usize, RowError)>,
    failed: bool,
}

/// A row that names its reading.
struct LongRow {
    key: String,
    /// `None` where there is no column of times, or no time in it.
    time_s: Option<f64>,
    line: u64,
    content: Result<Content, RowError>,
}

/// What a sensor says in a row.
struct Content {
    /// Not a number where the cell is empty.
    flux_tesla: [f64; 3],
    pose: Isometry3<f64>,
}

/// The rows of one reading.
struct Group {
    /// No more of them than one above the number of sensors.
    rows: Vec<LongRow>,
    /// Rows that name no reading and were taken for this one's.
    nameless: Nameless,
}

/// Rows that name no reading: how many, and what was wrong with the first.
#[derive(Default)]
struct Nameless {
    count: usize,
    first: Option<RowError>,
}

/// A row that may be passed over: line and reason.
#[derive(Clone)]
struct RowError {
    line: u64,
    message: String,
}

impl Nameless {
    fn push(&mut self, error: RowError) {
        self.count += 1;
        self.first.get_or_insert(error);
    }

    /// Moves up to `count` of them over to `other`.
    fn fill(&mut self, other: &mut Self, count: usize) {
        let moved = count.min(self.count);
        if moved > 0 {
            self.count -= moved;
            other.count += moved;
            other.first = other.first.take().or_else(|| self.first.clone());
        }
    }
}

impl Group {
    /// How many rows it has fewer than there are sensors.
    fn lacks(&self, sensors: usize) -> usize {
        sensors.saturating_sub(self.rows.len() + self.nameless.count)
    }
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
            nameless: Nameless::default(),
            waiting: None,
            lost: None,
            failed: false,
        })
    }

    /// The next row that names a reading; `others` takes in what stands before it.
    fn next_row(&mut self, others: &mut Nameless) -> Result<Option<LongRow>, ModalityError> {
        if let Some(row) = self.ahead.take() {
            return Ok(Some(row));
        }
        while let Some(row) = self.table.next_row() {
            match row {
                Ok(row) => {
                    let content = content(&row, &self.indices, &self.origin_m, self.unit_tesla);
                    let content = match content {
                        Ok(content) => Ok(content),
                        Err(error) => Err(passable(error, &self.output)?),
                    };
                    let time_s = self.indices.time_s.and_then(|column| row.number(column).ok());
                    let key = row.text(self.indices.reading).to_owned();
                    return Ok(Some(LongRow { key, time_s, line: row.line(), content }));
                }
                Err(error) => others.push(passable(error, &self.output)?),
            }
        }
        Ok(None)
    }

    /// The rows of the next reading; `None` at the end of the file. Leaves in `lost` what was lost before it.
    fn next_group(&mut self) -> Result<Option<Group>, ModalityError> {
        let sensors = self.calibration.sensors();
        let mut before = std::mem::take(&mut self.nameless);
        let Some(first) = self.next_row(&mut before)? else {
            self.lose(&before);
            return Ok(None);
        };
        let mut group = Group { rows: vec![first], nameless: Nameless::default() };
        let mut after = Nameless::default();
        while let Some(row) = self.next_row(&mut after)? {
            if row.key != group.rows[0].key {
                self.ahead = Some(row);
                break;
            }
            // What stands between two rows of a reading is a part of it.
            let between = after.count;
            after.fill(&mut group.nameless, between);
            // One more than expected is enough to know that it is wrong; the rest need not be held.
            if group.rows.len() <= sensors {
                group.rows.push(row);
            }
        }
        let lacking = group.lacks(sensors);
        before.fill(&mut group.nameless, lacking);
        let lacking = group.lacks(sensors);
        after.fill(&mut group.nameless, lacking);
        self.nameless = after;
        self.lose(&before);
        Ok(Some(group))
    }

    /// Rows that no reading lacks: how many readings they were.
    fn lose(&mut self, rows: &Nameless) {
        let sensors = self.calibration.sensors().max(1);
        let readings = (rows.count + sensors / 2) / sensors;
        self.lost = rows.first.clone().filter(|_| rows.count > 0).map(|why| (readings, why));
    }

    fn reading_of(&mut self, group: &Group) -> Result<Reading, ModalityError> {
        let (rows, sensors) = (&group.rows, self.calibration.sensors());
        let first = &rows[0];
        let file = self.table.file();
        let refuse = |message: String| row_error(file, first.line, message);
        let time_s = rows.iter().find_map(|row| row.time_s);
        // A first reading that is passed over keeps its place in time.
        let start_s = time_s.map(|time_s| *self.start_s.get_or_insert(time_s));
        let bad = rows.iter().find_map(|row| row.content.as_ref().err()).or(group.nameless.first.as_ref());
        if let Some(bad) = bad {
            return Err(row_error(file, bad.line, bad.message.clone()));
        }
        if rows.len() != sensors {
            let count = if rows.len() > sensors { "too many".to_owned() } else { rows.len().to_string() };
            return Err(refuse(format!(
                "reading `{}` has {count} rows, the array has {sensors} sensors",
                first.key
            )));
        }
        let time_s = match first.time_s.zip(start_s) {
            Some((time_s, start_s)) => time_s - start_s,
            None => self.output.sequence as f64 * self.period_s.unwrap_or_default(),
        };
        if time_s.abs() > MAX_TIME_S {
            return Err(refuse(format!("time {time_s:e} s is out of range")));
        }
        let at = SimTime::from_seconds(time_s);
        let place = Place { interval: (at, at), arrival: at, sequence: None };
        self.output.advance(&place).map_err(refuse)?;
        let sound: Vec<&Content> = rows.iter().filter_map(|row| row.content.as_ref().ok()).collect();
        let calibrated =
            |place: &(usize, usize)| self.calibration.apply(*place, sound[place.0].flux_tesla[place.1]);
        let values = self.calibration.channel_axes.iter().map(calibrated).collect();
        let known_poses = sound.iter().enumerate().map(|(i, row)| (format!("s{i}"), row.pose)).collect();
        self.output.reading(&place, known_poses, values)
    }
}

fn row_error(file: &str, line: u64, message: String) -> ModalityError {
    ModalityError::Row { file: file.to_owned(), line, message }
}

/// What is wrong with a row that may be passed over.
///
/// # Errors
/// The error itself, where the reader is to stop at it.
fn passable(error: ModalityError, output: &Output) -> Result<RowError, ModalityError> {
    match error {
        ModalityError::Row { line, message, .. } if output.bad_rows == BadRows::Skip => {
            Ok(RowError { line, message })
        }
        error => Err(error),
    }
}

fn content(
    row: &Row<'_>,
    indices: &LongIndices,
    origin_m: &Vector3<f64>,
    unit_tesla: f64,
) -> Result<Content, ModalityError> {
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
    // Also where another row of the reading has its time.
    indices.time_s.map(|column| row.number(column)).transpose()?;
    Ok(Content { flux_tesla, pose: Isometry3::from_parts(Translation3::from(position), exp_so3(&turn_rad)) })
}

impl LongReader {
    /// What comes next: a reading that was lost, or one that was read or refused.
    fn next_recorded(&mut self) -> Result<Option<Recorded>, ModalityError> {
        if self.lost.is_none() && self.waiting.is_none() {
            self.waiting = self.next_group()?;
        }
        if let Some((readings, why)) = self.lost.take() {
            self.output.sequence = self.output.sequence.saturating_add(u64::from(readings > 0));
            let error = row_error(self.table.file(), why.line, why.message.clone());
            self.lost = (readings > 1).then(|| (readings - 1, why));
            return Ok(Some(Recorded::Skipped(error)));
        }
        let Some(group) = self.waiting.take() else { return Ok(None) };
        match self.reading_of(&group) {
            Ok(reading) => Ok(Some(Recorded::Reading(reading))),
            Err(error) if self.output.passes_over(&error) => Ok(Some(Recorded::Skipped(error))),
            Err(error) => Err(error),
        }
    }
}

impl Iterator for LongReader {
    type Item = Result<Recorded, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let next = self.next_recorded();
        self.failed = next.is_err();
        next.transpose()
    }
}
