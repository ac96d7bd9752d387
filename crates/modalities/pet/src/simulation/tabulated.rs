//! The fastest mode, for long and many runs: aimed photons, the blocks' response and backgrounds from tables.
//!
//! True lines, and scattered ones of which one photon is direct, are made as in [`super::forced`], but each kind by itself, and what it asks
//! for thins the draws before anything is computed, tile by tile of the blocks' faces: true lines the transmission of both photons, the largest
//! acceptance of both blocks under the angles that there are, and a block behind the marker that the other photon can meet; scattered ones a first
//! scattering that leaves enough energy ([`super::scattering`]). The blocks' response comes from
//! [`super::response`]. The rest (lines with a prompt gamma, lines without a direct photon, singles for random lines) comes from
//! [`super::tables`], a grid over the marker's place. A node is chosen with its trilinear weight, so rates and lines are
//! interpolated linearly.
//!
//! Approximate where `forced` is not: see [`super::response`]; directions and transmission are taken at the marker's place, not the
//! annihilation's (a positron's range beside it); background lines are blurred by the grid's spacing.

use super::Physics;
use super::aim::{Aim, Aimed, Shares};
use super::block::Deposit;
use super::coincidence::LabelledLine;
use super::compton::deflected;
use super::detectors::{Hit, Kind, Single};
use super::forced::{Window, draw_pair, random_line};
use super::photon::Photon;
use super::response::{Placed, Response};
use super::source::{ANNIHILATION_EV, MarkerPaths, opposite};
use super::tables::{Key, Node, SPACING_M, Tables, kind_of};
use lumenav_core::RandomStream;
use nalgebra::Vector3;
use rand::RngExt as _;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Rectangles of the aim are cut into so many tiles along each side, each drawn as often as what goes there can make a line.
const TILES: usize = 4;
/// Transmission within a tile is at most this times the largest at its corners, that of two photons at most its square (within a tile of
/// 45 mm at 0.4 m directions differ by 6 degrees); where a voxel body has finer structure the excess is cut off.
const TILE_MARGIN: f64 = 1.1;

/// The tabulated mode.
#[derive(Clone, Debug)]
pub(super) struct Tabulated {
    tables: Arc<Tables>,
    aim: Aim,
    /// Those of the tables that this run came near.
    nodes: BTreeMap<Key, Arc<Node>>,
    /// By marker: eight keys and weights.
    corners: Vec<[(Key, f64); 8]>,
}

/// One marker's photons of one window.
#[derive(Clone, Copy)]
struct Source<'a> {
    physics: &'a Physics,
    paths: &'a MarkerPaths,
    marker: usize,
    /// Annihilation photons of decays without a prompt gamma that is read out.
    photons: f64,
    window: Window,
}

impl Source<'_> {
    /// The photon opposite to one.
    fn other(&self, first: &Photon, random: &mut RandomStream) -> Photon {
        let direction = opposite(&first.direction, self.physics.acollinearity_sigma_rad, random);
        Photon::emitted(first.place_m, direction, ANNIHILATION_EV)
    }
}

/// The aimed photon.
struct First {
    after_s: f64,
    aimed: Aimed,
    photon: Photon,
    shares: Shares,
    /// Its way through the body.
    chord_m: Option<(f64, f64)>,
}

impl First {
    /// The way of the other photon through the body; that they miss 180 degrees by half a degree is neglected.
    fn chord_of_other_m(&self) -> Option<(f64, f64)> {
        self.chord_m.map(|(near_m, far_m)| (-far_m, -near_m))
    }
}

/// The other photon, outside the body.
struct Second {
    photon: Photon,
    scatterings: u32,
    /// Acceptance by which it was drawn.
    given: f64,
}

/// What a marker's photons may meet, seen from where it is in the middle of a window.
struct Sight<'a> {
    physics: &'a Physics,
    from_m: Vector3<f64>,
    /// No photon of the window starts further away, m.
    within_m: f64,
    /// Diagonal of a tile, m.
    tile_m: f64,
}

