//! A photon, and its way out of the body.
//!
//! In a body of one material the free path is exponential and the body convex, so nothing is rejected. In voxels Woodcock's
//! method (1965) is used: free paths under the largest coefficient of the body, of which a share is taken that is the true
//! coefficient over the largest. Coefficients at 511 keV scale with the Klein-Nishina cross section; scattering is Compton's alone.

use super::compton::{ELECTRON_REST_ENERGY_EV, Scatter, deflected, klein_nishina_m2, scatter};
use lumenav_anatomy::phantom::Phantom;
use nalgebra::Vector3;
use rand::{Rng, RngExt as _};
use rand_distr::Exp1;

/// A photon on its way. Frame: world, or a block's, as whoever holds it says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photon {
    /// Where it is, m.
    pub place_m: Vector3<f64>,
    /// Unit vector of where it flies.
    pub direction: Vector3<f64>,
    /// Energy, eV.
    pub energy_ev: f64,
    /// Way since its emission, m.
    pub path_m: f64,
}

impl Photon {
    /// A photon that is just emitted.
    pub fn emitted(place_m: Vector3<f64>, direction: Vector3<f64>, energy_ev: f64) -> Self {
        Self { place_m, direction, energy_ev, path_m: 0.0 }
    }

    /// Flies on.
    pub fn advance(&mut self, by_m: f64) {
        self.place_m += self.direction * by_m;
        self.path_m += by_m;
    }

    /// In a block's coordinates: moved along its way to the plane of the face, where it flies into the block.
    pub fn on_face(mut self) -> Self {
        if self.direction.z > 0.0 {
            self.advance(-self.place_m.z / self.direction.z);
        }
        self
    }

    /// Scatters on a free electron; the energy that is left behind, eV.
    pub fn scatter<R: Rng + ?Sized>(&mut self, random: &mut R) -> f64 {
        let (share, cos_angle) = scatter(self.energy_ev, random);
        let before_ev = self.energy_ev;
        self.energy_ev *= share;
        self.direction = deflected(&self.direction, cos_angle, random);
        before_ev - self.energy_ev
    }
}

/// An exponential draw of mean 1.
pub fn free_path<R: Rng + ?Sized>(random: &mut R) -> f64 {
    random.sample(Exp1)
}

/// Step of the table of cross sections, eV: straight lines in it are within 1e-4 above 100 keV.
const STEP_EV: f64 = 4e3;
/// Its end, 4 MeV: above all gammas of positron emitters.
const STEPS: usize = 1000;

/// `σ_KN(E) / σ_KN(511 keV)`, tabulated.
#[derive(Clone, Debug, PartialEq)]
pub struct ComptonRatio(Vec<f64>);

impl Default for ComptonRatio {
    fn default() -> Self {
        let at_511_m2 = klein_nishina_m2(ELECTRON_REST_ENERGY_EV);
        Self((0..=STEPS).map(|i| klein_nishina_m2(STEP_EV * i as f64) / at_511_m2).collect())
    }
}

impl ComptonRatio {
    /// The ratio at an energy.
    pub fn at(&self, energy_ev: f64) -> f64 {
        let place = (energy_ev / STEP_EV).clamp(0.0, STEPS as f64 - 1.0);
        let index = place as usize;
        self.0[index] + (place - index as f64).min(1.0) * (self.0[index + 1] - self.0[index])
    }
}

/// What a photon crosses on its way to the detectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    phantom: Option<Phantom>,
    ratio: ComptonRatio,
    /// Photons of less are given up, eV.
    kill_ev: f64,
    /// Scatterings of photons of 511 keV: all, and those after which they are not given up.
    of_511: Scatter,
    kept_of_511: Scatter,
    /// How far the body stands from where its file says, m: a bed under the patient.
    moved_m: Vector3<f64>,
}

impl Body {
    /// A body (or air alone) in which photons are followed down to an energy, eV.
    pub fn new(phantom: Option<Phantom>, kill_ev: f64) -> Self {
        let of_511 = |least_share| Scatter::new(ELECTRON_REST_ENERGY_EV, least_share);
        Self {
            phantom,
            ratio: ComptonRatio::default(),
            kill_ev,
            of_511: of_511(0.0),
            kept_of_511: of_511(kill_ev / ELECTRON_REST_ENERGY_EV),
            moved_m: Vector3::zeros(),
        }
    }

    /// Stands so far from where its file says, m.
    pub fn move_to(&mut self, moved_m: Vector3<f64>) {
        self.moved_m = moved_m;
    }

    /// Probability that a photon of 511 keV leaves without having scattered.
    pub fn transmission_511(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
        let from_m = from_m - self.moved_m;
        self.phantom.as_ref().map_or(1.0, |p| (-p.optical_depth_511(&from_m, direction)).exp())
    }

