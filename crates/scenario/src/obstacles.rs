//! `[[tract.obstacle]]`: polyps, strictures and plates, rigid and fast to the tract.
//!
//! A polyp is a ball whose centre lies on the resting wall. A stricture is a disc of balls across the lumen that leaves a round opening: rings from
//! the opening out to the resting wall. Those of the first stand so close that the opening's radius is true within `t (1 - sqrt(3)/2)`, t half of
//! the thickness. A plate stands on the wall, across the
//! lumen. The capsule meets them as rapier's colliders ([`Obstacle`]); the wall around them moves as it would without.

use crate::engine::Obstacle;
use crate::places::arc_length_m;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, Node, Primitive};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Colour of obstacles.
const RGBA: u32 = 0xAA33_77FF;

/// `[[tract.obstacle]]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleTable {
    /// What it is.
    pub kind: ObstacleKind,
    /// The segment from whose oral end `at_mm` counts; the tract's start where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<SegmentKey>,
    /// Where, mm along the centre line.
    pub at_mm: NonNegative,
    /// Where around the lumen, degrees from the centre line's normal (polyp, plate). Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<Finite>,
    /// Radius of a polyp, or of a stricture's opening, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<Positive>,
    /// How far a plate stands into the lumen, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_mm: Option<Positive>,
    /// Thickness of a stricture, or of a plate, along the lumen, mm, 1 to 30. Default 3.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_mm: Option<Positive>,
}

/// Kinds of obstacles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObstacleKind {
    /// A ball on the wall.
    Polyp,
    /// A ring with an opening.
    Stricture,
    /// A plate on the wall.
    Plate,
}

/// Thickness along the lumen where none is given, and what it may be, mm.
const USUAL_THICKNESS_MM: f64 = 3.0;
const THICKNESSES_MM: std::ops::RangeInclusive<f64> = 1.0..=30.0;

impl ObstacleTable {
    /// The rigid things it is made of, in the tract's frame. `node` is its table.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key: not in the tract, a size that its kind does not have or lacks.
    pub fn place(&self, tract: &Tract, node: &Node) -> Result<Vec<Obstacle>, ConfigError> {
        let s_m = arc_length_m(self.segment, self.at_mm, tract, node)?;
        let size_m = 1e-3 * self.size_mm(node)?;
        let wall_m = tract.radius.radius_m(s_m);
        let thickness_m = 1e-3 * self.thickness_mm.map_or(USUAL_THICKNESS_MM, |t| t.0);
        // An opening as wide as the lumen is none.
        let (key, most_m) = match self.kind {
            ObstacleKind::Polyp => ("radius_mm", 2.0 * wall_m),
            ObstacleKind::Stricture => ("radius_mm", wall_m),
            ObstacleKind::Plate => ("height_mm", 2.0 * wall_m),
        };
        if size_m >= most_m {
            let message = format!(
                "the lumen's radius is {:.1} mm there; allowed: below {:.1}",
                1e3 * wall_m,
                1e3 * most_m
            );
            return Err(node.error_at(key, &message));
        }
        let station = tract.station(s_m);
        let outwards = |angle: f64| station.normal * angle.cos() + station.binormal * angle.sin();
        let angle = self.angle_deg.map_or(0.0, |angle| angle.0.to_radians());
        Ok(match self.kind {
            ObstacleKind::Polyp => {
                vec![ball(station.position_m + outwards(angle) * wall_m, size_m)]
            }
            ObstacleKind::Stricture => {
                let half_m = 0.5 * thickness_m;
                let rings = ((wall_m - size_m) / thickness_m).ceil() as usize;
                let place =
                    |(ring_m, way): (f64, f64)| ball(station.position_m + outwards(way) * ring_m, half_m);
                (0..rings).flat_map(|ring| ring_of_balls(size_m, half_m, ring)).map(place).collect()
            }
            ObstacleKind::Plate => {
                let (up, along) = (-outwards(angle), station.tangent);
                let turn = Matrix3::from_columns(&[along, up, along.cross(&up)]);
                let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
                let centre = station.position_m - up * (wall_m - 0.5 * size_m);
                vec![Obstacle::Plate {
                    torso_from_plate: Isometry3::from_parts(Translation3::from(centre.coords), rotation),
                    half_extents_m: Vector3::new(0.5 * thickness_m, 0.5 * size_m, wall_m),
                }]
            }
        })
    }

