//! A body of voxels: a regular grid of materials, crossed exactly.
//!
//! A ray runs from voxel to voxel by the next face that it meets (Amanatides and Woo 1987), in the grid's own index coordinates: voxel
//! `(i, j, k)` fills `[i, i+1) x [j, j+1) x [k, k+1)`. The map from the torso's frame is affine, so turned and flipped grids need no
//! resampling, and since the ray's parameter is its length in the torso's frame no step has to be scaled.

use super::Material;
use nalgebra::{Matrix3, Vector3};

/// Index of a voxel without material.
pub const OUTSIDE: u8 = u8::MAX;

/// A regular grid of materials.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGrid {
    size: [usize; 3],
    index_from_torso: Matrix3<f64>,
    /// Index coordinates of the torso's origin.
    origin_index: Vector3<f64>,
    materials: Vec<Material>,
    /// Material per voxel, the first index fastest; [`OUTSIDE`] for none.
    voxels: Vec<u8>,
    /// The part that holds material, as index coordinates.
    hull: (Vector3<f64>, Vector3<f64>),
    largest_per_m: f64,
}

/// Why voxels make no grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// Number of voxels and size differ.
    #[error("{found} voxels for a grid of {size:?}")]
    Count {
        /// Voxels there are.
        found: usize,
        /// The grid's size.
        size: [usize; 3],
    },
    /// The voxels' axes do not span space.
    #[error("the voxels' axes do not span space, or are not finite")]
    Axes,
    /// A voxel of a material that is not listed.
    #[error("material {0} is not listed")]
    Material(u8),
    /// More materials than an index can tell.
    #[error("{0} materials; allowed: 1 to 254")]
    Materials(usize),
    /// No voxel holds a material.
    #[error("no voxel holds a material")]
    Empty,
}

impl VoxelGrid {
    /// A grid. Columns of `torso_from_index` are the voxels' edges, m; `corner_torso_m` is the outer corner of voxel (0, 0, 0).
    ///
    /// # Errors
    /// [`GridError`].
    pub fn new(
        size: [usize; 3],
        torso_from_index: &Matrix3<f64>,
        corner_torso_m: &Vector3<f64>,
        materials: Vec<Material>,
        voxels: Vec<u8>,
    ) -> Result<Self, GridError> {
        let count = size.iter().try_fold(1_usize, |n, s| n.checked_mul(*s));
        if count != Some(voxels.len()) {
            return Err(GridError::Count { found: voxels.len(), size });
        }
        if materials.is_empty() || materials.len() >= usize::from(OUTSIDE) {
            return Err(GridError::Materials(materials.len()));
        }
        if let Some(unknown) = voxels.iter().find(|v| **v != OUTSIDE && usize::from(**v) >= materials.len()) {
            return Err(GridError::Material(*unknown));
        }
        let index_from_torso = torso_from_index.try_inverse().ok_or(GridError::Axes)?;
        let origin_index = -(index_from_torso * corner_torso_m);
        if !index_from_torso.iter().chain(origin_index.iter()).all(|v| v.is_finite()) {
            return Err(GridError::Axes);
        }
        let hull = hull(size, &voxels).ok_or(GridError::Empty)?;
        let mut is_used = vec![false; materials.len()];
        voxels.iter().filter(|v| **v != OUTSIDE).for_each(|v| is_used[usize::from(*v)] = true);
        let used = materials.iter().zip(&is_used).filter(|(_, used)| **used);
        let largest_per_m = used.map(|(m, _)| m.attenuation_511_per_m).fold(0.0, f64::max);
        Ok(Self { size, index_from_torso, origin_index, materials, voxels, hull, largest_per_m })
    }

    /// Voxels along each index.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// The materials.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Material per voxel, the first index fastest; [`OUTSIDE`] for none.
    pub fn voxels(&self) -> &[u8] {
        &self.voxels
    }

    /// The largest attenuation coefficient of a voxel, 1/m.
    pub fn largest_attenuation_511_per_m(&self) -> f64 {
        self.largest_per_m
    }

    /// Material at a place; `None` outside.
    pub fn material_at(&self, place_m: &Vector3<f64>) -> Option<&Material> {
        let p = self.to_index(place_m);
        let mut cell = [0; 3];
        for axis in 0..3 {
            if !(p[axis] >= 0.0 && p[axis] < self.size[axis] as f64) {
                return None;
            }
            cell[axis] = p[axis] as usize;
        }
        self.materials.get(usize::from(self.voxel(cell)))
    }

    /// Entry and exit of a ray through the box that holds all material, as distances along the unit vector `direction`, m.
    pub fn chord_m(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64)> {
        through(&self.hull, &self.to_index(from_m), &(self.index_from_torso * direction))
    }

