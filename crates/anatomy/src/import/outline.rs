//! The outer faces of walls drawn double. The lumen is what the inner face bounds; the outline of the organ still tells two things.
//!
//! *The middle.* Where a wall has both faces, the outer one is the outline of the organ, without the folds and pouches of the inner, and the line is centred in
//! it, as far as it stays in the lumen (`middle`, step 2). Only where a ray leaves the outline counts: where loops overlap, another's
//! outer face is entered on the way. Of one person's colon (Visible Human male, walls 8 mm thick) the centre line given lies so far from the
//! centroids of its sections, mean in mm:
//!
//! | | ascending | descending | sigmoid and rectum |
//! |---|---|---|---|
//! | of the inner face | 3.4 | 2.3 | 2.6 |
//! | of the outer face | 2.3 | 2.2 | 1.7 |
//!
//! *The ends.* The inner face may end blind before the outer one (of the same person the anal canal has none). Where the outer one reaches further by more
//! than a lumen's width, the line goes on within it, and there it is the lumen's wall.
//!
//! The way itself is looked for in the lumen, since outlines of neighbouring loops overlap and would let it through.

use super::bvh::Bvh;
use super::middle::chords_m;
use super::path::{Pay, led_on, nearest_inside, search};
use super::surface::Surface;
use super::voxels::Voxels;
use nalgebra::{Point3, Vector3};

/// Faces that a ray may enter before it leaves one.
const MOST_FACES: usize = 16;
/// A tail is led on by three mean radii at most so many times: no anal canal is longer.
const MOST_STEPS: usize = 4;
/// A lumen's width in mean radii: a wall is thinner.
const WIDTH_RADII: f64 = 2.0;
/// A ray goes on so far behind a face it entered, m: half the distance of corners that are one.
const START_M: f64 = 5e-6;

/// Outer faces, normals outwards, and their tree.
pub(super) struct Outline {
    surface: Surface,
    tree: Bvh,
}

impl Outline {
    /// `None` where there are no outer faces.
    pub(super) fn of(surface: Surface) -> Option<Self> {
        (!surface.triangles.is_empty()).then(|| Self { tree: Bvh::new(&surface), surface })
    }

    /// Distance along a unit vector to where it leaves the outline, m, where that is below `limit_m`.
    pub(super) fn exit_m(&self, from: &Point3<f64>, direction: &Vector3<f64>, limit_m: f64) -> Option<f64> {
        let mut walked_m = 0.0;
        for _ in 0..MOST_FACES {
            let here = from + direction * walked_m;
            let (hit_m, triangle) = self.tree.first_hit(&here, direction, limit_m - walked_m)?;
            if self.surface.vector_area(triangle as usize).dot(direction) > 0.0 {
                return Some(walked_m + hit_m);
            }
            walked_m += hit_m + START_M;
        }
        None
    }

    /// Its inside, with voxels of so long an edge.
    pub(super) fn voxels(&self, edge_m: f64) -> Voxels {
        let mut voxels = Voxels::new(&self.surface, edge_m);
        voxels.measure(&self.tree, |_| ());
        voxels
    }

    /// The lumen's surface with the outer face along a tail, where that is nearer to it, and without what ends the inner face there.
    pub(super) fn led_on_surface(&self, lumen: &Surface, tail: &[Point3<f64>]) -> Surface {
        let tree = Bvh::new(lumen);
        let away_m = |place: &Point3<f64>| {
            tail.iter().map(|p| (p - place).norm_squared()).fold(f64::INFINITY, f64::min).sqrt()
        };
        let is_nearer_to_tail = |surface: &Surface, other: &Bvh, t: usize| {
            let place = surface.centroid(t);
            let away_m = away_m(&place);
            other.distance_m(&place, 1.001 * away_m) > away_m
        };
        let mut joined = lumen.part(|t| !is_nearer_to_tail(lumen, &self.tree, t));
        let shift = joined.vertices.len() as u32;
        let along = self.surface.part(|t| is_nearer_to_tail(&self.surface, &tree, t));
        joined.vertices.extend(along.vertices);
        joined.triangles.extend(along.triangles.iter().map(|corners| corners.map(|v| v + shift)));
        joined
    }
}

/// From where the outer face ends beyond an end of the lumen to the first place in the lumen; `None` where that is no longer than a lumen is wide.
pub(super) fn tail(
    outer: &Voxels,
    lumen: &Voxels,
    [end_m, other_m]: [Point3<f64>; 2],
    radius_m: f64,
) -> Option<Vec<Point3<f64>>> {
    let (end, other) = (nearest_inside(outer, &end_m)?.0, nearest_inside(outer, &other_m)?.0);
    let mut tip = end;
    for _ in 0..MOST_STEPS {
        let before = tip;
        tip = led_on(outer, other, before, radius_m);
        if (outer.place_m(tip) - outer.place_m(before)).norm() < radius_m {
            break;
        }
    }
    into_lumen(outer, lumen, tip, end, radius_m).filter(|way| chords_m(way) > WIDTH_RADII * radius_m)
}

/// The way within the outer face from one of its voxels towards another, to the first place in the lumen.
pub(super) fn into_lumen(
    outer: &Voxels,
    lumen: &Voxels,
    from: usize,
    towards: usize,
    radius_m: f64,
) -> Option<Vec<Point3<f64>>> {
    let reach = search(outer, from, Some(towards), Pay::Middle { radius_m });
    let mut way =
        reach.way_to(outer, towards).into_iter().map(|index| outer.place_m(index)).collect::<Vec<_>>();
    let is_lumen = |place: &Point3<f64>| lumen.index_of(place).is_some_and(|index| lumen.is_inside(index));
    let entry = way.iter().position(is_lumen).filter(|_| reach.is_reached(towards))?;
    way.truncate(entry + 1);
    Some(way)
}
