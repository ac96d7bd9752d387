//! The tables of a PET sensor in a scenario.
//!
//! `[sensor.installed]` is what both sides know (scanner, how it tells the ends of a line, the body it looks through),
//! `[sensor.reality]` what the world does beyond it (how it is simulated, markers that sit or decay elsewhere than told), and
//! `[track.sensor.<name>]` what an estimator is told to do. The markers stand in the capsule's model: `[[marker]]`.

use crate::markers::{Marker, MarkerSet};
use crate::scanner::{ChangesTable, Scanner};
use crate::simulation::{EndPoints, Isotope, Mode, Scintillator, SourceMarker};
use crate::tracking::mixture::MOST_START_WINDOWS;
use crate::tracking::window::FEWEST_LINES;
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ModalityError, Node, Setup};
use serde::{Deserialize, Serialize};

/// `[sensor.installed]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstalledTable {
    /// Name of a scanner in `models/scanners`, or a path.
    pub scanner: String,
    /// Keys of that file that are replaced; absent: none.
    pub scanner_changes: Option<ChangesTable>,
    /// Name of a phantom in `models/phantoms`, or a path; absent: air.
    pub phantom: Option<String>,
    /// What is told of a line's ends.
    #[serde(default)]
    pub end_points: EndPoints,
    /// Length of a window, ms; absent: the schedule's period. Never longer than that.
    pub window_ms: Option<Positive>,
}

/// `[sensor.reality]`: what the world does that no estimator is told.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealityTable {
    /// How lines are made: `analog`, `forced` or `tabulated`.
    pub mode: Mode,
    /// FWHM of the angle between the photons' directions and a straight line, degrees.
    pub acollinearity_fwhm_deg: NonNegative,
    /// Standard deviation of each marker's misplacement, mm per axis.
    pub marker_placement_sigma_mm: NonNegative,
    /// Misplacement of each marker in the capsule's frame, mm, one after the other; added to the drawn one.
    pub marker_misplacement_mm: Vec<[Finite; 3]>,
    /// Activity of each marker over the one told; absent: as told.
    pub marker_activity_factor: Vec<Positive>,
}

impl Default for RealityTable {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            acollinearity_fwhm_deg: NonNegative(0.5),
            marker_placement_sigma_mm: NonNegative(0.0),
            marker_misplacement_mm: Vec::new(),
            marker_activity_factor: Vec::new(),
        }
    }
}

/// What a front end makes of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// A pose by the mixture's likelihood.
    #[default]
    Mixture,
    /// A pose by the rigid body of than2015, chapter 6.
    Rigid,
    /// A pose by fuzzy C-means, than2015, chapter 3.
    Fcm,
    /// The lines themselves for the filter; a pose only to start from.
    Lines,
    /// The position of one of several independent points (tracer particles, calibration sources).
    Points,
}

impl Output {
    /// As files name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mixture => "mixture",
            Self::Rigid => "rigid",
            Self::Fcm => "fcm",
            Self::Lines => "lines",
            Self::Points => "points",
        }
    }
}

/// Which front ends look at a key; the others would pass it over in silence.
const READ_BY: [(&str, &[Output]); 8] = [
    ("predict_failures", &[Output::Mixture, Output::Lines, Output::Rigid, Output::Fcm]),
    ("estimate_markers", &[Output::Mixture]),
    ("most_lines", &[Output::Mixture, Output::Lines, Output::Rigid, Output::Fcm]),
    ("start_windows", &[Output::Mixture, Output::Lines]),
    ("start_sigma_mm", &[Output::Mixture, Output::Lines]),
    ("start_rate_sigma_rad_s", &[Output::Mixture, Output::Lines]),
    ("points", &[Output::Points]),
    ("point", &[Output::Points]),
];

/// `[track.sensor.<name>]` for a PET sensor.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OptionsTable {
    /// `mixture`, `rigid`, `fcm` (poses), `lines` (for the filter) or `points` (positions of independent points).
    pub front_end: Output,
    /// Whether a pose that is lost, or about to be, is searched for anew: the failure prediction of than2015, section 3.4.4 (`fcm`,
    /// `rigid`), the test of the markers' orders over several windows (`mixture`, `lines`).
    pub predict_failures: bool,
    /// Whether the markers' places in the capsule are estimated on the way (`mixture`).
    pub estimate_markers: bool,
    /// Most lines used of a window; absent: all (`mixture`, `lines`) or the adaptive budget of than2015 (`fcm`, `rigid`).
    pub most_lines: Option<u32>,
    /// Windows, at most, from which a first pose is taken together, 1 to 24 (`mixture`, `lines`). Default 1; with few lines a window, say 5.
    pub start_windows: u32,
    /// A start from several windows waits for no more of them once every marker is told to this standard deviation, mm. Default 0: it waits for
    /// all.
    pub start_sigma_mm: NonNegative,
    /// Standard deviation of the capsule's angular rate before a start from several windows, rad/s per axis: a filter that starts there takes
    /// it from here, not from its own `initial_rate_sigma_rad_s`. Default 0.5.
    pub start_rate_sigma_rad_s: Positive,
    /// How many independent points there are (`points`).
    pub points: u32,
    /// Which of them this track follows, counted from 1 in the order in which they are found: by x, then y, then z (`points`).
    pub point: u32,
}