    /// No photon of 511 keV that flies to a place from anywhere within a distance of another gets there with a larger probability.
    pub fn most_transmission_511(&self, from_m: &Vector3<f64>, to_m: &Vector3<f64>, within_m: f64) -> f64 {
        let (from_m, to_m) = (from_m - self.moved_m, to_m - self.moved_m);
        self.phantom.as_ref().map_or(1.0, |p| (-p.least_optical_depth_511(&from_m, &to_m, within_m)).exp())
    }

    /// Follows a photon until it leaves the body for good: how often it scattered, or `None` where its energy fell too low.
    pub fn leave<R: Rng + ?Sized>(&self, photon: &mut Photon, random: &mut R) -> Option<u32> {
        let chord_m = self.chord_m(&photon.place_m, &photon.direction);
        self.leave_along(photon, chord_m, random)
    }

    /// As [`Self::leave`], where the first way through the body is known ([`Phantom::chord_m`]).
    pub fn leave_along<R: Rng + ?Sized>(
        &self,
        photon: &mut Photon,
        mut chord_m: Option<(f64, f64)>,
        random: &mut R,
    ) -> Option<u32> {
        let mut scatterings = 0;
        while self.reach_scattering(photon, chord_m, random) {
            let is_first = photon.energy_ev == ELECTRON_REST_ENERGY_EV;
            let (share, cos_angle) =
                if is_first { self.of_511.draw(random) } else { scatter(photon.energy_ev, random) };
            photon.energy_ev *= share;
            if photon.energy_ev < self.kill_ev {
                return None;
            }
            photon.direction = deflected(&photon.direction, cos_angle, random);
            scatterings += 1;
            chord_m = self.chord_m(&photon.place_m, &photon.direction);
        }
        Some(scatterings)
    }

    /// Share of the photons of 511 keV that scatter which are not given up afterwards.
    pub fn kept_share_511(&self) -> f64 {
        self.kept_of_511.share()
    }

    /// As [`Self::leave`], of a photon of 511 keV that is not given up after its first scattering, of which there are
    /// [`Self::kept_share_511`]; `None`, too, where it does not scatter.
    pub fn leave_scattered_511<R: Rng + ?Sized>(&self, photon: &mut Photon, random: &mut R) -> Option<u32> {
        let chord_m = self.chord_m(&photon.place_m, &photon.direction);
        if !self.reach_scattering(photon, chord_m, random) {
            return None;
        }
        let (share, cos_angle) = self.kept_of_511.draw(random);
        photon.energy_ev *= share;
        photon.direction = deflected(&photon.direction, cos_angle, random);
        self.leave(photon, random).map(|more| 1 + more)
    }

    /// Flies on to the place of the next scattering; `false` where the photon leaves the body without.
    pub fn reach_scattering<R: Rng + ?Sized>(
        &self,
        photon: &mut Photon,
        mut chord_m: Option<(f64, f64)>,
        random: &mut R,
    ) -> bool {
        let Some(phantom) = &self.phantom else { return false };
        let uniform_per_m = phantom.uniform_attenuation_511_per_m();
        let largest_per_m = uniform_per_m.unwrap_or_else(|| phantom.largest_attenuation_511_per_m());
        if largest_per_m <= 0.0 {
            return false;
        }
        while let Some((near_m, far_m)) = chord_m.filter(|(_, far_m)| *far_m > 0.0) {
            let step_m =
                near_m.max(0.0) + free_path(random) / (largest_per_m * self.ratio.at(photon.energy_ev));
            if step_m >= far_m {
                return false;
            }
            photon.advance(step_m);
            let is_real = uniform_per_m.is_some()
                || random.random::<f64>() * largest_per_m
                    < phantom.attenuation_511_per_m(&(photon.place_m - self.moved_m));
            if is_real {
                return true;
            }
            chord_m = Some((0.0, far_m - step_m));
        }
        false
    }

    /// Way of a ray through the body ([`Phantom::chord_m`]).
    pub fn chord_m(&self, from_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64)> {
        self.phantom.as_ref().and_then(|p| p.chord_m(&(from_m - self.moved_m), direction))
    }

