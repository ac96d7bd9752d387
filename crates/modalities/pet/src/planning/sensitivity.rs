//! Lines per second of a source in a body, without chance: every pair of blocks that can fire together, seen from the source.
//!
//! ```text
//! R = A β Σ_{a<b} ∫_a 2 dΩ/4π  e^{-τ(n) - τ(-n)}  D(n, a) D(-n, b)      (the ray -n must meet block b)
//! D = η (1 - e^{-μ_s depth / cos ϑ}) · accepted(e)
//! ```
//!
//! β positrons per decay, τ the optical depth at 511 keV, μ_s the scintillator's, e the distance from the block's nearest edge, where a part
//! of what scatters leaves the block. The integral runs over the block's face by the midpoint rule, in parts of which each counts by the
//! share that sees the partner. Lines of photons that did not scatter in the body, alone: scattered and random lines are the background,
//! which a plan takes as a share. Neglected: photons that enter a block through its side, whether one heads for the edge that is near, dead time.

use crate::Scanner;
use crate::simulation::Scintillator;
use crate::simulation::block::{BlockPhysics, EDGES_M, FIELD_M, passes_window};
use crate::simulation::compton::ELECTRON_REST_ENERGY_EV;
use crate::simulation::photon::Photon;
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::RandomStreams;
use nalgebra::Vector3;
use rand::RngExt as _;

/// How a block answers to a photon that enters its face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonDetection {
    /// Attenuation of the scintillator at 511 keV, 1/m.
    pub attenuation_per_m: f64,
    /// Share of the photons that interact in a block whose deposit falls into the energy window, by [`EDGES_M`].
    pub accepted: [f64; EDGES_M.len() + 1],
}

/// Photons that [`PhotonDetection::of_block`] sends into a block: its largest share then stands to half a per cent.
const TRIALS: u32 = 40_000;

impl PhotonDetection {
    /// From the block's physics, which both sides know: annihilation photons from about the scanner's middle enter the face of one block
    /// anywhere, and those that pass the energy window are counted. Gaps between crystals are in it. Always the same draws.
    pub fn of_block(scanner: &Scanner, scintillator: &Scintillator) -> Self {
        let [attenuation_per_m, _] = scintillator.attenuation_per_m(ELECTRON_REST_ENERGY_EV);
        let block = BlockPhysics::new(scanner, scintillator.clone());
        let mut random = RandomStreams::new(0, 0, "pet-planning").stream("block", 0);
        let grid = &scanner.grid;
        let middle = scanner.to_block(0, &scanner.middle_m());
        let (mut passed, mut interacting) = ([0.0; EDGES_M.len() + 1], [0.0; EDGES_M.len() + 1]);
        for _ in 0..TRIALS {
            let mut spread = |half_m: f64| half_m * (2.0 * random.random::<f64>() - 1.0);
            let from = middle + Vector3::new(spread(FIELD_M), spread(FIELD_M), spread(FIELD_M));
            let place = Vector3::new(spread(grid.half_width_m()), spread(grid.half_length_m()), 0.0);
            let Some(direction) = (place - from).try_normalize(0.0).filter(|d| d.z > 0.0) else { continue };
            let step = edge_step(scanner, place.x, place.y);
            interacting[step] -= (-attenuation_per_m * grid.depth_m / direction.z).exp_m1();
            let mut photon = Photon::emitted(place - direction * 1e-3, direction, ELECTRON_REST_ENERGY_EV);
            let deposit = block.respond(&mut photon, &mut random);
            let is_accepted = deposit.is_some_and(|d| {
                passes_window(&scanner.detection, d.energy_ev, &mut random)
                    && scanner.told_by_light(d.place_block_m, &mut random).is_some()
            });
            passed[step] += f64::from(u8::from(is_accepted));
        }
        let share =
            |step: usize| if interacting[step] > 0.0 { passed[step] / interacting[step] } else { 0.0 };
        Self { attenuation_per_m, accepted: std::array::from_fn(share) }
    }

    fn interacting(&self, depth_m: f64, cosine: f64) -> f64 {
        -(-self.attenuation_per_m * depth_m / cosine).exp_m1()
    }
}

