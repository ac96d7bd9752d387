//! `[patient]` and `[[patient.event]]`: keys, defaults, and what they may be. Sources: [`super::PATIENT_SOURCES`].

use crate::file::check_range;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, Node};
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize};

use super::sources::{PATIENT_EVENT_SOURCES, PATIENT_SOURCES};

/// How a patient lies or stands. The world is that of a patient lying supine: x right, y anterior and up, z superior.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Posture {
    /// On the back.
    #[default]
    Supine,
    /// On the belly.
    Prone,
    /// On the left side.
    LeftLateral,
    /// On the right side.
    RightLateral,
    /// Standing or sitting: the head upwards, the face towards -z of the world.
    Upright,
}

impl Posture {
    /// Turn about the long axis and about the world's x axis after it, rad: `R = Rx(pitch) Rz(roll)`.
    pub fn angles_rad(self) -> [f64; 2] {
        use std::f64::consts::{FRAC_PI_2, PI};
        match self {
            Self::Supine => [0.0, 0.0],
            Self::Prone => [PI, 0.0],
            Self::LeftLateral => [FRAC_PI_2, 0.0],
            Self::RightLateral => [-FRAC_PI_2, 0.0],
            Self::Upright => [0.0, -FRAC_PI_2],
        }
    }

    /// As in a file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Supine => "supine",
            Self::Prone => "prone",
            Self::LeftLateral => "left-lateral",
            Self::RightLateral => "right-lateral",
            Self::Upright => "upright",
        }
    }
}

/// One `[[patient.event]]`, by its `kind`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PatientEvent {
    /// `posture`.
    Posture(Turn),
    /// `cough`.
    Cough(Cough),
    /// `walk`.
    Walk(Walk),
    /// `table`.
    Table(Ride),
}

/// `kind = "posture"`: the patient turns to another posture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// When the turn begins, s.
    pub at_s: NonNegative,
    /// The posture in which it ends.
    pub to: Posture,
    /// How long it takes, s. Default 4 (chosen). Allowed: 0.5 to 1e4.
    #[serde(default = "turn_s")]
    pub duration_s: Positive,
}

/// `kind = "cough"`: a cough pushes the gut there and back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cough {
    /// When it begins, s.
    pub at_s: NonNegative,
    /// Largest acceleration of the gut in the torso, m/s². Default 5 (B). Allowed: 0 to 50.
    #[serde(default = "cough_m_s2")]
    pub acceleration_m_s2: NonNegative,
    /// How long it takes, s. Default 0.3 (B). Allowed: 0.05 to 2.
    #[serde(default = "cough_s")]
    pub duration_s: Positive,
    /// Which way the gut is pushed, in the torso. Default (0, 0, 1): cranially.
    #[serde(default = "cranial")]
    pub direction: [Finite; 3],
}

/// `kind = "walk"`: the patient walks, upright, forwards (-z of the world).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walk {
    /// The first step, s.
    pub from_s: NonNegative,
    /// The last step, s.
    pub to_s: Positive,
    /// Steps per second. Default 1.85 (B). Allowed: 0.2 to 5.
    #[serde(default = "steps_hz")]
    pub step_frequency_hz: Positive,
    /// Half of the way between the trunk's highest and lowest place, mm. Default 22 (B). Allowed: 0 to 200.
    #[serde(default = "step_mm")]
    pub amplitude_mm: NonNegative,
    /// Speed, m/s. Default 0: on the spot or on a treadmill. Allowed: 0 to 3.
    #[serde(default)]
    pub speed_m_s: NonNegative,
}

/// `kind = "table"`: the table under the patient moves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ride {
    /// When it begins to move, s.
    pub at_s: NonNegative,
    /// How far, mm in the world. Allowed: -1e4 to 1e4.
    pub by_mm: [Finite; 3],
    /// How long it takes, s. Default 10 (chosen). Allowed: 0.5 to 1e4.
    #[serde(default = "table_s")]
    pub duration_s: Positive,
}

/// What the other keys of an event mean.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Posture,
    Cough,
    Walk,
    Table,
}

#[derive(Deserialize)]
struct KindOfEvent {
    kind: Kind,
}

fn turn_s() -> Positive {
    Positive(4.0)
}

fn cough_m_s2() -> NonNegative {
    NonNegative(5.0)
}

