//! Lines per window and true fractions of than2015, table 4.2, from this crate's physics.
//!
//! `cargo run --release -p lumenav-pet --example table_4_2 -- [windows] [mode] [efficiency] [scanner] [diameter in cm]`

use lumenav_anatomy::phantom::Phantom;
use lumenav_core::{Node, RandomStreams};
use lumenav_pet::scanner::Scanner;
use lumenav_pet::simulation::{
    EndPoints, Isotope, Mode, Origin, Scintillator, Settings, Simulator, SourceMarker,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;

/// Lines per window and true per cent: full ring, reduced.
const TABLE: [(u32, [f64; 4]); 5] = [
    (20, [2410.0, 73.1, 284.0, 81.9]),
    (25, [1593.0, 65.4, 183.0, 75.9]),
    (30, [1067.0, 58.8, 120.0, 70.2]),
    (35, [722.0, 52.6, 80.0, 64.2]),
    (40, [492.0, 47.3, 54.0, 59.2]),
];

fn open(folder: &str, name: &str) -> Result<Node, Box<dyn std::error::Error>> {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
    Ok(Node::open(&models.join(folder).join(format!("{name}.toml")))?)
}

/// The helix of than2015, section 4.3: 5 mm/s around, 2.5 mm/s along z, 36 s, radius 57 mm.
fn helix(t_s: f64) -> Isometry3<f64> {
    let radius_m = 0.057;
    let angle = 5e-3 * t_s / radius_m;
    let place = Translation3::new(radius_m * angle.cos(), radius_m * angle.sin(), -0.045 + 2.5e-3 * t_s);
    let along = Vector3::new(-5e-3 * angle.sin(), 5e-3 * angle.cos(), 2.5e-3);
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &along).unwrap_or_default();
    Isometry3::from_parts(place, turn)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let windows: u64 = arguments.next().map_or(Ok(36), |a| a.parse())?;
    let mode = match arguments.next().as_deref() {
        Some("analog") => Mode::Analog,
        Some("tabulated") => Mode::Tabulated,
        _ => Mode::Forced,
    };
    let efficiency: f64 = arguments.next().map_or(Ok(1.0), |a| a.parse())?;
    let (only_scanner, only_cm) = (arguments.next(), arguments.next());
    let isotope = Isotope::from_node(&open("isotopes", "na-22")?)?;
    let markers: Vec<SourceMarker> = [[-12e-3, 0.0, 0.0], [0.0, 5e-3, 0.0], [0.0, -5e-3, 0.0]]
        .map(|p| SourceMarker {
            position_capsule_m: Vector3::from(p),
            activity_bq: 1.85e6,
            isotope: isotope.clone(),
            core_diameter_m: 5e-4,
            shell: None,
        })
        .to_vec();
    println!("{windows} windows of 720, {mode:?}, efficiency {efficiency}");
    println!(
        "scanner  cm   lines  than  ratio | true%  no-prompt%  than | scatter1 scatter2 prompt random % | ms/window"
    );
    for (scanner_name, column) in [("allegro", 0), ("reduced", 2)] {
        for (diameter_cm, row) in TABLE {
            if only_scanner.as_ref().is_some_and(|s| s != scanner_name)
                || only_cm.as_ref().is_some_and(|d| *d != diameter_cm.to_string())
            {
                continue;
            }
            let mut scanner = Scanner::from_node(&open("scanners", scanner_name)?)?;
            scanner.detection.efficiency = efficiency;
            let crystal = Scintillator::from_node(&open("scintillators", "gso")?)?;
            let phantom = Phantom::from_node(&open("phantoms", &format!("water-{diameter_cm}"))?)?;
            let settings = Settings { mode, end_points: EndPoints::Crystal, ..Settings::default() };
            let mut simulator = Simulator::new(scanner, crystal, Some(phantom), markers.clone(), settings);
            let random = RandomStreams::new(42, 0, "table-4-2");
            let (mut lines, mut counts, mut no_prompt) = (Vec::new(), [0_u64; 5], 0);
            let clock = std::time::Instant::now();
            for window in 0..windows {
                let run = window * 720 / windows;
                simulator.window(&helix, run as f64 * 0.05, 0.05, &random, run, &mut lines);
                for line in &lines {
                    let both = line.label.scatterings.iter().all(|n| *n > 0);
                    counts[match line.label.origin {
                        Origin::True => 0,
                        Origin::Scattered => 1 + usize::from(both),
                        Origin::Prompt => 3,
                        Origin::Random => 4,
                    }] += 1;
                    no_prompt += u64::from(line.label.origin != Origin::Prompt);
                }
            }
            let ms = clock.elapsed().as_secs_f64() * 1e3 / windows as f64;
            let all: u64 = counts.iter().sum();
            let share = |n: u64| 100.0 * n as f64 / all.max(1) as f64;
            let per_window = all as f64 / windows as f64;
            println!(
                "{scanner_name:8} {diameter_cm}  {per_window:7.1}  {:5} {:6.3} | {:5.1} {:7.1} {:9.1} | {:6.1} {:7.1} {:7.1} {:6.1} | {ms:.2}",
                row[column],
                per_window / row[column],
                share(counts[0]),
                100.0 * counts[0] as f64 / no_prompt.max(1) as f64,
                row[column + 1],
                share(counts[1]),
                share(counts[2]),
                share(counts[3]),
                share(counts[4]),
            );
        }
    }
    Ok(())
}
