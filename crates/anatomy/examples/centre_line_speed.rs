//! Times the calls of the engine's hot loop: `cargo run --release -p lumenav-anatomy --example centre_line_speed -- TRACT.toml`.

use lumenav_anatomy::tract_file::{TractOptions, load};
use lumenav_core::Node;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: centre_line_speed TRACT.toml")?;
    let start = Instant::now();
    let (tract, _) = load(&Node::open(Path::new(&path))?, &TractOptions::default())?;
    println!("load and check: {:.1} ms, {:.3} m", start.elapsed().as_secs_f64() * 1e3, tract.length_m());
    let count = 200_000_u32;
    let at = |i: u32| tract.length_m() * (f64::from(i) * 0.618_034).fract();
    // The best of 20 batches: what the machine does besides only ever adds.
    let time = |name: &str, repeats: u32, call: &dyn Fn(u32)| {
        let batch = |first: u32| {
            let start = Instant::now();
            (first..first + repeats / 20).for_each(call);
            start.elapsed().as_secs_f64() * 20e9 / f64::from(repeats)
        };
        let best = (0..20).map(|i| batch(i * (repeats / 20))).fold(f64::INFINITY, f64::min);
        println!("{name}: {best:.0} ns");
    };
    let points: Vec<_> = (0..count)
        .map(|i| {
            let station = tract.station(at(i));
            station.position_m + station.normal * 0.003
        })
        .collect();
    time("station, anywhere", count, &|i| {
        black_box(tract.station(at(i)));
    });
    time("radius with slope", count, &|i| {
        black_box(tract.radius.with_slope(at(i)));
    });
    // The engine's way: five rings 6 mm apart, moving by 5 um per step.
    let walk = |i: u32| 0.1 + 0.006 * f64::from(i % 5) + 5e-6 * f64::from(i / 5);
    time("station, walking", count, &|i| {
        black_box(tract.station(walk(i)));
    });
    let off: Vec<_> = (0..count)
        .map(|i| tract.station(walk(i)))
        .map(|station| station.position_m + station.normal * 0.003)
        .collect();
    time("project_near, walking, hint 5 um off", count, &|i| {
        black_box(tract.centre_line.project_near(&off[i as usize], walk(i) + 5e-6));
    });
    time("project_near, anywhere, hint 50 um off", count, &|i| {
        black_box(tract.centre_line.project_near(&points[i as usize], at(i) + 5e-5));
    });
    time("nearest 3", 2_000, &|i| {
        black_box(tract.centre_line.nearest(&points[i as usize], 3));
    });
    Ok(())
}
