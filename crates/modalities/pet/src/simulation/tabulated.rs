//! The fastest mode, for long and many runs: aimed photons, the blocks' response and backgrounds from tables.
//!
//! True and scattered lines of which one photon is direct are made as in [`super::forced`], but the response comes from
//! [`super::response`] and its largest acceptance thins the draws before anything is computed. The rest (lines with a prompt gamma,
//! lines without a direct photon, singles for random lines) comes from a table over the marker's place: a grid of [`SPACING_M`] whose
//! nodes are made by the forced mode when a run first comes near. A node is chosen with its trilinear weight, so rates and lines are
//! interpolated linearly. A node's numbers depend on the set-up alone, not on the run, its seed or who came first.
//!
//! Approximate where `forced` is not: see [`super::response`]; directions and transmission are taken at the marker's place, not the
//! annihilation's (a millimetre beside it); background lines are blurred by the grid's spacing.

use super::Physics;
use super::aim::Aim;
use super::block::Deposit;
use super::coincidence::LabelledLine;
use super::detectors::{Hit, Kind, Single};
use super::forced::{Forced, Keep, Sample, Window, draw_pair, random_line};
use super::photon::Photon;
use super::response::Response;
use super::source::{ANNIHILATION_EV, MarkerPaths, opposite};
use lumenav_core::{RandomStream, RandomStreams};
use nalgebra::Vector3;
use rand::RngExt as _;
use std::collections::BTreeMap;

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

/// Background of a marker at one place.
#[derive(Clone, Debug, Default)]
struct Node {
    lines: Vec<LabelledLine>,
    lines_per_decay: f64,
    sample: Sample,
    lone_per_decay: f64,
    prompts_per_decay: f64,
    /// Share of pairs of its singles that can fire together.
    allowed: f64,
}

/// Rectangles of the aim are cut into so many tiles along each side, each drawn as often as photons get out of the body there.
const TILES: usize = 4;
/// Transmission within a tile is at most this times the largest at its corners (within a tile of 45 mm at 0.4 m directions differ by
/// 6 degrees); where a voxel body has finer structure the excess is cut off.
const TILE_MARGIN: f64 = 1.1;

type Key = (usize, [i32; 3]);

/// Tables and room of the tabulated mode.
#[derive(Clone, Debug)]
pub(super) struct Tabulated {
    response: Response,
    aim: Aim,
    nodes: BTreeMap<Key, Node>,
    /// By marker: eight keys and weights.
    corners: Vec<[(Key, f64); 8]>,
}

impl Tabulated {
    /// Makes the response's table; nodes are made when needed.
    pub fn new(physics: &Physics) -> Self {
        let detectors = &physics.detectors;
        let response = Response::new(detectors.scanner(), detectors.physics(), detectors.kill_ev());
        Self { response, aim: Aim::default(), nodes: BTreeMap::new(), corners: Vec::new() }
    }

    /// All lines of a window, unsorted; `false` where a marker is too near to a block.
    pub fn window(
        &mut self,
        physics: &Physics,
        paths: &MarkerPaths,
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) -> bool {
        for marker in 0..physics.markers.len() {
            if !self.aim.set(physics, paths, marker, 1, |_| 1.0) {
                return false;
            }
        }
        self.corners.clear();
        for marker in 0..physics.markers.len() {
            let from_m = paths.at(marker, 0.5 * window.duration_s);
            self.aim.set(physics, paths, marker, TILES, |corners| {
                let through = |corner: &Vector3<f64>| {
                    physics.body.transmission_511(&from_m, &(corner - from_m).normalize())
                };
                (TILE_MARGIN * corners.iter().map(through).fold(0.0, f64::max)).min(1.0)
            });
            let decays = physics.decay_rate_hz(marker, window.start_s) * window.duration_s;
            let corners = corners_of(physics, paths, marker, window);
            for (key, weight) in corners {
                if weight > 0.0 && !self.nodes.contains_key(&key) {
                    let node = make_node(physics, marker, key);
                    self.nodes.insert(key, node);
                }
            }
            self.corners.push(corners);
            let unprompted = 1.0 - self.mean(marker, |node| node.prompts_per_decay);
            self.direct(physics, paths, (marker, decays), unprompted, window, random, out);
            self.background(physics, (marker, decays), window, random, out);
        }
        self.randoms_and_losses(physics, window, random, out);
        true
    }

