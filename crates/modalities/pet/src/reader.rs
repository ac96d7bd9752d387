//! Recorded lines of response.
