//! Moving elements freely within a box, by the gradient.
//!
//! ```text
//! dF = - Σ_poses ⟨C[:, p] (∂F/∂C_pp) C[p, :], dI⟩         p: the position's block
//! dI of a moved element by central differences of its own information (h = 10 µm: errors near 1e-9)
//! x = mid + half · sin u                                  keeps a coordinate in its range
//! ```
//!
//! L-BFGS runs on log F, so that lengths of scale 1 mm and 10 mm look alike, with a soft wall where two elements come nearer than the
//! spacing, or one to a place that is kept free or to the capsule than it can read. Under mirror planes an element's images move with it. A maximum is approached by p-norms of rising p; after each the exact criterion is taken, and the best is kept.

use super::lbfgs::minimise;
use super::sites::place;
use super::{Ended, Found, Question, Watch};
use crate::LayoutError;
use crate::criterion::Criterion;
use crate::information::{Inverse, Size};
use lumenav_core::layout::packed_len;
use lumenav_core::{Executor, LayoutElement, LayoutWorker, RandomStreams};
use nalgebra::{Matrix3, Vector3};
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

/// One coordinate of one element, and of its mirror images.
#[derive(Clone, Copy)]
struct Variable {
    element: usize,
    axis: usize,
    middle_m: f64,
    half_m: f64,
}

/// What a variable does to one element.
#[derive(Clone, Copy)]
struct Move {
    variable: usize,
    element: usize,
    axis: usize,
    /// -1 for an image whose coordinate is mirrored.
    sign: f64,
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
            "no start came to a layout that keeps {}, gives readings everywhere and has a bound at every pose",
            question.sites.words()
        ))
    })
}

struct Search<'a> {
    question: &'a Question<'a>,
    variables: Vec<Variable>,
    moves: Vec<Move>,
    prior: Vec<f64>,
    /// The poses' places, each once.
    places_m: Vec<Vector3<f64>>,
}

/// Variables of the first element of every orbit, and what each does to the orbit's elements. A coordinate at right angles to a mirror plane
/// that an element stands on is none.
fn variables(
    orbits: &[Vec<super::sites::Image>],
    sites: &super::Sites,
    ranges: &Ranges,
) -> (Vec<Variable>, Vec<Move>) {
    let (mut variables, mut moves) = (Vec::new(), Vec::new());
    for orbit in orbits {
        for axis in 0..3 {
            let is_mirrored = sites.mirrored.contains(&axis);
            let stands_on_the_plane = is_mirrored && orbit.iter().all(|(_, signs)| signs[axis] > 0.0);
            let (Some([low, high]), Some((element, _)), false) =
                (ranges.axes_m[axis], orbit.first(), stands_on_the_plane)
            else {
                continue;
            };
            let (middle_m, half_m) = (0.5 * (low + high), 0.5 * (high - low));
            let of_image = |(element, signs): &super::sites::Image| Move {
                variable: variables.len(),
                element: *element,
                axis,
                sign: signs[axis],
            };
            moves.extend(orbit.iter().map(of_image));
            variables.push(Variable { element: *element, axis, middle_m, half_m });
        }
    }
    (variables, moves)
}

