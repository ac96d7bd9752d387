//! A coincidence scanner: flat detector blocks of crystals, `models/scanners/*.toml`.
//!
//! Frame: origin at the scanner's centre, z along its axis, as the world. A block is a flat grid of `columns x rows` crystals; its
//! face stands `radius_m` from the axis at the angle α measured from +y towards +x (than2015 eq. 5.1 to 5.10):
//!
//! ```text
//! outward  n = (sin α, cos α, 0)      tangential t = (cos α, -sin α, 0)      axial e = (0, 0, 1)
//! crystal (i, k) of block b:  (R + d) n + h t + z e,   h = p_t (i - (columns - 1)/2),   z = z_b + p_a (k - (rows - 1)/2)
//! ```
//!
//! with pitch = crystal + gap, and d the depth at which ends are told ([`Scanner::told_depth_m`]). List-mode data count X = block · columns + i and Z = row (axial). A block is flat, the ring a polygon:
//! the distance of a crystal from the axis varies within a block. Heads that are not on a ring (two plates) are listed one by one.
//! A detector without crystals is one "crystal" per block with a `position_fwhm_mm`.

mod changes;

pub use changes::{CHANGES_SOURCES, ChangesTable};

use crate::simulation::block::FWHM_PER_SIGMA;
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::config::quantity::{Finite, Fraction, NonNegative, Positive};
use lumenav_core::{ConfigError, Name, Node};
use nalgebra::Vector3;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

/// Ends of recorded lines may lie so far beside a block, m: rings are told as circles, places at the face or behind the crystals.
const BESIDE_A_BLOCK_M: f64 = 0.010;

/// `[scanner]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScannerTable {
    name: String,
    #[serde(default)]
    description: String,
    source: String,
}

/// `[ring]`: blocks around the axis.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RingTable {
    /// Distance of the blocks' faces from the axis, mm.
    radius_mm: Positive,
    /// So many blocks at equal angles; or `angles_deg`.
    blocks: Option<u32>,
    /// Angles of the blocks from +y towards +x, degrees.
    angles_deg: Option<Vec<Finite>>,
    /// Axial positions of the rings' centres, mm.
    #[serde(default = "one_ring")]
    axial_mm: Vec<Finite>,
}

fn one_ring() -> Vec<Finite> {
    vec![Finite(0.0)]
}

/// `[[block]]`: a head that stands on its own.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BlockTable {
    /// Centre of its face, mm.
    centre_mm: [Finite; 3],
    /// From the face into the crystals.
    outward: [Finite; 3],
    /// Along the columns.
    tangential: [Finite; 3],
}

/// `[crystals]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CrystalsTable {
    columns: u32,
    rows: u32,
    tangential_mm: Positive,
    axial_mm: Positive,
    depth_mm: Positive,
    #[serde(default)]
    tangential_gap_mm: NonNegative,
    #[serde(default)]
    axial_gap_mm: NonNegative,
    /// Depth behind the face at which the ends of lines are told, mm; absent: the mean depth of the deposits that are reported.
    average_depth_of_interaction_mm: Option<NonNegative>,
}

/// `[detection]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DetectionTable {
    /// Name of a scintillator in `models/scintillators`, or a path.
    scintillator: String,
    /// FWHM at 511 keV over 511 keV.
    energy_resolution_at_511_kev: Fraction,
    energy_window_kev: [Positive; 2],
    /// FWHM of one photon's time, ns.
    time_resolution_ns: NonNegative,
    /// Two photons within this are a coincidence, ns.
    coincidence_window_ns: Positive,
    /// A block that has fired is blind for this long, us.
    #[serde(default)]
    block_dead_time_us: NonNegative,
    /// Share of detected photons that are read out, per crystal; or one for all.
    #[serde(default = "all")]
    efficiency: Positive,
    /// Resolution of a detector without crystals, FWHM, mm.
    position_fwhm_mm: Option<Positive>,
}

fn all() -> Positive {
    Positive(1.0)
}

