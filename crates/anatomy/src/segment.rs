//! Segments of a tract: their keys, the properties of their wall, the landmarks between them.
//!
//! Keys are those of the project's conventions, in order from mouth to anus; American spellings are accepted on input.

use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use serde::{Deserialize, Deserializer, Serialize, de};
use std::fmt;

/// A segment of the gut, in order from mouth to anus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SegmentKey {
    /// `oesophagus`
    Oesophagus,
    /// `stomach`
    Stomach,
    /// `duodenum`
    Duodenum,
    /// `jejunum`
    Jejunum,
    /// `ileum`
    Ileum,
    /// `terminal_ileum`
    TerminalIleum,
    /// `caecum`
    Caecum,
    /// `ascending`
    Ascending,
    /// `transverse`
    Transverse,
    /// `descending`
    Descending,
    /// `sigmoid`
    Sigmoid,
    /// `rectum`
    Rectum,
}

impl SegmentKey {
    /// All keys, in order.
    pub const ALL: [Self; 12] = [
        Self::Oesophagus,
        Self::Stomach,
        Self::Duodenum,
        Self::Jejunum,
        Self::Ileum,
        Self::TerminalIleum,
        Self::Caecum,
        Self::Ascending,
        Self::Transverse,
        Self::Descending,
        Self::Sigmoid,
        Self::Rectum,
    ];

    /// The key as files spell it.
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::Oesophagus => "oesophagus",
            Self::Stomach => "stomach",
            Self::Duodenum => "duodenum",
            Self::Jejunum => "jejunum",
            Self::Ileum => "ileum",
            Self::TerminalIleum => "terminal_ileum",
            Self::Caecum => "caecum",
            Self::Ascending => "ascending",
            Self::Transverse => "transverse",
            Self::Descending => "descending",
            Self::Sigmoid => "sigmoid",
            Self::Rectum => "rectum",
        }
    }

    /// The key of a name; `esophagus` and `cecum` are accepted. `None` for any other name.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "esophagus" => Some(Self::Oesophagus),
            "cecum" => Some(Self::Caecum),
            _ => Self::ALL.into_iter().find(|key| key.as_str() == name),
        }
    }

    /// All keys in one line, for messages.
    pub fn allowed() -> String {
        Self::ALL.map(|key| key.as_str()).join(", ")
    }

    /// Whether the segment belongs to the large bowel.
    pub fn is_colon(&self) -> bool {
        *self >= Self::Caecum
    }

    /// Name of the landmark at the oral end of this segment, `None` inside an organ.
    pub fn oral_landmark(&self) -> Option<&'static str> {
        match self {
            Self::Oesophagus => Some("upper_oesophageal_sphincter"),
            Self::Stomach => Some("cardia"),
            Self::Duodenum => Some("pylorus"),
            Self::Jejunum => Some("duodenojejunal_flexure"),
            Self::Ileum | Self::TerminalIleum => None,
            Self::Caecum => Some("ileocaecal_valve"),
            Self::Ascending => Some("caecocolic_junction"),
            Self::Transverse => Some("hepatic_flexure"),
            Self::Descending => Some("splenic_flexure"),
            Self::Sigmoid => Some("descending_sigmoid_junction"),
            Self::Rectum => Some("rectosigmoid_junction"),
        }
    }

    /// The wall of this segment unless a file says else.
    pub fn default_wall(&self) -> Wall {
        Wall::of(*self)
    }
}

impl fmt::Display for SegmentKey {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.as_str())
    }
}

impl Serialize for SegmentKey {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl<'de> Deserialize<'de> for SegmentKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::from_name(&name).ok_or_else(|| {
            de::Error::custom(format!("no segment is called `{name}`; allowed: {}", Self::allowed()))
        })
    }
}

/// What the wall of a segment does to a capsule. Defaults are the project's proposal for a soft bowel: values that reproduce
/// transit times, not measurements of tissue; where a range was measured it stands at the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// Radial stiffness per contact ring of the capsule, N/m. 60: gives way by 2 to 3 mm under the measured traction.
    pub stiffness_newton_per_m: f64,
    /// Radial damping per contact ring, N s/m.
    pub damping_newton_s_per_m: f64,
    /// Adhesion and viscous friction as a part of `coulomb_newton` and `viscous_newton_s_per_m` of the engine, 0 to 1. Oesophagus 0.04
    /// [T to 5.2 s upright: a capsule goes down with water], small bowel 0.6 [T towards 198 min of transit, with a look at the traction], else 1.
    pub grip: f64,
    /// Whether the empty lumen is flat and lies around a capsule from all sides without pressing on it: viscous friction acts on all of it.
    pub collapsed: bool,
    /// Coulomb friction. Porcine small bowel, in-vivo-like: 0.0004 to 0.018 (Lyle 2013), whose upper end is the wet
    /// oesophagus'; pulls ex vivo imply 0.05 to 0.2.
    pub friction: f64,
    /// Distance between haustra (colon) or folds, m; 0 for a smooth wall.
    pub haustra_pitch_m: f64,
    /// Depth of the folds as a fraction of the radius, 0 to 1.
    pub haustra_depth: f64,
    /// Radius of the contracted lumen as a fraction of the resting one.
    pub contracted_factor: f64,
    /// Radius of the distended lumen as a multiple of the resting one.
    pub distended_factor: f64,
}