    /// `∫ μ(511 keV) dl` from a place outwards along the unit vector `direction`.
    pub fn optical_depth_511(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
        let mut depth = 0.0;
        self.cross(from_m, direction, |voxel, length_m| {
            depth +=
                length_m * self.materials.get(usize::from(voxel)).map_or(0.0, |m| m.attenuation_511_per_m);
        });
        depth
    }

    /// Hands every voxel that a ray crosses from a place outwards to `visit`, with the length in it, m.
    pub fn cross(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>, mut visit: impl FnMut(u8, f64)) {
        let (p, d) = (self.to_index(from_m), self.index_from_torso * direction);
        let Some((near, far)) = through(&self.hull, &p, &d) else { return };
        let mut at = near.max(0.0);
        if at >= far {
            return;
        }
        let mut cell = [0_usize; 3];
        // Length of ray to the next face, and from face to face, per axis.
        let (mut next, mut step) = ([f64::INFINITY; 3], [f64::INFINITY; 3]);
        for axis in 0..3 {
            let (low, high) = (self.hull.0[axis], self.hull.1[axis]);
            // Rounding may put the entry a little beside the hull.
            let place = (p[axis] + d[axis] * at).clamp(low, high - 0.5e-9);
            cell[axis] = place.floor().clamp(low, high - 1.0) as usize;
            if d[axis] != 0.0 {
                step[axis] = 1.0 / d[axis].abs();
                let face = if d[axis] > 0.0 { cell[axis] + 1 } else { cell[axis] };
                next[axis] = (face as f64 - p[axis]) / d[axis];
            }
        }
        loop {
            let axis = if next[0] <= next[1] && next[0] <= next[2] {
                0
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            let to = next[axis].min(far);
            if to > at {
                visit(self.voxel(cell), to - at);
                at = to;
            }
            let is_last = if d[axis] > 0.0 {
                (cell[axis] + 1) as f64 >= self.hull.1[axis]
            } else {
                cell[axis] as f64 <= self.hull.0[axis]
            };
            if next[axis] >= far || is_last {
                return;
            }
            next[axis] += step[axis];
            cell[axis] = if d[axis] > 0.0 { cell[axis] + 1 } else { cell[axis] - 1 };
        }
    }

    fn to_index(&self, place_m: &Vector3<f64>) -> Vector3<f64> {
        self.index_from_torso * place_m + self.origin_index
    }

    fn voxel(&self, cell: [usize; 3]) -> u8 {
        self.voxels[(cell[2] * self.size[1] + cell[1]) * self.size[0] + cell[0]]
    }
}

/// The smallest box that holds all material.
fn hull(size: [usize; 3], voxels: &[u8]) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for (n, _) in voxels.iter().enumerate().filter(|(_, v)| **v != OUTSIDE) {
        let cell =
            Vector3::new(n % size[0], n / size[0] % size[1], n / (size[0] * size[1])).map(|v| v as f64);
        low = low.inf(&cell);
        high = high.sup(&cell.add_scalar(1.0));
    }
    (low.x < high.x).then_some((low, high))
}

