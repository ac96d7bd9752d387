//! Ultrasonic beacons: a modality outside the lumenav tree.
//!
//! Beacons on the body send pulses, a receiver in the capsule notes when each arrives. Position is observable from four
//! beacons on, attitude is not. Speed of sound differs between patients by a few per cent; the filter estimates it.

pub mod front_end;
pub mod model;
pub mod physics;
pub mod sensor;

use front_end::BeaconFrontEnd;
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::{Estimator, Modality, ModalityError, Node, Schema, Sensor, Setup};
use model::BeaconModel;
use nalgebra::Vector3;
use sensor::BeaconSensor;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// `[sensor.installed]`: what both sides know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstalledTable {
    /// Beacons in the world, mm.
    pub beacons_world_mm: Vec<[Finite; 3]>,
    /// Standard deviation of a time of flight, µs. 1 µs is 1.5 mm: a cycle of a 1 MHz pulse.
    pub sigma_us: Positive,
}

/// `[sensor.reality]`: what the world does beyond that, and the estimator is not told.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealityTable {
    /// True speed of sound over the mean of soft tissue, minus 1.
    pub speed_ratio: Finite,
}

/// `[track.sensor.<name>]`: what the estimator may choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OptionsTable {
    /// How far the speed of sound may be from the mean of soft tissue (one standard deviation, share). Default 0.02: between
    /// muscle and fat lies 7 %, and a path crosses both.
    pub speed_ratio_sigma: Positive,
}

impl Default for OptionsTable {
    fn default() -> Self {
        Self { speed_ratio_sigma: Positive(0.02) }
    }
}

/// The beacons as installed, in SI units.
#[derive(Clone, Debug)]
pub struct Installed {
    /// Places in the world, m.
    pub beacons_world_m: Vec<Vector3<f64>>,
    /// Standard deviation of a time of flight, s.
    pub sigma_s: f64,
    /// One channel per beacon.
    pub schema: Arc<Schema>,
}

impl Installed {
    /// From the user's table.
    ///
    /// # Errors
    /// [`ModalityError`] with file, line and key.
    pub fn from_node(node: &Node) -> Result<Self, ModalityError> {
        let table: InstalledTable = node.parse()?;
        if table.beacons_world_mm.is_empty() {
            return Err(node.error_at("beacons_world_mm", "at least one beacon is needed").into());
        }
        let labels = (0..table.beacons_world_mm.len()).map(|i| format!("beacon{i}_s")).collect();
        Ok(Self {
            beacons_world_m: table
                .beacons_world_mm
                .iter()
                .map(|b| Vector3::from(b.map(|v| v.0 * 1e-3)))
                .collect(),
            sigma_s: table.sigma_us.0 * 1e-6,
            schema: Schema::channels("beacons/1", "time_of_flight_s", labels),
        })
    }
}

/// The plugin.
#[derive(Clone, Copy, Debug, Default)]
pub struct Beacons;

impl Modality for Beacons {
    fn kind(&self) -> &'static str {
        "beacons"
    }

    fn about(&self) -> &'static str {
        "ultrasonic beacons around the body, a receiver in the capsule (position)"
    }

    fn front_ends(&self) -> &'static [&'static str] {
        &["time-of-flight"]
    }

    fn sensor(
        &self,
        installed: &Node,
        reality: &Node,
        setup: &Setup,
    ) -> Result<Box<dyn Sensor>, ModalityError> {
        let opened = Installed::from_node(installed)?;
        let table: RealityTable = reality.parse()?;
        if table.speed_ratio.0 <= -1.0 {
            return Err(reality
                .error_at("speed_ratio", "no sound travels at -1 or below; allowed: above -1")
                .into());
        }
        let Some(schedule) = setup.schedule else {
            return Err(installed.error("a simulated sensor needs a [sensor.schedule]").into());
        };
        Ok(Box::new(BeaconSensor::new(setup.sensor.clone(), opened, table.speed_ratio.0, schedule)))
    }

    fn estimator(&self, installed: &Node, options: &Node, setup: &Setup) -> Result<Estimator, ModalityError> {
        let opened = Installed::from_node(installed)?;
        let table: OptionsTable = options.parse()?;
        let model = BeaconModel::new(&setup.sensor, opened, table.speed_ratio_sigma.0);
        Ok(Estimator::of_front_end(BeaconFrontEnd::new(model)))
    }
}