impl<'a> Search<'a> {
    fn new(question: &'a Question<'a>, ranges: &Ranges) -> Result<Self, LayoutError> {
        let elements = question.model.elements();
        for axis in &question.sites.mirrored {
            if ranges.axes_m[*axis].is_some_and(|[low, high]| (low + high).abs() > 1e-9) {
                return Err(LayoutError::Impossible(
                    "a range along a mirrored axis has its middle at 0, such as [-250, 250]".to_owned(),
                ));
            }
        }
        let orbits = question.sites.orbits_installed(elements)?;
        let (variables, moves) = variables(&orbits, &question.sites, ranges);
        if variables.is_empty() {
            return Err(LayoutError::Impossible("nothing may move: give a range along an axis".to_owned()));
        }
        question.check_independent()?;
        let mut places_m: Vec<Vector3<f64>> = question.poses.iter().map(|p| p.translation.vector).collect();
        places_m.dedup();
        Ok(Self { question, variables, moves, prior: question.model.prior(), places_m })
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
        for m in &self.moves {
            let v = &self.variables[m.variable];
            elements[m.element].world_from_element.translation.vector[m.axis] =
                m.sign * (v.middle_m + v.half_m * u[m.variable].sin());
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
                && self.keeps_sites(&elements)
                && elements.iter().all(|e| self.question.reads_everywhere(e))
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

    fn keeps_sites(&self, elements: &[LayoutElement]) -> bool {
        let sites = &self.question.sites;
        let least = sites.spacing_m * (1.0 - SPACING_SLACK);
        let is_free = |e: &LayoutElement| {
            let away = |ball: &super::KeepOut| (place(e) - ball.centre_m).norm() / ball.radius_m;
            sites.keep_out.iter().all(|ball| away(ball) >= 1.0 - SPACING_SLACK)
        };
        elements.iter().all(is_free) && pairs(elements).all(|(i, j)| distance_m(elements, i, j) >= least)
    }
}

fn pairs(elements: &[LayoutElement]) -> impl Iterator<Item = (usize, usize)> + use<> {
    let n = elements.len();
    (0..n).flat_map(move |i| (0..i).map(move |j| (i, j)))
}

fn distance_m(elements: &[LayoutElement], i: usize, j: usize) -> f64 {
    (place(&elements[i]) - place(&elements[j])).norm()
}

/// Buffers of one climb.
struct Climb<'a> {
    search: &'a Search<'a>,
    worker: Box<dyn LayoutWorker + 'a>,
    elements: Vec<LayoutElement>,
    /// Each move a little up, a little down.
    shifted: Vec<LayoutElement>,
    informations: Vec<f64>,
    inverses: Vec<Inverse>,
    slopes: Vec<Matrix3<f64>>,
}

impl<'a> Climb<'a> {
    fn new(search: &'a Search<'a>) -> Self {
        let elements = search.question.model.elements().to_vec();
        let shifted = search
            .moves
            .iter()
            .flat_map(|m| [elements[m.element].clone(), elements[m.element].clone()])
            .collect();
        Self {
            worker: search.question.model.worker(),
            informations: vec![0.0; 2 * search.moves.len() * search.prior.len()],
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
        let size = Size::from(question.model.parameters());
        let mut information = vec![0.0; self.search.prior.len()];
        self.inverses.clear();
        for pose in &question.poses {
            self.worker.together(&self.elements, pose, &mut information);
            crate::evaluate::add(&mut information, &self.search.prior);
            let Some(inverse) = Inverse::of(&information, size) else { return false };
            self.inverses.push(inverse);
        }
        true
    }

    /// Adds ∂F/∂x of every variable.
    fn add_slopes(&mut self, gradient: &mut [f64]) {
        let question = self.search.question;
        let dimension = question.model.parameters().len();
        let one = packed_len(dimension);
        for (m, pair) in self.search.moves.iter().zip(self.shifted.chunks_mut(2)) {
            for (element, sign) in pair.iter_mut().zip([1.0, -1.0]) {
                element.world_from_element = self.elements[m.element].world_from_element;
                element.world_from_element.translation.vector[m.axis] += sign * DIFFERENCE_M;
            }
        }
        let mut weights = vec![0.0; one];
        for ((pose, inverse), slope) in question.poses.iter().zip(&self.inverses).zip(&self.slopes) {
            by_information(inverse, slope, &mut weights);
            self.worker.each(&self.shifted, pose, &mut self.informations);
            for (m, pair) in self.search.moves.iter().zip(self.informations.chunks(2 * one)) {
                let (up, down) = pair.split_at(one);
                let sum: f64 = weights.iter().zip(up).zip(down).map(|((w, u), d)| w * (u - d)).sum();
                gradient[m.variable] += m.sign * sum / (2.0 * DIFFERENCE_M);
            }
        }
    }

    /// Adds the slope of the walls between elements and around places that are kept free; their height.
    fn add_wall(&self, gradient: &mut [f64]) -> f64 {
        let sites = &self.search.question.sites;
        let mut height = 0.0;
        if sites.spacing_m > 0.0 {
            for (i, j) in pairs(&self.elements) {
                let (a, b) = (place(&self.elements[i]), place(&self.elements[j]));
                height += self.lean(&a, &b, sites.spacing_m, [Some(i), Some(j)], gradient);
            }
        }
        let least_m = self.search.question.model.least_distance_m();
        if least_m > 0.0 {
            for pose in &self.search.places_m {
                for (i, element) in self.elements.iter().enumerate() {
                    height += self.lean(&place(element), pose, least_m, [Some(i), None], gradient);
                }
            }
        }
        for ball in &sites.keep_out {
            for (i, element) in self.elements.iter().enumerate() {
                height +=
                    self.lean(&place(element), &ball.centre_m, ball.radius_m, [Some(i), None], gradient);
            }
        }
        height
    }

    /// The wall between places `a` and `b` (of these elements, where they are of any) that are to be so far apart: its slope, and its height.
    fn lean(
        &self,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
        apart_m: f64,
        of: [Option<usize>; 2],
        gradient: &mut [f64],
    ) -> f64 {
        let distance = (a - b).norm();
        let lack = 1.0 - distance / apart_m;
        if lack <= 0.0 {
            return 0.0;
        }
        let along = (a - b) / distance.max(f64::MIN_POSITIVE);
        for m in &self.search.moves {
            let is = |end: usize| f64::from(u8::from(of[end] == Some(m.element)));
            gradient[m.variable] -= m.sign * (is(0) - is(1)) * 2.0 * WALL * lack / apart_m * along[m.axis];
        }
        WALL * lack * lack
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
