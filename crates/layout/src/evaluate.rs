//! The map of the bound over a workspace, its summary, and what is left when elements die.

use crate::LayoutError;
use crate::criterion::Criterion;
use crate::information::{Inverse, PoseBound, Size};
use crate::workspace::Workspace;
use lumenav_core::jobs::collect;
use lumenav_core::layout::packed_len;
use lumenav_core::{Executor, LayoutElement, LayoutModel};
use nalgebra::Isometry3;
use serde::Serialize;

/// Poses of one job.
const POSES_PER_JOB: usize = 1024;

/// The bound at every pose of a workspace, in its order; `None` where it is infinite, or larger than the way to the furthest element.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Per pose.
    pub bounds: Vec<Option<PoseBound>>,
    /// Pairs of an element and a pose at which it gives no reading.
    pub without_reading: usize,
}

/// Judges elements of a model at every pose.
///
/// # Errors
/// [`LayoutError::Stopped`].
pub fn evaluate(
    model: &dyn LayoutModel,
    elements: &[LayoutElement],
    workspace: &Workspace,
    executor: &dyn Executor,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<Evaluation, LayoutError> {
    let parameters = model.parameters();
    let prior = model.prior();
    let poses = workspace.len();
    let least_m = model.least_distance_m();
    let one = |job: usize| -> Option<(Vec<Option<PoseBound>>, usize)> {
        if stopped() {
            return None;
        }
        let mut worker = model.worker();
        let mut information = vec![0.0; packed_len(parameters.len())];
        let mut without_reading = 0;
        let of = |pose: usize| {
            let pose = workspace.pose(pose);
            worker.together(elements, &pose, &mut information);
            add(&mut information, &prior);
            let may_be_blocked = |e: &&LayoutElement| {
                let way = e.world_from_element.translation.vector - pose.translation.vector;
                least_m <= 0.0 || way.norm_squared() < least_m * least_m
            };
            let near = elements.iter().filter(may_be_blocked);
            without_reading += near.filter(|e| model.blocked(e, &pose).is_some()).count();
            let bound = Inverse::of(&information, parameters).map(|inverse| inverse.bound(parameters));
            bound.filter(|bound| says_something(bound, elements, &pose))
        };
        let bounds = (job * POSES_PER_JOB..poses.min((job + 1) * POSES_PER_JOB)).map(of).collect();
        Some((bounds, without_reading))
    };
    let parts = collect(executor, poses.div_ceil(POSES_PER_JOB), one);
    let mut evaluation = Evaluation { bounds: Vec::with_capacity(poses), without_reading: 0 };
    for part in parts {
        let (bounds, without_reading) = part.flatten().ok_or(LayoutError::Stopped)?;
        evaluation.bounds.extend(bounds);
        evaluation.without_reading += without_reading;
    }
    Ok(evaluation)
}

/// Whether an error is smaller than the way to the furthest element: a bound is local, and beyond that it says nothing of where the capsule
/// is.
fn says_something(bound: &PoseBound, elements: &[LayoutElement], pose: &Isometry3<f64>) -> bool {
    let place = pose.translation.vector;
    let error = bound.position_m();
    elements.iter().any(|e| (e.world_from_element.translation.vector - place).norm() > error)
}

/// Adds one packed matrix to another.
pub(crate) fn add(to: &mut [f64], more: &[f64]) {
    for (a, b) in to.iter_mut().zip(more) {
        *a += b;
    }
}

/// What a map comes down to. Lengths in mm, angles in degrees; absent: infinite.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Elements of the layout.
    pub elements: usize,
    /// Their cost.
    pub cost: f64,
    /// Poses judged.
    pub poses: usize,
    /// Poses at which the bound is infinite (something of the pose is not seen at all), or larger than the way to the furthest element.
    pub poses_without_bound: usize,
    /// Pairs of an element and a pose at which it gives no reading (saturated, in the magnet).
    pub pairs_without_reading: usize,
    /// √(mean tr C).
    pub rms_mm: Option<f64>,
    /// √(mean C_ii) along x, y, z.
    pub rms_per_axis_mm: Option<[f64; 3]>,
    /// Mean √(tr C).
    pub mean_mm: Option<f64>,
    /// Median of √(tr C).
    pub median_mm: Option<f64>,
    /// Its 95th percentile.
    pub p95_mm: Option<f64>,
    /// Its largest.
    pub worst_mm: Option<f64>,
    /// Mean log det C, log m⁶.
    pub mean_log_det: Option<f64>,
    /// Largest √λ_max(C).
    pub e_mm: Option<f64>,
    /// √(mean squared angle).
    pub angle_rms_deg: Option<f64>,
    /// The largest angle.
    pub angle_worst_deg: Option<f64>,
    /// The wanted error.
    pub wanted_mm: f64,
    /// Share of the poses whose √(tr C) is at most that.
    pub share_below_wanted: f64,
}

/// The value below which a share of the sorted values lies (nearest rank).
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).copied().filter(|v| v.is_finite())
}

