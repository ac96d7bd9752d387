//! The way through the lumen: parts, ends, and the cheapest row of voxels between two places.
//!
//! A step of length `l` between voxels of clearance `d` costs
//!
//! ```text
//! l (w_i + w_j) / 2,         w = (r / d)^6,   r = mean radius of the lumen
//! l (1 + (w_i + w_j) / 2)     while ends are looked for
//! ```
//!
//! Across a tube of radius `r` that bends with radius `R` the cheapest way stays on the ridge of the clearance as long as the
//! exponent exceeds `r / R`, so any exponent above 1 finds the middle. The rest is for windows where lumina are fused: with 6 a millimetre in one half
//! as wide as the lumen is as dear as 64 in its middle (a person's ileum is fused over 10 mm by a window about that wide, the way round is
//! 0.6 m and wider than the mean; with 4 the window was the cheaper).
//!
//! The ends are the two places furthest apart by the second cost: the furthest from any place, then the furthest from that; places narrower than
//! half the mean radius are none, so that no crevice is one. From each the line is led on to the place near it that is furthest from the other by length,
//! and further as long as the lumen is narrow there. Dijkstra's method, ties by index, so the way is the same on every machine.

use super::voxels::{STEPS, Voxels};
use nalgebra::Point3;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

/// Exponent of the cost.
const EXPONENT: i32 = 6;
/// A step through a wall or outside costs so many times a step in the middle: only taken where there is no other way.
const WALL_FACTOR: f64 = 1e7;
/// A place with less clearance than this part of the mean radius is narrow: a corner, a crevice, an appendix; no end is looked for there.
const NARROW: f64 = 0.5;
/// From an end found so the line is led on to the furthest place within so many mean radii, which may be narrow; from there again, at most
/// so many times.
const LED_ON_RADII: f64 = 3.0;
const LED_ON_STEPS: usize = 16;

/// One connected part of the lumen.
pub(super) struct Part {
    /// Its first voxel.
    pub(super) seed: usize,
    pub(super) voxels: usize,
    pub(super) middle_m: Point3<f64>,
}

/// The connected parts, largest first.
pub(super) fn parts(voxels: &Voxels) -> Vec<Part> {
    let mut is_seen = vec![false; voxels.len()];
    let mut parts = Vec::new();
    for seed in voxels.inside.iter().map(|i| *i as usize) {
        if is_seen[seed] {
            continue;
        }
        let members = flood(voxels, seed, &mut is_seen);
        let sum: nalgebra::Vector3<f64> = members.iter().map(|index| voxels.place_m(*index).coords).sum();
        let middle_m = Point3::from(sum / f64::from(members.len() as u32));
        parts.push(Part { seed, voxels: members.len(), middle_m });
    }
    parts.sort_by_key(|part| std::cmp::Reverse(part.voxels));
    parts
}

/// The voxels of the part that one of them belongs to.
pub(super) fn members(voxels: &Voxels, seed: usize) -> Vec<usize> {
    flood(voxels, seed, &mut vec![false; voxels.len()])
}

fn flood(voxels: &Voxels, seed: usize, is_seen: &mut [bool]) -> Vec<usize> {
    is_seen[seed] = true;
    let mut found = vec![seed];
    let mut at = 0;
    while at < found.len() {
        for (axis, sign) in (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]) {
            let mut step = [0; 3];
            step[axis] = sign;
            if let Some(next) = voxels.open_neighbour(found[at], step).filter(|next| !is_seen[*next]) {
                is_seen[next] = true;
                found.push(next);
            }
        }
        at += 1;
    }
    found
}

/// A voxel waiting in the queue; the cheapest is the greatest.
struct Waiting {
    cost: f64,
    index: usize,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

/// What a search has found: for each voxel reached its cost and the step that led to it.
pub(super) struct Reach {
    cost: Vec<f64>,
    /// 0: not reached; 27: a source; else one more than the step's number.
    led_by: Vec<u8>,
    /// The last voxel settled: the furthest, or the target.
    pub(super) last: usize,
}

const SOURCE: u8 = 27;

/// How steps are paid.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Pay {
    /// Plain length, within the lumen.
    Length,
    /// Length and clearance, within the lumen. The last place is the furthest that is not narrow.
    Reach {
        /// Mean radius, m.
        radius_m: f64,
    },
    /// By clearance, within the lumen.
    Middle {
        /// Mean radius, m.
        radius_m: f64,
    },
    /// By clearance, and dearly through walls.
    MiddleThroughWalls {
        /// Mean radius, m.
        radius_m: f64,
    },
}

/// Searches from a voxel over the lumen, until `target` where there is one.
pub(super) fn search(voxels: &Voxels, from: usize, target: Option<usize>, pay: Pay) -> Reach {
    let mut reach = Reach { cost: vec![0.0; voxels.len()], led_by: vec![0; voxels.len()], last: from };
    let mut is_settled = vec![false; voxels.len()];
    let mut queue = BinaryHeap::from([Waiting { cost: 0.0, index: from }]);
    reach.led_by[from] = SOURCE;
    while let Some(Waiting { cost, index }) = queue.pop() {
        if is_settled[index] {
            continue;
        }
        is_settled[index] = true;
        if !matches!(pay, Pay::Reach { radius_m } if is_narrow(voxels, index, radius_m)) {
            reach.last = index;
        }
        if Some(index) == target {
            break;
        }
        for (number, step) in STEPS.iter().enumerate() {
            let Some((next, price)) = priced(voxels, index, *step, pay) else { continue };
            let total = cost + price;
            if !is_settled[next] && (reach.led_by[next] == 0 || total < reach.cost[next]) {
                reach.cost[next] = total;
                reach.led_by[next] = number as u8 + 1;
                queue.push(Waiting { cost: total, index: next });
            }
        }
    }
    reach
}

