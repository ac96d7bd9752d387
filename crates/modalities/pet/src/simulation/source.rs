//! Markers as sources: where and when they decay, and what a decay emits.

use super::compton::{ELECTRON_REST_ENERGY_EV, across, in_ball, isotropic};
use super::isotope::Isotope;
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

impl SourceMarker {
    /// Largest distance between a marker's place and an annihilation, m.
    pub fn reach_m(&self) -> f64 {
        0.5 * self.core_diameter_m + self.isotope.largest_range_m()
    }

    /// Draws where a positron annihilates, from the marker's place, m. Decays fill the core evenly.
    pub fn annihilation_offset_m<R: Rng + ?Sized>(&self, random: &mut R) -> Vector3<f64> {
        let range_m = self.isotope.range_m(random);
        let range_m = self.shell.map_or(range_m, |shell| shell.distance_m(range_m));
        self.core_offset_m(random) + isotropic(random) * range_m
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
