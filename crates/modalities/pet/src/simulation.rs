//! From decays to lines.

pub mod block;
pub mod compton;
pub mod isotope;
pub mod photon;
pub mod scintillator;

pub use block::{BlockPhysics, Deposit};
pub use isotope::Isotope;
pub use photon::{Body, Photon};
pub use scintillator::Scintillator;
