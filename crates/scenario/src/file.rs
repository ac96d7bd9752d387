//! The scenario file: one TOML that says what happens, what is installed, what is real, and who estimates.
//!
//! Tables: `[scenario]`, `[tract]`, `[capsule]`, `[motility]`, `[engine]`, `[patient]`, `[truth]`, `[[sensor]]` (with `.schedule`,
//! `.installed`, `.reality`, `.files`), `[[track]]` (with `.filter`, `.prior`, `.sensor.<name>`), `[[controller]]` (with `.law`),
//! `[[fault]]`, `[record]`, `[expect]`, `[[period]]`, `[layout]`.
//! Every key has a default that makes sense, unknown keys are errors, and every error names file, line, key and what is
//! allowed. The same reader serves replays: there `[[sensor]]` has `.files` instead of a schedule.

use crate::diverticula::DiverticulumTable;
use crate::error::ScenarioError;
use crate::loose::{LooseTable, TetherTable};
use crate::obstacles::ObstacleTable;
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{CapsuleBody, ConfigError, ModelFolder, Name, Node, Schedule};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// `[scenario]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioTable {
    /// Short name: the run's folder is named after it.
    pub name: String,
    /// What it is about.
    #[serde(default)]
    pub description: String,
    /// Length, s, at most 1e7 (four months). In a replay the data decide.
    pub duration_s: Option<Positive>,
    /// Nobody looks before, s: sensors, tracks, log and recording begin here, in a world that has run since 0. In a replay, readings that begin
    /// before are passed over. Default 0.
    #[serde(default)]
    pub observe_from_s: NonNegative,
    /// Seed of all random streams. Default 1.
    #[serde(default = "seed")]
    pub seed: u64,
    /// Where its numbers come from.
    #[serde(default)]
    pub source: String,
}

fn seed() -> u64 {
    1
}

/// Where the defaults of these tables come from.
pub(crate) const SCENARIO_SOURCES: [(&str, &str); 2] =
    [("observe_from_s", "chosen: from the start"), ("seed", "chosen: any number serves")];
pub(crate) const CAPSULE_SOURCES: [(&str, &str); 2] = [
    ("start_arc_length_mm", "chosen: clear of the tract's end by a little more than a capsule's length"),
    ("start_roll_deg", "chosen: no turn"),
];
pub(crate) const TRACT_SOURCES: [(&str, &str); 6] = [
    ("length_scale", "chosen: the tract as its file says"),
    ("radius_scale", "chosen: the tract as its file says"),
    ("tether.radius_mm", "believed: a thin cable"),
    ("tether.link_mm", "chosen: shorter than the bends of a small bowel are wide"),
    ("tether.density_kg_m3", "believed: of polymers"),
    ("tether.held", "chosen: somebody holds it"),
];
pub(crate) const EXPECT_SOURCES: [(&str, &str); 5] = [
    ("max_speed_m_s", "chosen: nothing is expected that the file does not say"),
    ("speed_share", "chosen: what cannot move faster never does"),
    ("least_steps", "chosen: one that is followed at all is followed for three"),
    ("distance", "chosen: nothing is expected that the file does not say"),
    ("rest", "chosen: nothing is expected that the file does not say"),
];
pub(crate) const CONTROLLER_SOURCES: [(&str, &str); 1] =
    [("rate_hz", "chosen: a capsule at 22 mm/s moves 2.2 mm between two decisions")];
pub(crate) const RECORD_SOURCES: [(&str, &str); 2] = [
    ("truth_rate_hz", "chosen: a capsule at 22 mm/s moves 2.2 mm between two rows"),
    ("scene_rate_hz", "chosen: the wall's contractions recur every 5 s at most, so ten pictures each"),
];

/// `[capsule]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CapsuleTable {
    /// Name of a model in `models/capsules`, or a path.
    pub model: String,
    /// Where the capsule starts along the tract, mm. Default 30: clear of the tract's end.
    #[serde(default = "start_mm")]
    pub start_arc_length_mm: NonNegative,
    /// Turn about its own axis at the start, degrees.
    #[serde(default)]
    pub start_roll_deg: Finite,
}

