//! The recording that the repository ships, made anew and compared.

use crate::support::{Run, root, scratch};
use lumenav::recording::inspect;

/// A recording in `viewer-recordings` is what its README's command makes: same entities, timelines and rows.
fn is_what_its_command_makes(name: &str, scenario: &str, settings: &[&str], entities: &[&str]) {
    let folder = scratch();
    let out = folder.path().join("run");
    let mut run = Run::new(&root().join(scenario)).out(&out);
    for setting in settings {
        run = run.arg("--set").arg(setting);
    }
    run.ok();
    let stored = root().join("viewer-recordings").join(name);
    let size = std::fs::metadata(&stored).expect("the recording is shipped").len();
    assert!(size < 3_000_000, "a shipped recording stays below 3 MB: {size} bytes");
    let (made, kept) = (inspect(&out.join("recording.rrd")), inspect(&stored));
    let (made, kept) = (made.expect("a recording"), kept.expect("a recording"));
    assert_eq!(made.rows, kept.rows);
    assert_eq!(made.timelines, kept.timelines);
    for entity in entities {
        assert!(kept.rows.contains_key(*entity), "{entity} is missing; there are: {:?}", kept.rows.keys());
    }
}

#[test]
fn regress_the_shipped_helix_is_what_its_command_makes() {
    is_what_its_command_makes(
        "helix-magnetic.rrd",
        "scenarios/helix-magnetic.toml",
        &["scenario.duration_s=10"],
        &[
            "/world/capsule/truth",
            "/world/sensors/plane/magnetometers",
            "/world/tracks/magnetic/pose",
            "/world/tracks/magnetic-eskf/path",
            "/plots/error/magnetic-eskf",
            "/plots/nees/magnetic-eskf",
        ],
    );
}

#[test]
fn regress_the_shipped_lines_are_what_their_command_makes() {
    is_what_its_command_makes(
        "colon-pet.rrd",
        "scenarios/colon-pet.toml",
        &["scenario.duration_s=3"],
        &[
            "/world/capsule/truth",
            "/world/tract/lumen",
            "/world/sensors/scanner/blocks",
            "/world/tracks/mixture/scanner/lines",
            "/world/tracks/pet-eskf/path",
            "/plots/nees/pet-eskf",
        ],
    );
}

#[test]
fn regress_the_shipped_swallow_is_what_its_command_makes() {
    is_what_its_command_makes(
        "whole-exam-swallow.rrd",
        "scenarios/whole-exam.toml",
        &["scenario.duration_s=30", "record.truth_rate_hz=10", "record.scene_rate_hz=2"],
        &[
            "/world/tract/lumen",
            "/world/tract/contraction",
            "/world/capsule/path",
            "/plots/along_tract/truth",
            "/segment",
            "/events/notes",
        ],
    );
}
