//! A torso of voxels around the project's own tract: an elliptic body with lungs, spine and heart as ellipsoids, and the tract's lumen.
//!
//! Size and voxels are those of than2015, section 4.4 (34.5 x 27.5 cm, 4 mm, 150 x 150 x 178); the organs' places are chosen to leave
//! the abdomen to the colon. A voxel is what its middle is. Order: lumen, heart, lungs, spine, soft tissue.

use super::voxels::OUTSIDE;
use super::{Material, MaterialTable, VoxelGrid};
use crate::Tract;
use crate::tract_file::{TractOptions, load};
use lumenav_core::config::quantity::{Finite, Positive};
use lumenav_core::{ConfigError, Node};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// `[phantom]` of kind `torso`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TorsoTable {
    pub(crate) name: String,
    source: String,
    /// File of the tract whose lumen is carved out; absent: none.
    tract: Option<String>,
    /// Left to right, mm.
    width_mm: Positive,
    /// Front to back, mm.
    depth_mm: Positive,
    voxel_mm: Positive,
    /// Voxels along x, y and z; the middle of the grid is the torso's origin.
    voxels: [u32; 3],
    body: MaterialTable,
    /// What fills the lumen; absent: as the body.
    lumen: Option<MaterialTable>,
    /// Organs, first come first served.
    organ: Vec<OrganTable>,
}

/// `[[phantom.organ]]`: an ellipsoid.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct OrganTable {
    centre_mm: [Finite; 3],
    semi_axes_mm: [Positive; 3],
    material: MaterialTable,
}

/// More voxels than this are a typing error (a whole body at 1 mm has 200 million).
pub(super) const MAX_VOXELS: usize = 1 << 28;
/// Steps along the centre line, in voxels: balls of the lumen's radius overlap without notches.
const STEP_VOXELS: f64 = 0.25;
/// The largest voxel, mm.
const MAX_VOXEL_MM: f64 = 100.0;

impl TorsoTable {
    pub(crate) fn grid(&self, node: &Node) -> Result<VoxelGrid, ConfigError> {
        let size = self.voxels.map(|n| n as usize);
        let count = size.iter().try_fold(1_usize, |n, s| n.checked_mul(*s)).filter(|n| *n <= MAX_VOXELS);
        if count.is_none_or(|n| n == 0) || self.voxel_mm.0 > MAX_VOXEL_MM {
            let message = format!("allowed: 1 to {MAX_VOXELS} voxels of at most {MAX_VOXEL_MM} mm");
            return Err(node.error_at("voxels", &message));
        }
        let step_m = 1e-3 * self.voxel_mm.0;
        let corner = -0.5 * step_m * Vector3::from(size.map(|n| n as f64));
        let mut materials: Vec<Material> = vec![self.body.material()];
        materials.extend(self.lumen.iter().map(MaterialTable::material));
        let first_organ = materials.len();
        materials.extend(self.organ.iter().map(|organ| organ.material.material()));
        if materials.len() >= usize::from(OUTSIDE) {
            return Err(node.error_at("organ", "allowed: at most 250 organs"));
        }
        let mut voxels = vec![OUTSIDE; count.unwrap_or_default()];
        let semi = Vector3::new(0.5e-3 * self.width_mm.0, 0.5e-3 * self.depth_mm.0, f64::INFINITY);
        let mut n = 0;
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let middle =
                        corner + step_m * Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5);
                    if is_in(&middle, &semi) {
                        let organ = self.organ.iter().position(|organ| organ.holds(&middle));
                        voxels[n] = organ.map_or(0, |o| (first_organ + o) as u8);
                    }
                    n += 1;
                }
            }
        }
        if let Some(tract) = &self.tract {
            let file = Node::open(&node.existing_path("tract", tract)?)?.with_log_of(node);
            let (tract, _) = load(&file, &TractOptions::default())?;
            let filling = u8::from(self.lumen.is_some());
            carve(&tract, size, &corner, step_m, &mut voxels, filling)
                .map_err(|message| node.error_at("tract", &message))?;
        }
        VoxelGrid::new(size, &Matrix3::from_diagonal_element(step_m), &corner, materials, voxels)
            .map_err(|error| node.error(&error.to_string()))
    }
}

impl OrganTable {
    fn holds(&self, place_m: &Vector3<f64>) -> bool {
        let from_centre = place_m - Vector3::from(self.centre_mm.map(|v| v.0 * 1e-3));
        is_in(&from_centre, &Vector3::from(self.semi_axes_mm.map(|v| v.0 * 1e-3)))
    }
}

fn is_in(from_centre_m: &Vector3<f64>, semi_axes_m: &Vector3<f64>) -> bool {
    from_centre_m.component_div(semi_axes_m).norm_squared() <= 1.0
}

/// Fills the lumen: balls of the resting radius along the centre line.
fn carve(
    tract: &Tract,
    size: [usize; 3],
    corner: &Vector3<f64>,
    step_m: f64,
    voxels: &mut [u8],
    filling: u8,
) -> Result<(), String> {
    let stations = (tract.length_m() / (STEP_VOXELS * step_m)).ceil().max(1.0) as usize;
    for s in 0..=stations {
        let arc_length_m = tract.length_m() * s as f64 / stations as f64;
        let centre = tract.station(arc_length_m).position_m.coords;
        let radius_m = tract.radii(arc_length_m).resting_m;
        let range = |axis: usize| {
            let at = |end: f64| (centre[axis] + end - corner[axis]) / step_m;
            let low = at(-radius_m).floor().max(0.0) as usize;
            low..(at(radius_m).ceil().max(0.0) as usize).min(size[axis])
        };
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let middle =
                        corner + step_m * Vector3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5);
                    if (middle - centre).norm_squared() > radius_m * radius_m {
                        continue;
                    }
                    let voxel = &mut voxels[(k * size[1] + j) * size[0] + i];
                    if *voxel == OUTSIDE {
                        return Err(format!(
                            "the lumen leaves the body {arc_length_m:.3} m along the tract, at {:.0}, {:.0}, {:.0} mm",
                            middle.x * 1e3,
                            middle.y * 1e3,
                            middle.z * 1e3
                        ));
                    }
                    *voxel = filling;
                }
            }
        }
    }
    Ok(())
}