fn start_mm() -> NonNegative {
    NonNegative(30.0)
}

/// `[capsule]` of a capsule model.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CapsuleModelTable {
    /// Its name.
    pub name: String,
    /// Outer diameter, mm.
    pub diameter_mm: Positive,
    /// Overall length, mm.
    pub length_mm: Positive,
    /// Mass, g.
    pub mass_g: Positive,
    /// Where the numbers come from.
    pub source: String,
}

/// `[tract]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TractTable {
    /// Name of a model in `models/tracts`, or a path.
    pub model: String,
    /// Consecutive segments to keep; empty: all.
    #[serde(default)]
    pub segments: Vec<String>,
    /// Factor on the centre line. Default 1.
    #[serde(default = "one")]
    pub length_scale: Positive,
    /// Factor on the radii. Default 1.
    #[serde(default = "one")]
    pub radius_scale: Positive,
    /// What stands in it, `[[tract.obstacle]]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub obstacle: Vec<ObstacleTable>,
    /// Pouches of its wall, `[[tract.diverticulum]]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diverticulum: Vec<DiverticulumTable>,
    /// What is loose in it beside the capsule, `[[tract.loose]]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loose: Vec<LooseTable>,
    /// What the capsule drags behind it, `[tract.tether]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tether: Option<TetherTable>,
}

fn one() -> Positive {
    Positive(1.0)
}

/// One `[[sensor]]`, its tables kept as nodes for the plugin.
#[derive(Clone, Debug)]
pub struct SensorEntry {
    /// Its name.
    pub name: Name,
    /// Its modality.
    pub modality: String,
    /// When it reads; `None` in a replay.
    pub schedule: Option<Schedule>,
    /// What both sides know.
    pub installed: Node,
    /// What the world does beyond that.
    pub reality: Node,
    /// Recorded data, in a replay.
    pub files: Node,
    /// The whole entry, for messages.
    pub node: Node,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorTable {
    name: String,
    modality: String,
    #[serde(rename = "schedule", skip_serializing, default)]
    _schedule: Option<IgnoredAny>,
    #[serde(rename = "installed", skip_serializing, default)]
    _installed: Option<IgnoredAny>,
    #[serde(rename = "reality", skip_serializing, default)]
    _reality: Option<IgnoredAny>,
    #[serde(rename = "files", skip_serializing, default)]
    _files: Option<IgnoredAny>,
}

/// One `[[track]]`, its tables kept as nodes for filter and plugins.
#[derive(Clone, Debug)]
pub struct TrackEntry {
    /// Its name.
    pub name: Name,
    /// Sensors it may use, by name.
    pub sensors: Vec<Name>,
    /// `[track.filter]`.
    pub filter: Node,
    /// `[track.prior]`, where written.
    pub prior: Option<Node>,
    /// Options of each sensor's front end, in the order of [`Self::sensors`].
    pub options: Vec<Node>,
    /// The whole entry, for messages.
    pub node: Node,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TrackTable {
    name: String,
    sensors: Vec<String>,
    #[serde(rename = "filter", skip_serializing, default)]
    _filter: Option<IgnoredAny>,
    #[serde(rename = "prior", skip_serializing, default)]
    _prior: Option<IgnoredAny>,
    #[serde(rename = "sensor", skip_serializing, default)]
    _sensor: Option<IgnoredAny>,
}

/// One `[[controller]]`, its law kept as a node for the crate that knows it.
#[derive(Clone, Debug)]
pub struct ControllerEntry {
    /// Its name.
    pub name: Name,
    /// The track whose estimates it sees.
    pub track: Name,
    /// The sensor that it moves.
    pub sensor: Name,
    /// How often it decides, Hz.
    pub rate_hz: f64,
    /// `[controller.law]`.
    pub law: Node,
    /// The whole entry, for messages.
    pub node: Node,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ControllerTable {
    name: String,
    track: String,
    sensor: String,
    #[serde(default = "control_rate")]
    rate_hz: Positive,
    #[serde(rename = "law", skip_serializing, default)]
    _law: Option<IgnoredAny>,
}

fn control_rate() -> Positive {
    Positive(10.0)
}

/// One `[[fault]]`: something that befalls a sensor's readings on their way, whatever the modality.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Fault {
    /// No readings arrive.
    Dropout {
        /// The sensor.
        sensor: String,
        /// From, s.
        start_s: NonNegative,
        /// To, s.
        end_s: Positive,
    },
    /// Single channels are lost.
    LostChannels {
        /// The sensor.
        sensor: String,
        /// From, s.
        start_s: NonNegative,
        /// To, s.
        end_s: Positive,
        /// Rows of the reading.
        channels: Vec<usize>,
    },
    /// Channels keep the value they had when the fault began.
    Stuck {
        /// The sensor.
        sensor: String,
        /// From, s.
        start_s: NonNegative,
        /// To, s.
        end_s: Positive,
        /// Rows of the reading.
        channels: Vec<usize>,
    },
    /// Values of random channels are replaced by wild ones.
    Outliers {
        /// The sensor.
        sensor: String,
        /// From, s.
        start_s: NonNegative,
        /// To, s.
        end_s: Positive,
        /// Share of the values hit.
        share: Fraction,
        /// Standard deviation of what is added, in the unit of the reading's column.
        sigma: Positive,
    },
    /// Readings arrive later.
    Delay {
        /// The sensor.
        sensor: String,
        /// From, s.
        start_s: NonNegative,
        /// To, s.
        end_s: Positive,
        /// By how much, ms.
        delay_ms: Positive,
    },
}

impl Fault {
    /// The sensor and the interval in seconds.
    pub fn place(&self) -> (&str, f64, f64) {
        match self {
            Self::Dropout { sensor, start_s, end_s }
            | Self::LostChannels { sensor, start_s, end_s, .. }
            | Self::Stuck { sensor, start_s, end_s, .. }
            | Self::Outliers { sensor, start_s, end_s, .. }
            | Self::Delay { sensor, start_s, end_s, .. } => (sensor, start_s.0, end_s.0),
        }
    }

