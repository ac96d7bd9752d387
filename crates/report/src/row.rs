//! One update of one track as a row of numbers.

use crate::error::ReportError;
use crate::file::{OutputFile, csv_cell, seconds_text};
use crate::tum::StampedPose;
use lumenav_core::{FixKind, Name, SimTime};
use lumenav_pipeline::TrackUpdate;
use nalgebra::{Isometry3, Matrix6, Quaternion, Translation3, UnitQuaternion};
use std::path::Path;

/// Numbers of the upper triangle of a 6 x 6 matrix.
pub const COVARIANCE_LENGTH: usize = 21;

/// Names and units of a row's numbers, in their order.
pub const NUMBERS: [(&str, &str); 24] = [
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
    ("nis", "1"),
    ("nis_dof", "1"),
    ("nees", "1"),
    ("error_x_mm", "mm"),
    ("error_y_mm", "mm"),
    ("error_z_mm", "mm"),
    ("error_mm", "mm"),
    ("heading_error_deg", "deg"),
    ("attitude_error_deg", "deg"),
    ("along_tract_error_mm", "mm"),
    ("weakest_sigma_mm", "mm"),
    ("weakest_x", "1"),
    ("weakest_y", "1"),
    ("weakest_z", "1"),
];

/// A row of `tracks.parquet`.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackRow {
    /// The track.
    pub track: Name,
    /// The sensor whose measurement was used.
    pub sensor: Name,
    /// Count of the track's updates from 0.
    pub update: u64,
    /// The instant the estimate is about, ns.
    pub t_ns: i64,
    /// When it was available, ns.
    pub available_ns: i64,
    /// 3 position, 5 position and pointing, 6 full pose.
    pub pose_dof: u8,
    /// Degrees of freedom of the NEES, where there is one.
    pub nees_dof: Option<u8>,
    /// Whether this update started or restarted the track.
    pub started: bool,
    /// False where the measurement was refused and the estimate is a prediction.
    pub accepted: bool,
    /// Whether all numbers of the estimate are finite and all known variances positive.
    pub valid: bool,
    /// See [`NUMBERS`].
    pub numbers: [Option<f64>; NUMBERS.len()],
    /// Upper triangle of the covariance, row by row; m², m·rad, rad².
    pub covariance: [f64; COVARIANCE_LENGTH],
}

impl TrackRow {
    /// The row of an update.
    pub fn of(update: &TrackUpdate<'_>) -> Self {
        let estimate = update.estimate;
        let pose = &estimate.pose;
        let (p, q) = (pose.world_from_capsule.translation.vector, pose.world_from_capsule.rotation);
        let mut row = Self {
            track: update.track.clone(),
            sensor: update.sensor.clone(),
            update: update.update,
            t_ns: estimate.at.0,
            available_ns: estimate.available.0,
            pose_dof: pose.kind.degrees_of_freedom() as u8,
            nees_dof: None,
            started: update.started,
            accepted: update.accepted,
            valid: is_sound(&pose.world_from_capsule, &pose.covariance, pose.kind),
            numbers: [None; NUMBERS.len()],
            covariance: upper_triangle(&pose.covariance),
        };
        row.set("x_m", &[p.x, p.y, p.z]);
        if pose.kind != FixKind::Position {
            row.set("qx", &[q.i, q.j, q.k, q.w]);
        }
        if let Some(v) = estimate.velocity_world_m_s {
            row.set("vx_m_s", &[v.x, v.y, v.z]);
        }
        if let Some((nis, dof)) = update.nis {
            row.set("nis", &[nis, dof]);
        }
        let (sigma_m, direction) = update.weakest;
        row.set("weakest_sigma_mm", &[1e3 * sigma_m, direction.x, direction.y, direction.z]);
        if let Some(error) = update.error {
            let mm = 1e3 * error.position_world_m;
            row.set("error_x_mm", &[mm.x, mm.y, mm.z, mm.norm()]);
            // The degrees of freedom stand there without a value where the covariance gave none.
            row.nees_dof = u8::try_from(error.nees_degrees_of_freedom).ok().filter(|dof| *dof > 0);
            if let Some(nees) = error.nees {
                row.set("nees", &[nees]);
            }
            for (name, value) in [
                ("heading_error_deg", error.heading_rad.map(f64::to_degrees)),
                ("attitude_error_deg", error.attitude_rad.map(f64::to_degrees)),
                ("along_tract_error_mm", error.along_tract_m.map(|m| 1e3 * m)),
            ] {
                if let Some(value) = value {
                    row.set(name, &[value]);
                }
            }
        }
        row
    }

