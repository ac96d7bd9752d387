//! The tables of a magnetic sensor in a scenario.
//!
//! `[sensor.installed]` is what both sides know, `[sensor.reality]` what the world does beyond it, `[track.sensor.<name>]`
//! what an estimator is told to do. The magnet itself stands in the capsule's model: `[magnet]`.

use crate::array::SensorArray;
use crate::front_end::Output;
use crate::nuisance::{Spread, Unknowns};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, ModalityError, Node, Setup};
use lumenav_fields::{Cylinder, FieldSource};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// `[sensor.installed]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstalledTable {
    /// Name of a sensor array in `models/sensor-arrays`, or a path.
    pub array: String,
    /// Whether readings clip at the array's saturation.
    #[serde(default = "yes")]
    pub saturation: bool,
    /// Whether readings are rounded to the array's resolution.
    #[serde(default = "yes")]
    pub quantization: bool,
    /// Noise of one reading of one axis, T; absent: the array's.
    pub noise_tesla: Option<Positive>,
    /// Name of the moving frame the array is fixed to: `torso`, or `abdomen`, where each breath lifts it and estimators are told the place
    /// of the torso; absent: the room.
    pub worn_on: Option<String>,
}

fn yes() -> bool {
    true
}

/// Field law of a magnet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Law {
    /// Point dipole.
    Dipole,
    /// Exact field of the cylinder (Derby and Olbert 2010).
    #[default]
    Cylinder,
}

/// A magnetic object that comes near: a ferromagnetic disturbance, as a point dipole for a time.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisturbanceTable {
    /// When it comes, s.
    pub start_s: NonNegative,
    /// When it is gone, s.
    pub end_s: Positive,
    /// Where, mm in the world.
    pub position_mm: [Finite; 3],
    /// Its remanent moment, A m²: a magnet. One of this and `sphere_radius_mm`.
    pub moment_a_m2: Option<[Finite; 3]>,
    /// Radius of an iron sphere, mm: magnetised by the Earth's field, the ambient one and the capsule's magnet.
    pub sphere_radius_mm: Option<Positive>,
}

/// A turn of the patient under the Earth's field.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TurnTable {
    /// When it begins, s.
    pub start_s: NonNegative,
    /// When it ends, s.
    pub end_s: Positive,
    /// About which axis of the patient.
    pub axis: [Finite; 3],
    /// By how much, degrees; the field turns the other way.
    pub angle_deg: Finite,
}

/// `[sensor.reality]`: what the world does that no estimator is told.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealityTable {
    /// Field law of the true magnet.
    pub law: Law,
    /// Standard deviation of a constant offset per channel, T.
    pub bias_sigma_tesla: NonNegative,
    /// Standard deviation of a relative gain error per channel.
    pub gain_sigma: NonNegative,
    /// Standard deviation of each channel's axis error, degrees per tangent direction.
    pub axis_sigma_deg: NonNegative,
    /// Standard deviation of each sensor's misplacement, mm per axis.
    pub placement_sigma_mm: NonNegative,
    /// Uniform ambient field in the world, T.
    pub ambient_tesla: [Finite; 3],
    /// The Earth's field as it lies in the world at the start, T. The array was zeroed in it, so that it is seen only as far as it turns.
    pub earth_tesla: [Finite; 3],
    /// Turns of the patient (whose frame the world is) under that field, at constant rate, one after another.
    pub turn: Vec<TurnTable>,
    /// Relative error of the magnet's strength (0.01: the true magnet is 1 % stronger).
    pub strength_error: Finite,
    /// Magnetic objects that come near.
    pub disturbance: Vec<DisturbanceTable>,
}

impl RealityTable {
    /// Reads the table and refuses what no world can be.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(node: &Node) -> Result<Self, ConfigError> {
        let table: Self = node.parse_sourced(&REALITY_SOURCES)?;
        if table.strength_error.0 <= -1.0 {
            let message = "a strength error of -1 or below leaves no magnet; allowed: above -1";
            return Err(node.error_at("strength_error", message));
        }
        for (i, disturbance) in table.disturbance.iter().enumerate() {
            if disturbance.end_s.0 <= disturbance.start_s.0 {
                return Err(node.error_at("disturbance", &format!("disturbance {i} ends before it starts")));
            }
            if disturbance.moment_a_m2.is_some() == disturbance.sphere_radius_mm.is_some() {
                let message = format!(
                    "disturbance {i} is either a magnet (`moment_a_m2`) or a sphere of iron (`sphere_radius_mm`); give one of them"
                );
                return Err(node.error_at("disturbance", &message));
            }
        }
        let mut before_s = 0.0;
        for (i, turn) in table.turn.iter().enumerate() {
            if turn.end_s.0 <= turn.start_s.0 || turn.start_s.0 < before_s {
                let message = format!("turn {i} ends before it starts, or starts before the last one ends");
                return Err(node.error_at("turn", &message));
            }
            before_s = turn.end_s.0;
            let length = Vector3::from(turn.axis.map(|v| v.0)).norm();
            if !(1e-9..=1e9).contains(&length) {
                let message = format!(
                    "turn {i} has an axis of length {length}; give a vector such as [0, 0, 1] (allowed: 1e-9 to 1e9)"
                );
                return Err(node.error_at("turn", &message));
            }
            if turn.angle_deg.0.abs() > 3600.0 {
                let message = format!("turn {i} is by {} degrees; at most ten turns, 3600", turn.angle_deg.0);
                return Err(node.error_at("turn", &message));
            }
        }
        Ok(table)
    }
}

