//! Markers as sources: where and when they decay, and what a decay emits.

use super::compton::{ELECTRON_REST_ENERGY_EV, across, in_ball, isotropic};
use super::isotope::{Isotope, PositronBranch};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// A shell of dense matter around a marker's core: positrons lose their range in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shell {
    /// Thickness, m.
    pub thickness_m: f64,
    /// Density over water's: positron ranges are alike as mass per area (Katz and Penfold 1952; within some 20 % for heavy metals).
    pub relative_density: f64,
}

impl Shell {
    /// Distance that a positron of a range in water gets from the core's surface, m.
    pub fn distance_m(&self, range_in_water_m: f64) -> f64 {
        let inside_m = range_in_water_m / self.relative_density;
        if inside_m <= self.thickness_m {
            inside_m
        } else {
            self.thickness_m + range_in_water_m - self.thickness_m * self.relative_density
        }
    }
}

/// A marker as it really is.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceMarker {
    /// Place in the capsule's frame, m.
    pub position_capsule_m: Vector3<f64>,
    /// Activity at the scenario's start, Bq.
    pub activity_bq: f64,
    /// What decays.
    pub isotope: Isotope,
    /// Diameter of the active core, m.
    pub core_diameter_m: f64,
    /// What surrounds the core.
    pub shell: Option<Shell>,
}

/// Beyond so many of its scales no range matters.
const MOST_SCALES: f64 = 60.0;
const SIMPSON_STEPS: u32 = 3000;

impl SourceMarker {
    /// Largest distance between a marker's place and an annihilation, m.
    pub fn reach_m(&self) -> f64 {
        let largest_m = self.isotope.largest_range_m();
        0.5 * self.core_diameter_m + self.shell.map_or(largest_m, |shell| shell.distance_m(largest_m))
    }

    /// Draws where a positron annihilates, from the marker's place, m. Decays fill the core evenly.
    pub fn annihilation_offset_m<R: Rng + ?Sized>(&self, random: &mut R) -> Vector3<f64> {
        let range_m = self.isotope.range_m(random);
        let range_m = self.shell.map_or(range_m, |shell| shell.distance_m(range_m));
        self.core_offset_m(random) + isotropic(random) * range_m
    }

    /// Variance per axis of the annihilations about the marker's place, m²: `R²/5` of the core and a third of the mean square of the distance
    /// that positrons get, whose range has the Gamma distribution of shape 2.
    pub fn variance_m2(&self) -> f64 {
        let of_branch = |branch: &PositronBranch| {
            let scale_m = 0.5 * branch.mean_range_m;
            let distance_m = |range_m: f64| self.shell.map_or(range_m, |shell| shell.distance_m(range_m));
            // Simpson's rule, to 1e-9.
            let integrand = |x: f64| distance_m(scale_m * x).powi(2) * x * (-x).exp();
            let sum: f64 = (0..SIMPSON_STEPS)
                .map(|k| {
                    let [a, b] = [k, k + 1].map(|k| MOST_SCALES * f64::from(k) / f64::from(SIMPSON_STEPS));
                    (b - a) / 6.0 * (integrand(a) + 4.0 * integrand(0.5 * (a + b)) + integrand(b))
                })
                .sum();
            branch.per_decay * sum
        };
        let square_m2: f64 = self.isotope.positrons.iter().map(of_branch).sum();
        let radius_m = 0.5 * self.core_diameter_m;
        radius_m * radius_m / 5.0 + square_m2 / self.isotope.positrons_per_decay() / 3.0
    }

    /// Draws where a decay happens, from the marker's place, m.
    pub fn core_offset_m<R: Rng + ?Sized>(&self, random: &mut R) -> Vector3<f64> {
        in_ball(random) * (0.5 * self.core_diameter_m)
    }
}

/// Pieces into which a window's motion is cut. Between two knots the markers move on straight lines: at 10 m/s² this is wrong by
/// 3 um in a window of 50 ms, `a (T/32)²/8`.
const PIECES: usize = 32;

/// The markers' ways through one window.
#[derive(Clone, Debug, Default)]
pub struct MarkerPaths {
    markers: usize,
    duration_s: f64,
    /// By knot, then marker, m.
    places_m: Vec<Vector3<f64>>,
}

impl MarkerPaths {
    /// Asks the motion at all knots of a window.
    pub fn follow(
        &mut self,
        markers: &[SourceMarker],
        motion: &dyn Fn(f64) -> Isometry3<f64>,
        start_s: f64,
        duration_s: f64,
    ) {
        self.markers = markers.len();
        self.duration_s = duration_s;
        self.places_m.clear();
        for knot in 0..=PIECES {
            let world_from_capsule = motion(start_s + duration_s * knot as f64 / PIECES as f64);
            for marker in markers {
                let place_m = world_from_capsule * Point3::from(marker.position_capsule_m);
                self.places_m.push(place_m.coords);
            }
        }
    }

    /// One marker at rest for a second.
    pub fn rest(&mut self, place_m: &Vector3<f64>) {
        self.markers = 1;
        self.duration_s = 1.0;
        self.places_m.clear();
        self.places_m.resize(PIECES + 1, *place_m);
    }

    /// Where a marker is, world, m; `after_s` from the window's start.
    pub fn at(&self, marker: usize, after_s: f64) -> Vector3<f64> {
        let place = (after_s / self.duration_s * PIECES as f64).clamp(0.0, PIECES as f64 - 1e-9);
        let knot = place as usize;
        let (a, b) = (
            &self.places_m[knot * self.markers + marker],
            &self.places_m[(knot + 1) * self.markers + marker],
        );
        a + (b - a) * (place - knot as f64)
    }

