//! Finding a layout: choosing from candidates ([`exchange`]), moving freely ([`moving`]), and a bound on what any choice can reach
//! ([`relaxation`]).
//!
//! Searches start from several places, drawn from named random streams; starts are jobs, the best of them (the first of equals) is the
//! answer, so threads cannot be seen. Stopped, each keeps the best it has.

pub mod exchange;
mod lbfgs;
pub mod moving;
pub mod relaxation;
pub mod sites;
mod table;

pub use sites::{KeepOut, Sites};
pub use table::InformationTable;

use crate::LayoutError;
use crate::criterion::Criterion;
use crate::information::{Inverse, Size};
use crate::workspace::Workspace;
use lumenav_core::jobs::collect;
use lumenav_core::{Executor, LayoutElement, LayoutModel};
use nalgebra::Isometry3;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// What is asked.
#[derive(Clone, Debug)]
pub struct Question<'a> {
    /// The sensor.
    pub model: &'a dyn LayoutModel,
    /// Where it is judged.
    pub poses: Vec<Isometry3<f64>>,
    /// What is minimised.
    pub criterion: Criterion,
    /// What a layout has to keep.
    pub sites: Sites,
    /// Seed of the starts.
    pub seed: u64,
    /// Number of starts.
    pub starts: usize,
}

/// A layout that was found.
#[derive(Clone, Debug)]
pub struct Found {
    /// Its elements.
    pub elements: Vec<LayoutElement>,
    /// F of it.
    pub f: f64,
    /// The start it came from, from 0.
    pub start: usize,
    /// Starts that ended with a layout, and the F of each.
    pub all_f: Vec<f64>,
}

/// How far a search is: starts that are done, and the best F so far.
pub type Watch<'a> = &'a (dyn Fn(usize, f64) + Sync);

impl<'a> Question<'a> {
    /// Asked over a whole workspace.
    pub fn new(model: &'a dyn LayoutModel, workspace: &Workspace, criterion: Criterion) -> Self {
        Self { model, poses: workspace.poses(), criterion, sites: Sites::default(), seed: 1, starts: 1 }
    }

    /// F of a layout.
    pub fn value(&self, elements: &[LayoutElement]) -> f64 {
        let size = Size::from(self.model.parameters());
        let prior = self.model.prior();
        let mut worker = self.model.worker();
        let mut information = vec![0.0; prior.len()];
        self.criterion.value(self.poses.len(), f64::INFINITY, |i| {
            worker.together(elements, &self.poses[i], &mut information);
            crate::evaluate::add(&mut information, &prior);
            Inverse::of(&information, size)
        })
    }

    /// Whether an element says anything by itself: what both searches stand on.
    ///
    /// # Errors
    /// [`LayoutError::Dependent`].
    pub fn check_independent(&self) -> Result<(), LayoutError> {
        let (Some(element), Some(pose)) = (self.model.elements().first(), self.poses.first()) else {
            return Ok(());
        };
        let mut information = self.model.prior();
        let is_independent = self.model.worker().each(std::slice::from_ref(element), pose, &mut information);
        if is_independent { Ok(()) } else { Err(LayoutError::Dependent) }
    }
}

/// How a start ended.
enum Ended {
    /// With a layout and its F.
    Found(Vec<LayoutElement>, f64),
    /// Without one that is allowed.
    Nothing,
    /// Before there was one.
    Stopped,
}

/// Runs the starts, each a job, and takes the best of them; `nothing` says why there is none.
fn run(
    starts: usize,
    executor: &dyn Executor,
    watch: Watch<'_>,
    start: impl Fn(usize) -> Ended + Sync,
    nothing: impl FnOnce() -> LayoutError,
) -> Result<Found, LayoutError> {
    let (done, least) = (AtomicUsize::new(0), Mutex::new(f64::INFINITY));
    let results = collect(executor, starts.max(1), |k| {
        let ended = start(k);
        if let Ended::Found(_, f) = &ended {
            let mut least = least.lock().unwrap_or_else(PoisonError::into_inner);
            *least = least.min(*f);
            watch(done.fetch_add(1, Ordering::Relaxed) + 1, *least);
        }
        ended
    });
    let mut best: Option<Found> = None;
    let (mut all_f, mut is_stopped) = (Vec::new(), false);
    for (start, ended) in results.into_iter().enumerate() {
        match ended {
            Some(Ended::Found(elements, f)) => {
                all_f.push(f);
                if best.as_ref().is_none_or(|b| f < b.f) {
                    best = Some(Found { elements, f, start, all_f: Vec::new() });
                }
            }
            Some(Ended::Nothing) => {}
            Some(Ended::Stopped) | None => is_stopped = true,
        }
    }
    match best {
        Some(found) => Ok(Found { all_f, ..found }),
        None if is_stopped => Err(LayoutError::Stopped),
        None => Err(nothing()),
    }
}