/// What a track does about the ambient field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ambient {
    /// Nothing: it was taken off before.
    #[default]
    Known,
    /// Only differences between channels are used: the field is free in each reading.
    Differences,
    /// As `differences`, and the array has to have reference sensors that tell all of the field by themselves: where few channels are near
    /// the magnet, the pose needs them.
    Reference,
    /// The filter carries it from reading to reading (`flux`).
    Estimated,
}

/// `[track.sensor.<name>]` for a magnetic sensor.
#[expect(clippy::struct_excessive_bools, reason = "keys of a file, each by itself")]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OptionsTable {
    /// `pose` (maximum likelihood) or `flux` (raw readings for the filter).
    pub front_end: Output,
    /// Field law that the estimator assumes.
    pub law: Law,
    /// Noise the estimator assumes, T; absent: the installed one.
    pub noise_tesla: Option<Positive>,
    /// Relative model error the estimator allows for, added to the noise as this share of each reading.
    pub relative_error: NonNegative,
    /// Whether the magnet's strength is unknown: `pose` solves for it in each reading, `flux` carries it.
    pub unknown_strength: bool,
    /// Standard deviation of its relative error at the start (`flux`); absent: 0.1.
    pub strength_sigma: Option<Positive>,
    /// Its random walk per square root of a second (`flux`); absent: 0.
    pub strength_walk: Option<NonNegative>,
    /// What is done about the ambient field.
    pub ambient: Ambient,
    /// Standard deviation of an estimated ambient field at the start, T per axis; absent: 5e-5.
    pub ambient_sigma_tesla: Option<Positive>,
    /// Its random walk, T per square root of a second; absent: 0.
    pub ambient_walk_tesla: Option<NonNegative>,
    /// Whether the channels have offsets that nobody knows (`flux`).
    pub unknown_bias: bool,
    /// Their standard deviation, T; absent: 1e-7.
    pub bias_sigma_tesla: Option<Positive>,
    /// Their random walk, T per square root of a second; absent: 0.
    pub bias_walk_tesla: Option<NonNegative>,
    /// Whether the channels have gains that nobody knows (`flux`).
    pub unknown_gain: bool,
    /// Standard deviation of their relative errors; absent: 0.01.
    pub gain_sigma: Option<Positive>,
    /// Whether the channels have axes that nobody knows (`flux`).
    pub unknown_axes: bool,
    /// Standard deviation of an axis about each of two directions, degrees; absent: 1.
    pub axis_sigma_deg: Option<Positive>,
    /// A pose whose χ² per degree of freedom exceeds this is refused as "does not fit a magnet". Absent: 25 (five standard
    /// deviations on every channel).
    pub max_reduced_chi_square: Option<Positive>,
}

