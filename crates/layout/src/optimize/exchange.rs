//! Choosing elements from candidates: greedy, then exchange. Under mirror planes an orbit ([`super::sites`]) counts as one candidate.
//!
//! The first start adds, one by one, the candidate that lowers F most (with a little of all candidates' information beside it, until
//! the chosen ones see everything by themselves); the others start from random choices. Then, as Fedorov's exchange does: each chosen
//! element is replaced by the candidate that lowers F most, round after round, until no exchange helps.

use super::table::InformationTable;
use super::{Ended, Found, Question, Watch};
use crate::LayoutError;
use crate::criterion::Criterion;
use crate::information::Inverse;
use lumenav_core::{Executor, LayoutElement, RandomStreams};
use rand::RngExt as _;

/// Share of all candidates' information that a greedy start leans on.
const LEANING: f64 = 1e-3;
/// An exchange must lower F by this share of it.
const LEAST_GAIN: f64 = 1e-9;
/// Exponents of the p-norms on the way to a maximum.
const SMOOTH: [f64; 2] = [8.0, 32.0];
/// Draws of a random choice that keeps the spacing.
const DRAWS: usize = 200;

/// What was chosen, beside the layout.
pub struct Chosen {
    /// The layout.
    pub found: Found,
    /// Candidates that could be chosen.
    pub candidates: usize,
    /// Candidates left out because they give no reading at some pose, or stand where nothing may.
    pub unusable: usize,
    /// Candidates left out because a mirror image is missing.
    pub unpaired: usize,
    /// What each orbit of candidates says at each pose.
    pub table: InformationTable,
    /// How many orbits were chosen.
    pub orbits: usize,
}

/// Chooses `count` of the model's candidates.
///
/// # Errors
/// [`LayoutError`]: more asked than there are, none that is usable, elements that work only together, stopped.
pub fn choose(
    question: &Question<'_>,
    count: usize,
    executor: &dyn Executor,
    watch: Watch<'_>,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<Chosen, LayoutError> {
    let all = question.model.candidates();
    let usable: Vec<LayoutElement> = all.iter().filter(|c| question.is_usable(c)).cloned().collect();
    let unusable = all.len() - usable.len();
    let groups = question.sites.orbits_of_candidates(&usable);
    let size = question.sites.orbit_len();
    let paired = groups.len() * size;
    if count == 0 || count > paired || !count.is_multiple_of(size) {
        let of_orbits = if size > 1 {
            format!(", {} have no mirror image; allowed: multiples of {size}", usable.len() - paired)
        } else {
            "; allowed: 1".to_owned()
        };
        return Err(LayoutError::Impossible(format!(
            "{count} elements asked of {} candidates, of which {unusable} give no reading at some pose (saturated, or in the magnet) or stand where nothing may{of_orbits} to {paired}",
            all.len(),
        )));
    }
    let table = InformationTable::new(question.model, &usable, &question.poses, executor)?.of_groups(&groups);
    let orbits = count / size;
    let search = Search {
        question,
        table: &table,
        elements: &usable,
        groups: &groups,
        prior: question.model.prior(),
        count: orbits,
    };
    let start = |k: usize| search.run_start(k, stopped);
    let found = super::run(question.starts, executor, watch, start, || {
        LayoutError::Impossible(format!(
            "no choice of {count} candidates keeps {} and has a bound at every pose",
            question.sites.words()
        ))
    })?;
    Ok(Chosen { found, candidates: paired, unusable, unpaired: usable.len() - paired, table, orbits })
}

struct Search<'a> {
    question: &'a Question<'a>,
    table: &'a InformationTable,
    elements: &'a [LayoutElement],
    /// What is chosen from: single elements, or orbits of them.
    groups: &'a [Vec<usize>],
    prior: Vec<f64>,
    count: usize,
}

/// Whether F fell by more than rounding; any finite F is less than an infinite one.
fn is_less(f: f64, before: f64) -> bool {
    if before == f64::INFINITY { f < before } else { f < before - LEAST_GAIN * before.abs() }
}

