//! `[[tract.loose]]` and `[tract.tether]`: what is loose in the tract beside the capsule.

use crate::engine::{DENSITIES_KG_M3, Engine, EngineError, Loose, Tether, ends_of};
use crate::places::arc_length_m;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_core::config::quantity::{NonNegative, Positive};
use lumenav_core::{CapsuleBody, ConfigError, Node, Primitive};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Density of residue where none is given, kg/m³: a little above that of water, so that it sinks (B).
const RESIDUE_KG_M3: f64 = 1050.0;
/// Radii of residue, mm: grains of less move with the water.
const RESIDUES_MM: std::ops::RangeInclusive<f64> = 0.5..=20.0;

const RESIDUE_RGBA: u32 = 0xAA77_33FF;
const CAPSULE_RGBA: u32 = 0x8888_88FF;
const TETHER_RGBA: u32 = 0xEEEE_EEFF;

/// `[[tract.loose]]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LooseTable {
    /// What it is.
    pub kind: LooseKind,
    /// The segment from whose oral end `at_mm` counts; the tract's start where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<SegmentKey>,
    /// Where it starts, mm along the centre line.
    pub at_mm: NonNegative,
    /// Radius of residue, mm, 0.5 to 20; of a second capsule where it is another than the capsule's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<Positive>,
    /// Density of residue, kg/m³. Default 1050 (B).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_kg_m3: Option<Positive>,
    /// Length of a second capsule, mm. Default the capsule's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_mm: Option<Positive>,
    /// Mass of a second capsule, g. Default the capsule's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_g: Option<Positive>,
}

/// Kinds of loose things.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LooseKind {
    /// A ball of what the bowel still holds.
    Residue,
    /// A second capsule.
    Capsule,
}

impl LooseTable {
    /// The body in the tract, beside a capsule of this body. `node` is its table.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key: not in the tract, a size that its kind has not or lacks.
    pub fn place(&self, tract: &Tract, capsule: &CapsuleBody, node: &Node) -> Result<Loose, ConfigError> {
        let arc_length_m = arc_length_m(self.segment, self.at_mm, tract, node)?;
        let shape = match self.kind {
            LooseKind::Residue => self.ball(node)?,
            LooseKind::Capsule => self.second(capsule, node)?,
        };
        Ok(Loose { shape, arc_length_m })
    }

    fn ball(&self, node: &Node) -> Result<CapsuleBody, ConfigError> {
        for (key, is_set) in [("length_mm", self.length_mm.is_some()), ("mass_g", self.mass_g.is_some())] {
            if is_set {
                return Err(node.error_at(key, "residue has none; it has `radius_mm` and `density_kg_m3`"));
            }
        }
        let radius_mm = self.radius_mm.ok_or_else(|| node.error_at("kind", "residue needs `radius_mm`"))?.0;
        if !RESIDUES_MM.contains(&radius_mm) {
            let (low, high) = (RESIDUES_MM.start(), RESIDUES_MM.end());
            return Err(node.error_at("radius_mm", &format!("{radius_mm} mm; allowed: {low} to {high}")));
        }
        let density_kg_m3 = self.density_kg_m3.map_or(RESIDUE_KG_M3, |density| density.0);
        let [low, high] = DENSITIES_KG_M3;
        if !(low..=high).contains(&density_kg_m3) {
            let message = format!("{density_kg_m3} kg/m³; allowed: {low} to {high}");
            return Err(node.error_at("density_kg_m3", &message));
        }
        let radius_m = 1e-3 * radius_mm;
        let mass_kg = density_kg_m3 * 4.0 / 3.0 * PI * radius_m * radius_m * radius_m;
        Ok(CapsuleBody { radius_m, length_m: 2.0 * radius_m, mass_kg })
    }

    fn second(&self, capsule: &CapsuleBody, node: &Node) -> Result<CapsuleBody, ConfigError> {
        if self.density_kg_m3.is_some() {
            return Err(node.error_at("density_kg_m3", "a capsule has none; it has `mass_g`"));
        }
        // As those of the capsule itself.
        for (key, set, low, high) in [
            ("radius_mm", self.radius_mm, 0.05, 50.0),
            ("length_mm", self.length_mm, 0.1, 1000.0),
            ("mass_g", self.mass_g, 1e-3, 1e4),
        ] {
            if let Some(value) = set.filter(|value| !(low..=high).contains(&value.0)) {
                return Err(node.error_at(key, &format!("{}; allowed: {low} to {high}", value.0)));
            }
        }
        let or = |set: Option<Positive>, usual: f64| set.map_or(usual, |value| 1e-3 * value.0);
        let body = CapsuleBody {
            radius_m: or(self.radius_mm, capsule.radius_m),
            length_m: or(self.length_mm, capsule.length_m),
            mass_kg: or(self.mass_g, capsule.mass_kg),
        };
        if body.length_m <= 2.0 * body.radius_m {
            let widest_mm = 1e3 * body.length_m;
            let key = if self.length_mm.is_some() { "length_mm" } else { "radius_mm" };
            let message = format!("a capsule is longer than wide; its length is {widest_mm:.1} mm");
            return Err(node.error_at(key, &message));
        }
        Ok(body)
    }
}

