//! Sensor arrays: `models/sensor-arrays/*.toml`.
//!
//! A file gives the noise and limits of its sensors and places them, either one by one (`[[sensor]]`) or by generators
//! (`[[plane]]`, `[[line]]`, `[[ring]]`). Positions are in the array's frame, which stands in the world unless a reading's
//! known poses move it (`array`: body-worn) or give every sensor its own (`s0`, `s1`, …: a flexible patch).

use crate::channels::{Channel, Channels};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, Node};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which axes of a sensor are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axes {
    /// Three orthogonal axes.
    #[default]
    Xyz,
    /// The first axis only.
    X,
    /// The second axis only.
    Y,
    /// The third axis only.
    Z,
}

impl Axes {
    fn unit_vectors(self) -> &'static [(char, Vector3<f64>)] {
        const X: (char, Vector3<f64>) = ('x', Vector3::new(1.0, 0.0, 0.0));
        const Y: (char, Vector3<f64>) = ('y', Vector3::new(0.0, 1.0, 0.0));
        const Z: (char, Vector3<f64>) = ('z', Vector3::new(0.0, 0.0, 1.0));
        match self {
            Self::Xyz => &[X, Y, Z],
            Self::X => &[X],
            Self::Y => &[Y],
            Self::Z => &[Z],
        }
    }
}

/// `[array]`: what all sensors of the array have in common.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArrayTable {
    name: String,
    #[serde(default)]
    description: String,
    source: String,
    /// Standard deviation of one reading of one axis, T.
    noise_tesla: Positive,
    /// Readings beyond this are clipped, T.
    saturation_tesla: Option<Positive>,
    /// Step of the converter, T.
    resolution_tesla: Option<Positive>,
    #[serde(default)]
    axes: Axes,
    /// Where a cold start looks first, mm; absent: a rule (see [`SensorArray::start_positions_m`]).
    #[serde(default)]
    start_positions_mm: Vec<[Finite; 3]>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorTable {
    position_mm: [Finite; 3],
    #[serde(default)]
    rotation_vector_deg: [Finite; 3],
    axes: Option<Axes>,
}

/// A regular grid, ends included.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaneTable {
    centre_mm: [Finite; 3],
    /// Direction of the columns.
    along: [Finite; 3],
    /// Direction of the rows.
    across: [Finite; 3],
    columns: u32,
    rows: u32,
    width_mm: NonNegative,
    height_mm: NonNegative,
    /// Takes every second sensor: 0 or 1 for the two halves of a checkerboard.
    checkerboard: Option<u32>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LineTable {
    from_mm: [Finite; 3],
    to_mm: [Finite; 3],
    count: u32,
}

/// Sensors on an ellipse around the z axis.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RingTable {
    centre_mm: [Finite; 3],
    semi_axis_x_mm: Positive,
    semi_axis_y_mm: Positive,
    count: u32,
    #[serde(default)]
    first_angle_deg: Finite,
}

/// The whole file, for its unknown keys.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArrayFile {
    #[serde(skip_serializing)]
    #[expect(dead_code, reason = "named here so that unknown tables are refused; parsed one by one below")]
    array: serde::de::IgnoredAny,
    #[serde(default)]
    sensor: Vec<SensorTable>,
    #[serde(default)]
    plane: Vec<PlaneTable>,
    #[serde(default)]
    line: Vec<LineTable>,
    #[serde(default)]
    ring: Vec<RingTable>,
}

/// One magnetometer in the array's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnetometer {
    /// `array_from_sensor`.
    pub pose: Isometry3<f64>,
    /// The axes that are read.
    pub axes: Axes,
}

/// An array as installed: what both sides know.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorArray {
    /// Its name.
    pub name: String,
    /// Its sensors.
    pub sensors: Vec<Magnetometer>,
    /// Noise of one reading of one axis, T.
    pub noise_tesla: f64,
    /// Clipping, T.
    pub saturation_tesla: Option<f64>,
    /// Step of the converter, T.
    pub resolution_tesla: Option<f64>,
    starts_m: Vec<Vector3<f64>>,
}

/// More sensors than this are a typing error.
const MAX_SENSORS: usize = 10_000;

fn vector_m(mm: &[Finite; 3]) -> Vector3<f64> {
    Vector3::new(mm[0].0, mm[1].0, mm[2].0) * 1e-3
}