impl OptionsTable {
    /// Reads the table and refuses what contradicts itself.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(node: &Node) -> Result<Self, ConfigError> {
        let table: Self = node.parse_sourced(&OPTIONS_SOURCES)?;
        let pose = table.front_end == Output::Pose;
        let estimated = table.ambient == Ambient::Estimated;
        for (key, asked) in [
            ("unknown_bias", table.unknown_bias),
            ("unknown_gain", table.unknown_gain),
            ("unknown_axes", table.unknown_axes),
            ("ambient", estimated),
        ] {
            if asked && pose {
                let message = "`front_end = \"pose\"` keeps nothing from reading to reading; set `front_end = \"flux\"`";
                return Err(node.error_at(key, message));
            }
        }
        let strength =
            (table.unknown_strength && !pose, "`unknown_strength = true` with `front_end = \"flux\"`");
        let ambient = (estimated, "`ambient = \"estimated\"`");
        let bias = (table.unknown_bias, "`unknown_bias = true`");
        for (key, given, (carried, needed)) in [
            ("strength_sigma", table.strength_sigma.is_some(), strength),
            ("strength_walk", table.strength_walk.is_some(), strength),
            ("ambient_sigma_tesla", table.ambient_sigma_tesla.is_some(), ambient),
            ("ambient_walk_tesla", table.ambient_walk_tesla.is_some(), ambient),
            ("bias_sigma_tesla", table.bias_sigma_tesla.is_some(), bias),
            ("bias_walk_tesla", table.bias_walk_tesla.is_some(), bias),
            ("gain_sigma", table.gain_sigma.is_some(), (table.unknown_gain, "`unknown_gain = true`")),
            ("axis_sigma_deg", table.axis_sigma_deg.is_some(), (table.unknown_axes, "`unknown_axes = true`")),
        ] {
            if given && !carried {
                return Err(node.error_at(
                    key,
                    &format!("says how well something is known that is known; set {needed} too"),
                ));
            }
        }
        Ok(table)
    }

    /// What the filter is asked to carry.
    pub fn unknowns(&self) -> Unknowns {
        let spread = |asked: bool, sigma: Option<Positive>, or: f64, walk: Option<NonNegative>| {
            asked.then(|| Spread { sigma: sigma.map_or(or, |s| s.0), walk: walk.map_or(0.0, |w| w.0) })
        };
        let axis = spread(self.unknown_axes, self.axis_sigma_deg, 1.0, None);
        Unknowns {
            strength: spread(
                self.unknown_strength && self.front_end == Output::Flux,
                self.strength_sigma,
                0.1,
                self.strength_walk,
            ),
            ambient_tesla: spread(
                self.ambient == Ambient::Estimated,
                self.ambient_sigma_tesla,
                5e-5,
                self.ambient_walk_tesla,
            ),
            bias_tesla: spread(self.unknown_bias, self.bias_sigma_tesla, 1e-7, self.bias_walk_tesla),
            gain: spread(self.unknown_gain, self.gain_sigma, 0.01, None),
            axis_rad: axis.map(|s| Spread { sigma: s.sigma.to_radians(), ..s }),
        }
    }
}

/// Where the defaults of these tables come from: key and source.
pub const INSTALLED_SOURCES: [(&str, &str); 4] = [
    ("saturation", "chosen: a real converter has an end"),
    ("quantization", "chosen: a real converter has steps"),
    ("noise_tesla", "the array's file"),
    ("worn_on", "chosen: fixed to the room"),
];

/// See [`INSTALLED_SOURCES`].
pub const REALITY_SOURCES: [(&str, &str); 10] = [
    ("law", "exact field of the cylinder, Derby and Olbert 2010"),
    ("bias_sigma_tesla", "chosen: a perfect array unless the scenario says else"),
    ("gain_sigma", "chosen: a perfect array unless the scenario says else"),
    ("axis_sigma_deg", "chosen: a perfect array unless the scenario says else"),
    ("placement_sigma_mm", "chosen: a perfect array unless the scenario says else"),
    ("ambient_tesla", "chosen: the Earth's field is taken off before"),
    ("earth_tesla", "chosen: the Earth's field is taken off before"),
    ("turn", "chosen: the patient rests"),
    ("strength_error", "chosen: the magnet is as its model says"),
    ("disturbance", "chosen: nothing magnetic comes near"),
];

/// See [`INSTALLED_SOURCES`].
pub const OPTIONS_SOURCES: [(&str, &str); 18] = [
    ("front_end", "chosen: a pose without a filter"),
    ("law", "exact field of the cylinder, Derby and Olbert 2010"),
    ("noise_tesla", "the installed noise, with the converter's step (Widrow and Kollar 2008)"),
    ("relative_error", "chosen: the estimator trusts its field law"),
    ("unknown_strength", "chosen: the magnet is as its model says"),
    ("strength_sigma", "chosen: 0.1, where unknown; a magnet's remanence is sold to some per cent"),
    ("strength_walk", "chosen: 0, a magnet does not age within an exam"),
    ("ambient", "chosen: the Earth's field is taken off before"),
    ("ambient_sigma_tesla", "chosen: 5e-5, where estimated; the Earth's field"),
    ("ambient_walk_tesla", "chosen: 0, a patient at rest"),
    ("unknown_bias", "chosen: a calibrated array"),
    ("bias_sigma_tesla", "chosen: 1e-7, where unknown"),
    ("bias_walk_tesla", "chosen: 0"),
    ("unknown_gain", "chosen: a calibrated array"),
    ("gain_sigma", "chosen: 0.01, where unknown"),
    ("unknown_axes", "chosen: a calibrated array"),
    ("axis_sigma_deg", "chosen: 1, where unknown"),
    ("max_reduced_chi_square", "chosen: 25, five standard deviations on every channel"),
];

/// See [`INSTALLED_SOURCES`].
pub const MAGNET_SOURCES: [(&str, &str); 1] = [("offset_mm", "chosen: in the capsule's middle")];

