//! What the tabulated mode looks up, shared by all runs of a process that have the same set-up.
//!
//! A table's numbers depend on scanner, crystals, body, acollinearity and what the markers are made of, not on where they are in the
//! capsule, how active they are, the run, its seed, or who came first: a hundred trials make a node once.

use super::Physics;
use super::coincidence::LabelledLine;
use super::forced::{Forced, Keep, Sample, Window};
use super::response::Response;
use super::scattering::Scatterings;
use super::source::{MarkerPaths, SourceMarker};
use lumenav_core::RandomStreams;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Distance between nodes of the background's table, m. At 50 mm the curvature of the singles' rate over a water cylinder of 20 cm
/// made a third too many randoms; the error falls with the square.
pub const SPACING_M: f64 = 0.025;
/// Decays of which a node's lines are made at a time.
const BATCH_DECAYS: f64 = 1e6;
/// A node has enough lines with this many (eight nodes mix), or after so many batches.
const ENOUGH_LINES: usize = 60;
const MOST_BATCHES: usize = 3;
/// Whole decays that a node's singles are made of.
const NODE_DECAYS: usize = 15_000;

/// The first marker of the same make, and the node's place in steps of [`SPACING_M`].
pub(super) type Key = (usize, [i32; 3]);

/// Background of a marker at one place.
#[derive(Clone, Debug, Default)]
pub(super) struct Node {
    pub lines: Vec<LabelledLine>,
    pub lines_per_decay: f64,
    pub sample: Sample,
    pub lone_per_decay: f64,
    pub prompts_per_decay: f64,
    /// Share of pairs of its singles that can fire together.
    pub allowed: f64,
}

/// The tables of one set-up. Nodes are made when a run first comes near.
#[derive(Debug)]
pub(super) struct Tables {
    physics: Physics,
    pub response: Response,
    pub scatterings: Scatterings,
    nodes: Mutex<BTreeMap<Key, Arc<OnceLock<Arc<Node>>>>>,
}

impl Tables {
    /// Makes the response's table.
    pub fn new(physics: &Physics) -> Self {
        let detectors = &physics.detectors;
        let response = Response::new(detectors.scanner(), detectors.physics(), detectors.kill_ev());
        let scatterings = Scatterings::new(&response, detectors.kill_ev());
        Self { physics: physics.clone(), response, scatterings, nodes: Mutex::default() }
    }

    /// A node; whoever comes while it is being made waits for it.
    pub fn node(&self, key: Key) -> Arc<Node> {
        let place = {
            // A thread that died while it held the lock left a map of whole entries.
            let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
            nodes.entry(key).or_default().clone()
        };
        place.get_or_init(|| Arc::new(make_node(&self.physics, key))).clone()
    }

    /// Whether this set-up's numbers are those of the tables.
    fn fit(&self, physics: &Physics) -> bool {
        let ours = &self.physics;
        ours.detectors == physics.detectors
            && ours.body == physics.body
            && ours.acollinearity_sigma_rad == physics.acollinearity_sigma_rad
            && ours.markers.len() == physics.markers.len()
            && ours.markers.iter().zip(&physics.markers).all(|(a, b)| alike(a, b))
    }
}

/// Tables by set-up, for simulators that are made one after another or at the same time.
#[derive(Clone, Debug, Default)]
pub struct TableStore {
    tables: Arc<Mutex<Vec<Arc<Tables>>>>,
}

impl TableStore {
    /// The tables of a set-up.
    pub(super) fn of(&self, physics: &Physics) -> Arc<Tables> {
        let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = tables.iter().find(|known| known.fit(physics)) {
            return known.clone();
        }
        let made = Arc::new(Tables::new(physics));
        tables.push(made.clone());
        made
    }
}

/// Markers of the same make, wherever they are and however active.
fn alike(a: &SourceMarker, b: &SourceMarker) -> bool {
    a.isotope == b.isotope && a.core_diameter_m == b.core_diameter_m && a.shell == b.shell
}

/// Markers that are alike share nodes.
pub(super) fn kind_of(physics: &Physics, marker: usize) -> usize {
    let here = &physics.markers[marker];
    physics.markers.iter().position(|m| alike(m, here)).unwrap_or(marker)
}

/// Makes a node by the forced mode.
fn make_node(physics: &Physics, key: Key) -> Node {
    let marker = key.0;
    let place_m = Vector3::from(key.1.map(|n| f64::from(n) * SPACING_M));
    let name = key.1.iter().fold(key.0 as u64, |name, n| name << 16 | (i64::from(*n) & 0xffff) as u64);
    let mut random = RandomStreams::new(0, 0, "pet-tables").stream("background", name);
    let window = Window { start_s: 0.0, duration_s: 1.0 };
    let mut alone = physics.clone();
    alone.markers = vec![physics.markers[marker].clone()];
    alone.positrons_per_decay = vec![physics.positrons_per_decay[marker]];
    let mut paths = MarkerPaths::default();
    paths.rest(&place_m);
    let mut node = Node::default();
    let mut forced = Forced::default();
    forced.sample(&alone, &paths, window, NODE_DECAYS, &mut random);
    node.sample = forced.sample.clone();
    node.lone_per_decay = node.sample.lone.len() as f64 / NODE_DECAYS as f64;
    node.prompts_per_decay = node.sample.prompts_per_decay;
    node.allowed = node.sample.allowed_share();
    if !forced.set_aim(&alone, &paths, 0) {
        return node;
    }
    let photons = 2.0 * BATCH_DECAYS * alone.positrons_per_decay[0];
    let mut batches = 0;
    let mut lines = Vec::new();
    while node.lines.len() < ENOUGH_LINES && batches < MOST_BATCHES {
        lines.clear();
        forced.direct(&alone, &paths, (0, photons), window, Keep::PromptOnly, &mut random, &mut lines);
        lines.retain(|line| line.label.has_prompt());
        forced.indirect(&alone, &paths, (0, photons), window, &mut random, &mut lines);
        node.lines.append(&mut lines);
        batches += 1;
    }
    node.lines_per_decay = node.lines.len() as f64 / (batches as f64 * BATCH_DECAYS);
    node
}