/// `i` of `count` points from -1/2 to 1/2, ends included; a single point stands in the middle.
fn centred(i: u32, count: u32) -> f64 {
    if count < 2 { 0.0 } else { f64::from(i) / f64::from(count - 1) - 0.5 }
}

impl SensorArray {
    /// Reads an array file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(node: &Node) -> Result<Self, ConfigError> {
        let file: ArrayFile = node.parse_quietly()?;
        let table: ArrayTable = node.child_or_empty("array").parse()?;
        let mut places = Vec::new();
        for (i, sensor) in file.sensor.iter().enumerate() {
            let turn = vector_m(&sensor.rotation_vector_deg) * 1e3_f64.to_radians();
            let _ = i;
            places.push((vector_m(&sensor.position_mm), turn, sensor.axes.unwrap_or(table.axes)));
        }
        let mut place = |position: Vector3<f64>| places.push((position, Vector3::zeros(), table.axes));
        for (i, plane) in file.plane.iter().enumerate() {
            Self::check_count(node, "plane", i, plane.columns.saturating_mul(plane.rows))?;
            plane.places().into_iter().for_each(&mut place);
        }
        for (i, line) in file.line.iter().enumerate() {
            Self::check_count(node, "line", i, line.count)?;
            let (from, to) = (vector_m(&line.from_mm), vector_m(&line.to_mm));
            (0..line.count).for_each(|i| place(from + (to - from) * (centred(i, line.count) + 0.5)));
        }
        for (i, ring) in file.ring.iter().enumerate() {
            Self::check_count(node, "ring", i, ring.count)?;
            ring.places().into_iter().for_each(&mut place);
        }
        Self::from_places(node, &table, places)
    }

    fn check_count(node: &Node, kind: &str, index: usize, count: u32) -> Result<(), ConfigError> {
        if count == 0 || count as usize > MAX_SENSORS {
            let message = format!("{kind} {index} has {count} sensors; 1 to {MAX_SENSORS} are allowed");
            return Err(node.error_at(kind, &message));
        }
        Ok(())
    }

    fn from_places(
        node: &Node,
        table: &ArrayTable,
        places: Vec<(Vector3<f64>, Vector3<f64>, Axes)>,
    ) -> Result<Self, ConfigError> {
        if places.is_empty() || places.len() > MAX_SENSORS {
            let message = format!("the array has {} sensors; give 1 to {MAX_SENSORS}", places.len());
            return Err(node.error(&message));
        }
        let sensors: Vec<Magnetometer> = places
            .into_iter()
            .map(|(position, turn, axes)| Magnetometer { pose: Isometry3::new(position, turn), axes })
            .collect();
        for (i, a) in sensors.iter().enumerate() {
            let twin = sensors[..i]
                .iter()
                .position(|b| (a.pose.translation.vector - b.pose.translation.vector).norm() < 1e-6);
            // Two single-axis sensors may share a place; two triads there are one sensor counted twice.
            if let Some(j) = twin.filter(|j| sensors[*j].axes == Axes::Xyz || a.axes == Axes::Xyz)
                && !node.file().is_empty()
                && table.description.is_empty()
            {
                let message = format!("sensors {j} and {i} stand at the same place; say why in `array.description`");
                return Err(node.error(&message));
            }
        }
        let starts_m = table.start_positions_mm.iter().map(vector_m).collect();
        Ok(Self {
            name: table.name.clone(),
            sensors,
            noise_tesla: table.noise_tesla.0,
            saturation_tesla: table.saturation_tesla.map(|v| v.0),
            resolution_tesla: table.resolution_tesla.map(|v| v.0),
            starts_m,
        })
    }

    /// An array of three-axis sensors at these places, axes along the world's.
    pub fn of_triads(name: &str, positions_m: &[Vector3<f64>], noise_tesla: f64) -> Self {
        let sensors = positions_m
            .iter()
            .map(|p| Magnetometer { pose: Isometry3::from_parts((*p).into(), UnitQuaternion::identity()), axes: Axes::Xyz })
            .collect();
        Self {
            name: name.to_owned(),
            sensors,
            noise_tesla,
            saturation_tesla: None,
            resolution_tesla: None,
            starts_m: Vec::new(),
        }
    }

    /// Labels of the channels as CSV files name them: `s0x_T`, `s0y_T`, …
    pub fn labels(&self) -> Vec<String> {
        let mut labels = Vec::new();
        for (i, sensor) in self.sensors.iter().enumerate() {
            labels.extend(sensor.axes.unit_vectors().iter().map(|(name, _)| format!("s{i}{name}_T")));
        }
        labels
    }

    /// The channels with the array's frame at `world_from_array`.
    pub fn channels(&self, world_from_array: &Isometry3<f64>) -> Channels {
        self.channels_at(|_, sensor| world_from_array * sensor.pose)
    }

    /// The channels as a reading's known poses put them: `array` moves all, `s<i>` places one.
    pub fn channels_known(&self, known_poses: &BTreeMap<String, Isometry3<f64>>) -> Channels {
        let array = known_poses.get("array").copied().unwrap_or_else(Isometry3::identity);
        self.channels_at(|i, sensor| {
            known_poses.get(&format!("s{i}")).copied().unwrap_or(array * sensor.pose)
        })
    }

    fn channels_at(&self, world_from_sensor: impl Fn(usize, &Magnetometer) -> Isometry3<f64>) -> Channels {
        let mut out = Channels { positions_world_m: Vec::new(), channels: Vec::new() };
        for (i, sensor) in self.sensors.iter().enumerate() {
            let pose = world_from_sensor(i, sensor);
            out.positions_world_m.push(pose.translation.vector);
            for (_, axis) in sensor.axes.unit_vectors() {
                out.channels.push(Channel { sensor: i, axis_world: pose.rotation * axis });
            }
        }
        out
    }

    /// Where a cold start looks: the file's own, else the centroid of the sensors, moved off a flat array along its normal by
    /// 0.4 times its extent (0.2 m for the reference grid of 0.5 m) to both sides.
    pub fn start_positions_m(&self, channels: &Channels) -> Vec<Vector3<f64>> {
        if !self.starts_m.is_empty() {
            return self.starts_m.clone();
        }
        let n = channels.positions_world_m.len() as f64;
        let centroid = channels.positions_world_m.iter().sum::<Vector3<f64>>() / n;
        let mut spread = nalgebra::Matrix3::zeros();
        let mut extent: f64 = 0.0;
        for p in &channels.positions_world_m {
            let d = p - centroid;
            spread += d * d.transpose();
            extent = extent.max(d.norm());
        }
        let eigen = spread.symmetric_eigen();
        let flat = eigen.eigenvalues.imin();
        let thickness = (eigen.eigenvalues[flat].max(0.0) / n).sqrt();
        if thickness > 0.1 * extent {
            return vec![centroid];
        }
        // Half the diagonal of the reference grid is 0.354 m: 0.566 times that is 0.2 m.
        let step = eigen.eigenvectors.column(flat) * (0.566 * extent);
        vec![centroid + step, centroid - step]
    }

    /// The centre of the sensors, for messages and pictures.
    pub fn centre(&self) -> Point3<f64> {
        let sum: Vector3<f64> = self.sensors.iter().map(|s| s.pose.translation.vector).sum();
        Point3::from(sum / self.sensors.len().max(1) as f64)
    }
}

impl PlaneTable {
    fn places(&self) -> Vec<Vector3<f64>> {
        let centre = vector_m(&self.centre_mm);
        let along = vector_m(&self.along).normalize() * (self.width_mm.0 * 1e-3);
        let across = vector_m(&self.across).normalize() * (self.height_mm.0 * 1e-3);
        let mut places = Vec::new();
        for row in 0..self.rows {
            for column in 0..self.columns {
                if self.checkerboard.is_none_or(|half| (row + column) % 2 == half % 2) {
                    places.push(centre + along * centred(column, self.columns) + across * centred(row, self.rows));
                }
            }
        }
        places
    }
}

impl RingTable {
    fn places(&self) -> Vec<Vector3<f64>> {
        (0..self.count)
            .map(|i| {
                let turn = std::f64::consts::TAU * f64::from(i) / f64::from(self.count);
                let angle = self.first_angle_deg.0.to_radians() + turn;
                vector_m(&self.centre_mm)
                    + Vector3::new(
                        self.semi_axis_x_mm.0 * 1e-3 * angle.cos(),
                        self.semi_axis_y_mm.0 * 1e-3 * angle.sin(),
                        0.0,
                    )
            })
            .collect()
    }
}
