//! What a photon meets on its way: bodies of tissue, as plain shapes or voxels.
//!
//! A [`Phantom`] tells the material at a place and how far a ray runs in it. Each [`Material`] has a linear attenuation coefficient
//! at 511 keV; at the energies that pass a PET scanner's window attenuation in tissue is Compton scattering alone, so whoever
//! transports photons scales it by the Klein-Nishina cross section. Voxels come from label images ([`image`]: NIfTI, MetaImage,
//! Interfile) or from the project's own [`torso`]. Frame: the torso's, which stands in the world unless a bed or
//! a patient moves it.

pub mod image;
pub mod torso;
pub mod voxels;

pub use voxels::VoxelGrid;

use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::{ConfigError, Node};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// `[phantom]` of a file in `models/phantoms`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum PhantomTable {
    /// A right cylinder along z.
    Cylinder {
        name: String,
        source: String,
        #[serde(default)]
        centre_mm: [Finite; 3],
        diameter_mm: Positive,
        length_mm: Positive,
        material: MaterialTable,
    },
    /// A right cylinder along z with an elliptic base.
    EllipticCylinder {
        name: String,
        source: String,
        #[serde(default)]
        centre_mm: [Finite; 3],
        width_mm: Positive,
        depth_mm: Positive,
        length_mm: Positive,
        material: MaterialTable,
    },
    /// A label image, and what its labels are.
    Voxels(image::VoxelsTable),
    /// An elliptic body with lungs, spine, heart and the lumen of a tract.
    Torso(torso::TorsoTable),
}

/// `material` of a phantom.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MaterialTable {
    name: String,
    attenuation_511_per_cm: NonNegative,
}

impl MaterialTable {
    pub(crate) fn material(&self) -> Material {
        Material { name: self.name.clone(), attenuation_511_per_m: self.attenuation_511_per_cm.0 * 100.0 }
    }
}

/// A tissue or a filling.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name.
    pub name: String,
    /// Linear attenuation coefficient at 511 keV, 1/m.
    pub attenuation_511_per_m: f64,
}

/// A body without holes of one material: a right cylinder along z with an elliptic base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipticCylinder {
    /// Centre, m.
    pub centre_m: Vector3<f64>,
    /// Half the width along x, m.
    pub semi_axis_x_m: f64,
    /// Half the width along y, m.
    pub semi_axis_y_m: f64,
    /// Half the length along z, m.
    pub half_length_m: f64,
}

impl EllipticCylinder {
    /// Whether a place lies inside.
    pub fn contains(&self, place_m: &Vector3<f64>) -> bool {
        let p = place_m - self.centre_m;
        let (x, y) = (p.x / self.semi_axis_x_m, p.y / self.semi_axis_y_m);
        p.z.abs() <= self.half_length_m && x * x + y * y <= 1.0
    }

    /// Entry and exit of a ray as distances along the unit vector `direction`, m; `None` where it misses. The entry is negative for
    /// a ray that starts inside.
    pub fn chord_m(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64)> {
        let p = from_m - self.centre_m;
        // Both sides of the ellipse's equation times the squares of the axes: no division.
        let (x, y) = (self.semi_axis_x_m * self.semi_axis_x_m, self.semi_axis_y_m * self.semi_axis_y_m);
        let a = y * direction.x * direction.x + x * direction.y * direction.y;
        let b = y * p.x * direction.x + x * p.y * direction.y;
        let c = y * p.x * p.x + x * p.y * p.y - x * y;
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        if a > 0.0 {
            // What is not a number misses.
            let square = (b * b - a * c).max(-1.0);
            if square < 0.0 {
                return None;
            }
            let (root, inverse) = (square.sqrt(), 1.0 / a);
            (near, far) = ((-b - root) * inverse, (-b + root) * inverse);
        } else if c > 0.0 {
            return None;
        }
        if direction.z == 0.0 {
            if p.z.abs() > self.half_length_m {
                return None;
            }
        } else {
            let inverse = 1.0 / direction.z;
            let (middle, half) = (-p.z * inverse, self.half_length_m * inverse.abs());
            near = near.max(middle - half);
            far = far.min(middle + half);
        }
        (near < far).then_some((near, far))
    }