    /// A marker's places at all knots, world, m.
    pub fn knots(&self, marker: usize) -> impl Iterator<Item = &Vector3<f64>> {
        self.places_m.iter().skip(marker).step_by(self.markers)
    }
}

/// The second photon's direction: opposite to the first, bent by the pair's momentum before annihilation.
pub fn opposite<R: Rng + ?Sized>(direction: &Vector3<f64>, sigma_rad: f64, random: &mut R) -> Vector3<f64> {
    if sigma_rad == 0.0 {
        return -direction;
    }
    let (a, b): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
    let [first, second] = across(direction);
    (first * (a * sigma_rad) + second * (b * sigma_rad) - direction).normalize()
}

/// Energy of an annihilation photon, eV.
pub const ANNIHILATION_EV: f64 = ELECTRON_REST_ENERGY_EV;

#[cfg(test)]
mod tests {
    use super::super::isotope::tests::model;
    use super::*;
    use lumenav_core::RandomStreams;

    fn marker(shell: Option<Shell>) -> SourceMarker {
        SourceMarker {
            position_capsule_m: Vector3::new(-0.012, 0.0, 0.0),
            activity_bq: 1.85e6,
            isotope: model("na-22"),
            core_diameter_m: 5e-4,
            shell,
        }
    }

    #[test]
    fn closed_form_spread_of_annihilations() {
        // Per axis: core R²/5, range 6 s²/3.
        let mut random = RandomStreams::new(10, 0, "source").stream("place", 0);
        let source = marker(None);
        let n = 60_000;
        let sum: f64 = (0..n).map(|_| source.annihilation_offset_m(&mut random).norm_squared()).sum();
        let expected = 3.0 * (2.5e-4_f64.powi(2) / 5.0 + 2.0 * 2e-4_f64.powi(2));
        let here = sum / f64::from(n);
        assert!((here / expected - 1.0).abs() < 0.03, "{here} {expected}");
        assert!(((expected / 3.0).sqrt() - 0.303e-3).abs() < 1e-5);
    }

    /// Told by the integral and by draws: bare and in a shell, of one branch and of two, within a fiftieth; the bare ones in closed form.
    #[test]
    fn closed_form_variance_of_annihilations() {
        let mut random = RandomStreams::new(12, 0, "source").stream("variance", 0);
        let bare = 2.5e-4_f64.powi(2) / 5.0 + 2.0 * 2e-4_f64.powi(2);
        assert!((marker(None).variance_m2() / bare - 1.0).abs() < 1e-9);
        let gold = Shell { thickness_m: 2e-5, relative_density: 19.3 };
        let foam = Shell { thickness_m: 2e-3, relative_density: 0.05 };
        for (isotope, shell) in
            [("na-22", None), ("na-22", Some(gold)), ("na-22", Some(foam)), ("ga-68", None)]
        {
            let source = SourceMarker { isotope: model(isotope), ..marker(shell) };
            let n = 100_000;
            let (mut sum, mut furthest_m) = (0.0, 0.0_f64);
            for _ in 0..n {
                let offset_m = source.annihilation_offset_m(&mut random);
                sum += offset_m.norm_squared();
                furthest_m = furthest_m.max(offset_m.norm());
            }
            let drawn = sum / f64::from(n) / 3.0;
            assert!((source.variance_m2() / drawn - 1.0).abs() < 0.02, "{isotope} {shell:?}: {drawn}");
            assert!(furthest_m <= source.reach_m(), "{isotope} {shell:?}: {furthest_m}");
        }
        // Of Ga-68 seventy times that of Na-22.
        let gallium = SourceMarker { isotope: model("ga-68"), ..marker(None) };
        assert!(gallium.variance_m2() > 5e-6);
    }

    #[test]
    fn closed_form_a_shell_of_gold_stops_positrons() {
        let gold = Shell { thickness_m: 1e-4, relative_density: 19.3 };
        assert!((gold.distance_m(1e-3) - 1e-3 / 19.3).abs() < 1e-15);
        // What is left beyond it flies on in water.
        assert!((gold.distance_m(3e-3) - (1e-4 + 3e-3 - 1.93e-3)).abs() < 1e-15);
    }

    #[test]
    fn closed_form_acollinearity_has_its_width() {
        let sigma = 0.5_f64.to_radians() / super::super::block::FWHM_PER_SIGMA;
        let mut random = RandomStreams::new(11, 0, "source").stream("pairs", 0);
        let n = 40_000;
        let mut sum = 0.0;
        for _ in 0..n {
            let first = isotropic(&mut random);
            sum += (opposite(&first, sigma, &mut random) + first).norm_squared();
        }
        // Two axes.
        assert!((sum / f64::from(n) / (2.0 * sigma * sigma) - 1.0).abs() < 0.03);
        assert_eq!(opposite(&Vector3::x(), 0.0, &mut random), -Vector3::x());
    }

    #[test]
    fn law_markers_move_within_a_window() {
        let mut paths = MarkerPaths::default();
        let motion = |t: f64| Isometry3::translation(0.1 * t * t, 0.0, 0.02 * t);
        paths.follow(&[marker(None)], &motion, 2.0, 0.05);
        for after_s in [0.0, 0.0123, 0.05] {
            let expected = motion(2.0 + after_s) * Point3::new(-0.012, 0.0, 0.0);
            assert!((paths.at(0, after_s) - expected.coords).norm() < 1e-7);
        }
        assert_eq!(paths.knots(0).count(), PIECES + 1);
    }
}
