//! What counts as an error and as a failure.
//!
//! Error of a marker: distance from where it really was in the middle of the window. Only the two base markers may be exchanged, and
//! only together: they are alike, while matching by the best of all permutations would hide a capsule that is seen the wrong way
//! round. A window *fails* where a marker is more than 3 mm off (chapter 4) or 5 mm (chapter 6), or where the tracker's own check
//! refuses it (section 5.5.1: share of a marker below 0.01, sides outside 7 to 16 mm). All three are counted. A window without a
//! pose fails by each of them, and the last pose stands for it in the means: that is what whoever watches would see.

use lumenav_evaluation::summary::Quantiles;
use nalgebra::{Isometry3, Vector3};

/// Failure of chapter 4, m.
pub const FAILED_3_MM_M: f64 = 3e-3;
/// Failure of chapter 6, m.
pub const FAILED_5_MM_M: f64 = 5e-3;
/// Sides that section 5.5.1 allows, m.
pub const SIDES_M: [f64; 2] = [7e-3, 16e-3];
/// Share of a marker that section 5.5.1 asks for.
pub const LEAST_SHARE: f64 = 0.01;

/// Errors of one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowError {
    /// Distance of each marker from its true place, m: apex, base, base.
    pub markers_m: [f64; 3],
    /// Error of each marker along x, y and z, m.
    pub axes_m: [Vector3<f64>; 3],
    /// Angle between the orientation vectors (middle of the base to the apex), rad.
    pub orientation_rad: f64,
    /// Distance of the markers' centroids, m.
    pub centroid_m: f64,
}

impl WindowError {
    /// Compares places of markers, m: apex, base, base.
    pub fn between(estimate_m: &[Vector3<f64>; 3], truth_m: &[Vector3<f64>; 3]) -> Self {
        let straight = [0, 1, 2].map(|i| estimate_m[i] - truth_m[i]);
        let exchanged = [estimate_m[0] - truth_m[0], estimate_m[2] - truth_m[1], estimate_m[1] - truth_m[2]];
        let squares = |errors: &[Vector3<f64>; 3]| errors.iter().map(Vector3::norm_squared).sum::<f64>();
        let axes_m = if squares(&exchanged) < squares(&straight) { exchanged } else { straight };
        let pointing = |places: &[Vector3<f64>; 3]| places[0] - (places[1] + places[2]) * 0.5;
        let (a, b) = (pointing(estimate_m), pointing(truth_m));
        Self {
            markers_m: axes_m.map(|e| e.norm()),
            axes_m,
            // Accurate for small angles, where the cosine is not.
            orientation_rad: a.cross(&b).norm().atan2(a.dot(&b)),
            centroid_m: axes_m.iter().sum::<Vector3<f64>>().norm() / 3.0,
        }
    }

    /// The marker that is furthest off, m.
    pub fn worst_m(&self) -> f64 {
        self.markers_m.iter().copied().fold(0.0, f64::max)
    }
}

/// Where a pose puts markers.
pub fn placed(
    world_from_capsule: &Isometry3<f64>,
    markers_capsule_m: &[Vector3<f64>; 3],
) -> [Vector3<f64>; 3] {
    markers_capsule_m.map(|marker| world_from_capsule * nalgebra::Point3::from(marker)).map(|p| p.coords)
}

/// Whether section 5.5.1 lets a triangle and its shares pass.
pub fn passes_geometry_check(markers_m: &[Vector3<f64>; 3], shares: &[f64]) -> bool {
    let sides = [(0, 1), (0, 2), (1, 2)].map(|(i, j): (usize, usize)| (markers_m[i] - markers_m[j]).norm());
    sides.iter().all(|side| (SIDES_M[0]..=SIDES_M[1]).contains(side))
        && shares.iter().all(|s| *s >= LEAST_SHARE)
}

/// Collects the windows of a run.
#[derive(Clone, Debug, Default)]
pub struct Score {
    all: Quantiles,
    markers: [Quantiles; 3],
    across: Quantiles,
    axial: Quantiles,
    orientation: Quantiles,
    centroid: Quantiles,
    sum_m: f64,
    sum_of_squares_m2: f64,
    /// Windows.
    pub windows: usize,
    /// Windows without a pose.
    pub without_pose: usize,
    /// Windows before the first pose, without one themselves.
    pub before_first_pose: usize,
    /// Windows of the start whose pose came with a later window.
    pub answered_late: usize,
    /// Windows with a marker more than 3 mm off, or without a pose.
    pub failed_3_mm: usize,
    /// Windows with a marker more than 5 mm off, or without a pose.
    pub failed_5_mm: usize,
    /// Windows that fail section 5.5.1, or without a pose.
    pub failed_check: usize,
    /// Worst marker of each window, m, in order; infinite before the first pose.
    pub worst_m: Vec<f64>,
    last: Option<[Vector3<f64>; 3]>,
}

