//! Replays: recorded data, and where there is one the reference trajectory to compare with.

#![expect(
    clippy::disallowed_types,
    reason = "world side: a reference trajectory is compared with, never estimated from"
)]

use lumenav_core::config::quantity::Finite;
use lumenav_core::pose::{exp_so3, interpolate};
use lumenav_core::{CapsuleTruth, ModalityError, Node, SimTime, TruthView};
use lumenav_records::{Table, tum};
use lumenav_scenario::{ScenarioError, ScenarioFile};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::Range;
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
    },
}

/// A recorded reference, interpolated at constant twist.
#[derive(Clone, Debug)]
pub struct ReferenceTrajectory {
    poses: Vec<(SimTime, Isometry3<f64>)>,
}

impl ReferenceTrajectory {
    fn read(node: &Node) -> Result<Self, ScenarioError> {
        let table: TruthFileTable = node.parse()?;
        let poses = match &table {
            TruthFileTable::Tum { file } => tum::read(&node.existing_path("file", file)?)?,
            TruthFileTable::Csv { .. } => read_csv(node, &table)?,
        };
        if poses.is_empty() {
            return Err(node.error_at("file", "the reference holds no pose").into());
        }
        Ok(Self { poses })
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

impl TruthView for ReferenceTrajectory {
    fn interval(&self) -> Range<SimTime> {
        // `read` refuses an empty reference.
        self.poses.first().map_or(SimTime::ZERO, |p| p.0)..self.poses.last().map_or(SimTime::ZERO, |p| p.0)
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        let after = self.poses.partition_point(|(t, _)| *t < at);
        let pose = match (after.checked_sub(1).and_then(|i| self.poses.get(i)), self.poses.get(after)) {
            (_, Some((t, pose))) if *t == at => *pose,
            (Some((ta, a)), Some((tb, b))) => interpolate(a, b, at.since_s(*ta) / tb.since_s(*ta)),
            (Some((_, pose)), None) | (None, Some((_, pose))) => *pose,
            (None, None) => Isometry3::identity(),
        };
        CapsuleTruth {
            at,
            world_from_capsule: pose,
            velocity_world_m_s: Vector3::zeros(),
            angular_rate_capsule_rad_s: Vector3::zeros(),
            specific_force_capsule_m_s2: Vector3::zeros(),
            arc_length_m: None,
            segment: None,
            wall_force_n: 0.0,
        }
    }

    fn frame(&self, _name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        None
    }
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
    for (key, why) in
        [("tract", "a world"), ("motility", "a world"), ("engine", "a world"), ("fault", "faults")]
    {
        if file.node.child(key).is_some() {
            return Err(file.node.error_at(key, &format!("a replay has no {why} to simulate")).into());
        }
    }
    let truth = file.node.child("truth").map(|node| ReferenceTrajectory::read(&node)).transpose()?;
    Ok((file, truth))
}
