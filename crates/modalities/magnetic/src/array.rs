//! Sensor arrays: `models/sensor-arrays/*.toml`.
//!
//! A file gives the noise and limits of its sensors and places them, either one by one (`[[sensor]]`) or by generators
//! (`[[plane]]`, `[[line]]`, `[[ring]]`). Positions are in the array's frame, which stands in the world unless a reading's
//! known poses move it (`array`: body-worn) or give every sensor its own (`s0`, `s1`, …: a flexible patch).

use crate::channels::{Channel, Channels};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::pose::exp_so3;
use lumenav_core::{ConfigError, Node};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Vector3};
use serde::de::IgnoredAny;
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
    /// Indices of the axes: 0 for x, 1 for y, 2 for z.
    pub fn indices(self) -> &'static [usize] {
        match self {
            Self::Xyz => &[0, 1, 2],
            Self::X => &[0],
            Self::Y => &[1],
            Self::Z => &[2],
        }
    }
}

/// Names of the axes in channel labels.
const AXIS_NAMES: [char; 3] = ['x', 'y', 'z'];

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
    /// Whether it stands far from the magnet, to tell the ambient field: no part of a layout, and no place for a start.
    #[serde(default)]
    reference: bool,
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

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArrayFile {
    #[expect(dead_code, reason = "named here, so that it is no unknown table; parsed by itself for the log")]
    array: IgnoredAny,
    #[serde(default)]
    sensor: Vec<SensorTable>,
    #[serde(default)]
    plane: Vec<PlaneTable>,
    #[serde(default)]
    line: Vec<LineTable>,
    #[serde(default)]
    ring: Vec<RingTable>,
}

/// Entry `index` of `[[kind]]`: where an error is reported.
#[derive(Clone, Copy)]
struct Entry {
    kind: &'static str,
    index: usize,
}

impl Entry {
    fn error(self, file: &Node, key: Option<&str>, message: &str) -> ConfigError {
        let entries = file.children(self.kind).unwrap_or_default();
        match (entries.get(self.index), key) {
            (Some(entry), Some(key)) => entry.error_at(key, message),
            (Some(entry), None) => entry.error(message),
            (None, _) => file.error_at(self.kind, message),
        }
    }
}

/// One magnetometer in the array's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnetometer {
    /// `array_from_sensor`.
    pub pose: Isometry3<f64>,
    /// The axes that are read.
    pub axes: Axes,
    /// Whether it stands far from the magnet, to tell the ambient field.
    pub reference: bool,
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
/// Positions beyond this are a typing error: no field of a capsule's magnet is measured at a hundred metres.
pub(crate) const MAX_DISTANCE_M: f64 = 100.0;
/// Sensors nearer to each other than this stand at one place.
const SAME_PLACE_M: f64 = 1e-6;

fn vector_m(mm: &[Finite; 3]) -> Vector3<f64> {
    Vector3::from(mm.map(|v| v.0)) * 1e-3
}

/// `i` of `count` points from -1/2 to 1/2, ends included; a single point stands in the middle.
fn centred(i: u32, count: u32) -> f64 {
    if count < 2 { 0.0 } else { f64::from(i) / f64::from(count - 1) - 0.5 }
}

/// Sensors collected from a file, each with the entry that placed it.
struct Places<'a> {
    file: &'a Node,
    axes: Axes,
    sensors: Vec<Magnetometer>,
    entries: Vec<Entry>,
}

