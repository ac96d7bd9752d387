//! A window's lines, made ready for the loops: directions, places and the shape of their noise, four lines to a pack, and the same in single
//! precision, eight to a pack.
//!
//! Places are kept from `origin` (a point near the markers), so that no digits are lost on the scanner's radius. For each line a
//! basis `(e1, e2)` of the plane perpendicular to it; the offset of a point M from the line is `u = (e1·(c - M), e2·(c - M))`, c
//! the line's foot point. A component k of the noise has the precision `P_k` (2 x 2) in that basis and the density at its middle
//! `c_k = π_k √det P_k / 2π`; [`super::noise`] says where they come from. The covariance is taken where the line passes `origin`: over
//! the 13 mm of a marker set it changes by less than 3 per cent. There, too, the lines are drawn back by how far those that the scanner
//! sees lie beside their marker ([`LineNoise::beside`]).

use super::failure::Failure;
use super::lanes::{Eight, Four, LANES, Three, cross, dot, splat3, three};
use super::noise::{COMPONENTS, LineNoise};
use crate::line::{Line, SHORTEST_LINE_M};
use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};

/// Where four lines run, or eight in single precision.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rays<T = Four> {
    /// Unit directions.
    pub(crate) direction: [T; 3],
    /// Points of the lines nearest to the origin, from it, m.
    pub(crate) foot_m: [T; 3],
    /// 1 for a line, 0 for a pack's empty places.
    pub(crate) filled: T,
}

/// The noise of four lines, or of eight in single precision.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shapes<T = Four> {
    pub(crate) e1: [T; 3],
    pub(crate) e2: [T; 3],
    /// `(e1·c, e2·c)`, m.
    pub(crate) at: [T; 2],
    /// `P_k` as 11, 12, 22, 1/m².
    pub(crate) precision: [[T; 3]; COMPONENTS],
    /// `c_k`, 1/m².
    pub(crate) peak: [T; COMPONENTS],
    /// Density of the background at the markers, 1/m².
    pub(crate) background: T,
    /// 1 for a line, 0 for a pack's empty places.
    pub(crate) filled: T,
}

/// Two packs of four lines as one of eight in single precision.
pub(crate) trait Paired: Copy {
    type Narrow;

    fn narrow(&self, second: &Self) -> Self::Narrow;
    /// The same lines, which count for nothing.
    fn emptied(&self) -> Self;
}

#[inline(always)]
fn narrow<const N: usize>(first: &[Four; N], second: &[Four; N]) -> [Eight; N] {
    let mut both = [Eight::default(); N];
    for i in 0..N {
        both[i] = Eight::of(first[i], second[i]);
    }
    both
}

impl Paired for Rays {
    type Narrow = Rays<Eight>;

    #[inline(always)]
    fn narrow(&self, second: &Self) -> Rays<Eight> {
        Rays {
            direction: narrow(&self.direction, &second.direction),
            foot_m: narrow(&self.foot_m, &second.foot_m),
            filled: Eight::of(self.filled, second.filled),
        }
    }

    #[inline(always)]
    fn emptied(&self) -> Self {
        Self { filled: Four::ZERO, ..*self }
    }
}

impl Paired for Shapes {
    type Narrow = Shapes<Eight>;

    #[inline(always)]
    fn narrow(&self, second: &Self) -> Shapes<Eight> {
        Shapes {
            e1: narrow(&self.e1, &second.e1),
            e2: narrow(&self.e2, &second.e2),
            at: narrow(&self.at, &second.at),
            precision: three!(k => narrow(&self.precision[k], &second.precision[k])),
            peak: narrow(&self.peak, &second.peak),
            background: Eight::of(self.background, second.background),
            filled: Eight::of(self.filled, second.filled),
        }
    }

    #[inline(always)]
    fn emptied(&self) -> Self {
        Self { filled: Four::ZERO, ..*self }
    }
}

/// Packs of four as packs of eight in single precision.
pub(crate) struct ToNarrow<'a, P: Paired> {
    pub(crate) packs: &'a [P],
    pub(crate) narrow: &'a mut Vec<P::Narrow>,
}

