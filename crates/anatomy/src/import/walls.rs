//! Walls with a thickness: surfaces that show tissue, an outer and an inner face, where others show the lumen alone. The inner face is the
//! lumen's, so the outer one goes.
//!
//! The two faces may belong to one component (a pipe whose ends are rings, pieces fused to each other), and a surface may have
//! walls along one stretch and the lumen alone along the next, so a face is told by its shape:
//!
//! ```text
//! mean curvature of a part, from its edges e with outward angle β_e (Cohen-Steiner and Morvan, Symp. Comput. Geom. 2003):
//!     c = Σ |e| β_e / (2 A),   a tube seen from outside: 1 / (2 R), from within: -1 / (2 R)
//! thickness t: from a face against its normal to the face opposite, through what the surface encloses
//! wall:    c > 0 here, c < 0 opposite, and t c < 1/2, which is t < R: the face opposite lies before the middle
//! lumen:   c > 0 on both sides, t = 2 R
//! ```
//!
//! Parts are patches about as wide as the mean radius `2 V / A` (of a wall that is its thickness), so that neither a fine nor a coarse mesh
//! matters. Patches vote for themselves and, by diffusion, for those around them; stretches shorter than they are wide follow their
//! neighbours.

use super::bvh::Bvh;
use super::repair::{Repair, RepairKind};
use super::surface::{Surface, unit_or_zero};
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, VecDeque};

/// Places at which a patch looks for the face opposite.
const LOOKS: usize = 4;
/// Rounds in which neighbouring patches share their curvature, and their votes: some mean radii.
const CURVATURE_ROUNDS: usize = 2;
const VOTE_ROUNDS: usize = 4;
/// A patch ends where the surface turns by more than 60 degrees from its first triangle: at the ring that joins two faces.
const PATCH_COSINE: f64 = 0.5;
/// A ray starts so far below its own triangle, m: half the distance of corners that are one.
const START_M: f64 = 5e-6;
/// Walls on less of the area than this are folds.
const LEAST_PART: f64 = 0.01;
/// More of the area than this looking like walls after the repairs is no surface of a lumen: of four real surfaces and the tests' tubes at most
/// 4 % do, of a wall nearly all.
const SUSPICIOUS: f64 = 0.25;

/// What a patch shows.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Face {
    Outer,
    Inner,
    Lumen,
}

const FACES: [Face; 3] = [Face::Outer, Face::Inner, Face::Lumen];

/// The surface as a graph of patches.
struct Patches {
    of_triangle: Vec<u32>,
    triangles: Vec<Vec<u32>>,
    area_m2: Vec<f64>,
    neighbours: Vec<Vec<u32>>,
}

/// A surface as patches, with what they see.
struct Study {
    patches: Patches,
    curvature: Vec<f64>,
    looks: Vec<Vec<Look>>,
    /// Votes of each patch for each of [`FACES`], m².
    votes: [Vec<f64>; 3],
}

impl Study {
    fn of(surface: &Surface, radius_m: f64) -> Option<Self> {
        if surface.triangles.is_empty() || radius_m.is_nan() || radius_m <= 0.0 {
            return None;
        }
        let neighbours = surface.neighbours();
        let patches = Patches::new(surface, &neighbours, radius_m);
        let mut bent = patches.integrated_curvature(surface, &neighbours);
        let mut area = patches.area_m2.clone();
        for _ in 0..CURVATURE_ROUNDS {
            bent = patches.diffused(&bent);
            area = patches.diffused(&area);
        }
        let curvature: Vec<f64> = bent.iter().zip(&area).map(|(b, a)| b / a.max(f64::MIN_POSITIVE)).collect();
        let looks = patches.looks(surface);
        let votes = patches.votes(&curvature, &looks);
        Some(Self { patches, curvature, looks, votes })
    }