/// The voxel one step on and what the step costs.
fn priced(voxels: &Voxels, index: usize, step: [i32; 3], pay: Pay) -> Option<(usize, f64)> {
    let length_m = f64::from(step.iter().map(|s| s * s).sum::<i32>()).sqrt() * voxels.edge_m;
    let weight = |index: usize, radius_m: f64| {
        let clearance_m = voxels.clearance_m(index).max(0.25 * voxels.edge_m);
        (radius_m / clearance_m).powi(EXPONENT)
    };
    match pay {
        Pay::Length => voxels.open_neighbour(index, step).map(|next| (next, length_m)),
        Pay::Reach { radius_m } => voxels
            .open_neighbour(index, step)
            .map(|next| (next, length_m * (1.0 + 0.5 * (weight(index, radius_m) + weight(next, radius_m))))),
        Pay::Middle { radius_m } | Pay::MiddleThroughWalls { radius_m } => {
            let open = if voxels.is_inside(index) { voxels.open_neighbour(index, step) } else { None };
            if let Some(next) = open {
                return Some((next, 0.5 * length_m * (weight(index, radius_m) + weight(next, radius_m))));
            }
            let next = voxels.neighbour(index, step)?;
            (pay != Pay::Middle { radius_m }).then_some((next, length_m * WALL_FACTOR))
        }
    }
}

impl Reach {
    pub(super) fn is_reached(&self, index: usize) -> bool {
        self.led_by[index] != 0
    }

    /// The row of voxels from the source to one that was reached.
    pub(super) fn way_to(&self, voxels: &Voxels, target: usize) -> Vec<usize> {
        let mut way = vec![target];
        let mut here = target;
        while (1..SOURCE).contains(&self.led_by[here]) {
            let back = STEPS[26 - self.led_by[here] as usize];
            let Some(before) = voxels.neighbour(here, back) else { break };
            here = before;
            way.push(here);
        }
        way.reverse();
        way
    }
}

fn is_narrow(voxels: &Voxels, index: usize, radius_m: f64) -> bool {
    voxels.clearance_m(index) < NARROW * radius_m
}

/// The two places of a part that are furthest apart within it.
pub(super) fn furthest_pair(voxels: &Voxels, seed: usize, radius_m: f64) -> (usize, usize) {
    let furthest = |from| search(voxels, from, None, Pay::Reach { radius_m }).last;
    let first = furthest(seed);
    let second = furthest(first);
    (led_on(voxels, second, first, radius_m), led_on(voxels, first, second, radius_m))
}

/// The place near an end that is furthest from the other, and on from there while the lumen is narrow: a rectum, a terminal ileum.
pub(super) fn led_on(voxels: &Voxels, other: usize, end: usize, radius_m: f64) -> usize {
    let from_other = search(voxels, other, None, Pay::Length);
    let far = |index: usize| from_other.cost[index];
    let mut end = end;
    for _ in 0..LED_ON_STEPS {
        let near = within(voxels, end, LED_ON_RADII * radius_m);
        let best = near.into_iter().max_by(|a, b| far(*a).total_cmp(&far(*b)).then(b.cmp(a))).unwrap_or(end);
        let advance_m = far(best) - far(end);
        end = best;
        let middle = to_the_middle(voxels, end, radius_m);
        if advance_m < radius_m || !is_narrow(voxels, middle, radius_m) {
            break;
        }
    }
    end
}

/// The voxels that are no further than `limit_m` from one, within the lumen.
fn within(voxels: &Voxels, from: usize, limit_m: f64) -> Vec<usize> {
    let mut cost = BTreeMap::from([(from, 0.0)]);
    let mut queue = BinaryHeap::from([Waiting { cost: 0.0, index: from }]);
    while let Some(Waiting { cost: here_m, index }) = queue.pop() {
        if cost.get(&index).is_some_and(|known| *known < here_m) {
            continue;
        }
        for step in STEPS {
            let Some((next, length_m)) = priced(voxels, index, step, Pay::Length) else { continue };
            let total = here_m + length_m;
            if total <= limit_m && cost.get(&next).is_none_or(|known| total < *known) {
                cost.insert(next, total);
                queue.push(Waiting { cost: total, index: next });
            }
        }
    }
    cost.into_keys().collect()
}

/// The inside voxel nearest to a place, and its distance, m.
pub(super) fn nearest_inside(voxels: &Voxels, place: &Point3<f64>) -> Option<(usize, f64)> {
    if let Some(index) = voxels.index_of(place).filter(|index| voxels.is_inside(*index)) {
        return Some((index, 0.0));
    }
    let distance = |index: u32| (voxels.place_m(index as usize) - place).norm();
    let nearest = voxels.inside.iter().copied().min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
    Some((nearest as usize, distance(nearest)))
}

/// Uphill in clearance from a voxel to the middle of the lumen, no further than `limit_m`.
pub(super) fn to_the_middle(voxels: &Voxels, from: usize, limit_m: f64) -> usize {
    let (start, mut here) = (voxels.place_m(from), from);
    loop {
        let best = STEPS
            .iter()
            .filter_map(|step| voxels.open_neighbour(here, *step))
            .filter(|next| (voxels.place_m(*next) - start).norm() <= limit_m)
            .max_by(|a, b| voxels.clearance_m(*a).total_cmp(&voxels.clearance_m(*b)).then(b.cmp(a)));
        match best {
            Some(next) if voxels.clearance_m(next) > voxels.clearance_m(here) => here = next,
            _ => return here,
        }
    }
}
