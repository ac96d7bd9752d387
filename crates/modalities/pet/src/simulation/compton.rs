//! Compton scattering by free electrons at rest (Klein and Nishina 1929).
//!
//! With `k = E / m_e c²` and `ε = E'/E` the scattered photon's share of the energy:
//!
//! ```text
//! ε = 1 / (1 + k (1 - cos θ)),      dσ/dΩ = r_e²/2 ε² (ε + 1/ε - sin² θ)
//! σ(k) = 2π r_e² { (1+k)/k² [ 2(1+k)/(1+2k) - ln(1+2k)/k ] + ln(1+2k)/(2k) - (1+3k)/(1+2k)² }
//! ```
//!
//! Binding of electrons, polarization and coherent (Rayleigh) scattering are neglected: at the energies that a PET scanner accepts
//! they change the number of photons that leave their path by about 1 % in water.

use nalgebra::Vector3;
use rand::{Rng, RngExt as _};

/// Rest energy of the electron, eV (CODATA 2018): the energy of an annihilation photon.
pub const ELECTRON_REST_ENERGY_EV: f64 = 510_998.95;
/// Classical radius of the electron, m (CODATA 2018).
pub const ELECTRON_RADIUS_M: f64 = 2.817_940_326_2e-15;
/// Below this `k` the closed form loses digits, and the series in `k` is exact to 1e-9.
const SMALL_K: f64 = 1e-3;

/// Cross section per electron at an energy, m².
pub fn klein_nishina_m2(energy_ev: f64) -> f64 {
    let k = energy_ev / ELECTRON_REST_ENERGY_EV;
    let area_m2 = std::f64::consts::TAU * ELECTRON_RADIUS_M * ELECTRON_RADIUS_M;
    if k < SMALL_K {
        // Thomson's 8/3 π r_e² with the first terms of the expansion.
        return area_m2 * 4.0 / 3.0 * (1.0 - 2.0 * k + 5.2 * k * k);
    }
    let wide = 1.0 + 2.0 * k;
    let log = wide.ln();
    area_m2
        * ((1.0 + k) / (k * k) * (2.0 * (1.0 + k) / wide - log / k) + log / (2.0 * k)
            - (1.0 + 3.0 * k) / (wide * wide))
}

/// Differential cross section per electron, m²/sr.
pub fn klein_nishina_m2_per_sr(energy_ev: f64, cos_angle: f64) -> f64 {
    let share = scattered_share(energy_ev, cos_angle);
    let sin2 = 1.0 - cos_angle * cos_angle;
    0.5 * ELECTRON_RADIUS_M * ELECTRON_RADIUS_M * share * share * (share + 1.0 / share - sin2)
}

/// Energy after scattering through an angle, over the energy before.
pub fn scattered_share(energy_ev: f64, cos_angle: f64) -> f64 {
    1.0 / (1.0 + energy_ev / ELECTRON_REST_ENERGY_EV * (1.0 - cos_angle))
}

/// Draws one scattering: the energy afterwards over the energy before, and the cosine of the angle.
pub fn scatter<R: Rng + ?Sized>(energy_ev: f64, random: &mut R) -> (f64, f64) {
    Scatter::new(energy_ev, 0.0).draw(random)
}

/// Scatterings of photons of one energy that keep at least a share of it.
///
/// Composition of `1/ε` and `ε`, each inverted, and rejection on `1 - ε sin² θ / (1 + ε²)` (Butcher and Messel 1960, as in the
/// manuals of EGS and Geant4). Of all scatterings they are the share `(F(1) - F(ε_least)) / (F(1) - F(1 / (1 + 2k)))`,
///
/// ```text
/// dσ/dε = π r_e²/k (1/ε + ε - sin² θ),    F(ε) = ln ε + ε²/2 - (2/k) (ln ε - ε) + (ε - 1/ε - 2 ln ε)/k²
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    k: f64,
    least2: f64,
    /// `-ln ε_least`.
    log: f64,
    /// Share of `1/ε` in the composition.
    of_inverse: f64,
    share: f64,
}

impl Scatter {
    /// Of photons of an energy, eV, that keep at least `least_share` of it.
    pub fn new(energy_ev: f64, least_share: f64) -> Self {
        let k = energy_ev / ELECTRON_REST_ENERGY_EV;
        let of_all = 1.0 / (1.0 + 2.0 * k);
        let least = least_share.clamp(of_all, 1.0);
        let (least2, log) = (least * least, -least.ln());
        let share =
            if least > of_all { integral_up_to_1(k, least) / integral_up_to_1(k, of_all) } else { 1.0 };
        Self { k, least2, log, of_inverse: log / (log + 0.5 * (1.0 - least2)), share }
    }

