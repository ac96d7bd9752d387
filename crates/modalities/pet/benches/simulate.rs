//! Time per window of 50 ms: the reduced scanner and the full ring, water of 20 cm, three markers of 1.85 MBq in the middle.
//!
//! `tabulated` is measured after its tables near the capsule are made.

use divan::Bencher;
use lumenav_anatomy::phantom::Phantom;
use lumenav_core::{Node, RandomStreams};
use lumenav_pet::scanner::Scanner;
use lumenav_pet::simulation::{Isotope, Mode, Scintillator, Settings, Simulator, SourceMarker};
use nalgebra::{Isometry3, Vector3};
use std::path::Path;

fn main() {
    divan::main();
}

fn open(folder: &str, name: &str) -> Option<Node> {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
    Node::open(&models.join(folder).join(format!("{name}.toml"))).ok()
}

fn simulator(scanner: &str, mode: Mode) -> Option<Simulator> {
    let isotope = Isotope::from_node(&open("isotopes", "na-22")?).ok()?;
    let places = [[-12e-3, 0.0, 0.0], [0.0, 5e-3, 0.0], [0.0, -5e-3, 0.0]];
    let markers = places
        .map(|p| SourceMarker {
            position_capsule_m: Vector3::from(p),
            activity_bq: 1.85e6,
            isotope: isotope.clone(),
            core_diameter_m: 5e-4,
            shell: None,
        })
        .to_vec();
    Some(Simulator::new(
        Scanner::from_node(&open("scanners", scanner)?).ok()?,
        Scintillator::from_node(&open("scintillators", "gso")?).ok()?,
        Phantom::from_node(&open("phantoms", "water-20")?).ok(),
        markers,
        Settings { mode, ..Settings::default() },
    ))
}

const SCANNERS: [&str; 2] = ["reduced", "allegro"];

#[divan::bench(args = SCANNERS, sample_size = 1, sample_count = 20)]
fn analog(bencher: Bencher, scanner: &str) {
    window(bencher, scanner, Mode::Analog);
}

#[divan::bench(args = SCANNERS, sample_size = 1, sample_count = 40)]
fn forced(bencher: Bencher, scanner: &str) {
    window(bencher, scanner, Mode::Forced);
}

#[divan::bench(args = SCANNERS, sample_size = 1, sample_count = 40)]
fn tabulated(bencher: Bencher, scanner: &str) {
    window(bencher, scanner, Mode::Tabulated);
}

fn window(bencher: Bencher, scanner: &str, mode: Mode) {
    let Some(mut simulator) = simulator(scanner, mode) else { return };
    let random = RandomStreams::new(1, 0, "bench");
    let motion = |t: f64| Isometry3::translation(0.02 + 0.005 * t, 0.01, 0.012);
    let (mut lines, mut sequence) = (Vec::new(), 0);
    simulator.window(&motion, 0.0, 0.05, &random, sequence, &mut lines);
    bencher.bench_local(|| {
        sequence += 1;
        simulator.window(&motion, 0.0, 0.05, &random, sequence, &mut lines);
        lines.len()
    });
}