fn cough_s() -> Positive {
    Positive(0.3)
}

fn cranial() -> [Finite; 3] {
    [Finite(0.0), Finite(0.0), Finite(1.0)]
}

fn steps_hz() -> Positive {
    Positive(1.85)
}

fn step_mm() -> NonNegative {
    NonNegative(22.0)
}

fn table_s() -> Positive {
    Positive(10.0)
}

impl PatientEvent {
    /// Reads one event: first its kind, then the keys of that kind, so that errors name their lines.
    fn from_node(entry: &Node) -> Result<Self, ConfigError> {
        let KindOfEvent { kind } = entry.parse_quietly()?;
        let rest = entry.without("kind");
        Ok(match kind {
            Kind::Posture => Self::Posture(rest.parse_sourced(&PATIENT_EVENT_SOURCES)?),
            Kind::Cough => Self::Cough(rest.parse_sourced(&PATIENT_EVENT_SOURCES)?),
            Kind::Walk => Self::Walk(rest.parse_sourced(&PATIENT_EVENT_SOURCES)?),
            Kind::Table => Self::Table(rest.parse_sourced(&PATIENT_EVENT_SOURCES)?),
        })
    }

    /// When it begins and ends, s.
    pub fn interval_s(&self) -> [f64; 2] {
        let lasts = |at_s: NonNegative, duration_s: Positive| [at_s.0, at_s.0 + duration_s.0];
        match self {
            Self::Posture(turn) => lasts(turn.at_s, turn.duration_s),
            Self::Cough(cough) => lasts(cough.at_s, cough.duration_s),
            Self::Walk(walk) => [walk.from_s.0, walk.to_s.0],
            Self::Table(ride) => lasts(ride.at_s, ride.duration_s),
        }
    }

    /// The key that says when it begins.
    fn begins(&self) -> &'static str {
        if matches!(self, Self::Walk(_)) { "from_s" } else { "at_s" }
    }

    /// In words, for notes.
    pub fn describe(&self) -> String {
        let [from_s, to_s] = self.interval_s();
        match self {
            Self::Posture(turn) => format!("turns to {} until {to_s} s", turn.to.name()),
            Self::Cough(cough) => format!("coughs with {} m/s2", cough.acceleration_m_s2.0),
            Self::Walk(_) => format!("walks from {from_s} to {to_s} s"),
            Self::Table(Ride { by_mm: [x, y, z], .. }) => {
                format!("the table moves by ({}, {}, {}) mm until {to_s} s", x.0, y.0, z.0)
            }
        }
    }
}

/// `[patient]`: (S) stated by a source, (B) believed, (T) tuned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PatientConfig {
    /// Posture at the start. Default supine.
    pub posture: Posture,
    /// How far a breath pushes the gut, from one end to the other, caudally at inspiration, mm. Default 13 (S). Allowed: 0 to 100.
    pub breathing_amplitude_mm: NonNegative,
    /// Time from breath to breath, s. Default 5 (B). Allowed: 0.5 to 100.
    pub breathing_period_s: Positive,
    /// How far a breath lifts the belly (frame `abdomen`), anteriorly at inspiration, mm. Default 5 (B). Allowed: 0 to 100.
    pub surface_amplitude_mm: NonNegative,
    /// How far the gut hangs from where it would be without weight, mm: a change of posture moves it by this times the change of gravity's
    /// direction in the torso. Default 10 (B). Allowed: 0 to 200.
    pub organ_shift_mm: NonNegative,
    /// How much longer than the turn that takes, s. Default 10 (B). Allowed: 0 to 1000.
    pub organ_shift_s: NonNegative,
    /// What happens, in any order; read by [`PatientConfig::from_node`], each by itself.
    #[serde(skip_serializing, deserialize_with = "later")]
    pub event: Vec<PatientEvent>,
}

fn later<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<PatientEvent>, D::Error> {
    IgnoredAny::deserialize(deserializer).map(|_| Vec::new())
}

impl Default for PatientConfig {
    fn default() -> Self {
        Self {
            posture: Posture::Supine,
            breathing_amplitude_mm: NonNegative(13.0),
            breathing_period_s: Positive(5.0),
            surface_amplitude_mm: NonNegative(5.0),
            organ_shift_mm: NonNegative(10.0),
            organ_shift_s: NonNegative(10.0),
            event: Vec::new(),
        }
    }
}

