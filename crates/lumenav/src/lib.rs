//! lumenav: where is a swallowed capsule endoscope, and what must we build to know it to a millimetre?
//!
//! This crate is the door to the library: it re-exports the others and ties them together. A run from a program of your own:
//!
//! ```no_run
//! use lumenav::pipeline::{Observers, simulate};
//! use lumenav::{default_registry, open_scenario, stage};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let file = open_scenario("scenarios/helix-magnetic.toml".as_ref(), &[], None)?;
//! let seed = file.scenario.seed;
//! let world = stage(&file, seed, 0)?;
//! let summary = simulate(&file, &default_registry(), seed, 0, world, &mut Observers::new(vec![]), &|| false)?;
//! println!("{} readings", summary.readings);
//! # Ok(())
//! # }
//! ```
//!
//! Observers ([`pipeline::RunObserver`]) watch the run: feature `report` writes files, feature `recording` writes `.rrd`.
//! Feature `reproduce` runs published tables again and draws charts.

pub use lumenav_anatomy as anatomy;
pub use lumenav_control as control;
pub use lumenav_core as core;
pub use lumenav_evaluation as evaluation;
pub use lumenav_fields as fields;
#[cfg(feature = "reproduce")]
pub use lumenav_figures as figures;
pub use lumenav_fusion as fusion;
pub use lumenav_layout as layouts;
pub use lumenav_magnetic as magnetic;
pub use lumenav_pet as pet;
pub use lumenav_pipeline as pipeline;
#[cfg(feature = "recording")]
pub use lumenav_recording as recording;
pub use lumenav_records as records;
#[cfg(feature = "report")]
pub use lumenav_report as report;
#[cfg(feature = "reproduce")]
pub use lumenav_reproduce as reproduce;
pub use lumenav_scenario as scenario;

mod layout;
mod replay;

pub use layout::{OpenedLayout, open_layout};
pub use replay::{ReferenceTrajectory, TruthFileTable, open_replay};

use lumenav_core::{ModelFolder, Node, Registry};
use lumenav_layout::LayoutError;
use lumenav_pipeline::Stage;
use lumenav_scenario::{ScenarioError, ScenarioFile};
use std::path::{Path, PathBuf};

/// The version of lumenav.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// All modalities that lumenav ships. A program of your own adds its plugin with [`Registry::with`].
pub fn default_registry() -> Registry {
    Registry::new().with(lumenav_magnetic::Magnetic).with(lumenav_pet::Pet::default())
}

/// The models folder: as given, else `LUMENAV_MODELS`, else the nearest `models` beside or above `file`, else `models` in the
/// working folder.
pub fn models_folder(given: Option<&Path>, file: &Path) -> ModelFolder {
    if let Some(given) = given {
        return ModelFolder::new(given);
    }
    if let Some(set) = std::env::var_os("LUMENAV_MODELS") {
        return ModelFolder::new(PathBuf::from(set));
    }
    let start = std::path::absolute(file).unwrap_or_else(|_| file.to_path_buf());
    let found = start.ancestors().skip(1).map(|folder| folder.join("models")).find(|m| m.is_dir());
    // Named as a person would name it: relative to the working folder where it lies below.
    let shorten = |path: PathBuf| {
        let here = std::env::current_dir().ok();
        here.and_then(|h| path.strip_prefix(h).ok().map(Path::to_path_buf)).unwrap_or(path)
    };
    ModelFolder::new(found.map_or_else(|| PathBuf::from("models"), shorten))
}

/// Opens a scenario with `key=value` overrides.
///
/// # Errors
/// [`ScenarioError`] with file, line, key and what is allowed.
pub fn open_scenario(
    path: &Path,
    overrides: &[String],
    models: Option<&Path>,
) -> Result<ScenarioFile, ScenarioError> {
    let node = Node::open_with(path, overrides)?;
    ScenarioFile::from_node(node, models_folder(models, path))
}

/// Builds the world of a scenario.
///
/// # Errors
/// [`ScenarioError`] with file, line, key and what is allowed.
pub fn stage(file: &ScenarioFile, seed: u64, trial: u64) -> Result<Stage, ScenarioError> {
    let built = lumenav_scenario::build_world(file, seed, trial)?;
    Ok(Stage { world: built.world, map: built.map, checkpoints: None })
}

/// Checks a scenario as far as it can be checked without running it: every table, every model it names.
///
/// # Errors
/// The first [`lumenav_pipeline::RunError`].
pub fn check(file: &ScenarioFile, registry: &Registry) -> Result<(), lumenav_pipeline::RunError> {
    let stage = stage(file, file.scenario.seed, 0)?;
    let mut sensors = lumenav_pipeline::build::sensors(file, registry, stage.map.as_ref())?;
    lumenav_pipeline::build::tracks(file, registry, stage.map.as_ref())?;
    lumenav_pipeline::build::check_controllers(file, &mut sensors)?;
    match open_layout(file, registry) {
        Err(LayoutError::Config(error)) => Err((*error).into()),
        Err(LayoutError::Modality(error)) => Err(error.into()),
        // What can only be found by searching is not searched for here.
        Ok(_)
        | Err(
            LayoutError::Dependent
            | LayoutError::Impossible(_)
            | LayoutError::Interrupted
            | LayoutError::Stopped,
        ) => Ok(()),
    }
}