/// `[coincidence]`.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CoincidenceTable {
    /// Blocks of one ring fire together only where they are so many apart.
    min_block_difference: Option<u32>,
    /// The pairs that can fire together; absent: all that `min_block_difference` allows.
    pairs: Option<Vec<[u32; 2]>>,
}

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScannerFile {
    #[expect(dead_code, reason = "named here, so that it is no unknown table; parsed by itself")]
    scanner: IgnoredAny,
    #[expect(dead_code, reason = "as above")]
    crystals: IgnoredAny,
    #[expect(dead_code, reason = "as above")]
    detection: IgnoredAny,
    ring: Option<IgnoredAny>,
    #[serde(default)]
    block: Vec<IgnoredAny>,
    #[expect(dead_code, reason = "as above")]
    coincidence: Option<IgnoredAny>,
}

/// Where the defaults of a scanner's tables come from: key and source.
pub const SCANNER_SOURCES: [(&str, &str); 10] = [
    ("description", "chosen: none"),
    ("axial_mm", "chosen: one ring, in the middle"),
    ("tangential_gap_mm", "chosen: crystals touch"),
    ("axial_gap_mm", "chosen: crystals touch"),
    (
        "average_depth_of_interaction_mm",
        "computed: mean depth of the deposits that the scintillator's physics reports",
    ),
    ("block_dead_time_us", "chosen: no dead time unless the scanner's file says else"),
    ("efficiency", "chosen: every photon that passes the energy window is read out"),
    ("position_fwhm_mm", "chosen: crystals tell the place"),
    ("min_block_difference", "chosen: 1, any two blocks"),
    ("pairs", "chosen: all that `min_block_difference` allows"),
];

/// A flat detector block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Centre of the face, m.
    pub centre_world_m: Vector3<f64>,
    /// From the face into the crystals.
    pub outward: Vector3<f64>,
    /// Along the columns.
    pub tangential: Vector3<f64>,
    /// Along the rows; `tangential x axial = -outward` on a ring.
    pub axial: Vector3<f64>,
}

/// The grid of crystals that all blocks share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrystalGrid {
    /// Crystals along `tangential`.
    pub columns: u32,
    /// Crystals along `axial`.
    pub rows: u32,
    /// Size of a crystal, m.
    pub tangential_m: f64,
    /// Size of a crystal, m.
    pub axial_m: f64,
    /// Size of a crystal, m.
    pub depth_m: f64,
    /// Distance between centres, m.
    pub tangential_pitch_m: f64,
    /// Distance between centres, m.
    pub axial_pitch_m: f64,
}

impl CrystalGrid {
    /// Column and row of the pitch cell that holds `(h, z)`; `None` beside the block.
    pub fn cell(&self, h_m: f64, z_m: f64) -> Option<(u32, u32)> {
        let index = |along_m: f64, pitch_m: f64, count: u32| {
            let cell = along_m / pitch_m + 0.5 * f64::from(count);
            (cell >= 0.0 && cell < f64::from(count)).then_some(cell as u32)
        };
        Some((index(h_m, self.tangential_pitch_m, self.columns)?, index(z_m, self.axial_pitch_m, self.rows)?))
    }

    /// Half the block's width, outer gaps left out, m.
    pub fn half_width_m(&self) -> f64 {
        0.5 * (f64::from(self.columns - 1) * self.tangential_pitch_m + self.tangential_m)
    }

    /// Half the block's length along the axis, outer gaps left out, m.
    pub fn half_length_m(&self) -> f64 {
        0.5 * (f64::from(self.rows - 1) * self.axial_pitch_m + self.axial_m)
    }
}

impl CrystalGrid {
    /// Whether two blocks share space: two boxes do unless an axis parts them (their sides, and what stands on two of them).
    fn overlap(&self, one: &Block, other: &Block) -> bool {
        let half_m = [self.half_width_m(), self.half_length_m(), 0.5 * self.depth_m];
        let sides = |b: &Block| [b.tangential, b.axial, b.outward];
        let middle = |b: &Block| b.centre_world_m + b.outward * (0.5 * self.depth_m);
        let apart = middle(other) - middle(one);
        if apart.norm() > 2.0 * Vector3::from(half_m).norm() {
            return false;
        }
        let (first, second) = (sides(one), sides(other));
        let crossed = first.iter().flat_map(|a| second.iter().map(|b| a.cross(b)));
        let axes = first.iter().chain(&second).copied().chain(crossed.filter(|axis| axis.norm() > 1e-6));
        axes.map(|axis| axis.normalize()).all(|axis| {
            let reach = |sides: &[Vector3<f64>; 3]| -> f64 {
                sides.iter().zip(half_m).map(|(side, half)| half * side.dot(&axis).abs()).sum()
            };
            apart.dot(&axis).abs() < reach(&first) + reach(&second) - TOUCH_M
        })
    }
}

