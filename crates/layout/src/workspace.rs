//! The poses at which a layout is judged: positions times directions of the capsule's axis, or those of a path.

use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::pose::attitude_from_axis;
use lumenav_core::{ConfigError, Node};
use nalgebra::{Isometry3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

/// `[layout.workspace]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkspaceTable {
    /// Coordinates of a grid, mm; all three or `along`.
    pub x_mm: Option<Coordinates>,
    /// See `x_mm`.
    pub y_mm: Option<Coordinates>,
    /// See `x_mm`.
    pub z_mm: Option<Coordinates>,
    /// Positions along the scenario's tract, or the poses of its path, instead of a grid.
    pub along: Option<Along>,
    /// Distance of two positions along the tract, mm. Default 10.
    #[serde(default = "step")]
    pub step_mm: Positive,
    /// Time between two poses of the path, s. Default 0.1.
    #[serde(default = "every")]
    pub every_s: Positive,
    /// Only positions inside an elliptic cylinder about z.
    pub inside: Option<InsideTable>,
    /// Directions of the capsule's axis; absent: as many as `direction_count`, spread evenly over the sphere.
    #[serde(default)]
    pub directions: Vec<[Finite; 3]>,
    /// Default 12.
    #[serde(default = "count")]
    pub direction_count: u32,
}

/// `[layout.workspace.inside]`: an elliptic cylinder about the world's z axis, a torso.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InsideTable {
    /// Half its width, mm.
    pub semi_axis_x_mm: Positive,
    /// Half its depth, mm.
    pub semi_axis_y_mm: Positive,
    /// Least distance from its surface, mm.
    #[serde(default)]
    pub clearance_mm: NonNegative,
}

/// Points of the ellipse that a distance is taken to: their own distance is 2 mm on a torso, the error some micrometres.
const ELLIPSE_POINTS: u32 = 720;

impl InsideTable {
    /// Whether a place is inside, with its clearance.
    fn holds(&self, place_m: &Vector3<f64>) -> bool {
        let (a, b) = (1e-3 * self.semi_axis_x_mm.0, 1e-3 * self.semi_axis_y_mm.0);
        if (place_m.x / a).powi(2) + (place_m.y / b).powi(2) > 1.0 {
            return false;
        }
        let distance = |k: u32| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(ELLIPSE_POINTS);
            (a * angle.cos() - place_m.x).hypot(b * angle.sin() - place_m.y)
        };
        let least = (0..ELLIPSE_POINTS).map(distance).fold(f64::INFINITY, f64::min);
        least >= 1e-3 * self.clearance_mm.0
    }
}

fn step() -> Positive {
    Positive(10.0)
}

fn every() -> Positive {
    Positive(0.1)
}

fn count() -> u32 {
    12
}

/// Where the defaults come from.
pub const WORKSPACE_SOURCES: [(&str, &str); 10] = [
    ("x_mm", "chosen: none, `along` says where"),
    ("y_mm", "chosen: none, `along` says where"),
    ("z_mm", "chosen: none, `along` says where"),
    ("along", "chosen: none, the grid says where"),
    ("step_mm", "chosen: half a capsule's length"),
    ("every_s", "chosen: a capsule at 22 mm/s moves 2.2 mm"),
    ("inside", "chosen: every position of the grid or the tract"),
    ("inside.clearance_mm", "chosen: up to the surface"),
    ("directions", "chosen: spread evenly over the sphere"),
    ("direction_count", "chosen: neighbours are some 60 degrees apart"),
];

/// Coordinates along an axis.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Coordinates {
    /// One by one, ascending.
    List(Vec<Finite>),
    /// Evenly from one to the other, ends included.
    Range {
        /// The first.
        from: Finite,
        /// The last.
        to: Finite,
        /// How many.
        count: u32,
    },
}

/// What positions may follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Along {
    /// The centre line of `[tract]`.
    Tract,
    /// The capsule's own way through the scenario, with its attitudes.
    Path,
}

/// What `along` gave.
#[derive(Clone, Debug, PartialEq)]
pub enum Followed {
    /// Places, to be combined with directions, m.
    Positions(Vec<Vector3<f64>>),
    /// Poses as they are.
    Poses(Vec<Isometry3<f64>>),
}

/// The grid that positions stand on.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Coordinates along x, y and z, m.
    pub axes_m: [Vec<f64>; 3],
    /// Number of each of the workspace's positions on the grid, x fastest; ascending.
    pub kept: Vec<usize>,
}

