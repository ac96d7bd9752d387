//! What is taken off a raw reading: `(raw - background) / gain`.
//!
//! Background: three rows (x, y, z), one number per sensor, what the sensors read without the magnet. Gains: one row with
//! the test magnet's apparent magnetisation per sensor, relative to the installed remanence: `g = μ0 M / Br`.

use super::FilesTable;
use crate::config::Installed;
use lumenav_core::{ModalityError, Node};
use std::io::Read as _;
use std::path::Path;

/// Background and gain of every channel.
pub(super) struct Calibration {
    /// Sensor and axis (0 to 2) per channel.
    pub(super) channel_axes: Vec<(usize, usize)>,
    background_tesla: Vec<[f64; 3]>,
    gains: Vec<f64>,
}

/// Vacuum permeability, T m/A; 4π·1e-7 to ten digits since 2019.
const MU0: f64 = 4.0e-7 * std::f64::consts::PI;
/// Calibration files are a few numbers per sensor.
const MAX_BYTES: u64 = 16 * 1024 * 1024;

impl Calibration {
    pub(super) fn open(
        installed: &Installed,
        node: &Node,
        files: &FilesTable,
    ) -> Result<Self, ModalityError> {
        let sensors = installed.array.sensors.len();
        let background_tesla = match &files.background_csv {
            Some(name) => read_background(
                &node.existing_path("background_csv", name)?,
                sensors,
                files.flux_unit_tesla.0,
            )?,
            None => vec![[0.0; 3]; sensors],
        };
        let gains = match &files.magnetization_csv {
            Some(name) => {
                let path = node.existing_path("magnetization_csv", name)?;
                read_gains(&path, installed, files.magnetization_unit_a_m.0)?
            }
            None => vec![1.0; sensors],
        };
        Ok(Self { channel_axes: installed.array.channel_axes(), background_tesla, gains })
    }

    /// Number of sensors.
    pub(super) fn sensors(&self) -> usize {
        self.gains.len()
    }

    /// A channel's flux, T, of what its sensor read along this axis.
    pub(super) fn apply(&self, (sensor, axis): (usize, usize), raw_tesla: f64) -> f64 {
        (raw_tesla - self.background_tesla[sensor][axis]) / self.gains[sensor]
    }
}

fn read_gains(path: &Path, installed: &Installed, unit_a_m: f64) -> Result<Vec<f64>, ModalityError> {
    let rows = read_numbers(path)?;
    let refuse =
        |line: u64, message: String| ModalityError::Row { file: path.display().to_string(), line, message };
    let [(line, values)] = rows.as_slice() else {
        return Err(refuse(1, format!("{} rows of numbers; expected 1", rows.len())));
    };
    let sensors = installed.array.sensors.len();
    if values.len() != sensors {
        return Err(refuse(*line, format!("{} numbers, the array has {sensors} sensors", values.len())));
    }
    let remanence = installed.magnet.cylinder.remanence_tesla();
    let gains: Vec<f64> = values.iter().map(|m| MU0 * m * unit_a_m / remanence).collect();
    match gains.iter().find(|g| !(0.5..=2.0).contains(*g)) {
        Some(gain) => Err(refuse(
            *line,
            format!(
                "a gain of {gain:.3} against the capsule's remanence of {remanence} T; 0.5 to 2 is allowed (check the unit)"
            ),
        )),
        None => Ok(gains),
    }
}

fn read_background(path: &Path, sensors: usize, unit_tesla: f64) -> Result<Vec<[f64; 3]>, ModalityError> {
    let rows = read_numbers(path)?;
    let refuse =
        |line: u64, message: String| ModalityError::Row { file: path.display().to_string(), line, message };
    if rows.len() != 3 {
        return Err(refuse(1, format!("{} rows of numbers; expected 3 (x, y, z)", rows.len())));
    }
    let mut offsets = vec![[0.0; 3]; sensors];
    for (axis, (line, values)) in rows.iter().enumerate() {
        if values.len() != sensors {
            return Err(refuse(*line, format!("{} numbers, the array has {sensors} sensors", values.len())));
        }
        for (offset, value) in offsets.iter_mut().zip(values) {
            offset[axis] = value * unit_tesla;
        }
    }
    Ok(offsets)
}

/// Rows of comma-separated finite numbers with their line.
fn read_numbers(path: &Path) -> Result<Vec<(u64, Vec<f64>)>, ModalityError> {
    let file = path.display().to_string();
    let mut text = String::new();
    lumenav_records::open(path)?
        .take(MAX_BYTES)
        .read_to_string(&mut text)
        .map_err(|source| ModalityError::File { file: file.clone(), source })?;
    let mut rows = Vec::new();
    for (line, content) in (1..).zip(text.lines()) {
        if content.trim().is_empty() || content.trim_start().starts_with('#') {
            continue;
        }
        let number = |cell: &str| {
            cell.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or(cell.trim().to_owned())
        };
        let values: Result<Vec<f64>, String> = content.split(',').map(number).collect();
        let values = values.map_err(|cell| {
            let message = format!("`{cell}` is not a finite number");
            ModalityError::Row { file: file.clone(), line, message }
        })?;
        rows.push((line, values));
    }
    Ok(rows)
}
