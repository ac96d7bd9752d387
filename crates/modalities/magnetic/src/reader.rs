//! Recorded magnetometer data.
//!
//! Two layouts. *Wide*: `t_s,s0x_T,s0y_T,s0z_T,s1x_T,…`, one row per reading, an empty cell is a lost channel; a second file
//! `t_s,sensor,x_m,y_m,z_m,qx,qy,qz,qw` may give every sensor its pose at every reading. *Long*: one row per sensor and
//! reading, with the columns named in `[files.columns]`, and the sensor's pose in the row.
//!
//! A background file (3 rows x, y, z; one column per sensor) is subtracted: what the sensors read without the magnet.

use crate::config::Installed;
use crate::sensor::flux_schema;
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::pose::exp_so3;
use lumenav_core::{Frame, ModalityError, Name, Node, Reading, ReadingStream, Schema, Setup, SimTime};
use lumenav_records::{BadRows, Table};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
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
    /// Time that becomes 0, s; absent: the first row's.
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
    /// Rows with the same entry here, one after another, form one reading.
    pub reading: String,
    /// Time of a row, s; absent: the readings' count times `period_s`.
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
    let path = |key: &str, name: &str| node.existing_path(key, name);
    let background = match &files.background_csv {
        Some(name) => read_background(
            &path("background_csv", name)?,
            installed.array.sensors.len(),
            files.flux_unit_tesla.0,
        )?,
        None => vec![0.0; installed.array.labels().len()],
    };
    let gains = match &files.magnetization_csv {
        Some(name) => {
            let unit = files.magnetization_unit_a_m.0;
            read_gains(&path("magnetization_csv", name)?, installed, unit)?
        }
        None => vec![1.0; installed.array.sensors.len()],
    };
    let table = Table::open(&path("flux_csv", &files.flux_csv)?)?;
    let schema = flux_schema(installed.array.labels());
    match &files.columns {
        Some(columns) => {
            let reader = LongReader::new(table, columns, &files, Correction { background, gains }, schema, setup.sensor.clone())?;
            Ok(Box::new(reader))
        }
        None => {
            let poses = match &files.poses_csv {
                Some(name) => Some(PoseTable::open(&path("poses_csv", name)?)?),
                None => None,
            };
            let labels = installed.array.labels();
            Ok(Box::new(WideReader::new(
                table,
                &labels,
                poses,
                &files,
                correction_per_channel(installed, background, &gains),
                schema,
                setup.sensor.clone(),
            )?))
        }
    }
}

/// What is taken off a raw reading: `(raw - background) / gain`.
struct Correction {
    /// Per channel, T.
    background: Vec<f64>,
    /// Per sensor in the long layout, per channel in the wide one.
    gains: Vec<f64>,
}

fn correction_per_channel(installed: &Installed, background: Vec<f64>, gains: &[f64]) -> Correction {
    let channels = installed.array.channels(&Isometry3::identity());
    Correction { background, gains: channels.channels.iter().map(|c| gains[c.sensor]).collect() }
}

/// One row of apparent magnetisations; as gains relative to the installed magnet.
fn read_gains(path: &Path, installed: &Installed, unit_a_m: f64) -> Result<Vec<f64>, ModalityError> {
    let file = path.display().to_string();
    let row = read_numbers(path)?;
    let refuse = |message: String| ModalityError::Row { file: file.clone(), line: 1, message };
    let [(_, values)] = row.as_slice() else {
        return Err(refuse(format!("{} rows of numbers; expected 1", row.len())));
    };
    let sensors = installed.array.sensors.len();
    if values.len() != sensors {
        return Err(refuse(format!("{} numbers, the array has {sensors} sensors", values.len())));
    }
    let remanence = installed.magnet.cylinder.remanence_tesla();
    let gains: Vec<f64> = values.iter().map(|m| MU0 * m * unit_a_m / remanence).collect();
    match gains.iter().find(|g| !(0.5..=2.0).contains(*g)) {
        Some(gain) => Err(refuse(format!(
            "a gain of {gain:.3} against the capsule's remanence of {remanence} T; 0.5 to 2 is allowed (check the unit)"
        ))),
        None => Ok(gains),
    }
}

/// Vacuum permeability, T m/A.
const MU0: f64 = 4.0e-7 * std::f64::consts::PI;

/// Rows of comma-separated finite numbers with their line.
fn read_numbers(path: &Path) -> Result<Vec<(u64, Vec<f64>)>, ModalityError> {
    let file = path.display().to_string();
    let mut text = String::new();
    std::io::Read::read_to_string(&mut lumenav_records::open(path)?, &mut text)
        .map_err(|source| ModalityError::File { file: file.clone(), source })?;
    let mut rows = Vec::new();
    for (index, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#')) {
        let line_number = index as u64 + 1;
        let mut values = Vec::new();
        for cell in line.split(',').map(str::trim) {
            match cell.parse::<f64>() {
                Ok(value) if value.is_finite() => values.push(value),
                _ => {
                    let message = format!("`{cell}` is not a finite number");
                    return Err(ModalityError::Row { file, line: line_number, message });
                }
            }
        }
        rows.push((line_number, values));
    }
    Ok(rows)
}

