//! From lines to poses.
