//! What a user does, with the program of the tests' profile.

use crate::support::{Run, data_or_skip, lumenav, root, scratch};
use lumenav::report::{Manifest, Metrics, read_json};
use std::path::Path;
use std::process::{Output, Stdio};

/// Starts the program with these arguments; it must succeed. What it said on stdout.
fn said<A: AsRef<std::ffi::OsStr>>(arguments: &[A]) -> String {
    let output = lumenav().args(arguments).output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Starts the program with these arguments; it must fail with this code. What it said on stderr.
fn complained<A: AsRef<std::ffi::OsStr>>(arguments: &[A], code: i32) -> String {
    let Output { status, stderr, .. } = lumenav().args(arguments).output().expect("the program starts");
    let text = String::from_utf8_lossy(&stderr).into_owned();
    assert_eq!(status.code(), Some(code), "{text}");
    text
}

fn path(path: &Path) -> &str {
    path.to_str().expect("scratch folders are UTF-8")
}

/// A run of `smoke/faults` with overrides, and what `explain` says of it.
fn explained(set: &[&str], more: &[&str]) -> String {
    let folder = scratch();
    let out = folder.path().join("run");
    let mut run = Run::new(&root().join("scenarios/smoke/faults.toml")).out(&out).arg("--record").arg("none");
    for set in set {
        run = run.arg("--set").arg(set);
    }
    run.ok();
    said(&[&["explain", path(&out)], more].concat())
}

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
fn law_explain_sees_a_track_that_never_comes_back() {
    let text = explained(&["fault.0.end_s=100", "scenario.duration_s=30"], &[]);
    assert!(
        text.contains("no update for 10.1 s, until the end: 100 readings of `plane` missing (dropout"),
        "{text}"
    );
    assert!(text.contains("weakest before: front-back (y)"), "{text}");
}

#[test]
fn law_explain_sees_a_track_that_starts_late_or_never() {
    let late = explained(&["fault.0.start_s=0", "fault.0.end_s=10", "scenario.duration_s=15"], &[]);
    assert!(late.contains("no update for 10.0 s, from the start until 10.00 s: 100 readings"), "{late}");
    let never = explained(&["fault.0.start_s=0", "fault.0.end_s=100", "scenario.duration_s=15"], &[]);
    assert!(
        never.contains("no update at all in 15.0 s: 150 readings of `plane` missing (dropout"),
        "{never}"
    );
    assert!(never.contains("0 updates") && !never.contains("nothing unusual"), "{never}");
}

#[test]
fn law_explain_blames_only_sensors_that_the_track_uses() {
    let folder = scratch();
    let file = folder.path().join("two.toml");
    let text = std::fs::read_to_string(root().join("scenarios/smoke/faults.toml")).expect("shipped");
    let second = "[[sensor]]\nname = \"other\"\nmodality = \"magnetic\"\n[sensor.schedule]\nrate_hz = \
                  10.0\n[sensor.installed]\narray = \"plane-4x4\"\n[[fault]]\nkind = \"dropout\"\nsensor = \
                  \"other\"\nstart_s = 0.0\nend_s = 80.0\n";
    std::fs::write(&file, format!("{text}\n{second}")).expect("a scratch file");
    let out = folder.path().join("run");
    let models = root().join("models");
    let run = Run::new(&file).out(&out).arg("--models").arg(&models).arg("--record").arg("none");
    run.arg("--set").arg("scenario.duration_s=55").ok();
    let text = said(&["explain", path(&out)]);
    let gap =
        text.lines().find(|l| l.contains("no update for")).unwrap_or_else(|| panic!("no gap in:\n{text}"));
    assert!(gap.contains("300 readings of `plane` missing") && !gap.contains("other"), "{gap}");
}

#[test]
fn law_explain_at_an_instant_names_what_happened_when_and_the_weak_direction() {
    let text = explained(&[], &["--at", "62s"]);
    assert!(text.contains("60.00 s  reality: sensor `plane`: disturbance from 60 to 65 s"), "{text}");
    let burst = text.lines().find(|l| l.contains("refused until 64.90 s")).expect("the burst");
    assert!(burst.trim_start().starts_with("60.00 s") && burst.contains("50 readings"), "{burst}");
    assert!(burst.contains("by the gate") && burst.contains("do not fit a magnet"), "{burst}");
    assert!(text.contains("weakest meanwhile: front-back (y)"), "{text}");
    assert!(!text.contains("dropout"), "the dropout ended 12 s before:\n{text}");
    // During the dropout the fault is named although it began earlier.
    let text = explained(&["scenario.duration_s=55"], &["--at", "40s", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["world"][0]["source"], "fault");
    let gap = &json["tracks"]["magnetic-eskf"]["gaps"][0];
    assert_eq!((gap["place"].as_str(), gap["from_s"].as_f64()), (Some("between"), Some(19.9)));
    assert!(json["tracks"]["magnetic-eskf"]["weakest"].is_null(), "no estimate near 40 s");
}

#[test]
fn law_explain_says_when_nothing_is_unusual_and_refuses_what_is_outside() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--record").arg("none").ok();
    let text = said(&["explain", path(&out), "--track", "magnetic-eskf"]);
    assert!(text.contains("nothing unusual: no gap, no refusal"), "{text}");
    let message = complained(&["explain", path(&out), "--at", "99s"], 1);
    assert!(message.contains("99 s is outside the run, which goes from 0.0 to 2.0 s"), "{message}");
    assert!(complained(&["explain", path(&out), "--track", "pet"], 1).contains("magnetic-eskf"));
}

#[test]
fn law_force_deletes_nothing_that_is_not_ours() {
    let folder = scratch();
    let out = folder.path().join("thesis");
    std::fs::create_dir(&out).expect("a scratch folder");
    std::fs::write(out.join("chapter.tex"), "x").expect("a scratch file");
    let scenario = root().join("scenarios/smoke/helix.toml");
    for trials in ["1", "2"] {
        let run = Run::new(&scenario).out(&out).arg("--force").arg("--trials").arg(trials);
        let message = run.fails(1);
        assert!(message.contains("thesis is not replaced") && message.contains("manifest.json"), "{message}");
    }
    assert_eq!(std::fs::read(out.join("chapter.tex")).expect("still there"), b"x");
    // A run's own folder may be replaced by trials, and the other way round.
    let own = folder.path().join("own");
    let run = || Run::new(&scenario).out(&own).arg("--force").arg("--record").arg("none");
    run().ok();
    run().arg("--trials").arg("2").ok();
    assert!(!own.join("metrics.json").exists() && own.join("trials/001/metrics.json").is_file());
    run().ok();
    assert!(own.join("metrics.json").is_file() && !own.join("trials").exists());
}

#[test]
fn law_explain_names_the_contraction_that_was_at_the_capsule() {
    let folder = scratch();
    let out = folder.path().join("run");
    let run = Run::new(&root().join("scenarios/smoke/colon.toml")).out(&out).arg("--record").arg("none");
    // Readings are lost while the wave of the scenario passes.
    let fault = "fault=[{kind=\"dropout\", sensor=\"belt\", start_s=4, end_s=6}]";
    run.arg("--set").arg(fault).ok();
    let text = said(&["explain", path(&out)]);
    for part in [
        "wave: wave of 0.0 s at the capsule",
        "meanwhile (gap): wave of 0.0 s at the capsule (",
        "meanwhile (gap): sensor `belt`: dropout from 4 to 6 s",
        "largest error, ",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

#[test]
fn law_models_are_found_by_name_or_the_known_ones_are_named() {
    let whole = said(&["models", "show", "sensor-arrays/belt-16"]);
    assert_eq!(said(&["models", "show", "belt-16"]), whole);
    let message = complained(&["models", "show", "belt-61"], 1);
    assert!(message.contains("no model `belt-61`") && message.contains("sensor-arrays/belt-16"), "{message}");
}

#[test]
fn law_forced_trials_leave_none_of_a_longer_earlier_run() {
    let folder = scratch();
    let out = folder.path().join("run");
    let scenario = root().join("scenarios/smoke/helix.toml");
    let run = |trials: &str| Run::new(&scenario).out(&out).arg("--trials").arg(trials);
    run("3").ok();
    assert!(run("2").fails(1).contains("more trials than are asked for"));
    assert!(run("3").arg("--seed").arg("9").fails(1).contains("holds other trials"));
    run("2").arg("--force").arg("--seed").arg("9").ok();
    let mut left: Vec<String> = std::fs::read_dir(out.join("trials"))
        .expect("trials")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["000", "001"]);
}

#[test]
fn law_stopped_trials_go_on_where_they_stopped() {
    let folder = scratch();
    let out = folder.path().join("run");
    let scenario = root().join("scenarios/smoke/helix.toml");
    let run = || Run::new(&scenario).out(&out).arg("--trials").arg("3");
    run().ok();
    let whole = std::fs::read(out.join("trials.json")).expect("written");
    // As if it had been stopped after trials 0 and 2, and killed in trial 1.
    std::fs::remove_file(out.join("trials.json")).expect("written");
    std::fs::remove_dir_all(out.join("trials/001")).expect("written");
    std::fs::create_dir(out.join("trials/.001.partial-1-0")).expect("a scratch folder");
    let timing =
        |trial: &str| std::fs::read(out.join("trials").join(trial).join("timing.json")).expect("written");
    let before = timing("000");
    run().ok();
    assert!(timing("000") == before, "a finished trial was computed again");
    assert!(std::fs::read(out.join("trials.json")).expect("written") == whole, "other figures");
    assert!(!out.join("trials/.001.partial-1-0").exists());
}

#[cfg(unix)]
#[test]
fn law_ctrl_c_keeps_finished_trials_and_says_how_to_go_on() {
    let folder = scratch();
    let out = folder.path().join("run");
    let mut child = lumenav()
        .args(["run", "scenarios/smoke/helix.toml", "--trials", "20000", "--threads", "2", "--out"])
        .arg(&out)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let begin = std::time::Instant::now();
    while !out.join("trials/000/manifest.json").exists() && begin.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let pid = child.id().to_string();
    let sent = std::process::Command::new("kill").args(["-INT", &pid]).status().expect("kill exists");
    assert!(sent.success());
    let status = child.wait().expect("it ends");
    let mut text = String::new();
    std::io::Read::read_to_string(&mut child.stderr.take().expect("piped"), &mut text).expect("text");
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(
        text.contains("of 20000 trials are finished and kept") && text.contains("goes on from there"),
        "{text}"
    );
    assert!(out.join("trials/000/metrics.json").is_file() && !out.join("trials.json").exists());
}

#[test]
fn law_the_very_same_run_is_not_computed_again() {
    let folder = scratch();
    let out = folder.path().join("run");
    let scenario = folder.path().join("s.toml");
    let text = std::fs::read_to_string(root().join("scenarios/smoke/helix.toml")).expect("shipped");
    std::fs::write(&scenario, &text).expect("a scratch file");
    let run = || Run::new(&scenario).out(&out).arg("--models").arg(root().join("models"));
    let first = run().arg("--record").arg("none").ok();
    let timing = std::fs::read(out.join("timing.json")).expect("written");
    let again = run().arg("--record").arg("none").output();
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    assert!(String::from_utf8_lossy(&again.stderr).contains("this very run already"));
    assert_eq!(String::from_utf8_lossy(&again.stdout), first);
    assert!(std::fs::read(out.join("timing.json")).expect("written") == timing, "it was computed again");
    // Another seed, another input and other outputs are other runs, and each is told.
    let refused = |run: Run, word: &str| {
        let message = run.fails(1);
        assert!(
            message.contains("exists already") && message.contains(word),
            "expected `{word}` in: {message}"
        );
    };
    refused(run().arg("--record").arg("none").arg("--seed").arg("5"), "another seed (1)");
    let shorter = || run().arg("--record").arg("none").arg("--set").arg("sensor.plane.schedule.rate_hz=4");
    refused(shorter(), "sensor.plane.schedule.rate_hz is ");
    refused(shorter(), "another --out, or replace it with --force");
    refused(run(), "other outputs");
    std::fs::write(&scenario, format!("{text}\n# a comment\n")).expect("a scratch file");
    refused(run().arg("--record").arg("none"), "another content of");
    let manifest: Manifest = read_json(&out.join("manifest.json")).expect("the contract");
    assert_eq!(manifest.random_streams_version, 1);
}

/// The manifest lists every file that was read, under the same names whatever the spelling of the command.
#[test]
fn law_every_input_is_listed_however_it_is_spelled() {
    let folder = scratch();
    let out = folder.path().join("run");
    let absolute = root().join("scenarios/smoke/colon.toml");
    let short = ["scenario.duration_s=0.5", "record.truth_rate_hz=10"];
    let run = |scenario: &Path, here: &Path| {
        let run = Run::new(scenario).out(&out).here(here).arg("--record").arg("none");
        short.iter().fold(run, |run, set| run.arg("--set").arg(set))
    };
    run(&absolute, folder.path()).ok();
    let manifest: Manifest = read_json(&out.join("manifest.json")).expect("the contract");
    let names: Vec<&str> = manifest.provenance.inputs.keys().map(String::as_str).collect();
    let expected = [
        "models/capsules/pillcam-magnet.toml",
        "models/sensor-arrays/belt-16.toml",
        "models/tracts/colon.toml",
        "scenarios/smoke/colon.toml",
    ];
    assert_eq!(names, expected);
    for (scenario, here) in [
        (Path::new("scenarios/smoke/colon.toml"), root()),
        (Path::new("./scenarios/../scenarios/smoke/colon.toml"), root()),
        (Path::new("colon.toml"), root().join("scenarios/smoke")),
    ] {
        let again = run(scenario, &here).output();
        let said = String::from_utf8_lossy(&again.stderr);
        assert!(again.status.success() && said.contains("this very run already"), "{scenario:?}: {said}");
    }
}

/// A replay of saved readings gives the run's tracks to the last byte: on time, late and lossy, and out of order.
#[test]
fn law_saved_readings_replay_to_the_same_tracks() {
    let delay = "fault=[{kind=\"delay\", sensor=\"plane\", start_s=0.5, end_s=1.0, delay_ms=500}]";
    for settings in [
        &[][..],
        &["sensor.plane.schedule.latency_ms=30", "sensor.plane.schedule.loss=0.2"],
        &[delay, "track.magnetic-eskf.filter.lag_s=0.3"],
    ] {
        let folder = scratch();
        let out = folder.path().join("run");
        let mut run = Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--save-readings");
        for setting in settings {
            run = run.arg("--set").arg(setting);
        }
        run.ok();
        let lag = if settings.len() == 2 && settings[0] == delay { "lag_s = 0.3\n" } else { "" };
        let text = format!(
            "[scenario]\nname = \"again\"\n[capsule]\nmodel = \"pillcam-magnet\"\n[[sensor]]\nname = \"plane\"\nmodality = \
             \"magnetic\"\n[sensor.installed]\narray = \"plane-4x4-below\"\n[sensor.files]\nflux_csv = \
             \"run/readings/plane.csv\"\n[[track]]\nname = \"magnetic\"\nsensors = [\"plane\"]\n[track.filter]\nkind = \
             \"none\"\n[[track]]\nname = \"magnetic-eskf\"\nsensors = [\"plane\"]\n[track.filter]\nkind = \
             \"eskf\"\n{lag}[track.sensor.plane]\nfront_end = \"flux\"\n"
        );
        let replay = folder.path().join("replay.toml");
        std::fs::write(&replay, text).expect("a scratch file");
        let again = folder.path().join("again");
        let output = lumenav()
            .arg("replay")
            .arg(&replay)
            .arg("--out")
            .arg(&again)
            .arg("--models")
            .arg(root().join("models"))
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{settings:?}: {}", String::from_utf8_lossy(&output.stderr));
        for name in ["magnetic.tum", "magnetic-eskf.tum"] {
            let track = |at: &Path| std::fs::read(at.join(name)).expect("a track");
            assert!(track(&out) == track(&again), "{settings:?}: {name} is another");
        }
    }
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
        ("mcap", "run.mcap"),
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
        let bytes = std::fs::read(to.join(file)).unwrap_or_else(|e| panic!("{format}: {e}"));
        // MCAP opens and ends with its magic; the crate that writes it reads it back in its own test.
        let magic = b"\x89MCAP0\r\n";
        assert_eq!(format == "mcap", bytes.starts_with(magic) && bytes.ends_with(magic), "{format}");
    }
}

#[test]
fn law_an_export_never_touches_the_run() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--record").arg("none").ok();
    let bytes = |name: &str| std::fs::read(out.join(name)).expect("the run's own file");
    let before = (bytes("tracks.parquet"), bytes("truth.tum"));
    let inside = out.join("export");
    let around = folder.path().join("elsewhere/../run");
    std::fs::create_dir(folder.path().join("elsewhere")).expect("a scratch folder");
    for format in ["parquet", "tum", "mcap"] {
        for to in [&out, &inside, &around] {
            let message =
                complained(&["export", path(&out), "--format", format, "--out", path(to), "--force"], 1);
            assert!(message.contains("lies in the run's own folder"), "{message}");
        }
    }
    assert!(before == (bytes("tracks.parquet"), bytes("truth.tum")), "the run's files changed");
    assert!(!inside.exists());
    // An existing file is replaced only when asked for, and then whole.
    let to = folder.path().join("to");
    let export = ["export", path(&out), "--format", "parquet", "--out", path(&to), "--json"];
    let json: serde_json::Value = serde_json::from_str(&said(&export)).expect("JSON");
    assert_eq!(json["files"][0], path(&to.join("tracks.parquet")));
    assert!(complained(&export, 1).contains("tracks.parquet exists already"));
    said(&[&export[..], &["--force"]].concat());
    assert!(std::fs::read(to.join("tracks.parquet")).expect("exported") == before.0);
    // The tracks and the truth, and nothing half-written beside them.
    assert_eq!(std::fs::read_dir(&to).expect("exported").count(), 2);
}