    /// As [`Self::transmission_511`], where the way through the body is known.
    pub fn transmission_511_along(
        &self,
        from_m: &Vector3<f64>,
        direction: &Vector3<f64>,
        chord_m: Option<(f64, f64)>,
    ) -> f64 {
        let (Some(phantom), Some((near_m, far_m))) = (&self.phantom, chord_m) else { return 1.0 };
        match phantom.uniform_attenuation_511_per_m() {
            Some(per_m) => (-per_m * (far_m.max(0.0) - near_m.max(0.0))).exp(),
            None => (-phantom.optical_depth_511(&(from_m - self.moved_m), direction)).exp(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_anatomy::phantom::{EllipticCylinder, Material};
    use lumenav_core::RandomStreams;

    fn water(centre_m: Vector3<f64>) -> Phantom {
        let shape = EllipticCylinder { centre_m, semi_axis_x_m: 0.1, semi_axis_y_m: 0.1, half_length_m: 0.1 };
        Phantom::cylinder("water", shape, Material { name: "water".into(), attenuation_511_per_m: 9.58 })
    }

    /// Share of photons along x that do not scatter.
    fn unscattered(body: &Body, from_m: Vector3<f64>, energy_ev: f64) -> f64 {
        let mut random = RandomStreams::new(4, 0, "photon").stream("walk", 0);
        let n = 40_000;
        let through = (0..n)
            .filter(|_| {
                let mut photon = Photon::emitted(from_m, Vector3::x(), energy_ev);
                body.leave(&mut photon, &mut random) == Some(0)
            })
            .count();
        through as f64 / f64::from(n)
    }

    #[test]
    fn closed_form_beer_lambert_from_inside_and_outside() {
        let body = Body::new(Some(water(Vector3::zeros())), 330e3);
        for (start, chord_m) in [(Vector3::zeros(), 0.1_f64), (Vector3::new(-0.5, 0.06, 0.0), 0.16)] {
            let expected = (-9.58 * chord_m).exp();
            let here = unscattered(&body, start, ELECTRON_REST_ENERGY_EV);
            assert!((here - expected).abs() < 0.01, "{here} {expected}");
            assert!((body.transmission_511(&start, &Vector3::x()) - expected).abs() < 1e-12);
        }
        // At 1274.5 keV by the ratio of cross sections.
        let ratio = klein_nishina_m2(1274.5e3) / klein_nishina_m2(ELECTRON_REST_ENERGY_EV);
        let here = unscattered(&body, Vector3::zeros(), 1274.5e3);
        assert!((here - (-0.958 * ratio).exp()).abs() < 0.01, "{here}");
        assert_eq!(unscattered(&Body::new(None, 330e3), Vector3::zeros(), 511e3), 1.0);
    }

    #[test]
    fn law_a_body_that_moved_is_that_body_seen_from_elsewhere() {
        let phantom = water(Vector3::zeros());
        let (resting, mut moved) = (Body::new(Some(phantom.clone()), 330e3), Body::new(Some(phantom), 330e3));
        let by_m = Vector3::new(0.01, -0.02, 0.07);
        moved.move_to(by_m);
        // Beside its middle, and so oblique that sign and axis of the shift tell.
        let (place, direction) = (Vector3::new(0.05, 0.02, 0.06), Vector3::new(0.6, 0.0, 0.8));
        let there = place + by_m;
        let through = resting.transmission_511(&place, &direction);
        assert!((moved.transmission_511(&there, &direction) - through).abs() < 1e-12);
        assert!((moved.transmission_511(&place, &direction) - through).abs() > 0.05);
        assert_eq!(
            moved.chord_m(&there, &direction).is_some(),
            resting.chord_m(&place, &direction).is_some()
        );
        let mut random = RandomStreams::new(4, 0, "photon").stream("moved", 0);
        let n = 20_000;
        let count = |random: &mut lumenav_core::RandomStream| {
            let leaves = |_: &i32| {
                let mut photon = Photon::emitted(there, direction, ELECTRON_REST_ENERGY_EV);
                moved.leave(&mut photon, random) == Some(0)
            };
            (0..n).filter(leaves).count()
        };
        let share = count(&mut random) as f64 / f64::from(n);
        assert!((share - through).abs() < 0.015, "{share} {through}");
    }

    #[test]
    fn law_energy_tells_the_angle_of_a_single_scattering() {
        let body = Body::new(Some(water(Vector3::zeros())), 330e3);
        let mut random = RandomStreams::new(5, 0, "photon").stream("walk", 0);
        let mut once = 0;
        for _ in 0..5000 {
            let mut photon = Photon::emitted(Vector3::zeros(), Vector3::x(), ELECTRON_REST_ENERGY_EV);
            let scatterings = body.leave(&mut photon, &mut random);
            if let Some(n) = scatterings {
                assert!(photon.energy_ev >= 330e3 && photon.energy_ev <= 511e3);
                if n == 1 {
                    once += 1;
                    let cos_angle = photon.direction.x;
                    let expected = ELECTRON_REST_ENERGY_EV / (2.0 - cos_angle);
                    assert!((photon.energy_ev / expected - 1.0).abs() < 1e-9);
                }
            }
        }
        assert!(once > 500, "{once}");
    }
}
