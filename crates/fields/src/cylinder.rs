//! Finite cylinder: an axially magnetised magnet or a coil (ideal solenoid), exact field and gradient.
//!
//! Source frame: origin in the middle, z along the axis (direction of magnetisation). Radius a, length 2b.
//!
//! ```text
//! B_rho = B0 [alpha+ C(k+, 1, 1, -1) - alpha- C(k-, 1, 1, -1)]
//! B_z   = B0 a/(a + rho) [beta+ C(k+, g^2, 1, g) - beta- C(k-, g^2, 1, g)]
//! z+- = z +- b,  alpha+- = a/sqrt(z+-^2 + (rho + a)^2),  beta+- = z+-/sqrt(z+-^2 + (rho + a)^2)
//! g = (a - rho)/(a + rho),  k+-^2 = (z+-^2 + (a - rho)^2)/(z+-^2 + (a + rho)^2)
//! B0 = Br/pi for a magnet, mu0 n I/pi for a coil with n turns per metre
//! ```
//!
//! `crate::kernel` evaluates them without the cancellations of the printed form, and hands over to the
//! multipole series ([`crate::multipole`]) beyond eight corner distances `sqrt(a^2 + b^2)`.
//!
//! Gradient, with t = B_rho/rho, w = (dB_rho/dz)/rho, q = dB_z/dz, h = -(q + 2 t)/rho^2:
//!
//! ```text
//!     | t + h x^2   h x y      w x |
//! G = | h x y       t + h y^2  w y |      symmetric (curl B = 0), trace 0 (div B = 0)
//!     | w x         w y        q   |
//! ```
//!
//! **Inside and on the surface.** The value is B of the current sheet, which holds inside as well (there
//! H = (B - J)/mu0 with J = Br z for a magnet). On the mantle (rho = a exactly, |z| < b) B_z is the mean of its
//! two limits. On the edge B_rho and the gradient diverge; evaluation there returns the value at a distance
//! of about 1e-14 (a + rho), finite. A point that is not finite gives not a number. Nothing panics.
//!
//! Neglected: permeability of the magnet (mu_r = 1.05 of NdFeB changes the far field by under 1 per cent, which
//! a fitted remanence absorbs), the coil's winding thickness and helix, its return leads.
//!
//! Source: derby2010 (N. Derby, S. Olbert, *Cylindrical magnets and ideal solenoids*, Am. J. Phys. 78, 2010).

use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};

use crate::dipole::MU0_OVER_4PI;
use crate::error::{FieldError, finite, positive, same_length};
use crate::kernel::{Axisymmetric, Constants, field};
use crate::lanes::{Lanes, Real};
use crate::multipole::{corner_distance_m, reduced_coefficients};

/// A cylinder magnetised along its axis, or the coil with the same field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    constants: Constants,
}

/// The buffers of [`Cylinder::gradient_batch`]: the six different elements of the symmetric gradient, T/m.
#[derive(Debug)]
pub struct GradientSlices<'a> {
    /// dB_x/dx
    pub xx: &'a mut [f64],
    /// dB_x/dy = dB_y/dx
    pub xy: &'a mut [f64],
    /// dB_x/dz = dB_z/dx
    pub xz: &'a mut [f64],
    /// dB_y/dy
    pub yy: &'a mut [f64],
    /// dB_y/dz = dB_z/dy
    pub yz: &'a mut [f64],
    /// dB_z/dz
    pub zz: &'a mut [f64],
}

impl Cylinder {
    /// A cylinder of the given **radius** and **half** length with (equivalent) remanence.
    ///
    /// # Errors
    /// Sizes that are not positive and finite, a remanence that is not finite (it may be negative or zero).
    pub fn new(radius_m: f64, half_length_m: f64, remanence_tesla: f64) -> Result<Self, FieldError> {
        positive("radius_m", radius_m)?;
        positive("half_length_m", half_length_m)?;
        finite("remanence_tesla", remanence_tesla)?;
        let constants = Constants {
            radius_m,
            half_length_m,
            remanence_tesla,
            multipoles: reduced_coefficients(radius_m, half_length_m, remanence_tesla),
            corner_distance_m: corner_distance_m(radius_m, half_length_m),
        };
        Ok(Self { constants })
    }