    /// In words, for notes.
    pub fn describe(&self) -> String {
        let (sensor, start, end) = self.place();
        let what = match self {
            Self::Dropout { .. } => "dropout".to_owned(),
            Self::LostChannels { channels, .. } => format!("channels {channels:?} lost"),
            Self::Stuck { channels, .. } => format!("channels {channels:?} stuck"),
            Self::Outliers { share, .. } => format!("outliers on {:.0} % of the values", 100.0 * share.0),
            Self::Delay { delay_ms, .. } => format!("readings {} ms later", delay_ms.0),
        };
        format!("sensor `{sensor}`: {what} from {start} to {end} s")
    }
}

/// `[record]`.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecordTable {
    /// Rate at which truth is written and availability judged, Hz. Default 10. Allowed: 1e-6 to 1e4.
    pub truth_rate_hz: Positive,
    /// Rate of pictures (moving wall, sensors), Hz. Default 2. Allowed: 1e-6 to 1e4.
    pub scene_rate_hz: Positive,
}

impl Default for RecordTable {
    fn default() -> Self {
        Self { truth_rate_hz: Positive(10.0), scene_rate_hz: Positive(2.0) }
    }
}

/// `[expect]`: what is known of the motion without a truth, and is checked.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExpectTable {
    /// No track moves faster between estimates, m/s; absent: not checked.
    pub max_speed_m_s: Option<Positive>,
    /// Least share of the steps that must be as slow as that. Default 1: all.
    pub speed_share: Option<Fraction>,
    /// Least steps that a track must have made to be judged so. Default 3.
    pub least_steps: Option<u32>,
    /// Pairs of tracks whose distance is reported.
    pub distance: Vec<DistanceTable>,
    /// Tracks of what rests.
    pub rest: Vec<RestTable>,
}

/// `[[expect.distance]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistanceTable {
    /// Two tracks.
    pub tracks: [String; 2],
    /// From where to where their mean distance without outliers must lie, mm; absent: anywhere.
    pub mm: Option<[NonNegative; 2]>,
    /// Least instants at which both must have an estimate to be judged so. Default 3.
    pub least_instants: Option<u32>,
    /// Largest robust standard deviation of the distance, mm; absent: any.
    pub max_robust_sd_mm: Option<Positive>,
    /// Largest share of outliers, 0 to 1; absent: any.
    pub max_outlier_share: Option<Fraction>,
}

