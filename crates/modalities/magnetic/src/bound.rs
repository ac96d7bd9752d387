//! Fisher information and Cramér-Rao bound of an array that sees a magnet (moussakhani2012, with its equations corrected).
//!
//! Independent Gaussian noise of standard deviation σ per channel: `I = Σ_k g_k g_kᵀ / σ_k²` with g_k the derivative of the
//! channel's flux. Two parametrisations:
//!
//! - *known strength*: position and two tangent coordinates of the axis on the sphere (5 degrees of freedom; no pose is
//!   singular, unlike with polar angles);
//! - *unknown strength*: these and the relative change of the strength (6 parameters; the same bound as that of position and
//!   the three components of the moment).
//!
//! Columns are scaled to unit diagonal before inversion: metres and radians differ by orders of magnitude.

use crate::channels::{Channels, MagnetPose, Prediction};
use lumenav_core::pose::tangent_basis;
use lumenav_fields::FieldSource;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Square roots of the Cramér-Rao bound at one pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Covariance bound of the position in the world, m².
    pub position_m2: Matrix3<f64>,
    /// Bounds of the axis along the principal tangent directions, rad, smaller first.
    pub axis_rad: [f64; 2],
    /// Bound of the strength, relative to it; `None` where the strength is known.
    pub strength_relative: Option<f64>,
}

/// Bound of the magnet's position and axis; `None` where the information is singular (the bound is infinite).
pub fn bound(
    channels: &Channels,
    source: &FieldSource,
    magnet: &MagnetPose,
    sigma_tesla: f64,
    strength_known: bool,
) -> Option<Bound> {
    let mut prediction = Prediction::default();
    channels.predict(source, magnet, &mut prediction);
    let (e1, e2) = tangent_basis(&magnet.axis_world);
    let columns = if strength_known { 5 } else { 6 };
    let mut rows = DMatrix::zeros(channels.len(), columns);
    for k in 0..channels.len() {
        let (p, a) = (&prediction.by_position[k], &prediction.by_axis[k]);
        rows.view_mut((k, 0), (1, 3)).copy_from(&p.transpose());
        rows[(k, 3)] = a.dot(&e1);
        rows[(k, 4)] = a.dot(&e2);
        if !strength_known {
            // Relative change of the strength: the flux is proportional to it.
            rows[(k, 5)] = prediction.flux_tesla[k];
        }
    }
    rows /= sigma_tesla;
    let covariance = inverse_of_information(&rows)?;
    let tangent = covariance.fixed_view::<2, 2>(3, 3).into_owned().symmetric_eigenvalues();
    let (low, high) = (tangent.min().max(0.0).sqrt(), tangent.max().max(0.0).sqrt());
    Some(Bound {
        position_m2: covariance.fixed_view::<3, 3>(0, 0).into_owned(),
        axis_rad: [low, high],
        strength_relative: (!strength_known).then(|| covariance[(5, 5)].max(0.0).sqrt()),
    })
}

/// `(Jᵀ J)⁻¹` through the QR of the column-scaled J, which keeps twice the digits that the normal equations would.
pub fn inverse_of_information(jacobian: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = jacobian.ncols();
    if jacobian.nrows() < n {
        return None;
    }
    let scales: Vec<f64> = jacobian.column_iter().map(|c| c.norm()).collect();
    if scales.iter().any(|s| !s.is_finite() || *s <= 0.0) {
        return None;
    }
    let mut scaled = jacobian.clone();
    for (mut column, scale) in scaled.column_iter_mut().zip(&scales) {
        column /= *scale;
    }
    let r = scaled.qr().r();
    // A scaled column that the others explain to the last digits: nothing is known along it.
    if r.diagonal().iter().any(|d| d.abs() < 1e-12) {
        return None;
    }
    let inverse = r.solve_upper_triangular(&DMatrix::identity(n, n))?;
    let mut covariance = &inverse * inverse.transpose();
    for i in 0..n {
        for j in 0..n {
            covariance[(i, j)] /= scales[i] * scales[j];
        }
    }
    Some(covariance)
}

impl Bound {
    /// Square root of the bound along each world axis, m.
    pub fn position_sigma_m(&self) -> Vector3<f64> {
        self.position_m2.diagonal().map(|v| v.max(0.0).sqrt())
    }

    /// Square root of the trace, m.
    pub fn position_norm_m(&self) -> f64 {
        self.position_m2.trace().max(0.0).sqrt()
    }
}
