//! The point nearest to all lines, and the lines that do not belong (than2015, eq. 3.4 and 3.5).
//!
//! Uniform weight (default): `Σ (I - nnᵀ) c = Σ f`, f the lines' foot points: the point that the iteration of eq. 3.4 rests at, found
//! in one step; the sums are kept up to date as lines leave. Gaussian weight: eq. 3.5 as printed, `c += k_T Σ G d / Σ G`, k_T = 0.5,
//! G the normal density of |d| under its own mean and standard deviation, until the step is below 0.1 mm (it weights down
//! the nearest lines as well as the furthest: two to three times worse, kept for comparison).
//!
//! The modified Thompson test then drops the furthest line while `|d| - mean > τ σ`, one per re-centring, until none is dropped.
//! Taken literally it runs away with an elongated marker set: the apex of the triangle of 10, 13 and 13 mm is furthest from the
//! centroid, each of its lines that goes pulls the centroid to the base and lowers mean and σ, and in one window of six all of
//! them go. So lines within `spared_m` of the centroid are never dropped: the set's radius plus the 5 mm within which a marker
//! owns a line. 0 is the literal test.
//!
//! Most lines that go are known without a look at all others. When the point has moved by m since the last such look, no distance has
//! changed by more than m, so their mean lies within m of what it was, less the lines that went; and their squares are told by sums:
//! `Σ d² = Σ f² - 2 c·Σ f + cᵀ Σ (I - nnᵀ) c`. Where the furthest line is beyond the largest limit that this leaves, the test drops it.

use super::failure::Failure;
use super::lanes::{Eight, Four, LANES, Three, three};
use super::quad::Quad;
use super::register::{Kernel, Register, Unit, dispatch, dot, load, splat3};
use super::thompson;
use super::window::{FEWEST_LINES, Rays, ToNarrow, Window};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// How lines weigh in the centroid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weight {
    /// All alike.
    #[default]
    Uniform,
    /// Eq. 3.5 as printed.
    Gaussian,
}

/// Step of eq. 3.4.
const STEP: f64 = 0.5;
/// The iteration of eq. 3.4 rests below this, m.
const REST_M: f64 = 1e-4;
/// Steps of eq. 3.4 before the point counts as resting: each halves the distance, so 40 are beyond any need.
const MAX_STEPS: usize = 40;
/// Smallest over largest eigenvalue of `Σ (I - nnᵀ)` below which lines run one way: the scatter of a scanner's own lines
/// is above 0.05 even where only two plates face each other at a third of their width.
const PARALLEL: f64 = 1e-4;

/// Finds centroids; keeps its buffers.
#[derive(Clone, Debug, Default)]
pub struct Centroid {
    /// The lines still in, packed, in an order of their own.
    kept: Vec<Rays>,
    /// The same in single precision, of the centroid that was found last.
    kept_narrow: Vec<Rays<Eight>>,
    /// Place in the window of each line still in.
    places: Vec<u32>,
    distances_m: Vec<Four>,
    look: Look,
    tau: thompson::Table,
    sums: Sums,
}

/// What a look at all distances found.
#[derive(Clone, Debug, Default)]
struct Look {
    /// From where, m.
    centre_m: Vector3<f64>,
    /// Sum of the distances, less those of lines that went since, m.
    sum_m: f64,
    /// Lines beyond this are in [`Self::far`], m.
    limit_m: f64,
    /// Far lines that are still in, and their distances, furthest first, m.
    far: Vec<(usize, f64)>,
}

impl Look {
    /// The last line takes the place of a far one.
    fn remove(&mut self, line: usize, last: usize) {
        let far = &mut self.far;
        if let Some(at) = far.iter().position(|(known, _)| *known == line) {
            self.sum_m -= far.remove(at).1;
        }
        if let Some(moved) = far.iter_mut().find(|(known, _)| *known == last) {
            moved.0 = line;
        }
    }
}

/// Sums over the lines still in.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// `Σ (I - nnᵀ)`.
    matrix: Matrix3<f64>,
    /// `Σ f`, m.
    side_m: Vector3<f64>,
    /// `Σ f²`, m².
    squares_m2: f64,
}

impl Sums {
    /// `Σ d²` from a point, m².
    fn squares_from(&self, centre_m: &Vector3<f64>) -> f64 {
        self.squares_m2 + centre_m.dot(&(self.matrix * centre_m - self.side_m * 2.0))
    }

    fn remove(&mut self, direction: &Vector3<f64>, foot_m: &Vector3<f64>) {
        self.matrix -= Matrix3::identity() - direction * direction.transpose();
        self.side_m -= foot_m;
        self.squares_m2 -= foot_m.norm_squared();
    }
}

/// Mean and standard deviation of the distances of the lines still in.
struct Spread {
    mean_m: f64,
    sigma_m: f64,
}