/// A rate scale may exceed 1 where a model sees too little (spec 20, section 3); beyond this it is a percentage.
const MOST_EFFICIENCY: f64 = 2.0;
/// Blocks that touch do not overlap, and angles are rounded.
const TOUCH_M: f64 = 1e-6;
/// Of air; water has 9.6 per metre.
const THIN_PER_M: f64 = 0.1;

/// How photons are detected.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Scintillator, as the file names it.
    pub scintillator: Name,
    /// FWHM at 511 keV over 511 keV.
    pub energy_resolution: f64,
    /// Lower and upper end of the energy window, eV.
    pub energy_window_ev: [f64; 2],
    /// FWHM of one photon's time, s.
    pub time_resolution_s: f64,
    /// Two photons within this are a coincidence, s.
    pub coincidence_window_s: f64,
    /// A block that has fired is blind for this long, s.
    pub block_dead_time_s: f64,
    /// Share of detected photons that are read out.
    pub efficiency: f64,
    /// Resolution of a detector without crystals, FWHM, m.
    pub position_fwhm_m: Option<f64>,
}

/// A scanner as installed: what both sides know.
#[derive(Clone, Debug, PartialEq)]
pub struct Scanner {
    /// Its name.
    pub name: String,
    /// Its blocks, in the order in which list-mode data count them.
    pub blocks: Vec<Block>,
    /// The crystals of each block.
    pub grid: CrystalGrid,
    /// How photons are detected.
    pub detection: Detection,
    /// Depth behind the face at which ends are told, m; `None` before [`Self::with_interaction_depth`], and the crystals' middle then.
    pub interaction_depth_m: Option<f64>,
    /// Row `a` of this square table, as long as there are blocks: whether `a` and `b` can fire together.
    pairs: Vec<bool>,
}

/// Indices of one crystal in list-mode data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CrystalIndex {
    /// `block · columns + column`.
    pub x: u32,
    /// Row, along the axis.
    pub z: u32,
}

/// More blocks than this are a typing error.
const MAX_BLOCKS: usize = 4096;
/// More crystals along a side than this are a typing error.
const MAX_CRYSTALS: u32 = 4096;
/// No scanner is larger than this, m.
const MAX_SIZE_M: f64 = 10.0;

