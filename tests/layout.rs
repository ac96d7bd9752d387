//! `lumenav layout`: judged, improved, compared; what it writes is taken by `run`; bad studies are refused by name.

use crate::support::{Run, lumenav, root, scratch};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn layout(what: &str, scenario: &str, out: &Path) -> Command {
    let mut command = lumenav();
    command.args(["layout", what, scenario, "--out"]).arg(out);
    command
}

fn ok(command: &mut Command) -> String {
    let output = command.output().expect("the program starts");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "stdout:\n{out}\nstderr:\n{err}");
    out.into_owned()
}

fn refused(command: &mut Command) -> String {
    let output = command.output().expect("the program starts");
    let err = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{err}");
    err
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("written")).expect("JSON")
}

/// Shows 3 of the issue in seconds: the checkerboard of the independent study, and what moving makes of it with two starts.
#[test]
fn cross_optimize_moves_sensors_to_what_the_study_reached() {
    let folder = scratch();
    let study = "scenarios/layout/two-planes.toml";
    ok(layout("optimize", study, folder.path()).args(["--set", "layout.optimize.starts=2"]));
    let found = json(&folder.path().join("optimization.json"));
    let number = |value: &Value| value.as_f64().expect("a number");
    assert!((number(&found["before"]["rms_mm"]) / 1.11817 - 1.0).abs() < 2e-4);
    assert!((number(&found["before"]["worst_mm"]) / 2.43047 - 1.0).abs() < 2e-4);
    assert!(number(&found["found"]) <= 1.10, "{}", found["found"]);
    assert_eq!(found["after"]["rms_mm"], found["found"]);
    assert_eq!(found["before"]["deaths"][0]["choices"], 16);
    assert!(number(&found["before"]["deaths"][0]["rms_mm"]) > number(&found["before"]["rms_mm"]));
}

#[test]
fn law_what_optimize_writes_is_taken_by_run_and_judged_the_same() {
    let folder = scratch();
    let study = "scenarios/torso-belt-study.toml";
    let few = ["--set", "layout.optimize.starts=1", "--set", "layout.workspace.direction_count=2"];
    let said = ok(layout("optimize", study, folder.path()).args(few));
    assert!(said.contains("no choice of as many of the 192 candidates gets below"), "{said}");
    let array = folder.path().join("array.toml");
    let set = format!("sensor.belt.installed.array={}", array.display());
    let run = folder.path().join("run");
    Run::new(&root().join(study))
        .out(&run)
        .arg("--set")
        .arg(&set)
        .args_of(&["--set", "scenario.duration_s=1", "--record", "none"])
        .ok();
    let again = folder.path().join("again");
    ok(layout("evaluate", study, &again).args(["--set", &set]).args(&few[2..]));
    let (found, judged) =
        (json(&folder.path().join("optimization.json")), json(&again.join("evaluation.json")));
    let (found, judged) = (found["after"]["rms_mm"].as_f64(), judged["rms_mm"].as_f64());
    // The file tells places to a tenth of a micrometre.
    assert!((found.expect("a number") / judged.expect("a number") - 1.0).abs() < 1e-5);
}

#[test]
fn law_threads_cannot_be_seen() {
    let folder = scratch();
    let study = "scenarios/layout/planes-candidates.toml";
    let few = ["--set", "layout.optimize.starts=2", "--set", "layout.workspace.z_mm=[250]"];
    let places = [("1", "with-one"), ("2", "with-two")];
    for (threads, place) in places {
        let out = folder.path().join(place);
        ok(layout("optimize", study, &out).args(few).args(["--threads", threads, "-q"]));
        ok(layout("evaluate", study, &out).args(few).args(["--threads", threads, "-q"]));
    }
    // The array's file and the JSON tell their command, which names the threads and the folder.
    let read = |(threads, place): (&str, &str), name: &str| {
        let text = std::fs::read_to_string(folder.path().join(place).join(name)).expect("written");
        text.replace(&format!("--threads {threads}"), "").replace(place, "")
    };
    for name in ["array.toml", "optimization.json", "evaluation.json", "map.csv", "map.svg"] {
        assert!(read(places[0], name) == read(places[1], name), "{name} differs");
    }
}

#[test]
fn law_layouts_are_compared_on_cost_and_error() {
    let folder = scratch();
    let said = ok(&mut layout("compare", "scenarios/torso-belt-study.toml", folder.path()));
    assert!(said.contains("two planes of 16"), "{said}");
    let compared = json(&folder.path().join("comparison.json"));
    let layouts = compared["layouts"].as_array().expect("layouts");
    assert_eq!(layouts.len(), 4);
    // The shipped choice beats the belt that costs as much.
    assert_eq!(layouts[0]["on_the_pareto_front"], false);
    assert_eq!(layouts[1]["on_the_pareto_front"], true);
    assert_eq!(layouts[2]["cost"], 96.0);
    assert!(folder.path().join("pareto.svg").is_file());
    // Nothing is overwritten unasked.
    let output =
        layout("compare", "scenarios/torso-belt-study.toml", folder.path()).output().expect("starts");
    assert!(String::from_utf8_lossy(&output.stderr).contains("--force"));
}