/// Which of the steps of [`EDGES_M`] a place on a face lies in; its coordinates along columns and rows, m.
fn edge_step(scanner: &Scanner, x_m: f64, y_m: f64) -> usize {
    let grid = &scanner.grid;
    let away_m = (grid.half_width_m() - x_m.abs()).min(grid.half_length_m() - y_m.abs());
    EDGES_M.iter().position(|end_m| away_m < *end_m).unwrap_or(EDGES_M.len())
}

/// A bundle of lines through a source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bundle {
    /// Where a line meets the middle of the crystals, world, m.
    pub ends_world_m: [Vector3<f64>; 2],
    /// Lines detected per positron.
    pub per_positron: f64,
}

/// All bundles from a source, `per_side` x `per_side` for each pair of blocks that can fire together.
///
/// The border of what a pair sees runs through the parts of a face: a part counts by the share of finer parts (at least [`RATE_PER_SIDE`] to a
/// side) from which the ray back meets the partner, and its line is that through their middle.
pub fn bundles(
    scanner: &Scanner,
    detection: &PhotonDetection,
    phantom: Option<&Phantom>,
    source_world_m: &Vector3<f64>,
    per_side: usize,
) -> Vec<Bundle> {
    let from = From { scanner, detection, phantom, source: source_world_m };
    let per_side = per_side.max(1);
    let mut all = Vec::new();
    let mut seen = Vec::new();
    for a in 0..scanner.blocks.len() {
        let partners: Vec<usize> =
            (a + 1..scanner.blocks.len()).filter(|b| scanner.can_coincide(a, *b)).collect();
        if partners.is_empty() {
            continue;
        }
        for i in 0..per_side {
            for k in 0..per_side {
                from.seen_from_part(a, &partners, [i, k], per_side, &mut seen);
                all.extend(seen.iter().filter_map(|part| from.bundle(a, part)));
            }
        }
    }
    all
}

/// What of a part of a face sees a partner.
struct SeenPart {
    partner: usize,
    /// Sum of the places of the finer parts on the face, m, and their number.
    places_m: Vector3<f64>,
    count: f64,
    /// Sum over them of what both blocks accept of what interacts.
    accepted: f64,
    /// Area of a finer part, m².
    area_m2: f64,
}

/// Lines from a source.
struct From<'a> {
    scanner: &'a Scanner,
    detection: &'a PhotonDetection,
    phantom: Option<&'a Phantom>,
    source: &'a Vector3<f64>,
}