    /// What each patch shows, by its votes and those around it.
    fn faces(&self) -> Vec<Face> {
        let mut votes = self.votes.clone();
        for votes in &mut votes {
            for _ in 0..VOTE_ROUNDS {
                *votes = self.patches.diffused(votes);
            }
        }
        let count = self.patches.triangles.len();
        let most = |patch: usize| {
            FACES.into_iter().max_by(|a, b| votes[*a as usize][patch].total_cmp(&votes[*b as usize][patch]))
        };
        let mut faces: Vec<Face> = (0..count).map(|patch| most(patch).unwrap_or(Face::Lumen)).collect();
        self.patches.settle(&mut faces, &self.curvature);
        faces
    }

    /// Whether a patch by itself votes most for a face.
    fn is_seen(&self, patch: usize, face: Face) -> bool {
        FACES.iter().all(|other| self.votes[*other as usize][patch] <= self.votes[face as usize][patch])
            && self.votes[face as usize][patch] > 0.0
    }
}

/// Removes the outer faces of walls; one repair for each connected face.
pub(super) fn take_inner_faces(surface: &mut Surface, radius_m: f64) -> Vec<Repair> {
    let Some(study) = Study::of(surface, radius_m) else { return Vec::new() };
    let Study { patches, looks, .. } = &study;
    let faces = study.faces();
    let outer = patches.outer(&faces, looks);
    let whole_m2: f64 = patches.area_m2.iter().sum();
    let gone_m2: f64 = outer.iter().flatten().map(|p| patches.area_m2[*p as usize]).sum();
    if gone_m2 < LEAST_PART * whole_m2 {
        return Vec::new();
    }
    let mut is_gone = vec![false; surface.triangles.len()];
    let mut repairs = Vec::new();
    for face in &outer {
        let mut thicknesses: Vec<f64> =
            face.iter().flat_map(|p| looks[*p as usize].iter().map(|look| look.thickness_m)).collect();
        thicknesses.sort_unstable_by(f64::total_cmp);
        let triangles: Vec<u32> = face.iter().flat_map(|p| patches.triangles[*p as usize].clone()).collect();
        triangles.iter().for_each(|t| is_gone[*t as usize] = true);
        repairs.push(Repair {
            kind: RepairKind::ThickWall,
            at_m: surface.centroid(triangles[0] as usize),
            size_m: thicknesses.get(thicknesses.len() / 2).copied().unwrap_or(0.0),
            count: triangles.len(),
        });
    }
    *surface = surface.part(|t| !is_gone[t]);
    // What looked into the lumen now bounds it: this is no fault of the file, so not told as one.
    surface.orient();
    repairs
}

/// A wall that is there but was not told from a lumen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Suspicion {
    /// A place on it, m.
    pub(super) at_m: Point3<f64>,
    /// Part of the surface's area that looks like a wall.
    pub(super) part: f64,
}

/// Where much of a surface still looks like walls after the repairs.
pub(super) fn suspicion(surface: &Surface, radius_m: f64) -> Option<Suspicion> {
    let study = Study::of(surface, radius_m)?;
    let is_wall = |p: &usize| study.is_seen(*p, Face::Outer) || study.is_seen(*p, Face::Inner);
    let walls: Vec<usize> = (0..study.patches.triangles.len()).filter(is_wall).collect();
    let area = |p: &usize| study.patches.area_m2[*p];
    let whole_m2: f64 = study.patches.area_m2.iter().sum();
    let part = walls.iter().map(area).sum::<f64>() / whole_m2;
    let widest = walls.iter().max_by(|a, b| area(a).total_cmp(&area(b)))?;
    let at_m = surface.centroid(study.patches.triangles[*widest][0] as usize);
    (part > SUSPICIOUS).then_some(Suspicion { at_m, part })
}

/// A patch's look at what lies opposite.
struct Look {
    thickness_m: f64,
    opposite: u32,
}