impl Wall {
    /// The default wall of a segment.
    fn of(key: SegmentKey) -> Self {
        let (haustra_pitch_m, haustra_depth) = match key {
            // Haustra: pitch and depth are believed, not measured.
            SegmentKey::Caecum
            | SegmentKey::Ascending
            | SegmentKey::Transverse
            | SegmentKey::Descending
            | SegmentKey::Sigmoid => (0.03, 0.35),
            // The others are smooth to a capsule: Kerckring's folds are thin and lie down before it.
            _ => (0.0, 0.0),
        };
        let grip = match key {
            SegmentKey::Oesophagus => 0.04,
            SegmentKey::Duodenum | SegmentKey::Jejunum | SegmentKey::Ileum | SegmentKey::TerminalIleum => 0.6,
            _ => 1.0,
        };
        Self {
            stiffness_newton_per_m: 60.0,
            damping_newton_s_per_m: 8.0,
            grip,
            collapsed: key == SegmentKey::Oesophagus,
            friction: if key == SegmentKey::Oesophagus { 0.018 } else { 0.08 },
            haustra_pitch_m,
            haustra_depth,
            contracted_factor: 0.05,
            // The stomach distends from 18 to 40 to 60 mm; the colon from 46 mm to below 90 mm of diameter.
            distended_factor: if key == SegmentKey::Stomach { 2.8 } else { 1.6 },
        }
    }
}

/// The `wall` table of a segment in a tract file: each key overrides the segment's default.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WallTable {
    /// See [`Wall::stiffness_newton_per_m`].
    pub stiffness_newton_per_m: Option<Positive>,
    /// See [`Wall::damping_newton_s_per_m`].
    pub damping_newton_s_per_m: Option<NonNegative>,
    /// See [`Wall::grip`].
    pub grip: Option<Fraction>,
    /// See [`Wall::collapsed`].
    pub collapsed: Option<bool>,
    /// See [`Wall::friction`].
    pub friction: Option<NonNegative>,
    /// See [`Wall::haustra_pitch_m`], in mm.
    pub haustra_pitch_mm: Option<NonNegative>,
    /// See [`Wall::haustra_depth`].
    pub haustra_depth: Option<Fraction>,
    /// See [`Wall::contracted_factor`].
    pub contracted_factor: Option<Fraction>,
    /// See [`Wall::distended_factor`].
    pub distended_factor: Option<Positive>,
}

impl WallTable {
    /// The wall of a segment with what this table overrides.
    pub fn over(&self, mut wall: Wall) -> Wall {
        let set = |to: &mut f64, value: Option<f64>| *to = value.unwrap_or(*to);
        set(&mut wall.stiffness_newton_per_m, self.stiffness_newton_per_m.map(|v| v.0));
        set(&mut wall.damping_newton_s_per_m, self.damping_newton_s_per_m.map(|v| v.0));
        set(&mut wall.grip, self.grip.map(|v| v.0));
        wall.collapsed = self.collapsed.unwrap_or(wall.collapsed);
        set(&mut wall.friction, self.friction.map(|v| v.0));
        set(&mut wall.haustra_pitch_m, self.haustra_pitch_mm.map(|v| v.0 * 1e-3));
        set(&mut wall.haustra_depth, self.haustra_depth.map(|v| v.0));
        set(&mut wall.contracted_factor, self.contracted_factor.map(|v| v.0));
        set(&mut wall.distended_factor, self.distended_factor.map(|v| v.0));
        wall
    }
}

/// One segment of a tract.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Which segment.
    pub key: SegmentKey,
    /// Arc length at which it begins, m.
    pub start_m: f64,
    /// Arc length at which it ends, m.
    pub end_m: f64,
    /// Its wall.
    pub wall: Wall,
    /// Where its numbers come from.
    pub source: String,
}

impl Segment {
    /// Length along the centre line, m.
    pub fn length_m(&self) -> f64 {
        self.end_m - self.start_m
    }
}

/// A named place between two segments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmark {
    /// Its name, for example `pylorus`.
    pub name: &'static str,
    /// Where it is, m.
    pub arc_length_m: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_every_key_reads_back_and_american_spellings_are_accepted() {
        for key in SegmentKey::ALL {
            assert_eq!(SegmentKey::from_name(key.as_str()), Some(key));
        }
        assert_eq!(SegmentKey::from_name("esophagus"), Some(SegmentKey::Oesophagus));
        assert_eq!(SegmentKey::from_name("cecum"), Some(SegmentKey::Caecum));
        assert_eq!(SegmentKey::from_name("colon"), None);
        assert!(SegmentKey::ALL.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn law_a_wall_table_changes_only_what_it_names() {
        let default = SegmentKey::Ascending.default_wall();
        assert_eq!(WallTable::default().over(default), default);
        let table = WallTable { haustra_pitch_mm: Some(NonNegative(25.0)), ..WallTable::default() };
        let wall = table.over(default);
        assert!((wall.haustra_pitch_m - 0.025).abs() < 1e-15);
        assert_eq!(Wall { haustra_pitch_m: default.haustra_pitch_m, ..wall }, default);
    }
}
