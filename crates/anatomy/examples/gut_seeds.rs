//! Makes guts for many seeds and prints how many were refused, and why, with the time each took:
//! `cargo run --release -p lumenav-anatomy --example gut_seeds -- SIZE FIRST COUNT`. Exit code 1: an overlap got through.

use lumenav_anatomy::generator::{BodySize, WholeGutRequest, whole_gut};
use lumenav_core::RandomStreams;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let size = arguments.first().and_then(|name| BodySize::from_name(name));
    let number = |i: usize| arguments.get(i).and_then(|text| text.parse::<u64>().ok());
    let (Some(size), Some(first), Some(count)) = (size, number(1), number(2)) else {
        eprintln!("usage: gut_seeds SIZE FIRST COUNT");
        return ExitCode::from(2);
    };
    let (mut times_s, mut attempts, mut refused, mut overlaps) = (Vec::new(), 0_u64, 0_u64, 0);
    for seed in first..first + count {
        let start = Instant::now();
        match whole_gut(&WholeGutRequest::new(size), &RandomStreams::new(seed, 0, "whole-gut")) {
            Ok(generated) => {
                attempts += u64::from(generated.attempts);
                overlaps += generated.report.overlaps.len();
            }
            Err(error) => {
                refused += 1;
                println!("seed {seed}: {error}");
            }
        }
        times_s.push(start.elapsed().as_secs_f64());
    }
    times_s.sort_by(f64::total_cmp);
    let made = count - refused;
    println!(
        "{}: {count} seeds, {refused} refused, {overlaps} overlaps, {:.1} attempts per tract; seconds: median {:.2}, 95 % {:.2}, worst {:.2}",
        size.as_str(),
        attempts as f64 / made as f64,
        times_s[times_s.len() / 2],
        times_s[(times_s.len() - 1) * 95 / 100],
        times_s[times_s.len() - 1]
    );
    if overlaps == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
