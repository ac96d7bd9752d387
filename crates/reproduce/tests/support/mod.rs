//! What the tests of all publications share.

use lumenav_core::ModelFolder;
use lumenav_reproduce::{Context, Executor, Size, Table, find};

/// Two threads, the last job first.
pub struct Backwards;

impl Executor for Backwards {
    fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync)) {
        std::thread::scope(|scope| {
            let odd = scope.spawn(|| (0..count).rev().filter(|k| k % 2 == 1).for_each(job));
            (0..count).rev().filter(|k| k % 2 == 0).for_each(job);
            odd.join().unwrap();
        });
    }
}

/// The shipped models.
pub fn models() -> ModelFolder {
    ModelFolder::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models"))
}

/// A reproduction in seconds.
pub fn quick(id: &str, executor: &dyn Executor) -> Table {
    let (models, reproduction) = (models(), find(id).unwrap());
    let seeds = reproduction.seeds(None, Size::Quick);
    reproduction.run(&Context::new(&models, seeds, Size::Quick, executor)).unwrap()
}
