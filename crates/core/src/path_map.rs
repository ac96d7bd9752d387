//! A map with a path through it: what a filter may know of the anatomy without knowing the anatomy crate.

use crate::Name;
use nalgebra::Point3;

/// A point projected onto a path.
#[derive(Clone, Debug, PartialEq)]
pub struct PathProjection {
    /// Arc length of the nearest point on the path, m.
    pub arc_length_m: f64,
    /// That point, world frame, m.
    pub point_world_m: Point3<f64>,
    /// Free radius of the lumen there, m.
    pub radius_m: f64,
    /// Distance from the asked point, m.
    pub distance_m: f64,
    /// Segment of the path.
    pub segment: Option<Name>,
}

/// Projects points onto a path. Implemented by tracts; used by map constraints and along-tract errors.
///
/// The map's frame is the world as long as no patient moves; who does carries the path along, and asks in the path's own frame.
pub trait PathMap: Send + Sync {
    /// The nearest `count` local minima of the distance, nearest first (a folded bowel has several).
    fn nearest(&self, point_world_m: &Point3<f64>, count: usize) -> Vec<PathProjection>;
    /// Length of the path, m.
    fn length_m(&self) -> f64;
}