impl Centroid {
    /// The centroid from the window's origin, m; afterwards [`Self::kept`] tells the lines that belong.
    ///
    /// # Errors
    /// [`Failure::Parallel`], [`Failure::TooFewLines`].
    pub fn find(&mut self, window: &Window, weight: Weight, spared_m: f64) -> Result<Vector3<f64>, Failure> {
        self.take(window);
        let mut centre = self.centre(weight, Vector3::zeros())?;
        loop {
            self.look(&centre, spared_m);
            let Some((furthest, _)) = self.furthest(&centre) else { break };
            let mut out = Some(furthest);
            while let Some(line) = out {
                if self.places.len() <= FEWEST_LINES {
                    let (given, usable) = (window.len(), self.places.len());
                    return Err(Failure::TooFewLines { given, usable, needed: FEWEST_LINES + 1 });
                }
                self.drop_line(line);
                centre = self.centre(weight, centre)?;
                out = self.surely_out(&centre, spared_m);
            }
        }
        self.solve()?;
        ToNarrow { packs: &self.kept, narrow: &mut self.kept_narrow }.run();
        if centre.iter().all(|v| v.is_finite()) { Ok(centre) } else { Err(Failure::Parallel { spread: 0.0 }) }
    }

    fn centre(&mut self, weight: Weight, before: Vector3<f64>) -> Result<Vector3<f64>, Failure> {
        match weight {
            Weight::Uniform => self.solve(),
            Weight::Gaussian => Ok(self.iterate(before)),
        }
    }

    /// Places in the window of the lines that belong.
    pub fn kept(&self) -> &[u32] {
        &self.places
    }

    pub(crate) fn kept_rays(&self) -> &[Rays] {
        &self.kept
    }

    pub(crate) fn kept_narrow(&self) -> &[Rays<Eight>] {
        &self.kept_narrow
    }

    fn take(&mut self, window: &Window) {
        self.kept.clear();
        self.kept.extend_from_slice(&window.rays);
        self.places.clear();
        self.places.extend(0..window.len() as u32);
        self.distances_m.clear();
        self.distances_m.resize(self.kept.len(), Four::ZERO);
        self.sums = dispatch(SumsOf(&self.kept));
    }

    /// The last line takes the place of line `k`.
    fn drop_line(&mut self, k: usize) {
        let last = self.places.len() - 1;
        let (n, foot) = ray(&self.kept, k);
        self.sums.remove(&n, &foot);
        self.look.remove(k, last);
        let (from, from_lane) = (self.kept[last / LANES], last % LANES);
        let (to, to_lane) = (&mut self.kept[k / LANES], k % LANES);
        for axis in 0..3 {
            to.direction[axis].0[to_lane] = from.direction[axis].0[from_lane];
            to.foot_m[axis].0[to_lane] = from.foot_m[axis].0[from_lane];
        }
        self.places.swap_remove(k);
        if from_lane == 0 {
            self.kept.pop();
        } else {
            self.kept[last / LANES].filled.0[from_lane] = 0.0;
        }
    }

    fn solve(&self) -> Result<Vector3<f64>, Failure> {
        let m = &self.sums.matrix;
        // The adjugate's rows; it is symmetric as the matrix is.
        let [a, b, c] = [
            m[(1, 1)] * m[(2, 2)] - m[(1, 2)] * m[(1, 2)],
            m[(0, 2)] * m[(1, 2)] - m[(0, 1)] * m[(2, 2)],
            m[(0, 1)] * m[(1, 2)] - m[(0, 2)] * m[(1, 1)],
        ];
        let [d, e, f] = [
            m[(0, 0)] * m[(2, 2)] - m[(0, 2)] * m[(0, 2)],
            m[(0, 1)] * m[(0, 2)] - m[(0, 0)] * m[(1, 2)],
            m[(0, 0)] * m[(1, 1)] - m[(0, 1)] * m[(0, 1)],
        ];
        let determinant = m[(0, 0)] * a + m[(0, 1)] * b + m[(0, 2)] * c;
        let spread = relative_spread(determinant, m.trace());
        if !(spread > PARALLEL) {
            return Err(Failure::Parallel { spread });
        }
        let v = &self.sums.side_m;
        let solution = Vector3::new(
            a * v.x + b * v.y + c * v.z,
            b * v.x + d * v.y + e * v.z,
            c * v.x + e * v.y + f * v.z,
        );
        Ok(solution / determinant)
    }