impl Scanner {
    /// Reads a scanner's file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(file: &Node) -> Result<Self, ConfigError> {
        let whole: ScannerFile = file.parse_quietly()?;
        let table: ScannerTable = file.child_or_empty("scanner").parse_sourced(&SCANNER_SOURCES)?;
        if whole.ring.is_some() != whole.block.is_empty() {
            return Err(file
                .error("a scanner has either a [ring] or one [[block]] or more, not both and not neither"));
        }
        let crystals = file.child_or_empty("crystals");
        let (grid, interaction_depth_m) = (grid(&crystals)?, interaction_depth(&crystals)?);
        let (blocks, around) = match file.child("ring") {
            Some(ring) => blocks_of_ring(&ring.parse_sourced(&SCANNER_SOURCES)?, &ring)?,
            None => (listed_blocks(file)?, 0),
        };
        let pairs = pairs(file, blocks.len(), around)?;
        let detection = detection(&file.child_or_empty("detection"))?;
        if detection.position_fwhm_m.is_some() && grid.columns * grid.rows > 1 {
            let message = "of a detector without crystals; allowed beside `columns = 1` and `rows = 1`";
            return Err(file.child_or_empty("detection").error_at("position_fwhm_mm", message));
        }
        let scanner = Self { name: table.name, blocks, grid, detection, interaction_depth_m, pairs };
        scanner.refuse_overlaps(&file.child("ring").unwrap_or_else(|| file.clone()))?;
        Ok(scanner)
    }

    /// Two blocks cannot be at one place.
    fn refuse_overlaps(&self, node: &Node) -> Result<(), ConfigError> {
        for (a, one) in self.blocks.iter().enumerate() {
            for (b, other) in self.blocks.iter().enumerate().skip(a + 1) {
                if self.grid.overlap(one, other) {
                    let message = format!(
                        "blocks {a} and {b} overlap: each {:.1} x {:.1} x {:.1} mm, their faces' middles {:.1} mm apart; allowed: fewer `columns` or `rows`, a larger `radius_mm`, `angles_deg` or `centre_mm` further apart",
                        2e3 * self.grid.half_width_m(),
                        2e3 * self.grid.half_length_m(),
                        1e3 * self.grid.depth_m,
                        1e3 * (one.centre_world_m - other.centre_world_m).norm(),
                    );
                    return Err(node.error(&message));
                }
            }
        }
        Ok(())
    }

    /// The first block whose face is inside a body, if any is.
    pub fn block_inside(&self, body: &Phantom) -> Option<usize> {
        let (half_width_m, half_length_m) = (self.grid.half_width_m(), self.grid.half_length_m());
        let parts = [-1.0, -0.5, 0.0, 0.5, 1.0];
        let is_inside = |block: &usize| {
            parts.iter().any(|h| {
                parts.iter().any(|z| {
                    let place = self.in_block(*block, h * half_width_m, z * half_length_m, 0.0);
                    body.attenuation_511_per_m(&place) > THIN_PER_M
                })
            })
        };
        (0..self.blocks.len()).find(is_inside)
    }

    /// The middle of its blocks' faces, m; to the nanometre, so that rounding does not move that of a ring.
    pub fn middle_m(&self) -> Vector3<f64> {
        let sum_m: Vector3<f64> = self.blocks.iter().map(|block| block.centre_world_m).sum();
        (sum_m / self.blocks.len().max(1) as f64).map(|axis| (axis * 1e9).round() * 1e-9 + 0.0)
    }

    /// Depth behind the face at which ends are told, m.
    pub fn told_depth_m(&self) -> f64 {
        self.interaction_depth_m.unwrap_or(0.5 * self.grid.depth_m)
    }

    /// Number of crystals.
    pub fn crystals(&self) -> usize {
        self.blocks.len() * (self.grid.columns * self.grid.rows) as usize
    }

    /// Whether two blocks can fire together.
    pub fn can_coincide(&self, a: usize, b: usize) -> bool {
        self.pairs[a * self.blocks.len() + b]
    }

    /// A scanner of some of this one's blocks, each with where it now stands: two of them can fire together where they can here. A
    /// block may be named again, and then stands at two places that never fire together.
    ///
    /// # Panics
    /// A number that is none of this scanner's blocks.
    #[must_use]
    pub fn of_blocks(&self, chosen: &[(usize, Block)]) -> Self {
        let pairs = chosen.iter().flat_map(|(a, _)| chosen.iter().map(|(b, _)| self.can_coincide(*a, *b)));
        Self {
            pairs: pairs.collect(),
            blocks: chosen.iter().map(|(_, block)| *block).collect(),
            ..self.clone()
        }
    }

    /// Block of a crystal; `None` where there is no such crystal.
    pub fn block_of(&self, crystal: CrystalIndex) -> Option<usize> {
        let block = (crystal.x / self.grid.columns) as usize;
        (block < self.blocks.len() && crystal.z < self.grid.rows).then_some(block)
    }

    /// Where the end of a line in a crystal is told, m: on its axis, at [`Self::told_depth_m`]; `None` where there is no such crystal.
    pub fn position(&self, crystal: CrystalIndex) -> Option<Vector3<f64>> {
        let block = self.block_of(crystal)?;
        let g = &self.grid;
        let h_m = g.tangential_pitch_m * (f64::from(crystal.x % g.columns) - 0.5 * f64::from(g.columns - 1));
        let z_m = g.axial_pitch_m * (f64::from(crystal.z) - 0.5 * f64::from(g.rows - 1));
        Some(self.in_block(block, h_m, z_m, self.told_depth_m()))
    }

    /// A place in a block: `h` along the columns, `z` along the rows, `depth` behind the face, m.
    pub fn in_block(&self, block: usize, h_m: f64, z_m: f64, depth_m: f64) -> Vector3<f64> {
        let b = &self.blocks[block];
        b.centre_world_m + b.tangential * h_m + b.axial * z_m + b.outward * depth_m
    }

    /// A place as block coordinates `(h, z, depth)`, m.
    pub fn to_block(&self, block: usize, place_world_m: &Vector3<f64>) -> Vector3<f64> {
        let b = &self.blocks[block];
        let from_face = place_world_m - b.centre_world_m;
        Vector3::new(from_face.dot(&b.tangential), from_face.dot(&b.axial), from_face.dot(&b.outward))
    }

    /// Column and row of the pitch cell that holds `(h, z)`; `None` beside the block.
    pub fn cell(&self, h_m: f64, z_m: f64) -> Option<(u32, u32)> {
        self.grid.cell(h_m, z_m)
    }

    /// The crystal that holds a place, gaps counted to the nearest crystal; `None` outside all blocks.
    pub fn crystal_at(&self, place_world_m: &Vector3<f64>) -> Option<CrystalIndex> {
        (0..self.blocks.len()).find_map(|block| {
            let local = self.to_block(block, place_world_m);
            // Rounding may put a place on the face a little before it.
            let slack_m = 1e-9;
            if local.z < -slack_m || local.z > self.grid.depth_m + slack_m {
                return None;
            }
            let (column, row) = self.cell(local.x, local.y)?;
            Some(CrystalIndex { x: block as u32 * self.grid.columns + column, z: row })
        })
    }

    /// Whether a place lies in a block or within `slack_m` of its sides.
    pub fn is_at_a_block(&self, place_world_m: &Vector3<f64>, slack_m: f64) -> bool {
        let g = &self.grid;
        let (half_width_m, half_length_m) = (g.half_width_m() + slack_m, g.half_length_m() + slack_m);
        (0..self.blocks.len()).any(|block| {
            let p = self.to_block(block, place_world_m);
            (-slack_m..=g.depth_m + slack_m).contains(&p.z)
                && p.x.abs() <= half_width_m
                && p.y.abs() <= half_length_m
        })
    }

    /// The place in a block that light tells of a deposit, where there are no crystals to tell it: along the face, not in depth; `None` beside what
    /// is read out. Of a block of crystals, the place itself.
    pub(crate) fn told_by_light<R: Rng + ?Sized>(
        &self,
        deposit_block_m: Vector3<f64>,
        random: &mut R,
    ) -> Option<Vector3<f64>> {
        let Some(fwhm_m) = self.detection.position_fwhm_m else { return Some(deposit_block_m) };
        let sigma_m = fwhm_m / FWHM_PER_SIGMA;
        let (a, b): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
        let told = deposit_block_m + Vector3::new(a * sigma_m, b * sigma_m, 0.0);
        let is_read_out =
            told.x.abs() <= self.grid.half_width_m() && told.y.abs() <= self.grid.half_length_m();
        is_read_out.then_some(told)
    }

    /// Refuses an end of a recorded line that lies at no block: lines that are not this scanner's would be followed like any others.
    ///
    /// # Errors
    /// In words.
    pub(crate) fn check_end(&self, end_world_mm: [f64; 3]) -> Result<(), String> {
        if self.is_at_a_block(&(Vector3::from(end_world_mm) * 1e-3), BESIDE_A_BLOCK_M) {
            return Ok(());
        }
        let ([x, y, z], most_mm) = (end_world_mm, 1e3 * BESIDE_A_BLOCK_M);
        Err(format!(
            "an end at ({x:.1}, {y:.1}, {z:.1}) mm is at no block of scanner `{}` (allowed: up to {most_mm:.0} mm beside one); places must be in mm and from the scanner's centre",
            self.name
        ))
    }

    /// The block nearest to a place: for end points that a file gives without indices.
    pub fn nearest_block(&self, place_world_m: &Vector3<f64>) -> usize {
        let distance = |block: usize| {
            let p = self.to_block(block, place_world_m);
            let beyond = |v: f64, half: f64| (v.abs() - half).max(0.0);
            let depth = (p.z - 0.5 * self.grid.depth_m).abs() - 0.5 * self.grid.depth_m;
            beyond(p.x, self.grid.half_width_m())
                .hypot(beyond(p.y, self.grid.half_length_m()))
                .hypot(depth.max(0.0))
        };
        (0..self.blocks.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(0)
    }
}

