//! The seam of lumenav: what crosses between the world, the estimators and whoever watches.
//!
//! One scenario is sensed by several *modalities* (magnetometers, PET markers, radio, camera, inertia). Each is a
//! plugin that depends on this crate alone. This crate therefore holds only what two plugins, or a plugin and the
//! framework, must agree on:
//!
//! - time ([`SimTime`]), poses and the one error convention ([`pose`]),
//! - what a sensor hands over ([`Reading`], a [`Frame`] of columns) and what truth looks like ([`TruthView`]),
//! - what an estimator makes of it ([`Measurement`], [`MeasurementModel`], [`Linearization`], [`StateView`]),
//! - the traits a plugin implements ([`Modality`], [`Sensor`], [`FrontEnd`]) and the [`Registry`] that finds it,
//! - what a layout of a sensor would say before it is built ([`LayoutModel`]), and work cut into jobs ([`Executor`]),
//! - named random streams ([`RandomStreams`]), configuration that knows file and line ([`Node`]),
//! - what a plugin draws ([`Primitive`]) and the [`laws`] every plugin is tested against.
//!
//! **Error state**, everywhere: `[δp_world (m), δθ_capsule (rad), δv_world (m/s), δω_capsule (rad/s), blocks…]`,
//! right perturbation on SO(3) x R³: `p ← p + δp`, `R ← R·Exp(δθ)`.

pub mod config;
pub mod control;
pub mod fix;
pub mod frame;
pub mod front_end;
pub mod jobs;
pub mod laws;
pub mod layout;
pub mod linear;
pub mod measurement;
pub mod modality;
pub mod motion;
pub mod path_map;
pub mod pose;
pub mod primitive;
pub mod random;
pub mod schedule;
pub mod sensor;
pub mod setup;
pub mod state;
pub mod time;
pub mod truth;
pub mod units;

pub use config::{ConfigError, Node, Resolved, ResolvedLog, ResolvedRow};
pub use control::{Command, Controller, PublishedEstimate};
pub use fix::{FixKind, MotionEstimate, PoseEstimate};
pub use frame::{Column, ColumnSpec, Frame, FrameError, Reading, Rows, Schema};
pub use front_end::{Estimator, FrontEnd, MotionInput, MotionSample, Outcome, PosePrior};
pub use jobs::{Executor, OneAfterAnother};
pub use layout::{LayoutElement, LayoutModel, LayoutParameters, LayoutWorker};
pub use measurement::{
    BlockSpec, Instant, Linearization, Measurement, MeasurementModel, Noise, Part, PriorUse, StateView,
};
pub use modality::{Modality, ModalityError, ReadingStream, Recorded, Registry};
pub use motion::{AxisStep, MotionModel};
pub use path_map::{PathMap, PathProjection};
pub use primitive::Primitive;
pub use random::{RandomStream, RandomStreams};
pub use schedule::Schedule;
#[expect(clippy::disallowed_types, reason = "this crate defines what only the world side may name")]
pub use sensor::Observation;
pub use sensor::Sensor;
pub use setup::{CapsuleBody, ModelFolder, Setup};
pub use state::NominalState;
pub use time::SimTime;
#[expect(clippy::disallowed_types, reason = "this crate defines what only the world side may name")]
pub use truth::{CapsuleTruth, TruthView};

/// A short shared name: of a sensor, a track, a state block.
pub type Name = std::sync::Arc<str>;
