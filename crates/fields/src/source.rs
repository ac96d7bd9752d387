//! A field source of any kind as a sensor sees it: flux and its derivatives in world coordinates.
//!
//! The source is axially symmetric: its pose is a position and a unit axis. With `h` the axis, `d` the offset
//! (sensor minus source) and, for the cylinder, `z = h.d`, `v = d - z h` (t, q, w, and the anisotropy k as in
//! [`crate::cylinder`]):
//!
//! ```text
//! B = t v + B_z h
//! G = dB/dd = t (I - h h^T) + k v v^T + w (v h^T + h v^T) + q h h^T
//! dB/dh     = (G [d]x - (B)x) [h]x             turning the axis = turning the field and the point back
//! ```
//!
//! dB/dh is the derivative under rotations of the axis: `dB = (dB/dh) dh` for every `dh` perpendicular to `h`;
//! its product with `h` itself is zero, for the cylinder and the dipole alike. A change of strength is
//! `dB = B d(strength)/strength`.

use nalgebra::{Matrix3, Vector3};

use crate::cylinder::{BLOCK, Block, Cylinder, radial_anisotropy};
use crate::dipole::{self, FluxJacobian};
use crate::error::{FieldError, same_length};
use crate::kernel::Axisymmetric;

/// A source of a static (or slowly varying) magnetic field that is symmetric about its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldSource {
    /// A point dipole with `b_T` in T m^3.
    Dipole {
        /// `mu0 |m| / (4 pi)`, T m^3.
        strength_t_m3: f64,
    },
    /// A finite magnet or coil.
    Cylinder(Cylinder),
}

impl FieldSource {
    /// Dipole strength `b_T` in T m^3; for a cylinder that of its far field.
    pub fn strength_t_m3(&self) -> f64 {
        match self {
            Self::Dipole { strength_t_m3 } => *strength_t_m3,
            Self::Cylinder(cylinder) => cylinder.strength_t_m3(),
        }
    }

    /// B in T at `offset_m` = sensor - source, for the axis `axis_unit` (both in one frame, that of B).
    pub fn flux_tesla(&self, axis_unit: &Vector3<f64>, offset_m: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Dipole { strength_t_m3 } => dipole::flux_tesla(*strength_t_m3, axis_unit, offset_m),
            Self::Cylinder(cylinder) => {
                let (z_m, radial_m) = split(axis_unit, offset_m);
                let kernel = cylinder.axisymmetric::<false>(radial_m.norm_squared(), z_m);
                radial_m * kernel.radial_over_rho + axis_unit * kernel.axial
            }
        }
    }

    /// B with dB/d(offset) and dB/d(axis) (rotations only, see the head of this file).
    pub fn flux_and_jacobian(&self, axis_unit: &Vector3<f64>, offset_m: &Vector3<f64>) -> FluxJacobian {
        match self {
            Self::Dipole { strength_t_m3 } => dipole_jacobian(*strength_t_m3, axis_unit, offset_m),
            Self::Cylinder(cylinder) => {
                let (z_m, radial_m) = split(axis_unit, offset_m);
                let rho2_m2 = radial_m.norm_squared();
                let kernel = cylinder.axisymmetric::<true>(rho2_m2, z_m);
                cylinder_jacobian(&kernel, axis_unit, offset_m, &radial_m, rho2_m2)
            }
        }
    }

    /// [`FieldSource::flux_and_jacobian`] at many sensors, the same bytes, into the caller's buffer.
    pub fn flux_and_jacobian_batch(
        &self,
        axis_unit: &Vector3<f64>,
        offsets_m: &[Vector3<f64>],
        out: &mut [FluxJacobian],
    ) -> Result<(), FieldError> {
        same_length("out", offsets_m.len(), out.len())?;
        match self {
            Self::Dipole { strength_t_m3 } => {
                for (out, offset_m) in out.iter_mut().zip(offsets_m) {
                    *out = dipole_jacobian(*strength_t_m3, axis_unit, offset_m);
                }
            }
            Self::Cylinder(cylinder) => {
                for (out, offsets_m) in out.chunks_mut(BLOCK).zip(offsets_m.chunks(BLOCK)) {
                    cylinder_block(cylinder, axis_unit, offsets_m, out);
                }
            }
        }
        Ok(())
    }
}

/// Height above the middle plane and the part of the offset perpendicular to the axis.
#[inline]
fn split(axis_unit: &Vector3<f64>, offset_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let z_m = axis_unit.dot(offset_m);
    (z_m, offset_m - axis_unit * z_m)
}

/// The dipole's derivatives, that by the axis restricted to rotations.
fn dipole_jacobian(strength_t_m3: f64, axis_unit: &Vector3<f64>, offset_m: &Vector3<f64>) -> FluxJacobian {
    let mut out = dipole::flux_and_jacobian(strength_t_m3, axis_unit, offset_m);
    out.d_flux_d_axis -= out.flux_tesla * axis_unit.transpose();
    out
}

/// World-frame flux and derivatives from the kernel's four numbers.
#[inline]
fn cylinder_jacobian(
    kernel: &Axisymmetric<f64>,
    axis_unit: &Vector3<f64>,
    offset_m: &Vector3<f64>,
    radial_m: &Vector3<f64>,
    rho2_m2: f64,
) -> FluxJacobian {
    let t = kernel.radial_over_rho;
    let flux_tesla = radial_m * t + axis_unit * kernel.axial;
    let mixed = radial_m * axis_unit.transpose();
    let gradient = Matrix3::from_diagonal_element(t)
        + axis_unit * axis_unit.transpose() * (kernel.axial_dz - t)
        + radial_m * radial_m.transpose() * radial_anisotropy(kernel, rho2_m2)
        + (mixed + mixed.transpose()) * kernel.radial_dz_over_rho;
    let d_flux_d_axis =
        (gradient * offset_m.cross_matrix() - flux_tesla.cross_matrix()) * axis_unit.cross_matrix();
    FluxJacobian { flux_tesla, d_flux_d_offset: gradient, d_flux_d_axis }
}

fn cylinder_block(
    cylinder: &Cylinder,
    axis_unit: &Vector3<f64>,
    offsets_m: &[Vector3<f64>],
    out: &mut [FluxJacobian],
) {
    let mut block = Block::new();
    block.count = offsets_m.len();
    let mut radials_m = [Vector3::zeros(); BLOCK];
    for (index, offset_m) in offsets_m.iter().enumerate() {
        (block.z_m[index], radials_m[index]) = split(axis_unit, offset_m);
        block.rho2_m2[index] = radials_m[index].norm_squared();
    }
    cylinder.axisymmetric_block(&mut block);
    for (index, (out, offset_m)) in out.iter_mut().zip(offsets_m).enumerate() {
        let kernel = block.get(index);
        *out = cylinder_jacobian(&kernel, axis_unit, offset_m, &radials_m[index], block.rho2_m2[index]);
    }
}
