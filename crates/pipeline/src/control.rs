//! Controllers of a run: each sees the estimates of one track and the encoder of the sensor that it moves.

use crate::build::NamedSensor;
use crate::error::RunError;
use crate::events::RunEvent;
use crate::run::Observers;
use crate::track::Track;
use lumenav_core::time::nanoseconds;
use lumenav_core::{Controller, Name, SimTime};
use lumenav_scenario::ScenarioFile;
use nalgebra::Vector6;
use std::collections::BTreeMap;

/// One controller under way.
pub(crate) struct Control {
    name: Name,
    controller: Box<dyn Controller>,
    track: Name,
    sensor: Name,
    /// Time between two decisions.
    pub(crate) period_ns: i64,
}

/// The controllers of a scenario; each sensor that one moves is told to stand still, and refuses where it cannot be moved.
///
/// # Errors
/// [`RunError`] with file, line and key.
pub(crate) fn controls(file: &ScenarioFile, sensors: &mut [NamedSensor]) -> Result<Vec<Control>, RunError> {
    let mut controls = Vec::new();
    for entry in &file.controllers {
        let controller = lumenav_control::build(&entry.law, &entry.sensor, entry.rate_hz)?;
        let moved = sensors.iter_mut().find(|(name, _)| *name == entry.sensor);
        if let Some(Err(error)) = moved.map(|(_, sensor)| sensor.command(SimTime::ZERO, &Vector6::zeros())) {
            let message = format!("`{}` cannot be moved: {error}", entry.sensor);
            return Err(entry.node.error_at("sensor", &message).into());
        }
        controls.push(Control {
            name: entry.name.clone(),
            controller,
            track: entry.track.clone(),
            sensor: entry.sensor.clone(),
            period_ns: nanoseconds(1.0 / entry.rate_hz).max(1),
        });
    }
    Ok(controls)
}

impl Control {
    /// Decides at an instant, and moves.
    pub(crate) fn step(
        &mut self,
        at: SimTime,
        tracks: &[Track],
        sensors: &mut [NamedSensor],
        observers: &mut Observers<'_>,
    ) -> Result<(), RunError> {
        let last = tracks.iter().find(|track| track.name == self.track).and_then(Track::latest);
        let Some((_, sensor)) = sensors.iter_mut().find(|(name, _)| *name == self.sensor) else {
            return Ok(());
        };
        let Some(world_from_sensor) = sensor.encoder(at) else { return Ok(()) };
        let known = BTreeMap::from([(self.sensor.to_string(), world_from_sensor)]);
        for command in self.controller.step(at, last, &known).iter().filter(|c| c.actuator == self.sensor) {
            sensor.command(at, &command.twist_world).map_err(|source| RunError::Sensor {
                sensor: self.sensor.to_string(),
                at,
                source,
            })?;
            let controller = &self.name;
            observers.tell(&RunEvent::Command {
                controller,
                command,
                at,
                world_from_sensor: &world_from_sensor,
            })?;
        }
        Ok(())
    }
}