/// `[magnet]` of a capsule model.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MagnetTable {
    /// Diameter, mm.
    pub diameter_mm: Positive,
    /// Length along its axis, mm.
    pub length_mm: Positive,
    /// Remanence, T.
    pub remanence_tesla: Positive,
    /// Its centre in the capsule's frame, mm.
    #[serde(default)]
    pub offset_mm: [Finite; 3],
    /// Where the numbers come from.
    pub source: String,
}

/// The magnet in the capsule: size, strength, place. Its north points along the capsule's x axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnet {
    /// The cylinder.
    pub cylinder: Cylinder,
    /// Its centre in the capsule's frame, m.
    pub offset_capsule_m: Vector3<f64>,
}

impl Magnet {
    /// Reads `[magnet]` of a capsule's model file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key; a capsule without a magnet says so.
    pub fn from_capsule(setup: &Setup) -> Result<Self, ConfigError> {
        let Some(node) = setup.capsule_model.child("magnet") else {
            let message = format!("sensor `{}` is magnetic, but this capsule has no [magnet]", setup.sensor);
            return Err(setup.capsule_model.error(&message));
        };
        let table: MagnetTable = node.parse_sourced(&MAGNET_SOURCES)?;
        let (radius, length) = (0.5e-3 * table.diameter_mm.0, 1e-3 * table.length_mm.0);
        let cylinder = Cylinder::magnet(radius, length, table.remanence_tesla.0)
            .map_err(|error| node.error(&error.to_string()))?;
        let [x, y, z] = table.offset_mm.map(|v| v.0 * 1e-3);
        Ok(Self { cylinder, offset_capsule_m: Vector3::new(x, y, z) })
    }

    /// Its field law.
    pub fn source(&self, law: Law) -> FieldSource {
        match law {
            Law::Dipole => FieldSource::Dipole { strength_t_m3: self.cylinder.strength_t_m3() },
            Law::Cylinder => FieldSource::Cylinder(self.cylinder),
        }
    }
}

/// `[sensor.installed]` with its array opened.
#[derive(Clone, Debug)]
pub struct Installed {
    /// The table.
    pub table: InstalledTable,
    /// The array.
    pub array: SensorArray,
    /// The magnet.
    pub magnet: Magnet,
}

impl Installed {
    /// Reads the table, the array's file and the capsule's magnet.
    ///
    /// # Errors
    /// [`ModalityError::Config`] with file, line and key.
    pub fn from_node(node: &Node, setup: &Setup) -> Result<Self, ModalityError> {
        let table: InstalledTable = node.parse_sourced(&INSTALLED_SOURCES)?;
        let file = setup.models.open("sensor-arrays", &table.array, node, "array")?;
        let array = SensorArray::from_node(&file)?;
        let magnet = Magnet::from_capsule(setup)?;
        Ok(Self { table, array, magnet })
    }

    /// Noise of one reading of one axis before the converter, T.
    pub fn noise_tesla(&self) -> f64 {
        self.table.noise_tesla.map_or(self.array.noise_tesla, |v| v.0)
    }

    /// Step of the converter where readings are rounded, T.
    pub fn step_tesla(&self) -> Option<f64> {
        self.array.resolution_tesla.filter(|_| self.table.quantization)
    }

    /// Limit of the converter where readings clip, T.
    pub fn limit_tesla(&self) -> Option<f64> {
        self.array.saturation_tesla.filter(|_| self.table.saturation)
    }

    /// Standard deviation of a reading behind the converter, T: a step q adds q²/12 (Widrow and Kollár 2008; exact enough
    /// from a noise of half a step on).
    pub fn reading_sigma_tesla(&self) -> f64 {
        let step = self.step_tesla().unwrap_or(0.0);
        self.noise_tesla().hypot(step / 12.0_f64.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn law_every_default_has_a_source() {
        let node = Node::parse_text("array = \"a\"\n", "s.toml", Path::new(""), &[]).unwrap();
        let _: InstalledTable = node.parse_sourced(&INSTALLED_SOURCES).unwrap();
        let empty = node.child_or_empty("nothing");
        let _: RealityTable = empty.parse_sourced(&REALITY_SOURCES).unwrap();
        let _: OptionsTable = empty.parse_sourced(&OPTIONS_SOURCES).unwrap();
        let text = "diameter_mm = 5\nlength_mm = 6\nremanence_tesla = 1\nsource = \"\"\n";
        let magnet = Node::parse_text(text, "c.toml", Path::new(""), &[]).unwrap().with_log_of(&node);
        let _: MagnetTable = magnet.parse_sourced(&MAGNET_SOURCES).unwrap();
        let rows: Vec<_> = node.log().entries().iter().flat_map(lumenav_core::Resolved::rows).collect();
        assert!(rows.len() > 15, "{}", rows.len());
        for row in rows {
            assert!(row.set || row.source.is_some(), "{} has no source", row.key);
        }
    }
}
