//! The smallest activity for a wanted rate of poses (than2015, section 3.6): `A_min = 1.85 MBq (f / 20 Hz) (210 / n(d))`, with n(d) the
//! lines of a 50 ms window in a body of diameter d, a cubic through table 4.2.

use nalgebra::{Matrix5x4, Vector4, Vector5};

/// Geometries of than2015, table 4.2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Geometry {
    /// The full ring of 28 blocks.
    FullRing,
    /// Two pairs of blocks.
    Reduced,
}

/// Diameters of the table's cylinders, m.
const DIAMETERS_M: [f64; 5] = [0.20, 0.25, 0.30, 0.35, 0.40];
/// Lines per run of 50 ms with three markers of 1.85 MBq, table 4.2.
const FULL_RING_LINES: [f64; 5] = [2410.0, 1593.0, 1067.0, 722.0, 492.0];
/// As above.
const REDUCED_LINES: [f64; 5] = [284.0, 183.0, 120.0, 80.0, 54.0];
/// Activity of one marker in the table, Bq.
const TABLE_ACTIVITY_BQ: f64 = 1.85e6;
/// Poses per second in the table.
const TABLE_RATE_HZ: f64 = 20.0;
/// Lines that one pose takes (than2015, chapter 4).
pub const LINES_PER_POSE: f64 = 210.0;

/// Lines of a 50 ms window in a body of a diameter: the least-squares cubic through the table; `None` outside its 20 to 40 cm.
pub fn lines_per_window(geometry: Geometry, diameter_m: f64) -> Option<f64> {
    if !(DIAMETERS_M[0]..=DIAMETERS_M[4]).contains(&diameter_m) {
        return None;
    }
    let lines = match geometry {
        Geometry::FullRing => FULL_RING_LINES,
        Geometry::Reduced => REDUCED_LINES,
    };
    // In steps of 5 cm from the middle, so that the four powers are of one size.
    let step = |d: f64| (d - DIAMETERS_M[2]) / 0.05;
    let powers = |x: f64| Vector4::new(1.0, x, x * x, x * x * x);
    let rows = Matrix5x4::from_fn(|r, c| powers(step(DIAMETERS_M[r]))[c]);
    let normal = (rows.transpose() * rows).cholesky()?;
    let cubic = normal.solve(&(rows.transpose() * Vector5::from(lines)));
    Some(cubic.dot(&powers(step(diameter_m))))
}

/// Smallest activity of each of three markers for so many poses per second, Bq; `None` outside the table's diameters.
///
/// Linear in the rate: at a lower activity the share of random lines is smaller still.
pub fn smallest_activity_bq(geometry: Geometry, diameter_m: f64, rate_hz: f64) -> Option<f64> {
    let lines = lines_per_window(geometry, diameter_m)?;
    Some(TABLE_ACTIVITY_BQ * (rate_hz / TABLE_RATE_HZ) * (LINES_PER_POSE / lines))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_table_is_met_by_its_cubic() {
        for (geometry, lines) in [(Geometry::FullRing, FULL_RING_LINES), (Geometry::Reduced, REDUCED_LINES)] {
            for (diameter, lines) in DIAMETERS_M.iter().zip(lines) {
                let ours = lines_per_window(geometry, *diameter).unwrap();
                assert!((ours / lines - 1.0).abs() < 0.02, "{geometry:?} {diameter}: {ours} {lines}");
            }
            assert!(lines_per_window(geometry, 0.19).is_none() && lines_per_window(geometry, 0.41).is_none());
            assert!(lines_per_window(geometry, f64::NAN).is_none());
        }
    }

    #[test]
    fn closed_form_activity_follows_rate_and_lines() {
        let at = |d: f64, hz: f64| smallest_activity_bq(Geometry::FullRing, d, hz).unwrap();
        assert!((at(0.20, 20.0) / (1.85e6 * 210.0 / 2410.0) - 1.0).abs() < 0.02);
        assert!((at(0.40, 20.0) / (1.85e6 * 210.0 / 492.0) - 1.0).abs() < 0.02);
        assert!((at(0.30, 40.0) / at(0.30, 20.0) - 2.0).abs() < 1e-12);
        assert!(at(0.21, 20.0) < at(0.22, 20.0));
    }
}
