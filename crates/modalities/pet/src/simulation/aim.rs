//! Directions aimed at blocks.
//!
//! Every ray that enters a block, through its face or a side, crosses the plane of the face within a rectangle: the face, and the
//! shadow of the block's back edges as seen from the source. A point drawn evenly in that rectangle and kept with probability
//! `(D / r³) / G` (`D` distance of the source from the plane, `r` of the point, `G ≥ D / r³`) is a ray drawn evenly in solid angle;
//! of the rectangle's area `A` follow `A G / 4π` such draws per photon, times the share of photons that can matter there. Rectangles of neighbours overlap, so a ray counts for the
//! block that it enters first.

use super::Physics;
use super::source::MarkerPaths;
use nalgebra::Vector3;
use rand::{Rng, RngExt as _};

/// A source nearer to a block's plane than this is not aimed, m: `G` grows without bound.
const NEAREST_M: f64 = 0.03;

/// The rectangle of one block.
#[derive(Clone, Copy, Debug)]
struct Target {
    block: usize,
    /// Lower corner, m.
    lower_m: [f64; 2],
    /// Sizes, m.
    size_m: [f64; 2],
    /// Upper bound of `D / r³`, 1/m².
    most_per_m2: f64,
    shares: Shares,
    /// Sum of `A G` times the share that is drawn up to and with this target.
    cumulative: f64,
}

/// Of the photons through a place, the shares that can matter: at least what is kept of any of them. So many are drawn at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shares {
    /// Gets out of the body, both photons of it where both must.
    pub through: f64,
    /// Is accepted by the block.
    pub first: f64,
    /// Of its other photon, is accepted by the block that this one meets; 0 where it meets none.
    pub second: f64,
}

impl Shares {
    /// All photons.
    pub const ALL: Self = Self { through: 1.0, first: 1.0, second: 1.0 };
    const NONE: Self = Self { through: 0.0, first: 0.0, second: 0.0 };

    /// What is enough for two places.
    fn or(self, other: Self) -> Self {
        Self {
            through: self.through.max(other.through),
            first: self.first.max(other.first),
            second: self.second.max(other.second),
        }
    }

    fn drawn(self) -> f64 {
        self.through * self.first * self.second
    }
}

/// Targets of one marker during one window.
#[derive(Clone, Debug, Default)]
pub(super) struct Aim {
    targets: Vec<Target>,
    /// Shares at the corners of one rectangle's tiles, row by row.
    corners: Vec<Shares>,
    reach_m: f64,
}

/// A ray drawn by [`Aim::draw`], still to be kept or dropped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aimed {
    target: usize,
    /// The block.
    pub block: usize,
    /// Point of the rectangle, world, m.
    pub point_m: Vector3<f64>,
    /// Drawn evenly between 0 and `G`.
    level_per_m2: f64,
}

