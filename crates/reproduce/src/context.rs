//! What a reproduction is given: models, seeds, size, and somebody who does the work.
//!
//! Work is cut into jobs that know nothing of each other and draw from random streams of their own names; each puts its result at
//! its own place. How many threads do them, and in which order, can therefore not be seen in the result.

use crate::ReproduceError;
use lumenav_core::ModelFolder;
pub use lumenav_core::{Executor, OneAfterAnother};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How much is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// As published.
    Full,
    /// A fraction of the windows, one seed: seconds, to see that it works. The figures are rough and say so.
    Quick,
}

impl Size {
    /// The one or the other.
    pub fn pick<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }
}

/// How far a reproduction is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress<'a> {
    /// What is being computed.
    pub stage: &'a str,
    /// Jobs of this stage that are done.
    pub done: usize,
    /// Jobs of this stage.
    pub jobs: usize,
}

/// What a reproduction is given.
pub struct Context<'a> {
    /// Where scanners, phantoms, capsules and tracts are.
    pub models: &'a ModelFolder,
    /// The seeds; each is a run of its own.
    pub seeds: Vec<u64>,
    /// How much is computed.
    pub size: Size,
    executor: &'a dyn Executor,
    progress: Option<&'a (dyn Fn(Progress<'_>) + Sync)>,
    stopped: Option<&'a (dyn Fn() -> bool + Sync)>,
}

impl<'a> Context<'a> {
    /// Nobody watches, nobody stops it.
    pub fn new(models: &'a ModelFolder, seeds: Vec<u64>, size: Size, executor: &'a dyn Executor) -> Self {
        Self { models, seeds, size, executor, progress: None, stopped: None }
    }

    /// Told how far it is, from whichever thread.
    pub fn watched(self, progress: &'a (dyn Fn(Progress<'_>) + Sync)) -> Self {
        Self { progress: Some(progress), ..self }
    }

    /// Asked before each job whether to stop.
    pub fn stoppable(self, stopped: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Self { stopped: Some(stopped), ..self }
    }

    /// Does `jobs` jobs and gives their results in order.
    ///
    /// # Errors
    /// The error of the first job in order that failed, or [`ReproduceError::Stopped`].
    pub fn jobs<T: Send>(
        &self,
        stage: &str,
        jobs: usize,
        job: impl Fn(usize) -> Result<T, ReproduceError> + Sync,
    ) -> Result<Vec<T>, ReproduceError> {
        let places: Vec<Mutex<Option<Result<T, ReproduceError>>>> =
            (0..jobs).map(|_| Mutex::new(None)).collect();
        let done = AtomicUsize::new(0);
        self.report(stage, 0, jobs);
        self.executor.for_each(jobs, &|k| {
            if self.stopped.is_some_and(|stopped| stopped()) {
                return;
            }
            let result = job(k);
            // A place is locked once; that a job panicked elsewhere does not spoil this result.
            *places[k].lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(result);
            self.report(stage, done.fetch_add(1, Ordering::Relaxed) + 1, jobs);
        });
        let stopped = ReproduceError::Stopped { done: done.into_inner(), jobs };
        let mut results = Vec::with_capacity(jobs);
        for place in places {
            match place.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
                Some(result) => results.push(result?),
                None => return Err(stopped),
            }
        }
        Ok(results)
    }

    fn report(&self, stage: &str, done: usize, jobs: usize) {
        if let Some(progress) = self.progress {
            progress(Progress { stage, done, jobs });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All jobs at once, each on a thread of its own.
    struct Threads;

    impl Executor for Threads {
        fn for_each(&self, count: usize, job: &(dyn Fn(usize) + Sync)) {
            std::thread::scope(|scope| {
                for k in (0..count).rev() {
                    scope.spawn(move || job(k));
                }
            });
        }
    }

    #[test]
    fn law_results_stand_in_order_for_any_executor() {
        let models = ModelFolder::new("models");
        for executor in [&OneAfterAnother as &dyn Executor, &Threads] {
            let context = Context::new(&models, vec![1], Size::Quick, executor);
            let squares = context.jobs("squares", 20, |k| Ok(k * k)).unwrap();
            assert_eq!(squares, (0..20).map(|k| k * k).collect::<Vec<_>>());
        }
    }

    #[test]
    fn law_a_stop_is_said_and_the_first_error_in_order_counts() {
        let models = ModelFolder::new("models");
        let count = AtomicUsize::new(0);
        let stop = || count.fetch_add(1, Ordering::Relaxed) >= 3;
        let context = Context::new(&models, vec![1], Size::Quick, &OneAfterAnother).stoppable(&stop);
        let error = context.jobs("stage", 9, Ok).unwrap_err();
        assert_eq!(error.to_string(), "stopped: 3 of 9 parts were done");
        let context = Context::new(&models, vec![1], Size::Quick, &Threads);
        let fail = |k: usize| match k {
            2 | 5 => Err(ReproduceError::of_part("job")(k)),
            _ => Ok(k),
        };
        assert_eq!(context.jobs("stage", 9, fail).unwrap_err().to_string(), "job: 2");
    }
}
