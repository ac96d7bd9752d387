//! The recording that the repository ships, made anew and compared.

use crate::support::{Run, root, scratch};
use lumenav::recording::inspect;

/// `viewer-recordings/helix-magnetic.rrd` is what its README's command makes: same entities, timelines and rows.
#[test]
fn regress_the_shipped_recording_is_what_its_command_makes() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/helix-magnetic.toml"))
        .out(&out)
        .arg("--set")
        .arg("scenario.duration_s=10")
        .ok();
    let stored = root().join("viewer-recordings/helix-magnetic.rrd");
    let size = std::fs::metadata(&stored).expect("the recording is shipped").len();
    assert!(size < 3_000_000, "a shipped recording stays below 3 MB: {size} bytes");
    let (made, kept) = (inspect(&out.join("recording.rrd")), inspect(&stored));
    let (made, kept) = (made.expect("a recording"), kept.expect("a recording"));
    assert_eq!(made.rows, kept.rows);
    assert_eq!(made.timelines, kept.timelines);
    for entity in [
        "/world/capsule/truth",
        "/world/sensors/plane/magnetometers",
        "/world/tracks/magnetic/pose",
        "/world/tracks/magnetic-eskf/path",
        "/plots/error/magnetic-eskf",
        "/plots/nees/magnetic-eskf",
    ] {
        assert!(kept.rows.contains_key(entity), "{entity} is missing; there are: {:?}", kept.rows.keys());
    }
}