fn grid(node: &Node) -> Result<CrystalGrid, ConfigError> {
    let table: CrystalsTable = node.parse_sourced(&SCANNER_SOURCES)?;
    check_crystals(node, "columns", table.columns)?;
    check_crystals(node, "rows", table.rows)?;
    Ok(CrystalGrid {
        columns: table.columns,
        rows: table.rows,
        tangential_m: table.tangential_mm.0 * 1e-3,
        axial_m: table.axial_mm.0 * 1e-3,
        depth_m: table.depth_mm.0 * 1e-3,
        tangential_pitch_m: (table.tangential_mm.0 + table.tangential_gap_mm.0) * 1e-3,
        axial_pitch_m: (table.axial_mm.0 + table.axial_gap_mm.0) * 1e-3,
    })
}

fn interaction_depth(node: &Node) -> Result<Option<f64>, ConfigError> {
    let table: CrystalsTable = node.parse_quietly()?;
    let Some(depth_mm) = table.average_depth_of_interaction_mm else { return Ok(None) };
    if depth_mm.0 > table.depth_mm.0 {
        let message =
            format!("{} mm; allowed: 0 to {} mm, the depth of a crystal", depth_mm.0, table.depth_mm.0);
        return Err(node.error_at("average_depth_of_interaction_mm", &message));
    }
    Ok(Some(depth_mm.0 * 1e-3))
}