/// Where a ray is in a box.
fn through(
    (low, high): &(Vector3<f64>, Vector3<f64>),
    p: &Vector3<f64>,
    d: &Vector3<f64>,
) -> Option<(f64, f64)> {
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if p[axis] < low[axis] || p[axis] >= high[axis] {
                return None;
            }
            continue;
        }
        let ends = [(low[axis] - p[axis]) / d[axis], (high[axis] - p[axis]) / d[axis]];
        near = near.max(ends[0].min(ends[1]));
        far = far.min(ends[0].max(ends[1]));
    }
    (near < far).then_some((near, far))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn material(name: &str, attenuation_511_per_m: f64) -> Material {
        Material { name: name.into(), attenuation_511_per_m }
    }

    /// Two materials in a turned, stretched grid with holes.
    fn grid() -> VoxelGrid {
        let size = [7, 5, 6];
        let voxels = (0..210).map(|n: usize| match n * 2_654_435_761 % 7 {
            0 | 1 => OUTSIDE,
            2..=4 => 0,
            _ => 1,
        });
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.4, 0.9).into_inner();
        let axes = turn * Matrix3::from_diagonal(&Vector3::new(0.01, 0.02, 0.015));
        let corner = axes * Vector3::new(-3.5, -2.5, -3.0);
        let materials = vec![material("a", 9.6), material("b", 17.2)];
        VoxelGrid::new(size, &axes, &corner, materials, voxels.collect()).unwrap()
    }

    #[test]
    fn closed_form_a_row_of_voxels() {
        let axes = Matrix3::from_diagonal_element(0.01);
        let voxels = vec![OUTSIDE, 0, 1, OUTSIDE, 0];
        let materials = vec![material("a", 10.0), material("b", 20.0)];
        let row = VoxelGrid::new([5, 1, 1], &axes, &Vector3::zeros(), materials, voxels).unwrap();
        let middle = Vector3::new(-1.0, 0.005, 0.005);
        assert_eq!(
            row.chord_m(&middle, &Vector3::x()).map(|(a, b)| ((a * 1e6).round(), (b * 1e6).round())),
            Some((1_010_000.0, 1_050_000.0))
        );
        assert!((row.optical_depth_511(&middle, &Vector3::x()) - 0.4).abs() < 1e-12);
        assert_eq!(row.optical_depth_511(&middle, &-Vector3::x()), 0.0);
        let inside = Vector3::new(0.025, 0.005, 0.005);
        assert!((row.optical_depth_511(&inside, &Vector3::x()) - 0.2).abs() < 1e-12);
        assert!((row.optical_depth_511(&inside, &-Vector3::x()) - 0.2).abs() < 1e-12);
        assert!((row.optical_depth_511(&inside, &Vector3::z()) - 0.1).abs() < 1e-12);
        assert_eq!(row.material_at(&inside).unwrap().name, "b");
        assert!(row.material_at(&Vector3::new(0.035, 0.005, 0.005)).is_none());
        assert!(row.material_at(&Vector3::new(0.051, 0.005, 0.005)).is_none());
        assert_eq!(row.largest_attenuation_511_per_m(), 20.0);
    }

    #[test]
    fn law_what_makes_no_grid_is_refused() {
        let axes = Matrix3::from_diagonal_element(0.01);
        let make = |size, axes: &Matrix3<f64>, materials, voxels: Vec<u8>| {
            VoxelGrid::new(size, axes, &Vector3::zeros(), materials, voxels).unwrap_err()
        };
        let one = || vec![material("a", 1.0)];
        assert!(matches!(make([2, 1, 1], &axes, one(), vec![0]), GridError::Count { .. }));
        assert!(matches!(make([usize::MAX, 3, 1], &axes, one(), vec![0]), GridError::Count { .. }));
        assert_eq!(make([1, 1, 1], &Matrix3::zeros(), one(), vec![0]), GridError::Axes);
        assert_eq!(make([1, 1, 1], &axes, one(), vec![1]), GridError::Material(1));
        assert_eq!(make([1, 1, 1], &axes, vec![], vec![0]), GridError::Materials(0));
        assert_eq!(make([1, 1, 1], &axes, one(), vec![OUTSIDE]), GridError::Empty);
    }

    proptest! {
        /// The exact traversal against a sum over small steps, and lengths against the chord.
        #[test]
        fn cross_traversal_is_the_integral_of_the_material_along_the_ray(
            p in prop::array::uniform3(-0.08_f64..0.08),
            d in prop::array::uniform3(-1.0_f64..1.0),
        ) {
            let Some(direction) = Vector3::from(d).try_normalize(1e-3) else { return Ok(()) };
            let (grid, from) = (grid(), Vector3::from(p));
            let (steps, reach_m) = (40_000, 0.3);
            let step_m = reach_m / f64::from(steps);
            let at = |i: i32| from + direction * (step_m * (f64::from(i) + 0.5));
            let sum: f64 = (0..steps).map(|i| grid.material_at(&at(i)).map_or(0.0, |m| m.attenuation_511_per_m)).sum();
            // Every face between two materials costs at most half a step.
            let tolerance = 40.0 * step_m * 17.2;
            let exact = grid.optical_depth_511(&from, &direction);
            prop_assert!((exact - sum * step_m).abs() < tolerance, "{exact} {}", sum * step_m);
            let mut length_m = 0.0;
            grid.cross(&from, &direction, |_, l| length_m += l);
            let chord = grid.chord_m(&from, &direction).map_or(0.0, |(near, far)| far.max(0.0) - near.max(0.0));
            prop_assert!((length_m - chord).abs() < 1e-9, "{length_m} {chord}");
        }

        #[test]
        fn law_rays_along_faces_and_through_corners_end(
            axis in 0_usize..3, sign in prop::bool::ANY, i in 0_u8..8, j in 0_u8..8,
        ) {
            let axes = Matrix3::from_diagonal_element(0.01);
            let cube = VoxelGrid::new([7; 3], &axes, &Vector3::zeros(), vec![material("a", 1.0)], vec![0; 343]).unwrap();
            let mut from = Vector3::repeat(-0.01);
            from[(axis + 1) % 3] = 0.01 * f64::from(i);
            from[(axis + 2) % 3] = 0.01 * f64::from(j);
            let mut direction = Vector3::zeros();
            direction[axis] = 1.0;
            if sign {
                from[axis] = 0.08;
                direction[axis] = -1.0;
            }
            let wanted = if i < 7 && j < 7 { 0.07 } else { 0.0 };
            prop_assert!((cube.optical_depth_511(&from, &direction) - wanted).abs() < 1e-9);
            let diagonal = Vector3::repeat(1.0).normalize();
            let depth = cube.optical_depth_511(&Vector3::repeat(-0.02), &diagonal);
            prop_assert!((depth - 0.07 * 3.0_f64.sqrt()).abs() < 1e-9);
        }
    }
}