impl From<'_> {
    /// Sorts the finer parts of one part of a block's face by the partner that the ray back meets.
    fn seen_from_part(
        &self,
        a: usize,
        partners: &[usize],
        [i, k]: [usize; 2],
        per_side: usize,
        seen: &mut Vec<SeenPart>,
    ) {
        let grid = &self.scanner.grid;
        let (width, length) = (2.0 * grid.half_width_m(), 2.0 * grid.half_length_m());
        let fine = RATE_PER_SIDE.div_ceil(per_side);
        let n = (per_side * fine) as f64;
        seen.clear();
        for i in i * fine..(i + 1) * fine {
            for k in k * fine..(k + 1) * fine {
                let (h, z) = (width * ((i as f64 + 0.5) / n - 0.5), length * ((k as f64 + 0.5) / n - 0.5));
                let place = self.scanner.in_block(a, h, z, 0.0);
                let Some((partner, there)) = self.partner(a, partners, &place) else { continue };
                let accepted = self.accepted(h, z) * self.accepted(there.x, there.y);
                match seen.iter_mut().find(|part| part.partner == partner) {
                    Some(part) => {
                        part.places_m += place;
                        part.count += 1.0;
                        part.accepted += accepted;
                    }
                    None => seen.push(SeenPart {
                        partner,
                        places_m: place,
                        count: 1.0,
                        accepted,
                        area_m2: width * length / (n * n),
                    }),
                }
            }
        }
    }

    /// What a block accepts of what interacts, at a place of its face.
    fn accepted(&self, x_m: f64, y_m: f64) -> f64 {
        self.detection.accepted[edge_step(self.scanner, x_m, y_m)]
    }

    /// The block that the ray back from a place on a block's face meets, and where on its face.
    fn partner(&self, a: usize, partners: &[usize], place: &Vector3<f64>) -> Option<(usize, Vector3<f64>)> {
        let scanner = self.scanner;
        let n = (place - self.source).try_normalize(1e-6)?;
        if n.dot(&scanner.blocks[a].outward) <= 0.0 {
            return None;
        }
        partners.iter().find_map(|b| {
            let (there, _) = self.meets(*b, &n)?;
            let local = scanner.to_block(*b, &there);
            let is_met =
                local.x.abs() <= scanner.grid.half_width_m() && local.y.abs() <= scanner.grid.half_length_m();
            is_met.then_some((*b, local))
        })
    }

    /// Where the ray back meets the plane of a block's face, and the cosine under which it does.
    fn meets(&self, b: usize, n: &Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
        let block = &self.scanner.blocks[b];
        let cosine = -n.dot(&block.outward);
        let reach_m = (block.centre_world_m - self.source).dot(&block.outward) / cosine;
        (cosine > 0.0 && reach_m > 0.0).then(|| (self.source - n * reach_m, cosine))
    }

    fn bundle(&self, a: usize, part: &SeenPart) -> Option<Bundle> {
        let detection = &self.scanner.detection;
        let depth_m = self.scanner.grid.depth_m;
        let place = part.places_m / part.count;
        let to = place - self.source;
        let distance_m = to.norm();
        let n = to.try_normalize(1e-6)?;
        let cos_a = n.dot(&self.scanner.blocks[a].outward);
        let (there, cos_b) = self.meets(part.partner, &n)?;
        let solid_angle = part.count * part.area_m2 * cos_a / (distance_m * distance_m);
        let depth = self
            .phantom
            .map_or(0.0, |p| p.optical_depth_511(self.source, &n) + p.optical_depth_511(self.source, &-n));
        let detected = detection.efficiency
            * detection.efficiency
            * self.detection.interacting(depth_m, cos_a)
            * self.detection.interacting(depth_m, cos_b)
            * (part.accepted / part.count);
        let middle =
            |place: &Vector3<f64>, along: f64, cosine: f64| place + n * (along * 0.5 * depth_m / cosine);
        Some(Bundle {
            ends_world_m: [middle(&place, 1.0, cos_a), middle(&there, -1.0, cos_b)],
            per_positron: solid_angle / std::f64::consts::TAU * (-depth).exp() * detected,
        })
    }
}

/// Faces are cut into so many parts along each side: rates then stand to 0.5 %.
pub const RATE_PER_SIDE: usize = 48;

