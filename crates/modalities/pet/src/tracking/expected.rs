//! Expected information of a line: `∫ p(u) g gᵀ du` over its offset, p = (1-β) q + β b with q the markers' own density.
//!
//! The sum over a grid with steps of [`STEP`] standard deviations of the core (trapezoidal rule, which converges exponentially for an
//! integrand that is smooth and dies out), four lines at a time. (A Gauss rule of five points a side steps over what is narrow in g where the
//! tail of the noise is wide: 15 per cent too small for the reduced scanner.)

use super::lanes::{Four, LANES, Three, cross, dot, splat3, three};
use super::likelihood::{MAX_MARKERS, Placed};
use super::noise::COMPONENTS;
use super::quad::Quad;
use super::register::{Kernel, Register, Unit, dispatch};
use super::window::Shapes;
use nalgebra::Matrix6;

/// Steps of the grid, in standard deviations of the core: half of it changes the information by 2e-3 at most.
const STEP: f64 = 1.0;
/// The grid ends so many standard deviations of the tail beside the outermost markers: what lies beyond adds less than 1e-3.
const REACH: f64 = 4.0;
/// More steps than this to a side are a noise of which nothing is known; the grid ends there.
const MOST_STEPS: f64 = 200.0;
/// Force across the line (2) and torque (3), and the lower triangle of their products.
const SCORES: usize = 5;
const PRODUCTS: usize = SCORES * (SCORES + 1) / 2;

/// Force and torque about the capsule's origin, world axes, of the four lines of a pack, to 2e-3; empty places give zeros.
pub(super) fn of_pack(shape: &Shapes, placed: &[Placed], background: f64) -> [Matrix6<f64>; LANES] {
    let sums = dispatch(Grid { shape, placed, background, step: STEP });
    std::array::from_fn(|lane| expand(shape, lane, &sums))
}

/// From products of `[force along e1, e2, torque]` to the matrix about `[force, torque]`, world axes.
fn expand(shape: &Shapes, lane: usize, sums: &[Four; PRODUCTS]) -> Matrix6<f64> {
    let mut axes = nalgebra::SMatrix::<f64, 6, SCORES>::zeros();
    for i in 0..3 {
        axes[(i, 0)] = shape.e1[i].0[lane];
        axes[(i, 1)] = shape.e2[i].0[lane];
        axes[(3 + i, 2 + i)] = 1.0;
    }
    let at = |i: usize, j: usize| sums[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)].0[lane];
    axes * nalgebra::SMatrix::<f64, SCORES, SCORES>::from_fn(at) * axes.transpose() * shape.filled.0[lane]
}

struct Grid<'a> {
    shape: &'a Shapes,
    placed: &'a [Placed],
    background: f64,
    step: f64,
}

/// A marker in the frames of four lines.
#[derive(Clone, Copy)]
struct Seen {
    at: [Four; 2],
    /// Torque of a unit force along e1, along e2.
    arms: [Three; 2],
    weight: Four,
}

impl Kernel for Grid<'_> {
    type Output = [Four; PRODUCTS];

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> Self::Output {
        let s = self.shape;
        let none = Seen { at: [Four::ZERO; 2], arms: [[Four::ZERO; 3]; 2], weight: Four::ZERO };
        let mut seen = [none; MAX_MARKERS];
        let seen = &mut seen[..self.placed.len().min(MAX_MARKERS)];
        for (to, p) in seen.iter_mut().zip(self.placed) {
            let (at, arm) = (splat3(&p.at_m), splat3(&p.arm_m));
            to.at = [dot(&s.e1, &at), dot(&s.e2, &at)];
            to.arms = [cross(&arm, &s.e1), cross(&arm, &s.e2)];
            to.weight = Four::splat(p.weight);
        }
        let [major, minor] = principal_axes(&s.precision[0]);
        let reach = [&major, &minor].map(|axis| axis.reach(&s.precision[COMPONENTS - 1]));
        let (mut low, mut high) = ([Four::splat(f64::INFINITY); 2], [Four::splat(f64::NEG_INFINITY); 2]);
        for m in seen.iter() {
            let at = [major.of(&m.at), minor.of(&m.at)];
            low = [low[0].min(at[0]), low[1].min(at[1])];
            high = [high[0].max(at[0]), high[1].max(at[1])];
        }
        let half = Four::splat(0.5);
        let middle = [half * (low[0] + high[0]), half * (low[1] + high[1])];
        // Each line's own; the pack runs to the largest.
        let sides = [0, 1].map(|i| {
            let side = (half * (high[i] - low[i]) + Four::splat(REACH) * reach[i]) / Four::splat(self.step);
            side.min(Four::splat(MOST_STEPS))
        });
        let [across, along] = sides.map(|side| side.0.iter().fold(0.0_f64, |a, b| a.max(*b)) as i32);
        let background = Four::splat(self.background) * s.background;
        let mut sums = [Four::ZERO; PRODUCTS];
        for i in -across..=across {
            let is_in = is_within(i, sides[0]);
            let x = middle[0] + Four::splat(self.step * f64::from(i));
            let along_major = [x * major.step[0], x * major.step[1]];
            for k in -along..=along {
                let y = middle[1] + Four::splat(self.step * f64::from(k));
                let at = [y.mul_add(minor.step[0], along_major[0]), y.mul_add(minor.step[1], along_major[1])];
                add_point(unit, s, seen, background, &at, is_in * is_within(k, sides[1]), &mut sums);
            }
        }
        let area = Four::splat(self.step * self.step) * major.length * minor.length;
        sums.map(|sum| sum * area)
    }
}

