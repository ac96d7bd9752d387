//! Checks of a track that need no truth: does it move as matter can, does what rests stay, and do two tracks keep their distance?
//!
//! Recorded data seldom have a reference. Three things are known all the same: how fast a body can move, that what rests is at one place, and,
//! where two sources are fixed to one body, that their distance does not change.
//!
//! ```text
//! speed        v_k = |p_k - p_(k-1)| / (t_k - t_(k-1))                      between estimates that follow each other
//! distance     d_k = |a_k - b_k|                                            at instants for which both tracks have an estimate
//! rest         p_k - median p, axis by axis
//! robust sd    1.4826 · median |d_k - median d|                             the standard deviation of a normal law
//! outliers     |d_k - median d| > 5 · robust sd; of a place, along any axis
//! ```

use crate::summary::{Quantiles, ScalarSummary};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Median absolute deviation of a normal law, inverted.
const SD_PER_MAD: f64 = 1.4826;
/// Beyond so many robust standard deviations a distance is an outlier: one normal value in two million.
pub const OUTLIER_SD: f64 = 5.0;
/// So many steps beyond the limit are listed; the others are counted.
pub const MOST_LISTED: usize = 1000;

/// A step faster than allowed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FastStep {
    /// When it began, s.
    pub from_s: f64,
    /// When it ended, s.
    pub to_s: f64,
    /// Its speed, m/s.
    pub speed_m_s: f64,
}

/// How fast a track moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpeedFigures {
    /// The limit, m/s.
    pub limit_m_s: f64,
    /// Steps between estimates.
    pub steps: usize,
    /// Share of the steps within the limit, 0 to 1.
    pub share_within: f64,
    /// Speeds, m/s.
    pub speed_m_s: ScalarSummary,
    /// The steps beyond the limit, in order, at most [`MOST_LISTED`].
    pub beyond: Vec<FastStep>,
}

/// Collects the speeds between a track's estimates.
#[derive(Debug, Clone)]
pub struct SpeedCheck {
    limit_m_s: f64,
    last: Option<(f64, Vector3<f64>)>,
    speeds: Quantiles,
    within: usize,
    beyond: Vec<FastStep>,
}

impl SpeedCheck {
    /// With a limit, m/s.
    pub fn new(limit_m_s: f64) -> Self {
        Self { limit_m_s, last: None, speeds: Quantiles::new(), within: 0, beyond: Vec::new() }
    }

    /// The next estimate, m; one that is not later than the last is not looked at.
    pub fn push(&mut self, at_s: f64, position_m: Vector3<f64>) {
        if let Some((from_s, from_m)) = self.last {
            if at_s.partial_cmp(&from_s) != Some(std::cmp::Ordering::Greater) {
                return;
            }
            let speed_m_s = (position_m - from_m).norm() / (at_s - from_s);
            self.speeds.push(speed_m_s);
            if speed_m_s <= self.limit_m_s {
                self.within += 1;
            } else if self.beyond.len() < MOST_LISTED {
                self.beyond.push(FastStep { from_s, to_s: at_s, speed_m_s });
            }
        }
        self.last = Some((at_s, position_m));
    }

    /// The figures; `None` before two estimates.
    pub fn figures(&mut self) -> Option<SpeedFigures> {
        let speed_m_s = self.speeds.summary()?;
        let steps = self.speeds.count();
        let share_within = self.within as f64 / steps as f64;
        Some(SpeedFigures {
            limit_m_s: self.limit_m_s,
            steps,
            share_within,
            speed_m_s,
            beyond: self.beyond.clone(),
        })
    }
}

/// How far two tracks are apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DistanceFigures {
    /// Instants for which both tracks have an estimate.
    pub instants: usize,
    /// Mean of all, outliers included, mm.
    pub mean_mm: f64,
    /// Median, mm.
    pub median_mm: f64,
    /// Robust standard deviation, mm.
    pub robust_sd_mm: f64,
    /// Mean without outliers, mm.
    pub mean_without_outliers_mm: f64,
    /// Instants whose distance is an outlier.
    pub outliers: usize,
}

/// Collects the distances of two tracks: 8 bytes per instant.
#[derive(Debug, Clone, Default)]
pub struct DistanceCheck {
    distances_m: Vec<f64>,
}

impl DistanceCheck {
    /// Both positions at one instant, m.
    pub fn push(&mut self, a_m: &Vector3<f64>, b_m: &Vector3<f64>) {
        let distance = (a_m - b_m).norm();
        if distance.is_finite() {
            self.distances_m.push(distance);
        }
    }

    /// The figures; `None` before the first instant.
    pub fn figures(&self) -> Option<DistanceFigures> {
        let median_m = median(&self.distances_m)?;
        let deviations: Vec<f64> = self.distances_m.iter().map(|d| (d - median_m).abs()).collect();
        let robust_sd_m = SD_PER_MAD * median(&deviations)?;
        let belongs = |d: &&f64| (**d - median_m).abs() <= OUTLIER_SD * robust_sd_m;
        let mean_of = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), v| (sum + v, count + 1));
            sum / count as f64
        };
        let inside = self.distances_m.iter().filter(belongs).count();
        Some(DistanceFigures {
            instants: self.distances_m.len(),
            mean_mm: 1e3 * mean_of(&mut self.distances_m.iter().copied()),
            median_mm: 1e3 * median_m,
            robust_sd_mm: 1e3 * robust_sd_m,
            mean_without_outliers_mm: 1e3 * mean_of(&mut self.distances_m.iter().filter(belongs).copied()),
            outliers: self.distances_m.len() - inside,
        })
    }
}