#[test]
fn law_nobody_reading_is_no_failure() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--record").arg("none").ok();
    let commands: [&[&str]; 7] = [
        &["scenarios", "show", "scenarios/colon-magnetic.toml", "--resolved"],
        &["scenarios", "list"],
        &["models", "list"],
        &["models", "show", "tracts/colon"],
        &["plugins"],
        &["completions", "bash"],
        &["explain", path(&out)],
    ];
    for command in commands {
        let mut child = lumenav()
            .args(command)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("it ends");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && text.is_empty(), "{command:?}: {:?}: {text}", output.status);
    }
}

#[test]
fn law_a_new_scenario_works_and_a_wrong_one_is_not_written() {
    let folder = scratch();
    let models = root().join("models");
    let make = |file: &Path, from: &str| {
        let mut command = lumenav();
        // Outside the checkout: what is shipped is in the program.
        command.current_dir(folder.path()).args(["new", "scenario"]).arg(file).args(["--from", from]);
        command.arg("--models").arg(&models).output().expect("the program starts")
    };
    let mine = folder.path().join("made/mine.toml");
    let output = make(&mine, "smoke/helix");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("lumenav run "));
    let out = folder.path().join("run");
    Run::new(&mine).out(&out).arg("--models").arg(&models).arg("--record").arg("none").ok();
    let metrics: Metrics = read_json(&out.join("metrics.json")).expect("the contract");
    assert_eq!(metrics.scenario, "mine");
    // From a file with another spelling of the name.
    let odd = folder.path().join("odd.toml");
    let text = std::fs::read_to_string(&mine).expect("made").replace("name = \"mine\"", "name='odd'");
    std::fs::write(&odd, text).expect("a scratch file");
    assert!(make(&folder.path().join("even.toml"), path(&odd)).status.success());
    assert!(
        std::fs::read_to_string(folder.path().join("even.toml")).expect("made").contains("name=\"even\"")
    );
    // A name that is not allowed, a scenario that does not exist, a file that is there: nothing is written.
    for (file, from, word) in [
        ("not allowed.toml", "smoke/helix", "is not allowed as a name"),
        ("x.toml", "nonsense", "shipped are: colon-magnetic"),
        ("even.toml", "smoke/helix", "exists already"),
    ] {
        let output = make(&folder.path().join(file), from);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.contains(word), "expected `{word}` in: {text}");
        assert!(file == "even.toml" || !folder.path().join(file).exists());
    }
}

