//! One run, end to end: the world is stepped, sensors look at it, front ends and filters follow, observers watch.

pub mod events;

pub use events::{
    ObserverError, Refusal, RunEvent, RunHeader, RunObserver, SceneOwner, SensorHeader, TrackHeader, TrackUpdate,
    UpdateError,
};