    /// A magnet of the given radius, full length and remanence.
    pub fn magnet(radius_m: f64, length_m: f64, remanence_tesla: f64) -> Result<Self, FieldError> {
        positive("length_m", length_m)?;
        Self::new(radius_m, 0.5 * length_m, remanence_tesla)
    }

    /// A coil of the given radius, full length, turns and current: equivalent remanence mu0 turns I / length.
    pub fn coil(radius_m: f64, length_m: f64, turns: f64, current_a: f64) -> Result<Self, FieldError> {
        positive("length_m", length_m)?;
        positive("turns", turns)?;
        finite("current_a", current_a)?;
        let mu0 = 4.0 * std::f64::consts::PI * MU0_OVER_4PI;
        Self::new(radius_m, 0.5 * length_m, mu0 * turns * current_a / length_m)
    }

    /// Radius, m.
    pub fn radius_m(&self) -> f64 {
        self.constants.radius_m
    }

    /// Half of the length, m.
    pub fn half_length_m(&self) -> f64 {
        self.constants.half_length_m
    }

    /// Remanence of the magnet, or mu0 n I of the coil, T.
    pub fn remanence_tesla(&self) -> f64 {
        self.constants.remanence_tesla
    }

    /// Strength `b_T = Br a^2 b / 2` of the dipole that this cylinder is from far away, T m^3.
    pub fn strength_t_m3(&self) -> f64 {
        let c = &self.constants;
        0.5 * c.remanence_tesla * c.radius_m * c.radius_m * c.half_length_m
    }

    /// Volume, m^3.
    pub fn volume_m3(&self) -> f64 {
        let c = &self.constants;
        2.0 * std::f64::consts::PI * c.radius_m * c.radius_m * c.half_length_m
    }

    /// B in T at a point, both in the source frame.
    pub fn flux_tesla(&self, point_source_m: &Vector3<f64>) -> Vector3<f64> {
        let p = point_source_m;
        let [x, y, z] = point_flux(&self.constants, p.x, p.y, p.z);
        Vector3::new(x, y, z)
    }

    /// dB/d(point) in T/m, row = component of B, both in the source frame.
    pub fn gradient(&self, point_source_m: &Vector3<f64>) -> Matrix3<f64> {
        self.flux_and_gradient(point_source_m).1
    }

    /// B in T and dB/d(point) in T/m from one evaluation.
    pub fn flux_and_gradient(&self, point_source_m: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let p = point_source_m;
        let ([bx, by, bz], [xx, xy, xz, yy, yz, zz]) = point_gradient(&self.constants, p.x, p.y, p.z);
        (Vector3::new(bx, by, bz), Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz))
    }

    /// B at many points of the source frame, coordinates and components in separate slices of one length (m, T).
    ///
    /// The same bytes as [`Cylinder::flux_tesla`] point by point. No allocation.
    pub fn flux_batch(
        &self,
        x_m: &[f64],
        y_m: &[f64],
        z_m: &[f64],
        out_x_tesla: &mut [f64],
        out_y_tesla: &mut [f64],
        out_z_tesla: &mut [f64],
    ) -> Result<(), FieldError> {
        let count = x_m.len();
        same_length("y_m", count, y_m.len())?;
        same_length("z_m", count, z_m.len())?;
        same_length("out_x_tesla", count, out_x_tesla.len())?;
        same_length("out_y_tesla", count, out_y_tesla.len())?;
        same_length("out_z_tesla", count, out_z_tesla.len())?;
        let points = [x_m, y_m, z_m];
        let flux = [out_x_tesla, out_y_tesla, out_z_tesla];
        Arch::new().dispatch(FluxBatch { constants: &self.constants, points, flux });
        Ok(())
    }

    /// B and its gradient at many points of the source frame (m, T, T/m); see [`Cylinder::flux_batch`].
    pub fn gradient_batch(
        &self,
        x_m: &[f64],
        y_m: &[f64],
        z_m: &[f64],
        out_flux_tesla: [&mut [f64]; 3],
        out_gradient: GradientSlices<'_>,
    ) -> Result<(), FieldError> {
        let count = x_m.len();
        same_length("y_m", count, y_m.len())?;
        same_length("z_m", count, z_m.len())?;
        for out in &out_flux_tesla {
            same_length("out_flux_tesla", count, out.len())?;
        }
        let GradientSlices { xx, xy, xz, yy, yz, zz } = out_gradient;
        let gradient = [xx, xy, xz, yy, yz, zz];
        for out in &gradient {
            same_length("out_gradient", count, out.len())?;
        }
        Arch::new().dispatch(GradientBatch {
            constants: &self.constants,
            points: [x_m, y_m, z_m],
            flux: out_flux_tesla,
            gradient,
        });
        Ok(())
    }

    /// The kernel at one point given by the squared distance from the axis and the height.
    pub(crate) fn axisymmetric<const GRADIENT: bool>(&self, rho2_m2: f64, z_m: f64) -> Axisymmetric<f64> {
        field::<f64, GRADIENT>(&self.constants, rho2_m2, z_m)
    }

    /// The kernel at up to [`BLOCK`] points.
    pub(crate) fn axisymmetric_block(&self, block: &mut Block) {
        Arch::new().dispatch(BlockBatch { constants: &self.constants, block });
    }
}

