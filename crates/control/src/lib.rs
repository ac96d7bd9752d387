//! Closed-loop actuation: controllers see what a track has published and what encoders tell, never the truth.
//!
//! A controller implements [`Controller`]; [`CONTROLLERS`] are those that a scenario can ask for by name in
//! `[controller.law]`. There is one: [`bed`] keeps the capsule near the middle of a scanner.

pub mod bed;

pub use bed::Bed;

use lumenav_core::{ConfigError, Controller, Name, Node};

/// Builds a controller of one kind from its `[controller.law]`, for the sensor that it moves and its decisions per second.
type Builder = fn(&Node, &Name, f64) -> Result<Box<dyn Controller>, ConfigError>;

/// One kind of controller.
#[derive(Clone, Copy, Debug)]
pub struct ControllerKind {
    /// The name in scenario files.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    build: Builder,
}

/// All kinds.
pub const CONTROLLERS: [ControllerKind; 1] = [ControllerKind {
    name: "bed",
    about: "moves the patient along a scanner's axis so that the capsule stays near the middle of its field of view",
    build: |law, sensor, rate_hz| Ok(Box::new(Bed::from_node(law, sensor.clone(), rate_hz)?)),
}];

/// The controller that a `[controller.law]` asks for, which decides `rate_hz` times a second.
///
/// # Errors
/// [`ConfigError`] with file, line, key and the kinds there are.
pub fn build(law: &Node, sensor: &Name, rate_hz: f64) -> Result<Box<dyn Controller>, ConfigError> {
    let known = || CONTROLLERS.map(|kind| kind.name).join(", ");
    let table = law.to_toml().unwrap_or_default();
    let Some(asked) = table.get("kind").and_then(|kind| kind.as_str()) else {
        return Err(law.error_at("kind", &format!("expected a name in quotes; allowed: {}", known())));
    };
    let Some(kind) = CONTROLLERS.iter().find(|kind| kind.name == asked) else {
        return Err(law.error_at("kind", &format!("unknown controller `{asked}`; allowed: {}", known())));
    };
    (kind.build)(&law.without("kind"), sensor, rate_hz)
}