#[test]
fn law_what_is_printed_for_programs_is_json() {
    let json = |arguments: &[&str]| -> serde_json::Value {
        serde_json::from_str(&said(arguments)).unwrap_or_else(|e| panic!("{arguments:?}: {e}"))
    };
    let list = json(&["scenarios", "list", "--json"]);
    let colon =
        list.as_array().expect("a list").iter().find(|s| s["file"] == "scenarios/colon-magnetic.toml");
    assert_eq!(colon.expect("shipped")["duration_s"], 600.0);
    assert_eq!(
        json(&["scenarios", "show", "scenarios/smoke/helix.toml", "--json"])["truth"]["kind"],
        "helix"
    );
    assert_eq!(json(&["scenarios", "check", "scenarios/smoke/helix.toml", "--json"])[0]["ok"], true);
    assert_eq!(json(&["models", "list", "--json"])[0]["model"], "capsules/hybrid");
    assert_eq!(
        json(&["models", "show", "sensor-arrays/belt-16", "--json"])["model"],
        "sensor-arrays/belt-16"
    );
    assert_eq!(json(&["models", "check", "--json"])[0]["ok"], true);
    assert_eq!(json(&["plugins", "--json"])[0]["kind"], "magnetic");
}

#[test]
fn law_resolved_shows_every_key_with_origin_unit_and_source() {
    let scenario = "scenarios/colon-magnetic.toml";
    let set = "sensor.belt.schedule.rate_hz=25";
    let text = said(&["scenarios", "show", scenario, "--resolved", "--set", set]);
    for line in [
        "start_arc_length_mm = 100.0  # set, mm",
        "start_roll_deg = 0.0  # default, degrees",
        "rate_hz = 25.0  # --set, Hz",
        "latency_ms = 0.0  # default, ms",
        "wave[0].start_time_s = 60.0  # set, s",
        "wave[1].speed_m_s = 0.022  # set, m/s",
    ] {
        assert!(text.lines().any(|l| l.starts_with(line)), "no line `{line}` in:\n{text}");
    }
    for (key, unit) in [
        ("fluid_density_kg_m3", ", kg/m^3"),
        ("fluid_viscosity_pa_s", ", Pa s"),
        ("_newton_s_per_m", ", N s/m"),
        ("_per_day", ", 1/day"),
    ] {
        let line = text.lines().find(|l| l.split(" = ").next().is_some_and(|k| k.ends_with(key)));
        let line = line.unwrap_or_else(|| panic!("no key `{key}` in:\n{text}"));
        assert!(line.contains(unit), "{line}");
    }
    assert!(!text.contains(" = {") && !text.contains("= [{"), "a nested table is not flattened:\n{text}");
    assert!(text.contains("# source: mass movements: propulsive sequences"), "{text}");
    assert!(text.contains("# source: 11 x 26 mm and less than 4 g"), "the capsule's source is missing");
}

