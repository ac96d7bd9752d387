//! From decays to lines.