    /// Their share of all scatterings.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Draws one: the energy afterwards over the energy before, and the cosine of the angle.
    pub fn draw<R: Rng + ?Sized>(&self, random: &mut R) -> (f64, f64) {
        loop {
            let share = if random.random::<f64>() < self.of_inverse {
                (-self.log * random.random::<f64>()).exp()
            } else {
                (self.least2 + (1.0 - self.least2) * random.random::<f64>()).sqrt()
            };
            let versine = ((1.0 - share) / (self.k * share)).min(2.0);
            let sin2 = versine * (2.0 - versine);
            if random.random::<f64>() * (1.0 + share * share) < 1.0 + share * share - share * sin2 {
                return (share, 1.0 - versine);
            }
        }
    }
}

/// `F(1) - F(ε)` of [`Scatter`].
fn integral_up_to_1(k: f64, share: f64) -> f64 {
    let of = |e: f64| {
        let log = e.ln();
        log + 0.5 * e * e - 2.0 / k * (log - e) + (e - 1.0 / e - 2.0 * log) / (k * k)
    };
    of(1.0) - of(share)
}

/// A direction at an angle from another, turned about it at random.
pub fn deflected<R: Rng + ?Sized>(direction: &Vector3<f64>, cos_angle: f64, random: &mut R) -> Vector3<f64> {
    let ([x, y], square) = in_disc(random);
    // A point of the disc, drawn out to the circle: a turn without sine and cosine.
    let out = ((1.0 - cos_angle * cos_angle).max(0.0) / square).sqrt();
    let [first, second] = across(direction);
    let turned = direction * cos_angle + (first * x + second * y) * out;
    // Rounding would otherwise grow over many scatterings.
    turned * (1.5 - 0.5 * turned.norm_squared())
}

/// Two unit vectors across a unit vector and each other (Duff et al. 2017).
pub fn across(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let sign = 1.0_f64.copysign(direction.z);
    let a = -1.0 / (sign + direction.z);
    let b = direction.x * direction.y * a;
    [
        Vector3::new(1.0 + sign * direction.x * direction.x * a, sign * b, -sign * direction.x),
        Vector3::new(b, sign + direction.y * direction.y * a, -direction.y),
    ]
}

/// A point drawn evenly in the unit disc, never its centre, and its squared radius.
fn in_disc<R: Rng + ?Sized>(random: &mut R) -> ([f64; 2], f64) {
    loop {
        let (x, y) = (2.0 * random.random::<f64>() - 1.0, 2.0 * random.random::<f64>() - 1.0);
        let square = x * x + y * y;
        if square < 1.0 && square > 0.0 {
            return ([x, y], square);
        }
    }
}

/// A direction at random, all alike (Marsaglia 1972).
pub fn isotropic<R: Rng + ?Sized>(random: &mut R) -> Vector3<f64> {
    let ([x, y], square) = in_disc(random);
    let out = 2.0 * (1.0 - square).sqrt();
    Vector3::new(x * out, y * out, 1.0 - 2.0 * square)
}

