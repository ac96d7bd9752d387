//! Integration tests of the whole project, one binary; one module per promise.

// Crates may know only what they may; estimators cannot reach the truth.
mod architecture;
// Every key of a source has its full reference.
mod bibliography;
// Bad input is refused with file, line, key; nothing half-written is left behind.
mod bad_input;
// Same scenario and seed, same bytes.
mod determinism;
// What a user does: run, replay, explain, export, view.
mod journeys;
// Layouts are judged, improved, compared.
mod layout;
// What late readings did is told.
mod late;
// The shipped recording is what its command makes.
mod recording;
// A controller moves a scanner after the capsule.
mod bed;
// Plugins outside the modality crates, through the filter, against committed numbers.
mod seam;
// What is observed later is what was there; worlds are taken up where they were left.
mod observe;
// Published claims and fixtures at the level of whole runs.
mod published;
// Arrays that are not as installed: carried, cancelled, calibrated.
mod unknowns;
// Filters start from data, never from truth.
mod truth_leak;

mod support;