    /// Interpolates a number of the nodes at a marker.
    fn mean(&self, marker: usize, of: impl Fn(&Node) -> f64) -> f64 {
        self.corners[marker]
            .iter()
            .filter_map(|(key, weight)| self.nodes.get(key).map(|node| weight * of(node)))
            .sum()
    }

    /// Chooses a node of a marker with its weight times a number.
    fn choose(&self, marker: usize, of: impl Fn(&Node) -> f64, random: &mut RandomStream) -> Option<&Node> {
        let mut level = random.random::<f64>() * self.mean(marker, &of);
        let mut chosen = None;
        for (key, weight) in &self.corners[marker] {
            let Some(node) = self.nodes.get(key) else { continue };
            let share = weight * of(node);
            if share > 0.0 {
                chosen = Some(node);
                level -= share;
                if level < 0.0 {
                    break;
                }
            }
        }
        chosen
    }

    /// True and scattered lines with a direct photon.
    #[expect(
        clippy::too_many_arguments,
        reason = "what one photon is made of; a struct of it would be taken apart at once"
    )]
    fn direct(
        &self,
        physics: &Physics,
        paths: &MarkerPaths,
        (marker, decays): (usize, f64),
        unprompted: f64,
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let detectors = &physics.detectors;
        let photons = 2.0 * decays * physics.positrons_per_decay[marker] * unprompted;
        let most = self.response.most_at_511;
        let draws = super::poisson(photons * self.aim.draws_per_photon() * most, random);
        for number in 0..draws {
            let after_s = window.duration_s * random.random::<f64>();
            let place_m = paths.at(marker, after_s);
            let aimed = self.aim.draw(physics, random);
            let Some(direction) = Aim::keep(&aimed, physics, &place_m) else { continue };
            let chord_m = physics.body.chord_m(&place_m, &direction);
            let through = physics.body.transmission_511_along(&place_m, &direction, chord_m);
            if random.random::<f64>() * self.aim.drawn(&aimed) >= through {
                continue;
            }
            // The other photon next: it is lost more often than the first is missed by its block.
            let other = opposite(&direction, physics.acollinearity_sigma_rad, random);
            let mut second = Photon::emitted(place_m, other, ANNIHILATION_EV);
            let backwards_m = chord_m.map(|(near_m, far_m)| (-far_m, -near_m));
            let Some(scatterings) = physics.body.leave_along(&mut second, backwards_m, random) else {
                continue;
            };
            let Some((other_block, near_m)) = detectors.first_block(&second, &[]) else { continue };
            second.advance(near_m);
            let mut first = Photon::emitted(place_m, direction, ANNIHILATION_EV);
            let Some((block, near_m)) = detectors.first_block(&first, &[]) else { continue };
            if block != aimed.block || !detectors.scanner().can_coincide(block, other_block) {
                continue;
            }
            first.advance(near_m);
            // Blocks are found from the marker's place, entries from the annihilation's.
            let offset_m = physics.markers[marker].annihilation_offset_m(random);
            let mut placed = |block: usize, mut photon: Photon, given: f64| {
                photon.place_m += offset_m;
                let local = detectors.to_block(block, &photon).on_face();
                self.response.draw(&local, given, random)
            };
            let (Some(b_m), Some(a_m)) = (placed(other_block, second, 1.0), placed(block, first, most))
            else {
                continue;
            };
            if scatterings == 0 && random.random::<bool>() {
                continue;
            }
            let single = |block: usize,
                          place_m: Vector3<f64>,
                          scatterings: u32,
                          random: &mut RandomStream| {
                self.single(physics, (block, place_m, scatterings), (after_s, number as u32, marker), random)
            };
            let (Some(a), Some(b)) =
                (single(block, a_m, 0, random), single(other_block, b_m, scatterings, random))
            else {
                continue;
            };
            if (a.after_s - b.after_s).abs() < detectors.scanner().detection.coincidence_window_s {
                out.push(LabelledLine::of(&a, &b, window.start_s, window.duration_s));
            }
        }
    }

    /// A photon that passed the energy window, read out.
    #[expect(clippy::unused_self, reason = "stands among the steps of a table's photon")]
    fn single(
        &self,
        physics: &Physics,
        (block, place_block_m, scatterings): (usize, Vector3<f64>, u32),
        (after_s, decay, marker): (f64, u32, usize),
        random: &mut RandomStream,
    ) -> Option<Single> {
        let crystal = physics.detectors.scanner().cell(place_block_m.x, place_block_m.y)?;
        let deposit = Deposit {
            energy_ev: ANNIHILATION_EV,
            crystal,
            crystal_energy_ev: ANNIHILATION_EV,
            place_block_m,
            path_m: 0.0,
        };
        let hit = Hit { block, deposit, kind: Kind::Annihilation, scatterings };
        physics.detectors.read_out_accepted(&hit, after_s, decay, marker as u8, random)
    }

    /// Lines with a prompt gamma, and lines without a direct photon.
    fn background(
        &self,
        physics: &Physics,
        (marker, decays): (usize, f64),
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        debug_assert!(marker < physics.markers.len());
        let rate = |node: &Node| node.lines_per_decay;
        let count = super::poisson(decays * self.mean(marker, rate), random);
        for _ in 0..count {
            let Some(node) = self.choose(marker, rate, random) else { continue };
            let mut line = node.lines[random.random_range(0..node.lines.len())];
            line.line.t_s = window.start_s + window.duration_s * random.random::<f64>();
            line.label.markers = [marker as u8; 2];
            out.push(line);
        }
    }

    /// Random lines, and lines lost to third singles and dead time.
    fn randoms_and_losses(
        &self,
        physics: &Physics,
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
        let decays = |marker: usize| physics.decay_rate_hz(marker, window.start_s) * window.duration_s;
        let lone = |node: &Node| node.lone_per_decay;
        let lone_singles = |marker: usize| decays(marker) * self.mean(marker, lone);
        let all: f64 = (0..physics.markers.len()).map(lone_singles).sum();
        if all <= 0.0 {
            return;
        }
        let allowed: f64 = (0..physics.markers.len())
            .map(|m| lone_singles(m) / all * self.mean(m, |node| node.allowed))
            .sum();
        let window_s = physics.detectors.scanner().detection.coincidence_window_s;
        let count = super::poisson(all * all * allowed * window_s / window.duration_s, random);
        let marker_of = |random: &mut RandomStream| {
            let mut level = random.random::<f64>() * all;
            (0..physics.markers.len() - 1)
                .find(|m| {
                    level -= lone_singles(*m);
                    level < 0.0
                })
                .unwrap_or(physics.markers.len() - 1)
        };
        for _ in 0..count {
            let markers = [marker_of(random), marker_of(random)];
            let (Some(a), Some(b)) =
                (self.choose(markers[0], lone, random), self.choose(markers[1], lone, random))
            else {
                continue;
            };
            if let Some((mut a, mut b)) = draw_pair(physics, &a.sample.lone, &b.sample.lone, random) {
                (a.marker, b.marker) = (markers[0] as u8, markers[1] as u8);
                out.push(random_line(physics, (a, b), window, random));
            }
        }
        // The busiest marker's nearest node stands for the singles of all.
        let Some(node) = self.choose(marker_of(random), lone, random) else { return };
        let total: f64 = (0..physics.markers.len()).map(decays).sum();
        node.sample.thin(physics, total / window.duration_s, random, out);
    }
}

/// Markers that are alike share nodes.
fn kind_of(physics: &Physics, marker: usize) -> usize {
    let here = &physics.markers[marker];
    physics
        .markers
        .iter()
        .position(|m| {
            m.isotope == here.isotope && m.core_diameter_m == here.core_diameter_m && m.shell == here.shell
        })
        .unwrap_or(marker)
}

/// The eight nodes around a marker in the middle of a window, with their weights.
fn corners_of(physics: &Physics, paths: &MarkerPaths, marker: usize, window: Window) -> [(Key, f64); 8] {
    let place = paths.at(marker, 0.5 * window.duration_s) / SPACING_M;
    let kind = kind_of(physics, marker);
    let base = place.map(f64::floor);
    let part = place - base;
    std::array::from_fn(|corner| {
        let mut weight = 1.0;
        let node = std::array::from_fn(|axis| {
            let up = corner >> axis & 1;
            weight *= if up == 1 { part[axis] } else { 1.0 - part[axis] };
            base[axis] as i32 + up as i32
        });
        ((kind, node), weight)
    })
}

/// Makes a node by the forced mode.
fn make_node(physics: &Physics, marker: usize, key: Key) -> Node {
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
