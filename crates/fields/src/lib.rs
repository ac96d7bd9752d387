//! Static magnetic fields of magnets and coils: flux density, exact derivatives, forces.
//!
//! Physics without plugins, files or noise. A magnet in a capsule seen by sensors around the body and a magnet
//! and coil outside seen by sensors in a capsule are the same question here: the flux density B at an offset
//! from a source whose axis points somewhere.
//!
//! | module | what |
//! |---|---|
//! | [`source`] | [`FieldSource`]: dipole or cylinder, flux and derivatives by offset and axis in world coordinates |
//! | [`dipole`] | the point dipole, with derivatives |
//! | [`cylinder`] | the exact finite cylinder (magnet or coil), field and gradient, scalar and batch |
//! | [`multipole`] | its far-field series |
//! | [`elliptic`] | Bulirsch's general complete elliptic integral |
//! | [`wrench`] | force and torque on a dipole |
//!
//! Conventions: SI; `offset_m` = sensor minus source; a Jacobian's row is the component of B. Results have the
//! same bytes on every processor (no fused multiply-add) and in every batch.
//!
//! Not covered: soft-magnetic parts, eddy currents, retardation, transversely magnetised cylinders.

#![allow(
    clippy::inline_always,
    reason = "code that runs in SIMD registers has to be inlined into the function that enables them"
)]

pub mod cylinder;
pub mod dipole;
pub mod elliptic;
mod error;
mod kernel;
mod lanes;
pub mod multipole;
pub mod source;
pub mod wrench;

pub use cylinder::{Cylinder, GradientSlices};
pub use dipole::FluxJacobian;
pub use error::FieldError;
pub use source::FieldSource;
pub use wrench::Wrench;