impl Search<'_> {
    fn elements(&self, chosen: &[usize]) -> Vec<LayoutElement> {
        let members = chosen.iter().flat_map(|i| &self.groups[*i]);
        members.map(|i| self.elements[*i].clone()).collect()
    }

    fn run_start(&self, start: usize, stopped: &dyn Fn() -> bool) -> Ended {
        if stopped() {
            return Ended::Stopped;
        }
        let first = if start == 0 { self.greedy(stopped) } else { None };
        let Some(mut chosen) = first.or_else(|| self.random(start)) else { return Ended::Nothing };
        // A maximum does not feel an exchange that leaves the worst pose as it is: the way there leads over norms that do.
        if matches!(self.question.criterion, Criterion::Worst | Criterion::E) {
            for p in SMOOTH {
                self.exchange(&mut chosen, Criterion::PNorm(p), stopped);
            }
        }
        let f = self.exchange(&mut chosen, self.question.criterion, stopped);
        if f == f64::INFINITY {
            return if stopped() { Ended::Stopped } else { Ended::Nothing };
        }
        chosen.sort_unstable();
        Ended::Found(self.elements(&chosen), f)
    }

    /// Whether candidate `i` keeps its distance from those chosen, all but the one at `except`.
    fn has_room(&self, i: usize, chosen: &[usize], except: Option<usize>) -> bool {
        let sites = &self.question.sites;
        let apart = |other: usize| {
            let of = |k: usize| self.groups[k].iter().map(|e| &self.elements[*e]);
            sites.spacing_m <= 0.0 || of(other).all(|a| of(i).all(|b| sites.apart(a, b)))
        };
        let mut others = chosen.iter().enumerate().filter(|(at, _)| Some(*at) != except);
        others.all(|(_, other)| *other != i && apart(*other))
    }

    fn random(&self, start: usize) -> Option<Vec<usize>> {
        let mut stream = RandomStreams::new(self.question.seed, 0, "layout").stream("exchange", start as u64);
        for _ in 0..DRAWS {
            let mut left: Vec<usize> = (0..self.groups.len()).collect();
            let mut chosen = Vec::with_capacity(self.count);
            while chosen.len() < self.count && !left.is_empty() {
                let i = left.swap_remove(stream.random_range(0..left.len()));
                if self.has_room(i, &chosen, None) {
                    chosen.push(i);
                }
            }
            if chosen.len() == self.count {
                return Some(chosen);
            }
        }
        None
    }

    /// Prior and the sum of those chosen, pose after pose.
    fn sums(&self, chosen: &[usize]) -> Vec<f64> {
        let one = self.table.len_of_one();
        let mut sums = Vec::with_capacity(self.table.poses * one);
        for pose in 0..self.table.poses {
            sums.extend_from_slice(&self.prior);
            let sum = &mut sums[pose * one..];
            for i in chosen {
                crate::evaluate::add(sum, self.table.at(pose, *i));
            }
        }
        sums
    }

    /// F of sums with one candidate more and, if named, one less.
    fn value_with(
        &self,
        criterion: Criterion,
        sums: &[f64],
        more: usize,
        less: Option<usize>,
        limit: f64,
        buffer: &mut [f64],
    ) -> f64 {
        let one = self.table.len_of_one();
        criterion.value(self.table.poses, limit, |pose| {
            let added = self.table.at(pose, more);
            let sum = &sums[pose * one..(pose + 1) * one];
            if let Some(less) = less {
                let taken = self.table.at(pose, less);
                for (((out, s), a), t) in buffer.iter_mut().zip(sum).zip(added).zip(taken) {
                    *out = s + a - t;
                }
            } else {
                for ((out, s), a) in buffer.iter_mut().zip(sum).zip(added) {
                    *out = s + a;
                }
            }
            Inverse::of(buffer, self.table.size)
        })
    }

    fn greedy(&self, stopped: &dyn Fn() -> bool) -> Option<Vec<usize>> {
        let one = self.table.len_of_one();
        let mut sums = self.sums(&[]);
        for (pose, sum) in sums.chunks_mut(one).enumerate() {
            for i in 0..self.table.candidates {
                for (s, v) in sum.iter_mut().zip(self.table.at(pose, i)) {
                    *s += LEANING * v / self.table.candidates as f64;
                }
            }
        }
        let mut chosen = Vec::with_capacity(self.count);
        let mut buffer = vec![0.0; one];
        while chosen.len() < self.count {
            let mut best: Option<(f64, usize)> = None;
            for i in (0..self.table.candidates).filter(|i| self.has_room(*i, &chosen, None)) {
                let limit = best.map_or(f64::INFINITY, |(f, _)| f);
                let f = self.value_with(self.question.criterion, &sums, i, None, limit, &mut buffer);
                if best.is_none_or(|(least, _)| f < least) {
                    best = Some((f, i));
                }
            }
            let (_, i) = best?;
            if stopped() {
                return None;
            }
            chosen.push(i);
            for (pose, sum) in sums.chunks_mut(one).enumerate() {
                crate::evaluate::add(sum, self.table.at(pose, i));
            }
        }
        Some(chosen)
    }

    /// Exchanges until none helps; F.
    fn exchange(&self, chosen: &mut [usize], criterion: Criterion, stopped: &dyn Fn() -> bool) -> f64 {
        let one = self.table.len_of_one();
        let mut buffer = vec![0.0; one];
        let mut sums = self.sums(chosen);
        let mut f = criterion.value(self.table.poses, f64::INFINITY, |pose| {
            Inverse::of(&sums[pose * one..(pose + 1) * one], self.table.size)
        });
        loop {
            let before = f;
            for at in 0..chosen.len() {
                if stopped() {
                    return f;
                }
                let mut best = None;
                for i in (0..self.table.candidates)
                    .filter(|i| self.has_room(*i, chosen, Some(at)) && *i != chosen[at])
                {
                    let value = self.value_with(criterion, &sums, i, Some(chosen[at]), f, &mut buffer);
                    if is_less(value, f) {
                        f = value;
                        best = Some(i);
                    }
                }
                if let Some(i) = best {
                    chosen[at] = i;
                    // Summed anew: differences of sums would drift.
                    sums = self.sums(chosen);
                }
            }
            if !is_less(f, before) {
                return f;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_any_bound_is_less_than_none() {
        assert!(is_less(-3.0, f64::INFINITY) && is_less(1e300, f64::INFINITY));
        assert!(!is_less(f64::INFINITY, f64::INFINITY) && !is_less(f64::INFINITY, 1.0));
        assert!(is_less(0.999, 1.0) && !is_less(1.0 - 1e-12, 1.0) && is_less(-1.1, -1.0));
    }
}
