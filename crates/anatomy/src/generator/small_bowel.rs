//! The folded small bowel: a path on a lattice that grows by kinks.
//!
//! The cavity between the colon's frame, behind the abdominal wall, is filled with a cubic lattice, turned at random; nodes too near to
//! what is already there are left out. The path begins as the shortest one from the end of the duodenum to the caecum. It then
//! grows: an edge `(u, v)` becomes `(u, u + d, v + d, v)`, `d` a lattice step across the edge, where both new nodes are free, until the
//! path has its length. Each such step sweeps one face of the lattice, which nothing else crosses: the path stays free of
//! itself and is never knotted, so no loop runs through another, as with loops on a mesentery. The mesentery's fan is
//!
//! ```text
//! |t(u + d) - i/n| < w,   t(p) = (p - a)·(b - a) / |b - a|²
//! ```
//!
//! with `a`, `b` the two ends of its root and `i/n` the place along the path: jejunum stays above left, ileum below right.
//! A kink is kept with the odds `exp(-β (2 + Δ))`, `Δ` the straight places it costs (-2 to 2), so that `β` sets how often loops bend.
//! Pitch: `p = sqrt(φ V / L)`, but no larger than gives the bends measured, `V` the free volume: a longer bowel lies closer.
//! What makes a bowel of this path is the relaxation ([`super::relaxation`]).

use super::Draws;
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::PI;

/// Share of the free volume that a path of this lattice fills before it gets stuck.
const FILL: f64 = 0.62;
/// The pitch that makes the bends measured, the smallest that still does, and the smallest at all, m: below twice the radius of
/// an empty bowel loops press each other flat.
const PITCH_M: f64 = 0.0195;
pub(super) const LEAST_PITCH_M: (f64, f64) = (0.018, 0.0125);
/// A path is that much longer than the bowel, which cuts its corners.
const SLACK: f64 = 1.06;
/// A kink that makes one corner more is that much less likely, as an exponent: gives the share of straight stretches measured.
const CORNER_EXPONENT: f64 = 1.05;
/// Grid on which the free volume is counted, m.
const VOLUME_GRID_M: f64 = 0.008;
/// Width of the fan at first, and by what it grows each time no kink was found.
const FAN_WIDTH: f64 = 0.25;
const FAN_STEP: f64 = 0.1;
/// Draws without a kink, as a multiple of the path's nodes, before the fan is widened.
const PATIENCE: usize = 60;

/// Where the small bowel may lie.
pub(super) struct Room<'a> {
    /// Corners of the box, m.
    pub(super) low: Point3<f64>,
    /// See `low`.
    pub(super) high: Point3<f64>,
    /// Whether a point is free for the small bowel's centre line.
    pub(super) is_free: &'a dyn Fn(&Point3<f64>) -> bool,
}

/// Nodes of the lattice: index and position.
type Key = [i32; 3];

struct Lattice {
    nodes: BTreeMap<Key, Point3<f64>>,
}

const STEPS: [Key; 6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

fn plus(a: Key, b: Key) -> Key {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

impl Lattice {
    fn new(room: &Room<'_>, pitch_m: f64, draws: &mut Draws) -> Self {
        let axis = Unit::new_normalize(draws.vector(1.0) + Vector3::new(0.0, 0.0, 1e-3));
        let turn = Rotation3::from_axis_angle(&axis, draws.between(-PI, PI));
        let centre = nalgebra::center(&room.low, &room.high) + draws.vector(0.5 * pitch_m);
        let reach = (0.5 * (room.high - room.low).norm() / pitch_m).ceil() as i32;
        let mut nodes = BTreeMap::new();
        for x in -reach..=reach {
            for y in -reach..=reach {
                for z in -reach..=reach {
                    let at = centre + turn * Vector3::new(f64::from(x), f64::from(y), f64::from(z)) * pitch_m;
                    if inside(room, &at) {
                        nodes.insert([x, y, z], at);
                    }
                }
            }
        }
        Self { nodes }
    }

    fn nearest(&self, point: &Point3<f64>) -> Option<Key> {
        let distance = |at: &Point3<f64>| (at - point).norm();
        self.nodes.iter().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1))).map(|(key, _)| *key)
    }

    /// The shortest path between two nodes, by breadth.
    fn shortest(&self, from: Key, to: Key) -> Option<Vec<Key>> {
        let mut came_from = BTreeMap::from([(to, to)]);
        let mut queue = VecDeque::from([to]);
        while let Some(node) = queue.pop_front() {
            if node == from {
                let mut path = vec![from];
                while let Some(next) = path.last().filter(|last| **last != to).map(|last| came_from[last]) {
                    path.push(next);
                }
                return Some(path);
            }
            for next in STEPS.map(|step| plus(node, step)) {
                if self.nodes.contains_key(&next) && !came_from.contains_key(&next) {
                    came_from.insert(next, node);
                    queue.push_back(next);
                }
            }
        }
        None
    }
}