impl Places<'_> {
    fn add(&mut self, entry: Entry, sensor: Magnetometer) -> Result<(), ConfigError> {
        let pose = &sensor.pose;
        if pose.translation.vector.amax() > MAX_DISTANCE_M {
            let message = format!("a sensor more than {MAX_DISTANCE_M} m from the array's origin");
            return Err(entry.error(self.file, None, &message));
        }
        // An angle of 1e308 degrees overflows; no number of it is a direction.
        if (pose.rotation.norm() - 1.0).abs().partial_cmp(&1e-9) != Some(std::cmp::Ordering::Less) {
            let message = "a rotation too large to be one; give degrees within a few turns";
            return Err(entry.error(self.file, Some("rotation_vector_deg"), message));
        }
        if self.sensors.len() >= MAX_SENSORS {
            return Err(entry.error(self.file, None, &format!("more than {MAX_SENSORS} sensors in all")));
        }
        self.sensors.push(sensor);
        self.entries.push(entry);
        Ok(())
    }

    /// Sensors along the array's axes, as generators place them; `count` of them before any are left out.
    fn add_all(
        &mut self,
        entry: Entry,
        count: u32,
        places: impl Iterator<Item = Vector3<f64>>,
    ) -> Result<(), ConfigError> {
        if count == 0 || count as usize > MAX_SENSORS {
            let message = format!("{count} sensors; 1 to {MAX_SENSORS} are allowed");
            return Err(entry.error(self.file, None, &message));
        }
        for position in places {
            let pose = Translation3::from(position).into();
            self.add(entry, Magnetometer { pose, axes: self.axes, reference: false })?;
        }
        Ok(())
    }

    /// Two sensors at one place that are one sensor counted twice. Two single-axis sensors may share a place.
    fn refuse_twins(&self) -> Result<(), ConfigError> {
        for (i, a) in self.sensors.iter().enumerate() {
            let twin = self.sensors[..i].iter().position(|b| {
                let distance = (a.pose.translation.vector - b.pose.translation.vector).norm();
                distance < SAME_PLACE_M && (a.axes == Axes::Xyz || b.axes == Axes::Xyz)
            });
            if let Some(j) = twin {
                let message =
                    format!("sensors {j} and {i} stand at the same place; say why in `array.description`");
                return Err(self.entries[i].error(self.file, None, &message));
            }
        }
        Ok(())
    }
}

impl ArrayFile {
    fn place(&self, places: &mut Places<'_>) -> Result<(), ConfigError> {
        for (index, sensor) in self.sensor.iter().enumerate() {
            let axes = sensor.axes.unwrap_or(places.axes);
            let sensor = Magnetometer { pose: sensor.pose(), axes, reference: sensor.reference };
            places.add(Entry { kind: "sensor", index }, sensor)?;
        }
        for (index, plane) in self.plane.iter().enumerate() {
            plane.place(Entry { kind: "plane", index }, places)?;
        }
        for (index, line) in self.line.iter().enumerate() {
            places.add_all(Entry { kind: "line", index }, line.count, line.places())?;
        }
        for (index, ring) in self.ring.iter().enumerate() {
            places.add_all(Entry { kind: "ring", index }, ring.count, ring.places())?;
        }
        Ok(())
    }
}