    /// Eq. 3.4 and 3.5 to their rest.
    fn iterate(&mut self, start: Vector3<f64>) -> Vector3<f64> {
        let mut centre = start;
        for _ in 0..MAX_STEPS {
            let spread = self.spread(&centre);
            let (mut weights, mut pull) = (0.0, Vector3::zeros());
            for k in 0..self.places.len() {
                let (n, foot) = ray(&self.kept, k);
                let v = foot - centre;
                let d = v - n * n.dot(&v);
                let z = (d.norm() - spread.mean_m) / spread.sigma_m.max(f64::MIN_POSITIVE);
                let g = (-0.5 * z * z).exp();
                weights += g;
                pull += d * g;
            }
            let step = pull * (STEP / weights.max(f64::MIN_POSITIVE));
            centre += step;
            if step.norm() < REST_M {
                break;
            }
        }
        centre
    }

    /// Looks at all distances from a point; the lines that the test calls far.
    fn look(&mut self, centre: &Vector3<f64>, spared_m: f64) {
        let Spread { mean_m, sigma_m } = self.spread(centre);
        let count = self.places.len();
        let limit_m = spared_m.max(mean_m + self.tau.tau(count) * sigma_m);
        self.look.centre_m = *centre;
        self.look.sum_m = mean_m * count as f64;
        self.look.limit_m = limit_m;
        self.look.far.clear();
        for (pack, distances) in self.distances_m[..self.kept.len()].iter().enumerate() {
            if distances.0.iter().all(|distance_m| *distance_m <= limit_m) {
                continue;
            }
            for (lane, distance_m) in distances.0.iter().enumerate() {
                if *distance_m > limit_m {
                    self.look.far.push((pack * LANES + lane, *distance_m));
                }
            }
        }
        self.look.far.sort_unstable_by(|a, b| b.1.total_cmp(&a.1));
    }

    /// Of the lines that were far at the last look, the furthest from a point now, and its distance, m.
    fn furthest(&self, centre: &Vector3<f64>) -> Option<(usize, f64)> {
        let moved_m = (centre - self.look.centre_m).norm();
        let far = &self.look.far;
        // A line that was nearer than this has not overtaken the top.
        let least_m = far.first()?.1 - 2.0 * moved_m;
        far.iter()
            .take_while(|(_, distance_m)| *distance_m >= least_m)
            .map(|(line, _)| (*line, distance_m(&ray(&self.kept, *line), centre)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The line that the test drops next, where that is sure without a look at all.
    fn surely_out(&mut self, centre: &Vector3<f64>, spared_m: f64) -> Option<usize> {
        let (line, distance_m) = self.furthest(centre)?;
        let moved_m = (centre - self.look.centre_m).norm();
        let count = self.places.len();
        let mean_m = self.look.sum_m / count as f64;
        let (least_m, most_m) = ((mean_m - moved_m).max(0.0), mean_m + moved_m);
        let variance_m2 = variance(self.sums.squares_from(centre), least_m, count);
        let limit_m = spared_m.max(most_m + self.tau.tau(count) * variance_m2.sqrt());
        // The others are at most a move beyond the last limit.
        (distance_m > limit_m.max(self.look.limit_m + moved_m)).then_some(line)
    }

    /// Mean and spread of the distances from a point.
    fn spread(&mut self, centre: &Vector3<f64>) -> Spread {
        let count = self.places.len();
        let out = &mut self.distances_m[..self.kept.len()];
        let (sum_m, squares_m2) = dispatch(DistancesFrom { kept: &self.kept, centre, out });
        let mean_m = sum_m / count as f64;
        Spread { mean_m, sigma_m: variance(squares_m2, mean_m, count).sqrt() }
    }
}

/// Variance of so many numbers from the sum of their squares and their mean.
fn variance(squares: f64, mean: f64, count: usize) -> f64 {
    ((squares - count as f64 * mean * mean) / (count.max(2) - 1) as f64).max(0.0)
}

/// Distances of all lines still in from a point; their sum and that of their squares.
struct DistancesFrom<'a> {
    kept: &'a [Rays],
    centre: &'a Vector3<f64>,
    out: &'a mut [Four],
}

impl Kernel for DistancesFrom<'_> {
    type Output = (f64, f64);

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> Self::Output {
        let (zero, centre) = (Quad::splat(unit, 0.0), splat3(unit, self.centre));
        let (mut sum, mut squares) = (zero, zero);
        for (r, out) in self.kept.iter().zip(self.out) {
            let (n, foot) = (load(unit, &r.direction), load(unit, &r.foot_m));
            let v: [Quad<S>; 3] = three!(i => foot[i] - centre[i]);
            let along = dot(&v, &n);
            let squared = along.mul_sub_from(along, dot(&v, &v)).max(zero) * Quad::of(unit, r.filled);
            let distance = squared.sqrt();
            *out = distance.numbers();
            sum += distance;
            squares += squared;
        }
        (sum.numbers().sum(), squares.numbers().sum())
    }
}

struct SumsOf<'a>(&'a [Rays]);