impl Evaluation {
    /// Errors √(tr C), m; infinite where there is no bound.
    pub fn errors_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.bounds.iter().map(|b| b.map_or(f64::INFINITY, |b| b.position_m()))
    }

    /// The summary for a layout of these elements.
    pub fn summary(&self, elements: &[LayoutElement], wanted_mm: f64) -> Summary {
        let mut sorted_mm: Vec<f64> = self.errors_m().map(|m| 1e3 * m).collect();
        sorted_mm.sort_by(f64::total_cmp);
        let known: Vec<&PoseBound> = self.bounds.iter().flatten().collect();
        let poses = self.bounds.len();
        let all = known.len() == poses;
        // A mean over poses of which one is infinite is infinite.
        let mean = |of: &dyn Fn(&PoseBound) -> f64| {
            all.then(|| known.iter().map(|b| of(b)).sum::<f64>() / poses as f64)
        };
        let largest =
            |of: &dyn Fn(&PoseBound) -> f64| all.then(|| known.iter().map(|b| of(b)).fold(0.0, f64::max));
        let root_mm = |m2: f64| 1e3 * m2.max(0.0).sqrt();
        let axis = |i: usize| mean(&move |b| b.position_m2[(i, i)]).map(root_mm);
        let below = sorted_mm.partition_point(|v| *v <= wanted_mm);
        Summary {
            elements: elements.len(),
            cost: elements.iter().map(|e| e.cost).sum(),
            poses,
            poses_without_bound: poses - known.len(),
            pairs_without_reading: self.without_reading,
            rms_mm: mean(&|b| b.position_m2.trace()).map(root_mm),
            rms_per_axis_mm: axis(0).zip(axis(1)).zip(axis(2)).map(|((x, y), z)| [x, y, z]),
            mean_mm: mean(&|b| 1e3 * b.position_m()),
            median_mm: quantile(&sorted_mm, 0.5),
            p95_mm: quantile(&sorted_mm, 0.95),
            worst_mm: largest(&|b| 1e3 * b.position_m()),
            mean_log_det: mean(&|b| b.position_m2.determinant().ln()),
            e_mm: largest(&|b| root_mm(b.largest_m2())),
            angle_rms_deg: mean(&|b| b.angle_rad.powi(2)).map(|v| v.sqrt().to_degrees()),
            angle_worst_deg: largest(&|b| b.angle_rad.to_degrees()),
            wanted_mm,
            share_below_wanted: below as f64 / poses as f64,
        }
    }
}

/// The worst that the death of so many elements can do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Deaths {
    /// How many die.
    pub dead: usize,
    /// Choices of them that were looked at.
    pub choices: usize,
    /// Whether those are all there are; else the choices follow the worst one of fewer deaths.
    pub exhaustive: bool,
    /// Poses that they were judged at.
    pub poses: usize,
    /// √(mean tr C) of the whole layout at those poses, mm; absent: infinite.
    pub alive_rms_mm: Option<f64>,
    /// Of all choices the largest √(mean tr C), mm; absent: infinite.
    pub rms_mm: Option<f64>,
    /// Who dies then.
    pub elements: Vec<String>,
}

/// Choices that are all tried; of more, the worst one of fewer deaths goes on.
const MOST_CHOICES: usize = 3000;
/// Poses that deaths are judged at, at most: every so many positions, each with all directions.
const DEATH_POSES: usize = 3000;
/// The same two where elements work only together: every choice is then a layout of its own, computed anew (0.1 s a pose for a full ring).
const MOST_TOGETHER: [usize; 2] = [100, 50];

