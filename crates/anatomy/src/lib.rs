//! Anatomy: where the gut runs, how wide it is, what its wall does.
//!
//! A [`Tract`] is a chain of segments from mouth to anus along one [`CentreLine`], with a [`RadiusProfile`]. Tracts come
//! from files ([`tract_file`]): point lists, centre-line CSVs, analytic shapes; and from seeded generators
//! ([`generator`]: a colon, a whole gut) whose lengths, radii and bends match those measured in people
//! ([`statistics`]). Everything is in the *torso* frame: right-handed, RAS+ (x right, y anterior, z superior), metres, arc
//! lengths from the oral end.

pub mod bends;
pub mod centre_line;
pub mod diverticulum;
pub mod error;
pub mod generator;
pub mod import;
pub mod lumen;
pub mod mesh;
pub mod motility;
pub mod motility_config;
mod motility_limits;
pub mod motility_sources;
pub mod phantom;
pub mod pylorus;
pub mod radius;
pub mod segment;
pub mod shape;
mod spline;
pub mod statistics;
#[cfg(test)]
mod test_tracts;
pub mod tract;
pub mod tract_file;

pub use centre_line::{CentreLine, Projection, Station};
pub use error::AnatomyError;
pub use mesh::{TubeMesh, tube_mesh};
pub use radius::RadiusProfile;
pub use segment::{Landmark, Segment, SegmentKey, Wall, WallTable};
pub use tract::{Bridge, End, Overlap, Radii, SegmentPoints, Tract, TractDraft, TractReport};