/// Where a track that should rest was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RestFigures {
    /// Estimates.
    pub instants: usize,
    /// Median of each coordinate, world, mm.
    pub median_mm: [f64; 3],
    /// Robust standard deviation along each axis, mm.
    pub robust_sd_mm: [f64; 3],
    /// Estimates that are outliers along an axis.
    pub outliers: usize,
    /// Farthest estimate from the median, mm.
    pub farthest_mm: f64,
}

/// Collects the places of a track that should rest: 24 bytes per instant.
#[derive(Debug, Clone, Default)]
pub struct RestCheck {
    places_m: [Vec<f64>; 3],
}

impl RestCheck {
    /// An estimate, m.
    pub fn push(&mut self, position_m: &Vector3<f64>) {
        if position_m.iter().all(|v| v.is_finite()) {
            self.places_m.iter_mut().zip(position_m.iter()).for_each(|(axis, v)| axis.push(*v));
        }
    }

    /// The figures; `None` before the first estimate.
    pub fn figures(&self) -> Option<RestFigures> {
        let mut medians_m = [0.0; 3];
        let mut sds_m = [0.0; 3];
        for (axis, places_m) in self.places_m.iter().enumerate() {
            medians_m[axis] = median(places_m)?;
            let deviations: Vec<f64> = places_m.iter().map(|p| (p - medians_m[axis]).abs()).collect();
            sds_m[axis] = SD_PER_MAD * median(&deviations)?;
        }
        let instants = self.places_m[0].len();
        let offset = |k: usize| Vector3::from_fn(|axis, _| self.places_m[axis][k] - medians_m[axis]);
        let is_outlier = |k: &usize| offset(*k).iter().zip(sds_m).any(|(d, sd)| d.abs() > OUTLIER_SD * sd);
        Some(RestFigures {
            instants,
            median_mm: medians_m.map(|m| 1e3 * m),
            robust_sd_mm: sds_m.map(|m| 1e3 * m),
            outliers: (0..instants).filter(is_outlier).count(),
            farthest_mm: 1e3 * (0..instants).map(|k| offset(k).norm()).fold(0.0, f64::max),
        })
    }
}

fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => None,
        n if n % 2 == 1 => Some(sorted[middle]),
        _ => Some(0.5 * (sorted[middle - 1] + sorted[middle])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_speeds_between_estimates_and_the_steps_beyond_the_limit() {
        let mut check = SpeedCheck::new(2.0);
        assert_eq!(check.figures(), None);
        for (t, x) in [(0.0, 0.0), (0.5, 0.5), (1.0, 2.0), (1.0, 9.0), (2.0, 2.0)] {
            check.push(t, Vector3::x() * x);
        }
        let figures = check.figures().unwrap();
        // 1, 3, 0 m/s; the second estimate of t = 1 is passed over.
        assert_eq!((figures.steps, figures.speed_m_s.max, figures.speed_m_s.median), (3, 3.0, 1.0));
        assert!((figures.share_within - 2.0 / 3.0).abs() < 1e-15);
        assert_eq!(figures.beyond, [FastStep { from_s: 0.5, to_s: 1.0, speed_m_s: 3.0 }]);
    }

    #[test]
    fn closed_form_an_outlier_moves_the_mean_but_not_the_robust_figures() {
        let mut check = DistanceCheck::default();
        assert_eq!(check.figures(), None);
        for d_mm in [168.0, 170.0, 171.0, 172.0, 173.0, 174.0, 176.0, 400.0] {
            check.push(&(Vector3::y() * d_mm * 1e-3), &Vector3::zeros());
        }
        let figures = check.figures().unwrap();
        // Sorted deviations from 172.5: 0.5, 0.5, 1.5, 1.5, 2.5, 3.5, 4.5, 227.5; their median 2.0.
        assert!((figures.median_mm - 172.5).abs() < 1e-9 && (figures.robust_sd_mm - 2.9652).abs() < 1e-9);
        assert_eq!((figures.instants, figures.outliers), (8, 1));
        assert!((figures.mean_mm - 200.5).abs() < 1e-9);
        assert!((figures.mean_without_outliers_mm - 172.0).abs() < 1e-9);
    }
    #[test]
    fn closed_form_what_rests_and_one_estimate_elsewhere() {
        let mut check = RestCheck::default();
        assert_eq!(check.figures(), None);
        for (x_mm, z_mm) in [(-2.0, 5.0), (-1.0, 5.5), (0.0, 6.0), (1.0, 6.5), (170.0, 7.0)] {
            check.push(&(Vector3::new(x_mm, 1.0, z_mm) * 1e-3));
        }
        check.push(&Vector3::repeat(f64::NAN));
        let figures = check.figures().unwrap();
        // Deviations from (0, 1, 6): 0, 1, 1, 2, 170 along x; 0, 0.5, 0.5, 1, 1 along z.
        for (ours, wanted) in figures.robust_sd_mm.iter().zip([1.4826, 0.0, 0.7413]) {
            assert!((ours - wanted).abs() < 1e-9, "{figures:?}");
        }
        assert_eq!((figures.instants, figures.outliers), (5, 1));
        assert!((figures.farthest_mm - 170.0_f64.hypot(1.0)).abs() < 1e-9);
        assert!(figures.median_mm.iter().zip([0.0, 1.0, 6.0]).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
