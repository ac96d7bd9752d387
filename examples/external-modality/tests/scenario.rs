//! The modality in a scenario: from the file through sensor, front end and filter to an error.

#[path = "../examples/run/errors.rs"]
mod errors;

use errors::TrackErrors;
use lumenav::pipeline::{Observers, simulate};
use lumenav::{default_registry, open_scenario, stage};
use lumenav_beacons::Beacons;
use std::path::Path;

/// Mean and worst error, mm, of the scenario's track with these overrides.
fn errors_mm(overrides: &[&str]) -> (f64, f64) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenario.toml");
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    let file = open_scenario(&path, &overrides, None).unwrap();
    let registry = default_registry().with(Beacons);
    let mut errors = TrackErrors::default();
    let mut observers = Observers::new(vec![&mut errors]);
    simulate(&file, &registry, 1, 0, stage(&file, 1, 0).unwrap(), &mut observers, &|| false).unwrap();
    let of = errors.tracks["beacons-eskf"];
    assert!(of.judged > 250, "{of:?}");
    (of.mean_mm(), of.worst_mm)
}

#[test]
fn regress_the_filter_tracks_to_a_millimetre_though_sound_is_faster_than_told() {
    let (mean_mm, worst_mm) = errors_mm(&[]);
    println!("figure: beacons: mean {mean_mm:.3} mm, worst {worst_mm:.3} mm");
    assert!(mean_mm < 1.5 && worst_mm < 6.0, "mean {mean_mm} mm, worst {worst_mm} mm");
    // A filter that may not learn the speed of sound is off by what the ratio makes of the paths.
    let (stiff_mm, _) = errors_mm(&["track.beacons-eskf.sensor.pingers.speed_ratio_sigma=1e-9"]);
    println!("figure: beacons, speed of sound not estimated: mean {stiff_mm:.3} mm");
    assert!(stiff_mm > mean_mm, "{stiff_mm} mm against {mean_mm} mm");
}

#[test]
fn law_a_program_without_the_plugin_says_so() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenario.toml");
    let file = open_scenario(&path, &[], None).unwrap();
    let error = lumenav::check(&file, &default_registry()).unwrap_err().to_string();
    assert!(error.contains("beacons") && error.contains("magnetic"), "{error}");
}
