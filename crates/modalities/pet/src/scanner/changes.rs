//! What a scenario changes of a scanner's file, to compare scanners without a file for each.
//!
//! The keys are those of the file (`[ring]`, `[crystals]`), and what is not named stays as it is there. Coincidences count the blocks, so
//! their number stays, too.

use super::{MAX_BLOCKS, MAX_SIZE_M, RingTable, Scanner, blocks_of_ring, check_crystals};
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::{ConfigError, Node};
use serde::{Deserialize, Serialize};

/// `[sensor.installed.scanner_changes]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ChangesTable {
    /// Distance of the faces of a ring's blocks from the axis, mm.
    pub radius_mm: Option<Positive>,
    /// Angles of a ring's blocks from +y towards +x, degrees; as many as the file has.
    pub angles_deg: Option<Vec<Finite>>,
    /// Crystals along the tangential side of each block.
    pub columns: Option<u32>,
    /// Crystals along the axial side of each block.
    pub rows: Option<u32>,
}

/// Where the defaults come from: key and source.
pub const CHANGES_SOURCES: [(&str, &str); 4] = [
    ("radius_mm", "the scanner's file"),
    ("angles_deg", "the scanner's file"),
    ("columns", "the scanner's file"),
    ("rows", "the scanner's file"),
];

impl Scanner {
    /// This scanner of the model `file` with what `changes` names replaced.
    ///
    /// # Errors
    /// [`ConfigError`] at the key that is changed: no ring to change, another number of blocks, blocks that would overlap.
    pub fn changed(mut self, file: &Node, changes: &Node) -> Result<Self, ConfigError> {
        let table: ChangesTable = changes.parse_sourced(&CHANGES_SOURCES)?;
        for (key, count, size) in
            [("columns", table.columns, &mut self.grid.columns), ("rows", table.rows, &mut self.grid.rows)]
        {
            if let Some(count) = count {
                check_crystals(changes, key, count)?;
                *size = count;
            }
        }
        let moved = [("radius_mm", table.radius_mm.is_some()), ("angles_deg", table.angles_deg.is_some())];
        let Some(ring) = file.child("ring") else {
            return match moved.iter().find(|(_, is_given)| *is_given) {
                Some((key, _)) => {
                    let name = &self.name;
                    let message = format!(
                        "scanner `{name}` has no [ring], its blocks are listed one by one; allowed: columns, rows"
                    );
                    Err(changes.error_at(key, &message))
                }
                None => self.refuse_overlaps(changes).map(|()| self),
            };
        };
        let mut ring: RingTable = ring.parse_quietly()?;
        if let Some(radius_mm) = table.radius_mm {
            if radius_mm.0 * 1e-3 > MAX_SIZE_M {
                let message = format!("{} mm; allowed: up to {} mm", radius_mm.0, 1e3 * MAX_SIZE_M);
                return Err(changes.error_at("radius_mm", &message));
            }
            ring.radius_mm = radius_mm;
        }
        if let Some(angles_deg) = table.angles_deg {
            let around = self.blocks.len() / ring.axial_mm.len().clamp(1, MAX_BLOCKS);
            if angles_deg.len() != around {
                let message = format!(
                    "{} angles; allowed: {around}, one for each block around scanner `{}`",
                    angles_deg.len(),
                    self.name
                );
                return Err(changes.error_at("angles_deg", &message));
            }
            (ring.blocks, ring.angles_deg) = (None, Some(angles_deg));
        }
        (self.blocks, _) = blocks_of_ring(&ring, changes)?;
        self.refuse_overlaps(changes)?;
        Ok(self)
    }
}