#[test]
fn law_bad_studies_are_refused_by_name() {
    let study = "scenarios/layout/planes-candidates.toml";
    for (what, set, words) in [
        ("evaluate", "layout.workspace.x_mm=[1, 0]", ["layout.workspace.x_mm", "ascending"]),
        ("evaluate", "layout.workspace.directions=[[0, 0, 0]]", ["directions", "length zero"]),
        ("evaluate", "layout.sensor=\"belt\"", ["layout.sensor", "planes"]),
        ("evaluate", "layout.dead=20", ["layout.dead", "0 to 8"]),
        ("evaluate", "layout.model.unknown_field=true", ["unknown field", "unknown_ambient"]),
        ("evaluate", "layout.model.strength_sigma=0.1", ["strength_sigma", "unknown_strength = true"]),
        ("evaluate", "layout.model.candidates=\"nowhere\"", ["no model `nowhere`", "planes-9x9x2"]),
        ("evaluate", "layout.wanted_mm=0", ["layout.wanted_mm", "above 0"]),
        ("optimize", "layout.optimize.count=163", ["163 elements asked of 162 candidates", "1 to 162"]),
        ("optimize", "layout.optimize.criterion=\"best\"", ["unknown variant `best`", "rms"]),
        ("optimize", "layout.optimize.x_mm=[250, -250]", ["layout.optimize.x_mm", "lower to the higher"]),
        ("optimize", "layout.optimize.spacing_mm=400", ["spacing of 400 mm", "16"]),
        ("optimize", "layout.optimize.starts=0", ["layout.optimize.starts", "1 to"]),
    ] {
        let folder = scratch();
        let out = folder.path().join("layout");
        let message = refused(layout(what, study, &out).args(["--set", set]));
        for word in words {
            assert!(message.contains(word), "`{set}`: expected `{word}` in: {message}");
        }
        assert!(!out.exists(), "{set} left {}", out.display());
    }
    let message =
        refused(&mut layout("evaluate", "scenarios/helix-magnetic.toml", &scratch().path().join("x")));
    assert!(message.contains("has no [layout]"), "{message}");
}

/// Blocks of a scanner say nothing one by one: judged and compared, and a search is refused in words.
#[test]
fn law_a_scanner_is_compared_and_not_searched_for() {
    let study = "scenarios/layout/pet-pairs.toml";
    let few = [
        "--set",
        "layout.workspace.x_mm=[0]",
        "--set",
        "layout.workspace.y_mm=[0]",
        "--set",
        "layout.workspace.z_mm=[0, 30]",
    ];
    let folder = scratch();
    ok(layout("compare", study, folder.path()).args(few));
    let compared = json(&folder.path().join("comparison.json"));
    let layouts = compared["layouts"].as_array().expect("layouts");
    assert_eq!((layouts.len(), compared["cost_unit"].as_str()), (27, Some("crystals")));
    let rms = |at: usize| layouts[at]["rms_mm"].as_f64().expect("a bound at every pose");
    let at = |name: &str| layouts.iter().position(|l| l["name"] == name).expect("an alternative");
    assert_eq!(layouts[0]["cost"], 4408.0);
    // Nearer blocks and wider ones see more lines.
    assert!(rms(at("90 deg, 38 wide, 350 mm")) < rms(0) && rms(0) < rms(at("90 deg, 38 wide, 500 mm")));
    assert!(rms(0) < rms(at("90 deg, 28 wide, 432 mm")));
    // One pair still sees all six parameters.
    assert!(layouts[0]["deaths"][0]["rms_mm"].as_f64().expect("a bound") > rms(0));
    for (what, set, words) in [
        ("optimize", "layout.optimize.starts=1", ["work only together", "layout compare"]),
        ("optimize", "layout.optimize.x_mm=[-500, 500]", ["work only together", "layout compare"]),
        ("evaluate", "layout.model.background_share=1", ["layout.model.background_share", "below 1"]),
        ("evaluate", "layout.model.candidates=\"a\"", ["unknown field", "per_side"]),
        (
            "evaluate",
            "sensor.scanner.installed.scanner_changes.columns=0",
            ["scanner_changes.columns", "1 to"],
        ),
    ] {
        let folder = scratch();
        let out = folder.path().join("layout");
        let message = refused(layout(what, study, &out).args(few).args(["--set", set]));
        for word in words {
            assert!(message.contains(word), "`{set}`: expected `{word}` in: {message}");
        }
        assert!(!out.exists(), "{set} left {}", out.display());
    }
}

/// A workspace far outside all sensitivity, and an array that cannot see: infinite in words, no number.
#[test]
fn law_what_is_not_seen_is_infinite_in_words() {
    let folder = scratch();
    let said = ok(layout("evaluate", "scenarios/layout/one-plane.toml", folder.path())
        .args([
            "--set",
            "layout.model.unknown_ambient=true",
            "--set",
            "sensor.planes.installed.array=tests/layout/one-sensor.toml",
        ])
        .current_dir(root()));
    assert!(said.contains("infinite") && said.contains("189 of 189"), "{said}");
    let judged = json(&folder.path().join("evaluation.json"));
    assert_eq!((judged["rms_mm"].clone(), judged["poses_without_bound"].clone()), (Value::Null, 189.into()));
}

/// A search of a hundred thousand starts is stopped after five seconds: the best layout so far is there, whole, and says that it is no end.
#[cfg(unix)]
#[test]
fn law_ctrl_c_keeps_the_best_layout_so_far() {
    let folder = scratch();
    let mut child = layout("optimize", "scenarios/layout/planes-candidates.toml", folder.path())
        .args(["--set", "layout.optimize.starts=100000", "--set", "layout.workspace.z_mm=[250]", "-q"])
        .spawn()
        .expect("the program starts");
    std::thread::sleep(std::time::Duration::from_secs(5));
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill exists");
    assert!(sent.success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    let found = json(&folder.path().join("optimization.json"));
    assert_eq!((&found["stopped"], &found["lower_bound"]), (&Value::Bool(true), &Value::Null));
    assert!(found["found"].as_f64() < found["installed"].as_f64());
    assert!(folder.path().join("array.toml").is_file());
}
