//! What every filter does, whatever it is inside, and the names by which a scenario asks for one.
//!
//! A new filter is a folder beside `eskf` and a line in [`FILTERS`]; whoever drives filters knows the trait alone.

use crate::eskf;
use crate::update::Innovation;
use lumenav_core::{
    BlockSpec, ConfigError, Measurement, MotionInput, Name, Node, PathMap, PosePrior, PublishedEstimate,
    Reading, SimTime,
};
use std::sync::Arc;

/// A filter of one track: it takes measurements in any order of arrival and answers with a belief.
pub trait Filter: Send {
    /// A measurement. It is put in its place in time and the belief follows.
    fn offer(&mut self, measurement: Measurement) -> Offered;

    /// An inertial reading that drives the prediction; why it does not, where it does not.
    fn offer_motion(&mut self, reading: Reading, input: Arc<dyn MotionInput>) -> Option<Refused>;

    /// Tells which instants a sensor's front end wants clones of from now on. One older than the lag cannot be had any more; a
    /// measurement that refers to it will be refused.
    fn want_clones(&mut self, sensor: &Name, instants: Vec<SimTime>);

    /// The prediction at an instant, for a front end's start point: all that is known up to that instant and nothing after it,
    /// so that a late reading is treated as one in order. `None` where there is no belief, it is too vague to start from, or
    /// the instant is older than the lag.
    fn predicted_pose(&self, at: SimTime) -> Option<PosePrior>;

    /// The same as an estimate to publish, however vague: what a started filter says where a reading was refused. It leaves
    /// no trace in the filter.
    fn predicted_estimate(&self, at: SimTime) -> Option<PublishedEstimate>;

    /// What became of later instants because of something that arrived late, since this was asked last; in order. A filter that
    /// never goes back has nothing to say.
    fn take_hindsight(&mut self) -> Vec<Hindsight> {
        Vec::new()
    }

    /// The estimate at the belief's own time; `None` before the start and after a loss.
    fn estimate(&self) -> Option<PublishedEstimate>;

    /// Counters since the start of the run.
    fn counters(&self) -> &Counters;
}

/// How often what happened, since the start of the run. Measurements are counted once, by the answer they were given; starts and
/// losses as the past is seen now, which what arrives late may change (see [`Hindsight`]).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Measurements that entered the belief.
    pub accepted: u64,
    /// Measurements beyond the chi-square gate.
    pub gated: u64,
    /// Measurements and motion readings older than the lag.
    pub too_late: u64,
    /// Measurements that came before there was a belief and could not start one.
    pub not_started: u64,
    /// Measurements whose value contains the prior.
    pub contained_prior: u64,
    /// Updates whose algebra or model failed, motion readings without a sample, and whatever claims to be from the future.
    pub failed: u64,
    /// Times a belief was started from a fix.
    pub starts: u64,
    /// Times a belief was given up.
    pub losses: u64,
}

/// Why a measurement was refused.
#[derive(Clone, Debug)]
pub enum Refused {
    /// Beyond the gate.
    Gate {
        /// The innovation.
        innovation: Innovation,
        /// The threshold it exceeded.
        threshold: f64,
        /// Channels that speak loudest against the prediction: index, standardised residual.
        worst_channels: Vec<(usize, f64)>,
    },
    /// Older than the lag by so many seconds.
    TooLate {
        /// How far behind, s.
        by_s: f64,
    },
    /// There is no belief and the measurement carries no fix.
    NotStarted,
    /// Its value contains the prior.
    ContainsPrior,
    /// It could not be computed, or contradicts itself.
    Failed(String),
}

/// What became of a measurement.
#[derive(Clone, Debug)]
pub enum Verdict {
    /// It entered the belief.
    Accepted(Innovation),
    /// It started the belief.
    Started,
    /// It did not enter.
    Refused(Refused),
}

/// The answer to an offered measurement.
#[derive(Clone, Debug)]
pub struct Offered {
    /// What became of it.
    pub verdict: Verdict,
    /// Whether the belief was given up because of it, and why.
    pub lost: Option<String>,
    /// The belief that was given up for its refusals, as it stood at the measurement's time: its last word, to be judged by.
    pub given_up: Option<Box<PublishedEstimate>>,
}

