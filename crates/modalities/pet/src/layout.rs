//! The scanner as a layout: what its blocks would say together about the capsule's pose in one window.
//!
//! A line needs two blocks, so the information is a sum over pairs of blocks that can fire together, and a block by itself says nothing:
//!
//! ```text
//! I(S) = Σ_{a<b in S} T Λ_ab / (1 - β) · E[g gᵀ | a, b]          about [δp_world (m), δθ_capsule (rad)]
//! ```
//!
//! with Λ_ab the rate of true lines between a and b, T the window's length, β the share of background among the lines that pass near
//! the markers and g the score of one unlabelled line: `planning::accuracy` computes it, `planning::sensitivity` the rates. A block
//! that is dead is left out, and every pair with it.
//!
//! The frame of an element: origin in the middle of the block's face, x along the rows (axial), y along the columns (tangential), z from
//! the face into the crystals. Its kind is the block's number in the scanner's file, which tells its partners wherever it stands.
//!
//! What the bound does not know. It is local: an isosceles triangle of markers of one activity is the same after half a turn about
//! its axis, and the bound of the roll holds within one of the two. The capsule rests for the window; activities are those of the
//! scenario's start; the background's share is the same at every pose and for every layout, as told in `[layout.model]`, although wide or near
//! blocks catch more scattered and random lines (simulated: 17 % at 350 mm, 10 % at 500 mm with two pairs of 38 columns); blocks lose nothing to
//! dead time.
//!
//! Time of a pose (`dev` profile, `per_side` 6, three markers): 13 ms for two pairs of blocks, 0.1 s for a full ring of 28. `layout.dead`
//! asks again for every choice of dead blocks: of a full ring two dead blocks are 378 choices, hours.

use crate::MarkerSet;
use crate::config::{self, Installed};
use crate::planning::Plan;
use crate::planning::accuracy::PER_SIDE;
use crate::planning::sensitivity::PhotonDetection;
use crate::scanner::{Block, Scanner};
use crate::tracking::{BlockErrors, BlockNoise, LineNoise, SourceNoise};
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::config::quantity::{NonNegative, Positive};
use lumenav_core::layout::packed_len;
use lumenav_core::{LayoutElement, LayoutModel, LayoutParameters, LayoutWorker, ModalityError, Node, Setup};
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// `[layout.model]` of a PET sensor.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LayoutTable {
    /// Length of a window, s; absent: the installed one, else the schedule's period, else [`WINDOW_S`].
    pub window_s: Option<Positive>,
    /// Share of scattered and random lines among all, 0 to below 1.
    pub background_share: NonNegative,
    /// Parts along each side of a block in the sum over directions; 1 to 64.
    pub per_side: u32,
}

/// Window of one localization, s: than2015, section 4.3.
pub const WINDOW_S: f64 = 0.05;
/// Share of lines that are not true: two pairs of blocks, 20 cm of water (than2015, table 4.2: 81.9 % true).
pub const BACKGROUND_SHARE: f64 = 0.181;
/// Finer than this the sum over directions has long settled.
const MOST_PER_SIDE: u32 = 64;

impl Default for LayoutTable {
    fn default() -> Self {
        Self { window_s: None, background_share: NonNegative(BACKGROUND_SHARE), per_side: PER_SIDE as u32 }
    }
}

/// Where the defaults come from.
pub const LAYOUT_SOURCES: [(&str, &str); 3] = [
    ("window_s", "the installed window, else the schedule's period, else 0.05 s of than2015, section 4.3"),
    (
        "background_share",
        "than2015, table 4.2: 81.9 % true lines with two pairs of blocks and 20 cm of water; a full ring or a larger body has more background",
    ),
    ("per_side", "computed: the bound stands to 0.3 % at 6"),
];

/// A scanner as a layout.
#[derive(Clone, Debug)]
pub struct ScannerLayout {
    scanner: Scanner,
    elements: Vec<LayoutElement>,
    parameters: LayoutParameters,
    detection: PhotonDetection,
    block_law: BlockNoise,
    /// Of the whole scanner's lines.
    noise: LineNoise,
    phantom: Option<Phantom>,
    markers: MarkerSet,
    /// The markers with positrons per second as their activity: isotopes may differ.
    sources: MarkerSet,
    window_s: f64,
    background_share: f64,
    per_side: usize,
}

