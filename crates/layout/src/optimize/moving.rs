//! Moving elements freely within a box, by the gradient.
//!
//! ```text
//! dF = - Σ_poses ⟨C[:, p] (∂F/∂C_pp) C[p, :], dI⟩         p: the position's block
//! dI of a moved element by central differences of its own information (h = 10 µm: errors near 1e-9)
//! x = mid + half · sin u                                  keeps a coordinate in its range
//! ```
//!
//! L-BFGS runs on log F, so that lengths of scale 1 mm and 10 mm look alike, with a soft wall where two elements come nearer than the
//! spacing. A maximum is approached by p-norms of rising p; after each the exact criterion is taken, and the best is kept.

use super::lbfgs::minimise;
use super::{Ended, Found, Question, Watch};
use crate::LayoutError;
use crate::criterion::Criterion;
use crate::information::Inverse;
use lumenav_core::layout::packed_len;
use lumenav_core::{Executor, LayoutElement, LayoutWorker, RandomStreams};
use nalgebra::Matrix3;
use rand::RngExt as _;

/// Half the way of a central difference, m.
const DIFFERENCE_M: f64 = 1e-5;
/// A coordinate at the end of its range would feel no slope: starts stay this share inside.
const INSIDE: f64 = 0.995;
/// Steps of one climb, and when it has settled.
const STEPS: usize = 400;
const TOLERANCE: f64 = 1e-8;
/// Exponents of the p-norms that stand in for a maximum, one after another.
const SHARPNESS: [f64; 4] = [4.0, 16.0, 64.0, 256.0];
/// Weight of the wall between elements.
const WALL: f64 = 100.0;
/// A layout may come this much nearer than the spacing.
const SPACING_SLACK: f64 = 1e-3;

/// Ranges of the coordinates that may move, m; `None`: stays where it is installed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ranges {
    /// Along x, y and z.
    pub axes_m: [Option<[f64; 2]>; 3],
}

/// One coordinate of one element.
#[derive(Clone, Copy)]
struct Variable {
    element: usize,
    axis: usize,
    middle_m: f64,
    half_m: f64,
}

/// Moves the model's elements.
///
/// # Errors
/// [`LayoutError`]: nothing may move, elements that work only together, a spacing that cannot be kept, stopped.
pub fn shift(
    question: &Question<'_>,
    ranges: &Ranges,
    executor: &dyn Executor,
    watch: Watch<'_>,
    stopped: &(dyn Fn() -> bool + Sync),
) -> Result<Found, LayoutError> {
    let search = Search::new(question, ranges)?;
    let start = |k: usize| search.run_start(k, stopped);
    super::run(question.starts, executor, watch, start, || {
        LayoutError::Impossible(format!(
            "no start came to a layout that keeps a spacing of {} mm and has a bound at every pose",
            1e3 * question.spacing_m
        ))
    })
}

