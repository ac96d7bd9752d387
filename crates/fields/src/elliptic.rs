//! Bulirsch's general complete elliptic integral.
//!
//! ```text
//! cel(kc, p, c, s) = integral over 0..pi/2 of (c cos^2 + s sin^2) / ((cos^2 + p sin^2) sqrt(cos^2 + kc^2 sin^2))
//! K = cel(kc, 1, 1, 1)    E = cel(kc, 1, 1, kc^2)    Pi(n) = cel(kc, 1 - n, 1, 1)
//! ```
//!
//! Iterated with the arithmetic-geometric mean: each step squares the relative difference of the two means,
//! so about six steps do for any modulus that is not extreme. [`crate::cylinder`] does not call this function
//! in its hot loop (it shares one mean between three integrals and avoids their cancellations) and is tested
//! against it.
//!
//! Source: R. Bulirsch, *Numerical calculation of elliptic integrals and elliptic functions III*, Numer. Math.
//! 13 (1969); the form with four arguments as in derby2010.

/// Relative difference of the two means at which their mean is exact to double precision: what is left is its
/// square.
const CONVERGED: f64 = 1.0e-8;

/// `cel(kc, p, c, s)` with the complementary modulus `kc` (its sign does not matter).
///
/// For negative `p` it is the Cauchy principal value. The integral diverges at `kc = 0` and at `p = 0` (unless
/// `s` is zero there); the result is then not a number. Arguments that are not numbers give not a number.
pub fn cel(kc: f64, p: f64, c: f64, s: f64) -> f64 {
    if kc == 0.0 || p == 0.0 || !(kc.is_finite() && p.is_finite() && c.is_finite() && s.is_finite()) {
        return f64::NAN;
    }
    let mut kc = kc.abs();
    let (mut p, mut c, mut s) = positive_parameter(kc, p, c, s);
    let mut mean = 1.0;
    let mut product = kc;
    loop {
        let previous_c = c;
        c += s / p;
        let ratio = product / p;
        s = 2.0 * (s + previous_c * ratio);
        p += ratio;
        let previous_mean = mean;
        mean += kc;
        if (previous_mean - kc).abs() <= previous_mean * CONVERGED {
            return std::f64::consts::FRAC_PI_2 * (s + c * mean) / (mean * (mean + p));
        }
        kc = 2.0 * product.sqrt();
        product = kc * mean;
    }
}

/// The start values of the iteration: `sqrt(p)` for positive p; a negative p is mapped to an integral with a
/// positive one (Bulirsch 1969, the principal value).
fn positive_parameter(kc: f64, p: f64, c: f64, s: f64) -> (f64, f64, f64) {
    if p > 0.0 {
        let root = p.sqrt();
        return (root, c, s / root);
    }
    let kc2 = kc * kc;
    let one_minus_p = 1.0 - p;
    let root = ((kc2 - p) / one_minus_p).sqrt();
    let mapped_c = (c - s) / one_minus_p;
    let principal = (1.0 - kc2) * (s - c * p) / (one_minus_p * one_minus_p * root);
    (root, mapped_c, mapped_c * root - principal)
}
