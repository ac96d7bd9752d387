//! Whether two ways to make lines make the same lines: rates, fractions, and how far lines pass from where they come from.

use super::coincidence::{LabelledLine, Origin};
use nalgebra::Vector3;

/// What is kept of many windows of one mode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Windows.
    pub windows: usize,
    /// Lines of each origin: true, scattered, with a prompt gamma, random.
    pub counts: [u64; 4],
    /// Distances of true lines from their markers, m.
    pub true_offsets_m: Vec<f64>,
    /// Distances of the other lines from the capsule, m.
    pub other_offsets_m: Vec<f64>,
}

impl Summary {
    /// Adds a window: its lines, the markers' places and the capsule's in the middle of it, world, m.
    pub fn add(&mut self, lines: &[LabelledLine], markers_m: &[Vector3<f64>], capsule_m: &Vector3<f64>) {
        self.windows += 1;
        for line in lines {
            let Some(along) = line.line.direction() else { continue };
            let offset_m =
                |place_m: &Vector3<f64>| (place_m - line.line.ends_world_m[0]).cross(&along).norm();
            let slot = match line.label.origin {
                Origin::True => 0,
                Origin::Scattered => 1,
                Origin::Prompt => 2,
                Origin::Random => 3,
            };
            self.counts[slot] += 1;
            if slot == 0 {
                self.true_offsets_m.push(offset_m(&markers_m[usize::from(line.label.markers[0])]));
            } else {
                self.other_offsets_m.push(offset_m(capsule_m));
            }
        }
    }

    /// All lines.
    pub fn lines(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Lines per window.
    pub fn lines_per_window(&self) -> f64 {
        self.lines() as f64 / self.windows.max(1) as f64
    }

    /// Share of true lines.
    pub fn true_fraction(&self) -> f64 {
        self.counts[0] as f64 / self.lines().max(1) as f64
    }

    /// Difference of two rates of lines of one origin over its standard error (counts are Poisson).
    pub fn rate_deviation(&self, other: &Self, of: impl Fn(&[u64; 4]) -> u64) -> f64 {
        let (a, b) = (of(&self.counts) as f64, of(&other.counts) as f64);
        let (n, m) = (self.windows.max(1) as f64, other.windows.max(1) as f64);
        (a / n - b / m) / (a / (n * n) + b / (m * m)).sqrt().max(f64::MIN_POSITIVE)
    }

    /// Difference of two true fractions over its standard error.
    pub fn fraction_deviation(&self, other: &Self) -> f64 {
        let (p, q) = (self.true_fraction(), other.true_fraction());
        let variance =
            p * (1.0 - p) / self.lines().max(1) as f64 + q * (1.0 - q) / other.lines().max(1) as f64;
        (p - q) / variance.sqrt().max(f64::MIN_POSITIVE)
    }
}

/// Two-sample test of Kolmogorov and Smirnov: probability that samples of one distribution differ at least so much. Asymptotic
/// distribution with Stephens' (1970) correction for small samples; 1 where one is empty.
pub fn kolmogorov_smirnov(a: &[f64], b: &[f64]) -> f64 {
    if a.is_empty() || b.is_empty() {
        return 1.0;
    }
    let (mut a, mut b) = (a.to_vec(), b.to_vec());
    a.sort_by(f64::total_cmp);
    b.sort_by(f64::total_cmp);
    let (n, m) = (a.len(), b.len());
    let (mut i, mut j, mut largest) = (0, 0, 0.0_f64);
    while i < n && j < m {
        let here = a[i].min(b[j]);
        while i < n && a[i] <= here {
            i += 1;
        }
        while j < m && b[j] <= here {
            j += 1;
        }
        largest = largest.max((i as f64 / n as f64 - j as f64 / m as f64).abs());
    }
    let root = (n as f64 * m as f64 / (n + m) as f64).sqrt();
    let x = (root + 0.12 + 0.11 / root) * largest;
    if x < 0.3 {
        // The alternating series converges slowly here, towards 1.
        return 1.0;
    }
    let term = |k: i32| if k % 2 == 1 { 1.0 } else { -1.0 } * (-2.0 * f64::from(k * k) * x * x).exp();
    (2.0 * (1..=100).map(term).sum::<f64>()).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_kolmogorov_distribution() {
        // Critical values of the limit distribution (Smirnov 1948): 1.358 at 5 %, 1.628 at 1 %. Samples of size n shifted by a
        // share D of ranks have exactly that distance.
        let n = 40_000;
        let a: Vec<f64> = (0..n).map(f64::from).collect();
        for (x, p) in [(1.3581, 0.05), (1.6276, 0.01)] {
            let shift = (x / (f64::from(n) / 2.0).sqrt() * f64::from(n)).round();
            let b: Vec<f64> = a.iter().map(|v| v + shift).collect();
            let here = kolmogorov_smirnov(&a, &b);
            assert!((here / p - 1.0).abs() < 0.02, "{here} {p}");
        }
        assert_eq!(kolmogorov_smirnov(&a, &a), 1.0);
    }
}