/// h = -(q + 2 t)/rho^2, zero on the axis within rounding of the other elements.
#[inline(always)]
pub(crate) fn radial_anisotropy<R: Real>(kernel: &Axisymmetric<R>, rho2: R) -> R {
    let sum = kernel.axial_dz + (kernel.radial_over_rho + kernel.radial_over_rho);
    // Any floor does: rho^2 h is multiplied by x^2, x y or y^2, which are below rho^2.
    let floor = rho2.constant(f64::MIN_POSITIVE);
    rho2.constant(0.0) - sum / rho2.at_least(floor)
}

#[inline(always)]
fn point_flux<R: Real>(constants: &Constants, x: R, y: R, z: R) -> [R; 3] {
    let kernel = field::<R, false>(constants, x * x + y * y, z);
    [x * kernel.radial_over_rho, y * kernel.radial_over_rho, kernel.axial]
}

#[inline(always)]
fn point_gradient<R: Real>(constants: &Constants, x: R, y: R, z: R) -> ([R; 3], [R; 6]) {
    let rho2 = x * x + y * y;
    let kernel = field::<R, true>(constants, rho2, z);
    let t = kernel.radial_over_rho;
    let h = radial_anisotropy(&kernel, rho2);
    let hx = h * x;
    let w = kernel.radial_dz_over_rho;
    let flux = [x * t, y * t, kernel.axial];
    (flux, [t + hx * x, hx * y, w * x, t + h * y * y, w * y, kernel.axial_dz])
}

/// One call of [`Cylinder::flux_batch`]. All slices have one length.
struct FluxBatch<'a> {
    constants: &'a Constants,
    points: [&'a [f64]; 3],
    flux: [&'a mut [f64]; 3],
}

impl WithSimd for FluxBatch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [(x, x_rest), (y, y_rest), (z, z_rest)] = self.points.map(S::as_simd_f64s);
        let [(bx, bx_rest), (by, by_rest), (bz, bz_rest)] = self.flux.map(S::as_mut_simd_f64s);
        for ((point, bx), (by, bz)) in x.iter().zip(y).zip(z).zip(bx).zip(by.iter_mut().zip(bz)) {
            let ((&x, &y), &z) = point;
            let [x, y, z] = [x, y, z].map(|values| Lanes::new(simd, values));
            let flux = point_flux(self.constants, x, y, z);
            (*bx, *by, *bz) = (flux[0].values, flux[1].values, flux[2].values);
        }
        for index in 0..x_rest.len() {
            let flux = point_flux(self.constants, x_rest[index], y_rest[index], z_rest[index]);
            (bx_rest[index], by_rest[index], bz_rest[index]) = (flux[0], flux[1], flux[2]);
        }
    }
}

