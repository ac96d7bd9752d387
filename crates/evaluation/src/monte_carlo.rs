//! What many trials say: means with intervals, and whether one track is better than another on the same
//! seeds.
//!
//! Trials of a study share their seeds: seed k gives every track the same gut, capsule motion and sensor
//! noise. So tracks are compared *seed by seed* ([`paired`]); the differences scatter far less than the
//! errors themselves. Intervals are bias-corrected and accelerated bootstrap intervals ([`bootstrap`]), which
//! assume no shape of the distribution; the test beside them is the signed-rank test of Wilcoxon, corrected
//! by Holm when several comparisons are made at once ([`signed_rank`]).
//!
//! A figure per trial goes in (its RMSE, say), never the updates of one trial: those are correlated, and an
//! interval over them is far too narrow.
//!
//! Randomness is passed in; equal generators give equal intervals.

pub mod bootstrap;
pub mod paired;
pub mod signed_rank;