/// Poses to judge a layout at.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// The positions, m; of a grid x runs fastest.
    pub positions_m: Vec<Vector3<f64>>,
    /// The directions, unit; of a path's poses, which have their own, one that counts for nothing.
    pub directions: Vec<Vector3<f64>>,
    /// The poses of a path, one per position; empty elsewhere.
    pub path: Vec<Isometry3<f64>>,
    /// The grid, where there is one.
    pub grid: Option<Grid>,
}

/// More poses than this are a typing error.
const MOST_POSES: usize = 20_000_000;
const MOST_COORDINATES: u32 = 10_000;

impl Workspace {
    /// Reads the table; `along` gives what follows the tract or the path.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key, or what `along` says.
    pub fn from_node<E: From<ConfigError>>(
        node: &Node,
        along: impl FnOnce(&WorkspaceTable, Along) -> Result<Followed, E>,
    ) -> Result<Self, E> {
        let table: WorkspaceTable = node.parse_sourced(&WORKSPACE_SOURCES)?;
        let mut directions = directions(&table, node)?;
        let mut path = Vec::new();
        let axes = [("x_mm", &table.x_mm), ("y_mm", &table.y_mm), ("z_mm", &table.z_mm)];
        let (positions_m, grid) = match (table.along, axes.iter().find(|(_, given)| given.is_some())) {
            (Some(_), Some((key, _))) => {
                return Err(node.error_at(key, "a grid and `along` at once; give one of them").into());
            }
            (Some(what), None) => match along(&table, what)? {
                Followed::Positions(mut all) => {
                    all.retain(|p| table.inside.is_none_or(|inside| inside.holds(p)));
                    (all, None)
                }
                Followed::Poses(poses) => {
                    let is_kept = |p: &Isometry3<f64>| {
                        table.inside.is_none_or(|inside| inside.holds(&p.translation.vector))
                    };
                    path = poses.into_iter().filter(is_kept).collect();
                    directions = vec![Vector3::x()];
                    (path.iter().map(|p| p.translation.vector).collect(), None)
                }
            },
            (None, _) => {
                let mut axes_m: [Vec<f64>; 3] = Default::default();
                for ((key, given), out) in axes.into_iter().zip(&mut axes_m) {
                    let Some(given) = given else {
                        let message = "missing; give x_mm, y_mm and z_mm, or along = \"tract\" or \"path\"";
                        return Err(node.error_at(key, message).into());
                    };
                    *out = given.metres().map_err(|message| node.error_at(key, &message))?;
                }
                let mut grid = Grid { axes_m, kept: Vec::new() };
                let all = grid.positions_m();
                let is_kept = |p: &Vector3<f64>| table.inside.is_none_or(|inside| inside.holds(p));
                grid.kept = (0..all.len()).filter(|i| is_kept(&all[*i])).collect();
                (grid.kept.iter().map(|i| all[*i]).collect(), Some(grid))
            }
        };
        let poses = positions_m.len() * directions.len();
        if positions_m.is_empty() || poses > MOST_POSES {
            return Err(node.error(&format!("{poses} poses; 1 to {MOST_POSES} are allowed")).into());
        }
        Ok(Self { positions_m, directions, path, grid })
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.positions_m.len() * self.directions.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Pose `i`: the directions of one position stand together.
    pub fn pose(&self, i: usize) -> Isometry3<f64> {
        if let Some(pose) = self.path.get(i) {
            return *pose;
        }
        let (position, direction) = (i / self.directions.len(), i % self.directions.len());
        Isometry3::from_parts(
            Translation3::from(self.positions_m[position]),
            attitude_from_axis(&self.directions[direction]),
        )
    }

    /// All poses.
    pub fn poses(&self) -> Vec<Isometry3<f64>> {
        (0..self.len()).map(|i| self.pose(i)).collect()
    }
}

impl Grid {
    /// All its points, x fastest.
    pub fn positions_m(&self) -> Vec<Vector3<f64>> {
        let [xs, ys, zs] = &self.axes_m;
        let mut all = Vec::with_capacity(xs.len() * ys.len() * zs.len());
        for z in zs {
            for y in ys {
                all.extend(xs.iter().map(|x| Vector3::new(*x, *y, *z)));
            }
        }
        all
    }
}

impl Coordinates {
    fn metres(&self) -> Result<Vec<f64>, String> {
        let values: Vec<f64> = match self {
            Self::List(list) => list.iter().map(|v| 1e-3 * v.0).collect(),
            Self::Range { from, to, count } => {
                if !(1..=MOST_COORDINATES).contains(count) {
                    return Err(format!("{count} coordinates; 1 to {MOST_COORDINATES} are allowed"));
                }
                let step = if *count > 1 { (to.0 - from.0) / f64::from(count - 1) } else { 0.0 };
                (0..*count).map(|i| 1e-3 * (from.0 + step * f64::from(i))).collect()
            }
        };
        if values.is_empty() || values.windows(2).any(|pair| pair[1] <= pair[0]) {
            return Err("coordinates in ascending order, at least one".to_owned());
        }
        Ok(values)
    }
}

fn directions(table: &WorkspaceTable, node: &Node) -> Result<Vec<Vector3<f64>>, ConfigError> {
    if table.directions.is_empty() {
        if !(1..=MOST_COORDINATES).contains(&table.direction_count) {
            let message =
                format!("{} directions; 1 to {MOST_COORDINATES} are allowed", table.direction_count);
            return Err(node.error_at("direction_count", &message));
        }
        return Ok(spread(table.direction_count));
    }
    let unit = |given: &[Finite; 3]| {
        Vector3::from(given.map(|v| v.0))
            .try_normalize(f64::MIN_POSITIVE)
            .filter(|v| v.iter().all(|c| c.is_finite()))
    };
    let all: Option<Vec<Vector3<f64>>> = table.directions.iter().map(unit).collect();
    all.ok_or_else(|| {
        node.error_at("directions", "a direction of length zero; give vectors such as [1, 0, 0]")
    })
}

/// Directions spread evenly over the sphere (Fibonacci spiral: equal areas, turned by the golden angle).
fn spread(count: u32) -> Vec<Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
            let radius = (1.0 - z * z).max(0.0).sqrt();
            let angle = golden * f64::from(i);
            Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn read(text: &str) -> Result<Workspace, ConfigError> {
        let node = Node::parse_text(text, "w.toml", Path::new(""), &[]).unwrap();
        Workspace::from_node(&node, |table, along| {
            let at = Vector3::new(1e-3 * table.step_mm.0, 0.0, 0.0);
            Ok(match along {
                Along::Tract => Followed::Positions(vec![at]),
                Along::Path => Followed::Poses(vec![Translation3::from(at).into(); 3]),
            })
        })
    }

