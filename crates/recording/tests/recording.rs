//! A recording is what the run was: read back, compared, measured.

#![expect(clippy::disallowed_types, reason = "world side: the test plays a world")]

#[path = "../../pipeline/tests/synthetic/mod.rs"]
mod synthetic;

use lumenav_pipeline::RunObserver as _;
use lumenav_recording::{RecorderOptions, RrdRecorder, inspect, read_scalars};
use std::path::Path;

/// Records the synthetic run; the path.
fn record(folder: &Path, name: &str, duration_s: f64, rate_hz: f64, full: bool) -> std::path::PathBuf {
    let path = folder.join(name);
    let mut recorder = RrdRecorder::to_file(&path, RecorderOptions { full }).unwrap();
    synthetic::play(&mut recorder, duration_s, rate_hz, &["magnetic", "pet"]).unwrap();
    path
}

#[test]
fn law_every_documented_entity_is_there_with_its_rows() {
    let folder = tempfile::tempdir().unwrap();
    let summary = inspect(&record(folder.path(), "a.rrd", 60.0, 20.0, false)).unwrap();
    assert_eq!(summary.application, "lumenav");
    assert_eq!(summary.recording, "helix-seed7-trial0");
    assert_eq!(summary.timelines.iter().map(String::as_str).collect::<Vec<_>>(), ["sim_time", "update"]);
    assert!(summary.blueprint_rows > 20);
    let rows =
        |path: &str| *summary.rows.get(path).unwrap_or_else(|| panic!("{path} is missing: {summary:#?}"));
    // 60 s at 10 Hz, and one row for the solid.
    assert_eq!(rows("/world/capsule/truth"), 601);
    // Two seconds of refusals leave a gap of 20 rows.
    assert_eq!(rows("/world/tracks/magnetic/pose"), 581);
    assert_eq!(rows("/world/tracks/magnetic/covariance"), 581);
    // One more where the line is broken at the gap.
    assert_eq!(rows("/plots/error/pet"), 582);
    assert_eq!(rows("/plots/nees/pet"), 582);
    assert_eq!(rows("/plots/along_tract/pet"), 581);
    assert_eq!(rows("/plots/along_tract/truth"), 601);
    assert_eq!(rows("/world/tract/lumen"), 1);
    assert_eq!(rows("/world/tract/centre_line"), 1);
    assert_eq!(rows("/world/sensors/belt/flux"), 600);
    // Unchanged: drawn once.
    assert_eq!(rows("/world/sensors/belt/places"), 1);
    // A burst of 40 refusals a track is two lines a track.
    assert_eq!(rows("/events/refusals"), 4);
    assert_eq!(rows("/events/notes"), 1);
    assert!((55..=65).contains(&rows("/world/capsule/path")));
    // Style, start and end.
    assert_eq!(rows("/plots/nees/band_5_dof"), 3);
}

#[test]
fn closed_form_plots_hold_the_errors_in_millimetres() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), "a.rrd", 10.0, 10.0, false);
    let error = read_scalars(&path, "/plots/error/magnetic").unwrap();
    assert_eq!(error.len(), 100);
    for (ns, mm) in error {
        let t = ns as f64 * 1e-9;
        let expected = ((1.7 * t).sin().powi(2) + (2.9 * t).cos().powi(2) + (0.8 * t).sin().powi(2)).sqrt();
        assert!((mm - expected).abs() < 1e-9, "{t} {mm} {expected}");
    }
}

#[test]
fn law_two_equal_runs_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let a = std::fs::read(record(folder.path(), "a.rrd", 20.0, 20.0, false)).unwrap();
    assert!(!a.is_empty());
    // More than twice: what comes out of a hash map in one of two orders would pass every other time.
    for _ in 0..8 {
        let b = std::fs::read(record(folder.path(), "b.rrd", 20.0, 20.0, false)).unwrap();
        assert!(a == b, "{} and {} bytes", a.len(), b.len());
    }
}

#[test]
fn law_the_size_stays_within_its_budget() {
    let folder = tempfile::tempdir().unwrap();
    let size = |path: &Path| std::fs::metadata(path).unwrap().len() as f64 / 1e6;
    let short = size(&record(folder.path(), "short.rrd", 60.0, 100.0, false));
    let full = size(&record(folder.path(), "full.rrd", 60.0, 100.0, true));
    println!("60 s: {short:.2} MB, full {full:.2} MB");
    assert!(short < 20.0 && short < full);
    let exam = record(folder.path(), "exam.rrd", 28_800.0, 2.0, false);
    println!("8 h: {:.2} MB", size(&exam));
    assert!(size(&exam) < 60.0);
    let summary = inspect(&exam).unwrap();
    assert!(summary.rows["/world/capsule/truth"] > 3_000);
}

#[test]
fn law_full_keeps_every_row() {
    let folder = tempfile::tempdir().unwrap();
    let summary = inspect(&record(folder.path(), "a.rrd", 10.0, 100.0, true)).unwrap();
    assert_eq!(summary.rows["/world/capsule/truth"], 1001);
    assert_eq!(summary.rows["/plots/error/pet"], 1001);
}

#[test]
fn law_a_run_that_does_not_finish_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rrd");
    let mut recorder = RrdRecorder::to_file(&path, RecorderOptions::default()).unwrap();
    recorder.start(&synthetic::header(1.0, &["magnetic"])).unwrap();
    drop(recorder);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn law_errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "no recording").unwrap();
    let error =
        RrdRecorder::to_file(&file.join("a.rrd"), RecorderOptions::default()).err().unwrap().to_string();
    assert!(error.starts_with("cannot create ") && error.contains("a.rrd"), "{error}");
    let error = inspect(&file).unwrap_err().to_string();
    assert!(error.contains("file is not a readable recording"), "{error}");
    let error =
        RrdRecorder::to_viewer("not an address", RecorderOptions::default()).err().unwrap().to_string();
    assert!(error.starts_with("`not an address` is not a viewer's address"), "{error}");
}
