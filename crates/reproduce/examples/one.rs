//! A reproduction from the library, without the program: `cargo run --release -p lumenav-reproduce --example one -- ID [quick|full] [SEED]`.
//! Prints the JSON and writes nothing.

use lumenav_core::ModelFolder;
use lumenav_reproduce::{Context, Executor, Progress, Size, find};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Jobs on as many threads as the machine has.
struct Threads;

impl Executor for Threads {
    fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(|| {
                    while let Some(k) = Some(next.fetch_add(1, Ordering::Relaxed)).filter(|k| *k < count) {
                        job(k);
                    }
                });
            }
        });
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let id = arguments.next().ok_or("which? for example than2015/rates")?;
    let size = if arguments.next().is_some_and(|size| size == "quick") { Size::Quick } else { Size::Full };
    let seed: Option<u64> = arguments.next().map(|seed| seed.parse()).transpose()?;
    let reproduction = find(&id).ok_or("there is no such reproduction")?;
    let models = ModelFolder::new("models");
    let show = |p: Progress<'_>| eprintln!("{}: {} of {}", p.stage, p.done, p.jobs);
    let context = Context::new(
        &models,
        reproduction.seeds(seed.as_ref().map(std::slice::from_ref), size),
        size,
        &Threads,
    )
    .watched(&show);
    let table = reproduction.run(&context)?;
    print!("{}", table.to_json()?);
    eprintln!("{}", table.tally());
    Ok(())
}
