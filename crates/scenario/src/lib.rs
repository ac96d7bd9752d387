//! Scenarios: the file that says what happens, and the worlds that make it true.
//!
//! [`mod@file`] reads a scenario strictly. A [`World`] is stepped and asked for the truth: [`kinematic`] worlds
//! follow a path, a recording or a motion model; the [`engine`] moves a capsule through a living tract by forces. The [`patient`] around
//! either breathes, turns, coughs, walks and is moved.

mod build;
pub mod diverticula;
pub mod engine;
pub mod engine_world;
pub mod error;
pub mod file;
pub mod kinematic;
pub mod loose;
pub mod obstacles;
pub mod path;
pub mod patient;
mod places;
mod wave_notes;
pub mod world;

pub use build::{BuiltWorld, build_world};
pub use error::ScenarioError;
pub use file::{Fault, RecordTable, ScenarioFile, SensorEntry, TrackEntry};
pub use world::{TruthHistory, World, WorldNote};
