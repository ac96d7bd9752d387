//! `scenarios/cough-and-turn.toml` from the file to the errors of its tracks.

use lumenav_core::{ModelFolder, Node, Primitive, Registry, SimTime};
use lumenav_magnetic::Magnetic;
use lumenav_pipeline::{ObserverError, Observers, RunEvent, RunHeader, RunObserver, Stage, simulate};
use lumenav_scenario::{ScenarioFile, build_world};
use std::collections::BTreeMap;
use std::path::Path;

/// One estimate: when, s, its error, m, and that along the tract, m.
struct Row {
    at_s: f64,
    error_m: f64,
    along_m: f64,
}

/// What the tracks made of the run.
#[derive(Default)]
struct Seen {
    rows: BTreeMap<String, Vec<Row>>,
    notes: Vec<String>,
    placements: usize,
    /// Largest and least specific force of the truth, m/s².
    felt_m_s2: Vec<(f64, f64)>,
}

impl RunObserver for Seen {
    fn start(&mut self, _header: &RunHeader) -> Result<(), ObserverError> {
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        match event {
            RunEvent::Update(update) => {
                let error = update.error.expect("each update of a simulation is judged");
                self.rows.entry(update.track.to_string()).or_default().push(Row {
                    at_s: update.estimate.at.seconds(),
                    error_m: error.position_world_m.norm(),
                    along_m: error.along_tract_m.unwrap_or(f64::NAN),
                });
            }
            RunEvent::Note { source, text, .. } if *source == "world" => self.notes.push((*text).to_owned()),
            RunEvent::Scene { primitives, .. } => {
                let placed = |p: &&Primitive| matches!(p, Primitive::Placement { .. });
                self.placements += primitives.iter().filter(placed).count();
            }
            RunEvent::Truth(truth) => {
                self.felt_m_s2.push((truth.at.seconds(), truth.specific_force_capsule_m_s2.norm()));
            }
            _ => {}
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        Ok(())
    }
}

fn run() -> Seen {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let overrides = ["record.truth_rate_hz=100".to_owned()];
    let node = Node::open_with(&root.join("scenarios/cough-and-turn.toml"), &overrides).unwrap();
    let file = ScenarioFile::from_node(node, ModelFolder::new(root.join("models"))).unwrap();
    let built = build_world(&file, 1, 0).unwrap();
    let mut seen = Seen::default();
    let stage = Stage { world: built.world, map: built.map, checkpoints: None };
    let registry = Registry::new().with(Magnetic);
    let mut observers = Observers::new(vec![&mut seen]);
    let summary = simulate(&file, &registry, 1, 0, stage, &mut observers, &|| false).unwrap();
    assert_eq!(summary.ended_at, SimTime::from_seconds(60.0));
    seen
}

fn rmse_mm(rows: &[Row], from_s: f64, to_s: f64) -> f64 {
    let within: Vec<f64> =
        rows.iter().filter(|r| (from_s..to_s).contains(&r.at_s)).map(|r| r.error_m * r.error_m).collect();
    assert!(!within.is_empty(), "no estimate from {from_s} to {to_s} s");
    1e3 * (within.iter().sum::<f64>() / within.len() as f64).sqrt()
}

#[test]
fn law_tracks_follow_a_patient_who_coughs_and_turns() {
    let seen = run();
    for (track, rows) in &seen.rows {
        let [all, breath, coughs, turn] =
            [(2.0, 60.0), (2.0, 10.0), (10.0, 12.0), (20.0, 24.0)].map(|(a, b)| rmse_mm(rows, a, b));
        let along: Vec<f64> = rows.iter().map(|r| r.along_m.abs()).collect();
        let near = along.iter().filter(|a| **a < 0.02).count() as f64 / along.len() as f64;
        println!(
            "figure: {track}: {} estimates, {all:.2} mm, breathing {breath:.2}, coughing {coughs:.2}, turning {turn:.2}; within 20 mm along: {near:.3}",
            rows.len()
        );
        assert!(rows.len() > 1150, "{track}: {}", rows.len());
    }
    let of = |track: &str, from_s: f64, to_s: f64| rmse_mm(&seen.rows[track], from_s, to_s);
    for (from_s, to_s) in [(2.0, 10.0), (13.0, 33.0), (36.0, 60.0)] {
        let [belt, skin, room] = ["belt", "skin", "room"].map(|track| of(track, from_s, to_s));
        assert!(belt < 1.0 && room < 2.0, "{from_s} to {to_s} s: {belt} {room}");
        // Breath lifts the skin by 5 mm, 3.1 in the root mean square (sin⁴): that is what its wearer does not know.
        assert!((2.0..4.0).contains(&skin), "{from_s} to {to_s} s: {skin}");
    }
    // A cough pushes the gut by 37 mm and back within 0.3 s, which no filter expects; afterwards all have it again.
    for track in ["belt", "skin", "room"] {
        assert!((2.0..20.0).contains(&of(track, 10.0, 12.0)), "{track}");
    }
    assert_eq!(seen.notes.iter().filter(|note| note.starts_with("patient: ")).count(), 5, "{:?}", seen.notes);
    assert!(seen.placements > 100, "{}", seen.placements);
    let felt = |from_s: f64, to_s: f64| {
        let all = seen.felt_m_s2.iter().filter(|(at, _)| (from_s..to_s).contains(at));
        all.map(|(_, felt)| (felt - 9.81).abs()).fold(0.0, f64::max)
    };
    let (coughing, resting) = (felt(10.0, 11.1), felt(13.0, 19.0));
    println!(
        "figure: the accelerometer is off gravity by {coughing:.1} m/s2 in a cough, {resting:.2} in breath alone"
    );
    assert!(coughing > 1.0, "{coughing}");
}
