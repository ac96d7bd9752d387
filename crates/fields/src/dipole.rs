//! Point dipole: flux density and its exact derivatives.
//!
//! ```text
//! B(d, h)   = b_T (3 (h.d) d / r^5 - h / r^3)                                        r = |d|
//! dB/dd     = 3 b_T / r^5 [ (h.d) I + d h^T + h d^T - 5 (h.d) d d^T / r^2 ]
//! dB/dh     = b_T (3 d d^T / r^5 - I / r^3)
//! ```
//!
//! `d` points from the magnet to the sensor, `h` is the magnet's axis, `b_T = mu0 |m| / (4 pi)` in T m^3
//! (for a magnet with remanence `Br` and volume `V`: `b_T = Br V / (4 pi)`). B is linear in `h`: the formulas
//! hold for any length of `h`, so six parameters with unknown strength use the same code. Any one frame
//! serves, as long as axis and offset share it.
//!
//! Neglected: the size of the magnet (see [`crate::cylinder`]). At `d = 0` no value exists; the result is not
//! a number there, nothing panics.
//!
//! Source: moussakhani2012, equations 1 to 3.

use nalgebra::{Matrix3, Vector3};

use crate::error::{FieldError, same_length};

/// Vacuum permeability over 4 pi, T m/A. `m mu0/(4 pi)` is the strength of a moment `m` (A m^2).
///
/// 1e-7 by the definition of the ampere before 2019; CODATA 2022 differs by 1.3e-10 relative, far below any
/// magnet's tolerance.
pub const MU0_OVER_4PI: f64 = 1.0e-7;

/// Flux density with its derivatives at one sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FluxJacobian {
    /// B at the sensor, T.
    pub flux_tesla: Vector3<f64>,
    /// dB/d(offset), T/m; row = component of B. Equal to dB/d(sensor position) and to -dB/d(source position).
    pub d_flux_d_offset: Matrix3<f64>,
    /// dB/d(axis), T per unit change of the axis vector; row = component of B.
    pub d_flux_d_axis: Matrix3<f64>,
}

impl Default for FluxJacobian {
    fn default() -> Self {
        Self {
            flux_tesla: Vector3::zeros(),
            d_flux_d_offset: Matrix3::zeros(),
            d_flux_d_axis: Matrix3::zeros(),
        }
    }
}

/// Strength `b_T` in T m^3 of a moment in A m^2.
pub fn strength_from_moment_t_m3(moment_a_m2: f64) -> f64 {
    MU0_OVER_4PI * moment_a_m2
}

/// Flux density in T at `offset_m` (sensor minus magnet) of a dipole along `axis_unit`.
#[inline]
pub fn flux_tesla(strength_t_m3: f64, axis_unit: &Vector3<f64>, offset_m: &Vector3<f64>) -> Vector3<f64> {
    let inverse_r2 = 1.0 / offset_m.norm_squared();
    let scale = strength_t_m3 * inverse_r2 * inverse_r2.sqrt();
    let along = 3.0 * axis_unit.dot(offset_m) * inverse_r2;
    (offset_m * along - axis_unit) * scale
}

/// Flux density (T) with its derivatives by offset (T/m) and by axis (T).
///
/// The derivative by the axis is that of the formula, linear in the axis: its product with the axis itself is
/// B. [`crate::FieldSource::flux_and_jacobian`] gives the one that is restricted to rotations.
#[inline]
pub fn flux_and_jacobian(
    strength_t_m3: f64,
    axis_unit: &Vector3<f64>,
    offset_m: &Vector3<f64>,
) -> FluxJacobian {
    let inverse_r2 = 1.0 / offset_m.norm_squared();
    let scale = strength_t_m3 * inverse_r2 * inverse_r2.sqrt();
    let projection = axis_unit.dot(offset_m);
    let outer = offset_m * offset_m.transpose();
    let mixed = offset_m * axis_unit.transpose();

    let flux_tesla = (offset_m * (3.0 * projection * inverse_r2) - axis_unit) * scale;
    let d_flux_d_offset = (Matrix3::from_diagonal_element(projection) + mixed + mixed.transpose()
        - outer * (5.0 * projection * inverse_r2))
        * (3.0 * scale * inverse_r2);
    let d_flux_d_axis = (outer * (3.0 * inverse_r2) - Matrix3::identity()) * scale;
    FluxJacobian { flux_tesla, d_flux_d_offset, d_flux_d_axis }
}

/// [`flux_tesla`] at many offsets, into the caller's buffer of the same length.
pub fn flux_batch(
    strength_t_m3: f64,
    axis_unit: &Vector3<f64>,
    offsets_m: &[Vector3<f64>],
    out_tesla: &mut [Vector3<f64>],
) -> Result<(), FieldError> {
    same_length("out_tesla", offsets_m.len(), out_tesla.len())?;
    for (out, offset_m) in out_tesla.iter_mut().zip(offsets_m) {
        *out = flux_tesla(strength_t_m3, axis_unit, offset_m);
    }
    Ok(())
}

/// [`flux_and_jacobian`] at many offsets, into the caller's buffer of the same length.
pub fn flux_and_jacobian_batch(
    strength_t_m3: f64,
    axis_unit: &Vector3<f64>,
    offsets_m: &[Vector3<f64>],
    out: &mut [FluxJacobian],
) -> Result<(), FieldError> {
    same_length("out", offsets_m.len(), out.len())?;
    for (out, offset_m) in out.iter_mut().zip(offsets_m) {
        *out = flux_and_jacobian(strength_t_m3, axis_unit, offset_m);
    }
    Ok(())
}
