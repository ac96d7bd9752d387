//! A triangle surface and its topology: edges, components, rims, orientation, volume.
//!
//! ```text
//! volume V = Σ a · (b × c) / 6,   area A = Σ |(b - a) × (c - a)| / 2,   mean radius of a long tube r = 2 V / A
//! ```
//!
//! The *boundary modulo 2* are the edges with an odd number of triangles. A surface without any is closed in the sense that a
//! ray to infinity crosses it an even number of times from outside and an odd number from inside, whatever its normals and
//! however many sheets meet in an edge: this is all that the voxels of `voxels` need.

use nalgebra::{Point3, Vector3};
use std::collections::{BTreeSet, VecDeque};

/// Rows of triangles around a rim that tell on which side of it the surface lies.
const RINGS: usize = 6;

/// A surface, m.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// Corners, m.
    pub vertices: Vec<Point3<f64>>,
    /// Corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// One side of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct EdgeUse {
    pub(super) low: u32,
    pub(super) high: u32,
    pub(super) triangle: u32,
    /// Whether the triangle runs from `low` to `high`.
    pub(super) is_forward: bool,
}

/// A closed row of boundary edges.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rim {
    pub(super) vertices: Vec<u32>,
    pub(super) centre: Point3<f64>,
    /// Twice the largest distance from the centre, m.
    pub(super) diameter_m: f64,
    /// Unit normal of the rim's own vector area, as its vertices turn.
    pub(super) normal: Vector3<f64>,
    /// Unit vector away from the surface at the rim.
    pub(super) outward: Vector3<f64>,
}

/// Sets that grow together.
pub(super) struct Unions(Vec<u32>);

impl Unions {
    pub(super) fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    pub(super) fn find(&mut self, mut index: u32) -> u32 {
        while self.0[index as usize] != index {
            let parent = self.0[index as usize];
            self.0[index as usize] = self.0[parent as usize];
            index = parent;
        }
        index
    }

    /// The smaller index stays the name of the set.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

impl Surface {
    /// Corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Point3<f64>; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }

    /// Smallest and largest coordinates of the corners in use.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = -low;
        for v in self.triangles.iter().flatten() {
            let p = self.vertices[*v as usize].coords;
            (low, high) = (low.inf(&p), high.sup(&p));
        }
        (low.into(), high.into())
    }

    /// Middle of the box.
    pub(super) fn middle(&self) -> Point3<f64> {
        let (low, high) = self.bounds();
        nalgebra::center(&low, &high)
    }

    /// Enclosed volume, m³, positive where normals point outwards; the origin is the middle of the box, against cancellation.
    pub fn volume_m3(&self) -> f64 {
        let origin = self.middle();
        let of = |t: usize| {
            let [a, b, c] = self.corners(t).map(|p| p - origin);
            a.dot(&b.cross(&c)) / 6.0
        };
        (0..self.triangles.len()).map(of).sum()
    }

    /// Area, m².
    pub fn area_m2(&self) -> f64 {
        (0..self.triangles.len()).map(|t| self.vector_area(t).norm()).sum()
    }