struct Search<'a> {
    question: &'a Question<'a>,
    variables: Vec<Variable>,
    prior: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(question: &'a Question<'a>, ranges: &Ranges) -> Result<Self, LayoutError> {
        let elements = question.model.elements();
        let variables: Vec<Variable> = (0..elements.len())
            .flat_map(|element| (0..3).map(move |axis| (element, axis)))
            .filter_map(|(element, axis)| {
                let [low, high] = ranges.axes_m[axis]?;
                Some(Variable { element, axis, middle_m: 0.5 * (low + high), half_m: 0.5 * (high - low) })
            })
            .collect();
        if variables.is_empty() {
            return Err(LayoutError::Impossible("nothing may move: give a range along an axis".to_owned()));
        }
        question.check_independent()?;
        Ok(Self { question, variables, prior: question.model.prior() })
    }

    fn start(&self, start: usize) -> Vec<f64> {
        let elements = self.question.model.elements();
        let mut stream = RandomStreams::new(self.question.seed, 0, "layout").stream("moving", start as u64);
        let coordinate = |v: &Variable| {
            let share = if start == 0 {
                let at = elements[v.element].world_from_element.translation.vector[v.axis];
                (at - v.middle_m) / v.half_m
            } else {
                stream.random_range(-1.0..1.0)
            };
            share.clamp(-INSIDE, INSIDE).asin()
        };
        self.variables.iter().map(coordinate).collect()
    }

    fn place(&self, u: &[f64], elements: &mut [LayoutElement]) {
        for (v, u) in self.variables.iter().zip(u) {
            elements[v.element].world_from_element.translation.vector[v.axis] =
                v.middle_m + v.half_m * u.sin();
        }
    }

    fn run_start(&self, start: usize, stopped: &dyn Fn() -> bool) -> Ended {
        if stopped() {
            return Ended::Stopped;
        }
        let mut climb = Climb::new(self);
        let mut u = self.start(start);
        let criterion = self.question.criterion;
        let phases: &[f64] =
            if matches!(criterion, Criterion::Worst | Criterion::E) { &SHARPNESS } else { &SHARPNESS[..1] };
        let mut best: Option<(Vec<LayoutElement>, f64)> = None;
        for sharpness in phases {
            minimise(&mut u, STEPS, TOLERANCE, stopped, |u, gradient| climb.value(u, *sharpness, gradient));
            let mut elements = self.question.model.elements().to_vec();
            self.place(&u, &mut elements);
            let f = self.question.value(&elements);
            if f.is_finite()
                && self.keeps_spacing(&elements)
                && best.as_ref().is_none_or(|(_, least)| f < *least)
            {
                best = Some((elements, f));
            }
        }
        match best {
            Some((elements, f)) => Ended::Found(elements, f),
            None if stopped() => Ended::Stopped,
            None => Ended::Nothing,
        }
    }

    fn keeps_spacing(&self, elements: &[LayoutElement]) -> bool {
        let least = self.question.spacing_m * (1.0 - SPACING_SLACK);
        pairs(elements).all(|(i, j)| distance_m(elements, i, j) >= least)
    }
}

fn pairs(elements: &[LayoutElement]) -> impl Iterator<Item = (usize, usize)> + use<> {
    let n = elements.len();
    (0..n).flat_map(move |i| (0..i).map(move |j| (i, j)))
}

fn distance_m(elements: &[LayoutElement], i: usize, j: usize) -> f64 {
    let place = |k: usize| elements[k].world_from_element.translation.vector;
    (place(i) - place(j)).norm()
}

/// Buffers of one climb.
struct Climb<'a> {
    search: &'a Search<'a>,
    worker: Box<dyn LayoutWorker + 'a>,
    elements: Vec<LayoutElement>,
    /// Each variable a little up, a little down.
    shifted: Vec<LayoutElement>,
    informations: Vec<f64>,
    inverses: Vec<Inverse>,
    slopes: Vec<Matrix3<f64>>,
}

impl<'a> Climb<'a> {
    fn new(search: &'a Search<'a>) -> Self {
        let elements = search.question.model.elements().to_vec();
        let shifted = search
            .variables
            .iter()
            .flat_map(|v| [elements[v.element].clone(), elements[v.element].clone()])
            .collect();
        Self {
            worker: search.question.model.worker(),
            informations: vec![0.0; 2 * search.variables.len() * search.prior.len()],
            inverses: Vec::new(),
            slopes: Vec::new(),
            elements,
            shifted,
            search,
        }
    }

    /// log F with the wall, and its gradient by u.
    fn value(&mut self, u: &[f64], sharpness: f64, gradient: &mut [f64]) -> f64 {
        self.search.place(u, &mut self.elements);
        gradient.fill(0.0);
        if !self.invert() {
            return f64::INFINITY;
        }
        let criterion = self.search.question.criterion;
        let f = criterion.slopes(sharpness, &self.inverses, &mut self.slopes);
        self.add_slopes(gradient);
        // Where F is no logarithm yet, that of it is minimised.
        let mut value = f;
        if matches!(criterion, Criterion::Rms | Criterion::Mean) {
            gradient.iter_mut().for_each(|g| *g /= f);
            value = f.ln();
        }
        value += self.add_wall(gradient);
        for ((g, v), u) in gradient.iter_mut().zip(&self.search.variables).zip(u) {
            *g *= v.half_m * u.cos();
        }
        value
    }

