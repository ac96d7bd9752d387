//! The resting radius of the lumen by arc length.
//!
//! Piecewise cubic Hermite interpolation whose slopes keep every piece monotone (Fritsch and Butland, SIAM J. Sci. Stat.
//! Comput. 5, 1984; the three-point rule at the ends as in SciPy's `PchipInterpolator`): the radius never leaves the
//! range of its two neighbours, so it stays positive, and its slope is continuous. With `h_i` the widths and
//! `δ_i` the secants, the slope inside is 0 where `δ_i-1 δ_i <= 0`, else the weighted harmonic mean
//!
//! ```text
//! (w1 + w2) / (w1/δ_i-1 + w2/δ_i),   w1 = 2 h_i + h_i-1,   w2 = h_i + 2 h_i-1
//! ```
//!
//! Outside the first and last entry the radius is constant.

use crate::error::AnatomyError;

/// Radii above this are a mistake of units, m.
const RADIUS_LIMIT_M: f64 = 1.0;

/// Resting radius of the lumen, m, by arc length, m.
#[derive(Debug, Clone, PartialEq)]
pub struct RadiusProfile {
    arc_lengths_m: Vec<f64>,
    radii_m: Vec<f64>,
    slopes: Vec<f64>,
    /// Equal buckets over the profile: index of the entry right of each one's start. Asked five times a step, a binary search would be a
    /// twelfth of the engine's time.
    buckets: Vec<u32>,
    buckets_per_m: f64,
}

impl RadiusProfile {
    /// The profile through `(arc length, radius)`, m, with increasing arc lengths. One entry makes a constant radius.
    ///
    /// # Errors
    /// [`AnatomyError`]: no entry, arc lengths that do not increase, radii that are not above 0 and at most 1 m.
    pub fn through(entries: &[(f64, f64)]) -> Result<Self, AnatomyError> {
        if entries.is_empty() {
            return Err(AnatomyError::NotPositive { name: "number of radii", value: 0.0 });
        }
        for (index, (arc_length_m, radius_m)) in entries.iter().enumerate() {
            if !(*radius_m > 0.0 && radius_m.is_finite()) {
                return Err(AnatomyError::NotPositive { name: "radius (m)", value: *radius_m });
            }
            if *radius_m > RADIUS_LIMIT_M {
                let (low, high) = (0.0, RADIUS_LIMIT_M);
                return Err(AnatomyError::OutOfRange { name: "radius (m)", value: *radius_m, low, high });
            }
            let grows = index == 0 || entries[index - 1].0 < *arc_length_m;
            if !(grows && arc_length_m.is_finite()) {
                return Err(AnatomyError::NotIncreasing { index });
            }
        }
        let (arc_lengths_m, radii_m): (Vec<f64>, Vec<f64>) = entries.iter().copied().unzip();
        let slopes = monotone_slopes(&arc_lengths_m, &radii_m);
        let (buckets, buckets_per_m) = buckets(&arc_lengths_m);
        Ok(Self { arc_lengths_m, radii_m, slopes, buckets, buckets_per_m })
    }

    /// Index of the first entry beyond an arc length that lies between the first and the last one.
    #[inline]
    fn right_of(&self, arc_length_m: f64) -> usize {
        let bucket = ((arc_length_m - self.arc_lengths_m[0]) * self.buckets_per_m) as usize;
        let mut right = self.buckets[bucket.min(self.buckets.len() - 1)] as usize;
        // Rounding may put a place next to a border into either bucket.
        while self.arc_lengths_m[right - 1] > arc_length_m {
            right -= 1;
        }
        while self.arc_lengths_m[right] <= arc_length_m {
            right += 1;
        }
        right
    }

    /// Resting radius at an arc length, m.
    #[inline]
    pub fn radius_m(&self, arc_length_m: f64) -> f64 {
        self.with_slope(arc_length_m).0
    }

    /// `dR/ds` at an arc length.
    #[inline]
    pub fn slope(&self, arc_length_m: f64) -> f64 {
        self.with_slope(arc_length_m).1
    }

    /// Radius (m) and its slope.
    pub fn with_slope(&self, arc_length_m: f64) -> (f64, f64) {
        let last = self.arc_lengths_m.len() - 1;
        if arc_length_m.is_nan() || arc_length_m <= self.arc_lengths_m[0] {
            return (self.radii_m[0], 0.0);
        }
        if arc_length_m >= self.arc_lengths_m[last] {
            return (self.radii_m[last], 0.0);
        }
        let right = self.right_of(arc_length_m);
        let i = right - 1;
        let h = self.arc_lengths_m[right] - self.arc_lengths_m[i];
        let t = (arc_length_m - self.arc_lengths_m[i]) / h;
        let rise = self.radii_m[right] - self.radii_m[i];
        let (m0, m1) = (self.slopes[i] * h, self.slopes[right] * h);
        let (c, d) = (3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise);
        let radius = self.radii_m[i] + t * (m0 + t * (c + t * d));
        (radius, (m0 + t * (2.0 * c + 3.0 * t * d)) / h)
    }