    /// A number by name; `None` where it does not apply.
    pub fn number(&self, name: &str) -> Option<f64> {
        let index = NUMBERS.iter().position(|(known, _)| *known == name)?;
        self.numbers[index]
    }

    /// Sets consecutive numbers from `first` on; an unknown name sets nothing.
    fn set(&mut self, first: &str, values: &[f64]) {
        let Some(start) = NUMBERS.iter().position(|(known, _)| *known == first) else { return };
        for (slot, value) in self.numbers[start..].iter_mut().zip(values) {
            *slot = Some(*value);
        }
    }

    /// The pose with its time; identity attitude where none is estimated, `None` where a number is not finite.
    pub fn stamped_pose(&self) -> Option<StampedPose> {
        let get = |name: &str| self.number(name).filter(|x| x.is_finite());
        let position = Translation3::new(get("x_m")?, get("y_m")?, get("z_m")?);
        let rotation = match (get("qx"), get("qy"), get("qz"), get("qw")) {
            (Some(x), Some(y), Some(z), Some(w)) => {
                UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-3)?
            }
            _ => UnitQuaternion::identity(),
        };
        Some(StampedPose {
            at: SimTime(self.t_ns),
            world_from_capsule: Isometry3::from_parts(position, rotation),
        })
    }

    /// The covariance as a matrix.
    pub fn covariance_matrix(&self) -> Matrix6<f64> {
        let mut matrix = Matrix6::zeros();
        for ((row, column), value) in upper_indices().zip(self.covariance) {
            matrix[(row, column)] = value;
            matrix[(column, row)] = value;
        }
        matrix
    }
}

/// Rows and columns of the upper triangle, row by row.
fn upper_indices() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|row| (row..6).map(move |column| (row, column)))
}

fn upper_triangle(matrix: &Matrix6<f64>) -> [f64; COVARIANCE_LENGTH] {
    let mut out = [0.0; COVARIANCE_LENGTH];
    for (slot, (row, column)) in out.iter_mut().zip(upper_indices()) {
        *slot = matrix[(row, column)];
    }
    out
}

fn is_sound(pose: &Isometry3<f64>, covariance: &Matrix6<f64>, kind: FixKind) -> bool {
    let finite = pose.translation.vector.iter().chain(pose.rotation.coords.iter()).chain(covariance.iter());
    let known: &[usize] = match kind {
        FixKind::Position => &[0, 1, 2],
        FixKind::Pointing => &[0, 1, 2, 4, 5],
        FixKind::Full => &[0, 1, 2, 3, 4, 5],
    };
    finite.into_iter().all(|x| x.is_finite()) && known.iter().all(|&i| covariance[(i, i)] > 0.0)
}

/// Writes rows as CSV, whole or not at all: `t_s`, `available_s`, the text columns, [`NUMBERS`], the covariance; an empty
/// cell where a number does not apply.
///
/// # Errors
/// [`ReportError::File`].
pub fn write_csv(path: &Path, rows: &[TrackRow]) -> Result<(), ReportError> {
    let mut file = OutputFile::beside(path)?;
    let mut header: Vec<String> = [
        "track",
        "sensor",
        "update",
        "t_s",
        "available_s",
        "pose_dof",
        "nees_dof",
        "started",
        "accepted",
        "valid",
    ]
    .map(str::to_owned)
    .to_vec();
    header.extend(NUMBERS.iter().map(|(name, _)| (*name).to_owned()));
    header.extend(upper_indices().map(|(row, column)| format!("cov_{row}{column}")));
    file.line(&header.join(","))?;
    for row in rows {
        let mut cells = vec![
            csv_cell(&row.track),
            csv_cell(&row.sensor),
            row.update.to_string(),
            seconds_text(row.t_ns),
            seconds_text(row.available_ns),
            row.pose_dof.to_string(),
            row.nees_dof.map(|n| n.to_string()).unwrap_or_default(),
            row.started.to_string(),
            row.accepted.to_string(),
            row.valid.to_string(),
        ];
        cells.extend(row.numbers.iter().map(|n| n.map(|n| format!("{n:?}")).unwrap_or_default()));
        cells.extend(row.covariance.iter().map(|n| format!("{n:?}")));
        file.line(&cells.join(","))?;
    }
    file.finish()
}