/// Three rows (x, y, z), one number per sensor; as one offset per channel, T.
fn read_background(path: &Path, sensors: usize, unit_tesla: f64) -> Result<Vec<f64>, ModalityError> {
    let file = path.display().to_string();
    let rows = read_numbers(path)?;
    if rows.len() != 3 {
        let message = format!("{} rows of numbers; expected 3 (x, y, z)", rows.len());
        return Err(ModalityError::Row { file, line: 1, message });
    }
    let mut offsets = vec![0.0; 3 * sensors];
    for (axis, (line, values)) in rows.iter().enumerate() {
        if values.len() != sensors {
            let message = format!("{} numbers, the array has {sensors} sensors", values.len());
            return Err(ModalityError::Row { file, line: *line, message });
        }
        for (sensor, value) in values.iter().enumerate() {
            offsets[3 * sensor + axis] = value * unit_tesla;
        }
    }
    Ok(offsets)
}

/// One row per reading.
struct WideReader {
    table: Table,
    time: usize,
    columns: Vec<usize>,
    poses: Option<PoseTable>,
    bad_rows: BadRows,
    correction: Correction,
    schema: Arc<Schema>,
    sensor: Name,
    sequence: u64,
    last_s: f64,
    failed: bool,
}

impl WideReader {
    fn new(
        table: Table,
        labels: &[String],
        poses: Option<PoseTable>,
        files: &FilesTable,
        correction: Correction,
        schema: Arc<Schema>,
        sensor: Name,
    ) -> Result<Self, ModalityError> {
        let time = table.column("t_s")?;
        let columns = labels.iter().map(|label| table.column(label)).collect::<Result<_, _>>()?;
        Ok(Self {
            table,
            time,
            columns,
            poses,
            bad_rows: files.bad_rows,
            correction,
            schema,
            sensor,
            sequence: 0,
            last_s: f64::NEG_INFINITY,
            failed: false,
        })
    }

    fn next_reading(&mut self) -> Option<Result<Reading, ModalityError>> {
        let row = match self.table.next_row()? {
            Ok(row) => row,
            Err(error) => return Some(Err(error)),
        };
        let read = || -> Result<(f64, Vec<f64>), ModalityError> {
            let time = row.number(self.time)?;
            if time <= self.last_s {
                return Err(row.error(&format!("time {time} s does not increase")));
            }
            let values = self.columns.iter().map(|c| Ok(row.optional(*c)?.unwrap_or(f64::NAN)));
            Ok((time, values.collect::<Result<_, ModalityError>>()?))
        };
        let (time, mut values) = match read() {
            Ok(row) => row,
            Err(error) => return Some(Err(error)),
        };
        self.last_s = time;
        for (k, value) in values.iter_mut().enumerate() {
            *value = (*value - self.correction.background[k]) / self.correction.gains[k];
        }
        let known_poses = match self.poses.as_mut().map(|poses| poses.at(time)).transpose() {
            Ok(poses) => poses.unwrap_or_default(),
            Err(error) => return Some(Err(error)),
        };
        let reading = assemble(&self.sensor, self.sequence, time, known_poses, &self.schema, values);
        self.sequence += 1;
        Some(reading)
    }
}

impl Iterator for WideReader {
    type Item = Result<Reading, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if self.failed {
                return None;
            }
            match self.next_reading()? {
                Err(ModalityError::Row { .. }) if self.bad_rows == BadRows::Skip => {}
                Err(error) => {
                    self.failed = true;
                    return Some(Err(error));
                }
                reading => return Some(reading),
            }
        }
    }
}

fn assemble(
    sensor: &Name,
    sequence: u64,
    time_s: f64,
    known_poses: BTreeMap<String, Isometry3<f64>>,
    schema: &Arc<Schema>,
    values: Vec<f64>,
) -> Result<Reading, ModalityError> {
    let at = SimTime::from_seconds(time_s);
    Ok(Reading {
        sensor: sensor.clone(),
        sequence,
        interval: (at, at),
        arrival: at,
        known_poses,
        payload: Frame::of_values(schema.clone(), values)?,
    })
}

/// Poses per sensor and time, in step with the readings.
struct PoseTable {
    table: Table,
    columns: [usize; 9],
    ahead: Option<(f64, String, Isometry3<f64>)>,
}

impl PoseTable {
    fn open(path: &Path) -> Result<Self, ModalityError> {
        let table = Table::open(path)?;
        let names = ["t_s", "sensor", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"];
        let mut columns = [0; 9];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = table.column(name)?;
        }
        Ok(Self { table, columns, ahead: None })
    }

