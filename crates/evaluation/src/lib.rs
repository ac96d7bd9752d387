//! Lumenav evaluation.
pub mod error;
pub mod pose_error;
pub mod summary;
pub mod trajectory;
