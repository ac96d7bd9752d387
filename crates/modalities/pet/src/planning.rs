//! Before anything is swallowed: dose, activity, and how accurate the poses can be.
//!
//! | [`dose`] | dose rate, the bound for a resting capsule, what a transit leaves in the wall |
//! |---|---|
//! | [`activity`] | the smallest activity for a wanted rate of poses |
//! | [`sensitivity`] | lines per second of a source in a body, by solid angle and attenuation |
//! | [`accuracy`] | Fisher information of scanner, body and marker set at a pose |

pub mod accuracy;
pub mod activity;
pub mod dose;
pub mod sensitivity;

pub use accuracy::{Expected, Plan};
pub use activity::smallest_activity_bq;
pub use sensitivity::PhotonDetection;