impl PatientConfig {
    /// Reads `[patient]`.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line, key and what is allowed.
    pub fn from_node(node: &Node) -> Result<Self, ConfigError> {
        let entries = node.children("event")?;
        let mut config: Self = node.parse_sourced(&PATIENT_SOURCES)?;
        for (key, value, high) in [
            ("breathing_amplitude_mm", config.breathing_amplitude_mm.0, 100.0),
            ("surface_amplitude_mm", config.surface_amplitude_mm.0, 100.0),
            ("organ_shift_mm", config.organ_shift_mm.0, 200.0),
            ("organ_shift_s", config.organ_shift_s.0, 1000.0),
        ] {
            check_range(node, key, value, 0.0, high)?;
        }
        check_range(node, "breathing_period_s", config.breathing_period_s.0, 0.5, 100.0)?;
        let rate_rad_s = std::f64::consts::TAU / config.breathing_period_s.0;
        let most_mm = 1e3 * MOST_BREATH_M_S2 / rate_rad_s.powi(2);
        if config.breathing_amplitude_mm.0 > most_mm {
            let message = format!(
                "{} mm every {} s is more than {MOST_BREATH_M_S2} m/s²; allowed: up to {most_mm:.1}",
                config.breathing_amplitude_mm.0, config.breathing_period_s.0
            );
            return Err(node.error_at("breathing_amplitude_mm", &message));
        }
        if entries.len() > MOST_EVENTS {
            let message = format!("{} events; at most {MOST_EVENTS} are allowed", entries.len());
            return Err(node.error_at("event", &message));
        }
        for entry in &entries {
            let event = PatientEvent::from_node(entry)?;
            check_numbers(&event, entry)?;
            config.event.push(event);
        }
        check_coughs(&config, &entries)?;
        check_order(&config, &entries)?;
        Ok(config)
    }
}

/// Furthest that a cough throws the gut, m (B).
const MOST_COUGH_M: f64 = 0.1;
/// Fastest table, m/s in the mean (B: tables of scanners go at some 0.2).
const MOST_TABLE_M_S: f64 = 1.0;
/// Largest acceleration of a breath, m/s² (B): 30 mm in a second have 1.2.
const MOST_BREATH_M_S2: f64 = 5.0;
/// Largest acceleration of a step, m/s² (B).
const MOST_STEP_M_S2: f64 = 20.0;
/// More events are refused: each costs time at each step.
const MOST_EVENTS: usize = 1000;

