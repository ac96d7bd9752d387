//! Far field of a cylinder or coil: multipole series, and its first term, the point dipole.
//!
//! ```text
//! phi = sum over odd l of C_l P_l(u) / r^(l+1),   u = z/r,   B = -grad phi
//! C_l = Br a^2 R0^l P'_(l+1)(b/R0) / ((l+1)(l+2)),   R0 = sqrt(a^2 + b^2);   C_1 = Br a^2 b / 2 = b_T
//!
//! B_z              =  sum (l+1)        C_l P_(l+1)(u)  / r^(l+2)
//! B_rho / rho      =  sum              C_l P'_(l+1)(u) / r^(l+3)
//! dB_z/dz          = -sum (l+1)(l+2)   C_l P_(l+2)(u)  / r^(l+3)
//! (dB_rho/dz)/rho  = -sum (l+1)        C_l P'_(l+2)(u) / r^(l+4)
//! ```
//!
//! Even terms vanish by symmetry. The series converges outside the sphere of radius R0 through the edges, each
//! further term by another `(R0/r)^2`. `C_l` is the integral of `r^l P_l` over the two charged faces, closed
//! with the identity `rho r^l P_l = -d/drho(rho d/drho r^(l+2) P_(l+2)) / ((l+1)(l+2))`; all terms of the
//! recursion behind it have one size, nothing cancels.
//!
//! Source: any text on potential theory (Jackson, *Classical Electrodynamics*, chapters 3 and 5); fixtures for
//! the permanent magnet and coil of taddese2018 in the tests.

use crate::kernel::{Axisymmetric, Constants};
use crate::lanes::Real;

/// Number of terms used beyond the switch radius: l = 1, 3, ..., 17.
pub(crate) const TERMS: usize = 9;

/// Distance R0 of the edges from the centre, m. Not `hypot`, whose last bit is the platform's own.
pub(crate) fn corner_distance_m(radius_m: f64, half_length_m: f64) -> f64 {
    (radius_m * radius_m + half_length_m * half_length_m).sqrt()
}

/// Derivative P'_n(u) of the Legendre polynomial.
fn legendre_derivative(n: usize, u: f64) -> f64 {
    let (mut previous, mut current) = (1.0, u);
    let (mut derivative_previous, mut derivative) = (0.0, 1.0);
    if n == 0 {
        return 0.0;
    }
    for k in 1..n {
        let k = k as f64;
        let next = ((2.0 * k + 1.0) * u * current - k * previous) / (k + 1.0);
        let derivative_next = derivative_previous + (2.0 * k + 1.0) * current;
        (previous, current) = (current, next);
        (derivative_previous, derivative) = (derivative, derivative_next);
    }
    derivative
}

/// Coefficient `C_l` in T m^(l+2) of a cylinder with the given radius, half length and (equivalent) remanence.
///
/// Zero for even `degree`. `C_1` is the dipole strength `b_T`.
pub fn coefficient(radius_m: f64, half_length_m: f64, remanence_tesla: f64, degree: usize) -> f64 {
    let corner_m = corner_distance_m(radius_m, half_length_m);
    let power = corner_m.powi(i32::try_from(degree).unwrap_or(i32::MAX));
    reduced_coefficient(radius_m, half_length_m, remanence_tesla, degree) * power
}

/// `C_l / R0^l`, T m^2: the coefficient without the power that would underflow for small magnets.
fn reduced_coefficient(radius_m: f64, half_length_m: f64, remanence_tesla: f64, degree: usize) -> f64 {
    if degree.is_multiple_of(2) {
        return 0.0;
    }
    let corner_m = corner_distance_m(radius_m, half_length_m);
    let derivative = legendre_derivative(degree + 1, half_length_m / corner_m);
    let l = degree as f64;
    remanence_tesla * radius_m * radius_m * derivative / ((l + 1.0) * (l + 2.0))
}

/// The reduced coefficients of degrees 1, 3, ..., 17.
pub(crate) fn reduced_coefficients(radius_m: f64, half_length_m: f64, remanence_tesla: f64) -> [f64; TERMS] {
    std::array::from_fn(|index| reduced_coefficient(radius_m, half_length_m, remanence_tesla, 2 * index + 1))
}

/// The series over [`Real`]; see the head of the file.
#[inline(always)]
pub(crate) fn far_field<R: Real, const GRADIENT: bool>(
    constants: &Constants,
    r2: R,
    z: R,
) -> Axisymmetric<R> {
    let one = z.constant(1.0);
    let zero = z.constant(0.0);
    let inverse_r2 = one / r2;
    let inverse_r = inverse_r2.sqrt();
    let u = z * inverse_r;
    let corner = z.constant(constants.corner_distance_m);
    let ratio = corner * inverse_r;
    let ratio2 = ratio * ratio;

    // Entering a term: P_l, P_(l+1), their derivatives.
    let (mut p0, mut p1) = (u, legendre_step(1, u, u, one));
    let (mut d0, mut d1) = (one, z.constant(3.0) * u);
    let mut power = ratio;
    let (mut axial, mut radial, mut axial_dz, mut radial_dz) = (zero, zero, zero, zero);
    for (index, &coefficient) in constants.multipoles.iter().enumerate() {
        let l = 2 * index + 1;
        let degree = l as f64;
        let term = power * z.constant(coefficient);
        axial = axial + term * z.constant(degree + 1.0) * p1;
        radial = radial + term * d1;
        let p2 = legendre_step(l + 1, u, p1, p0);
        let d2 = d0 + z.constant(2.0 * degree + 3.0) * p1;
        if GRADIENT {
            axial_dz = axial_dz + term * z.constant((degree + 1.0) * (degree + 2.0)) * p2;
            radial_dz = radial_dz + term * z.constant(degree + 1.0) * d2;
        }
        let p3 = legendre_step(l + 2, u, p2, p1);
        let d3 = d1 + z.constant(2.0 * degree + 5.0) * p2;
        (p0, p1, d0, d1) = (p2, p3, d2, d3);
        power = power * ratio2;
    }
    let inverse_r3 = inverse_r2 * inverse_r;
    Axisymmetric {
        radial_over_rho: radial * inverse_r3,
        axial: axial * inverse_r2,
        axial_dz: zero - axial_dz * inverse_r3,
        radial_dz_over_rho: zero - radial_dz * inverse_r2 * inverse_r2,
    }
}

/// P_(n+1)(u) from P_n and P_(n-1).
#[inline(always)]
fn legendre_step<R: Real>(n: usize, u: R, current: R, previous: R) -> R {
    let n = n as f64;
    u * current * u.constant((2.0 * n + 1.0) / (n + 1.0)) - previous * u.constant(n / (n + 1.0))
}