/// One call of [`Cylinder::gradient_batch`]. All slices have one length.
struct GradientBatch<'a> {
    constants: &'a Constants,
    points: [&'a [f64]; 3],
    flux: [&'a mut [f64]; 3],
    gradient: [&'a mut [f64]; 6],
}

impl WithSimd for GradientBatch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [(x, x_rest), (y, y_rest), (z, z_rest)] = self.points.map(S::as_simd_f64s);
        let mut flux = self.flux.map(S::as_mut_simd_f64s);
        let mut gradient = self.gradient.map(S::as_mut_simd_f64s);
        for (index, ((&x, &y), &z)) in x.iter().zip(y).zip(z).enumerate() {
            let [x, y, z] = [x, y, z].map(|values| Lanes::new(simd, values));
            let (b, g) = point_gradient(self.constants, x, y, z);
            for (out, value) in flux.iter_mut().zip(b) {
                out.0[index] = value.values;
            }
            for (out, value) in gradient.iter_mut().zip(g) {
                out.0[index] = value.values;
            }
        }
        for index in 0..x_rest.len() {
            let (b, g) = point_gradient(self.constants, x_rest[index], y_rest[index], z_rest[index]);
            for (out, value) in flux.iter_mut().zip(b) {
                out.1[index] = value;
            }
            for (out, value) in gradient.iter_mut().zip(g) {
                out.1[index] = value;
            }
        }
    }
}

/// Points per call of [`Cylinder::axisymmetric_block`]: a multiple of every register width in use.
pub(crate) const BLOCK: usize = 16;

/// A block of points in cylinder coordinates with room for the kernel's answer.
pub(crate) struct Block {
    pub(crate) rho2_m2: [f64; BLOCK],
    pub(crate) z_m: [f64; BLOCK],
    pub(crate) count: usize,
    pub(crate) radial_over_rho: [f64; BLOCK],
    pub(crate) axial: [f64; BLOCK],
    pub(crate) axial_dz: [f64; BLOCK],
    pub(crate) radial_dz_over_rho: [f64; BLOCK],
}

impl Block {
    pub(crate) fn new() -> Self {
        // Lanes that stay unused evaluate the centre of the source: harmless and cheap.
        let zero = [0.0; BLOCK];
        Self {
            rho2_m2: zero,
            z_m: zero,
            count: 0,
            radial_over_rho: zero,
            axial: zero,
            axial_dz: zero,
            radial_dz_over_rho: zero,
        }
    }

    pub(crate) fn get(&self, index: usize) -> Axisymmetric<f64> {
        Axisymmetric {
            radial_over_rho: self.radial_over_rho[index],
            axial: self.axial[index],
            axial_dz: self.axial_dz[index],
            radial_dz_over_rho: self.radial_dz_over_rho[index],
        }
    }
}

struct BlockBatch<'a> {
    constants: &'a Constants,
    block: &'a mut Block,
}

impl WithSimd for BlockBatch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let block = self.block;
        let used = block.count.div_ceil(S::F64_LANES) * S::F64_LANES;
        let (rho2, _) = S::as_simd_f64s(&block.rho2_m2[..used]);
        let (z, _) = S::as_simd_f64s(&block.z_m[..used]);
        let (radial, _) = S::as_mut_simd_f64s(&mut block.radial_over_rho);
        let (axial, _) = S::as_mut_simd_f64s(&mut block.axial);
        let (axial_dz, _) = S::as_mut_simd_f64s(&mut block.axial_dz);
        let (radial_dz, _) = S::as_mut_simd_f64s(&mut block.radial_dz_over_rho);
        for (index, (&rho2, &z)) in rho2.iter().zip(z).enumerate() {
            let kernel = field::<Lanes<S>, true>(self.constants, Lanes::new(simd, rho2), Lanes::new(simd, z));
            radial[index] = kernel.radial_over_rho.values;
            axial[index] = kernel.axial.values;
            axial_dz[index] = kernel.axial_dz.values;
            radial_dz[index] = kernel.radial_dz_over_rho.values;
        }
    }
}