fn check_crystals(node: &Node, key: &str, count: u32) -> Result<(), ConfigError> {
    if (1..=MAX_CRYSTALS).contains(&count) {
        return Ok(());
    }
    Err(node.error_at(key, &format!("{count} crystals; allowed: 1 to {MAX_CRYSTALS}")))
}

/// Blocks on one ring or more, and how many there are around one; `node` is where the table stands.
fn blocks_of_ring(table: &RingTable, node: &Node) -> Result<(Vec<Block>, usize), ConfigError> {
    let angles_rad: Vec<f64> = match (&table.blocks, &table.angles_deg) {
        (Some(count), None) if (2..=MAX_BLOCKS as u32).contains(count) => {
            (0..*count).map(|b| f64::from(b) * std::f64::consts::TAU / f64::from(*count)).collect()
        }
        (Some(count), None) => {
            return Err(node.error_at("blocks", &format!("{count} blocks; allowed: 2 to {MAX_BLOCKS}")));
        }
        (None, Some(angles)) if angles.len() >= 2 && angles.len() <= MAX_BLOCKS => {
            angles.iter().map(|a| a.0.rem_euclid(360.0).to_radians()).collect()
        }
        (None, Some(_)) => return Err(node.error_at("angles_deg", "a coincidence needs two blocks at least")),
        _ => return Err(node.error("give either `blocks` (a count) or `angles_deg`")),
    };
    let radius_m = table.radius_mm.0 * 1e-3;
    if radius_m > MAX_SIZE_M || table.axial_mm.iter().any(|z| z.0.abs() * 1e-3 > MAX_SIZE_M) {
        return Err(node.error(&format!("a scanner of more than {MAX_SIZE_M} m")));
    }
    if table.axial_mm.is_empty() || table.axial_mm.len() * angles_rad.len() > MAX_BLOCKS {
        return Err(
            node.error_at("axial_mm", &format!("allowed: 1 ring or more, {MAX_BLOCKS} blocks in all"))
        );
    }
    let mut blocks = Vec::new();
    for axial in &table.axial_mm {
        for alpha in &angles_rad {
            let (sin, cos) = alpha.sin_cos();
            let outward = Vector3::new(sin, cos, 0.0);
            blocks.push(Block {
                centre_world_m: outward * radius_m + Vector3::z() * (axial.0 * 1e-3),
                outward,
                tangential: Vector3::new(cos, -sin, 0.0),
                axial: Vector3::z(),
            });
        }
    }
    Ok((blocks, angles_rad.len()))
}