/// `[[expect.rest]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RestTable {
    /// The track.
    pub track: String,
    /// Least estimates to be judged by. Default 3.
    pub least_instants: Option<u32>,
    /// Largest robust standard deviation along any axis, mm; absent: any.
    pub max_robust_sd_mm: Option<Positive>,
    /// Largest share of outliers, 0 to 1; absent: any.
    pub max_outlier_share: Option<Fraction>,
}

/// `[[period]]`: a stretch of the run whose errors are reported by themselves as well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PeriodTable {
    /// What it is called in `metrics.json`.
    pub name: String,
    /// Its first instant, s.
    pub from_s: NonNegative,
    /// Its end, s, which no longer belongs to it.
    pub to_s: Positive,
}

impl PeriodTable {
    /// Whether an instant, s, lies in it.
    pub fn contains(&self, at_s: f64) -> bool {
        (self.from_s.0..self.to_s.0).contains(&at_s)
    }
}

/// A scenario or replay as read: typed where the framework decides, nodes where a plugin does.
#[derive(Clone, Debug)]
pub struct ScenarioFile {
    /// `[scenario]`.
    pub scenario: ScenarioTable,
    /// `[capsule]`.
    pub capsule: CapsuleTable,
    /// The capsule's shape.
    pub body: CapsuleBody,
    /// The capsule's model file.
    pub capsule_model: Node,
    /// `[tract]`, where written.
    pub tract: Option<TractTable>,
    /// The sensors.
    pub sensors: Vec<SensorEntry>,
    /// The tracks.
    pub tracks: Vec<TrackEntry>,
    /// The controllers.
    pub controllers: Vec<ControllerEntry>,
    /// The faults.
    pub faults: Vec<Fault>,
    /// `[record]`.
    pub record: RecordTable,
    /// `[expect]`.
    pub expect: ExpectTable,
    /// Every `[[period]]`.
    pub periods: Vec<PeriodTable>,
    /// Where models are found.
    pub models: ModelFolder,
    /// The file.
    pub node: Node,
}

/// Tables of the file, for its unknown keys.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Outline {
    #[serde(rename = "scenario")]
    _scenario: IgnoredAny,
    #[serde(rename = "capsule")]
    _capsule: IgnoredAny,
    #[serde(rename = "tract")]
    _tract: Option<IgnoredAny>,
    #[serde(rename = "motility")]
    _motility: Option<IgnoredAny>,
    #[serde(rename = "engine")]
    _engine: Option<IgnoredAny>,
    #[serde(rename = "patient")]
    _patient: Option<IgnoredAny>,
    #[serde(rename = "truth")]
    _truth: Option<IgnoredAny>,
    #[serde(rename = "sensor")]
    _sensor: Option<IgnoredAny>,
    #[serde(rename = "track")]
    _track: Option<IgnoredAny>,
    #[serde(rename = "controller")]
    _controller: Option<IgnoredAny>,
    #[serde(rename = "fault")]
    _fault: Option<IgnoredAny>,
    #[serde(rename = "record")]
    _record: Option<IgnoredAny>,
    #[serde(rename = "expect")]
    _expect: Option<IgnoredAny>,
    #[serde(rename = "period")]
    _period: Option<IgnoredAny>,
    // Read by whoever designs layouts; a run has no use for it.
    #[serde(rename = "layout")]
    _layout: Option<IgnoredAny>,
}