impl<P: Paired> ToNarrow<'_, P> {
    pub(crate) fn run(self) {
        self.narrow.clear();
        Arch::new().dispatch(self);
    }
}

impl<P: Paired> WithSimd for ToNarrow<'_, P> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (pairs, last) = self.packs.as_chunks::<2>();
        self.narrow.extend(pairs.iter().map(|[first, second]| first.narrow(second)));
        self.narrow.extend(last.iter().map(|pack| pack.narrow(&pack.emptied())));
    }
}

/// Four lines as they come.
#[derive(Clone, Copy, Debug, Default)]
struct Ends {
    a: Three,
    b: Three,
    filled: Four,
}

/// A window of lines, prepared.
#[derive(Clone, Debug, Default)]
pub struct Window {
    pub(crate) origin_world_m: Vector3<f64>,
    scanner_world_m: Vector3<f64>,
    pub(crate) rays: Vec<Rays>,
    /// Of the lines that pass near: the others are no one's, they count for nothing.
    pub(crate) shapes: Vec<Shapes>,
    /// The same in single precision: what a climb looks at.
    pub(crate) narrow_shapes: Vec<Shapes<Eight>>,
    /// Index in the given slice of each line that is in.
    pub(crate) indices: Vec<u32>,
    /// Index in the given slice of each line that passes near.
    pub(crate) near_indices: Vec<u32>,
    ends: Vec<Ends>,
    near_ends: Vec<Ends>,
    given: usize,
    /// Density of the background, 1/m².
    pub(crate) background_per_m2: f64,
}

/// How a window is made ready.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preparation {
    /// A point near the markers: the prediction, or the lines' centroid.
    pub about_world_m: Vector3<f64>,
    /// Where the origin of the scanner's frame, in which its file tells the blocks, stands in the world: a bed moves it.
    pub scanner_world_m: Vector3<f64>,
    /// Lines are carried along this velocity to `at_s`, m/s.
    pub velocity_world_m_s: Vector3<f64>,
    /// The window's middle, s; not looked at where the velocity is zero.
    pub at_s: f64,
    /// Take at most so many lines, evenly over the window; `None`: all.
    pub budget: Option<usize>,
}

impl Preparation {
    /// All lines, at rest, about a point.
    pub fn about(about_world_m: Vector3<f64>) -> Self {
        Self {
            about_world_m,
            scanner_world_m: Vector3::zeros(),
            velocity_world_m_s: Vector3::zeros(),
            at_s: 0.0,
            budget: None,
        }
    }
}

/// The least usable lines that any tracker looks at: six degrees of freedom from two numbers per line.
pub const FEWEST_LINES: usize = 3;

impl Window {
    /// Lines that are in.
    pub fn len(&self) -> usize {
        self.indices.len()
    }

    /// Lines that pass near enough to enter the likelihood.
    pub fn near(&self) -> usize {
        self.near_indices.len()
    }

    /// Whether none is in.
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// The point that it was prepared about, world, m.
    pub fn origin_world_m(&self) -> Vector3<f64> {
        self.origin_world_m
    }

    /// Takes the lines in: directions and places. [`Self::shape`] adds the noise.
    ///
    /// # Errors
    /// [`Failure::TooFewLines`].
    pub fn load(&mut self, lines: &[Line], how: &Preparation, needed: usize) -> Result<(), Failure> {
        self.given = lines.len();
        self.indices.clear();
        self.ends.clear();
        self.rays.clear();
        self.shapes.clear();
        self.narrow_shapes.clear();
        self.origin_world_m = how.about_world_m;
        self.scanner_world_m = how.scanner_world_m;
        // Without a budget, or within it, all are taken.
        let most = how.budget.filter(|most| *most < lines.len());
        let even = most.map(|most| {
            let usable = lines.iter().filter(|l| is_usable(l)).count();
            (most.min(usable), usable)
        });
        let mut seen = 0_usize;
        for (index, line) in lines.iter().enumerate() {
            if !is_usable(line) {
                continue;
            }
            // The k-th of `take` of `usable` lines, evenly spread (Bresenham).
            seen += 1;
            if even.is_some_and(|(take, usable)| seen * take / usable == (seen - 1) * take / usable) {
                continue;
            }
            let moved = if how.velocity_world_m_s == Vector3::zeros() {
                how.about_world_m
            } else {
                how.about_world_m + how.velocity_world_m_s * (line.t_s - how.at_s)
            };
            push_line(&mut self.ends, self.indices.len(), line, &moved);
            self.indices.push(index as u32);
        }
        if self.indices.len() < needed.max(FEWEST_LINES) {
            let (given, usable) = (self.given, self.indices.len());
            return Err(Failure::TooFewLines { given, usable, needed: needed.max(FEWEST_LINES) });
        }
        fill_up(&mut self.ends);
        Arch::new().dispatch(ToRays { ends: &self.ends, rays: &mut self.rays });
        Ok(())
    }

