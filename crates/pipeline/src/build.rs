//! From a scenario file to running parts: sensors, tracks, header. World and estimator are built by different calls.

use crate::error::RunError;
use crate::events::{RunHeader, SensorHeader, TrackHeader};
use crate::track::{Input, Track, blocks};
use lumenav_core::{Modality, Name, PathMap, Registry, Sensor, Setup, SimTime};
use lumenav_fusion::FilterSetup;
use lumenav_scenario::{ScenarioFile, SensorEntry};
use std::sync::Arc;

/// What a plugin is told about a sensor.
fn setup(file: &ScenarioFile, entry: &SensorEntry, map: Option<&Arc<dyn PathMap>>) -> Setup {
    Setup {
        sensor: entry.name.clone(),
        schedule: entry.schedule,
        capsule: file.body,
        capsule_model: file.capsule_model.clone(),
        models: file.models.clone(),
        map: map.cloned(),
    }
}

fn modality<'r>(registry: &'r Registry, entry: &SensorEntry) -> Result<&'r Arc<dyn Modality>, RunError> {
    Ok(registry.get(&entry.modality, &entry.node)?)
}

/// A simulated sensor with its name.
pub type NamedSensor = (Name, Box<dyn Sensor>);

/// The simulated sensors of a scenario.
///
/// # Errors
/// [`RunError`] with file, line and key.
pub fn sensors(
    file: &ScenarioFile,
    registry: &Registry,
    map: Option<&Arc<dyn PathMap>>,
) -> Result<Vec<NamedSensor>, RunError> {
    file.sensors
        .iter()
        .map(|entry| {
            if !entry.files.keys().is_empty() {
                let message =
                    "recorded data belong into a replay (lumenav replay), not into a simulated scenario";
                return Err(entry.files.error(message).into());
            }
            let setup = setup(file, entry, map);
            let sensor = modality(registry, entry)?.sensor(&entry.installed, &entry.reality, &setup)?;
            Ok((entry.name.clone(), sensor))
        })
        .collect()
}

/// The recorded data of a replay, one stream per sensor.
///
/// # Errors
/// [`RunError`] with file, line and key.
pub fn readers(
    file: &ScenarioFile,
    registry: &Registry,
) -> Result<Vec<(Name, lumenav_core::ReadingStream)>, RunError> {
    if let Some(controller) = file.controllers.first() {
        return Err(controller
            .node
            .error("a replay has no controllers: what was recorded does not move")
            .into());
    }
    file.sensors
        .iter()
        .map(|entry| {
            if !entry.reality.keys().is_empty() {
                return Err(entry.reality.error("a replay has no `reality`: the data are real").into());
            }
            let setup = setup(file, entry, None);
            let stream = modality(registry, entry)?.reader(&entry.installed, &entry.files, &setup)?;
            Ok((entry.name.clone(), stream))
        })
        .collect()
}

/// Checks the controllers of a scenario, and that what they move can be moved.
///
/// # Errors
/// [`RunError`] with file, line and key.
pub fn check_controllers(file: &ScenarioFile, sensors: &mut [NamedSensor]) -> Result<(), RunError> {
    crate::control::controls(file, sensors).map(drop)
}

/// The tracks of a scenario, each with front ends of its own.
///
/// # Errors
/// [`RunError`] with file, line and key.
pub fn tracks(
    file: &ScenarioFile,
    registry: &Registry,
    map: Option<&Arc<dyn PathMap>>,
) -> Result<Vec<Track>, RunError> {
    let mut tracks = Vec::new();
    for track in &file.tracks {
        let mut inputs = Vec::new();
        for (name, options) in track.sensors.iter().zip(&track.options) {
            // The file's reader has checked that every sensor of a track exists.
            let Some(entry) = file.sensors.iter().find(|s| s.name == *name) else { continue };
            let setup = setup(file, entry, map);
            let estimator = modality(registry, entry)?.estimator(&entry.installed, options, &setup)?;
            inputs.push(Input {
                sensor: name.clone(),
                front_end: estimator.front_end,
                motion_input: estimator.motion_input,
                taken: None,
            });
        }
        let setup = FilterSetup {
            blocks: blocks(&inputs),
            prior: track.prior.as_ref(),
            begins: SimTime::from_seconds(file.scenario.observe_from_s.0),
            map: map.cloned(),
        };
        let filter = lumenav_fusion::build(&track.filter, &setup)?;
        tracks.push(Track::new(track.name.clone(), inputs, filter, &track.node)?);
    }
    Ok(tracks)
}

/// What observers are told before the first event.
///
/// # Errors
/// [`RunError`] where a filter table is wrong.
pub fn header(file: &ScenarioFile, seed: u64, trial: u64, has_truth: bool) -> Result<RunHeader, RunError> {
    let mut tracks = Vec::new();
    for track in &file.tracks {
        let filter = lumenav_fusion::kind_of(&track.filter)?.name;
        let front_end = |node: &lumenav_core::Node| {
            let table = node.to_toml().unwrap_or_default();
            table.get("front_end").and_then(|v| v.as_str()).unwrap_or("default").to_owned()
        };
        tracks.push(TrackHeader {
            name: track.name.clone(),
            sensors: track.sensors.clone(),
            filter: filter.to_owned(),
            front_ends: track.options.iter().map(front_end).collect(),
        });
    }
    let sensor_header = |s: &SensorEntry| SensorHeader { name: s.name.clone(), modality: s.modality.clone() };
    Ok(RunHeader {
        scenario: file.scenario.name.clone(),
        seed,
        trial,
        duration_s: file.scenario.duration_s.map(|d| d.0),
        observe_from_s: file.scenario.observe_from_s.0,
        tracks,
        sensors: file.sensors.iter().map(sensor_header).collect(),
        capsule: file.body,
        has_truth,
        expect: file.expect.clone(),
        periods: file.periods.clone(),
        scenario_toml: file.node.to_toml().map(|t| t.to_string()).unwrap_or_default(),
    })
}
