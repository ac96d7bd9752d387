//! Filters that fuse measurements of any modality into one belief about the capsule.
//!
//! A filter knows the seam (`lumenav-core`) and nothing else: no sensor, no anatomy, no truth. It consumes
//! [`Measurement`](lumenav_core::Measurement)s in any order of arrival and keeps a belief over pose, velocity, angular
//! rate, run-time nuisance blocks and stochastic clones.
//!
//! [`Filter`] is what every filter does, [`FILTERS`] those that a scenario can ask for by name, [`Eskf`] the error-state
//! extended Kalman filter. The crate's rooms: [`belief`] (state, covariance, prediction),
//! [`compress`] and [`update`] (one low-rank update for residual and information form alike), [`gate`] (chi-square),
//! [`filter`] (trait and names), [`eskf`] (the event log: delays, replay, start, loss and re-acquisition), [`options`] (what a user may set).

pub mod belief;
pub mod compress;
mod dense;
pub mod eskf;
pub mod filter;
pub mod gate;
pub mod options;
pub mod update;

pub use belief::Belief;
pub use eskf::Eskf;
pub use filter::{
    Counters, FILTERS, Filter, FilterKind, FilterSetup, Hindsight, Offered, Refused, Turn, Verdict, build,
    kind_of,
};
pub use lumenav_core::MotionModel;
pub use options::{EskfOptions, PriorOptions};