    /// Adds the noise of each line that passes near, where it passes the origin.
    pub fn shape(&mut self, noise: &LineNoise) {
        self.choose_near(noise);
        self.shapes.clear();
        let (ends, shapes) = (&self.near_ends, &mut self.shapes);
        // Blocks and field are the scanner's, wherever a bed holds it.
        let origin = &(self.origin_world_m - self.scanner_world_m);
        let beside = noise.beside(origin);
        Arch::new().dispatch(ToShapes { ends, origin, beside: &beside, noise, shapes });
        ToNarrow { packs: &self.shapes, narrow: &mut self.narrow_shapes }.run();
        self.background_per_m2 = 1.0 / (std::f64::consts::PI * noise.background_radius_m.powi(2));
    }

    /// The lines that pass the origin within the background's radius.
    fn choose_near(&mut self, noise: &LineNoise) {
        self.near_ends.clear();
        self.near_indices.clear();
        let squared_radius = noise.background_radius_m * noise.background_radius_m;
        for (k, index) in self.indices.iter().enumerate() {
            let (pack, lane) = place(k);
            let foot = self.rays[pack].foot_m.map(|axis| axis.0[lane]);
            if foot[0] * foot[0] + foot[1] * foot[1] + foot[2] * foot[2] >= squared_radius {
                continue;
            }
            let (from, (to, to_lane)) = (&self.ends[pack], place(self.near_indices.len()));
            if to_lane == 0 {
                self.near_ends.push(Ends::default());
            }
            let to = &mut self.near_ends[to];
            for axis in 0..3 {
                to.a[axis].0[to_lane] = from.a[axis].0[lane];
                to.b[axis].0[to_lane] = from.b[axis].0[lane];
            }
            to.filled.0[to_lane] = 1.0;
            self.near_indices.push(*index);
        }
        fill_up(&mut self.near_ends);
    }

    /// Loads and shapes.
    ///
    /// # Errors
    /// [`Failure::TooFewLines`].
    pub fn prepare(
        &mut self,
        lines: &[Line],
        noise: &LineNoise,
        how: &Preparation,
        needed: usize,
    ) -> Result<(), Failure> {
        self.load(lines, how, needed)?;
        self.shape(noise);
        Ok(())
    }

    /// Makes loaded lines ready about another point, before [`Self::shape`].
    pub(crate) fn move_origin(&mut self, to_world_m: &Vector3<f64>) {
        let step = to_world_m - self.origin_world_m;
        self.origin_world_m = *to_world_m;
        let step = splat3(&step);
        for rays in &mut self.rays {
            for axis in 0..3 {
                rays.foot_m[axis] = rays.foot_m[axis] - step[axis];
            }
            let along = dot(&rays.direction, &rays.foot_m);
            for axis in 0..3 {
                rays.foot_m[axis] = rays.foot_m[axis] - along * rays.direction[axis];
            }
        }
        for pack in &mut self.ends {
            for axis in 0..3 {
                pack.a[axis] = pack.a[axis] - step[axis];
                pack.b[axis] = pack.b[axis] - step[axis];
            }
        }
    }
}

