//! `events.jsonl`: what happened besides estimates, one JSON object a line; what `explain` reads.
//!
//! ```json
//! {"t_ns":1500000000,"event":"note","source":"world","text":"enters the duodenum"}
//! {"t_ns":1510000000,"event":"refused","track":"magnetic","sensor":"belt","sequence":151,"reason":"gate","chi_square":91.2,
//!  "dof":48.0,"threshold":84.0,"worst":[{"channel":3,"label":"s1x_T","standardised":7.1}]}
//! {"t_ns":1520000000,"event":"missing","sensor":"belt","text":"dropout"}
//! ```

use crate::error::ReportError;
use crate::file::OutputFile;
use lumenav_core::{Frame, Rows};
use lumenav_pipeline::{ObserverError, Refusal, RunEvent, RunHeader, RunObserver};
use serde::{Deserialize, Serialize};
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

/// A line of `events.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoggedEvent {
    /// The instant it is about, ns.
    pub t_ns: i64,
    /// What happened.
    #[serde(flatten)]
    pub what: Logged,
}

/// What a line tells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Logged {
    /// Something happened in the world or to a track.
    Note {
        /// `world`, `fault`, or the track's name.
        source: String,
        /// In words.
        text: String,
    },
    /// A due reading did not come.
    Missing {
        /// The sensor.
        sensor: String,
        /// Why.
        text: String,
    },
    /// A measurement or reading did not enter a track.
    Refused {
        /// The track.
        track: String,
        /// The sensor.
        sensor: String,
        /// The reading's sequence number.
        sequence: u64,
        /// `gate`, `too_late`, `front_end`, `not_started`, `contains_prior` or `failed`.
        reason: String,
        /// In words, where the reason alone does not say it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        text: Option<String>,
        /// Squared distance of the innovation (gate).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        chi_square: Option<f64>,
        /// Its degrees of freedom (gate).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dof: Option<f64>,
        /// The gate's threshold (gate).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        threshold: Option<f64>,
        /// How late, s (too late).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        late_s: Option<f64>,
        /// The channels that fit worst (gate).
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        worst: Vec<WorstChannel>,
    },
}

/// A channel of a refused measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorstChannel {
    /// Its index in the residual.
    pub channel: usize,
    /// Its label, where the measurement's value has labelled channels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// Residual over its standard deviation.
    pub standardised: f64,
}

/// Short name of a refusal, as in `metrics.json`.
pub fn refusal_reason(why: &Refusal) -> &'static str {
    match why {
        Refusal::Gate { .. } => "gate",
        Refusal::TooLate { .. } => "too_late",
        Refusal::FrontEnd { .. } => "front_end",
        Refusal::NotStarted => "not_started",
        Refusal::ContainsPrior => "contains_prior",
        Refusal::Failed { .. } => "failed",
    }
}

impl LoggedEvent {
    /// The line of an event; `None` for events that other files hold.
    pub fn of(event: &RunEvent<'_>) -> Option<Self> {
        match event {
            RunEvent::Note { at, source, text } => Some(Self {
                t_ns: at.0,
                what: Logged::Note { source: (*source).to_owned(), text: (*text).to_owned() },
            }),
            RunEvent::Missing { sensor, at, why } => Some(Self {
                t_ns: at.0,
                what: Logged::Missing { sensor: sensor.to_string(), text: (*why).to_owned() },
            }),
            RunEvent::Refused { track, sensor, sequence, at, measurement, why } => {
                let mut refused = Logged::Refused {
                    track: track.to_string(),
                    sensor: sensor.to_string(),
                    sequence: *sequence,
                    reason: refusal_reason(why).to_owned(),
                    text: None,
                    chi_square: None,
                    dof: None,
                    threshold: None,
                    late_s: None,
                    worst: Vec::new(),
                };
                refused.add_details(why, measurement.map(|m| &*m.value));
                Some(Self { t_ns: at.0, what: refused })
            }
            _ => None,
        }
    }
}

impl Logged {
    fn add_details(&mut self, why: &Refusal, value: Option<&Frame>) {
        let Self::Refused { text, chi_square, dof, threshold, late_s, worst, .. } = self else { return };
        match why {
            Refusal::Gate { chi_square: squared, degrees_of_freedom, threshold: limit, worst_channels } => {
                *chi_square = Some(*squared);
                *dof = Some(*degrees_of_freedom);
                *threshold = Some(*limit);
                *worst = worst_channels
                    .iter()
                    .map(|&(channel, standardised)| WorstChannel {
                        channel,
                        label: value.and_then(|frame| label(frame, channel)),
                        standardised,
                    })
                    .collect();
            }
            Refusal::TooLate { by_s } => *late_s = Some(*by_s),
            Refusal::FrontEnd { why } | Refusal::Failed { why } => *text = Some(why.clone()),
            Refusal::NotStarted | Refusal::ContainsPrior => {}
        }
    }
}

/// The label of a channel.
fn label(frame: &Frame, channel: usize) -> Option<String> {
    match &frame.schema().rows {
        Rows::Channels(labels) => labels.get(channel).cloned(),
        Rows::Events => None,
    }
}

/// Writes `events.jsonl` into a folder.
pub struct EventsObserver {
    path: PathBuf,
    file: Option<OutputFile>,
}

impl EventsObserver {
    /// The file goes into `folder`, which exists.
    pub fn new(folder: &Path) -> Self {
        Self { path: folder.join("events.jsonl"), file: None }
    }

    fn write(&mut self, event: &RunEvent<'_>) -> Result<(), ReportError> {
        let (Some(file), Some(logged)) = (self.file.as_mut(), LoggedEvent::of(event)) else { return Ok(()) };
        let line = serde_json::to_string(&logged)
            .map_err(|source| ReportError::Json { path: self.path.clone(), source })?;
        file.line(&line)
    }
}

impl RunObserver for EventsObserver {
    fn start(&mut self, _: &RunHeader) -> Result<(), ObserverError> {
        self.file = Some(OutputFile::in_place(&self.path).map_err(|e| ObserverError::new("events", e))?);
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        self.write(event).map_err(|e| ObserverError::new("events", e))
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        match self.file.as_mut() {
            Some(file) => file.finish().map_err(|e| ObserverError::new("events", e)),
            None => Ok(()),
        }
    }
}

/// Calls `see` for each line of an `events.jsonl`.
///
/// # Errors
/// [`ReportError::Line`] with file and line where a line is no event, [`ReportError::File`].
pub fn for_each_event(path: &Path, mut see: impl FnMut(LoggedEvent)) -> Result<(), ReportError> {
    let file = std::fs::File::open(path).map_err(ReportError::file("cannot open", path))?;
    for (index, line) in BufReader::new(file).lines().enumerate() {
        let bad = |what: String| ReportError::Line { path: path.to_owned(), line: index + 1, what };
        let line = line.map_err(|e| bad(format!("cannot be read as text: {e}")))?;
        if line.trim().is_empty() {
            continue;
        }
        see(serde_json::from_str(&line).map_err(|e| bad(format!("no event: {e}")))?);
    }
    Ok(())
}

/// All lines of an `events.jsonl`.
///
/// # Errors
/// As [`for_each_event`].
pub fn read_events(path: &Path) -> Result<Vec<LoggedEvent>, ReportError> {
    let mut events = Vec::new();
    for_each_event(path, |event| events.push(event))?;
    Ok(events)
}
