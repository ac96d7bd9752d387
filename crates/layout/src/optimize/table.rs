//! The information of every candidate at every pose, computed once.

use crate::LayoutError;
use crate::information::Size;
use lumenav_core::jobs::collect;
use lumenav_core::layout::packed_len;
use lumenav_core::{Executor, LayoutElement, LayoutModel};
use nalgebra::Isometry3;

/// Most numbers of a table: 4 GB.
const MOST_NUMBERS: usize = 500_000_000;
const POSES_PER_JOB: usize = 64;

/// Packed informations, pose by pose, candidate by candidate.
pub struct InformationTable {
    /// Number of candidates.
    pub candidates: usize,
    /// Number of poses.
    pub poses: usize,
    /// Number of parameters.
    pub size: Size,
    one: usize,
    values: Vec<f64>,
}

impl InformationTable {
    /// Of these candidates at these poses.
    ///
    /// # Errors
    /// [`LayoutError::Dependent`], or a table that does not fit into memory.
    pub fn new(
        model: &dyn LayoutModel,
        candidates: &[LayoutElement],
        poses: &[Isometry3<f64>],
        executor: &dyn Executor,
    ) -> Result<Self, LayoutError> {
        let size = Size::from(model.parameters());
        let one = packed_len(size.all);
        let numbers = candidates.len() * poses.len() * one;
        if numbers > MOST_NUMBERS {
            return Err(LayoutError::Impossible(format!(
                "{} candidates at {} poses do not fit into memory; give fewer poses or candidates",
                candidates.len(),
                poses.len()
            )));
        }
        let job = |k: usize| {
            let mut worker = model.worker();
            let poses = &poses[k * POSES_PER_JOB..poses.len().min((k + 1) * POSES_PER_JOB)];
            let mut part = vec![0.0; poses.len() * candidates.len() * one];
            let mut works = true;
            for (pose, out) in poses.iter().zip(part.chunks_mut(candidates.len() * one)) {
                works &= worker.each(candidates, pose, out);
            }
            works.then_some(part)
        };
        let mut values = Vec::with_capacity(numbers);
        for part in collect(executor, poses.len().div_ceil(POSES_PER_JOB), job) {
            values.extend(part.flatten().ok_or(LayoutError::Dependent)?);
        }
        Ok(Self { candidates: candidates.len(), poses: poses.len(), size, one, values })
    }

    /// The table of groups of candidates, each as one.
    #[must_use]
    pub fn of_groups(self, groups: &[Vec<usize>]) -> Self {
        if groups.len() == self.candidates && groups.iter().enumerate().all(|(k, group)| group[..] == [k]) {
            return self;
        }
        let mut values = vec![0.0; self.poses * groups.len() * self.one];
        for (at, sum) in values.chunks_mut(self.one).enumerate() {
            for candidate in &groups[at % groups.len()] {
                crate::evaluate::add(sum, self.at(at / groups.len(), *candidate));
            }
        }
        Self { candidates: groups.len(), values, ..self }
    }

    /// Numbers of one matrix.
    pub fn len_of_one(&self) -> usize {
        self.one
    }

    /// What a candidate says at a pose.
    #[inline]
    pub fn at(&self, pose: usize, candidate: usize) -> &[f64] {
        let from = (pose * self.candidates + candidate) * self.one;
        &self.values[from..from + self.one]
    }
}