/// Pack and lane of the k-th line.
fn place(k: usize) -> (usize, usize) {
    (k / LANES, k % LANES)
}

/// Puts a line, told from `about_world_m`, behind `count` others.
fn push_line(packs: &mut Vec<Ends>, count: usize, line: &Line, about_world_m: &Vector3<f64>) {
    let (pack, lane) = place(count);
    if lane == 0 {
        packs.push(Ends::default());
    }
    let pack = &mut packs[pack];
    for axis in 0..3 {
        pack.a[axis].0[lane] = line.ends_world_m[0][axis] - about_world_m[axis];
        pack.b[axis].0[lane] = line.ends_world_m[1][axis] - about_world_m[axis];
    }
    pack.filled.0[lane] = 1.0;
}

/// Usable lines as rays from the world's origin; keeps its buffers.
#[derive(Clone, Debug, Default)]
pub(crate) struct RaysThrough {
    ends: Vec<Ends>,
    rays: Vec<Rays>,
}

impl RaysThrough {
    /// The rays of these lines.
    pub(crate) fn of(&mut self, lines: &[Line]) -> &[Rays] {
        self.ends.clear();
        self.rays.clear();
        for (count, line) in lines.iter().enumerate() {
            push_line(&mut self.ends, count, line, &Vector3::zeros());
        }
        fill_up(&mut self.ends);
        Arch::new().dispatch(ToRays { ends: &self.ends, rays: &mut self.rays });
        &self.rays
    }
}

/// Empty places repeat the pack's first line: finite numbers that count for nothing.
fn fill_up(packs: &mut [Ends]) {
    let Some(pack) = packs.last_mut() else { return };
    for lane in 1..LANES {
        if pack.filled.0[lane] != 0.0 {
            continue;
        }
        for axis in 0..3 {
            pack.a[axis].0[lane] = pack.a[axis].0[0];
            pack.b[axis].0[lane] = pack.b[axis].0[0];
        }
    }
}

/// The mean of the usable lines' middles: an origin where nothing is known, m.
pub(crate) fn middle_m(lines: &[Line]) -> Vector3<f64> {
    let usable = lines.iter().filter(|line| is_usable(line));
    let (sum, count) = usable.fold((Vector3::zeros(), 0.0), |(sum, count), line| {
        (sum + 0.5 * (line.ends_world_m[0] + line.ends_world_m[1]), count + 1.0)
    });
    if count > 0.0 { sum / count } else { sum }
}

pub(crate) fn is_usable(line: &Line) -> bool {
    let along = line.ends_world_m[1] - line.ends_world_m[0];
    let squared = along.norm_squared();
    // Not a number and infinity fail the comparisons; both ends are looked at, since their difference may hide an infinity.
    squared > SHORTEST_LINE_M * SHORTEST_LINE_M
        && squared < LONGEST_LINE_M * LONGEST_LINE_M
        && line.ends_world_m[0].norm_squared() < LONGEST_LINE_M * LONGEST_LINE_M
        && line.t_s.is_finite()
}

/// No scanner is larger, m; beyond it digits are lost.
const LONGEST_LINE_M: f64 = 100.0;

struct ToRays<'a> {
    ends: &'a [Ends],
    rays: &'a mut Vec<Rays>,
}

impl WithSimd for ToRays<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for ends in self.ends {
            self.rays.push(rays_of(ends));
        }
    }
}

struct ToShapes<'a> {
    ends: &'a [Ends],
    origin: &'a Vector3<f64>,
    beside: &'a Vector3<f64>,
    noise: &'a LineNoise,
    shapes: &'a mut Vec<Shapes>,
}

impl WithSimd for ToShapes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let [origin, beside] = [self.origin, self.beside].map(splat3);
        for ends in self.ends {
            self.shapes.push(shapes_of(ends, &rays_of(ends), &origin, &beside, self.noise));
        }
    }
}

#[inline(always)]
fn rays_of(ends: &Ends) -> Rays {
    let along: Three = three!(i => ends.b[i] - ends.a[i]);
    let inverse = Four::splat(1.0) / dot(&along, &along).sqrt();
    let direction: Three = three!(i => along[i] * inverse);
    let t = dot(&direction, &ends.a);
    let foot_m: Three = three!(i => ends.a[i] - t * direction[i]);
    Rays { direction, foot_m, filled: ends.filled }
}