    /// Half the cross product of two sides.
    pub(super) fn vector_area(&self, triangle: usize) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        0.5 * (b - a).cross(&(c - a))
    }

    pub(super) fn centroid(&self, triangle: usize) -> Point3<f64> {
        let [a, b, c] = self.corners(triangle);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    }

    /// All sides, those of the same edge together.
    pub(super) fn edge_uses(&self) -> Vec<EdgeUse> {
        let mut uses = Vec::with_capacity(3 * self.triangles.len());
        for (t, [a, b, c]) in self.triangles.iter().enumerate() {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let (low, high) = (*from.min(to), *from.max(to));
                uses.push(EdgeUse { low, high, triangle: t as u32, is_forward: from < to });
            }
        }
        uses.sort_unstable();
        uses
    }

    /// Component of each triangle, numbered from 0 by the first triangle; connected through edges of exactly two triangles.
    pub(super) fn components(&self) -> (usize, Vec<u32>) {
        let mut sets = Unions::new(self.triangles.len());
        for edge in self.edge_uses().chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
            if let [a, b] = edge {
                sets.join(a.triangle, b.triangle);
            }
        }
        let mut number = vec![u32::MAX; self.triangles.len()];
        let mut count = 0;
        let labels = (0..self.triangles.len() as u32)
            .map(|t| {
                let root = sets.find(t) as usize;
                if number[root] == u32::MAX {
                    number[root] = count;
                    count += 1;
                }
                number[root]
            })
            .collect();
        (count as usize, labels)
    }

    /// The part made of these triangles, with all vertices.
    pub(super) fn part(&self, keep: impl Fn(usize) -> bool) -> Self {
        let kept = self.triangles.iter().enumerate().filter(|(t, _)| keep(*t)).map(|(_, corners)| *corners);
        Self { vertices: self.vertices.clone(), triangles: kept.collect() }
    }

    /// Turns triangles so that neighbours agree, and every component so that its volume is positive (rims are spanned by fans for that).
    /// The triangles that were turned within their component, and the components turned whole (first triangle, size).
    pub(super) fn orient(&mut self) -> (Vec<u32>, Vec<(u32, usize)>) {
        let neighbours = self.neighbours();
        let mut flip: Vec<Option<bool>> = vec![None; self.triangles.len()];
        let mut components: Vec<Vec<u32>> = Vec::new();
        for seed in 0..self.triangles.len() {
            if flip[seed].is_some() {
                continue;
            }
            flip[seed] = Some(false);
            let (mut members, mut queue) = (Vec::new(), VecDeque::from([seed as u32]));
            while let Some(t) = queue.pop_front() {
                members.push(t);
                let own = flip[t as usize] == Some(true);
                for (other, agrees) in neighbours[t as usize].iter().flatten() {
                    let slot = &mut flip[*other as usize];
                    if slot.is_none() {
                        *slot = Some(own == *agrees);
                        queue.push_back(*other);
                    }
                }
            }
            components.push(members);
        }
        for (t, flip) in flip.iter().enumerate() {
            if *flip == Some(true) {
                self.triangles[t].swap(1, 2);
            }
        }
        let (mut turned, mut whole) = (Vec::new(), Vec::new());
        for members in &components {
            let volume = self.spanned_volume(members);
            if volume < 0.0 {
                members.iter().for_each(|t| self.triangles[*t as usize].swap(1, 2));
            }
            // Against what stood in the file, the minority was wrong.
            let is_turned = |t: &&u32| (flip[**t as usize] == Some(true)) != (volume < 0.0);
            let count = members.iter().filter(is_turned).count();
            if 2 * count > members.len() {
                whole.push((members[0], members.len()));
                turned.extend(members.iter().filter(|t| !is_turned(t)));
            } else {
                turned.extend(members.iter().filter(is_turned));
            }
        }
        (turned, whole)
    }

    /// Neighbour across each side of each triangle, and whether both turn the same way.
    pub(super) fn neighbours(&self) -> Vec<[Option<(u32, bool)>; 3]> {
        let mut neighbours = vec![[None; 3]; self.triangles.len()];
        let mut put = |from: &EdgeUse, to: &EdgeUse| {
            let sides: &mut [Option<(u32, bool)>; 3] = &mut neighbours[from.triangle as usize];
            if let Some(free) = sides.iter_mut().find(|side| side.is_none()) {
                *free = Some((to.triangle, from.is_forward != to.is_forward));
            }
        };
        for edge in self.edge_uses().chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
            if let [a, b] = edge {
                put(a, b);
                put(b, a);
            }
        }
        neighbours
    }

    /// Volume of some triangles with their rims spanned by fans from their middle, m³.
    fn spanned_volume(&self, members: &[u32]) -> f64 {
        let part = Self {
            vertices: self.vertices.clone(),
            triangles: members.iter().map(|t| self.triangles[*t as usize]).collect(),
        };
        part.spanned().volume_m3()
    }

    /// The surface with every rim spanned by a fan, turned to fit its neighbours.
    pub(super) fn spanned(&self) -> Self {
        let mut closed = self.clone();
        for rim in self.rims() {
            closed.span(&rim);
        }
        closed
    }

    /// Closes a rim by a fan from its middle.
    pub(super) fn span(&mut self, rim: &Rim) {
        let middle = self.vertices.len() as u32;
        self.vertices.push(rim.centre);
        for i in 0..rim.vertices.len() {
            let (a, b) = (rim.vertices[i], rim.vertices[(i + 1) % rim.vertices.len()]);
            // Rims run as their triangles do, so a closing triangle runs the other way.
            self.triangles.push([b, a, middle]);
        }
    }

    /// The boundary modulo 2, as closed rows that meet no vertex twice.
    pub(super) fn rims(&self) -> Vec<Rim> {
        let mut edges: Vec<(u32, u32)> = Vec::new();
        for edge in self.edge_uses().chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
            if edge.len() % 2 == 1 {
                let e = edge[0];
                edges.push(if e.is_forward { (e.low, e.high) } else { (e.high, e.low) });
            }
        }
        if edges.is_empty() {
            return Vec::new();
        }
        let mut of_vertex: Vec<(u32, u32)> = Vec::with_capacity(3 * self.triangles.len());
        for (t, corners) in self.triangles.iter().enumerate() {
            of_vertex.extend(corners.iter().map(|v| (*v, t as u32)));
        }
        of_vertex.sort_unstable();
        loops(&edges).into_iter().map(|vertices| self.rim(vertices, &of_vertex)).collect()
    }

    /// The triangles within [`RINGS`] of a rim. `of_vertex`: triangles by vertex, sorted.
    fn around(&self, rim: &[u32], of_vertex: &[(u32, u32)]) -> Vec<u32> {
        let (mut seen, mut found) = (BTreeSet::new(), BTreeSet::new());
        let mut front: Vec<u32> = rim.to_vec();
        seen.extend(front.iter().copied());
        for _ in 0..RINGS {
            let mut next = Vec::new();
            for v in front {
                let from = of_vertex.partition_point(|(w, _)| *w < v);
                for (_, t) in of_vertex[from..].iter().take_while(|(w, _)| *w == v) {
                    found.insert(*t);
                    next.extend(self.triangles[*t as usize].into_iter().filter(|w| seen.insert(*w)));
                }
            }
            front = next;
        }
        found.into_iter().collect()
    }

    fn rim(&self, vertices: Vec<u32>, of_vertex: &[(u32, u32)]) -> Rim {
        let triangles = self.around(&vertices, of_vertex);
        let at = |v: u32| self.vertices[v as usize];
        let count = vertices.len() as f64;
        let centre = Point3::from(vertices.iter().map(|v| at(*v).coords).sum::<Vector3<f64>>() / count);
        let radius = vertices.iter().map(|v| (at(*v) - centre).norm()).fold(0.0, f64::max);
        let area: Vector3<f64> = (0..vertices.len())
            .map(|i| (at(vertices[i]) - centre).cross(&(at(vertices[(i + 1) % vertices.len()]) - centre)))
            .sum();
        let inward: Vector3<f64> = triangles.iter().map(|t| self.centroid(*t as usize) - centre).sum();
        // Across the rim's plane, to the side where its triangles are not.
        let normal = unit_or_zero(area);
        let outward = if normal.dot(&inward) > 0.0 { -normal } else { normal };
        Rim { vertices, centre, diameter_m: 2.0 * radius, normal, outward }
    }
}

