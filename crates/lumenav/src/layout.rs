//! Opening the `[layout]` of a scenario: the sensor as a layout, and the poses at which it is judged.

use lumenav_core::{ConfigError, LayoutModel, Name, Registry, Setup, SimTime};
use lumenav_layout::workspace::{Along, Followed};
use lumenav_layout::{LayoutError, Study, Workspace};
use lumenav_scenario::ScenarioFile;
use lumenav_scenario::engine_world::read_tract;
use nalgebra::{Isometry3, Vector3};

/// A layout to judge or to improve.
pub struct OpenedLayout {
    /// `[layout]`.
    pub study: Study,
    /// The sensor's name.
    pub sensor: Name,
    /// The sensor as a layout.
    pub model: Box<dyn LayoutModel>,
    /// The poses.
    pub workspace: Workspace,
    /// Of a workspace along the scenario's path: when the sensor reads (s), and where the capsule is then. Empty elsewhere.
    pub readings: Vec<(f64, Isometry3<f64>)>,
}

/// Opens the `[layout]` of a scenario; `None` where it has none.
///
/// # Errors
/// [`LayoutError`] with file, line and key.
pub fn open_layout(file: &ScenarioFile, registry: &Registry) -> Result<Option<OpenedLayout>, LayoutError> {
    let Some(node) = file.node.child("layout") else { return Ok(None) };
    let study = Study::from_node(node)?;
    let known: Vec<&str> = file.sensors.iter().map(|s| &*s.name).collect();
    let entry = match (&study.sensor, file.sensors.as_slice()) {
        (None, [only]) => only,
        (None, _) => {
            let message = format!("which sensor? The scenario has: {}", known.join(", "));
            return Err(study.node.error_at("sensor", &message).into());
        }
        (Some(name), sensors) => sensors.iter().find(|s| *s.name == **name).ok_or_else(|| {
            let message = format!("no sensor `{name}`; the scenario has: {}", known.join(", "));
            study.node.error_at("sensor", &message)
        })?,
    };
    let setup = Setup {
        sensor: entry.name.clone(),
        schedule: entry.schedule,
        capsule: file.body,
        capsule_model: file.capsule_model.clone(),
        models: file.models.clone(),
        map: None,
    };
    let model = registry.get(&entry.modality, &entry.node)?.layout(&entry.installed, &study.model, &setup)?;
    let mut readings = Vec::new();
    let workspace = Workspace::from_node(&study.workspace, |table, along| match along {
        Along::Tract => {
            along_tract(file, 1e-3 * table.step_mm.0).map(Followed::Positions).map_err(LayoutError::from)
        }
        Along::Path => {
            if let Some(schedule) = entry.schedule {
                readings = along_path(file, |k| schedule.due(k), "along")?;
            }
            let every_s = table.every_s.0;
            let every = |k: u64| SimTime((1e9 * every_s * k as f64).round() as i64);
            let poses = along_path(file, every, "every_s")?;
            Ok(Followed::Poses(poses.into_iter().map(|(_, pose)| pose).collect()))
        }
    })?;
    Ok(Some(OpenedLayout { sensor: entry.name.clone(), study, model, workspace, readings }))
}

/// Places on the tract's centre line, so many metres apart.
fn along_tract(file: &ScenarioFile, step_m: f64) -> Result<Vec<Vector3<f64>>, ConfigError> {
    let Some(table) = &file.tract else {
        return Err(file
            .node
            .child_or_empty("layout")
            .error("`along = \"tract\"`, but the scenario has no [tract]"));
    };
    let (tract, _) = read_tract(file, table)?;
    let line = &tract.centre_line;
    let steps = (line.length_m() / step_m).floor() as usize;
    Ok((0..=steps).map(|k| line.station(k as f64 * step_m).position_m.coords).collect())
}

/// More poses than this are a typing error.
const MOST_POSES: u64 = 10_000_000;

/// Times (s) and poses of the capsule on its way through the scenario, of the scenario's own seed, at the instants `at` from where it is observed until its end. The
/// design of a sensor knows the way that it is designed for; no estimate is made of it.
fn along_path(
    file: &ScenarioFile,
    at: impl Fn(u64) -> SimTime,
    key: &str,
) -> Result<Vec<(f64, Isometry3<f64>)>, LayoutError> {
    let table = file.node.child_or_empty("layout").child_or_empty("workspace");
    let Some(duration_s) = file.scenario.duration_s else {
        return Err(table.error_at("along", "the scenario has no duration_s, so its path has no end").into());
    };
    let end = SimTime((1e9 * duration_s.0).round() as i64);
    if at(MOST_POSES) <= end {
        return Err(table.error_at(key, &format!("more than {MOST_POSES} poses")).into());
    }
    let failed = |error: lumenav_scenario::ScenarioError| match error {
        lumenav_scenario::ScenarioError::Config(error) => LayoutError::Config(error),
        other => LayoutError::Impossible(format!("the scenario's path: {other}")),
    };
    let mut world = crate::stage(file, file.scenario.seed, 0).map_err(failed)?.world;
    let mut poses = Vec::new();
    let begin = SimTime::from_seconds(file.scenario.observe_from_s.0);
    for now in (0..MOST_POSES).map(at).skip_while(|now| *now < begin).take_while(|now| *now <= end) {
        world.advance_to(now).map_err(failed)?;
        poses.push((now.seconds(), world.truth().capsule(now).world_from_capsule));
        world.forget_before(now);
    }
    Ok(poses)
}