    /// The narrowest and the widest radius, m.
    pub fn range_m(&self) -> (f64, f64) {
        // Monotone between the entries, so the extremes are entries.
        self.radii_m.iter().fold((f64::INFINITY, 0.0), |(low, high), r| (r.min(low), r.max(high)))
    }
}

/// For each of as many equal buckets as there are entries, the index of the entry right of its start; and buckets per metre.
fn buckets(arc_lengths_m: &[f64]) -> (Vec<u32>, f64) {
    let last = arc_lengths_m.len() - 1;
    if last == 0 {
        return (vec![0], 0.0);
    }
    let (count, length_m) = (arc_lengths_m.len(), arc_lengths_m[last] - arc_lengths_m[0]);
    let right = |bucket: usize| {
        let start_m = arc_lengths_m[0] + length_m * bucket as f64 / count as f64;
        // A tract has a few thousand entries.
        arc_lengths_m.partition_point(|s| *s <= start_m).clamp(1, last) as u32
    };
    ((0..count).map(right).collect(), count as f64 / length_m)
}

fn monotone_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    if n == 1 {
        return vec![0.0];
    }
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let secant: Vec<f64> = y.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    if n == 2 {
        return vec![secant[0]; 2];
    }
    let mut slopes = vec![0.0; n];
    for i in 1..n - 1 {
        if secant[i - 1] * secant[i] > 0.0 {
            let (w1, w2) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            slopes[i] = (w1 + w2) / (w1 / secant[i - 1] + w2 / secant[i]);
        }
    }
    slopes[0] = end_slope(h[0], h[1], secant[0], secant[1]);
    slopes[n - 1] = end_slope(h[n - 2], h[n - 3], secant[n - 2], secant[n - 3]);
    slopes
}

/// Three-point slope at an end, limited so that the piece stays monotone.
fn end_slope(h0: f64, h1: f64, secant0: f64, secant1: f64) -> f64 {
    let slope = ((2.0 * h0 + h1) * secant0 - h0 * secant1) / (h0 + h1);
    if slope * secant0 <= 0.0 {
        0.0
    } else if secant0 * secant1 <= 0.0 && slope.abs() > 3.0 * secant0.abs() {
        3.0 * secant0
    } else {
        slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_every_place_finds_its_own_piece() {
        // Entries from a micrometre to a decimetre apart, asked at entries, beside them and between.
        let mut entries = vec![(0.01, 0.02)];
        for k in 0..200 {
            let step_m = [1e-6, 1e-3, 0.1, 3e-3][k % 4] * (1.0 + 0.1 * (k as f64).sin());
            let (s, _) = entries[k];
            entries.push((s + step_m, 0.02 + 0.005 * (0.7 * k as f64).cos()));
        }
        let profile = RadiusProfile::through(&entries).unwrap();
        for pair in entries.windows(2) {
            for s in [pair[0].0, pair[0].0.next_up(), 0.5 * (pair[0].0 + pair[1].0), pair[1].0.next_down()] {
                let found = profile.right_of(s.clamp(pair[0].0, pair[1].0.next_down()));
                assert_eq!(entries[found].0, pair[1].0, "at {s}");
            }
        }
    }

    #[test]
    fn law_the_radius_stays_between_its_neighbours_and_the_slope_is_its_derivative() {
        let entries = [(0.0, 0.01), (0.02, 0.02), (0.025, 0.0201), (0.1, 0.005), (0.11, 0.03), (0.2, 0.03)];
        let profile = RadiusProfile::through(&entries).unwrap();
        for pair in entries.windows(2) {
            for k in 1..200 {
                let s = pair[0].0 + (pair[1].0 - pair[0].0) * f64::from(k) / 200.0;
                let (low, high) = (pair[0].1.min(pair[1].1), pair[0].1.max(pair[1].1));
                assert!((low - 1e-15..=high + 1e-15).contains(&profile.radius_m(s)));
                let h = 1e-8;
                let numeric = (profile.radius_m(s + h) - profile.radius_m(s - h)) / (2.0 * h);
                assert!((numeric - profile.slope(s)).abs() < 1e-5, "at {s}");
            }
        }
        for (s, r) in entries {
            assert!((profile.radius_m(s) - r).abs() < 1e-17);
            assert!((profile.slope(s - 1e-12) - profile.slope(s + 1e-12)).abs() < 1e-6 || s == 0.0);
        }
        assert_eq!(profile.range_m(), (0.005, 0.03));
    }

    #[test]
    fn law_bad_profiles_are_refused_and_one_entry_is_constant() {
        assert!(RadiusProfile::through(&[]).is_err());
        for radius in [0.0, -0.01, f64::NAN, f64::INFINITY, 7.0] {
            assert!(RadiusProfile::through(&[(0.0, radius)]).is_err());
        }
        assert!(matches!(
            RadiusProfile::through(&[(0.0, 0.01), (0.0, 0.02)]),
            Err(AnatomyError::NotIncreasing { index: 1 })
        ));
        assert!(RadiusProfile::through(&[(f64::NAN, 0.01)]).is_err());
        let tube = RadiusProfile::through(&[(0.0, 0.012)]).unwrap();
        for s in [-1.0, 0.0, 3.0, f64::NAN] {
            assert_eq!(tube.with_slope(s), (0.012, 0.0));
        }
    }
}