impl Patches {
    fn new(surface: &Surface, neighbours: &[[Option<(u32, bool)>; 3]], radius_m: f64) -> Self {
        let count = surface.triangles.len();
        let normals: Vec<Vector3<f64>> = (0..count).map(|t| unit_or_zero(surface.vector_area(t))).collect();
        let centroids: Vec<Point3<f64>> = (0..count).map(|t| surface.centroid(t)).collect();
        let (mut of_triangle, mut triangles) = (vec![u32::MAX; count], Vec::<Vec<u32>>::new());
        for seed in 0..count {
            if of_triangle[seed] != u32::MAX {
                continue;
            }
            let name = triangles.len() as u32;
            of_triangle[seed] = name;
            let (mut members, mut queue) = (Vec::new(), VecDeque::from([seed as u32]));
            while let Some(here) = queue.pop_front() {
                members.push(here);
                for (next, _) in neighbours[here as usize].iter().flatten() {
                    let n = *next as usize;
                    let is_near = (centroids[n] - centroids[seed]).norm() < radius_m
                        && normals[n].dot(&normals[seed]) > PATCH_COSINE;
                    if of_triangle[n] == u32::MAX && is_near {
                        of_triangle[n] = name;
                        queue.push_back(*next);
                    }
                }
            }
            triangles.push(members);
        }
        let area_m2 = triangles
            .iter()
            .map(|members| members.iter().map(|t| surface.vector_area(*t as usize).norm()).sum())
            .collect();
        let around = |members: &Vec<u32>| {
            let own = of_triangle[members[0] as usize];
            let mut near: Vec<u32> = members
                .iter()
                .flat_map(|t| neighbours[*t as usize].iter().flatten())
                .map(|(other, _)| of_triangle[*other as usize])
                .filter(|other| *other != own)
                .collect();
            near.sort_unstable();
            near.dedup();
            near
        };
        let near = triangles.iter().map(around).collect();
        Self { of_triangle, triangles, area_m2, neighbours: near }
    }

    /// `Σ |e| β_e / 2` of each patch; an edge between two patches counts half for each.
    fn integrated_curvature(&self, surface: &Surface, neighbours: &[[Option<(u32, bool)>; 3]]) -> Vec<f64> {
        let mut sums = vec![0.0; self.triangles.len()];
        for (t, sides) in neighbours.iter().enumerate() {
            let normal = unit_or_zero(surface.vector_area(t));
            for (other, _) in sides.iter().flatten() {
                let o = *other as usize;
                let towards = unit_or_zero(surface.vector_area(o));
                let angle = normal.cross(&towards).norm().atan2(normal.dot(&towards));
                let is_convex = normal.dot(&(surface.centroid(o) - surface.centroid(t))) < 0.0;
                let length_m = shared_edge_m(surface, t, o);
                sums[self.of_triangle[t] as usize] +=
                    0.25 * length_m * if is_convex { angle } else { -angle };
            }
        }
        sums
    }

    /// Every patch's value and its neighbours', half and half.
    fn diffused(&self, values: &[f64]) -> Vec<f64> {
        let of = |(patch, near): (usize, &Vec<u32>)| {
            let around: f64 = near.iter().map(|n| values[*n as usize]).sum();
            let own = values[patch];
            if near.is_empty() { own } else { 0.5 * (own + around / near.len() as f64) }
        };
        self.neighbours.iter().enumerate().map(of).collect()
    }

    fn looks(&self, surface: &Surface) -> Vec<Vec<Look>> {
        let tree = Bvh::new(surface);
        let look = |t: &u32| {
            let inward = -unit_or_zero(surface.vector_area(*t as usize));
            let from = surface.centroid(*t as usize) + inward * START_M;
            tree.first_hit(&from, &inward, f64::INFINITY).map(|(thickness_m, opposite)| Look {
                thickness_m,
                opposite: self.of_triangle[opposite as usize],
            })
        };
        let of = |members: &Vec<u32>| {
            members.iter().step_by(members.len().div_ceil(LOOKS)).filter_map(look).collect()
        };
        self.triangles.iter().map(of).collect()
    }

