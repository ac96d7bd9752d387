//! `[layout]`: what a scenario says about the design of a sensor's layout.
//!
//! ```toml
//! [layout]
//! sensor = "belt"
//! wanted_mm = 1.0
//! [layout.workspace]          # see `workspace`
//! [layout.model]              # the modality's own: what is unknown, candidates
//! [layout.optimize]
//! criterion = "rms"
//! count = 16
//! [layout.motion]             # of a path: how a filter believes that the capsule moves; see `core::MotionModel`
//! [[layout.alternative]]      # what `layout compare` sets beside it
//! name = "two planes"
//! set = ["sensor.belt.installed.array=two-planes"]
//! ```

use crate::criterion::Criterion;
use crate::optimize::moving::Ranges;
use crate::optimize::{KeepOut, Sites};
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, MotionModel, Node};
use nalgebra::Vector3;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LayoutTable {
    sensor: Option<String>,
    #[serde(default = "wanted")]
    wanted_mm: Positive,
    #[serde(default = "dead")]
    dead: u32,
    #[serde(rename = "workspace", skip_serializing, default)]
    _workspace: Option<IgnoredAny>,
    #[serde(rename = "model", skip_serializing, default)]
    _model: Option<IgnoredAny>,
    #[serde(rename = "optimize", skip_serializing, default)]
    _optimize: Option<IgnoredAny>,
    #[serde(rename = "motion", skip_serializing, default)]
    _motion: Option<IgnoredAny>,
    #[serde(rename = "alternative", skip_serializing, default)]
    _alternative: Option<IgnoredAny>,
}

fn wanted() -> Positive {
    Positive(1.0)
}

fn dead() -> u32 {
    2
}

const LAYOUT_SOURCES: [(&str, &str); 3] = [
    ("sensor", "chosen: the scenario's only sensor"),
    ("wanted_mm", "chosen: the project's aim, a millimetre"),
    ("dead", "chosen: one cable and one more"),
];

/// Names of the criteria.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CriterionName {
    /// A-optimality.
    #[default]
    Rms,
    /// Mean error.
    Mean,
    /// Largest error.
    Worst,
    /// See `p`.
    PNorm,
    /// D-optimality.
    D,
    /// E-optimality.
    E,
}

/// An axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisName {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

/// A ball in which no element may stand.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeepOutTable {
    /// Its centre, mm.
    pub centre_mm: [Finite; 3],
    /// Its radius, mm.
    pub radius_mm: Positive,
}

/// `[layout.optimize]`. With a range along an axis the installed elements move; without, the model's candidates are chosen from.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OptimizeTable {
    /// What is minimised.
    pub criterion: CriterionName,
    /// Exponent of the p-norm.
    pub p: Positive,
    /// How many elements are chosen; absent: as many as are installed.
    pub count: Option<u32>,
    /// Starts of the search.
    pub starts: u32,
    /// Seed of the starts.
    pub seed: u64,
    /// Least distance of two elements, mm.
    pub spacing_mm: NonNegative,
    /// Balls in which no element may stand.
    pub keep_out: Vec<KeepOutTable>,
    /// Mirror planes through the origin, each by the axis that it turns round: the layout is its own image.
    pub mirror: Vec<AxisName>,
    /// Range in which the elements move along x, mm.
    pub x_mm: Option<[Finite; 2]>,
    /// Along y.
    pub y_mm: Option<[Finite; 2]>,
    /// Along z.
    pub z_mm: Option<[Finite; 2]>,
}

impl Default for OptimizeTable {
    fn default() -> Self {
        Self {
            criterion: CriterionName::Rms,
            p: Positive(16.0),
            count: None,
            starts: 8,
            seed: 1,
            spacing_mm: NonNegative(0.0),
            keep_out: Vec::new(),
            mirror: Vec::new(),
            x_mm: None,
            y_mm: None,
            z_mm: None,
        }
    }
}

const OPTIMIZE_SOURCES: [(&str, &str); 11] = [
    ("criterion", "chosen: the root mean square error"),
    ("p", "chosen: near the largest error"),
    ("count", "the installed array"),
    ("starts", "chosen: the best of eight"),
    ("seed", "chosen: any number serves"),
    ("spacing_mm", "chosen: sensors are points"),
    ("keep_out", "chosen: none"),
    ("mirror", "chosen: none"),
    ("x_mm", "chosen: stays where it is installed"),
    ("y_mm", "chosen: stays where it is installed"),
    ("z_mm", "chosen: stays where it is installed"),
];

/// `[[layout.alternative]]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlternativeTable {
    /// What it is called.
    pub name: String,
    /// What it replaces in the scenario, as `--set` does.
    pub set: Vec<String>,
}