impl Score {
    /// A window: the tracker's markers and shares (`None`: it gave no pose), and the true places.
    pub fn push(&mut self, tracked: Option<(&[Vector3<f64>; 3], &[f64])>, truth_m: &[Vector3<f64>; 3]) {
        self.windows += 1;
        let fresh = tracked.is_some();
        if let Some((markers, shares)) = tracked {
            self.last = Some(*markers);
            self.failed_check += usize::from(!passes_geometry_check(markers, shares));
        } else {
            self.without_pose += 1;
            self.failed_check += 1;
        }
        let Some(markers) = self.last else {
            // No pose so far: nothing to average, but not forgotten either.
            self.before_first_pose += 1;
            self.failed_3_mm += 1;
            self.failed_5_mm += 1;
            self.worst_m.push(f64::INFINITY);
            return;
        };
        let error = WindowError::between(&markers, truth_m);
        let beyond = |limit_m: f64| usize::from(!fresh || error.worst_m() > limit_m);
        self.failed_3_mm += beyond(FAILED_3_MM_M);
        self.failed_5_mm += beyond(FAILED_5_MM_M);
        self.worst_m.push(error.worst_m());
        self.orientation.push(error.orientation_rad);
        self.centroid.push(error.centroid_m);
        for (i, distance) in error.markers_m.iter().enumerate() {
            self.all.push(*distance);
            self.markers[i].push(*distance);
            self.sum_m += distance;
            self.sum_of_squares_m2 += distance * distance;
            self.across.push(error.axes_m[i].x.abs());
            self.across.push(error.axes_m[i].y.abs());
            self.axial.push(error.axes_m[i].z.abs());
        }
    }

    /// Mean error over windows and markers, mm; NaN without a pose.
    pub fn mean_mm(&self) -> f64 {
        mean(&self.all) * 1e3
    }

    /// Standard deviation of the error over windows and markers, mm.
    pub fn sd_mm(&self) -> f64 {
        let n = self.all.count() as f64;
        let mean = self.sum_m / n;
        ((self.sum_of_squares_m2 / n - mean * mean).max(0.0) * n / (n - 1.0)).sqrt() * 1e3
    }

    /// Mean error of each marker, mm.
    pub fn markers_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|i| mean(&self.markers[i]) * 1e3)
    }

    /// Mean absolute error along x and y, mm.
    pub fn across_mm(&self) -> f64 {
        mean(&self.across) * 1e3
    }

    /// Mean absolute error along z, mm.
    pub fn axial_mm(&self) -> f64 {
        mean(&self.axial) * 1e3
    }

    /// Mean error of the orientation vector, degrees.
    pub fn orientation_deg(&self) -> f64 {
        mean(&self.orientation).to_degrees()
    }

    /// Mean error of the markers' centroid, mm.
    pub fn centroid_mm(&self) -> f64 {
        mean(&self.centroid) * 1e3
    }
}

fn mean(values: &Quantiles) -> f64 {
    values.mean().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [Vector3<f64>; 3] =
        [Vector3::new(-0.012, 0.0, 0.0), Vector3::new(0.0, 0.005, 0.0), Vector3::new(0.0, -0.005, 0.0)];

    #[test]
    fn closed_form_exchanged_base_is_no_error_but_an_exchanged_apex_is() {
        let [apex, left, right] = TRIANGLE;
        let error = WindowError::between(&[apex, right, left], &TRIANGLE);
        assert_eq!((error.worst_m(), error.orientation_rad), (0.0, 0.0));
        // The apex seen as a base marker: the best permutation would hide it.
        let error = WindowError::between(&[left, apex, right], &TRIANGLE);
        assert!((error.worst_m() - 0.013).abs() < 1e-12, "{error:?}");
        let moved = TRIANGLE.map(|p| p + Vector3::new(0.003, 0.0, 0.004));
        let error = WindowError::between(&moved, &TRIANGLE);
        assert!(error.markers_m.iter().all(|e| (e - 0.005).abs() < 1e-12));
        assert!((error.centroid_m - 0.005).abs() < 1e-12 && error.orientation_rad < 1e-12);
        let turned = TRIANGLE.map(|p| nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), 0.1) * p);
        assert!((WindowError::between(&turned, &TRIANGLE).orientation_rad - 0.1).abs() < 1e-12);
    }

    #[test]
    fn closed_form_windows_without_a_pose_fail_and_keep_the_last_pose() {
        let shares = [0.3, 0.3, 0.4];
        let shifted = |by_m: f64| TRIANGLE.map(|p| p + Vector3::x() * by_m);
        let mut score = Score::default();
        score.push(None, &TRIANGLE);
        assert!(score.mean_mm().is_nan());
        score.push(Some((&shifted(0.001), &shares)), &TRIANGLE);
        score.push(None, &TRIANGLE);
        score.push(Some((&shifted(0.004), &shares)), &TRIANGLE);
        score.push(Some((&TRIANGLE, &[0.005, 0.5, 0.495])), &TRIANGLE);
        assert_eq!((score.windows, score.without_pose, score.before_first_pose), (5, 2, 1));
        assert_eq!((score.failed_3_mm, score.failed_5_mm, score.failed_check), (3, 2, 3));
        assert!((score.mean_mm() - 1.5).abs() < 1e-12, "{}", score.mean_mm());
        // Four windows of three equal errors 1, 1, 4, 0: variance 12/11 times their own.
        assert!((score.sd_mm() - (2.25_f64 * 12.0 / 11.0).sqrt()).abs() < 1e-9, "{}", score.sd_mm());
        assert!((score.across_mm() - 0.75).abs() < 1e-12 && score.axial_mm() == 0.0);
        assert_eq!(score.worst_m.len(), 5);
        assert!(!passes_geometry_check(&TRIANGLE.map(|p| p * 0.6), &shares));
    }
}