fn check_numbers(event: &PatientEvent, entry: &Node) -> Result<(), ConfigError> {
    let range = |key: &str, value: f64, low: f64, high: f64| check_range(entry, key, value, low, high);
    let [from_s, to_s] = event.interval_s();
    range(event.begins(), from_s, 0.0, 1e7)?;
    match event {
        PatientEvent::Posture(turn) => range("duration_s", turn.duration_s.0, 0.5, 1e4),
        PatientEvent::Cough(cough) => {
            range("acceleration_m_s2", cough.acceleration_m_s2.0, 0.0, 50.0)?;
            range("duration_s", cough.duration_s.0, 0.05, 2.0)?;
            // It throws the gut by a d²/24.
            let most_m_s2 = 24.0 * MOST_COUGH_M / cough.duration_s.0.powi(2);
            if cough.acceleration_m_s2.0 > most_m_s2 {
                let message = format!(
                    "{} m/s² over {} s would throw the gut by {:.0} mm; allowed: up to {most_m_s2:.1} (or a shorter `duration_s`)",
                    cough.acceleration_m_s2.0,
                    cough.duration_s.0,
                    1e3 * cough.acceleration_m_s2.0 * cough.duration_s.0.powi(2) / 24.0
                );
                return Err(entry.error_at("acceleration_m_s2", &message));
            }
            let length = cough.direction.iter().map(|d| d.0 * d.0).sum::<f64>().sqrt();
            if (1e-9..=1e9).contains(&length) {
                return Ok(());
            }
            let message =
                format!("has the length {length:e}; give a vector such as [0, 0, 1] (allowed: 1e-9 to 1e9)");
            Err(entry.error_at("direction", &message))
        }
        PatientEvent::Walk(walk) => {
            range("step_frequency_hz", walk.step_frequency_hz.0, 0.2, 5.0)?;
            range("amplitude_mm", walk.amplitude_mm.0, 0.0, 200.0)?;
            range("speed_m_s", walk.speed_m_s.0, 0.0, 3.0)?;
            let rate_rad_s = std::f64::consts::TAU * walk.step_frequency_hz.0;
            let most_mm = 1e3 * MOST_STEP_M_S2 / rate_rad_s.powi(2);
            if walk.amplitude_mm.0 > most_mm {
                let message = format!(
                    "{} mm at {} Hz is more than {MOST_STEP_M_S2} m/s², a runner's; allowed: up to {most_mm:.1}",
                    walk.amplitude_mm.0, walk.step_frequency_hz.0
                );
                return Err(entry.error_at("amplitude_mm", &message));
            }
            range("to_s", to_s, 0.0, 1e7)?;
            if to_s >= from_s + 1.0 {
                return Ok(());
            }
            let message =
                format!("the walk ends at {to_s} s and begins at {from_s} s; allowed: 1 s later, or more");
            Err(entry.error_at("to_s", &message))
        }
        PatientEvent::Table(ride) => {
            ride.by_mm.iter().try_for_each(|by| range("by_mm", by.0, -1e4, 1e4))?;
            range("duration_s", ride.duration_s.0, 0.5, 1e4)?;
            let way_m = 1e-3 * ride.by_mm.iter().map(|by| by.0 * by.0).sum::<f64>().sqrt();
            if way_m <= MOST_TABLE_M_S * ride.duration_s.0 {
                return Ok(());
            }
            let message = format!(
                "{way_m:.2} m in {} s are {:.1} m/s; allowed: up to {MOST_TABLE_M_S}",
                ride.duration_s.0,
                way_m / ride.duration_s.0
            );
            Err(entry.error_at("duration_s", &message))
        }
    }
}

/// Coughs come one after another: their throws would add up.
fn check_coughs(config: &PatientConfig, entries: &[Node]) -> Result<(), ConfigError> {
    let is_cough = |event: &PatientEvent| matches!(event, PatientEvent::Cough(_));
    let mut order: Vec<usize> = (0..entries.len()).filter(|i| is_cough(&config.event[*i])).collect();
    order.sort_by(|a, b| config.event[*a].interval_s()[0].total_cmp(&config.event[*b].interval_s()[0]));
    for pair in order.windows(2) {
        let [[_, free_s], [from_s, _]] = [pair[0], pair[1]].map(|i| config.event[i].interval_s());
        if from_s < free_s {
            let message = format!(
                "begins at {from_s} s, while the cough before it lasts until {free_s} s; allowed: from {free_s} on"
            );
            return Err(entries[pair[1]].error_at(config.event[pair[1]].begins(), &message));
        }
    }
    Ok(())
}

/// Turns and walks come one after another, and who walks stands.
fn check_order(config: &PatientConfig, entries: &[Node]) -> Result<(), ConfigError> {
    let moves = |event: &PatientEvent| matches!(event, PatientEvent::Posture(_) | PatientEvent::Walk(_));
    let mut order: Vec<usize> = (0..entries.len()).filter(|i| moves(&config.event[*i])).collect();
    order.sort_by(|a, b| config.event[*a].interval_s()[0].total_cmp(&config.event[*b].interval_s()[0]));
    let (mut posture, mut free_s) = (config.posture, 0.0);
    for index in order {
        let (event, entry) = (&config.event[index], &entries[index]);
        let [from_s, to_s] = event.interval_s();
        let key = event.begins();
        if from_s < free_s {
            let message = format!(
                "begins at {from_s} s, while the turn or walk before it lasts until {free_s} s; allowed: from {free_s} on"
            );
            return Err(entry.error_at(key, &message));
        }
        free_s = to_s;
        match event {
            PatientEvent::Posture(turn) => posture = turn.to,
            _ if posture != Posture::Upright => {
                let message = format!(
                    "the patient is {} then and cannot walk; allowed: after a `posture` event to \"upright\", or with `posture = \"upright\"` in [patient]",
                    posture.name()
                );
                return Err(entry.error_at(key, &message));
            }
            _ => {}
        }
    }
    Ok(())
}