    /// A cylinder all of whose places lie at least so deep in this one, m; `None` where none does.
    fn shrunk(&self, by_m: f64) -> Option<Self> {
        let share = 1.0 - by_m / self.semi_axis_x_m.min(self.semi_axis_y_m);
        let half_length_m = self.half_length_m - by_m;
        (share > 0.0 && half_length_m > 0.0).then_some(Self {
            semi_axis_x_m: share * self.semi_axis_x_m,
            semi_axis_y_m: share * self.semi_axis_y_m,
            half_length_m,
            ..*self
        })
    }
}

/// A body that photons cross.
#[derive(Clone, Debug, PartialEq)]
pub struct Phantom {
    /// Its name.
    pub name: String,
    shape: Shape,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Cylinder(EllipticCylinder, Material),
    Voxels(Arc<VoxelGrid>),
}

/// No phantom is larger than this, m.
const MAX_SIZE_M: f64 = 10.0;

impl Phantom {
    /// Reads a phantom's file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line and key.
    pub fn from_node(file: &Node) -> Result<Self, ConfigError> {
        let node = file.child_or_empty("phantom");
        let table: PhantomTable = node.parse()?;
        let (name, centre_mm, semi_axes_mm, length_mm, material) = match &table {
            PhantomTable::Cylinder { name, centre_mm, diameter_mm, length_mm, material, .. } => {
                (name, centre_mm, [0.5 * diameter_mm.0; 2], length_mm, material)
            }
            PhantomTable::EllipticCylinder {
                name,
                centre_mm,
                width_mm,
                depth_mm,
                length_mm,
                material,
                ..
            } => (name, centre_mm, [0.5 * width_mm.0, 0.5 * depth_mm.0], length_mm, material),
            PhantomTable::Voxels(table) => return Ok(Self::voxels(&table.name, table.grid(&node)?)),
            PhantomTable::Torso(table) => return Ok(Self::voxels(&table.name, table.grid(&node)?)),
        };
        let cylinder = EllipticCylinder {
            centre_m: Vector3::from(centre_mm.map(|v| v.0)) * 1e-3,
            semi_axis_x_m: semi_axes_mm[0] * 1e-3,
            semi_axis_y_m: semi_axes_mm[1] * 1e-3,
            half_length_m: 0.5e-3 * length_mm.0,
        };
        let sizes = [
            cylinder.semi_axis_x_m,
            cylinder.semi_axis_y_m,
            cylinder.half_length_m,
            cylinder.centre_m.amax(),
        ];
        if sizes.iter().any(|v| *v > MAX_SIZE_M) {
            return Err(node.error(&format!("a phantom of more than {MAX_SIZE_M} m")));
        }
        Ok(Self::cylinder(name, cylinder, material.material()))
    }

    /// A phantom of one cylinder.
    pub fn cylinder(name: &str, cylinder: EllipticCylinder, material: Material) -> Self {
        Self { name: name.to_owned(), shape: Shape::Cylinder(cylinder, material) }
    }

    /// A phantom of voxels.
    pub fn voxels(name: &str, grid: VoxelGrid) -> Self {
        Self { name: name.to_owned(), shape: Shape::Voxels(Arc::new(grid)) }
    }

    /// Its voxels, where it is made of voxels.
    pub fn grid(&self) -> Option<&VoxelGrid> {
        match &self.shape {
            Shape::Voxels(grid) => Some(grid),
            Shape::Cylinder(..) => None,
        }
    }