impl SensorArray {
    /// Reads an array file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(node: &Node) -> Result<Self, ConfigError> {
        let file: ArrayFile = node.parse_quietly()?;
        let table: ArrayTable = node.child_or_empty("array").parse()?;
        let mut places = Places { file: node, axes: table.axes, sensors: Vec::new(), entries: Vec::new() };
        file.place(&mut places)?;
        if places.sensors.is_empty() {
            return Err(
                node.error("the array has no sensors; give [[sensor]], [[plane]], [[line]] or [[ring]]")
            );
        }
        if table.description.is_empty() {
            places.refuse_twins()?;
        }
        Ok(Self {
            name: table.name,
            sensors: places.sensors,
            noise_tesla: table.noise_tesla.0,
            saturation_tesla: table.saturation_tesla.map(|v| v.0),
            resolution_tesla: table.resolution_tesla.map(|v| v.0),
            starts_m: table.start_positions_mm.iter().map(vector_m).collect(),
        })
    }

    /// An array of three-axis sensors at these places, axes along the world's.
    pub fn of_triads(name: &str, positions_m: &[Vector3<f64>], noise_tesla: f64) -> Self {
        let sensors = positions_m
            .iter()
            .map(|p| Magnetometer { pose: Translation3::from(*p).into(), axes: Axes::Xyz, reference: false })
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

    /// Whether the reference sensors read along three directions that differ by more than some degrees.
    pub fn reference_tells_all(&self) -> bool {
        let mut seen = Matrix3::zeros();
        for sensor in self.sensors.iter().filter(|sensor| sensor.reference) {
            for axis in sensor.axes.indices() {
                let along: Vector3<f64> = sensor.pose.rotation * Vector3::ith(*axis, 1.0);
                seen += along * along.transpose();
            }
        }
        seen.symmetric_eigenvalues().min() > 1e-2
    }

    /// Where a cold start looks first, as the file says, m in the array's frame.
    pub fn starts_m(&self) -> &[Vector3<f64>] {
        &self.starts_m
    }

    /// Labels of the channels as CSV files name them: `s0x_T`, `s0y_T`, …
    pub fn labels(&self) -> Vec<String> {
        let mut labels = Vec::new();
        for (i, sensor) in self.sensors.iter().enumerate() {
            labels.extend(sensor.axes.indices().iter().map(|axis| format!("s{i}{}_T", AXIS_NAMES[*axis])));
        }
        labels
    }

    /// Sensor and axis (0 to 2) of every channel.
    pub fn channel_axes(&self) -> Vec<(usize, usize)> {
        let of_sensor =
            |(i, sensor): (usize, &Magnetometer)| sensor.axes.indices().iter().map(move |axis| (i, *axis));
        self.sensors.iter().enumerate().flat_map(of_sensor).collect()
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
            for axis in sensor.axes.indices() {
                let unit = |i: usize| pose.rotation * Vector3::ith(i % 3, 1.0);
                let across_world = [unit(axis + 1), unit(axis + 2)];
                out.channels.push(Channel { sensor: i, axis_world: unit(*axis), across_world });
            }
        }
        out
    }

    /// Places of the sensors that are there to see the magnet: all but the reference sensors, unless there are no others.
    fn beside_the_capsule<'a>(&'a self, channels: &'a Channels) -> impl Iterator<Item = Vector3<f64>> + 'a {
        let all_reference = self.sensors.iter().all(|sensor| sensor.reference);
        let seen = move |sensor: &Magnetometer| all_reference || !sensor.reference;
        let places = channels.positions_world_m.iter().zip(&self.sensors);
        places.filter(move |(_, sensor)| seen(sensor)).map(|(place, _)| *place)
    }

    /// Where a cold start looks, in the world: the file's own places, else the centroid of the sensors, moved off a flat
    /// array along its normal by 0.4 times its extent (0.2 m for the reference grid of 0.5 m) to both sides.
    pub fn start_positions_m(
        &self,
        channels: &Channels,
        world_from_array: &Isometry3<f64>,
    ) -> Vec<Vector3<f64>> {
        if !self.starts_m.is_empty() {
            return self.starts_m.iter().map(|p| (world_from_array * Point3::from(*p)).coords).collect();
        }
        let beside: Vec<Vector3<f64>> = self.beside_the_capsule(channels).collect();
        let n = beside.len() as f64;
        let centroid = beside.iter().sum::<Vector3<f64>>() / n;
        let mut spread = Matrix3::zeros();
        let mut extent: f64 = 0.0;
        for p in &beside {
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
}

impl SensorTable {
    fn pose(&self) -> Isometry3<f64> {
        let turn_rad = Vector3::from(self.rotation_vector_deg.map(|v| v.0.to_radians()));
        Isometry3::from_parts(vector_m(&self.position_mm).into(), exp_so3(&turn_rad))
    }
}

impl PlaneTable {
    fn place(&self, entry: Entry, places: &mut Places<'_>) -> Result<(), ConfigError> {
        if self.checkerboard.is_some_and(|half| half > 1) {
            let message = "0 and 1 are the two halves of a checkerboard";
            return Err(entry.error(places.file, Some("checkerboard"), message));
        }
        let direction = |key: &str, v: &[Finite; 3]| {
            let message = "a direction of length zero; give a vector such as [1, 0, 0]";
            let unit = vector_m(v).try_normalize(f64::MIN_POSITIVE);
            unit.ok_or_else(|| entry.error(places.file, Some(key), message))
        };
        let along = direction("along", &self.along)? * (self.width_mm.0 * 1e-3);
        let across = direction("across", &self.across)? * (self.height_mm.0 * 1e-3);
        let centre = vector_m(&self.centre_mm);
        let (rows, columns) = (self.rows, self.columns);
        let taken = |row: u32, column: u32| self.checkerboard.is_none_or(|half| (row + column) % 2 == half);
        let sensors = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| (row, column)))
            .filter(|(row, column)| taken(*row, *column))
            .map(|(row, column)| centre + along * centred(column, columns) + across * centred(row, rows));
        places.add_all(entry, columns.saturating_mul(rows), sensors)
    }
}

impl LineTable {
    fn places(&self) -> impl Iterator<Item = Vector3<f64>> {
        let (from, to) = (vector_m(&self.from_mm), vector_m(&self.to_mm));
        (0..self.count).map(move |i| from + (to - from) * (centred(i, self.count) + 0.5))
    }
}

impl RingTable {
    fn places(&self) -> impl Iterator<Item = Vector3<f64>> {
        let (a_m, b_m) = (self.semi_axis_x_mm.0 * 1e-3, self.semi_axis_y_mm.0 * 1e-3);
        (0..self.count).map(move |i| {
            let turn = std::f64::consts::TAU * f64::from(i) / f64::from(self.count);
            let angle = self.first_angle_deg.0.to_radians() + turn;
            vector_m(&self.centre_mm) + Vector3::new(a_m * angle.cos(), b_m * angle.sin(), 0.0)
        })
    }
}
