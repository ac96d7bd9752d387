//! Runs a scenario with the beacons registered and prints each track's error: what a program of your own does, without lumenav's
//! command line and files.
//!
//! ```text
//! cargo run --release --example run -- scenario.toml key=value …        (in this folder)
//! ```

mod errors;

use errors::TrackErrors;
use lumenav::pipeline::{Observers, simulate};
use lumenav::{default_registry, open_scenario, stage};
use lumenav_beacons::Beacons;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "scenario.toml".to_owned());
    let overrides: Vec<String> = std::env::args().skip(2).collect();
    let file = open_scenario(path.as_ref(), &overrides, None)?;
    let seed = file.scenario.seed;
    let registry = default_registry().with(Beacons);
    let mut errors = TrackErrors::default();
    let mut observers = Observers::new(vec![&mut errors]);
    let summary = simulate(&file, &registry, seed, 0, stage(&file, seed, 0)?, &mut observers, &|| false)?;
    println!("{} (seed {seed}): {} readings", file.scenario.name, summary.readings);
    for (track, of) in &errors.tracks {
        let (mean_mm, worst_mm) = (of.mean_mm(), of.worst_mm);
        println!("{track}: {} updates, mean error {mean_mm:.3} mm, worst {worst_mm:.3} mm", of.judged);
    }
    Ok(())
}
