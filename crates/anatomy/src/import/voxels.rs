//! The inside of a closed surface as a graph of voxels that no step of can cross the wall.
//!
//! Every line of voxel middles along x, y and z is cut with the surface. A step between neighbours is walled where a crossing lies
//! between them, open where none does. Outside is what open steps reach from the grid's corner, inside is the rest: also a space between two
//! faces of a wall. So two loops that touch with less than a voxel of wall between them stay apart, which a plain voxel mask would
//! fuse, and normals do not matter. A diagonal step is open where some row of axis steps is.
//!
//! Lines that run exactly through an edge are decided the same way for both its triangles: the edge function is evaluated with its
//! corners in the order of their indices. The grid is shifted by an irrational part of a voxel so that this stays rare.
//!
//! ```text
//! clearance d: distance of a voxel's middle to the nearest triangle
//! ```

use super::bvh::Bvh;
use super::surface::Surface;
use nalgebra::{Point3, Vector3};

/// Voxels at most: 5 bytes each are touched only where there is lumen, 1 byte everywhere.
pub(super) const MAX_VOXELS: f64 = 40e6;
/// Parts of a voxel by which the grid is shifted.
const SHIFT: [f64; 3] = [0.414_213_562, 0.303_300_859, 0.271_443_309];

const OUTSIDE: u8 = 1 << 3;

/// The 26 steps to a neighbour; the opposite of step `i` is step `25 - i`.
pub(super) const STEPS: [[i32; 3]; 26] = steps();

const fn steps() -> [[i32; 3]; 26] {
    let mut steps = [[0; 3]; 26];
    let (mut from, mut to) = (0, 0);
    while from < 27 {
        if from != 13 {
            steps[to] = [from % 3 - 1, from / 3 % 3 - 1, from / 9 - 1];
            to += 1;
        }
        from += 1;
    }
    steps
}

/// Voxels with the walls between them.
pub(super) struct Voxels {
    pub(super) size: [usize; 3],
    pub(super) edge_m: f64,
    /// Middle of voxel (0, 0, 0), m.
    pub(super) first_m: Point3<f64>,
    /// Bits 0 to 2: wall before the next voxel along x, y, z; 3: outside.
    flags: Vec<u8>,
    /// Clearance of inside voxels, m.
    clearance_m: Vec<f32>,
    /// Inside voxels, in order.
    pub(super) inside: Vec<u32>,
}

impl Voxels {
    /// Voxels of a closed surface, with an edge as asked or larger where there would be too many.
    pub(super) fn new(surface: &Surface, edge_m: f64) -> Self {
        let (low, high) = surface.bounds();
        let extent = high - low;
        let needed = extent.map(|e| e / edge_m + 4.0).product();
        let edge_m = edge_m * (needed / MAX_VOXELS).cbrt().max(1.0);
        let size = [0, 1, 2].map(|i| (extent[i] / edge_m).ceil() as usize + 3);
        let first_m = low - Vector3::from(SHIFT.map(|s| (1.0 + s) * edge_m));
        let count = size.iter().product();
        let mut voxels = Self {
            size,
            edge_m,
            first_m,
            flags: vec![0; count],
            clearance_m: vec![0.0; count],
            inside: Vec::new(),
        };
        for axis in 0..3 {
            voxels.cut(surface, axis);
        }
        voxels.flood();
        voxels.inside = (0..count as u32).filter(|index| voxels.is_inside(*index as usize)).collect();
        voxels
    }

    /// Marks what open steps reach from the corner.
    fn flood(&mut self) {
        let strides = self.strides();
        let last = self.size.map(|n| n as u32 - 1);
        self.flags[0] |= OUTSIDE;
        let mut waiting = vec![([0_u32; 3], 0_usize)];
        while let Some((at, index)) = waiting.pop() {
            for axis in 0..3 {
                if at[axis] < last[axis] && self.flags[index] & (1 << axis) == 0 {
                    let next = index + strides[axis];
                    if self.flags[next] & OUTSIDE == 0 {
                        self.flags[next] |= OUTSIDE;
                        let mut place = at;
                        place[axis] += 1;
                        waiting.push((place, next));
                    }
                }
                if at[axis] > 0 {
                    let next = index - strides[axis];
                    if self.flags[next] & (OUTSIDE | 1 << axis) == 0 {
                        self.flags[next] |= OUTSIDE;
                        let mut place = at;
                        place[axis] -= 1;
                        waiting.push((place, next));
                    }
                }
            }
        }
    }