/// `e^T C f` of a symmetric C given as xx, xy, xz, yy, yz, zz.
#[inline(always)]
fn quadratic(e: &Three, c: &[Four; 6], f: &Three) -> Four {
    let cf = [dot(&[c[0], c[1], c[2]], f), dot(&[c[1], c[3], c[4]], f), dot(&[c[2], c[4], c[5]], f)];
    dot(e, &cf)
}

/// A covariance across the line, and what is round in it: 11, 12, 22.
#[inline(always)]
fn flat(e1: &Three, e2: &Three, c: &[Four; 6], round: Four) -> [Four; 3] {
    [quadratic(e1, c, e1) + round, quadratic(e1, c, e2), quadratic(e2, c, e2) + round]
}

#[inline(always)]
fn shapes_of(ends: &Ends, rays: &Rays, origin: &Three, beside: &Three, noise: &LineNoise) -> Shapes {
    let one = Four::splat(1.0);
    let n = &rays.direction;
    // Duff et al. 2017: a basis without a singular direction.
    let sign = n[2].less_select(Four::ZERO, -one, one);
    let a = -one / (sign + n[2]);
    let b = n[0] * n[1] * a;
    let e1 = [one + sign * n[0] * n[0] * a, sign * b, -(sign * n[0])];
    let e2 = cross(n, &e1);
    // Where the line passes the origin: 0 at the first end, 1 at the second.
    let along: Three = three!(i => ends.b[i] - ends.a[i]);
    let length = dot(&along, n);
    let from_a = -dot(&ends.a, n);
    let s = (from_a / length).max(Four::ZERO).min(one);
    let (near, far) = ((one - s) * (one - s), s * s);
    let mut core = [Four::ZERO; 6];
    let mut tail = [Four::ZERO; 6];
    let blocks = [
        noise.blocks_at(&three!(i => ends.a[i] + origin[i])),
        noise.blocks_at(&three!(i => ends.b[i] + origin[i])),
    ];
    for lane in 0..LANES {
        let (ca, ta) = noise.end_covariances(blocks[0][lane]);
        let (cb, tb) = noise.end_covariances(blocks[1][lane]);
        for i in 0..6 {
            core[i].0[lane] = near.0[lane] * ca[i] + far.0[lane] * cb[i];
            tail[i].0[lane] = near.0[lane] * ta[i] + far.0[lane] * tb[i];
        }
    }
    let bend = Four::splat(noise.acollinearity_sd_rad) * length * s * (one - s);
    let round = bend * bend + Four::splat(noise.source_variance_m2);
    let (core, tail) = (flat(&e1, &e2, &core, round), flat(&e1, &e2, &tail, round));
    let half = Four::splat(0.5);
    let mixed: [Four; 3] = three!(i => half * (core[i] + tail[i]));
    let mut precision = [[Four::ZERO; 3]; COMPONENTS];
    let mut peak = [Four::ZERO; COMPONENTS];
    for (k, c) in [core, mixed, tail].iter().enumerate() {
        let inverse = one / (c[0] * c[2] - c[1] * c[1]);
        precision[k] = [c[2] * inverse, -(c[1] * inverse), c[0] * inverse];
        peak[k] =
            Four::splat(noise.component_shares[k] / std::f64::consts::TAU) * inverse.sqrt() * ends.filled;
    }
    // A marker's lines lie about where they are seen in the mean, beside it.
    let foot_m: Three = three!(i => rays.foot_m[i] - beside[i]);
    let at = [dot(&e1, &foot_m), dot(&e2, &foot_m)];
    // Even among the lines that pass near.
    let radius = Four::splat(noise.background_radius_m);
    let background = Four::splat(1.0) / (Four::splat(std::f64::consts::PI) * radius * radius);
    Shapes { e1, e2, at, precision, peak, background, filled: ends.filled }
}
