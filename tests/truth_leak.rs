//! A filter starts from data or from `[track.prior]`, never from the truth.

use crate::support::{Run, lumenav, root, scratch};
use std::path::Path;

/// First row of a track's TUM file.
fn first_pose(folder: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(folder.join("magnetic-eskf.tum")).expect("the track was written");
    let row = text.lines().find(|l| !l.starts_with('#')).expect("a pose");
    row.split_whitespace().map(|v| v.parse().expect("a number")).collect()
}

const PRIOR: &str = "track.magnetic-eskf.prior={position_mm=[0,0,0], position_sigma_mm=1e-3, \
                     rotation_vector_deg=[0,0,0], rotation_sigma_deg=1e-3}";

/// The truth's start moves from 10 to 8 mm beside the origin; the belief, told by a tight prior that the capsule rests at the
/// origin, stays there through every update: nothing of it can have come from the truth.
#[test]
fn law_the_first_belief_does_not_follow_the_truth() {
    let folder = scratch();
    let scenario = root().join("scenarios/smoke/faults.toml");
    for (name, from) in [("a", "[-10,0,0]"), ("b", "[-8,0,0]")] {
        let out = folder.path().join(name);
        let mut run = Run::new(&scenario).out(&out);
        for set in [
            "scenario.duration_s=0.9",
            &format!("truth.from_mm={from}"),
            PRIOR,
            "track.magnetic-eskf.filter.gate_probability=0.999999999999",
            "track.magnetic-eskf.filter.initial_velocity_sigma_m_s=1e-9",
            "track.magnetic-eskf.filter.motion.velocity_random_walk_m_s_per_sqrt_s=0",
        ] {
            run = run.arg("--set").arg(set);
        }
        run.ok();
        let pose = first_pose(&out);
        let from_origin = (1..4).map(|i| pose[i].powi(2)).sum::<f64>().sqrt();
        assert!(from_origin < 1e-4, "truth at {from} mm, first belief {from_origin} m from its prior");
    }
}

/// Without a prior the first estimate is the first fix, with the fix's own error: not the truth to the last digit.
#[test]
fn law_the_first_belief_is_a_noisy_fix() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).ok();
    let first = first_pose(&out);
    let truth = std::fs::read_to_string(out.join("truth.tum")).expect("truth was written");
    let row = truth.lines().find(|l| !l.starts_with('#')).expect("a pose");
    let true_pose: Vec<f64> = row.split_whitespace().map(|v| v.parse().expect("a number")).collect();
    let distance: f64 = (1..4).map(|i| (first[i] - true_pose[i]).powi(2)).sum::<f64>().sqrt();
    assert!(distance > 1e-6 && distance < 0.02, "first estimate {distance} m from the truth");
}

const TRACKS: &str = "[[track]]\nname = \"magnetic\"\nsensors = [\"plane\"]\n[track.filter]\nkind = \"none\"\n\
                      [[track]]\nname = \"magnetic-eskf\"\nsensors = [\"plane\"]\n[track.sensor.plane]\nfront_end = \"flux\"\n";

/// The readings of a run, replayed without any truth and with a truth half a metre away, give the run's own tracks to the
/// last byte: whatever estimators know came from readings.
#[test]
fn law_tracks_are_the_same_without_the_truth() {
    let folder = scratch();
    let run = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&run).arg("--save-readings").ok();
    let moved: String = std::fs::read_to_string(run.join("truth.tum"))
        .expect("truth was written")
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let mut cells: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
            cells[1] = (cells[1].parse::<f64>().expect("a number") + 0.5).to_string();
            cells.join(" ") + "\n"
        })
        .collect();
    // Half of it, and of another day: what it does not cover is said.
    let half: String =
        moved.lines().take(moved.lines().count() / 2).map(|line| line.to_owned() + "\n").collect();
    let other_day = "9".to_owned() + &moved.trim_end().replace('\n', "\n9") + "\n";
    for (name, text) in [("moved", &moved), ("half", &half), ("other-day", &other_day)] {
        std::fs::write(folder.path().join(name).with_extension("tum"), text).expect("a scratch file");
    }
    let truth_of = |name: &str| format!("[truth]\nkind = \"tum\"\nfile = \"{name}.tum\"\n");
    for (name, truth, uncovered) in [
        ("blind", String::new(), None),
        ("misled", truth_of("moved"), None),
        (
            "covered-half",
            truth_of("half"),
            Some(" estimates have a truth at their instant; of the others nothing is said"),
        ),
        ("of-another-day", truth_of("other-day"), Some("magnetic: 0 of ")),
    ] {
        let text = format!(
            "[scenario]\nname = \"again\"\n[capsule]\nmodel = \"pillcam-magnet\"\n{truth}[[sensor]]\nname = \"plane\"\n\
             modality = \"magnetic\"\n[sensor.installed]\narray = \"plane-4x4-below\"\n[sensor.files]\n\
             flux_csv = \"run/readings/plane.csv\"\n{TRACKS}"
        );
        let replay = folder.path().join(name).with_extension("toml");
        std::fs::write(&replay, text).expect("a scratch file");
        let out = folder.path().join(name);
        let models = root().join("models");
        let output = lumenav()
            .arg("replay")
            .arg(&replay)
            .arg("--out")
            .arg(&out)
            .arg("--models")
            .arg(models)
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let table = String::from_utf8_lossy(&output.stdout).into_owned();
        match uncovered {
            Some(words) => assert!(table.contains(words), "{name}: {table}"),
            None => assert!(!table.contains("have a truth at their instant"), "{name}: {table}"),
        }
        for track in ["magnetic.tum", "magnetic-eskf.tum"] {
            let read = |folder: &Path| std::fs::read(folder.join(track)).expect("a track");
            assert!(read(&run) == read(&out), "{track} of the {name} replay is another");
        }
    }
}