impl ScenarioFile {
    /// Reads a file that has been opened.
    ///
    /// # Errors
    /// [`ScenarioError::Config`] with file, line, key and what is allowed.
    pub fn from_node(node: Node, models: ModelFolder) -> Result<Self, ScenarioError> {
        let _: Outline = node.parse_quietly()?;
        let scenario: ScenarioTable = node.child_or_empty("scenario").parse_sourced(&SCENARIO_SOURCES)?;
        check_name(&scenario.name, &node.child_or_empty("scenario"))?;
        check_times(&node.child_or_empty("scenario"), &scenario)?;
        let capsule: CapsuleTable = node.child_or_empty("capsule").parse_sourced(&CAPSULE_SOURCES)?;
        let capsule_model =
            models.open("capsules", &capsule.model, &node.child_or_empty("capsule"), "model")?;
        let shape_node = capsule_model.child_or_empty("capsule");
        let shape: CapsuleModelTable = shape_node.parse()?;
        check_range(&shape_node, "diameter_mm", shape.diameter_mm.0, 0.1, 100.0)?;
        check_range(&shape_node, "length_mm", shape.length_mm.0, 0.1, 1000.0)?;
        check_range(&shape_node, "mass_g", shape.mass_g.0, 1e-3, 1e4)?;
        if shape.length_mm.0 < shape.diameter_mm.0 {
            let message = "a capsule is at least as long as it is wide";
            return Err(shape_node.error_at("length_mm", message).into());
        }
        let body = CapsuleBody {
            radius_m: 0.5e-3 * shape.diameter_mm.0,
            length_m: 1e-3 * shape.length_mm.0,
            mass_kg: 1e-3 * shape.mass_g.0,
        };
        let tract = node.child("tract").map(|n| n.parse_sourced(&TRACT_SOURCES)).transpose()?;
        let sensors = read_sensors(&node)?;
        let tracks = read_tracks(&node, &sensors)?;
        let controllers = read_controllers(&node, &sensors, &tracks)?;
        let faults = read_faults(&node, &sensors, scenario.observe_from_s.0)?;
        let record_node = node.child_or_empty("record");
        let record: RecordTable = record_node.parse_sourced(&RECORD_SOURCES)?;
        check_range(&record_node, "truth_rate_hz", record.truth_rate_hz.0, 1e-6, 1e4)?;
        check_range(&record_node, "scene_rate_hz", record.scene_rate_hz.0, 1e-6, 1e4)?;
        let expect = read_expectations(&node, &tracks)?;
        let periods = read_periods(&node, &scenario)?;
        Ok(Self {
            scenario,
            capsule,
            body,
            capsule_model,
            tract,
            sensors,
            tracks,
            controllers,
            faults,
            record,
            expect,
            periods,
            models,
            node,
        })
    }
}

fn check_times(node: &Node, scenario: &ScenarioTable) -> Result<(), ConfigError> {
    let from_s = scenario.observe_from_s.0;
    check_range(node, "observe_from_s", from_s, 0.0, 1e7)?;
    let Some(duration_s) = scenario.duration_s else { return Ok(()) };
    check_range(node, "duration_s", duration_s.0, 1e-6, 1e7)?;
    if from_s >= duration_s.0 {
        let message = format!("the scenario has ended by then; give less than duration_s = {}", duration_s.0);
        return Err(node.error_at("observe_from_s", &message));
    }
    Ok(())
}

fn read_periods(node: &Node, scenario: &ScenarioTable) -> Result<Vec<PeriodTable>, ConfigError> {
    let mut seen = BTreeSet::new();
    let mut periods = Vec::new();
    for entry in node.children("period")? {
        let period: PeriodTable = entry.parse()?;
        check_unique(&mut seen, &period.name, &entry)?;
        if period.to_s.0 <= period.from_s.0 {
            let message = format!("ends before it begins; give more than from_s = {}", period.from_s.0);
            return Err(entry.error_at("to_s", &message));
        }
        if period.to_s.0 <= scenario.observe_from_s.0 {
            let message = format!(
                "ends before anybody looks; give more than observe_from_s = {}",
                scenario.observe_from_s.0
            );
            return Err(entry.error_at("to_s", &message));
        }
        if let Some(duration_s) = scenario.duration_s.filter(|duration_s| period.from_s.0 >= duration_s.0) {
            let message = format!("begins after the end of the scenario; give less than {}", duration_s.0);
            return Err(entry.error_at("from_s", &message));
        }
        periods.push(period);
    }
    Ok(periods)
}

