//! Work cut into jobs that know nothing of each other, each with a place for its result: who does them, on how many threads and in
//! which order, cannot be seen in what comes out.

use std::sync::{Mutex, PoisonError};

/// Does jobs, in any order and on any number of threads.
pub trait Executor: Sync {
    /// Calls `job` once with each of 0 to `count - 1` and comes back when all are done.
    fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync));
}

/// One job after another on the calling thread.
#[derive(Clone, Copy, Debug, Default)]
pub struct OneAfterAnother;

impl Executor for OneAfterAnother {
    fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync)) {
        (0..count).for_each(job);
    }
}

/// Results of `count` jobs, in order; `None` for one that the executor never called.
pub fn collect<T: Send>(
    executor: &dyn Executor,
    count: usize,
    job: impl Fn(usize) -> T + Sync,
) -> Vec<Option<T>> {
    let places: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
    executor.for_each(count, &|k| {
        let result = job(k);
        // A place is locked once; that a job panicked elsewhere does not spoil this result.
        *places[k].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    });
    places.into_iter().map(|place| place.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_results_stand_in_order() {
        struct Backwards;
        impl Executor for Backwards {
            fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync)) {
                (1..count).rev().for_each(job);
            }
        }
        assert_eq!(collect(&OneAfterAnother, 3, |k| k * k), [Some(0), Some(1), Some(4)]);
        assert_eq!(collect(&Backwards, 3, |k| k), [None, Some(1), Some(2)]);
    }
}
