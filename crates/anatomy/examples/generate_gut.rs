//! Prints the tract file of a generated whole gut:
//! `cargo run --release -p lumenav-anatomy --example generate_gut -- SIZE SEED [LENGTH_SCALE [RADIUS_SCALE]]`.

use lumenav_anatomy::generator::{BodySize, WholeGutRequest, tract_file_text, whole_gut};
use lumenav_anatomy::statistics::TractStatistics;
use lumenav_core::RandomStreams;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments.get(i).map_or(Ok(1.0), |text| text.parse::<f64>());
    let size = arguments.first().and_then(|name| BodySize::from_name(name));
    let seed = arguments.get(1).map(|text| text.parse::<u64>());
    let (Some(size), Some(Ok(seed)), Ok(length_scale), Ok(radius_scale)) = (size, seed, number(2), number(3))
    else {
        let sizes = BodySize::ALL.map(BodySize::as_str).join("|");
        eprintln!("usage: generate_gut {sizes} SEED [LENGTH_SCALE [RADIUS_SCALE]]");
        return ExitCode::from(2);
    };
    let start = Instant::now();
    match whole_gut(
        &WholeGutRequest { size, length_scale, radius_scale },
        &RandomStreams::new(seed, 0, "whole-gut"),
    ) {
        Ok(generated) => {
            eprintln!("{} attempts, {:.2} s", generated.attempts, start.elapsed().as_secs_f64());
            eprintln!("{}", TractStatistics::of(&generated.tract, &generated.report));
            let made_by = format!(
                "cargo run --release -p lumenav-anatomy --example generate_gut -- {}",
                arguments.join(" ")
            );
            print!("{}", tract_file_text(&generated.draft, &made_by));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error} ({:.2} s)", start.elapsed().as_secs_f64());
            ExitCode::FAILURE
        }
    }
}