fn read_expectations(node: &Node, tracks: &[TrackEntry]) -> Result<ExpectTable, ConfigError> {
    let table = node.child_or_empty("expect");
    let expect: ExpectTable = table.parse_sourced(&EXPECT_SOURCES)?;
    let known: Vec<&str> = tracks.iter().map(|t| &*t.name).collect();
    let check_track = |name: &String, key: &str, entry: &Node| {
        if known.contains(&name.as_str()) {
            return Ok(());
        }
        let message = format!("no track `{name}`; there are: {}", known.join(", "));
        Err(entry.error_at(key, &message))
    };
    if expect.speed_share.is_some() && expect.max_speed_m_s.is_none() {
        return Err(
            table.error_at("speed_share", "a share of the steps within which speed? Give `max_speed_m_s`")
        );
    }
    if expect.least_steps.is_some() && expect.max_speed_m_s.is_none() {
        return Err(table.error_at("least_steps", "steps within which speed? Give `max_speed_m_s`"));
    }
    for (rest, entry) in expect.rest.iter().zip(table.children("rest")?) {
        check_track(&rest.track, "track", &entry)?;
    }
    for (pair, entry) in expect.distance.iter().zip(table.children("distance")?) {
        for name in &pair.tracks {
            check_track(name, "tracks", &entry)?;
        }
        if let Some([low, high]) = pair.mm
            && low.0 > high.0
        {
            let message = format!("from {} to {} mm; the first must not be the larger", low.0, high.0);
            return Err(entry.error_at("mm", &message));
        }
        if pair.tracks[0] == pair.tracks[1] {
            return Err(entry.error_at("tracks", "the distance of a track from itself; name two tracks"));
        }
    }
    Ok(expect)
}

/// Refuses a number outside its range, at its key.
///
/// # Errors
/// [`ConfigError`] with file, line, key and what is allowed.
pub(crate) fn check_range(
    node: &Node,
    key: &str,
    value: f64,
    low: f64,
    high: f64,
) -> Result<(), ConfigError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let message = format!("{value:e} is not allowed here; it must be from {low:e} to {high:e}");
    Err(node.error_at(key, &message))
}

/// Names become folders and entity paths: letters, digits, `-`, `_` and `.`, not starting with a dot.
fn check_name(name: &str, node: &Node) -> Result<(), ConfigError> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.len() > 80 || name.starts_with('.') || !name.chars().all(allowed) {
        let message =
            format!("`{name}` is not allowed as a name; use 1 to 80 of A-Z a-z 0-9 - _ . (no leading dot)");
        return Err(node.error_at("name", &message));
    }
    Ok(())
}

fn check_unique(seen: &mut BTreeSet<String>, name: &str, node: &Node) -> Result<(), ConfigError> {
    check_name(name, node)?;
    if seen.insert(name.to_owned()) {
        Ok(())
    } else {
        Err(node.error_at("name", "this name is taken already"))
    }
}

fn read_sensors(node: &Node) -> Result<Vec<SensorEntry>, ConfigError> {
    let mut seen = BTreeSet::new();
    let mut sensors = Vec::new();
    for entry in node.children("sensor")? {
        let table: SensorTable = entry.parse()?;
        check_unique(&mut seen, &table.name, &entry)?;
        sensors.push(SensorEntry {
            name: table.name.as_str().into(),
            modality: table.modality,
            schedule: entry.child("schedule").map(|n| n.parse()).transpose()?,
            installed: entry.child_or_empty("installed"),
            reality: entry.child_or_empty("reality"),
            files: entry.child_or_empty("files"),
            node: entry,
        });
    }
    Ok(sensors)
}

