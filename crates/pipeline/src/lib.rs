//! One run, end to end: the world is stepped, sensors look at it, front ends and filters follow, observers watch.
//!
//! [`events`] is what observers see; [`run`] the event loop, for simulated and for recorded data; [`track`] one estimator with
//! its front ends; [`faults`] what befalls readings on their way; [`judge`] the comparison with truth and bound; [`Checkpoints`] states of a
//! world that are kept.

mod ahead;
pub mod build;
mod checkpoints;
mod control;
pub mod error;
pub mod events;
pub mod faults;
pub mod judge;
pub mod run;
pub mod track;

pub use checkpoints::Checkpoints;
pub use error::RunError;
pub use events::{
    ObserverError, Refusal, RunEvent, RunHeader, RunObserver, SceneOwner, SensorHeader, TrackHeader,
    TrackUpdate, UpdateError,
};
pub use run::{Observers, RunSummary, Stage, StopRequest, TruthAt, replay, simulate};
