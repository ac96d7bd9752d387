//! `[[tract.diverticulum]]`: pouches of the wall.

use crate::places::arc_length_m;
use lumenav_anatomy::diverticulum::Diverticulum;
use lumenav_anatomy::segment::SegmentKey;
use lumenav_anatomy::tract::Tract;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, Node};
use serde::{Deserialize, Serialize};

/// Narrowest mouth, mm: below it a capsule's ring of contact would see a cliff.
const NARROWEST_MOUTH_MM: f64 = 10.0;
/// Widest mouth, in radii of the lumen: two hundredths of the depth are left on the other side.
const WIDEST_MOUTH: f64 = 5.0 / 3.0;

/// `[[tract.diverticulum]]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiverticulumTable {
    /// The segment from whose oral end `at_mm` counts; the tract's start where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<SegmentKey>,
    /// Where its middle is, mm along the centre line.
    pub at_mm: NonNegative,
    /// Where around the lumen, degrees from the centre line's normal. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<Finite>,
    /// How far it goes beyond the resting wall, mm; at most the mouth: deeper ones have necks, which a radius cannot tell.
    pub depth_mm: Positive,
    /// Its width at half of the depth, mm, 10 to 5/3 of the lumen's radius: a wider one would widen the other side, too.
    pub mouth_mm: Positive,
}

impl DiverticulumTable {
    /// The pouch in the tract. `node` is its table.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key: not in the tract, a mouth or depth that no such pouch has.
    pub fn place(&self, tract: &Tract, node: &Node) -> Result<Diverticulum, ConfigError> {
        let s_m = arc_length_m(self.segment, self.at_mm, tract, node)?;
        let radius_m = tract.radius.radius_m(s_m);
        let (mouth_mm, depth_mm) = (self.mouth_mm.0, self.depth_mm.0);
        let widest_mm = (1e3 * WIDEST_MOUTH * radius_m).max(NARROWEST_MOUTH_MM);
        if !(NARROWEST_MOUTH_MM..=widest_mm).contains(&mouth_mm) {
            let message = format!(
                "the lumen's radius is {:.1} mm there; allowed: {NARROWEST_MOUTH_MM} to {widest_mm:.1}",
                1e3 * radius_m
            );
            return Err(node.error_at("mouth_mm", &message));
        }
        if depth_mm > mouth_mm {
            let message =
                format!("deeper than its mouth is wide, it would have a neck; allowed: to {mouth_mm}");
            return Err(node.error_at("depth_mm", &message));
        }
        let angle_rad = self.angle_deg.map_or(0.0, |angle| angle.0.to_radians());
        Ok(Diverticulum::new(s_m, angle_rad, 1e-3 * depth_mm, 1e-3 * mouth_mm, radius_m))
    }
}

/// All pouches of `[tract]`, in the order of the file.
///
/// # Errors
/// As [`DiverticulumTable::place`].
pub(crate) fn place_all(
    tables: &[DiverticulumTable],
    tract: &Tract,
    node: &Node,
) -> Result<Vec<Diverticulum>, ConfigError> {
    let nodes = node.children("diverticulum")?;
    tables.iter().zip(&nodes).map(|(table, node)| table.place(tract, node)).collect()
}