fn read_tracks(node: &Node, sensors: &[SensorEntry]) -> Result<Vec<TrackEntry>, ConfigError> {
    let known: Vec<&str> = sensors.iter().map(|s| &*s.name).collect();
    let mut seen = BTreeSet::new();
    let mut tracks = Vec::new();
    for entry in node.children("track")? {
        let table: TrackTable = entry.parse()?;
        check_unique(&mut seen, &table.name, &entry)?;
        if table.sensors.is_empty() {
            return Err(entry.error_at("sensors", "a track needs at least one sensor"));
        }
        for (i, name) in table.sensors.iter().enumerate() {
            if !known.contains(&name.as_str()) {
                let message = format!("no sensor `{name}`; the scenario has: {}", known.join(", "));
                return Err(entry.error_at("sensors", &message));
            }
            if table.sensors[..i].contains(name) {
                return Err(entry.error_at("sensors", &format!("sensor `{name}` is listed twice")));
            }
        }
        let options = entry.child_or_empty("sensor");
        if let Some(other) = options.keys().into_iter().find(|k| !table.sensors.contains(k)) {
            let message =
                format!("this track does not use a sensor `{other}`; it uses: {}", table.sensors.join(", "));
            return Err(options.error_at(&other, &message));
        }
        tracks.push(TrackEntry {
            name: table.name.as_str().into(),
            sensors: table.sensors.iter().map(|s| s.as_str().into()).collect(),
            filter: entry.child_or_empty("filter"),
            prior: entry.child("prior"),
            options: table.sensors.iter().map(|s| options.child_or_empty(s)).collect(),
            node: entry,
        });
    }
    Ok(tracks)
}

fn read_controllers(
    node: &Node,
    sensors: &[SensorEntry],
    tracks: &[TrackEntry],
) -> Result<Vec<ControllerEntry>, ConfigError> {
    let mut seen = BTreeSet::new();
    let mut moved = BTreeSet::new();
    let mut controllers = Vec::new();
    for entry in node.children("controller")? {
        let table: ControllerTable = entry.parse_sourced(&CONTROLLER_SOURCES)?;
        check_unique(&mut seen, &table.name, &entry)?;
        check_range(&entry, "rate_hz", table.rate_hz.0, 1e-3, 1e4)?;
        let known: Vec<&str> = tracks.iter().map(|t| &*t.name).collect();
        if !known.contains(&table.track.as_str()) {
            let message = format!("no track `{}`; the scenario has: {}", table.track, known.join(", "));
            return Err(entry.error_at("track", &message));
        }
        let known: Vec<&str> = sensors.iter().map(|s| &*s.name).collect();
        if !known.contains(&table.sensor.as_str()) {
            let message = format!("no sensor `{}`; the scenario has: {}", table.sensor, known.join(", "));
            return Err(entry.error_at("sensor", &message));
        }
        if !moved.insert(table.sensor.clone()) {
            let message = format!("sensor `{}` is moved by another controller already", table.sensor);
            return Err(entry.error_at("sensor", &message));
        }
        controllers.push(ControllerEntry {
            name: table.name.as_str().into(),
            track: table.track.as_str().into(),
            sensor: table.sensor.as_str().into(),
            rate_hz: table.rate_hz.0,
            law: entry.child_or_empty("law"),
            node: entry,
        });
    }
    Ok(controllers)
}

fn read_faults(node: &Node, sensors: &[SensorEntry], observe_from_s: f64) -> Result<Vec<Fault>, ConfigError> {
    let mut faults = Vec::new();
    for entry in node.children("fault")? {
        let fault: Fault = entry.parse()?;
        let (sensor, start, end) = fault.place();
        if !sensors.iter().any(|s| &*s.name == sensor) {
            let known: Vec<&str> = sensors.iter().map(|s| &*s.name).collect();
            let message = format!("no sensor `{sensor}`; the scenario has: {}", known.join(", "));
            return Err(entry.error_at("sensor", &message));
        }
        check_range(&entry, "start_s", start, 0.0, 1e9)?;
        check_range(&entry, "end_s", end, 0.0, 1e9)?;
        if let Fault::Delay { delay_ms, .. } = &fault {
            check_range(&entry, "delay_ms", delay_ms.0, 0.0, 1e9)?;
        }
        if matches!(fault, Fault::Stuck { .. }) && start < observe_from_s && observe_from_s < end {
            let message = format!(
                "what sticks holds a reading from before anybody looks; give at least observe_from_s = {observe_from_s}"
            );
            return Err(entry.error_at("start_s", &message));
        }
        if end <= start {
            return Err(
                entry.error_at("end_s", &format!("the fault ends at {end} s, before it starts at {start} s"))
            );
        }
        faults.push(fault);
    }
    Ok(faults)
}