/// More points than this in one field of view are not told apart.
const MOST_POINTS: u32 = 16;

impl OptionsTable {
    /// Reads and checks the table.
    ///
    /// # Errors
    /// [`ModalityError::Config`] with file, line and key.
    pub fn from_node(node: &Node) -> Result<Self, ModalityError> {
        let table: Self = node.parse_sourced(&OPTIONS_SOURCES)?;
        for (key, front_ends) in READ_BY {
            if node.keys().iter().any(|given| given == key) && !front_ends.contains(&table.front_end) {
                let names: Vec<&str> = front_ends.iter().map(|front_end| front_end.name()).collect();
                let message = format!(
                    "front end `{}` does not look at this; allowed with: {}",
                    table.front_end.name(),
                    names.join(", ")
                );
                return Err(node.error_at(key, &message).into());
            }
        }
        if !(1..=MOST_START_WINDOWS as u32).contains(&table.start_windows) {
            let message = format!("{} windows; allowed: 1 to {MOST_START_WINDOWS}", table.start_windows);
            return Err(node.error_at("start_windows", &message).into());
        }
        for (key, why) in
            [("start_sigma_mm", "waits for no window"), ("start_rate_sigma_rad_s", "tells no motion")]
        {
            if table.start_windows == 1 && node.keys().iter().any(|given| given == key) {
                let message = format!("a start from one window {why}; give `start_windows` above 1");
                return Err(node.error_at(key, &message).into());
            }
        }
        if table.most_lines.is_some_and(|most| most < FEWEST_LINES as u32) {
            let message = format!("allowed: {FEWEST_LINES} or more");
            return Err(node.error_at("most_lines", &message).into());
        }
        if !(1..=MOST_POINTS).contains(&table.points) {
            let message = format!("{} points; allowed: 1 to {MOST_POINTS}", table.points);
            return Err(node.error_at("points", &message).into());
        }
        if !(1..=table.points).contains(&table.point) {
            let message = format!("point {}; allowed: 1 to {} (`points`)", table.point, table.points);
            return Err(node.error_at("point", &message).into());
        }
        Ok(table)
    }
}

impl Default for OptionsTable {
    fn default() -> Self {
        Self {
            front_end: Output::default(),
            predict_failures: true,
            estimate_markers: false,
            most_lines: None,
            start_windows: 1,
            start_sigma_mm: NonNegative(0.0),
            start_rate_sigma_rad_s: Positive(0.5),
            points: 1,
            point: 1,
        }
    }
}

/// Where the defaults of these tables come from: key and source.
pub const INSTALLED_SOURCES: [(&str, &str); 4] = [
    ("scanner_changes", "chosen: the scanner is as its file says"),
    ("phantom", "chosen: nothing around the capsule"),
    ("end_points", "chosen: crystal centres, as list-mode data have them"),
    ("window_ms", "chosen: windows follow each other without a gap"),
];

/// See [`INSTALLED_SOURCES`].
pub const REALITY_SOURCES: [(&str, &str); 5] = [
    ("mode", "chosen: `forced`, unbiased and fast enough for a minute"),
    ("acollinearity_fwhm_deg", "about 0.5 degrees in water, than2015, section 2.2"),
    ("marker_placement_sigma_mm", "chosen: markers sit where the model says unless the scenario says else"),
    ("marker_misplacement_mm", "chosen: markers sit where the model says unless the scenario says else"),
    (
        "marker_activity_factor",
        "chosen: markers are as active as the model says unless the scenario says else",
    ),
];

/// See [`INSTALLED_SOURCES`].
pub const OPTIONS_SOURCES: [(&str, &str); 9] = [
    ("front_end", "chosen: the estimator that gives a covariance"),
    ("predict_failures", "than2015, section 3.4.4: a track that is lost stays lost without it"),
    ("estimate_markers", "chosen: the markers stand where the capsule's model says"),
    ("most_lines", "chosen: no line is thrown away unseen"),
    ("start_windows", "chosen: 284 lines (than2015, table 4.2) tell a first pose"),
    ("start_sigma_mm", "chosen: a start waits for as many windows as are named"),
    ("start_rate_sigma_rad_s", "chosen: the fastest path of than2015 turns by 0.7 rad/s"),
    ("points", "chosen: a single particle"),
    ("point", "chosen: the first that is found"),
];

