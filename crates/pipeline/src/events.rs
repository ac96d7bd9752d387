//! What a run tells whoever watches: events in order, nothing kept in memory.
//!
//! Observers (evaluation, recording, files, progress) see the truth; estimators never see an observer.

#![expect(clippy::disallowed_types, reason = "world side: observers evaluate and record the truth")]

use lumenav_core::{
    CapsuleBody, CapsuleTruth, Command, Frame, Measurement, Name, Primitive, PublishedEstimate, Reading,
    SimTime,
};
pub use lumenav_scenario::file::{DistanceTable, ExpectTable, PeriodTable};
use nalgebra::{Isometry3, Vector3};

/// What is known before the first event.
#[derive(Clone, Debug)]
pub struct RunHeader {
    /// Name of the scenario or replay.
    pub scenario: String,
    /// Seed of all random streams.
    pub seed: u64,
    /// Trial number within a Monte Carlo, from 0.
    pub trial: u64,
    /// End of the scenario; `None` in a replay (until the data end).
    pub duration_s: Option<f64>,
    /// When it begins to be observed, s.
    pub observe_from_s: f64,
    /// The tracks in the file's order.
    pub tracks: Vec<TrackHeader>,
    /// The sensors in the file's order.
    pub sensors: Vec<SensorHeader>,
    /// The capsule's shape.
    pub capsule: CapsuleBody,
    /// Whether there is a truth to compare with.
    pub has_truth: bool,
    /// What is known of the motion without a truth.
    pub expect: ExpectTable,
    /// Stretches of the run that are judged by themselves as well.
    pub periods: Vec<PeriodTable>,
    /// The scenario file as it was run, overrides applied.
    pub scenario_toml: String,
}

/// A track before it starts.
#[derive(Clone, Debug)]
pub struct TrackHeader {
    /// Its name.
    pub name: Name,
    /// The sensors it uses.
    pub sensors: Vec<Name>,
    /// `none` (front end alone), `eskf`, …
    pub filter: String,
    /// The front end of each sensor, in the same order.
    pub front_ends: Vec<String>,
}

/// A sensor before it starts.
#[derive(Clone, Debug)]
pub struct SensorHeader {
    /// Its name.
    pub name: Name,
    /// Its modality.
    pub modality: String,
}

/// Whose picture it is: the place in the recording's tree.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SceneOwner {
    /// `/world/<path>`: tract, body, bed.
    World,
    /// `/world/sensors/<sensor>/<path>`.
    Sensor(Name),
    /// `/world/tracks/<track>/<sensor>/<path>`: what a track's front end makes of a sensor's readings.
    Track {
        /// The track.
        track: Name,
        /// The sensor.
        sensor: Name,
    },
}

/// Why a measurement or a reading did not enter a track.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// The chi-square gate: the squared distance, its degrees of freedom and the threshold.
    Gate {
        /// Squared Mahalanobis distance of the innovation.
        chi_square: f64,
        /// Its degrees of freedom.
        degrees_of_freedom: f64,
        /// The gate's threshold.
        threshold: f64,
        /// The largest standardised residuals: channel index and value.
        worst_channels: Vec<(usize, f64)>,
    },
    /// It arrived later than the filter's lag.
    TooLate {
        /// How late, s.
        by_s: f64,
    },
    /// The front end refused the reading.
    FrontEnd {
        /// In words.
        why: String,
    },
    /// The filter has no estimate yet and this measurement cannot start one.
    NotStarted,
    /// Its value contains the prior: it is a track of its own.
    ContainsPrior,
    /// The update could not be computed.
    Failed {
        /// In words.
        why: String,
    },
}

/// How an estimate compares with the truth at its own time stamp.
#[derive(Clone, Debug, PartialEq)]
pub struct UpdateError {
    /// Estimate minus truth in the world, m.
    pub position_world_m: Vector3<f64>,
    /// Angle between estimated and true x axis, rad; `None` where the estimate has no pointing.
    pub heading_rad: Option<f64>,
    /// Full attitude error, rad; `None` where roll is unknown.
    pub attitude_rad: Option<f64>,
    /// Squared error over covariance, over [`Self::nees_degrees_of_freedom`].
    pub nees: Option<f64>,
    /// 3 position, 5 position and pointing, 6 full pose.
    pub nees_degrees_of_freedom: usize,
    /// Estimated minus true arc length along the tract, m.
    pub along_tract_m: Option<f64>,
    /// Trace of the position bound of this measurement alone at the true pose, m².
    pub bound_position_m2: Option<f64>,
}