    fn strides(&self) -> [usize; 3] {
        [1, self.size[0], self.size[0] * self.size[1]]
    }

    pub(super) fn len(&self) -> usize {
        self.flags.len()
    }

    /// Cuts all lines along an axis with the surface.
    fn cut(&mut self, surface: &Surface, axis: usize) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let strides = self.strides();
        let in_grid: Vec<Point3<f64>> =
            surface.vertices.iter().map(|p| Point3::from((p - self.first_m) / self.edge_m)).collect();
        for triangle in &surface.triangles {
            let corners = triangle.map(|c| in_grid[c as usize]);
            let span = |k: usize| {
                let (low, high) = corners
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[k]), h.max(p[k])));
                (low.ceil().max(0.0) as usize, (high.floor().max(-1.0) + 1.0) as usize)
            };
            let ((u0, u1), (v0, v1)) = (span(u), span(v));
            for j in v0..v1.min(self.size[v]) {
                for i in u0..u1.min(self.size[u]) {
                    let Some(at) = crossing(triangle, &corners, (axis, u, v), (i as f64, j as f64)) else {
                        continue;
                    };
                    // The crossing lies after voxel `before` and not after the next.
                    let before = at.floor().clamp(0.0, (self.size[axis] - 1) as f64) as usize;
                    let line = i * strides[u] + j * strides[v];
                    self.flags[line + before * strides[axis]] |= 1 << axis;
                }
            }
        }
    }

    /// Counts as inside also what outside is walled in: a wall within `reach_m` in at least five of the six axis directions. So the lumen of
    /// a pipe with open mouths belongs to the graph, and where loops lie close the crevices between them, which no step joins to a
    /// lumen but at a mouth.
    pub(super) fn enclose(&mut self, reach_m: f64) {
        let reach = (reach_m / self.edge_m) as u16;
        let mut seen = vec![0_u8; self.flags.len()];
        for (axis, stride) in self.strides().into_iter().enumerate() {
            let mut since = vec![u16::MAX; self.flags.len()];
            for index in stride..self.flags.len() {
                let before = index - stride;
                let is_wall = self.flags[before] & (1 << axis) != 0;
                since[index] = if is_wall { 0 } else { since[before].saturating_add(1) };
                seen[index] += u8::from(since[index] <= reach);
            }
            since.fill(u16::MAX);
            for index in (0..self.flags.len() - stride).rev() {
                let is_wall = self.flags[index] & (1 << axis) != 0;
                since[index] = if is_wall { 0 } else { since[index + stride].saturating_add(1) };
                seen[index] += u8::from(since[index] <= reach);
            }
        }
        let [nx, ny, nz] = self.size;
        for (index, seen) in seen.iter().enumerate() {
            // The border stays outside: `next` relies on it.
            let at = [index % nx, index / nx % ny, index / (nx * ny)];
            let is_border = at[0] == 0
                || at[1] == 0
                || at[2] == 0
                || at[0] + 1 == nx
                || at[1] + 1 == ny
                || at[2] + 1 == nz;
            if *seen >= 5 && !is_border {
                self.flags[index] &= !OUTSIDE;
            }
        }
        self.inside = (0..self.flags.len() as u32).filter(|index| self.is_inside(*index as usize)).collect();
    }

    /// Index of the voxel that holds a place, where it is in the grid.
    pub(super) fn index_of(&self, place: &Point3<f64>) -> Option<usize> {
        let p = (place - self.first_m) / self.edge_m;
        let mut index = 0;
        for (axis, stride) in self.strides().into_iter().enumerate() {
            let i = p[axis].round();
            if !(i >= 0.0 && i < self.size[axis] as f64) {
                return None;
            }
            index += i as usize * stride;
        }
        Some(index)
    }

    /// Middle of a voxel, m.
    pub(super) fn place_m(&self, index: usize) -> Point3<f64> {
        let [nx, ny, _] = self.size;
        let p = Vector3::new((index % nx) as f64, (index / nx % ny) as f64, (index / (nx * ny)) as f64);
        self.first_m + p * self.edge_m
    }

    pub(super) fn is_inside(&self, index: usize) -> bool {
        self.flags[index] & OUTSIDE == 0
    }

    /// Distance to the wall, m.
    pub(super) fn clearance_m(&self, index: usize) -> f64 {
        f64::from(self.clearance_m[index])
    }

    /// Measures the clearance of every inside voxel.
    pub(super) fn measure(&mut self, tree: &Bvh, mut progress: impl FnMut(f64)) {
        let strides = self.strides();
        for n in 0..self.inside.len() {
            let index = self.inside[n] as usize;
            // One voxel on the distance grows by an edge at most: a bound that prunes the tree.
            let known = strides.iter().map(|s| self.clearance_m[index - s]).fold(0.0, f32::max);
            let limit_m = if known > 0.0 { f64::from(known) + 1.0001 * self.edge_m } else { f64::INFINITY };
            self.clearance_m[index] = tree.distance_m(&self.place_m(index), limit_m) as f32;
            if n % 16384 == 0 {
                progress(n as f64 / self.inside.len() as f64);
            }
        }
    }

    /// The neighbour one step on, where it is in the grid.
    pub(super) fn neighbour(&self, index: usize, step: [i32; 3]) -> Option<usize> {
        let [nx, ny, _] = self.size;
        let here = [index % nx, index / nx % ny, index / (nx * ny)];
        let mut next = index as i64;
        for (axis, stride) in self.strides().into_iter().enumerate() {
            let place = here[axis] as i64 + i64::from(step[axis]);
            if !(0..self.size[axis] as i64).contains(&place) {
                return None;
            }
            next += i64::from(step[axis]) * stride as i64;
        }
        Some(next as usize)
    }

    /// Whether a wall lies on the axis step from a voxel.
    fn is_walled(&self, index: usize, axis: usize, sign: i32) -> bool {
        let before = if sign > 0 { index } else { index - self.strides()[axis] };
        self.flags[before] & (1 << axis) != 0
    }

    /// One step on from an inside voxel: the grid's border is outside, so there is a neighbour.
    fn next(&self, index: usize, step: [i32; 3]) -> usize {
        let [sx, sy, sz] = self.strides().map(|s| s as i64);
        let [dx, dy, dz] = step.map(i64::from);
        (index as i64 + dx * sx + dy * sy + dz * sz) as usize
    }

    /// The inside voxel one open step on from an inside voxel.
    pub(super) fn open_neighbour(&self, index: usize, step: [i32; 3]) -> Option<usize> {
        let next = self.next(index, step);
        (self.is_inside(next) && self.is_open(index, step)).then_some(next)
    }

    /// Whether some row of axis steps leads through the lumen, from an inside voxel.
    fn is_open(&self, index: usize, step: [i32; 3]) -> bool {
        (0..3).filter(|axis| step[*axis] != 0).any(|axis| {
            let (mut one, mut rest) = ([0; 3], step);
            (one[axis], rest[axis]) = (step[axis], 0);
            let next = self.next(index, one);
            !self.is_walled(index, axis, step[axis])
                && self.is_inside(next)
                && (rest == [0; 3] || self.is_open(next, rest))
        })
    }
}

/// Where a line along `axis` through `(at.0, at.1)` of the other two cuts a triangle, grid units.
fn crossing(
    names: &[u32; 3],
    corners: &[Point3<f64>; 3],
    (axis, u, v): (usize, usize, usize),
    at: (f64, f64),
) -> Option<f64> {
    let mut weights = [0.0; 3];
    let mut is_left = [false; 3];
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let is_swapped = names[i] > names[j];
        let (a, b) = if is_swapped { (&corners[j], &corners[i]) } else { (&corners[i], &corners[j]) };
        let value = (b[u] - a[u]) * (at.1 - a[v]) - (b[v] - a[v]) * (at.0 - a[u]);
        is_left[k] = (value >= 0.0) != is_swapped;
        weights[k] = if is_swapped { -value } else { value };
    }
    let sum: f64 = weights.iter().sum();
    let is_in = is_left[0] == is_left[1] && is_left[1] == is_left[2] && sum != 0.0;
    is_in.then(|| (0..3).map(|k| weights[k] * corners[k][axis]).sum::<f64>() / sum)
}
