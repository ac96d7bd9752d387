//! PET-marker tracking: three or more positron emitters in the capsule's cover, coincidence detectors around the body.
//!
//! Each annihilation sends two 511 keV photons apart at almost 180 degrees; two crystals that fire together give one *line of
//! response* (LoR). A window of 50 ms holds a few hundred lines, most of them true, some scattered or random, none labelled. The
//! trackers turn one window into the markers' positions and with them the capsule's pose in six degrees of freedom. The rooms:
//!
//! | physics | [`scanner`] (blocks, crystals, index ↔ position), [`markers`], [`simulation`] (from decays to lines) |
//! |---|---|
//! | estimators | [`line`], [`tracking`] (`fcm`, `rigid`, `mixture`), [`planning`] (dose, activity, expected accuracy) |
//! | files | [`reader`] |
//!
//! Source: T. D. Than, *Localization and tracking of robotic endoscopic capsules using multiple positron emission markers*, PhD
//! thesis, University of Wollongong, 2015 (`than2015`), with its slips corrected where a file's head says so.

pub mod line;
pub mod markers;
pub mod payload;
pub mod planning;
pub mod reader;
pub mod scanner;
pub mod simulation;
pub mod tracking;

pub use line::Line;
pub use markers::{Marker, MarkerSet};
pub use scanner::{CrystalIndex, Scanner};
