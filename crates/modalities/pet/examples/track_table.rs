//! Marker error of the trackers on the windows of than2015, table 4.2 and 4.3, from a small generator: which tracker, how many
//! lines, mean and standard deviation of the marker error, failures of 720 windows.
//!
//! `cargo run --release -p lumenav-pet --example track_table -- [windows] [seeds] [simulator|physics|law] [speed] [acceleration m/s2]`
//!
//! Failure: any marker more than 3 mm off, only the two base markers interchangeable, or no answer. Nothing is left out of the
//! counts; the mean is over all answered windows.

#![allow(dead_code, reason = "one support file for tests, benches and this table")]

#[path = "../tests/tracking/support.rs"]
mod support;

use lumenav_pet::tracking::{
    BlockErrors, BlockNoise, ClassicOptions, Fcm, Mixture, MixtureOptions, Rigid, Tracker,
};
use support::{
    Ends, Generator, MotionFilter, WINDOW_S, helix, marker_errors, noise_of, noise_of_drawn, noise_of_law,
    scanner, triangle,
};

const ROWS: [(f64, f64); 5] = [(284.0, 0.819), (183.0, 0.759), (120.0, 0.702), (80.0, 0.642), (54.0, 0.592)];

fn law() -> BlockNoise {
    BlockNoise::reference()
}

