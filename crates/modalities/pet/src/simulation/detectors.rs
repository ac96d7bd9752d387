//! All blocks of a scanner: which of them a photon meets, and what becomes a single.
//!
//! A photon enters a block through any side, and what leaves one block may enter the next (a ring's blocks leave gaps of some
//! millimetres between them). Photons of one decay that leave energy in the same block make one single there. A single is kept where
//! its crystal is read out (`efficiency`) and its measured energy lies in the window; its time is smeared.

use super::block::{BlockPhysics, Deposit, FWHM_PER_SIGMA, passes_window};
use super::photon::Photon;
use super::scintillator::Scintillator;
use crate::scanner::{CrystalIndex, Scanner};
use nalgebra::Vector3;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Speed of light, m/s.
const LIGHT_M_PER_S: f64 = 299_792_458.0;

/// Which photon of a decay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One of the two of the annihilation.
    Annihilation,
    /// A prompt gamma.
    Prompt,
}

/// What one decay left in one block.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// The block.
    pub block: usize,
    /// What was left there.
    pub deposit: Deposit,
    /// The photon that left most.
    pub kind: Kind,
    /// How often that photon scattered in the body.
    pub scatterings: u32,
}

/// Hits of one decay. Three photons seldom meet more than four blocks; more are not kept.
#[derive(Clone, Debug, Default)]
pub struct Hits {
    hits: Vec<Hit>,
}

/// More hits of one decay than this do not happen; the bound keeps memory fixed.
const MAX_HITS: usize = 16;

impl Hits {
    /// Room for one decay.
    pub fn new() -> Self {
        Self { hits: Vec::with_capacity(MAX_HITS) }
    }

    /// Forgets the last decay.
    pub fn clear(&mut self) {
        self.hits.clear();
    }

    /// All hits, one per block.
    pub fn as_slice(&self) -> &[Hit] {
        &self.hits
    }

    /// Adds a hit; two in one block become one, placed where more energy was left.
    fn add(&mut self, hit: Hit) {
        if let Some(same) = self.hits.iter_mut().find(|h| h.block == hit.block) {
            let energy_ev = same.deposit.energy_ev + hit.deposit.energy_ev;
            let path_m = same.deposit.path_m.min(hit.deposit.path_m);
            if hit.deposit.crystal_energy_ev > same.deposit.crystal_energy_ev {
                *same = hit;
            }
            same.deposit.energy_ev = energy_ev;
            same.deposit.path_m = path_m;
        } else if self.hits.len() < MAX_HITS {
            self.hits.push(hit);
        }
    }
}

/// A photon that was read out.
#[derive(Clone, Copy, Debug)]
pub struct Single {
    /// When, from the window's start, smeared, s.
    pub after_s: f64,
    /// Number of its decay in the window.
    pub decay: u32,
    /// Its marker.
    pub marker: u8,
    /// Which photon.
    pub kind: Kind,
    /// How often it scattered in the body, at most 255.
    pub scatterings: u8,
    /// Its block.
    pub block: u16,
    /// Its crystal.
    pub crystal: CrystalIndex,
    /// Where the scanner says it was, world, m.
    pub end_world_m: Vector3<f64>,
}

/// What the scanner reports as the place of a photon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EndPoints {
    /// The centre of the crystal.
    #[default]
    Crystal,
    /// The mean place of the energy in the crystal: what a simulator's files often hold.
    Continuous,
}

/// All blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Detectors {
    scanner: Scanner,
    physics: BlockPhysics,
    end_points: EndPoints,
    /// Share of photons that are read out, at most 1.
    read_out: f64,
    kill_ev: f64,
    /// Within this distance from the axis there is no block, m.
    free_radius_m: f64,
    /// Blocks lie between these, m.
    axial_m: [f64; 2],
}

impl Detectors {
    /// The detectors of a scanner.
    pub fn new(scanner: Scanner, scintillator: Scintillator, end_points: EndPoints) -> Self {
        let physics = BlockPhysics::new(&scanner, scintillator);
        let g = &scanner.grid;
        let corners = |block: usize| {
            let (w, l, d) = (g.half_width_m(), g.half_length_m(), g.depth_m);
            [w, -w]
                .into_iter()
                .flat_map(move |h| {
                    [l, -l]
                        .into_iter()
                        .flat_map(move |z| [0.0, d].into_iter().map(move |depth| (h, z, depth)))
                })
                .map(|(h, z, depth)| (block, h, z, depth))
                .collect::<Vec<_>>()
        };
        let mut axial_m = [f64::INFINITY, f64::NEG_INFINITY];
        let mut free_radius_m = f64::INFINITY;
        for block in 0..scanner.blocks.len() {
            for (block, h, z, depth) in corners(block) {
                let corner = scanner.in_block(block, h, z, depth);
                axial_m = [axial_m[0].min(corner.z), axial_m[1].max(corner.z)];
            }
            free_radius_m = free_radius_m.min(free_radius_of(&scanner, block));
        }
        let kill_ev = super::block::kill_energy_ev(&scanner.detection);
        let read_out = scanner.detection.efficiency.min(1.0);
        Self { scanner, physics, end_points, read_out, kill_ev, free_radius_m, axial_m }
    }