impl Aim {
    /// Targets for a marker's way through a window; `false` where it comes too near to a block's plane. Each rectangle is cut into
    /// `tiles x tiles`; `shares` tells those at a place (world, m) of a block's plane: a tile's are the largest of its corners'.
    pub fn set(
        &mut self,
        physics: &Physics,
        paths: &MarkerPaths,
        marker: usize,
        tiles: usize,
        shares: impl Fn(usize, &Vector3<f64>) -> Shares,
    ) -> bool {
        self.reach_m = physics.markers[marker].reach_m();
        self.targets.clear();
        let scanner = physics.detectors.scanner();
        let g = &scanner.grid;
        let mut cumulative = 0.0;
        for block in 0..scanner.blocks.len() {
            let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
            for place in paths.knots(marker) {
                let local = scanner.to_block(block, place);
                low = low.inf(&local);
                high = high.sup(&local);
            }
            let nearest_m = -high.z - self.reach_m;
            if nearest_m < NEAREST_M {
                return false;
            }
            // Shadow of the back edge at `w`: h + (w - h) D / (D + depth), furthest out from the nearest source.
            let shadow = |place_m: f64, edge_m: f64| {
                place_m + (edge_m - place_m) * nearest_m / (nearest_m + g.depth_m)
            };
            let side = |axis: usize, half_m: f64| {
                let upper_m = half_m.max(shadow(high[axis] + self.reach_m, half_m));
                let lower_m = (-half_m).min(shadow(low[axis] - self.reach_m, -half_m));
                (lower_m, upper_m - lower_m)
            };
            let (h, z) = (side(0, g.half_width_m()), side(1, g.half_length_m()));
            let most_per_m2 = 1.0 / (nearest_m * nearest_m);
            let size_m = [h.1 / tiles as f64, z.1 / tiles as f64];
            let corner_m = |i: usize, k: usize| [h.0 + size_m[0] * i as f64, z.0 + size_m[1] * k as f64];
            self.corners.clear();
            for corner in 0..(tiles + 1) * (tiles + 1) {
                let [h_m, z_m] = corner_m(corner % (tiles + 1), corner / (tiles + 1));
                self.corners.push(shares(block, &scanner.in_block(block, h_m, z_m, 0.0)));
            }
            for tile in 0..tiles * tiles {
                let (i, k) = (tile % tiles, tile / tiles);
                let lower_m = corner_m(i, k);
                let first = i + k * (tiles + 1);
                let corners = [first, first + 1, first + tiles + 1, first + tiles + 2];
                let shares = corners.iter().fold(Shares::NONE, |all, corner| all.or(self.corners[*corner]));
                let shares = Shares { through: shares.through.min(1.0), ..shares };
                cumulative += size_m[0] * size_m[1] * most_per_m2 * shares.drawn();
                self.targets.push(Target { block, lower_m, size_m, most_per_m2, shares, cumulative });
            }
        }
        true
    }

    /// Rays to draw per photon, `Σ A G / 4π`.
    pub fn draws_per_photon(&self) -> f64 {
        self.targets.last().map_or(0.0, |t| t.cumulative) / (4.0 * std::f64::consts::PI)
    }

    /// Shares by which a ray was drawn: what is kept of it with some probability is kept with that over these.
    pub fn shares(&self, aimed: &Aimed) -> Shares {
        self.targets[aimed.target].shares
    }

    /// Draws a block and a point.
    pub fn draw<R: Rng + ?Sized>(&self, physics: &Physics, random: &mut R) -> Aimed {
        let total = self.targets.last().map_or(0.0, |t| t.cumulative);
        let level = random.random::<f64>() * total;
        let target = self.targets.partition_point(|t| t.cumulative <= level).min(self.targets.len() - 1);
        let t = &self.targets[target];
        let h_m = t.lower_m[0] + t.size_m[0] * random.random::<f64>();
        let z_m = t.lower_m[1] + t.size_m[1] * random.random::<f64>();
        Aimed {
            target,
            block: t.block,
            point_m: physics.detectors.scanner().in_block(t.block, h_m, z_m, 0.0),
            level_per_m2: random.random::<f64>() * t.most_per_m2,
        }
    }

    /// Whether a ray from near a marker's place can be kept at all: spares drawing where exactly it starts.
    pub fn may_keep(&self, aimed: &Aimed, physics: &Physics, place_m: &Vector3<f64>) -> bool {
        let way = aimed.point_m - place_m;
        let distance_m = way.dot(&physics.detectors.scanner().blocks[aimed.block].outward);
        let least_m = way.norm() - self.reach_m;
        least_m <= 0.0 || aimed.level_per_m2 * least_m * least_m * least_m < distance_m + self.reach_m
    }

    /// Keeps a ray or drops it; its direction.
    pub fn keep(aimed: &Aimed, physics: &Physics, from_m: &Vector3<f64>) -> Option<Vector3<f64>> {
        let way = aimed.point_m - from_m;
        let distance_m = way.dot(&physics.detectors.scanner().blocks[aimed.block].outward);
        let square = way.norm_squared();
        let norm = square.sqrt();
        (aimed.level_per_m2 * square * norm < distance_m).then(|| way / norm)
    }
}
