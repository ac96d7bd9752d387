//! Readings that arrive late, from the file to the words of `explain`.

use crate::support::{Run, lumenav, root, scratch};
use lumenav::report::{Logged, read_events};
use std::path::Path;

/// Positions of a reading's columns in a file of saved readings.
struct Columns {
    time: usize,
    arrival: usize,
    flux: usize,
}

impl Columns {
    fn of(header: &str) -> Self {
        let cells: Vec<&str> = header.split(',').collect();
        let find = |name: &str| cells.iter().position(|cell| *cell == name).expect("a saved column");
        Self { time: find("t_s"), arrival: find("arrival_s"), flux: find("s0x_T") }
    }
}

/// Readings at 20 Hz without those between 1 and 4 s and after 4.3 s; that of 3.9 s has the flux of 1 s and arrives last.
fn holed(text: &str) -> String {
    let header = text.lines().next().expect("a header");
    let columns = Columns::of(header);
    let rows: Vec<Vec<String>> =
        text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect();
    let time_s = |row: &[String]| row[columns.time].parse::<f64>().expect("a time");
    let at = |seconds: f64| rows.iter().position(|row| (time_s(row) - seconds).abs() < 1e-6).expect("a row");
    let mut late = rows[at(3.9)].clone();
    late[columns.flux..].clone_from_slice(&rows[at(1.0)][columns.flux..]);
    late[columns.arrival].clone_from(&rows[at(4.35)][columns.arrival]);
    let kept = rows.iter().filter(|row| time_s(row) <= 1.01 || (3.99..4.31).contains(&time_s(row)));
    let lines: Vec<String> = kept.chain([&late]).map(|row| row.join(",")).collect();
    format!("{header}\n{}\n", lines.join("\n"))
}

fn replay(folder: &Path) -> std::path::PathBuf {
    let text = "[scenario]\nname = \"late\"\n[capsule]\nmodel = \"pillcam-magnet\"\n[[sensor]]\nname = \"plane\"\n\
                modality = \"magnetic\"\n[sensor.installed]\narray = \"plane-4x4-below\"\n[sensor.files]\n\
                flux_csv = \"flux.csv\"\n[[track]]\nname = \"late-eskf\"\nsensors = [\"plane\"]\n";
    let (file, out) = (folder.join("replay.toml"), folder.join("replayed"));
    std::fs::write(&file, text).expect("a scratch file");
    let models = root().join("models");
    let output = lumenav()
        .args(["replay", "--record", "none", "--models"])
        .arg(models)
        .arg("--out")
        .arg(&out)
        .arg(&file)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    out
}

/// A reading that arrives late is accepted, and those that had been accepted after it contradict it: the belief that was told is
/// another. Nobody would know why without the words for it.
#[test]
fn law_explain_says_what_a_late_reading_did_to_the_belief() {
    let folder = scratch();
    let saved = folder.path().join("saved");
    let truth = "truth={kind=\"line\", from_mm=[-20, 0, 0], to_mm=[25, 0, 0], speed_mm_s=10.0}";
    let mut run = Run::new(&root().join("scenarios/smoke/helix.toml")).out(&saved).arg("--save-readings");
    for set in [truth, "scenario.duration_s=4.4", "sensor.plane.schedule.rate_hz=20"] {
        run = run.arg("--set").arg(set);
    }
    run.arg("--record").arg("none").ok();
    let text = std::fs::read_to_string(saved.join("readings/plane.csv")).expect("saved");
    std::fs::write(folder.path().join("flux.csv"), holed(&text)).expect("a scratch file");
    let out = replay(folder.path());

    let notes: Vec<(i64, String)> = read_events(&out.join("events.jsonl"))
        .expect("events")
        .into_iter()
        .filter_map(|event| match event.what {
            Logged::Note { source, text } if source == "late-eskf" => Some((event.t_ns / 1_000_000, text)),
            _ => None,
        })
        .collect();
    let lost = notes.iter().find(|(_, text)| text.starts_with("belief given up")).expect("a loss is told");
    assert_eq!(lost.0, 4100, "{notes:?}");
    let why = "3 measurements in a row of sensor `plane` were refused";
    let seen = "(seen at 4.350 s, when the reading of 3.900 s of sensor `plane` came late)";
    assert_eq!(lost.1, format!("belief given up: {why} {seen}"));
    assert!(
        notes.contains(&(4150, format!("belief started from a fix of sensor `plane` {seen}"))),
        "{notes:?}"
    );

    let output = lumenav().arg("explain").arg(&out).output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains(&lost.1) && !said.contains("nothing unusual"), "{said}");
}
