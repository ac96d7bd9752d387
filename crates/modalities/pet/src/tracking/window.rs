//! A window's lines, made ready for the loops: directions, places and the shape of their noise, four lines to a pack.
//!
//! Places are kept from `origin` (a point near the markers), so that no digits are lost on the scanner's radius. For each line a
//! basis `(e1, e2)` of the plane perpendicular to it; the offset of a point M from the line is `u = (e1·(c - M), e2·(c - M))`, c
//! the line's foot point. A component k of the noise has the precision `P_k` (2 x 2) in that basis and the density at its middle
//! `c_k = π_k √det P_k / 2π`; [`super::noise`] says where they come from. The covariance is taken where the line passes `origin`: over
//! the 13 mm of a marker set it changes by less than 3 per cent.

use super::failure::Failure;
use super::lanes::{Four, LANES, Three, cross, dot};
use super::noise::{COMPONENTS, LineNoise};
use crate::line::{Line, SHORTEST_LINE_M};
use nalgebra::Vector3;
use pulp::Arch;

/// Where four lines run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rays {
    /// Unit directions.
    pub(crate) direction: Three,
    /// Points of the lines nearest to the origin, from it, m.
    pub(crate) foot_m: Three,
    /// 1 for a line, 0 for a pack's empty places.
    pub(crate) filled: Four,
}

/// The noise of four lines.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shapes {
    pub(crate) e1: Three,
    pub(crate) e2: Three,
    /// `(e1·c, e2·c)`, m.
    pub(crate) at: [Four; 2],
    /// `P_k` as 11, 12, 22, 1/m².
    pub(crate) precision: [[Four; 3]; COMPONENTS],
    /// `c_k`, 1/m².
    pub(crate) peak: [Four; COMPONENTS],
    /// Density of the background at the markers, 1/m².
    pub(crate) background: Four,
    /// 1 for a line that passes near, else 0.
    pub(crate) filled: Four,
}

/// Four lines as they come.
#[derive(Clone, Copy, Debug, Default)]
struct Ends {
    a: Three,
    b: Three,
    filled: Four,
    blocks: [[u32; LANES]; 2],
}

/// A window of lines, prepared.
#[derive(Clone, Debug, Default)]
pub struct Window {
    pub(crate) origin_world_m: Vector3<f64>,
    pub(crate) rays: Vec<Rays>,
    pub(crate) shapes: Vec<Shapes>,
    /// Index in the given slice of each line that is in.
    pub(crate) indices: Vec<u32>,
    ends: Vec<Ends>,
    given: usize,
    near: usize,
    /// Density of the background, 1/m².
    pub(crate) background_per_m2: f64,
}