    /// The size that its kind has, mm; keys that it has not are refused.
    fn size_mm(&self, node: &Node) -> Result<f64, ConfigError> {
        let (asked, size, others): (_, _, &[(&str, bool)]) = match self.kind {
            ObstacleKind::Polyp => (
                "radius_mm",
                self.radius_mm,
                &[("height_mm", self.height_mm.is_some()), ("thickness_mm", self.thickness_mm.is_some())],
            ),
            ObstacleKind::Stricture => (
                "radius_mm",
                self.radius_mm,
                &[("height_mm", self.height_mm.is_some()), ("angle_deg", self.angle_deg.is_some())],
            ),
            ObstacleKind::Plate => ("height_mm", self.height_mm, &[("radius_mm", self.radius_mm.is_some())]),
        };
        if let Some((key, _)) = others.iter().find(|(_, is_set)| *is_set) {
            return Err(node.error_at(key, &format!("this kind has none; its size is `{asked}`")));
        }
        if let Some(thickness_mm) = self.thickness_mm.filter(|t| !THICKNESSES_MM.contains(&t.0)) {
            let (low, high) = (THICKNESSES_MM.start(), THICKNESSES_MM.end());
            let message = format!("{} mm is no obstacle's; allowed: {low} to {high}", thickness_mm.0);
            return Err(node.error_at("thickness_mm", &message));
        }
        size.map(|size| size.0).ok_or_else(|| node.error_at("kind", &format!("this kind needs `{asked}`")))
    }
}

/// Radius (m) and angle of the balls of one ring around an opening: the first half a ball apart, the others touching.
fn ring_of_balls(opening_m: f64, half_m: f64, ring: usize) -> impl Iterator<Item = (f64, f64)> {
    let ring_m = opening_m + half_m * (2 * ring + 1) as f64;
    let apart_m = if ring == 0 { half_m } else { 2.0 * half_m };
    let count = (std::f64::consts::TAU * ring_m / apart_m).ceil();
    (0..count as usize).map(move |k| (ring_m, std::f64::consts::TAU * k as f64 / count))
}

fn ball(centre_torso_m: Point3<f64>, radius_m: f64) -> Obstacle {
    Obstacle::Ball { centre_torso_m, radius_m }
}

/// All obstacles of `[tract]`, in the order of the file.
///
/// # Errors
/// As [`ObstacleTable::place`].
pub(crate) fn place_all(
    tables: &[ObstacleTable],
    tract: &Tract,
    node: &Node,
) -> Result<Vec<Vec<Obstacle>>, ConfigError> {
    let nodes = node.children("obstacle")?;
    tables.iter().zip(&nodes).map(|(table, node)| table.place(tract, node)).collect()
}

/// Draws them.
pub(crate) fn draw(all: &[Vec<Obstacle>], out: &mut Vec<Primitive>) {
    for (index, one) in all.iter().enumerate() {
        let path = format!("tract/obstacle/{index}");
        let single = |p: &Point3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        match one.first() {
            Some(Obstacle::Ball { radius_m, .. }) => {
                let centres = one.iter().filter_map(|part| match part {
                    Obstacle::Ball { centre_torso_m, .. } => Some(single(centre_torso_m)),
                    Obstacle::Plate { .. } => None,
                });
                out.push(Primitive::Points {
                    path,
                    positions_world_m: centres.collect(),
                    rgba: vec![RGBA],
                    radius_m: *radius_m as f32,
                });
            }
            Some(Obstacle::Plate { torso_from_plate, half_extents_m: h }) => {
                let corner = |k: u32| {
                    let sign = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
                    single(&(torso_from_plate * Point3::new(sign(0) * h.x, sign(1) * h.y, sign(2) * h.z)))
                };
                let faces =
                    [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
                let triangles = faces.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
                let vertices_world_m = (0..8).map(corner).collect();
                out.push(Primitive::Mesh { path, vertices_world_m, triangles, rgba: vec![RGBA] });
            }
            None => {}
        }
    }
}
