//! The trackers on seeded windows: consistency, marker sets of all shapes, misuse, independent points.

#![allow(dead_code, reason = "one support file for tests, benches and the table of examples")]

mod consistency;
mod doubt;
mod edge;
mod few_lines;
mod field;
mod misuse;
mod parallax;
mod points;
mod shapes;
mod share;
mod starts;
mod support;
