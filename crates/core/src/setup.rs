//! What the framework hands every plugin when it is built: the sensor's name, the capsule, the models folder.

use crate::Name;
use crate::config::{ConfigError, Node};
use crate::path_map::PathMap;
use crate::schedule::Schedule;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where models are found.
///
/// A bare name (`belt-16`) is `<models>/<kind>/belt-16.toml`; anything with a slash or an ending of `.toml` is a path
/// relative to the file that names it.
#[derive(Clone, Debug)]
pub struct ModelFolder {
    root: PathBuf,
}

impl ModelFolder {
    /// The folder that holds `tracts`, `capsules`, `sensor-arrays`, …
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The path of a model as a file of the user's names it.
    pub fn resolve(&self, kind: &str, name: &str, named_in: &Path) -> PathBuf {
        let is_path = name.contains('/') || name.contains('\\') || Path::new(name).extension().is_some();
        if is_path { named_in.join(name) } else { self.root.join(kind).join(format!("{name}.toml")) }
    }

    /// Opens the model that `node.key` names.
    ///
    /// # Errors
    /// [`ConfigError`] at that key: no such model (with those there are), or a file that is not TOML.
    pub fn open(&self, kind: &str, name: &str, node: &Node, key: &str) -> Result<Node, ConfigError> {
        let path = self.resolve(kind, name, node.folder_of(key));
        if !path.is_file() {
            let known = self.list(kind).join(", ");
            let known = if known.is_empty() { "none".to_owned() } else { known };
            return Err(node.error_at(
                key,
                &format!(
                    "no model `{name}` ({} does not exist); models/{kind} has: {known}; a path with `/` or `.toml` is read from beside \
                     this file, another folder of models is told with --models",
                    path.display()
                ),
            ));
        }
        Node::open(&path).map(|opened| opened.with_log_of(node))
    }

    /// Names of the models of a kind, sorted.
    pub fn list(&self, kind: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.root.join(kind)) else { return Vec::new() };
        let mut names: Vec<String> = entries
            .filter_map(Result::ok)
            .map(|entry| entry.path())
            .filter(|path| path.extension().is_some_and(|e| e == "toml"))
            .filter_map(|path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned()))
            .collect();
        names.sort();
        names
    }
}

/// Shape and mass of the capsule, from its model file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapsuleBody {
    /// Outer radius, m.
    pub radius_m: f64,
    /// Overall length, m.
    pub length_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
}

/// What a plugin is told when it is built. Both sides get the same.
#[derive(Clone)]
pub struct Setup {
    /// The sensor's name in the scenario.
    pub sensor: Name,
    /// When the sensor reads; recorded data carry their own times.
    pub schedule: Option<Schedule>,
    /// The capsule's shape.
    pub capsule: CapsuleBody,
    /// The capsule's model file, in which a modality finds its own table (`[magnet]`, `[[marker]]`).
    pub capsule_model: Node,
    /// Where models are found.
    pub models: ModelFolder,
    /// The tract as a map, where the scenario has one and estimators may know it.
    pub map: Option<Arc<dyn PathMap>>,
}