/// A way to the corner of a tile.
struct Way {
    block: usize,
    direction: Vector3<f64>,
    length_m: f64,
}

impl<'a> Sight<'a> {
    /// Acollinearity is within so many standard deviations of each of its two axes: all but one pair in 300,000.
    const DEVIATIONS: f64 = 5.0;
    /// Rectangles reach so far beyond their blocks, as a share: shadows of the back edges.
    const SHADOW: f64 = 1.5;
    /// A tile is seen from its corners alone. Its shadow behind the marker is `SHADOW / TILES` blocks wide where both are as far away, so that
    /// a block that is met at more than so many times its distance may lie between the corners.
    const FURTHEST: f64 = 2.0;

    fn new(source: Source<'a>) -> Self {
        let Source { physics, paths, marker, window, .. } = source;
        let from_m = paths.at(marker, 0.5 * window.duration_s);
        let moved_m = paths.knots(marker).map(|knot| (knot - from_m).norm()).fold(0.0, f64::max);
        let g = &physics.detectors.scanner().grid;
        Self {
            physics,
            from_m,
            within_m: moved_m + physics.markers[marker].reach_m(),
            tile_m: Self::SHADOW * 2.0 * g.half_width_m().hypot(g.half_length_m()) / TILES as f64,
        }
    }

    fn to(&self, block: usize, corner_m: &Vector3<f64>) -> Way {
        let way = corner_m - self.from_m;
        let length_m = way.norm();
        Way { block, direction: way / length_m, length_m }
    }

    /// Share of photons in a direction that get out of the body; 1 from outside it, where one at a corner tells nothing of those beside it.
    fn through(&self, direction: &Vector3<f64>) -> f64 {
        let body = &self.physics.body;
        match body.chord_m(&self.from_m, direction) {
            Some((near_m, _)) if near_m < 0.0 => body.transmission_511(&self.from_m, direction),
            _ => 1.0,
        }
    }

    /// The largest acceptance of photons to about this corner.
    fn first(&self, response: &Response, way: &Way) -> f64 {
        let outward = &self.physics.detectors.scanner().blocks[way.block].outward;
        response.most_at_511_within(wider(way.direction.dot(outward), self.within_m / way.length_m))
    }

    /// The largest acceptance of their other photons.
    fn second(&self, response: &Response, way: &Way) -> f64 {
        let detectors = &self.physics.detectors;
        let scanner = detectors.scanner();
        let back = Photon::emitted(self.from_m, -way.direction, ANNIHILATION_EV);
        let turned_rad = Self::DEVIATIONS * self.physics.acollinearity_sigma_rad;
        let within_rad = turned_rad + self.within_m / way.length_m;
        let mut most = 0.0_f64;
        for other in (0..scanner.blocks.len()).filter(|other| scanner.can_coincide(way.block, *other)) {
            let seen = detectors.to_block(other, &back);
            // Turned about its own axis, a block may poke a corner into the shadow of a tile whose own corners it leaves out.
            let upright = scanner.blocks[way.block].axial.dot(&scanner.blocks[other].axial).abs() > UPRIGHT;
            let is_far = seen.place_m.z.abs() > Self::FURTHEST * way.length_m * seen.direction.z || !upright;
            let near = (self.within_m, within_rad);
            if !is_far && detectors.physics().is_missed_from_about(&seen.place_m, &seen.direction, near) {
                continue;
            }
            // Of a tile that lies in this block's sight in part, the rest of this corner's neighbourhood.
            let wider_rad = within_rad + self.tile_m / way.length_m;
            most = most.max(response.most_at_511_within(wider(seen.direction.z, wider_rad)));
        }
        most
    }
}

/// Blocks whose axes along the scanner differ by less stand alike, cosine.
const UPRIGHT: f64 = 1.0 - 1e-6;