#[test]
fn law_a_model_of_an_unknown_kind_is_an_error() {
    let folder = scratch();
    let models = folder.path().join("models");
    std::fs::create_dir_all(models.join("receivers")).expect("a scratch folder");
    std::fs::write(models.join("receivers/ring.toml"), "x = 1\n").expect("a scratch file");
    let message = complained(&["models", "check", "--models", path(&models)], 3);
    assert!(message.contains("unknown kind of model `receivers`"), "{message}");
    assert!(message.contains("scintillators, sensor-arrays, tracts"), "{message}");
    complained(&["models", "show", "receivers/ring", "--models", path(&models)], 3);
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
    // With strength and field carried from reading to reading it is as good as with both known; alone each reading tells less of them.
    for (track, limit_mm) in [("cylinder", 0.10), ("dipole", 0.17), ("cylinder-unknown", 0.12)] {
        let t = &metrics.tracks[track];
        let error = t.position_error_mm.as_ref().expect("there is a reference");
        assert_eq!(t.updates, 189, "{track}: every pose of the three series is solved");
        assert!(error.mean <= limit_mm, "{track}: {} mm", error.mean);
    }
}

#[test]
fn law_dose_of_a_run_is_that_of_its_transit() {
    let folder = scratch();
    let out = folder.path().join("run");
    let short = ["capsule.model=hybrid", "scenario.duration_s=1"];
    let run = Run::new(&root().join("scenarios/smoke/colon.toml")).out(&out).arg("--record").arg("none");
    short.iter().fold(run, |run, set| run.arg("--set").arg(set)).ok();
    let to = folder.path().join("dose");
    let dose = ["dose", path(&out), "--models", "models", "--out", path(&to), "--json"];
    let json: serde_json::Value = serde_json::from_str(&said(&dose)).expect("JSON");
    let largest = json["segments"].as_array().expect("segments").iter();
    let largest = largest.map(|s| s["largest_msv"].as_f64().expect("a number")).fold(0.0, f64::max);
    // A second beside a capsule of 12 mm with 5.55 MBq, the wall no nearer than its radius: at most Γ A t / r².
    let most = 1e3 * 0.362e-12 * 5.55e6 / 3600.0 / (6e-3_f64 * 6e-3);
    assert!(largest > 0.02 * most && largest <= most * (1.0 + 1e-9), "{largest} {most}");
    let csv = std::fs::read_to_string(to.join("dose.csv")).expect("written");
    let column = |line: &str| line.split(',').nth(2).and_then(|cell| cell.parse::<f64>().ok());
    let in_file = csv.lines().skip(1).filter_map(column).fold(0.0, f64::max);
    assert!((1e3 * in_file / largest - 1.0).abs() < 1e-12);
    assert!(std::fs::read_to_string(to.join("dose.svg")).expect("written").contains("along the tract"));
    assert!(complained(&dose, 1).contains("exists already"));
    // Half the constant, half the dose.
    let half = said(&[&dose[..4], &["--dose-rate-constant", "0.181", "--json"]].concat());
    let half: serde_json::Value = serde_json::from_str(&half).expect("JSON");
    let ratio = half["segments"][0]["mean_msv"].as_f64().expect("a number")
        / json["segments"][0]["mean_msv"].as_f64().expect("a number");
    assert!((ratio - 0.5).abs() < 1e-9, "{ratio}");
    assert!(complained(&["dose", path(folder.path())], 1).contains("is no run's folder"));
}

