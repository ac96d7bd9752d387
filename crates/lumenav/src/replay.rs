//! Replays: recorded data, and where there is one the reference trajectory to compare with.

#![expect(
    clippy::disallowed_types,
    reason = "world side: a reference trajectory is compared with, never estimated from"
)]

use lumenav_core::config::quantity::{Finite, NonNegative};
use lumenav_core::pose::{exp_so3, interpolate, log_so3};
use lumenav_core::{CapsuleTruth, ModalityError, Node, SimTime};
use lumenav_records::{Table, tum};
use lumenav_scenario::{ScenarioError, ScenarioFile};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// `[truth]` of a replay.
#[expect(clippy::large_enum_variant, reason = "one value per run")]
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TruthFileTable {
    /// A TUM trajectory of the capsule.
    Tum {
        /// The file, relative to the replay.
        file: String,
        /// Longest gap between rows across which the pose is interpolated, s. Default 0.5: a capsule at the colon's fastest
        /// moves by a centimetre in it.
        #[serde(default = "half_a_second")]
        max_gap_s: NonNegative,
    },
    /// Columns of a CSV file; rows with the same `reading` entry are one instant.
    Csv {
        /// The files in order of time, relative to the replay.
        files: Vec<String>,
        /// Time that becomes 0, s; absent: the first row's.
        time_zero_s: Option<Finite>,
        /// Rows with the same entry here form one instant.
        reading: String,
        /// Time, s.
        time_s: String,
        /// Position, mm.
        position_mm: [String; 3],
        /// Attitude, world from body, as a rotation vector, rad.
        rotation_vector_rad: [String; 3],
        /// The body's axis that is the capsule's x axis: `x`, `y` or `z`.
        axis: String,
        /// Added to the positions, mm.
        #[serde(default)]
        origin_mm: [Finite; 3],
        /// As for `tum`.
        #[serde(default = "half_a_second")]
        max_gap_s: NonNegative,
    },
}

fn half_a_second() -> NonNegative {
    NonNegative(0.5)
}

/// A recorded reference, interpolated at constant twist.
#[derive(Clone, Debug)]
pub struct ReferenceTrajectory {
    poses: Vec<(SimTime, Isometry3<f64>)>,
    max_gap_s: f64,
}

impl ReferenceTrajectory {
    fn read(node: &Node) -> Result<Self, ScenarioError> {
        let table: TruthFileTable = node.parse()?;
        let poses = match &table {
            TruthFileTable::Tum { file, .. } => tum::read(&node.existing_path("file", file)?)?,
            TruthFileTable::Csv { .. } => read_csv(node, &table)?,
        };
        if poses.is_empty() {
            return Err(node.error_at("file", "the reference holds no pose").into());
        }
        let (TruthFileTable::Tum { max_gap_s, .. } | TruthFileTable::Csv { max_gap_s, .. }) = &table;
        Ok(Self { poses, max_gap_s: max_gap_s.0 })
    }
}

fn read_csv(node: &Node, table: &TruthFileTable) -> Result<Vec<(SimTime, Isometry3<f64>)>, ScenarioError> {
    let TruthFileTable::Csv {
        files,
        time_zero_s,
        reading,
        time_s,
        position_mm,
        rotation_vector_rad,
        axis,
        origin_mm,
        max_gap_s: _,
    } = table
    else {
        return Ok(Vec::new());
    };
    let to_x = match axis.as_str() {
        "x" => UnitQuaternion::identity(),
        "y" => UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2),
        "z" => UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2),
        other => {
            return Err(node.error_at("axis", &format!("`{other}` is no axis; allowed: x, y, z")).into());
        }
    };
    let origin = Vector3::from(origin_mm.map(|v| v.0)) * 1e-3;
    let columns = |rows: &Table, names: &[String; 3]| -> Result<[usize; 3], ModalityError> {
        Ok([rows.column(&names[0])?, rows.column(&names[1])?, rows.column(&names[2])?])
    };
    let mut poses: Vec<(SimTime, Isometry3<f64>)> = Vec::new();
    let mut start_s = time_zero_s.map(|v| v.0);
    for file in files {
        let mut rows = Table::open(&node.existing_path("files", file)?)?;
        let (group, time) = (rows.column(reading)?, rows.column(time_s)?);
        let (position, rotation) = (columns(&rows, position_mm)?, columns(&rows, rotation_vector_rad)?);
        let mut last_group = None;
        while let Some(row) = rows.next_row() {
            let row = row?;
            let key = row.text(group).to_owned();
            if last_group.as_ref() == Some(&key) {
                continue;
            }
            last_group = Some(key);
            let three = |c: &[usize; 3]| -> Result<Vector3<f64>, ModalityError> {
                Ok(Vector3::new(row.number(c[0])?, row.number(c[1])?, row.number(c[2])?))
            };
            let seconds = row.number(time)?;
            let at = SimTime::from_seconds(seconds - *start_s.get_or_insert(seconds));
            if poses.last().is_some_and(|(last, _)| at <= *last) {
                return Err(row.error(&format!("time {seconds} s does not increase")).into());
            }
            let attitude = exp_so3(&three(&rotation)?) * to_x;
            let place = Translation3::from(three(&position)? * 1e-3 + origin);
            poses.push((at, Isometry3::from_parts(place, attitude)));
        }
    }
    Ok(poses)
}

