//! Simulated seconds per second: ten simulated seconds of the colon per iteration, at 240 Hz, with its spontaneous motility and
//! one mass movement. 20 ms per iteration are 500 times real time; 8.7 ms are eight hours in 25 s.

use lumenav_anatomy::generator::{ColonRequest, colon};
use lumenav_anatomy::motility::Motility;
use lumenav_anatomy::motility_config::MotilityConfig;
use lumenav_core::config::quantity::{Fraction, NonNegative};
use lumenav_core::{CapsuleBody, RandomStreams};
use lumenav_scenario::engine::{Engine, EngineConfig};
use std::sync::Arc;

const CAPSULE: CapsuleBody = CapsuleBody { radius_m: 0.0055, length_m: 0.026, mass_kg: 0.0033 };

fn main() {
    divan::main();
}

fn engine(amplitude_scale: f64) -> Engine {
    let streams = RandomStreams::new(1, 0, "tract");
    // The default request with this seed is one of those the generator's own tests build.
    let tract = Arc::new(colon(&ColonRequest::default(), &streams).expect("the default colon exists").tract);
    let config = MotilityConfig { amplitude_scale: Fraction(amplitude_scale), ..MotilityConfig::default() };
    let motility = Motility::new(&config, &tract, &RandomStreams::new(1, 0, "motility"))
        // The default configuration names no wave that could lie outside the tract.
        .expect("the default motility is valid");
    let config = EngineConfig { start_arc_length_m: NonNegative(0.1), ..EngineConfig::default() };
    // The start lies in the tract, and the capsule is a real one.
    Engine::new(config, tract, motility, CAPSULE).expect("a valid engine")
}

#[divan::bench(args = [0.0, 1.0])]
fn ten_seconds_of_colon(bencher: divan::Bencher, amplitude_scale: f64) {
    let mut engine = engine(amplitude_scale);
    for _ in 0..2400 {
        engine.step();
    }
    bencher.bench_local(|| {
        for _ in 0..2400 {
            engine.step();
        }
        engine.state().arc_length_m
    });
}