/// One step of one track.
#[derive(Clone, Debug)]
pub struct TrackUpdate<'a> {
    /// The track.
    pub track: &'a Name,
    /// The sensor whose measurement was used.
    pub sensor: &'a Name,
    /// Counts this track's updates from 0.
    pub update: u64,
    /// The estimate.
    pub estimate: &'a PublishedEstimate,
    /// True where a late measurement changed what was already published for this instant. It is not judged again: the
    /// instant would count twice.
    pub revision: bool,
    /// Normalised innovation squared and its degrees of freedom; `None` for a front end alone or a start.
    pub nis: Option<(f64, f64)>,
    /// Standard deviation of position along its weakest direction, m, and that direction in the world.
    pub weakest: (f64, Vector3<f64>),
    /// True where this update started or restarted the track.
    pub started: bool,
    /// False where the measurement was refused and the estimate is the prediction alone: it is judged like any other, so
    /// that a track cannot look better by refusing what it got wrong.
    pub accepted: bool,
    /// The truth at the estimate's time stamp.
    pub truth: Option<&'a CapsuleTruth>,
    /// The comparison with it.
    pub error: Option<&'a UpdateError>,
    /// Processor time of front end and filter, s. Only `timing.json` may hold it.
    pub compute_s: f64,
}

/// One event of a run.
#[derive(Clone, Debug)]
pub enum RunEvent<'a> {
    /// The truth, at the rate of `[record]`.
    Truth(&'a CapsuleTruth),
    /// A reading arrived, with its labels (world side only).
    Reading {
        /// The reading.
        reading: &'a Reading,
        /// What only evaluation and recording may see.
        labels: Option<&'a Frame>,
    },
    /// A due reading did not come: dropout or fault, with the reason in words.
    Missing {
        /// The sensor.
        sensor: &'a Name,
        /// When it was due.
        at: SimTime,
        /// Why.
        why: &'a str,
    },
    /// A picture.
    Scene {
        /// When.
        at: SimTime,
        /// Whose.
        owner: &'a SceneOwner,
        /// What.
        primitives: &'a [Primitive],
    },
    /// A track moved on.
    Update(&'a TrackUpdate<'a>),
    /// A measurement or a reading was refused.
    Refused {
        /// The track.
        track: &'a Name,
        /// The sensor.
        sensor: &'a Name,
        /// The reading's sequence number.
        sequence: u64,
        /// The instant it is about.
        at: SimTime,
        /// The measurement, where it got that far.
        measurement: Option<&'a Measurement>,
        /// Why.
        why: &'a Refusal,
    },
    /// A controller has decided.
    Command {
        /// The controller.
        controller: &'a Name,
        /// What it moves, and how from now on.
        command: &'a Command,
        /// When.
        at: SimTime,
        /// Where the moved sensor is then, by its encoder.
        world_from_sensor: &'a Isometry3<f64>,
    },
    /// Something happened in the world or to a track: segment entered, fault began, track lost.
    Note {
        /// When.
        at: SimTime,
        /// `world`, `fault`, or the track's name.
        source: &'a str,
        /// In words.
        text: &'a str,
    },
    /// The world has come so far, and nobody looks yet: for progress, about once per simulated second.
    Unobserved {
        /// The simulated time.
        at: SimTime,
    },
    /// The clock moved: for progress, once per simulated second; in a replay at the rate at which availability is judged.
    Clock {
        /// The simulated time.
        at: SimTime,
    },
}

/// Why an observer gave up. A run stops at the first.
#[derive(Debug, thiserror::Error)]
#[error("{what}: {source}")]
pub struct ObserverError {
    /// What could not be done, with the file.
    pub what: String,
    /// Why.
    pub source: Box<dyn std::error::Error + Send + Sync>,
}

impl ObserverError {
    /// An error about a file or another thing an observer writes.
    pub fn new(what: impl Into<String>, source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self { what: what.into(), source: source.into() }
    }
}

/// Watches a run. Memory must not grow with the simulated time (8 bytes per update and track for exact quantiles aside).
pub trait RunObserver {
    /// Before the first event, once.
    ///
    /// # Errors
    /// [`ObserverError`]; the run then does not start.
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError>;

    /// One event.
    ///
    /// # Errors
    /// [`ObserverError`]; the run then stops.
    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError>;

    /// After the last event. Files appear whole here, or not at all.
    ///
    /// # Errors
    /// [`ObserverError`].
    fn finish(&mut self) -> Result<(), ObserverError>;
}
