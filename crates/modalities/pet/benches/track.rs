//! Time per window of 210 lines and three markers: the three trackers on a followed capsule, and a global search; and how often the
//! allocator is asked by them once they are warm (it must not be).
//!
//! Full ring, 20 cm of water, four of five lines true, the helix of than2015.

#![allow(dead_code, reason = "one support file for tests, benches and the table of examples")]

#[path = "../tests/tracking/support.rs"]
mod support;

use divan::{AllocProfiler, Bencher};
use lumenav_pet::Line;
use lumenav_pet::tracking::{
    BlockNoise, ClassicOptions, Fcm, Mixture, MixtureOptions, Rigid, Tracked, Tracker,
};
use support::{Ends, Generator, WINDOW_S, helix, noise_of, scanner, triangle};

/// Divan counts what the benches allocate: columns of zeros are the check.
#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

const LINES: usize = 210;
const WINDOWS: usize = 40;

fn windows() -> Vec<Vec<Line>> {
    let law = Ends::Law(BlockNoise::reference());
    let mut generator = Generator::new(scanner("allegro"), law, triangle(), 1);
    let trues = LINES * 4 / 5;
    let one = |w: usize| generator.window(&|t| helix(t, 1.0), w as f64 * WINDOW_S, trues, LINES - trues).0;
    (0..WINDOWS).map(one).collect()
}

/// Follows the windows to and fro, so that each lies a window's way from the last.
fn follow(bencher: Bencher<'_, '_>, mut tracker: Box<dyn Tracker>) {
    let windows = windows();
    let mut out = Tracked::default();
    let order: Vec<usize> = (0..WINDOWS).chain((1..WINDOWS - 1).rev()).collect();
    for w in &order {
        // Warm: buffers have their size.
        let _ = tracker.track_into(&windows[*w], None, &mut out);
    }
    let mut at = 0;
    bencher.bench_local(|| {
        at = (at + 1) % order.len();
        tracker.track_into(&windows[order[at]], None, &mut out).is_ok()
    });
}

#[divan::bench(sample_size = 40, sample_count = 100)]
fn fcm(bencher: Bencher<'_, '_>) {
    follow(bencher, Box::new(Fcm::new(&triangle(), ClassicOptions::default())));
}

#[divan::bench(sample_size = 40, sample_count = 100)]
fn rigid(bencher: Bencher<'_, '_>) {
    follow(bencher, Box::new(Rigid::new(&triangle(), ClassicOptions::default())));
}

#[divan::bench(sample_size = 40, sample_count = 100)]
fn mixture(bencher: Bencher<'_, '_>) {
    let options = MixtureOptions { test_permutations: false, ..MixtureOptions::default() };
    follow(bencher, Box::new(Mixture::new(&triangle(), noise_of(&scanner("allegro")), options)));
}

/// With the test of the markers' orders every tenth window.
#[divan::bench(sample_size = 40, sample_count = 100)]
fn mixture_with_test(bencher: Bencher<'_, '_>) {
    let mixture = Mixture::new(&triangle(), noise_of(&scanner("allegro")), MixtureOptions::default());
    follow(bencher, Box::new(mixture));
}

/// The first window, of which nothing is known.
#[divan::bench(sample_count = 40)]
fn initialize(bencher: Bencher<'_, '_>) {
    let windows = windows();
    let fresh = Mixture::new(&triangle(), noise_of(&scanner("allegro")), MixtureOptions::default());
    let mut out = Tracked::default();
    let mut w = 0;
    bencher.with_inputs(|| fresh.clone()).bench_local_values(|mut tracker| {
        w = (w + 1) % WINDOWS;
        tracker.track_into(&windows[w], None, &mut out).is_ok()
    });
}