impl Offered {
    pub(crate) fn refused(why: Refused) -> Self {
        Self { verdict: Verdict::Refused(why), lost: None, given_up: None }
    }
}

/// A turn in the life of the belief at an instant that had been passed already. Something arrived late, was put in its place, and
/// what follows it was applied again, with another end than the one that had been told.
#[derive(Clone, Debug)]
pub struct Hindsight {
    /// The instant of the turn.
    pub at: SimTime,
    /// The sensor whose measurement made it.
    pub sensor: Name,
    /// What is now so.
    pub turn: Turn,
}

/// What is now so of an instant.
#[derive(Clone, Debug)]
pub enum Turn {
    /// The belief was given up there.
    Lost {
        /// Why.
        why: String,
        /// As [`Offered::given_up`].
        given_up: Option<Box<PublishedEstimate>>,
    },
    /// It was not given up there, although that was told.
    NotLost,
    /// The belief was started there.
    Started,
    /// It was not started there, although that was told.
    NotStarted,
}

/// What a filter is told when it is built, beside its own options.
#[derive(Clone, Default)]
pub struct FilterSetup<'n> {
    /// The nuisance states that the track's front ends and motion inputs ask for.
    pub blocks: Vec<BlockSpec>,
    /// `[track.prior]`, where the track has one.
    pub prior: Option<&'n Node>,
    /// When the track begins to be observed: the instant that the prior is about.
    pub begins: SimTime,
    /// The tract as a map, where estimators may know it.
    pub map: Option<Arc<dyn PathMap>>,
}

/// Builds a filter from `[track.filter]` (its `kind` taken out) and the track's setup; `None` where the track has none.
type Build = fn(&Node, &FilterSetup<'_>) -> Result<Option<Box<dyn Filter>>, ConfigError>;

/// A filter that a scenario can ask for.
pub struct FilterKind {
    /// The name in `[track.filter]`.
    pub name: &'static str,
    /// One line for people.
    pub about: &'static str,
    build: Build,
}

/// All filters there are.
pub static FILTERS: &[FilterKind] = &[
    FilterKind {
        name: "none",
        about: "no filter: the front end's own fixes are the track",
        build: no_filter,
    },
    FilterKind {
        name: "eskf",
        about: "error-state Kalman filter with replay of late measurements",
        build: eskf::build,
    },
];

/// The filter of a `[track.filter]` without a `kind`.
const DEFAULT: &str = "eskf";

fn no_filter(options: &Node, setup: &FilterSetup<'_>) -> Result<Option<Box<dyn Filter>>, ConfigError> {
    if options.keys().iter().any(|key| key != "kind") {
        return Err(options.error("a track without a filter has no options of one"));
    }
    match setup.prior {
        Some(prior) => Err(prior.error("a track without a filter takes no prior")),
        None => Ok(None),
    }
}

/// The kind that `[track.filter]` asks for.
///
/// # Errors
/// [`ConfigError`] with file, line and key: not a name, or one that nobody knows.
pub fn kind_of(node: &Node) -> Result<&'static FilterKind, ConfigError> {
    let allowed = || FILTERS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
    let table = node.to_toml().unwrap_or_default();
    let asked = match table.get("kind") {
        None => DEFAULT,
        Some(value) => value.as_str().ok_or_else(|| {
            node.error_at("kind", &format!("expected a name in quotes; allowed: {}", allowed()))
        })?,
    };
    FILTERS
        .iter()
        .find(|kind| kind.name == asked)
        .ok_or_else(|| node.error_at("kind", &format!("unknown filter `{asked}`; allowed: {}", allowed())))
}

/// The filter that `[track.filter]` asks for; `None` where the track has none.
///
/// # Errors
/// [`ConfigError`] with file, line and key.
pub fn build(node: &Node, setup: &FilterSetup<'_>) -> Result<Option<Box<dyn Filter>>, ConfigError> {
    (kind_of(node)?.build)(&node.without("kind"), setup)
}
