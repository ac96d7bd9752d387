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

use super::failure::Failure;
use super::lanes::{Four, LANES, Three, dot, splat3, three};
use super::thompson;
use super::window::{FEWEST_LINES, Rays, Window};
use nalgebra::{Matrix3, Vector3};
use pulp::{Arch, Simd, WithSimd};
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
    /// Place in the window of each line still in.
    places: Vec<u32>,
    distances_m: Vec<Four>,
    tau: thompson::Table,
    matrix: Matrix3<f64>,
    side: Vector3<f64>,
}

/// Distances of the lines still in.
struct Spread {
    mean_m: f64,
    sigma_m: f64,
    furthest: usize,
    furthest_m: f64,
}

impl Centroid {
    /// The centroid from the window's origin, m; afterwards [`Self::kept`] tells the lines that belong.
    ///
    /// # Errors
    /// [`Failure::Parallel`], [`Failure::TooFewLines`].
    pub fn find(&mut self, window: &Window, weight: Weight, spared_m: f64) -> Result<Vector3<f64>, Failure> {
        self.take(window);
        let mut centre = Vector3::zeros();
        loop {
            centre = match weight {
                Weight::Uniform => self.solve()?,
                Weight::Gaussian => self.iterate(centre),
            };
            let spread = self.spread(&centre);
            let count = self.places.len();
            if spread.furthest_m <= spared_m
                || spread.furthest_m - spread.mean_m <= self.tau.tau(count) * spread.sigma_m
            {
                break;
            }
            if count <= FEWEST_LINES {
                return Err(Failure::TooFewLines {
                    given: window.len(),
                    usable: count,
                    needed: FEWEST_LINES + 1,
                });
            }
            self.drop_line(spread.furthest);
        }
        self.solve()?;
        if centre.iter().all(|v| v.is_finite()) { Ok(centre) } else { Err(Failure::Parallel { spread: 0.0 }) }
    }

    /// Places in the window of the lines that belong.
    pub fn kept(&self) -> &[u32] {
        &self.places
    }

    pub(crate) fn kept_rays(&self) -> &[Rays] {
        &self.kept
    }

    fn take(&mut self, window: &Window) {
        self.kept.clear();
        self.kept.extend_from_slice(&window.rays);
        self.places.clear();
        self.places.extend(0..window.len() as u32);
        self.distances_m.clear();
        self.distances_m.resize(self.kept.len(), Four::ZERO);
        let (matrix, side) = sums(&self.kept);
        (self.matrix, self.side) = (matrix, side);
    }

    /// The last line takes the place of line `k`.
    fn drop_line(&mut self, k: usize) {
        let last = self.places.len() - 1;
        let (n, foot) = ray(&self.kept, k);
        self.matrix -= Matrix3::identity() - n * n.transpose();
        self.side -= foot;
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
        let spread = relative_spread(&self.matrix);
        let solution = (spread > PARALLEL).then(|| self.matrix.cholesky()).flatten();
        solution.map(|c| c.solve(&self.side)).ok_or(Failure::Parallel { spread })
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

    /// Mean and spread of the distances from a point, and the furthest line.
    fn spread(&mut self, centre: &Vector3<f64>) -> Spread {
        let count = self.places.len();
        let out = &mut self.distances_m[..self.kept.len()];
        let (sum, squares, top) = Arch::new().dispatch(DistancesFrom { kept: &self.kept, centre, out });
        let mean_m = sum / count as f64;
        let variance = (squares - sum * mean_m) / (count.max(2) - 1) as f64;
        let pack = self.distances_m[..self.kept.len()].iter().position(|d| d.0.contains(&top)).unwrap_or(0);
        let lane = self.distances_m[pack].0.iter().position(|d| *d == top).unwrap_or(0);
        Spread {
            mean_m,
            sigma_m: variance.max(0.0).sqrt(),
            furthest: (pack * LANES + lane).min(count - 1),
            furthest_m: top,
        }
    }
}

/// Sum of the distances, of their squares, and the largest.
struct DistancesFrom<'a> {
    kept: &'a [Rays],
    centre: &'a Vector3<f64>,
    out: &'a mut [Four],
}

impl WithSimd for DistancesFrom<'_> {
    type Output = (f64, f64, f64);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let centre = splat3(self.centre);
        let (mut sum, mut squares, mut top) = (Four::ZERO, Four::ZERO, Four::ZERO);
        for (rays, out) in self.kept.iter().zip(self.out) {
            let v: Three = three!(i => rays.foot_m[i] - centre[i]);
            let along = dot(&v, &rays.direction);
            let squared = (dot(&v, &v) - along * along).max(Four::ZERO) * rays.filled;
            let distance = squared.sqrt();
            *out = distance;
            sum += distance;
            squares += squared;
            top = distance.max(top);
        }
        (sum.sum(), squares.sum(), top.0.iter().copied().fold(0.0, f64::max))
    }
}

/// `Σ (I - nnᵀ)` and `Σ f`.
fn sums(rays: &[Rays]) -> (Matrix3<f64>, Vector3<f64>) {
    let mut outer = [Four::ZERO; 6];
    let mut side = [Four::ZERO; 3];
    let mut count = Four::ZERO;
    for r in rays {
        let n = &r.direction;
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (sum, (i, j)) in outer.iter_mut().zip(pairs) {
            *sum += n[i] * n[j] * r.filled;
        }
        for i in 0..3 {
            side[i] += r.foot_m[i] * r.filled;
        }
        count += r.filled;
    }
    let matrix = Matrix3::identity() * count.sum() - super::likelihood::symmetric(&outer);
    (matrix, Vector3::from(side.map(Four::sum)))
}

pub(crate) fn ray(rays: &[Rays], k: usize) -> (Vector3<f64>, Vector3<f64>) {
    let (pack, lane) = (&rays[k / LANES], k % LANES);
    let at = |v: &Three| Vector3::new(v[0].0[lane], v[1].0[lane], v[2].0[lane]);
    (at(&pack.direction), at(&pack.foot_m))
}

/// Determinant over the cube of a third of the trace, to the power that makes it a ratio of eigenvalues where one is small: cheap,
/// and zero exactly where the lines run one way.
fn relative_spread(matrix: &Matrix3<f64>) -> f64 {
    let mean = matrix.trace() / 3.0;
    if mean > 0.0 { (matrix.determinant() / (mean * mean * mean)).max(0.0) } else { 0.0 }
}