/// What is asked of `layout optimize`.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// What is minimised.
    pub criterion: Criterion,
    /// How many elements are chosen.
    pub count: Option<usize>,
    /// Starts of the search.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// What a layout has to keep.
    pub sites: Sites,
    /// Where elements move; `None`: candidates are chosen from.
    pub ranges: Option<Ranges>,
}

/// `[layout]` as read.
#[derive(Clone, Debug)]
pub struct Study {
    /// The sensor it is about; absent: the scenario's only one.
    pub sensor: Option<String>,
    /// The wanted error, mm.
    pub wanted_mm: f64,
    /// Up to how many elements die.
    pub dead: usize,
    /// `[layout.workspace]`.
    pub workspace: Node,
    /// `[layout.model]`, the plugin's.
    pub model: Node,
    /// `[layout.optimize]`.
    pub search: Search,
    /// `[layout.motion]`: how a filter believes that the capsule moves, for the posterior bound.
    pub motion: MotionModel,
    /// Every `[[layout.alternative]]`.
    pub alternatives: Vec<AlternativeTable>,
    /// The table itself, for messages.
    pub node: Node,
}

/// More starts than this are a typing error.
const MOST_STARTS: u32 = 100_000;

impl Study {
    /// Reads `[layout]`.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(node: Node) -> Result<Self, ConfigError> {
        let table: LayoutTable = node.parse_sourced(&LAYOUT_SOURCES)?;
        if table.dead > 8 {
            return Err(node.error_at("dead", &format!("{} dead elements; 0 to 8 are allowed", table.dead)));
        }
        let alternatives: Result<Vec<AlternativeTable>, ConfigError> =
            node.children("alternative")?.iter().map(Node::parse).collect();
        Ok(Self {
            sensor: table.sensor,
            wanted_mm: table.wanted_mm.0,
            dead: table.dead as usize,
            workspace: node.child_or_empty("workspace"),
            model: node.child_or_empty("model"),
            search: Search::from_node(&node.child_or_empty("optimize"))?,
            motion: node.child_or_empty("motion").parse()?,
            alternatives: alternatives?,
            node,
        })
    }
}

impl Search {
    fn from_node(node: &Node) -> Result<Self, ConfigError> {
        let table: OptimizeTable = node.parse_sourced(&OPTIMIZE_SOURCES)?;
        if !(1..=MOST_STARTS).contains(&table.starts) {
            return Err(
                node.error_at("starts", &format!("{} starts; 1 to {MOST_STARTS} are allowed", table.starts))
            );
        }
        if table.criterion == CriterionName::PNorm && !(1.0..=1000.0).contains(&table.p.0) {
            return Err(node.error_at("p", &format!("{} is no exponent; 1 to 1000 are allowed", table.p.0)));
        }
        let range = |key: &str, given: &Option<[Finite; 2]>| match given {
            None => Ok(None),
            Some([low, high]) if low.0 < high.0 => Ok(Some([1e-3 * low.0, 1e-3 * high.0])),
            Some(_) => {
                Err(node.error_at(key, "a range from the lower to the higher end, such as [-250, 250]"))
            }
        };
        let axes_m = [range("x_mm", &table.x_mm)?, range("y_mm", &table.y_mm)?, range("z_mm", &table.z_mm)?];
        let moves = axes_m.iter().any(Option::is_some);
        if moves && table.count.is_some() {
            let message = "the installed elements move, all of them; leave `count` out, or the ranges";
            return Err(node.error_at("count", message));
        }
        Ok(Self {
            criterion: match table.criterion {
                CriterionName::Rms => Criterion::Rms,
                CriterionName::Mean => Criterion::Mean,
                CriterionName::Worst => Criterion::Worst,
                CriterionName::PNorm => Criterion::PNorm(table.p.0),
                CriterionName::D => Criterion::D,
                CriterionName::E => Criterion::E,
            },
            count: table.count.map(|c| c as usize),
            starts: table.starts as usize,
            seed: table.seed,
            sites: sites_of(&table),
            ranges: moves.then_some(Ranges { axes_m }),
        })
    }
}

fn sites_of(table: &OptimizeTable) -> Sites {
    let ball = |t: &KeepOutTable| KeepOut {
        centre_m: Vector3::from(t.centre_mm.map(|v| v.0)) * 1e-3,
        radius_m: 1e-3 * t.radius_mm.0,
    };
    let mut mirrored: Vec<usize> = table.mirror.iter().map(|axis| *axis as usize).collect();
    mirrored.sort_unstable();
    mirrored.dedup();
    Sites {
        spacing_m: 1e-3 * table.spacing_mm.0,
        keep_out: table.keep_out.iter().map(ball).collect(),
        mirrored,
    }
}
