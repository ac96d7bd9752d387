//! The world side of a plugin: a sensor looks at the truth and hands over a reading.

#![expect(clippy::disallowed_types, reason = "world side: a sensor observes the truth")]

use crate::frame::{Frame, Reading};
use crate::modality::ModalityError;
use crate::primitive::Primitive;
use crate::random::RandomStreams;
use crate::time::SimTime;
use crate::truth::TruthView;
use nalgebra::{Isometry3, Vector6};

/// What the world hands over: the reading, and beside it what only evaluation and recording may see.
#[derive(Clone, Debug)]
pub struct Observation {
    /// What the estimator gets.
    pub reading: Reading,
    /// Which marker a line came from, which channel was disturbed; never reaches an estimator.
    pub labels: Option<Frame>,
}

/// A simulated sensor.
pub trait Sensor: Send {
    /// The next instant at which it wants to be asked. The pipeline merges these and stops the engine there.
    fn next_due(&self) -> SimTime;

    /// Nobody looks before `at`: makes [`Sensor::next_due`] the first of its instants whose whole interval lies from there on, with the
    /// sequence number, and so the random numbers, that it has in a run that is watched from the start. Called once, before the first
    /// [`Sensor::observe`].
    fn skip_to(&mut self, at: SimTime);

    /// How far back of that instant it looks, in nanoseconds (an exposure, a 50 ms window). The pipeline keeps that
    /// much truth and no more.
    fn look_back_ns(&self) -> i64 {
        0
    }

    /// Looks at the truth at `at` and advances [`Sensor::next_due`]. `None`: nothing was read (a dropout, no coincidence).
    /// Every random number comes from a stream of `random` named by purpose and the reading's sequence.
    ///
    /// # Errors
    /// [`ModalityError`] where the reading cannot be formed.
    fn observe(
        &mut self,
        truth: &dyn TruthView,
        at: SimTime,
        random: &RandomStreams,
    ) -> Result<Option<Observation>, ModalityError>;

    /// Is moved from `at` on: its own frame flies with this twist (m/s, rad/s) in the world. Asked in the order of time.
    ///
    /// # Errors
    /// [`ModalityError::Immovable`] where it cannot be moved at all, [`ModalityError::Unsupported`] where not so.
    fn command(&mut self, _at: SimTime, _twist_world: &Vector6<f64>) -> Result<(), ModalityError> {
        Err(ModalityError::Immovable)
    }

    /// `world_from_sensor` as its encoders tell it at an instant after the last command; `None` where it cannot be moved.
    fn encoder(&self, _at: SimTime) -> Option<Isometry3<f64>> {
        None
    }

    /// What of the sensor itself is worth drawing (positions, field arrows, lines of the last window).
    fn scene(&self, _out: &mut Vec<Primitive>) {}
}
