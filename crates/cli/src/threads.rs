//! Jobs on rayon's threads.

use lumenav::core::Executor;
use rayon::prelude::*;

/// A pool of threads.
pub struct Threads(rayon::ThreadPool);

impl Threads {
    /// So many threads; `None`: as many as the machine has cores.
    ///
    /// # Errors
    /// Threads that the system does not give.
    pub fn new(count: Option<usize>) -> anyhow::Result<Self> {
        Ok(Self(rayon::ThreadPoolBuilder::new().num_threads(count.unwrap_or(0)).build()?))
    }
}

impl Executor for Threads {
    fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync)) {
        self.0.install(|| (0..count).into_par_iter().with_max_len(1).for_each(job));
    }
}
