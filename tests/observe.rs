//! A scenario that is observed from a later instant on, and worlds whose states are kept.

use crate::support::{Run, lumenav, root, scratch};
use std::path::{Path, PathBuf};

/// Runs a smoke scenario into a folder.
fn run(scenario: &str, out: &Path, arguments: &[&str]) -> Run {
    Run::new(&root().join(format!("scenarios/smoke/{scenario}.toml"))).out(out).args_of(arguments)
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Rows of a run from an instant on; the first column is the time.
fn rows_from(path: &Path, separator: char, from_s: f64) -> Vec<String> {
    let time = |row: &&str| row.split(separator).next().and_then(|cell| cell.parse().ok()).unwrap_or(-1.0);
    text(path).lines().filter(|row| time(row) >= from_s - 1e-9).map(str::to_owned).collect()
}

/// Sensors that begin to look see what they would have seen, with the same noise; who does not look is told nothing.
#[test]
fn law_what_is_observed_later_is_what_was_there() {
    for (scenario, sensor, from_s) in [("colon", "belt", 5.0), ("pet", "scanner", 1.02)] {
        let folder = scratch();
        let [whole, later] = ["whole", "later"].map(|name| folder.path().join(name));
        run(scenario, &whole, &["--save-readings"]).ok();
        let from = format!("scenario.observe_from_s={from_s}");
        run(scenario, &later, &["--save-readings", "--set", &from]).ok();
        let readings = format!("readings/{sensor}.csv");
        // Of a window, all of it has to lie there.
        let first_s = if scenario == "pet" { from_s + 0.025 } else { from_s };
        let seen = rows_from(&later.join(&readings), ',', 0.0);
        assert!(seen.len() > 15, "{scenario}: {} rows", seen.len());
        assert_eq!(seen, rows_from(&whole.join(&readings), ',', first_s), "{scenario}");
        // The log's rows are counted from where it begins.
        if from_s.fract() == 0.0 {
            let truth = rows_from(&later.join("truth.tum"), ' ', 0.0);
            assert_eq!(truth, rows_from(&whole.join("truth.tum"), ' ', from_s), "{scenario}");
        }
        let metrics: serde_json::Value =
            serde_json::from_str(&text(&later.join("metrics.json"))).expect("JSON");
        assert_eq!(metrics["observe_from_s"], from_s);
        for (track, figures) in metrics["tracks"].as_object().expect("tracks") {
            let first_s = figures["time_to_first_fix_s"].as_f64().expect("a first fix");
            assert!(first_s < 0.5, "{scenario} {track}: {first_s} s");
        }
        // What the world tells from there on it tells alike, and nothing of before.
        let world = |run: &Path| -> Vec<String> {
            let of_world = |row: &&str| row.contains("\"source\":\"world\"");
            text(&run.join("events.jsonl")).lines().filter(of_world).map(str::to_owned).collect()
        };
        let instant = |row: &str| {
            let row: serde_json::Value = serde_json::from_str(row).expect("JSON");
            row["t_ns"].as_i64().expect("an instant")
        };
        let mut expected = world(&whole);
        expected.retain(|row| instant(row) as f64 >= 1e9 * from_s);
        assert_eq!(world(&later), expected, "{scenario}");
    }
}

/// The readings of a run that is observed later replay to its tracks, with a prior that is about the instant from which it is.
#[test]
fn law_a_replay_of_what_is_observed_later_is_the_run() {
    let folder = scratch();
    let scenario = folder.path().join("s.toml");
    let prior = "[track.prior]\nposition_mm = [0, 0, 0]\nrotation_vector_deg = [0, 0, 0]\nvelocity_mm_s = [0, 0, 0]\nposition_sigma_mm = 30\nrotation_sigma_deg = 60\n";
    let head = "[capsule]\nmodel = \"pillcam-magnet\"\n[[sensor]]\nname = \"plane\"\nmodality = \"magnetic\"\n\
                [sensor.installed]\narray = \"plane-4x4-below\"\n";
    let track = format!(
        "[[track]]\nname = \"eskf\"\nsensors = [\"plane\"]\n{prior}[track.sensor.plane]\nfront_end = \"flux\"\n"
    );
    let truth = "[truth]\nkind = \"line\"\nfrom_mm = [-40, 0, 0]\nto_mm = [40, 0, 0]\nspeed_mm_s = 2.0\n";
    let schedule = "[sensor.schedule]\nrate_hz = 10.0\n";
    let names = "[scenario]\nname = \"later\"\nobserve_from_s = 20.0\n";
    std::fs::write(&scenario, format!("{names}duration_s = 25.0\n{truth}{head}{schedule}{track}"))
        .expect("a file");
    let models = root().join("models");
    let out = folder.path().join("run");
    Run::new(&scenario).out(&out).arg("--save-readings").arg("--models").arg(&models).ok();
    let replay = folder.path().join("r.toml");
    let files = "[sensor.files]\nflux_csv = \"run/readings/plane.csv\"\n";
    std::fs::write(&replay, format!("{names}{head}{files}{track}")).expect("a file");
    let replayed = folder.path().join("replayed");
    let output = lumenav()
        .arg("replay")
        .arg(&replay)
        .arg("--out")
        .arg(&replayed)
        .arg("--models")
        .arg(&models)
        .output();
    let output = output.expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows = |run: &Path| rows_from(&run.join("eskf.tum"), ' ', 0.0);
    assert!(rows(&out).len() > 40, "{:?}", rows(&out).len());
    assert_eq!(rows(&replayed), rows(&out));
}

/// The states that a folder holds, the latest last.
fn states(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    let instant = |path: &PathBuf| -> i64 {
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        name.rsplit('-').next().expect("an instant").parse().expect("a number")
    };
    all.sort_by_key(instant);
    all
}

/// A world that is taken up where it was left makes the same bytes as one from zero, and a damaged state is named.
#[test]
fn law_a_world_that_is_taken_up_makes_the_same_bytes() {
    let folder = scratch();
    let kept = folder.path().join("worlds");
    let kept_in = kept.to_str().expect("a plain path");
    let later = ["--set", "scenario.observe_from_s=9", "--save-readings"];
    let resume = ["--checkpoints", kept_in, "--checkpoint-every", "2"];
    let [from_zero, keeping, taken_up] = ["a", "b", "c"].map(|name| folder.path().join(name));
    run("colon", &from_zero, &later).ok();
    run("colon", &keeping, &later).args_of(&resume).ok();
    let all = states(&kept);
    assert_eq!(all.len(), 6, "{all:?}");
    // What is not needed any more is not asked for: states of 2 and 4 s may be gone, and that of 6 s is used.
    all[..2].iter().chain(&all[3..]).for_each(|path| std::fs::remove_file(path).expect("a file"));
    run("colon", &taken_up, &later).args_of(&resume).ok();
    assert_eq!(states(&kept).len(), 4, "from 6 s on: 8, 10 and 12 s once more");
    for file in
        ["truth.parquet", "tracks.parquet", "events.jsonl", "truth.tum", "readings/belt.csv", "recording.rrd"]
    {
        let bytes =
            |run: &Path| std::fs::read(run.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        assert!(bytes(&from_zero) == bytes(&keeping), "{file}");
        assert!(bytes(&from_zero) == bytes(&taken_up), "{file}");
    }
    // Another seed is another world.
    let mut other = run("colon", &folder.path().join("d"), &later).args_of(&resume);
    other = other.args_of(&["--seed", "2", "--record", "none"]);
    other.ok();
    assert_eq!(states(&kept).len(), 10);
    for path in states(&kept) {
        let bytes = std::fs::read(&path).expect("a state");
        std::fs::write(&path, &bytes[..bytes.len() - 1]).expect("a shorter state");
    }
    let message = run("colon", &folder.path().join("e"), &later).args_of(&resume).fails(3);
    assert!(message.contains(".world: ") && message.contains("cut short, or damaged"), "{message}");
    assert!(!folder.path().join("e").exists());
}