/// Closed rows of directed edges; a row that meets a vertex twice is two rows.
fn loops(edges: &[(u32, u32)]) -> Vec<Vec<u32>> {
    let mut ends: Vec<(u32, usize)> = Vec::with_capacity(2 * edges.len());
    for (i, (from, to)) in edges.iter().enumerate() {
        ends.extend([(*from, i), (*to, i)]);
    }
    ends.sort_unstable();
    let mut is_used = vec![false; edges.len()];
    let mut found = Vec::new();
    for first in 0..edges.len() {
        if is_used[first] {
            continue;
        }
        is_used[first] = true;
        let mut walk: Vec<u32> = vec![edges[first].0, edges[first].1];
        loop {
            let here = walk[walk.len() - 1];
            if let Some(back) = walk[..walk.len() - 1].iter().position(|v| *v == here) {
                let row = walk.split_off(back + 1);
                if row.len() >= 2 {
                    found.push(row);
                }
                if walk.len() == 1 {
                    break;
                }
            }
            let here = walk[walk.len() - 1];
            let from = ends.partition_point(|(v, _)| *v < here);
            let next = ends[from..].iter().take_while(|(v, _)| *v == here).find(|(_, e)| {
                // Along the triangles' own direction where there is one.
                !is_used[*e] && edges[*e].0 == here
            });
            let any = || ends[from..].iter().take_while(|(v, _)| *v == here).find(|(_, e)| !is_used[*e]);
            // Every vertex of a boundary modulo 2 has an even number of edges, so a walk ends only where it began.
            let Some((_, edge)) = next.or_else(any) else { break };
            is_used[*edge] = true;
            let (a, b) = edges[*edge];
            walk.push(if a == here { b } else { a });
        }
    }
    found
}

/// Unit vector; zero where there is no direction.
pub(super) fn unit_or_zero(v: Vector3<f64>) -> Vector3<f64> {
    v.try_normalize(0.0).unwrap_or_else(Vector3::zeros)
}
