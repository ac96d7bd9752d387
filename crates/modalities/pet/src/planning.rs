//! Planning: dose, smallest activity, expected accuracy.