#[test]
fn law_periods_are_told_below_the_table() {
    let folder = scratch();
    let scenario = folder.path().join("s.toml");
    let text = std::fs::read_to_string(root().join("scenarios/smoke/helix.toml")).expect("shipped");
    std::fs::write(&scenario, format!("{text}\n[[period]]\nname = \"late\"\nfrom_s = 1.0\nto_s = 2.0\n"))
        .expect("a scratch file");
    let run = || Run::new(&scenario).arg("--models").arg(root().join("models")).arg("--record").arg("none");
    let table = run().out(&folder.path().join("one")).ok();
    assert!(table.contains(", late: 1 to 2 s: mean "), "{table}");
    let table = run().out(&folder.path().join("two")).arg("--trials").arg("2").ok();
    assert!(table.contains(", late: mean ") && table.contains("(worst trial "), "{table}");
}

/// What `[expect]` asks is judged, and told by the exit code after everything is written.
#[test]
fn law_what_is_expected_and_is_not_so_ends_with_code_4() {
    let folder = scratch();
    let scenario = folder.path().join("s.toml");
    let text = std::fs::read_to_string(root().join("scenarios/smoke/helix.toml")).expect("shipped");
    let run = |expect: &str, out: &str| {
        std::fs::write(&scenario, format!("{text}\n{expect}\n")).expect("a scratch file");
        let run = Run::new(&scenario).arg("--models").arg(root().join("models")).arg("--record").arg("none");
        run.out(&folder.path().join(out))
    };
    let distance = "[[expect.distance]]\ntracks = [\"magnetic\", \"magnetic-eskf\"]\n";
    let rest = "[[expect.rest]]\ntrack = \"magnetic\"\n";
    let met =
        format!("[expect]\nmax_speed_m_s = 5.0\n{distance}mm = [0.0, 5.0]\n{rest}max_robust_sd_mm = 100.0");
    let table = run(&met, "met").ok();
    assert!(table.contains("as expected: share of the steps of magnetic within 5 m/s: 1"), "{table}");
    // A helix of 22 mm per second does not rest within 0.1 mm.
    for (expect, wanted) in [
        ("[expect]\nmax_speed_m_s = 1e-4".to_owned(), "NOT AS EXPECTED: share of the steps of magnetic"),
        (format!("{distance}mm = [10.0, 20.0]"), "NOT AS EXPECTED: distance magnetic - magnetic-eskf"),
        (format!("{rest}max_robust_sd_mm = 0.1"), "NOT AS EXPECTED: rest of magnetic, largest robust sd"),
    ] {
        let said = run(&expect, "unmet").arg("--force").fails_with_table(4);
        assert!(said.contains(wanted) && said.contains("expectations are not met"), "{said}");
        let metrics =
            std::fs::read_to_string(folder.path().join("unmet/metrics.json")).expect("it is written");
        let metrics: serde_json::Value = serde_json::from_str(&metrics).expect("JSON");
        let verdicts = metrics["expected"]["verdicts"].as_array().expect("verdicts");
        assert!(verdicts.iter().any(|verdict| verdict["met"] == false), "{verdicts:?}");
    }
    // Of every trial the same.
    let trials = |expect: &str, out: &str| run(expect, out).arg("--trials").arg("2").arg("--force");
    let table = trials(&met, "trials-met").ok();
    assert!(table.contains("as expected in 2 of 2 trials: share of the steps of magnetic"), "{table}");
    let said = trials(&format!("{rest}max_robust_sd_mm = 0.1"), "trials-unmet").fails_with_table(4);
    assert!(said.contains("NOT AS EXPECTED in 0 of 2 trials: rest of magnetic, largest robust sd"), "{said}");
    assert!(said.contains("not in trial 0, 1"), "{said}");
    // A track that answers hardly ever shows nothing.
    let said = run(&format!("{rest}least_instants = 100000"), "few").fails_with_table(4);
    assert!(said.contains("NOT AS EXPECTED: rest of magnetic, instants"), "{said}");
    for (expect, wanted) in [
        ("[expect]\nspeed_share = 0.9".to_owned(), "Give `max_speed_m_s`"),
        (rest.replace("magnetic", "no"), "no track `no`"),
        (format!("{distance}mm = [3.0, 2.0]"), "the first must not be the larger"),
    ] {
        let said = run(&expect, "bad").fails(3);
        assert!(said.contains(wanted), "{said}");
    }
}

