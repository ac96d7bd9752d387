//! From decays to lines.

pub mod compton;
pub mod isotope;
pub mod scintillator;

pub use isotope::Isotope;
pub use scintillator::Scintillator;