/// A point drawn evenly in the unit ball: of three numbers drawn evenly the largest is as far out.
pub fn in_ball<R: Rng + ?Sized>(random: &mut R) -> Vector3<f64> {
    let [a, b, c]: [f64; 3] = random.random();
    isotropic(random) * a.max(b).max(c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::RandomStreams;

    /// One barn, m².
    const BARN_M2: f64 = 1e-28;

    /// The whole integral is the cross section's closed form; scatterings that keep a share are those of all that do: cosines by their mean
    /// and spread within five standard errors, their share within four.
    #[test]
    fn law_scatterings_that_keep_a_share_are_those_of_all_that_do() {
        for energy_ev in [200e3, ELECTRON_REST_ENERGY_EV, 1274.5e3] {
            let k = energy_ev / ELECTRON_REST_ENERGY_EV;
            let area_m2 = std::f64::consts::PI * ELECTRON_RADIUS_M * ELECTRON_RADIUS_M / k;
            let whole = area_m2 * integral_up_to_1(k, 1.0 / (1.0 + 2.0 * k));
            assert!((whole / klein_nishina_m2(energy_ev) - 1.0).abs() < 1e-12);
        }
        let mut random = RandomStreams::new(6, 0, "compton").stream("kept", 0);
        let (least, n) = (0.65, 200_000);
        let kept = Scatter::new(ELECTRON_REST_ENERGY_EV, least);
        let (mut count, mut sums) = (0.0, [[0.0; 2]; 2]);
        let mut add = |of: usize, cos: f64| {
            sums[of][0] += cos;
            sums[of][1] += cos * cos;
        };
        for _ in 0..n {
            let (share, cos) = scatter(ELECTRON_REST_ENERGY_EV, &mut random);
            if share >= least {
                count += 1.0;
                add(0, cos);
            }
            let (share, cos) = kept.draw(&mut random);
            assert!(share >= least * (1.0 - 1e-12));
            add(1, cos);
        }
        let all = f64::from(n);
        let error = (kept.share() * (1.0 - kept.share()) / all).sqrt();
        assert!((count / all - kept.share()).abs() < 4.0 * error, "{} {}", count / all, kept.share());
        let [mean, other] = [sums[0][0] / count, sums[1][0] / all];
        let spread = (sums[0][1] / count - mean * mean).sqrt();
        assert!((mean - other).abs() < 5.0 * spread * (1.0 / count + 1.0 / all).sqrt(), "{mean} {other}");
        let other_spread = (sums[1][1] / all - other * other).sqrt();
        assert!((spread / other_spread - 1.0).abs() < 0.01, "{spread} {other_spread}");
    }

    #[test]
    fn published_cross_section_at_511_kev_and_thomson_limit() {
        // 0.2866 b per electron: Evans, The Atomic Nucleus (1955), table of the Klein-Nishina formula at m_e c².
        let here = klein_nishina_m2(ELECTRON_REST_ENERGY_EV) / BARN_M2;
        assert!((here - 0.2866).abs() < 2e-4, "{here} b");
        // 8/3 π r_e² = 0.66525 b (CODATA).
        assert!((klein_nishina_m2(1e-3) / BARN_M2 - 0.665_245_87).abs() < 1e-6);
        // The series meets the closed form.
        let k = SMALL_K * ELECTRON_REST_ENERGY_EV;
        let (below, above) = (klein_nishina_m2(k * (1.0 - 1e-9)), klein_nishina_m2(k * (1.0 + 1e-9)));
        assert!((below / above - 1.0).abs() < 1e-6, "{below} {above}");
    }

    #[test]
    fn closed_form_differential_cross_section_integrates_to_the_total() {
        for energy_ev in [5e3, 100e3, 511e3, 1274.5e3, 3e6] {
            let n = 20_000;
            let step = 2.0 / f64::from(n);
            let sum: f64 =
                (0..n).map(|i| klein_nishina_m2_per_sr(energy_ev, -1.0 + (f64::from(i) + 0.5) * step)).sum();
            let total = sum * step * std::f64::consts::TAU;
            assert!((total / klein_nishina_m2(energy_ev) - 1.0).abs() < 1e-6, "{energy_ev}");
        }
    }

    #[test]
    fn closed_form_sampled_angles_follow_the_differential_cross_section() {
        // Chi-square over 40 bins of the cosine; 0.999 quantile of 39 degrees of freedom is 72.1.
        let mut random = RandomStreams::new(1, 0, "compton").stream("angles", 0);
        for energy_ev in [60e3, 511e3, 1274.5e3] {
            let (bins, draws) = (40_usize, 200_000);
            let mut counts = vec![0_u32; bins];
            for _ in 0..draws {
                let (share, cos_angle) = scatter(energy_ev, &mut random);
                assert!((share - scattered_share(energy_ev, cos_angle)).abs() < 1e-12);
                counts[(((cos_angle + 1.0) * 0.5 * bins as f64) as usize).min(bins - 1)] += 1;
            }
            let within = |bin: usize| {
                let fine = 200;
                let width = 2.0 / bins as f64;
                let at = |i: usize| -1.0 + width * (bin as f64 + (i as f64 + 0.5) / fine as f64);
                let mean: f64 =
                    (0..fine).map(|i| klein_nishina_m2_per_sr(energy_ev, at(i))).sum::<f64>() / fine as f64;
                mean * width * std::f64::consts::TAU / klein_nishina_m2(energy_ev)
            };
            let chi2: f64 = counts
                .iter()
                .enumerate()
                .map(|(bin, count)| {
                    let expected = within(bin) * f64::from(draws);
                    (f64::from(*count) - expected).powi(2) / expected
                })
                .sum();
            assert!(chi2 < 72.1, "{energy_ev} eV: chi-square {chi2}");
        }
    }

    #[test]
    fn law_deflected_directions_keep_angle_and_length() {
        let mut random = RandomStreams::new(2, 0, "compton").stream("turns", 0);
        for _ in 0..1000 {
            let before = isotropic(&mut random);
            let cos_angle = 2.0 * random.random::<f64>() - 1.0;
            let after = deflected(&before, cos_angle, &mut random);
            assert!((after.norm() - 1.0).abs() < 1e-12);
            assert!((after.dot(&before) - cos_angle).abs() < 1e-12);
        }
        for pole in [Vector3::z(), -Vector3::z()] {
            assert!((deflected(&pole, 0.5, &mut random).dot(&pole) - 0.5).abs() < 1e-12);
        }
    }
}