/// Windows of the simulator, each count from its own phantom.
fn simulated(
    scanner: &lumenav_pet::Scanner,
    set: &lumenav_pet::MarkerSet,
    lines: f64,
    seed: u64,
    windows: usize,
    motion: &dyn Fn(f64) -> nalgebra::Isometry3<f64>,
) -> Vec<Vec<lumenav_pet::Line>> {
    use lumenav_pet::simulation::{Isotope, Mode, Settings, Simulator, SourceMarker};
    let phantom = match lines as u32 {
        284 => "water-20",
        183 => "water-25",
        120 => "water-30",
        80 => "water-35",
        _ => "water-40",
    };
    let phantom = lumenav_anatomy::phantom::Phantom::from_node(&support::model("phantoms", phantom))
        .expect("a phantom");
    let isotope = Isotope::from_node(&support::model("isotopes", "na-22")).expect("an isotope");
    let markers = set
        .markers
        .iter()
        .map(|m| SourceMarker {
            position_capsule_m: m.position_capsule_m,
            activity_bq: m.activity_bq,
            isotope: isotope.clone(),
            core_diameter_m: m.core_diameter_m,
            shell: None,
        })
        .collect();
    let settings = Settings { mode: Mode::Forced, ..Settings::default() };
    let mut simulator =
        Simulator::new(scanner.clone(), support::scintillator(scanner), Some(phantom), markers, settings);
    let streams = lumenav_core::RandomStreams::new(seed, 0, "track-table");
    let mut out = Vec::new();
    (0..windows)
        .map(|w| {
            simulator.window(motion, w as f64 * WINDOW_S, WINDOW_S, &streams, w as u64, &mut out);
            out.iter().map(|l| l.line).collect()
        })
        .collect()
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let windows: usize = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(720);
    let seeds: u64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(1);
    let source = arguments.next().unwrap_or("simulator".into());
    let physics = source != "law";
    let speed: f64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(1.0);
    let acceleration: f64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(0.03);
    let (set, scanner) = (triangle(), scanner("reduced"));
    let noise = if source == "simulator" {
        noise_of(&scanner)
    } else if physics {
        noise_of_drawn(&scanner)
    } else {
        noise_of_law(&scanner, &law())
    };
    if physics {
        let errors = BlockErrors::of_block(
            &scanner,
            &support::scintillator(&scanner),
            lumenav_pet::simulation::EndPoints::Crystal,
        );
        println!("block noise {:?}", errors.law);
    }
    println!(
        "{windows} windows, ends by {source}, speed x{speed}, acceleration {acceleration} m/s2, 1 rad/s2"
    );
    for (lines, share) in ROWS {
        for seed in 1..=seeds {
            let ends = if physics { Ends::physics(&scanner) } else { Ends::Law(law()) };
            let mut generator = Generator::new(scanner.clone(), ends, set.clone(), seed);
            let motion = |t: f64| helix(t, speed);
            let all: Vec<Vec<lumenav_pet::Line>> = if source == "simulator" {
                simulated(&scanner, &set, lines, seed, windows, &motion)
            } else {
                (0..windows)
                    .map(|w| generator.poisson_window(&motion, w as f64 * WINDOW_S, lines, share))
                    .collect()
            };
            let lines = all.iter().map(Vec::len).sum::<usize>() as f64 / windows as f64;
            let kinds: [(&str, Box<dyn Tracker>, bool); 4] = [
                ("fcm", Box::new(Fcm::new(&set, ClassicOptions::default())), false),
                ("rigid", Box::new(Rigid::new(&set, ClassicOptions::default())), false),
                ("mixture", Box::new(Mixture::new(&set, noise.clone(), MixtureOptions::default())), false),
                (
                    "mixture+motion",
                    Box::new(Mixture::new(&set, noise.clone(), MixtureOptions::default())),
                    true,
                ),
            ];
            for (name, mut tracker, moving) in kinds {
                let mut filter = MotionFilter::new(acceleration, 1.0);
                let (mut errors, mut failures, mut refused, mut nees) = (Vec::new(), 0, 0, 0.0);
                let (mut searched, mut why) = (0, std::collections::BTreeMap::new());
                let clock = std::time::Instant::now();
                for (w, window) in all.iter().enumerate() {
                    let truth = motion((w as f64 + 0.5) * WINDOW_S);
                    let answer = if moving {
                        filter.step(tracker.as_mut(), window, WINDOW_S)
                    } else {
                        tracker.track(window, None)
                    };
                    match answer {
                        Ok(t) => {
                            let (mean, worst) = marker_errors(&t.markers_world_m, &truth, &set);
                            errors.push(mean * 1e3);
                            failures += usize::from(worst > 3e-3);
                            searched += usize::from(t.reinitialized.is_some());
                            let twin =
                                t.ambiguous.first().map_or(t.world_from_capsule, |r| r.world_from_capsule);
                            let e = |p| lumenav_core::pose::ominus(&p, &truth);
                            let (a, b) = (e(t.world_from_capsule), e(twin));
                            let e = if a.fixed_rows::<3>(3).norm() <= b.fixed_rows::<3>(3).norm() {
                                a
                            } else {
                                // The twin's axes: its covariance is the answer's, turned.
                                let d = twin.rotation.inverse() * t.world_from_capsule.rotation;
                                let mut b = b;
                                let turned = d.inverse() * b.fixed_rows::<3>(3).into_owned();
                                b.fixed_rows_mut::<3>(3).copy_from(&turned);
                                b
                            };
                            if worst < 3e-3 {
                                nees += t.covariance.cholesky().map_or(f64::NAN, |c| e.dot(&c.solve(&e)));
                            }
                        }
                        Err(f) => {
                            refused += 1;
                            let name = format!("{f:?}");
                            *why.entry(name.split([' ', '{']).next().unwrap_or("").to_owned())
                                .or_insert(0) += 1;
                        }
                    }
                }
                let us = clock.elapsed().as_secs_f64() * 1e6 / windows as f64;
                let n = errors.len().max(1) as f64;
                let mean = errors.iter().sum::<f64>() / n;
                let sd = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt();
                let nees = nees / (errors.len() - failures).max(1) as f64;
                println!(
                    "{lines:5.1} lines seed {seed} {name:15} {mean:.3} +- {sd:.3} mm, wrong {failures}, refused {refused} {why:?}, searches {searched}, NEES {nees:.1}, {us:.0} us"
                );
            }
        }
    }
}
