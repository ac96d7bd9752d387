//! Prints the figures of tracts beside those measured in people:
//! `cargo run --release -p lumenav-anatomy --example tract_statistics -- FILE…`. Exit code 1: a figure lies outside its range.

use lumenav_anatomy::statistics::TractStatistics;
use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_core::Node;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let files: Vec<String> = std::env::args().skip(1).collect();
    if files.is_empty() {
        eprintln!("usage: tract_statistics FILE…");
        return ExitCode::from(2);
    }
    let mut all_inside = true;
    for file in files {
        match Node::open(Path::new(&file)).and_then(|node| load(&node, &TractOptions::default())) {
            Ok((tract, report)) => {
                let statistics = TractStatistics::of(&tract, &report);
                println!("{file}\n{statistics}");
                for verdict in statistics.verdicts() {
                    all_inside &= verdict.inside();
                    println!("{verdict}");
                }
                println!();
            }
            Err(error) => {
                eprintln!("{error}");
                return ExitCode::from(2);
            }
        }
    }
    if all_inside { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