/// What the death of 1 to `most` elements does at worst.
///
/// # Errors
/// [`LayoutError::Stopped`].
pub fn deaths(
    model: &dyn LayoutModel,
    elements: &[LayoutElement],
    workspace: &Workspace,
    most: usize,
    executor: &dyn Executor,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<Deaths>, LayoutError> {
    let [most_choices, most_poses] =
        if works_alone(model, elements, workspace) { [MOST_CHOICES, DEATH_POSES] } else { MOST_TOGETHER };
    let directions = workspace.directions.len();
    let step = workspace.positions_m.len().div_ceil((most_poses / directions).max(1));
    let places = (0..workspace.positions_m.len()).step_by(step);
    let poses: Vec<_> = places
        .flat_map(|place| (0..directions).map(move |k| workspace.pose(place * directions + k)))
        .collect();
    let survivors = Survivors::new(model, elements, &poses);
    let alive = if most > 0 { survivors.rms_mm(&[]) } else { f64::INFINITY };
    let rms = |dead: &Vec<usize>| (!stopped()).then(|| survivors.rms_mm(dead));
    let mut all: Vec<Deaths> = Vec::new();
    let mut worst: Vec<usize> = Vec::new();
    for dead in 1..=most.min(elements.len().saturating_sub(1)) {
        let every = combinations(elements.len(), dead, most_choices);
        let exhaustive = every.is_some();
        let choices = every.unwrap_or_else(|| {
            let more = (0..elements.len()).filter(|i| !worst.contains(i));
            more.map(|i| worst.iter().copied().chain([i]).collect()).collect()
        });
        let values: Option<Vec<f64>> =
            collect(executor, choices.len(), |k| rms(&choices[k])).into_iter().map(Option::flatten).collect();
        let values = values.ok_or(LayoutError::Stopped)?;
        // The first of equals, so that threads cannot be seen.
        let Some((at, largest)) = values.iter().enumerate().rev().max_by(|a, b| a.1.total_cmp(b.1)) else {
            break;
        };
        worst.clone_from(&choices[at]);
        all.push(Deaths {
            dead,
            choices: choices.len(),
            exhaustive,
            poses: poses.len(),
            alive_rms_mm: Some(alive).filter(|v| v.is_finite()),
            rms_mm: Some(*largest).filter(|v| v.is_finite()),
            elements: worst.iter().map(|i| elements[*i].name.clone()).collect(),
        });
    }
    Ok(all)
}

/// Whether an element says anything by itself.
fn works_alone(model: &dyn LayoutModel, elements: &[LayoutElement], workspace: &Workspace) -> bool {
    let mut information = model.prior();
    let mut worker = model.worker();
    elements
        .first()
        .is_none_or(|first| worker.each(std::slice::from_ref(first), &workspace.pose(0), &mut information))
}

/// What is left of a layout without some of its elements.
struct Survivors<'a> {
    model: &'a dyn LayoutModel,
    elements: &'a [LayoutElement],
    poses: &'a [Isometry3<f64>],
    prior: Vec<f64>,
    /// What each element says at each pose; `None` where they work only together.
    each: Option<Vec<f64>>,
}

impl<'a> Survivors<'a> {
    fn new(model: &'a dyn LayoutModel, elements: &'a [LayoutElement], poses: &'a [Isometry3<f64>]) -> Self {
        let prior = model.prior();
        let mut each = vec![0.0; poses.len() * elements.len() * prior.len()];
        let mut worker = model.worker();
        let of_pose = (elements.len() * prior.len()).max(1);
        let independent =
            poses.iter().zip(each.chunks_mut(of_pose)).all(|(pose, out)| worker.each(elements, pose, out));
        drop(worker);
        Self { model, elements, poses, prior, each: independent.then_some(each) }
    }

    fn rms_mm(&self, dead: &[usize]) -> f64 {
        let dimension = Size::from(self.model.parameters());
        let mut information = vec![0.0; self.prior.len()];
        let is_left = |i: &usize| !dead.contains(i);
        let f = if let Some(each) = &self.each {
            Criterion::Rms.value(self.poses.len(), f64::INFINITY, |pose| {
                information.copy_from_slice(&self.prior);
                for i in (0..self.elements.len()).filter(is_left) {
                    let from = (pose * self.elements.len() + i) * self.prior.len();
                    add(&mut information, &each[from..from + self.prior.len()]);
                }
                Inverse::of(&information, dimension)
            })
        } else {
            let left: Vec<LayoutElement> =
                (0..self.elements.len()).filter(is_left).map(|i| self.elements[i].clone()).collect();
            let mut worker = self.model.worker();
            Criterion::Rms.value(self.poses.len(), f64::INFINITY, |pose| {
                worker.together(&left, &self.poses[pose], &mut information);
                add(&mut information, &self.prior);
                Inverse::of(&information, dimension)
            })
        };
        Criterion::Rms.shown(f)
    }
}

/// All choices of `k` of `n`, or `None` where they are more than `most`.
fn combinations(n: usize, k: usize, most: usize) -> Option<Vec<Vec<usize>>> {
    let mut count = 1_usize;
    for i in 0..k {
        count = count.checked_mul(n - i)? / (i + 1);
        if count > most.saturating_mul(n) {
            return None;
        }
    }
    if count > most {
        return None;
    }
    let mut all = Vec::with_capacity(count);
    let mut now: Vec<usize> = (0..k).collect();
    loop {
        all.push(now.clone());
        let Some(at) = (0..k).rev().find(|i| now[*i] < n - k + i) else { return Some(all) };
        now[at] += 1;
        for i in at + 1..k {
            now[i] = now[i - 1] + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_choices() {
        assert_eq!(combinations(4, 2, 10).unwrap().len(), 6);
        assert_eq!(combinations(4, 1, 10).unwrap(), [[0], [1], [2], [3]]);
        assert_eq!(combinations(16, 3, 600).unwrap().len(), 560);
        assert!(combinations(16, 3, 500).is_none());
        assert!(combinations(10_000, 5, 500).is_none());
    }

    #[test]
    fn closed_form_quantiles_count_infinite_ones_as_largest() {
        let sorted = [1.0, 2.0, 3.0, f64::INFINITY];
        assert_eq!(quantile(&sorted, 0.5), Some(2.0));
        assert_eq!(quantile(&sorted, 0.95), None);
    }
}