/// True lines per second of a source of so many positrons per second.
pub fn line_rate(
    scanner: &Scanner,
    detection: &PhotonDetection,
    phantom: Option<&Phantom>,
    source_world_m: &Vector3<f64>,
    positrons_per_s: f64,
) -> f64 {
    let all = bundles(scanner, detection, phantom, source_world_m, RATE_PER_SIDE);
    positrons_per_s * all.iter().map(|bundle| bundle.per_positron).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::{Isotope, Origin, Settings, Simulator, SourceMarker};
    use lumenav_core::Node;
    use std::path::{Path, PathBuf};

    fn models() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models")
    }

    fn scanner(name: &str) -> Scanner {
        Scanner::from_node(&Node::open(&models().join(format!("scanners/{name}.toml"))).unwrap()).unwrap()
    }

    fn gso() -> PhotonDetection {
        let file = Node::open(&models().join("scintillators/gso.toml")).unwrap();
        PhotonDetection::of_block(&scanner("reduced"), &Scintillator::from_node(&file).unwrap())
    }

    fn water(diameter_cm: u32) -> Phantom {
        let path = models().join(format!("phantoms/water-{diameter_cm}.toml"));
        Phantom::from_node(&Node::open(&path).unwrap()).unwrap()
    }

    /// A pair of faces seen from the middle: the solid angle of a rectangle, `4 asin(sin α sin β)`.
    #[test]
    fn closed_form_solid_angle_of_two_pairs_of_plates() {
        let reduced = scanner("reduced");
        // A scintillator that stops everything, and no body.
        let black = PhotonDetection { attenuation_per_m: 1e9, accepted: [1.0; 3] };
        let rate = line_rate(&reduced, &black, None, &Vector3::zeros(), 1.0);
        let half_angle = |half: f64| (half / 0.43205).atan().sin();
        let (alpha, beta) =
            (half_angle(reduced.grid.half_width_m()), half_angle(reduced.grid.half_length_m()));
        let wanted = 2.0 * 4.0 * (alpha * beta).asin() / std::f64::consts::TAU;
        assert!((rate / wanted - 1.0).abs() < 1e-3, "{rate} {wanted}");
        // Off the middle by a quarter of the length only half of each face has a partner.
        let off = Vector3::new(0.0, 0.0, 0.5 * reduced.grid.half_length_m());
        let ratio = line_rate(&reduced, &black, None, &off, 1.0) / rate;
        assert!((ratio - 0.5).abs() < 0.03, "{ratio}");
    }

    /// True lines per 50 ms of an independent Monte Carlo of the reduced scanner (lines per window times true share; the helix of than2015:
    /// 57 mm radius, ±45 mm), over five sizes of body, without any calibration.
    #[test]
    fn cross_rates_follow_the_monte_carlo_over_all_sizes() {
        let (reduced, gso) = (scanner("reduced"), gso());
        for (diameter, wanted) in [
            (20, 257.0 * 0.819),
            (25, 165.0 * 0.763),
            (30, 111.0 * 0.708),
            (35, 70.0 * 0.659),
            (40, 48.0 * 0.603),
        ] {
            let phantom = water(diameter);
            let helix = (0..12).map(|i| {
                let t_s = 3.0 * f64::from(i) + 1.5;
                let angle = 5e-3 * t_s / 0.057;
                Vector3::new(0.057 * angle.cos(), 0.057 * angle.sin(), -0.045 + 2.5e-3 * t_s)
            });
            let rate = |place| line_rate(&reduced, &gso, Some(&phantom), &place, 3.0 * 1.85e6 * 0.9038);
            let mean = helix.map(|place| rate(place) * 0.05).sum::<f64>() / 12.0;
            println!("{diameter} cm: {mean:.1} of {wanted:.1} lines, {:.3}", mean / wanted);
            assert!((mean / wanted - 1.0).abs() < 0.05, "{diameter} cm: {mean} {wanted}");
        }
    }

    /// The simulator's true lines from a capsule at rest.
    #[test]
    fn cross_rate_is_the_simulators() {
        let (reduced, phantom, place) = (scanner("reduced"), water(20), Vector3::new(0.01, -0.02, 0.015));
        let open = |path: &str| Node::open(&models().join(path)).unwrap();
        let crystal = Scintillator::from_node(&open("scintillators/gso.toml")).unwrap();
        let isotope = Isotope::from_node(&open("isotopes/na-22.toml")).unwrap();
        let marker = SourceMarker {
            position_capsule_m: Vector3::zeros(),
            activity_bq: 1.85e6,
            isotope,
            core_diameter_m: 5e-4,
            shell: None,
        };
        let mut simulator = Simulator::new(
            reduced.clone(),
            crystal,
            Some(phantom.clone()),
            vec![marker],
            Settings::default(),
        );
        let rest = |_: f64| nalgebra::Isometry3::translation(place.x, place.y, place.z);
        // 8 s: some 17,000 lines, 0.8 %. (In half a second chance alone could be a third of the tolerance.)
        let (windows, window_s) = (16, 0.5);
        let (mut lines, mut found) = (Vec::new(), 0.0);
        for sequence in 0..windows {
            simulator.window(&rest, 0.0, window_s, &RandomStreams::new(3, 0, "pet"), sequence, &mut lines);
            found += lines.iter().filter(|line| line.label.origin == Origin::True).count() as f64;
        }
        let duration_s = window_s * windows as f64;
        let wanted = duration_s * line_rate(&reduced, &gso(), Some(&phantom), &place, 1.85e6 * 0.9038);
        println!("simulated {found}, by quadrature {wanted:.1}");
        assert!((found / wanted - 1.0).abs() < 0.03, "{found} {wanted}");
    }

    #[test]
    fn law_sensitivity_falls_along_the_axis() {
        let (ring, gso) = (scanner("allegro"), gso());
        let rate = |z: f64| {
            bundles(&ring, &gso, None, &Vector3::new(0.0, 0.0, z), 16)
                .iter()
                .map(|b| b.per_positron)
                .sum::<f64>()
        };
        let (middle, half, end) = (rate(0.0), rate(0.045), rate(0.088));
        assert!(middle > half && half > end && end < 0.1 * middle);
        // Roughly linear (than2015, section 4.5).
        assert!((half / middle - 0.5).abs() < 0.08, "{}", half / middle);
        assert_eq!(rate(0.2), 0.0);
    }
}