    #[test]
    fn law_a_grid_times_directions() {
        let read_ok = read("x_mm = [-200, 0, 200]\ny_mm = [0]\nz_mm = { from = 100, to = 400, count = 4 }\ndirections = [[2, 0, 0], [0, 1, 1]]\n").unwrap();
        assert_eq!(read_ok.len(), 24);
        assert_eq!(read_ok.positions_m[4], Vector3::new(0.0, 0.0, 0.2));
        let pose = read_ok.pose(9);
        assert!((pose * Vector3::x() - Vector3::new(0.0, 1.0, 1.0).normalize()).norm() < 1e-12);
        let spread = read("along = \"tract\"\nstep_mm = 5\n").unwrap();
        assert_eq!(spread.len(), 12);
        assert_eq!(read("along = \"path\"\nstep_mm = 7\n").unwrap().poses()[2].translation.x, 7e-3);
        // Evenly: their mean is nearly nothing.
        assert!(spread.directions.iter().sum::<Vector3<f64>>().norm() < 0.1 * 12.0);
    }

    /// A circle of 100 mm with 30 mm of clearance holds what is within 70 mm.
    #[test]
    fn closed_form_inside_with_clearance() {
        let kept = read("x_mm = [-90, -69, 0, 69, 71]\ny_mm = [0, 69]\nz_mm = [0]\ninside = { semi_axis_x_mm = 100, semi_axis_y_mm = 100, clearance_mm = 30 }\n").unwrap();
        assert_eq!(kept.grid.unwrap().kept, [1, 2, 3, 7]);
        let none = read(
            "x_mm = [200]\ny_mm = [0]\nz_mm = [0]\ninside = { semi_axis_x_mm = 100, semi_axis_y_mm = 100 }\n",
        );
        assert!(none.unwrap_err().to_string().contains("0 poses"));
    }

    #[test]
    fn law_bad_tables_name_their_key() {
        for (text, wanted) in [
            ("x_mm = [0]\n", "y_mm"),
            ("x_mm = [1, 0]\ny_mm = [0]\nz_mm = [0]\n", "ascending"),
            ("along = \"tract\"\nx_mm = [0]\n", "at once"),
            ("along = \"tract\"\ndirections = [[0, 0, 0]]\n", "length zero"),
            ("along = \"tract\"\ndirection_count = 0\n", "1 to 10000"),
            ("x_mm = { from = 0, to = 1, count = 0 }\ny_mm = [0]\nz_mm = [0]\n", "coordinates"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(wanted), "{text}: {error}");
        }
    }
}