impl ReferenceTrajectory {
    /// The pose at an instant, with the twist of the stretch it lies in; `None` before the first row, after the last, and in
    /// gaps of more than `max_gap_s`: what was not recorded is not known, and nothing is judged by it.
    pub fn at(&self, at: SimTime) -> Option<CapsuleTruth> {
        let after = self.poses.partition_point(|(t, _)| *t < at);
        let next = self.poses.get(after);
        let before = after.checked_sub(1).and_then(|i| self.poses.get(i));
        let exact = next.filter(|(t, _)| *t == at);
        let stretch = match exact {
            Some(exact) => before.map(|b| (b, exact)).or_else(|| Some((exact, self.poses.get(after + 1)?))),
            None => before.zip(next),
        };
        let stretch = stretch.filter(|(a, b)| b.0.since_s(a.0) <= self.max_gap_s);
        let (pose, twist) = match (exact, stretch) {
            (Some((_, pose)), None) => (*pose, (Vector3::zeros(), Vector3::zeros())),
            (Some((_, pose)), Some((a, b))) => (*pose, twist(a, b)),
            (None, Some((a, b))) => {
                (interpolate(&a.1, &b.1, at.since_s(a.0) / b.0.since_s(a.0)), twist(a, b))
            }
            (None, None) => return None,
        };
        Some(CapsuleTruth {
            at,
            world_from_capsule: pose,
            velocity_world_m_s: twist.0,
            angular_rate_capsule_rad_s: twist.1,
            // At constant velocity only gravity is felt; the patient is taken to lie supine.
            specific_force_capsule_m_s2: pose.rotation.inverse() * Vector3::new(0.0, 9.81, 0.0),
            arc_length_m: None,
            segment: None,
            wall_force_n: None,
        })
    }
}

/// Velocity in the world and angular rate in the capsule's frame from one row to the next.
fn twist(a: &(SimTime, Isometry3<f64>), b: &(SimTime, Isometry3<f64>)) -> (Vector3<f64>, Vector3<f64>) {
    let dt_s = b.0.since_s(a.0);
    let velocity = (b.1.translation.vector - a.1.translation.vector) / dt_s;
    (velocity, log_so3(&(a.1.rotation.inverse() * b.1.rotation)) / dt_s)
}

/// Opens a replay with `key=value` overrides: the file, and its reference where it has one.
///
/// # Errors
/// [`ScenarioError`] with file, line, key and what is allowed.
pub fn open_replay(
    path: &Path,
    overrides: &[String],
    models: Option<&Path>,
) -> Result<(ScenarioFile, Option<ReferenceTrajectory>), ScenarioError> {
    let file = crate::open_scenario(path, overrides, models)?;
    for (key, why) in [
        ("tract", "a world"),
        ("motility", "a world"),
        ("engine", "a world"),
        ("patient", "a patient"),
        ("fault", "faults"),
    ] {
        if file.node.child(key).is_some() {
            return Err(file.node.error_at(key, &format!("a replay has no {why} to simulate")).into());
        }
    }
    let truth = file.node.child("truth").map(|node| ReferenceTrajectory::read(&node)).transpose()?;
    Ok((file, truth))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn rows(at_s: &[f64]) -> ReferenceTrajectory {
        let pose = |t: f64| Isometry3::new(Vector3::new(0.01 * t, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.2 * t));
        let poses = at_s.iter().map(|t| (SimTime::from_seconds(*t), pose(*t))).collect();
        ReferenceTrajectory { poses, max_gap_s: 0.5 }
    }

    #[test]
    fn closed_form_between_rows_the_twist_is_constant() {
        let truth = rows(&[0.0, 0.4]).at(SimTime::from_seconds(0.1)).unwrap();
        assert_relative_eq!(truth.world_from_capsule.translation.x, 0.001, epsilon = 1e-12);
        assert_relative_eq!(truth.velocity_world_m_s.x, 0.01, epsilon = 1e-12);
        assert_relative_eq!(truth.angular_rate_capsule_rad_s.z, 0.2, epsilon = 1e-12);
    }

    #[test]
    fn law_what_was_not_recorded_is_not_known() {
        let reference = rows(&[1.0, 1.2, 9.0]);
        let known = |t: f64| reference.at(SimTime::from_seconds(t)).is_some();
        assert!(!known(0.99) && known(1.0) && known(1.1) && known(1.2));
        assert!(!known(1.3) && !known(5.0) && known(9.0) && !known(9.001));
    }
}
