//! Time of flight of sound from a beacon to the capsule, without any trait.
//!
//! ```text
//! t = |p - b|/c        ∂t/∂p = (p - b)ᵀ/(c |p - b|)        ∂t/∂s = -t/(1 + s)  for c = c₀ (1 + s)
//! ```
//!
//! c₀ = 1540 m/s, the mean of soft tissue (F. A. Duck, "Physical properties of tissue", 1990, table 4.1); fat is 7 % slower,
//! which is why s is estimated. Neglected: refraction, gas in the bowel (it blocks a beacon: a lost channel), multipath.
//! Unobservable: attitude.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Mean speed of sound of soft tissue, m/s.
pub const SOUND_M_S: f64 = 1540.0;

/// Time of flight from a beacon, s; `speed_ratio` is s above.
pub fn time_of_flight_s(position_m: &Vector3<f64>, beacon_m: &Vector3<f64>, speed_ratio: f64) -> f64 {
    (position_m - beacon_m).norm() / (SOUND_M_S * (1.0 + speed_ratio))
}

/// `∂t/∂p` (s/m) and `∂t/∂s` (s).
pub fn derivatives(
    position_m: &Vector3<f64>,
    beacon_m: &Vector3<f64>,
    speed_ratio: f64,
) -> (Vector3<f64>, f64) {
    let difference = position_m - beacon_m;
    let speed_m_s = SOUND_M_S * (1.0 + speed_ratio);
    // At a beacon itself the direction is undefined; no direction is as good as any.
    let direction = difference.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    (direction / speed_m_s, -difference.norm() / (speed_m_s * (1.0 + speed_ratio)))
}

/// Position (world, m) and its covariance (m²) from times of flight at s = 0: differences of squared ranges are linear in p, three
/// Gauss-Newton steps polish. `None` for fewer than four beacons or a flat arrangement.
pub fn locate(seen: &[(Vector3<f64>, f64)], sigma_s: f64) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let ((first, first_s), others) = seen.split_first()?;
    if others.len() < 3 {
        return None;
    }
    let square = |time_s: f64| (SOUND_M_S * time_s).powi(2);
    let mut rows = DMatrix::zeros(others.len(), 3);
    let mut right = DVector::zeros(others.len());
    for (i, (beacon, time_s)) in others.iter().enumerate() {
        rows.set_row(i, &((beacon - first) * 2.0).transpose());
        right[i] = square(*first_s) - square(*time_s) + beacon.norm_squared() - first.norm_squared();
    }
    let decomposed = rows.svd(true, true);
    // Flatter than one part in a hundred: the height over the beacons' plane would be a guess.
    if decomposed.singular_values.min() < 1e-2 * decomposed.singular_values.max() {
        return None;
    }
    let solved = decomposed.solve(&right, 0.0).ok()?;
    let mut position = Vector3::new(solved[0], solved[1], solved[2]);
    let mut inverse = Matrix3::zeros();
    for _ in 0..3 {
        let (mut information, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        for (beacon, time_s) in seen {
            let (by_position, _) = derivatives(&position, beacon, 0.0);
            information += by_position * by_position.transpose();
            gradient += by_position * (time_s - time_of_flight_s(&position, beacon, 0.0));
        }
        inverse = information.try_inverse()?;
        position += inverse * gradient;
    }
    position.iter().all(|v| v.is_finite()).then(|| (position, inverse * sigma_s.powi(2)))
}
