//! Opening the `[layout]` of a scenario: the sensor as a layout, and the poses at which it is judged.

use lumenav_core::{ConfigError, LayoutModel, Name, Registry, Setup};
use lumenav_layout::workspace::Along;
use lumenav_layout::{LayoutError, Study, Workspace};
use lumenav_scenario::ScenarioFile;
use lumenav_scenario::engine_world::read_tract;
use nalgebra::Vector3;

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
    let workspace = Workspace::from_node(&study.workspace, |Along::Tract, step_m| {
        along_tract(file, step_m).map_err(LayoutError::from)
    })?;
    Ok(Some(OpenedLayout { sensor: entry.name.clone(), study, model, workspace }))
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
