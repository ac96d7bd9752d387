//! Tests of the magnetic plugin, one binary; one module per promise.

#![allow(clippy::disallowed_types, reason = "world side: tests hold the truth that they compare with")]

mod magnetic {
    /// Array and capsule files: what is built, and what is refused where.
    mod files;
    /// The front end: honest or silent.
    mod front_end;
    /// The laws of the seam.
    mod laws;
    /// What is unknown beside the pose.
    mod nuisance;
    /// Recorded data.
    mod reader;
    /// The simulated array.
    mod sensor;
    /// Maximum likelihood: right basin, efficient.
    mod solver;
    mod support;
    /// Arrays on a patient who moves, and arrays of the room.
    mod worn;
}