impl ScannerLayout {
    /// Reads the installed scanner, the capsule's markers and `[layout.model]`.
    ///
    /// # Errors
    /// [`ModalityError::Config`] with file, line and key.
    pub fn from_nodes(installed: &Node, options: &Node, setup: &Setup) -> Result<Self, ModalityError> {
        let opened = Installed::from_node(installed, setup)?;
        let table = read_table(options)?;
        let markers = MarkerSet::from_capsule(&setup.capsule_model, &setup.sensor, 3)?;
        let mut sources = markers.clone();
        let as_sources = config::sources(&markers, setup)?;
        for (source, known) in sources.markers.iter_mut().zip(&as_sources) {
            source.activity_bq *= known.isotope.positrons_per_decay();
        }
        let errors = BlockErrors::of_block(&opened.scanner, &opened.scintillator, opened.table.end_points);
        let installed_s = opened.table.window_ms.map(|window| 1e-3 * window.0);
        let period_s = setup.schedule.map(|schedule| schedule.rate_hz.0.recip());
        Ok(Self {
            elements: elements_of(&opened.scanner),
            parameters: LayoutParameters { angles: 3, nuisance: Vec::new() },
            detection: PhotonDetection::of_block(&opened.scanner, &opened.scintillator),
            block_law: errors.law,
            noise: LineNoise::of_block(&opened.scanner, &errors, &SourceNoise::of_markers(&as_sources))
                .wide_enough_for(&markers),
            window_s: table.window_s.map(|window| window.0).or(installed_s).or(period_s).unwrap_or(WINDOW_S),
            background_share: table.background_share.0,
            per_side: table.per_side as usize,
            scanner: opened.scanner,
            phantom: opened.phantom,
            markers,
            sources,
        })
    }

    /// Length of a window, s.
    pub fn window_s(&self) -> f64 {
        self.window_s
    }

    /// What the accuracy of these blocks depends on.
    fn plan<'a>(&'a self, blocks: &'a Blocks) -> Plan<'a> {
        Plan {
            scanner: &blocks.scanner,
            detection: &self.detection,
            noise: &blocks.noise,
            phantom: self.phantom.as_ref(),
            markers: &self.sources,
            // `sources` has it in its activities.
            positrons_per_decay: 1.0,
            window_s: self.window_s,
            background_share: self.background_share,
            per_side: self.per_side,
        }
    }

    /// The first marker that stands in the element's crystals, counted from 0.
    fn marker_inside(&self, element: &LayoutElement, world_from_capsule: &Isometry3<f64>) -> Option<usize> {
        let element_from_capsule = element.world_from_element.inverse() * world_from_capsule;
        let grid = &self.scanner.grid;
        self.markers.markers.iter().position(|marker| {
            let place = element_from_capsule * Point3::from(marker.position_capsule_m);
            place.x.abs() <= grid.half_length_m()
                && place.y.abs() <= grid.half_width_m()
                && (0.0..=grid.depth_m).contains(&place.z)
        })
    }
}

fn read_table(options: &Node) -> Result<LayoutTable, ModalityError> {
    let table: LayoutTable = options.parse_sourced(&LAYOUT_SOURCES)?;
    if table.background_share.0 >= 1.0 {
        let message = format!("{} leaves no true line; allowed: 0 to below 1", table.background_share.0);
        return Err(options.error_at("background_share", &message).into());
    }
    if !(1..=MOST_PER_SIDE).contains(&table.per_side) {
        let message = format!("{} parts; allowed: 1 to {MOST_PER_SIDE}", table.per_side);
        return Err(options.error_at("per_side", &message).into());
    }
    Ok(table)
}

fn elements_of(scanner: &Scanner) -> Vec<LayoutElement> {
    let crystals = f64::from(scanner.grid.columns) * f64::from(scanner.grid.rows);
    let element = |(number, block): (usize, &Block)| LayoutElement {
        name: format!("b{number}"),
        world_from_element: world_from_block(block),
        kind: number,
        cost: crystals,
    };
    scanner.blocks.iter().enumerate().map(element).collect()
}