    /// Material at a place; `None` outside.
    pub fn material_at(&self, place_m: &Vector3<f64>) -> Option<&Material> {
        match &self.shape {
            Shape::Cylinder(cylinder, material) => cylinder.contains(place_m).then_some(material),
            Shape::Voxels(grid) => grid.material_at(place_m),
        }
    }

    /// Attenuation coefficient at 511 keV at a place, 1/m; 0 outside.
    pub fn attenuation_511_per_m(&self, place_m: &Vector3<f64>) -> f64 {
        self.material_at(place_m).map_or(0.0, |m| m.attenuation_511_per_m)
    }

    /// The largest attenuation coefficient at 511 keV anywhere in it, 1/m (the majorant of Woodcock's tracking).
    pub fn largest_attenuation_511_per_m(&self) -> f64 {
        match &self.shape {
            Shape::Cylinder(_, material) => material.attenuation_511_per_m,
            Shape::Voxels(grid) => grid.largest_attenuation_511_per_m(),
        }
    }

    /// The one attenuation coefficient of a phantom of one material, 1/m: photons need no rejection there.
    pub fn uniform_attenuation_511_per_m(&self) -> Option<f64> {
        match &self.shape {
            Shape::Cylinder(_, material) => Some(material.attenuation_511_per_m),
            Shape::Voxels(_) => None,
        }
    }

    /// Entry and exit of a ray through its hull as distances along the unit vector `direction`, m; see [`EllipticCylinder::chord_m`].
    pub fn chord_m(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64)> {
        match &self.shape {
            Shape::Cylinder(cylinder, _) => cylinder.chord_m(from_m, direction),
            Shape::Voxels(grid) => grid.chord_m(from_m, direction),
        }
    }

    /// `∫ μ(511 keV) dl` from a place outwards along the unit vector `direction`, dimensionless.
    pub fn optical_depth_511(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
        match &self.shape {
            Shape::Cylinder(cylinder, material) => {
                let inside_m = cylinder
                    .chord_m(from_m, direction)
                    .map_or(0.0, |(near, far)| far.max(0.0) - near.max(0.0));
                inside_m * material.attenuation_511_per_m
            }
            Shape::Voxels(grid) => grid.optical_depth_511(from_m, direction),
        }
    }