    fn invert(&mut self) -> bool {
        let question = self.search.question;
        let dimension = question.model.parameters().len();
        let mut information = vec![0.0; self.search.prior.len()];
        self.inverses.clear();
        for pose in &question.poses {
            self.worker.together(&self.elements, pose, &mut information);
            crate::evaluate::add(&mut information, &self.search.prior);
            let Some(inverse) = Inverse::of(&information, dimension) else { return false };
            self.inverses.push(inverse);
        }
        true
    }

    /// Adds ∂F/∂x of every variable.
    fn add_slopes(&mut self, gradient: &mut [f64]) {
        let question = self.search.question;
        let dimension = question.model.parameters().len();
        let one = packed_len(dimension);
        for (v, pair) in self.search.variables.iter().zip(self.shifted.chunks_mut(2)) {
            for (element, sign) in pair.iter_mut().zip([1.0, -1.0]) {
                element.world_from_element = self.elements[v.element].world_from_element;
                element.world_from_element.translation.vector[v.axis] += sign * DIFFERENCE_M;
            }
        }
        let mut weights = vec![0.0; one];
        for ((pose, inverse), slope) in question.poses.iter().zip(&self.inverses).zip(&self.slopes) {
            by_information(inverse, slope, &mut weights);
            self.worker.each(&self.shifted, pose, &mut self.informations);
            for (g, pair) in gradient.iter_mut().zip(self.informations.chunks(2 * one)) {
                let (up, down) = pair.split_at(one);
                let sum: f64 = weights.iter().zip(up).zip(down).map(|((w, u), d)| w * (u - d)).sum();
                *g += sum / (2.0 * DIFFERENCE_M);
            }
        }
    }

    /// Adds the wall's slope; its height.
    fn add_wall(&self, gradient: &mut [f64]) -> f64 {
        let spacing_m = self.search.question.spacing_m;
        let mut height = 0.0;
        if spacing_m <= 0.0 {
            return height;
        }
        for (i, j) in pairs(&self.elements) {
            let distance = distance_m(&self.elements, i, j);
            let lack = 1.0 - distance / spacing_m;
            if lack <= 0.0 {
                continue;
            }
            height += WALL * lack * lack;
            let place = |k: usize| self.elements[k].world_from_element.translation.vector;
            let along = (place(i) - place(j)) / distance.max(f64::MIN_POSITIVE);
            for (g, v) in gradient.iter_mut().zip(&self.search.variables) {
                let sign = f64::from(u8::from(v.element == i)) - f64::from(u8::from(v.element == j));
                *g -= sign * 2.0 * WALL * lack / spacing_m * along[v.axis];
            }
        }
        height
    }
}

/// ∂F/∂I as weights of the packed triangle: `-C[:, p] S C[p, :]`, what stands beside the diagonal twice.
pub(super) fn by_information(inverse: &Inverse, slope: &Matrix3<f64>, weights: &mut [f64]) {
    let dimension = inverse.dimension();
    let mut at = 0;
    for i in 0..dimension {
        let left: [f64; 3] = std::array::from_fn(|b| (0..3).map(|a| inverse.at(i, a) * slope[(a, b)]).sum());
        for j in 0..=i {
            let value: f64 = (0..3).map(|b| left[b] * inverse.at(b, j)).sum();
            weights[at] = if i == j { -value } else { -2.0 * value };
            at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// F = tr C_pp by one number of I: central differences.
    #[test]
    fn closed_form_derivative_by_the_information() {
        let dimension = 5;
        let mut packed = vec![0.0; packed_len(dimension)];
        for i in 0..dimension {
            for j in 0..=i {
                packed[packed_len(i) + j] =
                    if i == j { 2.0 + i as f64 } else { 0.3 * ((i + 2 * j) as f64).cos() };
            }
        }
        let trace = |packed: &[f64]| Inverse::of(packed, dimension).unwrap().position_trace_m2();
        let mut weights = vec![0.0; packed.len()];
        by_information(&Inverse::of(&packed, dimension).unwrap(), &Matrix3::identity(), &mut weights);
        for k in 0..packed.len() {
            let h = 1e-6;
            let moved = |by: f64| {
                let mut other = packed.clone();
                other[k] += by;
                trace(&other)
            };
            let wanted = (moved(h) - moved(-h)) / (2.0 * h);
            assert!((weights[k] - wanted).abs() < 1e-8, "{k}: {} {wanted}", weights[k]);
        }
    }
}
