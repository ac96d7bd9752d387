//! The inside of a closed surface as a graph of voxels that no step of can cross the wall.
//!
//! Every line of voxel middles along x, y and z is cut with the surface. A middle is inside where the number of crossings before it
//! is odd on at least two of its three lines; a step between neighbours is open where both are inside and no crossing lies
//! between them. So two loops that touch with less than a voxel of wall between them stay apart, which a plain voxel mask would
//! fuse. A diagonal step is open where some row of axis steps is.
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

const INSIDE: u8 = 1 << 6;
/// While lines are counted: the parity that the next voxel gets.
const CARRY: u8 = 1 << 7;

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
    /// Bits 0 to 2: wall before the next voxel along x, y, z; 3 to 5: parity along x, y, z; 6: inside.
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
        for index in 0..count {
            if (voxels.flags[index] >> 3 & 7).count_ones() >= 2 {
                voxels.flags[index] |= INSIDE;
                voxels.inside.push(index as u32);
            }
        }
        voxels
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
                    self.flags[line + before * strides[axis]] ^= 8 << axis;
                    self.flags[line + before * strides[axis]] |= 1 << axis;
                }
            }
        }
        self.count_along(axis);
    }

    /// Turns the parity of crossings after each voxel into the parity before it.
    fn count_along(&mut self, axis: usize) {
        let stride = self.strides()[axis];
        let bit = 8_u8 << axis;
        for index in 0..self.flags.len() {
            let place = index / stride % self.size[axis];
            let is_inside = place > 0 && self.flags[index - stride] & CARRY != 0;
            let flips = self.flags[index] & bit != 0;
            let after = is_inside != flips;
            self.flags[index] &= !(bit | CARRY);
            self.flags[index] |= if is_inside { bit } else { 0 } | if after { CARRY } else { 0 };
        }
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
        self.flags[index] & INSIDE != 0
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

    /// The inside voxel one open step on.
    pub(super) fn open_neighbour(&self, index: usize, step: [i32; 3]) -> Option<usize> {
        let next = self.neighbour(index, step).filter(|next| self.is_inside(*next))?;
        self.is_open(index, step).then_some(next)
    }

    /// Whether some row of axis steps leads through the lumen.
    fn is_open(&self, index: usize, step: [i32; 3]) -> bool {
        if step == [0; 3] {
            return true;
        }
        (0..3).filter(|axis| step[*axis] != 0).any(|axis| {
            let (mut one, mut rest) = ([0; 3], step);
            (one[axis], rest[axis]) = (step[axis], 0);
            !self.is_walled(index, axis, step[axis])
                && self
                    .neighbour(index, one)
                    .is_some_and(|next| self.is_inside(next) && self.is_open(next, rest))
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