/// `[tract.tether]`: a string from the capsule's tip towards the mouth.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TetherTable {
    /// Length, mm. It has to lie in the tract behind the capsule at the start.
    pub length_mm: Positive,
    /// Radius, mm. Default 1.
    #[serde(default = "radius_mm")]
    pub radius_mm: Positive,
    /// Length of a link of the chain it is made of, mm, at most. Default 20.
    #[serde(default = "link_mm")]
    pub link_mm: Positive,
    /// Density, kg/m³. Default 1200.
    #[serde(default = "density_kg_m3")]
    pub density_kg_m3: Positive,
    /// Whether its oral end is held where it is at the start. Default true.
    #[serde(default = "held")]
    pub held: bool,
}

fn radius_mm() -> Positive {
    Positive(1.0)
}

fn link_mm() -> Positive {
    Positive(20.0)
}

fn density_kg_m3() -> Positive {
    Positive(1200.0)
}

fn held() -> bool {
    true
}

impl TetherTable {
    fn tether(&self) -> Tether {
        Tether {
            length_m: 1e-3 * self.length_mm.0,
            radius_m: 1e-3 * self.radius_mm.0,
            link_m: 1e-3 * self.link_mm.0,
            density_kg_m3: self.density_kg_m3.0,
            held: self.held,
        }
    }
}

/// Puts all that is loose beside the capsule. `node` is `[tract]`.
///
/// # Errors
/// [`ConfigError`] with file, line and key.
pub(crate) fn insert_all(
    engine: &mut Engine,
    tables: &[LooseTable],
    tether: Option<&TetherTable>,
    capsule: &CapsuleBody,
    node: &Node,
) -> Result<(), ConfigError> {
    for (table, node) in tables.iter().zip(&node.children("loose")?) {
        let loose = table.place(engine.tract(), capsule, node)?;
        engine.insert_loose(&loose).map_err(|error| node.error_at("at_mm", &error.to_string()))?;
    }
    if let Some(table) = tether {
        let node = node.child_or_empty("tether");
        engine.attach_tether(&table.tether()).map_err(|error| at_tether(&error, &node))?;
    }
    Ok(())
}

/// The error at the key of the table, in its unit.
fn at_tether(error: &EngineError, node: &Node) -> ConfigError {
    let EngineError::OutOfRange { name, value, low, high } = error else {
        return node.error_at("length_mm", &error.to_string());
    };
    let (key, unit) = match *name {
        "radius_m" => ("radius_mm", 1e3),
        "link_m" => ("link_mm", 1e3),
        "length_m" => ("length_mm", 1e3),
        other => (other, 1.0),
    };
    let message = if high < low {
        "there is no room for it between the mouth's end of the tract and the capsule; start the capsule further on".to_owned()
    } else {
        format!(
            "{:.4} is not allowed here; it must be from {:.4} to {:.4}",
            unit * value,
            unit * low,
            unit * high
        )
    };
    node.error_at(key, &message)
}

/// Draws it all where it is now, in the tract's frame.
pub(crate) fn draw(engine: &Engine, loose: &[LooseTable], has_tether: bool, out: &mut Vec<Primitive>) {
    let single = |p: &Point3<f64>| [p.x as f32, p.y as f32, p.z as f32];
    let mut bodies = engine.loose();
    for (index, (table, (shape, pose, _))) in loose.iter().zip(bodies.by_ref()).enumerate() {
        let path = format!("tract/loose/{index}");
        let radius_m = shape.radius_m as f32;
        // A capsule as balls along its cylinder, which overlap.
        let half_m = 0.5 * shape.length_m - shape.radius_m;
        let (balls, colour) = match table.kind {
            LooseKind::Residue => (vec![0.0], RESIDUE_RGBA),
            LooseKind::Capsule => ((-8..=8).map(|k| half_m * f64::from(k) / 8.0).collect(), CAPSULE_RGBA),
        };
        let centres = balls.iter().map(|x| single(&(pose * Point3::new(*x, 0.0, 0.0))));
        out.push(Primitive::Points {
            path,
            positions_world_m: centres.collect(),
            rgba: vec![colour],
            radius_m,
        });
    }
    if has_tether {
        let ends = bodies.map(|(shape, pose, _)| single(&ends_of(&shape, &pose)[1]));
        let strip = std::iter::once(single(&engine.oral_tip_gut_m())).chain(ends).collect();
        out.push(Primitive::Lines {
            path: "tract/tether".into(),
            strips_world_m: vec![strip],
            rgba: vec![TETHER_RGBA],
        });
    }
}
