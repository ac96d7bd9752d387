//! Tests of the field physics, in one binary.
//!
//! - `reference`: against mpmath and magpylib (`tests/cross/fields_reference.csv`)
//! - `cross`: fixtures of an independent study of the set-up of taddese2018, and closed forms
//! - `derivatives`: every analytic derivative against central differences
//! - `laws`: what every static field obeys, batch and scalar, limits, inputs that make no sense

#[path = "fields/cross.rs"]
mod cross;
#[path = "fields/derivatives.rs"]
mod derivatives;
#[path = "fields/laws.rs"]
mod laws;
#[path = "fields/reference.rs"]
mod reference;

use lumenav_fields::Cylinder;
use nalgebra::Vector3;

/// The permanent magnet of taddese2018 (101.6 mm wide and high, N52).
pub fn permanent_magnet() -> Cylinder {
    Cylinder::magnet(0.0508, 0.1016, 1.48).unwrap()
}

/// The coil of taddese2018 (180 mm wide, 40 mm high, 160 turns, 0.71 A).
pub fn coil() -> Cylinder {
    Cylinder::coil(0.09, 0.04, 160.0, 0.71).unwrap()
}

/// A capsule's magnet, 5 mm wide and 6 mm high.
pub fn capsule_magnet() -> Cylinder {
    Cylinder::magnet(0.0025, 0.006, 1.2938).unwrap()
}

/// A spread of unit vectors (golden spiral), none on a coordinate axis.
pub fn directions(count: usize) -> Vec<Vector3<f64>> {
    (0..count)
        .map(|index| {
            let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
            let turn = 2.399_963_229_728_653 * index as f64 + 0.1;
            let rho = (1.0 - z * z).sqrt();
            Vector3::new(rho * turn.cos(), rho * turn.sin(), z)
        })
        .collect()
}