    /// Votes of each patch, by its own looks, m².
    fn votes(&self, curvature: &[f64], looks: &[Vec<Look>]) -> [Vec<f64>; 3] {
        let mut votes = FACES.map(|_| vec![0.0; self.triangles.len()]);
        for (patch, looks) in looks.iter().enumerate() {
            for look in looks {
                let (here, there) = (curvature[patch], curvature[look.opposite as usize]);
                let is_thin = look.thickness_m * here.max(there) < 0.5;
                let face = match (here > 0.0, there > 0.0) {
                    (true, false) if is_thin => Face::Outer,
                    (false, true) if is_thin => Face::Inner,
                    _ => Face::Lumen,
                };
                votes[face as usize][patch] += self.area_m2[patch] / looks.len() as f64;
            }
        }
        votes
    }

    /// Stretches shorter than they are wide take the face that most of their neighbours have, the smallest first.
    fn settle(&self, faces: &mut [Face], curvature: &[f64]) {
        let mut stretches = self.stretches(|patch| Some(faces[patch]));
        let area = |stretch: &Vec<u32>| stretch.iter().map(|p| self.area_m2[*p as usize]).sum::<f64>();
        stretches.sort_by(|a, b| area(a).total_cmp(&area(b)));
        for stretch in stretches {
            let area_m2 = area(&stretch);
            let bent: f64 =
                stretch.iter().map(|p| self.area_m2[*p as usize] * curvature[*p as usize].abs()).sum();
            // A stretch of a tube as long as it is wide has an area of 4 π R², R = 1 / (2 c).
            if area_m2 * (bent / area_m2).powi(2) >= std::f64::consts::PI {
                continue;
            }
            let own = faces[stretch[0] as usize];
            let mut around: BTreeMap<Face, usize> = BTreeMap::new();
            for near in stretch.iter().flat_map(|p| &self.neighbours[*p as usize]) {
                if faces[*near as usize] != own {
                    *around.entry(faces[*near as usize]).or_default() += 1;
                }
            }
            if let Some((face, _)) = around.into_iter().max_by_key(|(_, count)| *count) {
                stretch.iter().for_each(|p| faces[*p as usize] = face);
            }
        }
    }

    /// Connected patches of the same name; those without one left out.
    fn stretches(&self, name: impl Fn(usize) -> Option<Face>) -> Vec<Vec<u32>> {
        let mut is_seen = vec![false; self.triangles.len()];
        let mut found = Vec::new();
        for seed in 0..self.triangles.len() {
            if is_seen[seed] || name(seed).is_none() {
                continue;
            }
            is_seen[seed] = true;
            let mut stretch = vec![seed as u32];
            let mut at = 0;
            while at < stretch.len() {
                for near in &self.neighbours[stretch[at] as usize] {
                    let n = *near as usize;
                    if !is_seen[n] && name(n) == name(seed) {
                        is_seen[n] = true;
                        stretch.push(*near);
                    }
                }
                at += 1;
            }
            found.push(stretch);
        }
        found
    }

    /// The outer faces that have an inner one opposite.
    fn outer(&self, faces: &[Face], looks: &[Vec<Look>]) -> Vec<Vec<u32>> {
        let is_outer = |patch: usize| (faces[patch] == Face::Outer).then_some(Face::Outer);
        let has_inner_opposite = |stretch: &Vec<u32>| {
            let opposite = || stretch.iter().flat_map(|p| &looks[*p as usize]);
            let inner = opposite().filter(|look| faces[look.opposite as usize] == Face::Inner).count();
            2 * inner > opposite().count()
        };
        self.stretches(is_outer).into_iter().filter(has_inner_opposite).collect()
    }
}

/// Length of the side that two triangles share, m.
fn shared_edge_m(surface: &Surface, a: usize, b: usize) -> f64 {
    let other = surface.triangles[b];
    let shared: Vec<Point3<f64>> = surface.triangles[a]
        .iter()
        .filter(|v| other.contains(v))
        .map(|v| surface.vertices[*v as usize])
        .collect();
    if let [p, q, ..] = shared[..] { (p - q).norm() } else { 0.0 }
}