/// A principal axis of four lines' core: the grid does not know how the lines' own axes are turned.
struct PrincipalAxis {
    /// Unit, along e1 and e2.
    direction: [Four; 2],
    /// Standard deviation of the core along it, m.
    length: Four,
    /// One standard deviation along it, m.
    step: [Four; 2],
}

impl PrincipalAxis {
    #[inline(always)]
    fn new(direction: [Four; 2], variance_m2: Four) -> Self {
        let length = variance_m2.sqrt();
        Self { direction, length, step: [direction[0] * length, direction[1] * length] }
    }

    /// A place in standard deviations along this axis.
    #[inline(always)]
    fn of(&self, at: &[Four; 2]) -> Four {
        (self.direction[0] * at[0] + self.direction[1] * at[1]) / self.length
    }

    /// Standard deviation of another law along this axis, in those of the core.
    #[inline(always)]
    fn reach(&self, precision: &[Four; 3]) -> Four {
        let [a, b, c] = *precision;
        let [x, y] = self.direction;
        let variance = (c * x * x - Four::splat(2.0) * b * x * y + a * y * y) / (a * c - b * b);
        variance.max(Four::ZERO).sqrt() / self.length
    }
}

/// Of a covariance given by its inverse; the wider axis first. Of a round one any two will do.
#[inline(always)]
fn principal_axes(precision: &[Four; 3]) -> [PrincipalAxis; 2] {
    let [a, b, c] = *precision;
    let (half, one) = (Four::splat(0.5), Four::splat(1.0));
    let mean = half * (a + c);
    let apart = half * (c - a);
    let root = (apart * apart + b * b).sqrt();
    // Twice the angle of the smaller precision's axis has the cosine apart/root and the sine -b/root.
    let cosine = apart / root.max(Four::splat(f64::MIN_POSITIVE));
    let x = (half * (one + cosine)).max(Four::ZERO).sqrt();
    let y = (half * (one - cosine)).max(Four::ZERO).sqrt();
    let y = b.less_select(Four::ZERO, y, -y);
    let determinant = a * c - b * b;
    let largest = (mean + root) / determinant;
    [PrincipalAxis::new([x, y], largest), PrincipalAxis::new([-y, x], one / (determinant * largest))]
}

/// 1 where a step is one of the line's own, else 0: what a line says does not depend on those beside it in the pack.
#[inline(always)]
fn is_within(step: i32, side: Four) -> Four {
    side.less_select(Four::splat(f64::from(step.abs())), Four::ZERO, Four::splat(1.0))
}

/// Adds `s sᵀ / p` at an offset, s the markers' densities times their scores.
#[inline(always)]
fn add_point<S: Unit>(
    unit: S,
    shape: &Shapes,
    seen: &[Seen],
    background: Four,
    at: &[Four; 2],
    is_in: Four,
    sums: &mut [Four; PRODUCTS],
) {
    let mut all = background;
    let mut score = [Four::ZERO; SCORES];
    for m in seen {
        let (x, y) = (at[0] - m.at[0], at[1] - m.at[1]);
        let half = Four::splat(-0.5);
        let (xx, xy, yy) = (half * x * x, -(x * y), half * y * y);
        let density: Three = three!(k => {
            let [a, b, c] = shape.precision[k];
            Quad::of(unit, a.mul_add(xx, b.mul_add(xy, c * yy))).exp().numbers()
        });
        let (mut fx, mut fy) = (Four::ZERO, Four::ZERO);
        for k in 0..COMPONENTS {
            let [a, b, c] = shape.precision[k];
            let density = m.weight * shape.peak[k] * density[k];
            all += density;
            fx = density.mul_add(a.mul_add(x, b * y), fx);
            fy = density.mul_add(b.mul_add(x, c * y), fy);
        }
        score[0] += fx;
        score[1] += fy;
        for i in 0..3 {
            score[2 + i] += m.arms[0][i].mul_add(fx, m.arms[1][i] * fy);
        }
    }
    let inverse = is_in / all.max(Four::splat(f64::MIN_POSITIVE));
    let mut at = 0;
    for i in 0..SCORES {
        let scaled = score[i] * inverse;
        for j in 0..=i {
            sums[at] = scaled.mul_add(score[j], sums[at]);
            at += 1;
        }
    }
}

#[cfg(test)]
mod tests;