    fn next(&mut self) -> Result<Option<(f64, String, Isometry3<f64>)>, ModalityError> {
        if let Some(row) = self.ahead.take() {
            return Ok(Some(row));
        }
        let Some(row) = self.table.next_row() else { return Ok(None) };
        let row = row?;
        let mut v = [0.0; 9];
        for (i, column) in self.columns.iter().enumerate() {
            if i != 1 {
                v[i] = row.number(*column)?;
            }
        }
        let quaternion = Quaternion::new(v[8], v[5], v[6], v[7]);
        if (quaternion.norm() - 1.0).abs() > 1e-2 {
            return Err(row.error("the quaternion's norm is not 1"));
        }
        let pose = Isometry3::from_parts(
            Translation3::new(v[2], v[3], v[4]),
            UnitQuaternion::new_normalize(quaternion),
        );
        let name = row.text(self.columns[1]);
        let name = if name.starts_with('s') { name.to_owned() } else { format!("s{name}") };
        Ok(Some((v[0], name, pose)))
    }

    /// All poses with this time stamp; earlier ones are passed over.
    fn at(&mut self, time_s: f64) -> Result<BTreeMap<String, Isometry3<f64>>, ModalityError> {
        let mut poses = BTreeMap::new();
        while let Some(row) = self.next()? {
            if row.0 > time_s + 1e-9 {
                self.ahead = Some(row);
                break;
            }
            if row.0 >= time_s - 1e-9 {
                poses.insert(row.1, row.2);
            }
        }
        Ok(poses)
    }
}

/// Column indices of the long layout.
struct LongIndices {
    reading: usize,
    time_s: Option<usize>,
    flux: [usize; 3],
    position: [usize; 3],
    rotation: [usize; 3],
}

/// One row per sensor and reading.
struct LongReader {
    table: Table,
    indices: LongIndices,
    period_s: Option<f64>,
    origin_m: Vector3<f64>,
    unit_tesla: f64,
    correction: Correction,
    schema: Arc<Schema>,
    sensor: Name,
    sequence: u64,
    start_s: Option<f64>,
    /// First row of the next reading.
    ahead: Option<LongRow>,
    done: bool,
}

struct LongRow {
    key: String,
    time_s: Option<f64>,
    flux_tesla: Vector3<f64>,
    pose: Isometry3<f64>,
    line: u64,
}

impl LongReader {
    fn new(
        table: Table,
        columns: &LongColumns,
        files: &FilesTable,
        correction: Correction,
        schema: Arc<Schema>,
        sensor: Name,
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
            correction,
            schema,
            sensor,
            sequence: 0,
            start_s: files.time_zero_s.map(|v| v.0),
            ahead: None,
            done: false,
        })
    }

    fn next_row(&mut self) -> Result<Option<LongRow>, ModalityError> {
        if let Some(row) = self.ahead.take() {
            return Ok(Some(row));
        }
        let Some(row) = self.table.next_row() else { return Ok(None) };
        let row = row?;
        let three = |columns: &[usize; 3]| -> Result<Vector3<f64>, ModalityError> {
            Ok(Vector3::new(row.number(columns[0])?, row.number(columns[1])?, row.number(columns[2])?))
        };
        let position = three(&self.indices.position)? * 1e-3 + self.origin_m;
        let rotation = exp_so3(&three(&self.indices.rotation)?);
        Ok(Some(LongRow {
            key: row.text(self.indices.reading).to_owned(),
            time_s: self.indices.time_s.map(|c| row.number(c)).transpose()?,
            flux_tesla: three(&self.indices.flux)? * self.unit_tesla,
            pose: Isometry3::from_parts(Translation3::from(position), rotation),
            line: row.line(),
        }))
    }

    fn next_reading(&mut self) -> Result<Option<Reading>, ModalityError> {
        let Some(first) = self.next_row()? else { return Ok(None) };
        let sensors = self.correction.gains.len();
        let (key, time_s, line) = (first.key.clone(), first.time_s, first.line);
        let mut rows = vec![first];
        while let Some(row) = self.next_row()? {
            if row.key != key {
                self.ahead = Some(row);
                break;
            }
            rows.push(row);
        }
        if rows.len() != sensors {
            let message = format!("reading `{key}` has {} rows, the array has {sensors} sensors", rows.len());
            return Err(ModalityError::Row { file: self.table_file(), line, message });
        }
        let mut values = Vec::with_capacity(3 * sensors);
        let mut known_poses = BTreeMap::new();
        for (i, row) in rows.iter().enumerate() {
            let c = &self.correction;
            values.extend((0..3).map(|k| (row.flux_tesla[k] - c.background[3 * i + k]) / c.gains[i]));
            known_poses.insert(format!("s{i}"), row.pose);
        }
        let time = match (time_s, self.period_s) {
            (Some(time), _) => time - *self.start_s.get_or_insert(time),
            (None, Some(period)) => self.sequence as f64 * period,
            (None, None) => {
                let message = "neither `columns.time_s` nor `columns.period_s` is given".to_owned();
                return Err(ModalityError::Row { file: self.table_file(), line, message });
            }
        };
        let reading = assemble(&self.sensor, self.sequence, time, known_poses, &self.schema, values)?;
        self.sequence += 1;
        Ok(Some(reading))
    }

    fn table_file(&self) -> String {
        self.table.file().to_owned()
    }
}

impl Iterator for LongReader {
    type Item = Result<Reading, ModalityError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        let next = self.next_reading().transpose();
        self.done = !matches!(next, Some(Ok(_)));
        next
    }
}