/// Axial, tangential and outward are a right-handed frame, in this order.
fn world_from_block(block: &Block) -> Isometry3<f64> {
    let axes = Matrix3::from_columns(&[block.axial, block.tangential, block.outward]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::from(block.centre_world_m), turn)
}

fn block_at(world_from_element: &Isometry3<f64>) -> Block {
    let turn = &world_from_element.rotation;
    Block {
        centre_world_m: world_from_element.translation.vector,
        axial: turn * Vector3::x(),
        tangential: turn * Vector3::y(),
        outward: turn * Vector3::z(),
    }
}

impl LayoutModel for ScannerLayout {
    fn elements(&self) -> &[LayoutElement] {
        &self.elements
    }

    fn candidates(&self) -> &[LayoutElement] {
        &[]
    }

    fn cost_unit(&self) -> &'static str {
        "crystals"
    }

    fn parameters(&self) -> &LayoutParameters {
        &self.parameters
    }

    fn prior(&self) -> Vec<f64> {
        vec![0.0; packed_len(self.parameters.len())]
    }

    fn worker(&self) -> Box<dyn LayoutWorker + '_> {
        Box::new(Worker { layout: self, blocks: None })
    }

    fn blocked(&self, element: &LayoutElement, world_from_capsule: &Isometry3<f64>) -> Option<String> {
        let marker = self.marker_inside(element, world_from_capsule)?;
        Some(format!("marker {} stands in the block", marker + 1))
    }

    /// None: a scanner's file holds coincidences and crystals beside the places, and nothing searches for blocks one by one.
    fn to_toml(&self, _name: &str, _source: &str, _elements: &[LayoutElement]) -> Option<String> {
        None
    }
}

/// The scanner that some elements make, and the noise of its lines.
struct Blocks {
    elements: Vec<LayoutElement>,
    scanner: Scanner,
    noise: LineNoise,
}

impl Blocks {
    fn new(layout: &ScannerLayout, elements: &[LayoutElement]) -> Self {
        let installed = layout.scanner.blocks.len();
        let mut chosen: Vec<(usize, Block)> = elements
            .iter()
            .filter(|element| element.kind < installed)
            .map(|element| (element.kind, block_at(&element.world_from_element)))
            .collect();
        // The sum over directions starts from the first block of a pair: the order in which they are named must not be seen.
        chosen.sort_by_key(|(number, _)| *number);
        let scanner = layout.scanner.of_blocks(&chosen);
        let noise = layout.noise.of_other_blocks(&scanner, &layout.block_law);
        Self { elements: elements.to_vec(), scanner, noise }
    }
}

struct Worker<'a> {
    layout: &'a ScannerLayout,
    /// Those of the last pose: a map asks for the same elements at every pose.
    blocks: Option<Blocks>,
}

impl Worker<'_> {
    fn blocks(&mut self, elements: &[LayoutElement]) -> &Blocks {
        let known = self.blocks.take().filter(|blocks| blocks.elements == elements);
        self.blocks.insert(known.unwrap_or_else(|| Blocks::new(self.layout, elements)))
    }
}

impl LayoutWorker for Worker<'_> {
    fn together(&mut self, elements: &[LayoutElement], pose: &Isometry3<f64>, information: &mut [f64]) {
        let layout = self.layout;
        let is_free = |element: &&LayoutElement| layout.marker_inside(element, pose).is_none();
        let expected = if elements.iter().all(|element| is_free(&element)) {
            layout.plan(self.blocks(elements)).expected(pose)
        } else {
            let free: Vec<LayoutElement> = elements.iter().filter(is_free).cloned().collect();
            layout.plan(&Blocks::new(layout, &free)).expected(pose)
        };
        pack(&expected.information, information);
    }

    fn each(&mut self, _: &[LayoutElement], _: &Isometry3<f64>, _: &mut [f64]) -> bool {
        false
    }
}

/// The lower triangle, row by row.
fn pack(information: &Matrix6<f64>, packed: &mut [f64]) {
    let entries = (0..6).flat_map(|i| (0..=i).map(move |j| information[(i, j)]));
    packed.iter_mut().zip(entries).for_each(|(to, from)| *to = from);
}

#[cfg(test)]
mod tests;