    /// The scanner.
    pub fn scanner(&self) -> &Scanner {
        &self.scanner
    }

    /// Physics of one block.
    pub fn physics(&self) -> &BlockPhysics {
        &self.physics
    }

    /// Photons of less energy are never accepted, eV.
    pub fn kill_ev(&self) -> f64 {
        self.kill_ev
    }

    /// The block that a ray enters first, of those that `passed` does not hold, and how far away, m.
    pub fn first_block(&self, photon: &Photon, passed: &[usize]) -> Option<(usize, f64)> {
        let (p, d) = (&photon.place_m, &photon.direction);
        // Far from the axis z only grows: a ray that leaves the free cylinder beyond the blocks' ends misses them all.
        let (a, b, c) = (
            d.x * d.x + d.y * d.y,
            p.x * d.x + p.y * d.y,
            p.x * p.x + p.y * p.y - self.free_radius_m * self.free_radius_m,
        );
        if c < 0.0 {
            if a <= 0.0 {
                return None;
            }
            let z_m = p.z + d.z * (-b + (b * b - a * c).sqrt()) / a;
            if (d.z >= 0.0 && z_m > self.axial_m[1]) || (d.z <= 0.0 && z_m < self.axial_m[0]) {
                return None;
            }
        }
        let mut nearest: Option<(usize, f64)> = None;
        for block in 0..self.scanner.blocks.len() {
            if let Some(near_m) = self.entry_m(block, photon)
                && nearest.is_none_or(|(_, best_m)| near_m < best_m)
                && !passed.contains(&block)
            {
                nearest = Some((block, near_m));
            }
        }
        nearest
    }

    /// Whether a ray enters this block, and before all others.
    pub fn enters_first(&self, block: usize, photon: &Photon) -> bool {
        let Some(near_m) = self.entry_m(block, photon) else { return false };
        // Of two at one distance the first counts, as in [`Self::first_block`].
        (0..self.scanner.blocks.len()).filter(|other| *other != block).all(|other| {
            self.entry_m(other, photon)
                .is_none_or(|there_m| near_m < there_m || (near_m == there_m && block < other))
        })
    }

    /// How far away a ray enters a block, m.
    fn entry_m(&self, block: usize, photon: &Photon) -> Option<f64> {
        let (frame, d) = (&self.scanner.blocks[block], &photon.direction);
        let inward = d.dot(&frame.outward);
        let from_face = photon.place_m - frame.centre_world_m;
        let depth_m = from_face.dot(&frame.outward);
        if inward <= 0.0 && depth_m < 0.0 {
            return None;
        }
        let place = Vector3::new(from_face.dot(&frame.tangential), from_face.dot(&frame.axial), depth_m);
        let direction = Vector3::new(d.dot(&frame.tangential), d.dot(&frame.axial), inward);
        if self.physics.is_missed_from_the_front(&place, &direction) {
            return None;
        }
        self.physics.chord_m(&place, &direction).map(|(near_m, _)| near_m)
    }

    /// A photon in a block's coordinates.
    pub fn to_block(&self, block: usize, photon: &Photon) -> Photon {
        let frame = &self.scanner.blocks[block];
        let d = &photon.direction;
        Photon {
            place_m: self.scanner.to_block(block, &photon.place_m),
            direction: Vector3::new(d.dot(&frame.tangential), d.dot(&frame.axial), d.dot(&frame.outward)),
            ..*photon
        }
    }

    /// A photon of a block's coordinates in the world.
    fn to_world(&self, block: usize, photon: &Photon) -> Photon {
        let frame = &self.scanner.blocks[block];
        let (p, d) = (&photon.place_m, &photon.direction);
        Photon {
            place_m: self.scanner.in_block(block, p.x, p.y, p.z),
            direction: frame.tangential * d.x + frame.axial * d.y + frame.outward * d.z,
            ..*photon
        }
    }

