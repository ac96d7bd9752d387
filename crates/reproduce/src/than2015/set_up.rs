//! Scanners, phantoms and markers of than2015, from the models folder.

use super::published::{MEASURED_ACTIVITIES_MBQ, MEASURED_CORE_MM, MEASURED_SIDES_MM};
use crate::ReproduceError;
use lumenav_anatomy::phantom::{EllipticCylinder, Material, Phantom};
use lumenav_core::{ModelFolder, Node};
use lumenav_pet::{MarkerSet, Scanner};
use nalgebra::Vector3;

/// A scanner of `models/scanners`.
///
/// # Errors
/// A file that is not there or not right.
pub fn scanner(models: &ModelFolder, name: &str) -> Result<Scanner, ReproduceError> {
    let node = Node::open(&models.root().join("scanners").join(format!("{name}.toml")))?;
    Ok(Scanner::from_node(&node)?)
}

/// A phantom of `models/phantoms`.
///
/// # Errors
/// A file that is not there or not right.
pub fn phantom(models: &ModelFolder, name: &str) -> Result<Phantom, ReproduceError> {
    let node = Node::open(&models.root().join("phantoms").join(format!("{name}.toml")))?;
    Ok(Phantom::from_node(&node)?)
}

/// The markers of the simulations: `models/capsules/pet-triangle.toml`, sides of 10, 13 and 13 mm.
///
/// # Errors
/// A file that is not there or not right.
pub fn markers(models: &ModelFolder) -> Result<MarkerSet, ReproduceError> {
    let node = Node::open(&models.root().join("capsules").join("pet-triangle.toml"))?;
    Ok(MarkerSet::from_capsule(&node, "than2015", 3)?)
}

/// The markers of the experiments as measured: the base as in the simulations but 10.57 mm long, the apex where its two sides
/// reach, activities and cores as stated.
pub fn measured_markers(nominal: &MarkerSet) -> MarkerSet {
    let [base_m, to_first_m, to_second_m] = MEASURED_SIDES_MM.map(|side| side * 1e-3);
    // Base from (0, b/2) to (0, -b/2): |apex - first|² - |apex - second|² = -2 b y.
    let y = (to_second_m * to_second_m - to_first_m * to_first_m) / (2.0 * base_m);
    let x = -(to_first_m * to_first_m - (y - 0.5 * base_m).powi(2)).sqrt();
    let places = [Vector3::new(x, y, 0.0), Vector3::y() * 0.5 * base_m, Vector3::y() * -0.5 * base_m];
    let mut set = nominal.clone();
    for ((marker, place), activity) in set.markers.iter_mut().zip(places).zip(MEASURED_ACTIVITIES_MBQ) {
        marker.position_capsule_m = place;
        marker.activity_bq = activity * 1e6;
        marker.core_diameter_m = MEASURED_CORE_MM * 1e-3;
    }
    set
}

/// The Jaszczak cylinder of the experiments: water of 216 mm diameter and 186 mm length, with the attenuation of `water`.
pub fn jaszczak(water: &Phantom) -> Phantom {
    let cylinder = EllipticCylinder {
        centre_m: Vector3::zeros(),
        semi_axis_x_m: 0.108,
        semi_axis_y_m: 0.108,
        half_length_m: 0.093,
    };
    let attenuation_511_per_m = water.largest_attenuation_511_per_m();
    Phantom::cylinder("jaszczak", cylinder, Material { name: "water".to_owned(), attenuation_511_per_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn models() -> ModelFolder {
        ModelFolder::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models"))
    }

    #[test]
    fn published_triangles_have_their_sides() {
        let sides = |set: &MarkerSet| {
            let p = set.positions_capsule_m();
            [p[1] - p[2], p[0] - p[1], p[0] - p[2]].map(|side| side.norm() * 1e3)
        };
        let nominal = markers(&models()).unwrap();
        let measured = measured_markers(&nominal);
        for (set, wanted) in [(&nominal, [10.0, 13.0, 13.0]), (&measured, MEASURED_SIDES_MM)] {
            assert!(sides(set).iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{:?}", sides(set));
        }
        // The apex is behind, as in the simulations.
        assert!(measured.positions_capsule_m()[0].x < -0.01);
        assert!((measured.total_activity_bq() - 4.55e6).abs() < 1.0);
    }

    #[test]
    fn law_all_that_than2015_needs_is_in_the_models_folder() {
        for name in ["allegro", "tf64", "reduced"] {
            scanner(&models(), name).unwrap();
        }
        for row in super::super::published::RATES {
            let phantom = phantom(&models(), row.phantom).unwrap();
            let out = phantom.chord_m(&Vector3::zeros(), &Vector3::x()).unwrap();
            assert!((out.1 - 0.005 * row.diameter_cm).abs() < 1e-12);
        }
        let error = scanner(&models(), "alegro").unwrap_err().to_string();
        assert!(error.contains("alegro.toml"), "{error}");
    }
}