/// How a window is made ready.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preparation {
    /// A point near the markers: the prediction, or the lines' centroid.
    pub about_world_m: Vector3<f64>,
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
        Self { about_world_m, velocity_world_m_s: Vector3::zeros(), at_s: 0.0, budget: None }
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
        self.near
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
        self.origin_world_m = how.about_world_m;
        let usable = lines.iter().filter(|l| is_usable(l)).count();
        let take = how.budget.unwrap_or(usize::MAX).min(usable);
        let mut seen = 0_usize;
        for (index, line) in lines.iter().enumerate() {
            if !is_usable(line) {
                continue;
            }
            // The k-th of `take` of `usable` lines, evenly spread (Bresenham).
            seen += 1;
            if seen * take / usable == (seen - 1) * take / usable {
                continue;
            }
            let moved = if how.velocity_world_m_s == Vector3::zeros() {
                how.about_world_m
            } else {
                how.about_world_m + how.velocity_world_m_s * (line.t_s - how.at_s)
            };
            let lane = self.indices.len() % LANES;
            if lane == 0 {
                self.ends.push(Ends::default());
            }
            if let Some(pack) = self.ends.last_mut() {
                for axis in 0..3 {
                    pack.a[axis].0[lane] = line.ends_world_m[0][axis] - moved[axis];
                    pack.b[axis].0[lane] = line.ends_world_m[1][axis] - moved[axis];
                }
                pack.filled.0[lane] = 1.0;
            }
            self.indices.push(index as u32);
        }
        if self.indices.len() < needed.max(FEWEST_LINES) {
            let (given, usable) = (self.given, self.indices.len());
            return Err(Failure::TooFewLines { given, usable, needed: needed.max(FEWEST_LINES) });
        }
        // Empty places repeat the pack's first line: finite numbers that count for nothing.
        if let Some(pack) = self.ends.last_mut() {
            for lane in 0..LANES {
                if pack.filled.0[lane] == 0.0 {
                    for axis in 0..3 {
                        pack.a[axis].0[lane] = pack.a[axis].0[0];
                        pack.b[axis].0[lane] = pack.b[axis].0[0];
                    }
                }
            }
        }
        let (ends, rays) = (&self.ends, &mut self.rays);
        Arch::new().dispatch(|| rays.extend(ends.iter().map(rays_of)));
        Ok(())
    }

    /// Adds the noise of each line, where it passes the origin.
    pub fn shape(&mut self, noise: &LineNoise) {
        let origin = self.origin_world_m;
        for pack in &mut self.ends {
            for lane in 0..LANES {
                let place = |end: &Three| {
                    Vector3::new(
                        end[0].0[lane] + origin.x,
                        end[1].0[lane] + origin.y,
                        end[2].0[lane] + origin.z,
                    )
                };
                pack.blocks[0][lane] = noise.block_at(&place(&pack.a));
                pack.blocks[1][lane] = noise.block_at(&place(&pack.b));
            }
        }
        self.shapes.clear();
        let (ends, rays, shapes) = (&self.ends, &self.rays, &mut self.shapes);
        Arch::new().dispatch(
            #[inline(always)]
            || shapes.extend(ends.iter().zip(rays).map(|(e, r)| shapes_of(e, r, noise))),
        );
        self.near = self.shapes.iter().map(|s| s.filled.sum()).sum::<f64>() as usize;
        self.background_per_m2 = 1.0 / (std::f64::consts::PI * noise.background_radius_m.powi(2));
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

    /// Makes the same lines ready about another point: the noise is left as it is.
    pub(crate) fn move_origin(&mut self, to_world_m: &Vector3<f64>) {
        let step = to_world_m - self.origin_world_m;
        self.origin_world_m = *to_world_m;
        let step = super::lanes::splat3(&step);
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
        for (shape, rays) in self.shapes.iter_mut().zip(&self.rays) {
            shape.at = [dot(&shape.e1, &rays.foot_m), dot(&shape.e2, &rays.foot_m)];
        }
    }
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

#[inline(always)]
fn rays_of(ends: &Ends) -> Rays {
    let along: Three = std::array::from_fn(|i| ends.b[i] - ends.a[i]);
    let inverse = Four::splat(1.0) / dot(&along, &along).sqrt();
    let direction: Three = std::array::from_fn(|i| along[i] * inverse);
    let t = dot(&direction, &ends.a);
    let foot_m: Three = std::array::from_fn(|i| ends.a[i] - t * direction[i]);
    Rays { direction, foot_m, filled: ends.filled }
}

/// `e^T C f` of a symmetric C given as xx, xy, xz, yy, yz, zz.
#[inline(always)]
fn quadratic(e: &Three, c: &[Four; 6], f: &Three) -> Four {
    let cf = [
        c[0] * f[0] + c[1] * f[1] + c[2] * f[2],
        c[1] * f[0] + c[3] * f[1] + c[4] * f[2],
        c[2] * f[0] + c[4] * f[1] + c[5] * f[2],
    ];
    dot(e, &cf)
}

#[inline(always)]
fn shapes_of(ends: &Ends, rays: &Rays, noise: &LineNoise) -> Shapes {
    let one = Four::splat(1.0);
    let n = &rays.direction;
    // Duff et al. 2017: a basis without a singular direction.
    let sign = n[2].less_select(Four::ZERO, -one, one);
    let a = -one / (sign + n[2]);
    let b = n[0] * n[1] * a;
    let e1 = [one + sign * n[0] * n[0] * a, sign * b, -(sign * n[0])];
    let e2 = cross(n, &e1);
    // Where the line passes the origin: 0 at the first end, 1 at the second.
    let along: Three = std::array::from_fn(|i| ends.b[i] - ends.a[i]);
    let length = dot(&along, n);
    let from_a = -dot(&ends.a, n);
    let s = (from_a / length).max(Four::ZERO).min(one);
    let (near, far) = ((one - s) * (one - s), s * s);
    let mut core = [Four::ZERO; 6];
    let mut tail = [Four::ZERO; 6];
    for lane in 0..LANES {
        let (ca, ta) = noise.end_covariances(ends.blocks[0][lane]);
        let (cb, tb) = noise.end_covariances(ends.blocks[1][lane]);
        for i in 0..6 {
            core[i].0[lane] = near.0[lane] * ca[i] + far.0[lane] * cb[i];
            tail[i].0[lane] = near.0[lane] * ta[i] + far.0[lane] * tb[i];
        }
    }
    let bend = Four::splat(noise.acollinearity_sd_rad) * length * s * (one - s);
    let round = bend * bend + Four::splat(noise.source_variance_m2);
    let flat = |c: &[Four; 6]| {
        [quadratic(&e1, c, &e1) + round, quadratic(&e1, c, &e2), quadratic(&e2, c, &e2) + round]
    };
    let (core, tail) = (flat(&core), flat(&tail));
    let half = Four::splat(0.5);
    let mixed: [Four; 3] = std::array::from_fn(|i| half * (core[i] + tail[i]));
    let mut precision = [[Four::ZERO; 3]; COMPONENTS];
    let mut peak = [Four::ZERO; COMPONENTS];
    for (k, c) in [core, mixed, tail].iter().enumerate() {
        let inverse = one / (c[0] * c[2] - c[1] * c[1]);
        precision[k] = [c[2] * inverse, -(c[1] * inverse), c[0] * inverse];
        peak[k] =
            Four::splat(noise.component_shares[k] / std::f64::consts::TAU) * inverse.sqrt() * ends.filled;
    }
    let at = [dot(&e1, &rays.foot_m), dot(&e2, &rays.foot_m)];
    // Even among the lines that pass near; the others are no one's, they count for nothing.
    let radius = Four::splat(noise.background_radius_m);
    let filled = (at[0] * at[0] + at[1] * at[1]).less_select(radius * radius, ends.filled, Four::ZERO);
    let background = Four::splat(1.0) / (Four::splat(std::f64::consts::PI) * radius * radius);
    Shapes { e1, e2, at, precision, peak, background, filled }
}