    /// Follows a photon (world) through all blocks that it meets.
    pub fn detect<R: Rng + ?Sized>(
        &self,
        photon: Photon,
        kind: Kind,
        scatterings: u32,
        random: &mut R,
        hits: &mut Hits,
    ) {
        if let Some((block, _)) = self.first_block(&photon, &[]) {
            self.detect_from(block, photon, kind, scatterings, random, hits);
        }
    }

    /// As [`Self::detect`], where the block that it enters first is known.
    pub fn detect_from<R: Rng + ?Sized>(
        &self,
        mut block: usize,
        mut photon: Photon,
        kind: Kind,
        scatterings: u32,
        random: &mut R,
        hits: &mut Hits,
    ) {
        // A way through more than four blocks needs a scanner that is no scanner.
        let mut passed = [usize::MAX; 4];
        for count in 0..passed.len() {
            let mut local = self.to_block(block, &photon);
            if let Some(deposit) = self.physics.respond(&mut local, random) {
                hits.add(Hit { block, deposit, kind, scatterings });
                if local.energy_ev < self.kill_ev {
                    return;
                }
                photon = self.to_world(block, &local);
            }
            passed[count] = block;
            match self.first_block(&photon, &passed[..=count]) {
                Some((next, _)) => block = next,
                None => return,
            }
        }
    }

    /// Reads a hit out: `None` where efficiency, energy window or the end of what is read out drop it. `after_s` is the decay's time.
    pub fn read_out<R: Rng + ?Sized>(
        &self,
        hit: &Hit,
        after_s: f64,
        decay: u32,
        marker: u8,
        random: &mut R,
    ) -> Option<Single> {
        let detection = &self.scanner.detection;
        // A deposit so far below the window never passes; one random number less.
        if hit.deposit.energy_ev < self.kill_ev || !passes_window(detection, hit.deposit.energy_ev, random) {
            return None;
        }
        self.read_out_accepted(hit, after_s, decay, marker, random)
    }

    /// Reads out a hit that passed the energy window.
    pub fn read_out_accepted<R: Rng + ?Sized>(
        &self,
        hit: &Hit,
        after_s: f64,
        decay: u32,
        marker: u8,
        random: &mut R,
    ) -> Option<Single> {
        let detection = &self.scanner.detection;
        if self.read_out < 1.0 && random.random::<f64>() >= self.read_out {
            return None;
        }
        let smear: f64 = random.sample(StandardNormal);
        let sigma_s = detection.time_resolution_s / FWHM_PER_SIGMA;
        let (crystal, end_world_m) = self.report(hit, random)?;
        Some(Single {
            after_s: after_s + hit.deposit.path_m / LIGHT_M_PER_S + sigma_s * smear,
            decay,
            marker,
            kind: hit.kind,
            scatterings: hit.scatterings.min(255) as u8,
            block: hit.block as u16,
            crystal,
            end_world_m,
        })
    }

    /// Crystal and place that the scanner reports; `None` where light tells a place beside what is read out.
    fn report<R: Rng + ?Sized>(&self, hit: &Hit, random: &mut R) -> Option<(CrystalIndex, Vector3<f64>)> {
        let g = &self.scanner.grid;
        let (column, row) = hit.deposit.crystal;
        let crystal = CrystalIndex { x: hit.block as u32 * g.columns + column, z: row };
        let mut place = self.scanner.told_by_light(hit.deposit.place_block_m, random)?;
        if self.scanner.detection.position_fwhm_m.is_some() {
            place.z = self.scanner.told_depth_m();
        } else if self.end_points == EndPoints::Crystal {
            place.x = g.tangential_pitch_m * (f64::from(column) - 0.5 * f64::from(g.columns - 1));
            place.y = g.axial_pitch_m * (f64::from(row) - 0.5 * f64::from(g.rows - 1));
            place.z = self.scanner.told_depth_m();
        }
        Some((crystal, self.scanner.in_block(hit.block, place.x, place.y, place.z)))
    }
}

/// Distance from the axis to a block, at least, m. Blocks along the axis: from the face's edges; tilted ones: 0, no shortcut.
fn free_radius_of(scanner: &Scanner, block: usize) -> f64 {
    let frame = &scanner.blocks[block];
    if frame.axial.x.hypot(frame.axial.y) > 1e-9 {
        return 0.0;
    }
    // The block's shadow on the plane across the axis is a rectangle.
    let local = scanner.to_block(block, &Vector3::new(0.0, 0.0, frame.centre_world_m.z));
    let h_m = (local.x.abs() - scanner.grid.half_width_m()).max(0.0);
    let depth_m = (-local.z).max(local.z - scanner.grid.depth_m).max(0.0);
    h_m.hypot(depth_m)
}