/// Cosine of an angle that is so much larger, at most a right one.
fn wider(cosine: f64, by_rad: f64) -> f64 {
    (cosine.clamp(-1.0, 1.0).acos() + by_rad).min(std::f64::consts::FRAC_PI_2).cos()
}

impl Tabulated {
    /// Looks up these tables.
    pub fn new(tables: Arc<Tables>) -> Self {
        Self { tables, aim: Aim::default(), nodes: BTreeMap::new(), corners: Vec::new() }
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
            if !self.aim.set(physics, paths, marker, 1, |_, _| Shares::ALL) {
                return false;
            }
        }
        self.corners.clear();
        for marker in 0..physics.markers.len() {
            let decays = physics.decay_rate_hz(marker, window.start_s) * window.duration_s;
            let corners = corners_of(physics, paths, marker, window);
            for (key, weight) in corners {
                if weight > 0.0 && !self.nodes.contains_key(&key) {
                    self.nodes.insert(key, self.tables.node(key));
                }
            }
            self.corners.push(corners);
            let unprompted = 1.0 - self.mean(marker, |node| node.prompts_per_decay);
            let photons = 2.0 * decays * physics.positrons_per_decay[marker] * unprompted;
            let source = Source { physics, paths, marker, photons, window };
            self.true_lines(source, random, out);
            self.scattered_lines(source, random, out);
            self.background((marker, decays), window, random, out);
        }
        self.randoms_and_losses(physics, window, random, out);
        true
    }

    /// Interpolates a number of the nodes at a marker.
    fn mean(&self, marker: usize, of: impl Fn(&Node) -> f64) -> f64 {
        self.corners[marker]
            .iter()
            .filter_map(|(key, weight)| self.nodes.get(key).map(|node| weight * of(node.as_ref())))
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
        chosen.map(Arc::as_ref)
    }

    /// Lines of two direct photons. Either can be the aimed one, so half of them are drawn.
    fn true_lines(&mut self, source: Source, random: &mut RandomStream, out: &mut Vec<LabelledLine>) {
        let body = &source.physics.body;
        let response = &self.tables.response;
        let sight = Sight::new(source);
        self.aim.set(source.physics, source.paths, source.marker, TILES, |block, corner| {
            let way = sight.to(block, corner);
            let through = sight.through(&way.direction) * sight.through(&-way.direction);
            Shares {
                through: TILE_MARGIN * TILE_MARGIN * through,
                first: sight.first(response, &way),
                second: sight.second(response, &way),
            }
        });
        let draws = 0.5 * source.photons * self.aim.draws_per_photon();
        for number in 0..super::poisson(draws, random) {
            let Some(first) = self.aimed(source, random) else { continue };
            // Straight through the body: half a degree more or less is neglected, as in the way of the other.
            let Photon { place_m, direction, .. } = first.photon;
            let both = body.transmission_511_along(&place_m, &direction, first.chord_m)
                * body.transmission_511_along(&place_m, &-direction, first.chord_of_other_m());
            if random.random::<f64>() * first.shares.through >= both {
                continue;
            }
            let second = source.other(&first.photon, random);
            let second = Second { photon: second, scatterings: 0, given: first.shares.second };
            out.extend(self.line(source, &first, &second, number, random));
        }
    }

    /// Lines of a direct photon and one that scattered.
    fn scattered_lines(&mut self, source: Source, random: &mut RandomStream, out: &mut Vec<LabelledLine>) {
        let body = &source.physics.body;
        let (response, scatterings) = (&self.tables.response, &self.tables.scatterings);
        let sight = Sight::new(source);
        self.aim.set(source.physics, source.paths, source.marker, TILES, |block, corner| {
            let way = sight.to(block, corner);
            let through = TILE_MARGIN * sight.through(&way.direction);
            Shares { through, first: sight.first(response, &way), second: 1.0 }
        });
        let draws = source.photons * self.aim.draws_per_photon() * scatterings.per_scattering();
        for number in 0..super::poisson(draws, random) {
            let Some(scattering) = scatterings.draw(response, random) else { continue };
            let Some(first) = self.aimed(source, random) else { continue };
            let photon = &first.photon;
            let through = body.transmission_511_along(&photon.place_m, &photon.direction, first.chord_m);
            if random.random::<f64>() * first.shares.through >= through {
                continue;
            }
            let mut second = source.other(photon, random);
            if !body.reach_scattering(&mut second, first.chord_of_other_m(), random) {
                continue;
            }
            second.energy_ev = scattering.energy_ev;
            second.direction = deflected(&second.direction, scattering.cos_angle, random);
            let Some(more) = body.leave(&mut second, random) else { continue };
            let given = response.most_at(second.energy_ev);
            if random.random::<f64>() * scattering.given >= given {
                continue;
            }
            let second = Second { photon: second, scatterings: 1 + more, given };
            out.extend(self.line(source, &first, &second, number, random));
        }
    }

    /// An aimed photon.
    fn aimed(&self, source: Source, random: &mut RandomStream) -> Option<First> {
        let Source { physics, paths, marker, window, .. } = source;
        let after_s = window.duration_s * random.random::<f64>();
        let place_m = paths.at(marker, after_s);
        let aimed = self.aim.draw(physics, random);
        let direction = Aim::keep(&aimed, physics, &place_m)?;
        let photon = Photon::emitted(place_m, direction, ANNIHILATION_EV);
        let chord_m = physics.body.chord_m(&place_m, &direction);
        Some(First { after_s, aimed, photon, shares: self.aim.shares(&aimed), chord_m })
    }

    /// The line of two photons outside the body, where both are detected and the first enters the block that it was aimed at.
    fn line(
        &self,
        source: Source,
        first: &First,
        second: &Second,
        number: u64,
        random: &mut RandomStream,
    ) -> Option<LabelledLine> {
        let Source { physics, marker, window, .. } = source;
        let detectors = &physics.detectors;
        let (other_block, _) = detectors.first_block(&second.photon, &[])?;
        let block = first.aimed.block;
        if !detectors.scanner().can_coincide(block, other_block)
            || !detectors.enters_first(block, &first.photon)
        {
            return None;
        }
        // Blocks are found from the marker's place, entries from the annihilation's.
        let offset_m = physics.markers[marker].annihilation_offset_m(random);
        let response = &self.tables.response;
        let mut placed = |block: usize, mut photon: Photon, given: f64| {
            photon.place_m += offset_m;
            response.draw(&detectors.to_block(block, &photon).on_face(), given, random)
        };
        let at_b = placed(other_block, second.photon, second.given)?;
        let at_a = placed(block, first.photon, first.shares.first)?;
        let name = (first.after_s, number as u32, marker);
        let a = single(physics, (block, &at_a, 0), name, random)?;
        let b = single(physics, (other_block, &at_b, second.scatterings), name, random)?;
        let is_in_time = (a.after_s - b.after_s).abs() < detectors.scanner().detection.coincidence_window_s;
        is_in_time.then(|| LabelledLine::of(&a, &b, window.start_s, window.duration_s))
    }

    /// Lines with a prompt gamma, and lines without a direct photon.
    fn background(
        &self,
        (marker, decays): (usize, f64),
        window: Window,
        random: &mut RandomStream,
        out: &mut Vec<LabelledLine>,
    ) {
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

/// A photon that passed the energy window, read out.
fn single(
    physics: &Physics,
    (block, placed, scatterings): (usize, &Placed, u32),
    (after_s, decay, marker): (f64, u32, usize),
    random: &mut RandomStream,
) -> Option<Single> {
    let deposit = Deposit {
        energy_ev: ANNIHILATION_EV,
        crystal: placed.crystal,
        crystal_energy_ev: ANNIHILATION_EV,
        place_block_m: placed.place_block_m,
        path_m: 0.0,
    };
    let hit = Hit { block, deposit, kind: Kind::Annihilation, scatterings };
    physics.detectors.read_out_accepted(&hit, after_s, decay, marker as u8, random)
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
