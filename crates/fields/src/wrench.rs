//! Force and torque on a magnet in a field.
//!
//! ```text
//! any field:     tau = m x B                     f = grad(m.B) = G^T m          (G = dB/dpoint)
//! two dipoles:   tau = mu0/(4 pi r^3) m_c x (D m_E)                              D = 3 p^ p^T - I
//!                f   = 3 mu0/(4 pi r^4) (m_E m_c^T + m_c m_E^T + (m_c^T Z m_E) I) p^     Z = I - 5 p^ p^T
//! ```
//!
//! `p` points from the external magnet E to the capsule's magnet c; the wrench acts on c, about c's centre. By
//! reaction, the external magnet feels `-f` and `-(tau + p x f)` about its own centre. Neglected: the size of the
//! magnet that feels the field (it is a point dipole here); the other one may be exact (`G` of any source).
//!
//! Source: taddese2018, section 7.

use nalgebra::{Matrix3, Vector3};

use crate::dipole::{FluxJacobian, MU0_OVER_4PI};

/// Force and torque, in the frame of the vectors that gave them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// Force, N.
    pub force_n: Vector3<f64>,
    /// Torque about the centre of the magnet that feels the field, N m.
    pub torque_n_m: Vector3<f64>,
}

/// Wrench on a dipole of moment `moment_a_m2` where the flux is `flux_tesla` with gradient
/// `gradient_tesla_per_m` (dB/dpoint, row = component of B).
pub fn dipole_in_field(
    moment_a_m2: &Vector3<f64>,
    flux_tesla: &Vector3<f64>,
    gradient_tesla_per_m: &Matrix3<f64>,
) -> Wrench {
    Wrench { force_n: gradient_tesla_per_m.tr_mul(moment_a_m2), torque_n_m: moment_a_m2.cross(flux_tesla) }
}

/// [`dipole_in_field`] with what [`crate::FieldSource::flux_and_jacobian`] returns.
pub fn dipole_in_source_field(moment_a_m2: &Vector3<f64>, field: &FluxJacobian) -> Wrench {
    dipole_in_field(moment_a_m2, &field.flux_tesla, &field.d_flux_d_offset)
}

/// Wrench on the dipole `moment_capsule_a_m2` at `offset_m` (capsule minus external magnet) from the dipole
/// `moment_external_a_m2`. Not a number at zero distance.
pub fn dipole_on_dipole(
    moment_external_a_m2: &Vector3<f64>,
    moment_capsule_a_m2: &Vector3<f64>,
    offset_m: &Vector3<f64>,
) -> Wrench {
    let (external, capsule) = (moment_external_a_m2, moment_capsule_a_m2);
    let inverse_r = 1.0 / offset_m.norm();
    let inverse_r3 = inverse_r * inverse_r * inverse_r;
    let direction = offset_m * inverse_r;
    let (external_along, capsule_along) = (external.dot(&direction), capsule.dot(&direction));
    let reflected = direction * (3.0 * external_along) - external;
    let isotropic = capsule.dot(external) - 5.0 * capsule_along * external_along;
    Wrench {
        torque_n_m: capsule.cross(&reflected) * (MU0_OVER_4PI * inverse_r3),
        force_n: (external * capsule_along + capsule * external_along + direction * isotropic)
            * (3.0 * MU0_OVER_4PI * inverse_r3 * inverse_r),
    }
}
