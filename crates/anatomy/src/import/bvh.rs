//! A tree of boxes over triangles: nearest point of the surface, and first hit of a ray.
//!
//! Nodes are split at the median of their longest axis, so the tree is balanced whatever the mesh; a leaf holds up to four triangles.
//! Distance to a triangle by its Voronoi regions (Ericson, *Real-Time Collision Detection*, section 5.1.5), hits by Möller and
//! Trumbore (J. Graphics Tools 2, 1997).

use super::surface::Surface;
use nalgebra::{Point3, Vector3};

const LEAF: usize = 4;

struct Node {
    low: Point3<f64>,
    high: Point3<f64>,
    /// First triangle of a leaf, or the second child (the first follows its parent).
    link: u32,
    /// Triangles of a leaf; 0 for an inner node.
    count: u32,
}

/// The tree; it holds its own copy of the triangles, in its order.
pub(super) struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Named>,
}

/// Corners of a triangle and its index in the surface.
type Named = ([Point3<f64>; 3], u32);

impl Bvh {
    pub(super) fn new(surface: &Surface) -> Self {
        let mut triangles: Vec<Named> =
            (0..surface.triangles.len()).map(|t| (surface.corners(t), t as u32)).collect();
        let mut tree = Self { nodes: Vec::new(), triangles: Vec::new() };
        if !triangles.is_empty() {
            let count = triangles.len();
            tree.build(&mut triangles, 0, count);
        }
        tree.triangles = triangles;
        tree
    }

    fn build(&mut self, triangles: &mut [Named], from: usize, to: usize) {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = -low;
        for corner in triangles[from..to].iter().flat_map(|(corners, _)| corners) {
            (low, high) = (low.inf(&corner.coords), high.sup(&corner.coords));
        }
        let index = self.nodes.len();
        let count = to - from;
        let is_leaf = count <= LEAF;
        let (link, leaf) = (from as u32, if is_leaf { count as u32 } else { 0 });
        self.nodes.push(Node { low: low.into(), high: high.into(), link, count: leaf });
        if is_leaf {
            return;
        }
        let axis = (high - low).imax();
        let key = |(t, _): &Named| t[0][axis] + t[1][axis] + t[2][axis];
        let middle = from + count / 2;
        triangles[from..to].select_nth_unstable_by(count / 2, |a, b| key(a).total_cmp(&key(b)));
        self.build(triangles, from, middle);
        self.nodes[index].link = self.nodes.len() as u32;
        self.build(triangles, middle, to);
    }

    /// Distance to the surface, m, where it is below `limit_m`; else `limit_m`.
    pub(super) fn distance_m(&self, place: &Point3<f64>, limit_m: f64) -> f64 {
        let mut best = limit_m * limit_m;
        if !self.nodes.is_empty() {
            self.nearest_in(0, place, &mut best);
        }
        best.sqrt()
    }

    fn nearest_in(&self, index: usize, place: &Point3<f64>, best: &mut f64) {
        let node = &self.nodes[index];
        if node.count > 0 {
            let from = node.link as usize;
            for (triangle, _) in &self.triangles[from..from + node.count as usize] {
                *best = best.min((closest(triangle, place) - place).norm_squared());
            }
            return;
        }
        let children =
            [index + 1, node.link as usize].map(|child| (self.nodes[child].squared_to(place), child));
        let [near, far] = if children[0].0 <= children[1].0 { children } else { [children[1], children[0]] };
        for (bound, child) in [near, far] {
            if bound < *best {
                self.nearest_in(child, place, best);
            }
        }
    }

    /// Distance along a unit vector to the first hit, m, where it is below `limit_m`.
    pub(super) fn hit_m(&self, from: &Point3<f64>, direction: &Vector3<f64>, limit_m: f64) -> Option<f64> {
        self.first_hit(from, direction, limit_m).map(|(distance_m, _)| distance_m)
    }

    /// The same, with the triangle that is hit.
    pub(super) fn first_hit(
        &self,
        from: &Point3<f64>,
        direction: &Vector3<f64>,
        limit_m: f64,
    ) -> Option<(f64, u32)> {
        let inverse = direction.map(|d| 1.0 / d);
        let (mut best, mut name) = (limit_m, 0);
        let mut stack: Vec<usize> = if self.nodes.is_empty() { Vec::new() } else { vec![0] };
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if !node.is_met(from, &inverse, best) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.link as usize, index + 1]);
                continue;
            }
            let first = node.link as usize;
            for (triangle, index) in &self.triangles[first..first + node.count as usize] {
                if let Some(t) = hit(triangle, from, direction).filter(|t| *t < best) {
                    (best, name) = (t, *index);
                }
            }
        }
        (best < limit_m).then_some((best, name))
    }
}

impl Node {
    fn squared_to(&self, place: &Point3<f64>) -> f64 {
        let outside = |i: usize| (self.low[i] - place[i]).max(place[i] - self.high[i]).max(0.0);
        Vector3::new(outside(0), outside(1), outside(2)).norm_squared()
    }

    fn is_met(&self, from: &Point3<f64>, inverse: &Vector3<f64>, limit_m: f64) -> bool {
        let (mut near, mut far) = (0.0_f64, limit_m);
        for i in 0..3 {
            let (a, b) = ((self.low[i] - from[i]) * inverse[i], (self.high[i] - from[i]) * inverse[i]);
            // `max` and `min` pass over the NaN of a ray within a face of the box.
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        near <= far
    }
}

fn closest([a, b, c]: &[Point3<f64>; 3], p: &Point3<f64>) -> Point3<f64> {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    // A triangle without area that got here: one of its corners is near enough.
    if sum > 0.0 { a + ab * (vb / sum) + ac * (vc / sum) } else { *a }
}

fn hit([a, b, c]: &[Point3<f64>; 3], from: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(&ac);
    let determinant = ab.dot(&p);
    if determinant == 0.0 {
        return None;
    }
    let s = from - a;
    let u = s.dot(&p) / determinant;
    let q = s.cross(&ab);
    let v = direction.dot(&q) / determinant;
    let t = ac.dot(&q) / determinant;
    // A hair wider than the triangle: a ray along a shared edge must not slip through.
    (u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 2e-9 && t > 0.0).then_some(t)
}