fn inside(room: &Room<'_>, at: &Point3<f64>) -> bool {
    (0..3).all(|i| (room.low[i]..=room.high[i]).contains(&at[i])) && (room.is_free)(at)
}

/// Volume free for the centre line, m³.
fn free_volume_m3(room: &Room<'_>) -> f64 {
    let counts = (room.high - room.low).map(|side| (side / VOLUME_GRID_M).floor() as usize);
    let mut free = 0_usize;
    for x in 0..counts.x {
        for y in 0..counts.y {
            for z in 0..counts.z {
                let cell = Vector3::new(x as f64, y as f64, z as f64).add_scalar(0.5) * VOLUME_GRID_M;
                free += usize::from((room.is_free)(&(room.low + cell)));
            }
        }
    }
    free as f64 * VOLUME_GRID_M.powi(3)
}

/// A path of the given length from `start_m` to `end_m` (both included); in words, where there is no room for it.
pub(super) fn folded_path(
    room: &Room<'_>,
    start_m: Point3<f64>,
    end_m: Point3<f64>,
    length_m: f64,
    least_pitch_m: f64,
    draws: &mut Draws,
) -> Result<Vec<Point3<f64>>, String> {
    let volume_m3 = free_volume_m3(room);
    let path_m = SLACK * length_m;
    let pitch_m = (FILL * volume_m3 / path_m).sqrt().min(PITCH_M);
    if pitch_m < least_pitch_m {
        return Err(format!(
            "{length_m:.2} m of small bowel do not fit into {:.2} litres: loops would lie {:.1} mm apart",
            1e3 * volume_m3,
            1e3 * pitch_m
        ));
    }
    let lattice = Lattice::new(room, pitch_m, draws);
    let ends = lattice.nearest(&start_m).zip(lattice.nearest(&end_m));
    let Some(path) = ends.and_then(|(from, to)| lattice.shortest(from, to)) else {
        return Err("no way leads from the duodenum to the caecum".to_owned());
    };
    let ends_m = [path[0], path[path.len() - 1]].map(|key| lattice.nodes[&key]);
    let ways_m = (ends_m[0] - start_m).norm() + (end_m - ends_m[1]).norm();
    let count = ((path_m - ways_m) / pitch_m).round().max(1.0) as usize + 1;
    let path = grown(&lattice, path, count, (start_m, end_m), draws)?;
    let nodes = path.iter().map(|key| lattice.nodes[key]);
    Ok(std::iter::once(start_m).chain(nodes).chain([end_m]).collect())
}

/// Grows a path by kinks to `count` nodes.
fn grown(
    lattice: &Lattice,
    mut path: Vec<Key>,
    count: usize,
    (start_m, end_m): (Point3<f64>, Point3<f64>),
    draws: &mut Draws,
) -> Result<Vec<Key>, String> {
    let mut taken: BTreeSet<Key> = path.iter().copied().collect();
    let root = (end_m - start_m) / (end_m - start_m).norm_squared();
    let mut width = FAN_WIDTH;
    let mut failures = 0;
    while path.len() < count {
        let i = draws.below(path.len() - 1);
        let step = STEPS[draws.below(6)];
        let kink = [plus(path[i], step), plus(path[i + 1], step)];
        let place = i as f64 / path.len() as f64;
        let fits = kink.iter().all(|key| {
            let Some(at) = lattice.nodes.get(key).filter(|_| !taken.contains(key)) else { return false };
            ((at - start_m).dot(&root).clamp(0.0, 1.0) - place).abs() < width
        });
        let fits = fits && draws.between(0.0, 1.0) < corner_odds(&path, i, kink);
        if fits {
            taken.extend(kink);
            let tail = path.split_off(i + 1);
            path.extend(kink.into_iter().chain(tail));
            failures = 0;
            continue;
        }
        failures += 1;
        if failures > PATIENCE * path.len() {
            if width > 1.0 {
                let (have, want) = (path.len(), count);
                return Err(format!("the small bowel filled its room at {have} of {want} steps"));
            }
            (width, failures) = (width + FAN_STEP, 0);
        }
    }
    Ok(path)
}

/// Odds of keeping a kink by the corners it adds: two at most beside its own.
fn corner_odds(path: &[Key], i: usize, kink: [Key; 2]) -> f64 {
    let minus = |a: Key, b: Key| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let straight = |a: Key, b: Key, c: Key| minus(b, a) == minus(c, b);
    let before = i.checked_sub(1).map(|at| path[at]);
    let after = path.get(i + 2).copied();
    let was = usize::from(before.is_some_and(|b| straight(b, path[i], path[i + 1])))
        + usize::from(after.is_some_and(|a| straight(path[i], path[i + 1], a)));
    let is = usize::from(before.is_some_and(|b| straight(b, path[i], kink[0])))
        + usize::from(after.is_some_and(|a| straight(kink[1], path[i + 1], a)));
    // Straight places lost are corners won; from -2 to 2, taken from the best.
    (CORNER_EXPONENT * (is as f64 - was as f64 - 2.0)).exp()
}