fn listed_blocks(file: &Node) -> Result<Vec<Block>, ConfigError> {
    let nodes = file.children("block").unwrap_or_default();
    if nodes.len() < 2 || nodes.len() > MAX_BLOCKS {
        return Err(file.error_at("block", &format!("{} blocks; allowed: 2 to {MAX_BLOCKS}", nodes.len())));
    }
    let mut blocks = Vec::new();
    for node in &nodes {
        let table: BlockTable = node.parse()?;
        let unit = |key: &str, v: [Finite; 3]| {
            Vector3::from(v.map(|c| c.0))
                .try_normalize(1e-9)
                .ok_or_else(|| node.error_at(key, "a direction cannot be of length zero"))
        };
        let outward = unit("outward", table.outward)?;
        let along = unit("tangential", table.tangential)?;
        let Some(tangential) = (along - outward * along.dot(&outward)).try_normalize(1e-3) else {
            return Err(node.error_at("tangential", "the columns cannot run along `outward`"));
        };
        let centre_world_m = Vector3::from(table.centre_mm.map(|v| v.0)) * 1e-3;
        if centre_world_m.amax() > MAX_SIZE_M {
            return Err(
                node.error_at("centre_mm", &format!("more than {MAX_SIZE_M} m from the scanner's centre"))
            );
        }
        // As on a ring: tangential x axial = -outward.
        blocks.push(Block { centre_world_m, outward, tangential, axial: tangential.cross(&outward) });
    }
    Ok(blocks)
}

fn pairs(file: &Node, blocks: usize, around: usize) -> Result<Vec<bool>, ConfigError> {
    let node = file.child_or_empty("coincidence");
    let table: CoincidenceTable = node.parse_sourced(&SCANNER_SOURCES)?;
    let mut allowed = vec![false; blocks * blocks];
    if let Some(pairs) = &table.pairs {
        for [a, b] in pairs.iter().map(|p| p.map(|v| v as usize)) {
            if a >= blocks || b >= blocks || a == b {
                let message = format!(
                    "[{a}, {b}] is no pair of blocks; allowed: two different ones of 0 to {}",
                    blocks - 1
                );
                return Err(node.error_at("pairs", &message));
            }
            allowed[a * blocks + b] = true;
            allowed[b * blocks + a] = true;
        }
    }
    if table.pairs.is_some() && table.min_block_difference.is_some() {
        return Err(node.error_at("min_block_difference", "`pairs` names every pair; give one of the two"));
    }
    let least = table.min_block_difference.unwrap_or(1) as usize;
    if table.min_block_difference.is_some() && around == 0 {
        return Err(
            node.error_at("min_block_difference", "only blocks of a [ring] have a difference; give `pairs`")
        );
    }
    if table.pairs.is_none() {
        for a in 0..blocks {
            for b in 0..blocks {
                let apart = if around > 0 { (a % around).abs_diff(b % around) } else { 0 };
                let apart = if around > 0 { apart.min(around - apart) } else { least };
                allowed[a * blocks + b] = a != b && apart >= least;
            }
        }
    }
    if !allowed.contains(&true) {
        return Err(node.error("no two blocks can fire together"));
    }
    Ok(allowed)
}

fn detection(node: &Node) -> Result<Detection, ConfigError> {
    let table: DetectionTable = node.parse_sourced(&SCANNER_SOURCES)?;
    let [low, high] = table.energy_window_kev.map(|v| v.0 * 1e3);
    if low >= high {
        return Err(node.error_at("energy_window_kev", "the window's lower end lies above its upper end"));
    }
    if table.efficiency.0 > MOST_EFFICIENCY {
        let message = format!(
            "{} of the photons that are detected; allowed: above 0, up to {MOST_EFFICIENCY}",
            table.efficiency.0
        );
        return Err(node.error_at("efficiency", &message));
    }
    Ok(Detection {
        scintillator: Name::from(table.scintillator.as_str()),
        energy_resolution: table.energy_resolution_at_511_kev.0,
        energy_window_ev: [low, high],
        time_resolution_s: table.time_resolution_ns.0 * 1e-9,
        coincidence_window_s: table.coincidence_window_ns.0 * 1e-9,
        block_dead_time_s: table.block_dead_time_us.0 * 1e-6,
        efficiency: table.efficiency.0,
        position_fwhm_m: table.position_fwhm_mm.map(|v| v.0 * 1e-3),
    })
}

#[cfg(test)]
mod tests;
