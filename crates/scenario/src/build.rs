//! From a scenario file to its world.

use crate::engine_world::{self, EngineWorld};
use crate::error::ScenarioError;
use crate::file::ScenarioFile;
use crate::kinematic::{self, TruthTable};
use crate::patient::Patient;
use crate::world::World;
use lumenav_core::{PathMap, RandomStreams};
use std::sync::Arc;

/// A world and what evaluation knows of its map.
pub struct BuiltWorld {
    /// The world.
    pub world: Box<dyn World>,
    /// The tract as a map, where there is one.
    pub map: Option<Arc<dyn PathMap>>,
}

/// Builds the world: kinematic where the file has a `[truth]`, else the engine in its `[tract]`.
///
/// # Errors
/// [`ScenarioError`] with file, line, key and what is allowed.
pub fn build_world(file: &ScenarioFile, seed: u64, trial: u64) -> Result<BuiltWorld, ScenarioError> {
    let node = &file.node;
    let patient = Patient::of_file(node)?;
    if let Some(truth) = node.child("truth") {
        if let Some(key) = ["tract", "motility", "engine"].into_iter().find(|key| node.child(key).is_some()) {
            let message = "kinematic truth ([truth]) and an engine in a tract exclude each other";
            return Err(node.error_at(key, message).into());
        }
        let table: TruthTable = truth.parse()?;
        let streams = RandomStreams::new(seed, trial, kinematic::COMPONENT);
        let scenario = (&node.child_or_empty("scenario"), file.scenario.duration_s.map(|d| d.0));
        let world = kinematic::build(&table, &truth, scenario, patient, &streams)?;
        return Ok(BuiltWorld { world, map: None });
    }
    if let Some(table) = &file.tract {
        let streams = RandomStreams::new(seed, trial, engine_world::COMPONENT);
        let (world, tract) = EngineWorld::new(file, table, patient, &streams)?;
        return Ok(BuiltWorld { world: Box::new(world), map: Some(tract) });
    }
    let message = "the scenario has neither a [truth] (kinematic) nor a [tract] (engine)";
    Err(node.error(message).into())
}