impl Kernel for SumsOf<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> Sums {
        let zero = Quad::splat(unit, 0.0);
        let (mut outer, mut side, mut count, mut squares) = ([zero; 6], [zero; 3], zero, zero);
        for r in self.0 {
            let (n, foot) = (load(unit, &r.direction), load(unit, &r.foot_m));
            let filled = Quad::of(unit, r.filled);
            let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
            for (sum, (i, j)) in outer.iter_mut().zip(pairs) {
                *sum = (n[i] * filled).mul_add(n[j], *sum);
            }
            for i in 0..3 {
                side[i] = foot[i].mul_add(filled, side[i]);
            }
            count += filled;
            squares = dot(&foot, &foot).mul_add(filled, squares);
        }
        Sums {
            matrix: Matrix3::identity() * count.numbers().sum()
                - super::likelihood::symmetric(&outer.map(|sum| sum.numbers().sum())),
            side_m: Vector3::from(side.map(|s| s.numbers().sum())),
            squares_m2: squares.numbers().sum(),
        }
    }
}

/// Distance of a ray from a point, m.
fn distance_m((direction, foot_m): &(Vector3<f64>, Vector3<f64>), from_m: &Vector3<f64>) -> f64 {
    let v = foot_m - from_m;
    (v - direction * direction.dot(&v)).norm()
}

pub(crate) fn ray(rays: &[Rays], k: usize) -> (Vector3<f64>, Vector3<f64>) {
    let (pack, lane) = (&rays[k / LANES], k % LANES);
    let at = |v: &Three| Vector3::new(v[0].0[lane], v[1].0[lane], v[2].0[lane]);
    (at(&pack.direction), at(&pack.foot_m))
}

/// Determinant over the cube of a third of the trace, to the power that makes it a ratio of eigenvalues where one is small: cheap,
/// and zero exactly where the lines run one way.
fn relative_spread(determinant: f64, trace: f64) -> f64 {
    let mean = trace / 3.0;
    if mean > 0.0 { (determinant / (mean * mean * mean)).max(0.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line::Line;
    use crate::tracking::window::Preparation;
    use lumenav_core::RandomStreams;
    use rand::RngExt as _;

    /// Four of five lines from near a point, the others from anywhere.
    fn lines(seed: u64) -> Vec<Line> {
        let mut random = RandomStreams::new(seed, 0, "centroid").stream("lines", 0);
        let mut cube = |half_m: f64| Vector3::from_fn(|_, _| half_m * (2.0 * random.random::<f64>() - 1.0));
        (0..210)
            .map(|i| {
                let through = if i % 5 == 0 { cube(0.08) } else { cube(0.006) };
                let along = cube(1.0).normalize() * 0.4;
                Line { t_s: 0.0, ends_world_m: [through - along, through + along] }
            })
            .collect()
    }

    /// The test as printed: the centre and all distances anew for each line that goes.
    fn literal(window: &Window, spared_m: f64) -> Vec<u32> {
        let mut kept: Vec<u32> = (0..window.len() as u32).collect();
        loop {
            let rays: Vec<_> = kept.iter().map(|k| ray(&window.rays, *k as usize)).collect();
            let across = |n: &Vector3<f64>| Matrix3::identity() - n * n.transpose();
            let matrix: Matrix3<f64> = rays.iter().map(|(n, _)| across(n)).sum();
            let side: Vector3<f64> = rays.iter().map(|(_, foot)| foot).sum();
            let centre = matrix.cholesky().unwrap().solve(&side);
            let distances: Vec<f64> = rays.iter().map(|ray| distance_m(ray, &centre)).collect();
            let n = distances.len() as f64;
            let mean = distances.iter().sum::<f64>() / n;
            let sigma = (distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
            let order = |a: &usize, b: &usize| distances[*a].total_cmp(&distances[*b]);
            let furthest = (0..kept.len()).max_by(order).unwrap();
            let limit = spared_m.max(mean + thompson::tau(kept.len()) * sigma);
            if distances[furthest] <= limit {
                return kept;
            }
            kept.remove(furthest);
        }
    }

    #[test]
    fn cross_the_lines_kept_are_those_of_a_look_at_all_for_each_that_goes() {
        for seed in 0..40 {
            let mut window = Window::default();
            window.load(&lines(seed), &Preparation::about(Vector3::new(2e-3, 1e-3, -3e-3)), 6).unwrap();
            for spared_m in [0.0, 0.013] {
                let mut centroid = Centroid::default();
                centroid.find(&window, Weight::Uniform, spared_m).unwrap();
                let mut kept = centroid.kept().to_vec();
                kept.sort_unstable();
                assert_eq!(kept, literal(&window, spared_m), "seed {seed}");
                assert!(kept.len() < 205);
            }
        }
    }
}
