//! What a user does, with the program of the tests' profile.

use crate::support::{Run, data_or_skip, lumenav, root, scratch};
use lumenav::report::{Metrics, read_json};

#[test]
fn law_run_writes_what_the_readme_promises() {
    let folder = scratch();
    let out = folder.path().join("run");
    let printed = Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).ok();
    assert!(printed.contains("magnetic-eskf"), "{printed}");
    for name in [
        "manifest.json",
        "metrics.json",
        "timing.json",
        "tracks.parquet",
        "truth.tum",
        "magnetic.tum",
        "magnetic-eskf.tum",
        "events.jsonl",
        "recording.rrd",
    ] {
        assert!(out.join(name).is_file(), "{name} is missing");
    }
    let metrics: Metrics = read_json(&out.join("metrics.json")).expect("the contract");
    assert_eq!((metrics.schema, metrics.seed), (1, 1));
    let track = &metrics.tracks["magnetic-eskf"];
    let error = track.position_error_mm.as_ref().expect("there is a truth");
    assert!(error.mean > 0.0 && error.mean < 10.0, "{error:?}");
    assert!(track.availability.is_some_and(|a| a > 0.9));
}

#[test]
fn law_metrics_keep_the_contract() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).ok();
    let text = std::fs::read_to_string(out.join("metrics.json")).expect("written");
    for key in [
        "\"schema\"",
        "\"scenario\"",
        "\"seed\"",
        "\"duration_s\"",
        "\"tracks\"",
        "\"position_error_mm\"",
        "\"mean\"",
        "\"rmse\"",
        "\"median\"",
        "\"p95\"",
        "\"max\"",
        "\"attitude_error_deg\"",
        "\"heading_error_deg\"",
        "\"availability\"",
        "\"failed_updates\"",
        "\"updates\"",
        "\"nees\"",
        "\"dof\"",
        "\"inside_95\"",
        "\"verdict\"",
        "\"latency_ms\"",
        "\"time_to_first_fix_s\"",
    ] {
        assert!(text.contains(key), "metrics.json lacks {key}");
    }
}

#[test]
fn law_explain_says_what_happened_when_and_which_direction_was_weak() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/faults.toml")).out(&out).ok();
    let output = lumenav().arg("explain").arg(&out).output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout);
    // The dropout: about 30 s from 20 s on, with its reason.
    let gap =
        text.lines().find(|l| l.contains("no update for")).unwrap_or_else(|| panic!("no gap in:\n{text}"));
    assert!(gap.contains("dropout") && gap.trim_start().starts_with("19.9"), "{gap}");
    // The disturbance: refusals from 60 s on, by the gate or the front end.
    let burst = text
        .lines()
        .find(|l| l.contains("refused until") && l.trim_start().starts_with("60."))
        .unwrap_or_else(|| panic!("no burst at 60 s in:\n{text}"));
    assert!(burst.contains("chi-square"), "{burst}");
    assert!(text.contains("weakest") && text.contains("1 sigma"), "{text}");
}

#[test]
fn law_saved_readings_replay_to_the_same_tracks() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--save-readings").ok();
    let replay = folder.path().join("replay.toml");
    let text = format!(
        "[scenario]\nname = \"again\"\n[capsule]\nmodel = \"pillcam-magnet\"\n[[sensor]]\nname = \"plane\"\nmodality = \
         \"magnetic\"\n[sensor.installed]\narray = \"plane-4x4-below\"\n[sensor.files]\nflux_csv = \
         \"{}\"\n[[track]]\nname = \"magnetic\"\nsensors = [\"plane\"]\n[track.filter]\nkind = \"none\"\n",
        out.join("readings/plane.csv").display()
    );
    std::fs::write(&replay, text).expect("a scratch file");
    let again = folder.path().join("again");
    let output = lumenav()
        .args(["replay"])
        .arg(&replay)
        .arg("--out")
        .arg(&again)
        .arg("--models")
        .arg(root().join("models"))
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let track = |at: &std::path::Path| std::fs::read(at.join("magnetic.tum")).expect("a track");
    assert!(track(&out) == track(&again), "a replay of saved readings gives another track");
}

#[test]
fn law_every_shipped_scenario_and_model_is_right() {
    let mut check = lumenav();
    check.args(["scenarios", "check"]);
    for folder in ["scenarios", "scenarios/smoke"] {
        for entry in std::fs::read_dir(root().join(folder)).expect("shipped").filter_map(Result::ok) {
            if entry.path().extension().is_some_and(|e| e == "toml") {
                check.arg(entry.path());
            }
        }
    }
    let output = check.output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = lumenav().args(["models", "check"]).output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn law_export_writes_every_format() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).ok();
    for (format, file) in [
        ("tum", "magnetic.tum"),
        ("csv", "magnetic.csv"),
        ("kitti", "magnetic.kitti"),
        ("parquet", "tracks.parquet"),
    ] {
        let to = folder.path().join(format);
        let output = lumenav()
            .arg("export")
            .arg(&out)
            .args(["--format", format, "--out"])
            .arg(&to)
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(to.join(file).is_file(), "{format}");
    }
}

/// Recorded data: exact cylinder within 0.10 mm, dipole within 0.17 mm of the reference, which no estimator is told.
#[test]
fn published_magnet_patch_cylinder_and_dipole() {
    let Some(data) = data_or_skip("published_magnet_patch_cylinder_and_dipole") else { return };
    let folder = scratch();
    let out = folder.path().join("replay");
    let output = lumenav()
        .args(["replay", "scenarios/replay/magnet-patch.toml", "--out"])
        .arg(&out)
        .env("LUMENAV_DATA", data)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metrics: Metrics = read_json(&out.join("metrics.json")).expect("the contract");
    for (track, limit_mm) in [("cylinder", 0.10), ("dipole", 0.17)] {
        let t = &metrics.tracks[track];
        let error = t.position_error_mm.as_ref().expect("there is a reference");
        assert_eq!(t.updates, 189, "{track}: every pose of the three series is solved");
        assert!(error.mean <= limit_mm, "{track}: {} mm", error.mean);
    }
}