    /// No way to a place from anywhere within a distance of another has a smaller optical depth at 511 keV, dimensionless. (0, which
    /// is true of anything, for voxels.)
    ///
    /// A point of such a way lies within the distance of the point of the middle one that divides it alike: where that is so deep in the
    /// body, this one is in it.
    pub fn least_optical_depth_511(&self, from_m: &Vector3<f64>, to_m: &Vector3<f64>, within_m: f64) -> f64 {
        let Shape::Cylinder(cylinder, material) = &self.shape else { return 0.0 };
        let way = to_m - from_m;
        let distance_m = way.norm();
        let Some(deep) = cylinder.shrunk(within_m).filter(|_| distance_m > within_m) else { return 0.0 };
        let inside_m = deep
            .chord_m(from_m, &(way / distance_m))
            .map_or(0.0, |(near, far)| far.clamp(0.0, distance_m) - near.max(0.0));
        inside_m.max(0.0) * (1.0 - within_m / distance_m) * material.attenuation_511_per_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn water(diameter_m: f64) -> Phantom {
        let cylinder = EllipticCylinder {
            centre_m: Vector3::zeros(),
            semi_axis_x_m: 0.5 * diameter_m,
            semi_axis_y_m: 0.5 * diameter_m,
            half_length_m: 0.1,
        };
        Phantom::cylinder("water", cylinder, Material { name: "water".into(), attenuation_511_per_m: 9.6 })
    }

    /// An elliptic one beside the origin: both ends of every chord lie on its surface, the middle inside.
    #[test]
    fn law_chords_of_an_elliptic_cylinder_end_on_its_surface() {
        let body = elliptic();
        let on_surface = |place: Vector3<f64>| {
            let p = place - body.centre_m;
            let side = (p.x / body.semi_axis_x_m).powi(2) + (p.y / body.semi_axis_y_m).powi(2);
            let end = p.z.abs() / body.half_length_m;
            (side.max(end) - 1.0).abs() < 1e-9
        };
        let (mut hits, mut misses) = (0, 0);
        for k in 0..20_000 {
            let [a, b] = [somewhere(2 * k, 0.3), somewhere(2 * k + 1, 1.0)];
            let (from, direction) = (a + body.centre_m, b.normalize());
            let Some((near, far)) = body.chord_m(&from, &direction) else {
                misses += 1;
                assert!(!body.contains(&from));
                continue;
            };
            hits += 1;
            assert!(on_surface(from + direction * near) && on_surface(from + direction * far));
            assert!(body.contains(&(from + direction * (0.5 * (near + far)))));
        }
        assert!(hits > 3_000 && misses > 3_000, "{hits} {misses}");
    }

    /// No way from near a place has less of the body before it than is said, and little more is said than there is.
    #[test]
    fn law_the_least_optical_depth_is_least() {
        let body = elliptic();
        let phantom =
            Phantom::cylinder("torso", body, Material { name: "water".into(), attenuation_511_per_m: 9.6 });
        let (mut inside, mut tightest) = (0, f64::INFINITY);
        for k in 0..20_000 {
            let from = body.centre_m + somewhere(5 * k, 0.2);
            let to = body.centre_m + somewhere(5 * k + 1, 1.0).normalize() * 0.45;
            let within_m = 0.02 * somewhere(5 * k + 2, 1.0).x.abs();
            let least = phantom.least_optical_depth_511(&from, &to, within_m);
            for i in 0..10 {
                let start = from + somewhere(1_000_000 + 10 * k + i, 1.0).normalize() * within_m;
                let depth = phantom.optical_depth_511(&start, &(to - start).normalize());
                assert!(depth >= least - 1e-12, "{depth} {least} from {from} to {to} within {within_m}");
                tightest = tightest.min(depth - least);
            }
            inside += u32::from(body.contains(&from) && least > 0.0);
        }
        assert!(inside > 5_000 && tightest < 0.02, "{inside} {tightest}");
    }

    fn elliptic() -> EllipticCylinder {
        EllipticCylinder {
            centre_m: Vector3::new(0.03, -0.02, 0.05),
            semi_axis_x_m: 0.17,
            semi_axis_y_m: 0.14,
            half_length_m: 0.2,
        }
    }

    /// Places of a cube, spread evenly (Roberts' sequence of three dimensions).
    fn somewhere(k: u32, half: f64) -> Vector3<f64> {
        let k = f64::from(k);
        Vector3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3)
            .map(|step| half * (2.0 * (0.5 + step * k).fract() - 1.0))
    }

    #[test]
    fn closed_form_chords_of_a_cylinder() {
        let phantom = water(0.2);
        let centre = Vector3::zeros();
        assert!((phantom.optical_depth_511(&centre, &Vector3::x()) - 0.96).abs() < 1e-12);
        assert!((phantom.optical_depth_511(&centre, &Vector3::z()) - 0.96).abs() < 1e-12);
        // From outside the whole chord counts, from behind none of it.
        let outside = Vector3::new(-1.0, 0.06, 0.0);
        assert!((phantom.optical_depth_511(&outside, &Vector3::x()) - 9.6 * 0.16).abs() < 1e-12);
        assert_eq!(phantom.optical_depth_511(&outside, &-Vector3::x()), 0.0);
        // A slanted ray leaves through the flat end.
        let slanted = Vector3::new(0.6, 0.0, 0.8);
        assert!((phantom.optical_depth_511(&centre, &slanted) - 9.6 * 0.125).abs() < 1e-12);
        assert!(phantom.chord_m(&Vector3::new(0.2, 0.0, 0.0), &Vector3::z()).is_none());
    }
}
