//! Covariance of a line offset.