#[test]
fn law_a_generated_gut_is_one_that_the_statistics_command_knows_and_a_wrong_word_is_refused() {
    let folder = scratch();
    let gut = folder.path().join("gut.toml");
    let made =
        said(&["models", "generate", "tract", "--size", "average-man", "--seed", "1", "--out", path(&gut)]);
    assert!(made.contains("gut.toml"), "{made}");
    // But for its first line, which tells the command, the shipped gut of this seed.
    let without_head = |file: &Path| -> String {
        let text = std::fs::read_to_string(file).expect("it was written");
        text.split_once('\n').map(|(_, rest)| rest.to_owned()).expect("more than a line")
    };
    assert!(without_head(&gut) == without_head(&root().join("models/tracts/whole-gut-average-man.toml")));
    assert!(said(&["models", "statistics", path(&gut)]).contains("30 of 30"));
    let again = ["models", "generate", "tract", "--out", path(&gut)];
    assert!(complained(&again, 1).contains("exists already"));
    let other = folder.path().join("other.toml");
    let said = complained(&["models", "generate", "tract", "--size", "giant", "--out", path(&other)], 2);
    assert!(said.contains("small-woman"), "{said}");
    assert!(!other.exists());
}

#[test]
fn law_what_is_no_surface_is_not_imported() {
    let folder = scratch();
    let (surface, out) = (folder.path().join("surface.stl"), folder.path().join("tract.toml"));
    std::fs::write(&surface, "no surface").expect("a file can be written");
    let said = complained(&["models", "import", path(&surface), "--out", path(&out)], 3);
    assert!(said.contains("surface.stl"), "{said}");
    assert!(!out.exists());
}