/// `[sensor.installed]` with its models opened.
#[derive(Clone, Debug)]
pub struct Installed {
    /// The table.
    pub table: InstalledTable,
    /// The scanner.
    pub scanner: Scanner,
    /// Its crystals.
    pub scintillator: Scintillator,
    /// The body, where there is one.
    pub phantom: Option<Phantom>,
}

impl Installed {
    /// Reads the table and the scanner's, scintillator's and phantom's files.
    ///
    /// # Errors
    /// [`ModalityError::Config`] with file, line and key.
    pub fn from_node(node: &Node, setup: &Setup) -> Result<Self, ModalityError> {
        let table: InstalledTable = node.parse_sourced(&INSTALLED_SOURCES)?;
        let file = setup.models.open("scanners", &table.scanner, node, "scanner")?;
        let scanner = Scanner::from_node(&file)?;
        let scanner = match node.child("scanner_changes") {
            Some(changes) => scanner.changed(&file, &changes)?,
            None => scanner,
        };
        let crystals = setup.models.open(
            "scintillators",
            &scanner.detection.scintillator,
            &file.child_or_empty("detection"),
            "scintillator",
        )?;
        let scintillator = Scintillator::from_node(&crystals)?;
        let scanner = scanner.with_interaction_depth(&scintillator);
        let phantom = match &table.phantom {
            Some(name) => Some(Phantom::from_node(&setup.models.open("phantoms", name, node, "phantom")?)?),
            None => None,
        };
        if let Some(block) = phantom.as_ref().and_then(|phantom| scanner.block_inside(phantom)) {
            let message = format!("block {block} of scanner `{}` stands inside this body", scanner.name);
            return Err(node.error_at("phantom", &message).into());
        }
        if let (Some(window), Some(schedule)) = (table.window_ms, setup.schedule) {
            let period_ms = 1e3 / schedule.rate_hz.0;
            if window.0 > period_ms * (1.0 + 1e-9) {
                let message = format!(
                    "a window of {} ms at a period of {period_ms} ms; allowed: up to the period",
                    window.0
                );
                return Err(node.error_at("window_ms", &message).into());
            }
        }
        Ok(Self { table, scanner, scintillator, phantom })
    }
}

/// The isotope of every marker, opened.
///
/// # Errors
/// [`ModalityError::Config`] with file, line and key.
fn isotopes(markers: &MarkerSet, setup: &Setup) -> Result<Vec<Isotope>, ModalityError> {
    let nodes = setup.capsule_model.children("marker")?;
    let open = |(marker, node): (&Marker, &Node)| -> Result<Isotope, ModalityError> {
        Ok(Isotope::from_node(&setup.models.open("isotopes", &marker.isotope, node, "isotope")?)?)
    };
    markers.markers.iter().zip(&nodes).map(open).collect()
}

/// The markers as installed, as sources.
///
/// # Errors
/// [`ModalityError::Config`] with file, line and key.
pub fn sources(markers: &MarkerSet, setup: &Setup) -> Result<Vec<SourceMarker>, ModalityError> {
    let source = |(marker, isotope): (&Marker, Isotope)| SourceMarker {
        position_capsule_m: marker.position_capsule_m,
        activity_bq: marker.activity_bq,
        isotope,
        core_diameter_m: marker.core_diameter_m,
        shell: marker.shell,
    };
    Ok(markers.markers.iter().zip(isotopes(markers, setup)?).map(source).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn law_every_default_has_a_source() {
        let node = Node::parse_text("scanner = \"a\"\n", "s.toml", Path::new(""), &[]).unwrap();
        let _: InstalledTable = node.parse_sourced(&INSTALLED_SOURCES).unwrap();
        let empty = node.child_or_empty("nothing");
        let _: RealityTable = empty.parse_sourced(&REALITY_SOURCES).unwrap();
        let _: OptionsTable = empty.parse_sourced(&OPTIONS_SOURCES).unwrap();
        let rows: Vec<_> = node.log().entries().iter().flat_map(lumenav_core::Resolved::rows).collect();
        assert!(rows.len() >= 10, "{}", rows.len());
        for row in rows {
            assert!(row.set || row.source.is_some(), "{} has no source", row.key);
        }
    }
}
