//! Where a lumen touches itself, where it is fused with itself, and what branches off.
//!
//! Every voxel belongs to the station of the line that is nearest within the lumen. Two neighbouring voxels (or next but one, with the wall between) whose stations are more
//! than 6 cm apart along the line are a contact: with a wall between them two loops *touch*, without one they are *fused*, which makes a
//! handle (a second way round). Contacts of the same two stretches count as one. A voxel further from its station than three times
//! that station's radius (and than 30 mm) is a *branch*: an appendix, a piece of another organ.

use super::middle::ImportStation;
use super::voxels::{STEPS, Voxels};
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, VecDeque};

/// Closer along the line are neighbours, m: as in [`crate::tract::NEIGHBOUR_M`].
const APART_M: f64 = crate::tract::NEIGHBOUR_M;
/// Contacts are gathered in stretches of this length, m.
const BIN_M: f64 = 0.01;
/// A branch is this many radii long, and this long, m.
const BRANCH_RADII: f64 = 3.0;
const BRANCH_M: f64 = 0.03;

/// Two parts of the lumen that meet.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfContact {
    /// Arc lengths of the two stretches' middles, m.
    pub at_m: (f64, f64),
    /// Where, surface frame, m.
    pub place_m: Point3<f64>,
    /// Area of the faces between their voxels, m².
    pub area_m2: f64,
    /// Whether there is no wall between them: a handle.
    pub is_fused: bool,
}

/// A part of the lumen that leads away from the line.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    /// Where it leaves the line, m along it.
    pub at_m: f64,
    /// Its furthest place, surface frame, m.
    pub tip_m: Point3<f64>,
    /// How far that is from the line within the lumen, m.
    pub length_m: f64,
}

/// Station of each voxel, and the way to it.
struct Owners {
    /// One more than the station; 0 for none.
    station: Vec<u32>,
    away_m: Vec<f32>,
}

/// Contacts and branches of a line.
pub(super) fn find(voxels: &Voxels, stations: &[ImportStation]) -> (Vec<SelfContact>, Vec<Branch>) {
    let mut arc_m = vec![0.0; stations.len()];
    for i in 1..stations.len() {
        arc_m[i] = arc_m[i - 1] + (stations[i].point_m - stations[i - 1].point_m).norm();
    }
    let owners = owners(voxels, stations);
    (contacts(voxels, &owners, &arc_m), branches(voxels, &owners, stations, &arc_m))
}

/// Spreads the stations over the lumen, in rings of whole steps: near enough for labels, and linear in time.
fn owners(voxels: &Voxels, stations: &[ImportStation]) -> Owners {
    let mut owners = Owners { station: vec![0; voxels.len()], away_m: vec![0.0; voxels.len()] };
    let mut queue = VecDeque::new();
    for (i, station) in stations.iter().enumerate() {
        let index = voxels.index_of(&station.point_m).filter(|index| voxels.is_inside(*index));
        if let Some(index) = index.filter(|index| owners.station[*index] == 0) {
            owners.station[index] = i as u32 + 1;
            queue.push_back(index);
        }
    }
    while let Some(here) = queue.pop_front() {
        for step in STEPS {
            let Some(next) = voxels.open_neighbour(here, step).filter(|next| owners.station[*next] == 0)
            else {
                continue;
            };
            owners.station[next] = owners.station[here];
            let station = &stations[owners.station[here] as usize - 1];
            let straight = (voxels.place_m(next) - station.point_m).norm() as f32;
            // At least the straight line, and no shorter than on the voxel before: round a corner the way goes on.
            owners.away_m[next] = straight.max(owners.away_m[here]);
            queue.push_back(next);
        }
    }
    owners
}

#[derive(Default)]
struct Gathered {
    faces: usize,
    place: Vector3<f64>,
    first: f64,
    second: f64,
}

fn contacts(voxels: &Voxels, owners: &Owners, arc_m: &[f64]) -> Vec<SelfContact> {
    let mut bins: BTreeMap<(bool, i64, i64), Gathered> = BTreeMap::new();
    for here in voxels.inside.iter().map(|i| *i as usize) {
        for step in [[1, 0, 0], [0, 1, 0], [0, 0, 1]] {
            // Where the wall, or the gap between two walls, holds the middle of a voxel, the one behind it is the other loop.
            let across = voxels.neighbour(here, step).and_then(|next| {
                if voxels.is_inside(next) { Some(next) } else { voxels.neighbour(next, step) }
            });
            let Some(next) = across.filter(|next| voxels.is_inside(*next)) else { continue };
            let (Some(a), Some(b)) =
                (owners.station[here].checked_sub(1), owners.station[next].checked_sub(1))
            else {
                continue;
            };
            let (a, b) = (arc_m[a.min(b) as usize], arc_m[a.max(b) as usize]);
            if b - a < APART_M {
                continue;
            }
            let is_fused = voxels.open_neighbour(here, step) == Some(next);
            let gathered = bins.entry((is_fused, (a / BIN_M) as i64, (b / BIN_M) as i64)).or_default();
            gathered.faces += 1;
            gathered.place += voxels.place_m(here).coords;
            gathered.first += a;
            gathered.second += b;
        }
    }
    merge(bins, voxels.edge_m * voxels.edge_m)
}

/// Joins bins that are next to each other.
fn merge(mut bins: BTreeMap<(bool, i64, i64), Gathered>, face_m2: f64) -> Vec<SelfContact> {
    let mut contacts = Vec::new();
    while let Some(((is_fused, a, b), first)) = bins.pop_first() {
        let mut all = first;
        let mut waiting = vec![(a, b)];
        while let Some((a, b)) = waiting.pop() {
            for key in (-1..=1).flat_map(|i| (-1..=1).map(move |j| (a + i, b + j))) {
                if let Some(more) = bins.remove(&(is_fused, key.0, key.1)) {
                    all.faces += more.faces;
                    all.place += more.place;
                    all.first += more.first;
                    all.second += more.second;
                    waiting.push(key);
                }
            }
        }
        let count = all.faces as f64;
        contacts.push(SelfContact {
            at_m: (all.first / count, all.second / count),
            place_m: Point3::from(all.place / count),
            area_m2: count * face_m2,
            is_fused,
        });
    }
    contacts.sort_by(|a, b| a.at_m.0.total_cmp(&b.at_m.0).then(a.at_m.1.total_cmp(&b.at_m.1)));
    contacts
}

fn branches(voxels: &Voxels, owners: &Owners, stations: &[ImportStation], arc_m: &[f64]) -> Vec<Branch> {
    let mut furthest: BTreeMap<i64, Branch> = BTreeMap::new();
    for index in voxels.inside.iter().map(|i| *i as usize) {
        let Some(station) = owners.station[index].checked_sub(1).map(|s| s as usize) else { continue };
        let length_m = f64::from(owners.away_m[index]);
        if length_m < BRANCH_M.max(BRANCH_RADII * stations[station].radius_m) {
            continue;
        }
        let branch = Branch { at_m: arc_m[station], tip_m: voxels.place_m(index), length_m };
        let slot = furthest.entry((arc_m[station] / BRANCH_M) as i64).or_insert_with(|| branch.clone());
        if length_m > slot.length_m {
            *slot = branch;
        }
    }
    furthest.into_values().collect()
}
