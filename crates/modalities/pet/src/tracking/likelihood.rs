//! The robust likelihood of a pose: a component per marker, an explicit background.
//!
//! ```text
//! p_i = (1-β) Σ_j w_j Σ_k c_ik exp(-½ uᵀ P_ik u) + β b_i,      u = offset of line i from marker j,  M_j = p + R a_j
//! ```
//!
//! with shares w_j (they sum to 1), background share β, and the line's noise of [`super::window`]. Derivatives are those of the
//! mixture itself, not of a bound to it. With responsibilities ρ_ijk, marker forces `f_ij = Eᵢᵀ Σ_k ρ_ijk P_ik u_ij` and line scores
//! `g_i = Σ_j J_jᵀ f_ij`:
//!
//! ```text
//! gradient               Σ_i g_i
//! observed information   Σ_ij J_jᵀ Eᵢᵀ [Σ_k ρ (P - P u uᵀ P)] Eᵢ J_j + Σ_i g_i g_iᵀ - Σ_j f_jᵀ ∂²M_j
//! ```
//!
//! This is Louis' form (1982): complete-data information less the information that the unknown labels take away; it is not positive
//! definite everywhere. The last term is the curvature of the rotation itself. By `[δp_world, δθ_capsule]` at the capsule's origin.
//!
//! [`Likelihood::expected_information`] integrates `g gᵀ` over the model's own law of each line's offset (`expected.rs`).

use super::lanes::{Eight, Four, three};
use super::noise::COMPONENTS;
use super::octet::Octet;
use super::quad::Quad;
use super::register::{self, Kernel, LogSum, Numbers, Register, Unit, cross, dispatch, dot, load, splat3};
use super::window::{Shapes, Window};
use lumenav_core::pose::skew;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};
use std::marker::PhantomData;

/// Shares of markers and background.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Share of each marker in the lines that are not background; they sum to 1.
    pub shares: Vec<f64>,
    /// Share of the background, between 0 and 1.
    pub background: f64,
}

/// The likelihood at a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// `Σ ln p_i`, p_i in 1/m².
    pub log_likelihood: f64,
    /// By `[δp_world, δθ_capsule]`.
    pub gradient: Vector6<f64>,
    /// Observed information; need not be positive definite.
    pub information: Matrix6<f64>,
    /// Lines that each marker explains: responsibilities summed.
    pub lines_of_marker: Vec<f64>,
    /// Lines that the background explains.
    pub background_lines: f64,
}

impl Default for Evaluation {
    fn default() -> Self {
        Self {
            log_likelihood: 0.0,
            gradient: Vector6::zeros(),
            information: Matrix6::zeros(),
            lines_of_marker: Vec::new(),
            background_lines: 0.0,
        }
    }
}

impl Evaluation {
    /// Lines that the markers explain.
    pub fn effective_lines(&self) -> f64 {
        self.lines_of_marker.iter().sum()
    }
}

/// Markers' positions in the capsule's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Likelihood {
    /// m.
    pub markers_capsule_m: Vec<Vector3<f64>>,
}

/// What a pass sums for one marker.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MarkerSums<T = f64> {
    /// Responsibilities.
    pub(crate) lines: T,
    /// Force, 1/m.
    pub(crate) force: [T; 3],
    /// `Σ E^T [...] E`: xx, xy, xz, yy, yz, zz, 1/m².
    pub(crate) curvature: [T; 6],
}

impl<R: Register> MarkerSums<R> {
    #[inline(always)]
    fn nothing(zero: R) -> Self {
        Self { lines: zero, force: [zero; 3], curvature: [zero; 6] }
    }

    /// Over the lanes.
    #[inline(always)]
    fn added(&self) -> MarkerSums {
        MarkerSums {
            lines: self.lines.numbers().sum(),
            force: register::sums(&self.force),
            curvature: register::sums(&self.curvature),
        }
    }
}

/// What a pass sums over all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums<L = f64, T = f64> {
    pub(crate) log_likelihood: L,
    pub(crate) background: T,
    /// Upper triangle of `Σ g g^T`, rows first, force before torque about the capsule's origin, world.
    pub(crate) outer: [T; 21],
}

/// One marker as a pass sees it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Placed {
    /// Place from the window's origin, m.
    pub(crate) at_m: Vector3<f64>,
    /// Place from the capsule's origin, world axes, m.
    pub(crate) arm_m: Vector3<f64>,
    /// `(1-β) w`.
    pub(crate) weight: f64,
}

/// What a pass is for.
pub(crate) trait Purpose {
    /// Subtract what the labels' uncertainty within a marker takes (Louis), and sum the outer products.
    const OBSERVED: bool;
}
/// Observed information of a pose.
pub(crate) struct OfPose;
/// Complete-data information of free points (EM).
pub(crate) struct OfPoints;
impl Purpose for OfPose {
    const OBSERVED: bool = true;
}
impl Purpose for OfPoints {
    const OBSERVED: bool = false;
}

/// More markers than this are not read from a file.
pub(crate) const MAX_MARKERS: usize = 32;

/// One pass over a window; tells each marker's sums.
pub(crate) fn pass<P: Purpose, T: Numbers>(
    shapes: &[Shapes<T>],
    placed: &[Placed],
    background: f64,
    tell: impl FnMut(&Placed, &MarkerSums),
) -> Sums {
    /// A loop for a fixed number of markers; empty places have no weight.
    fn fixed<P: Purpose, T: Numbers, const J: usize>(
        shapes: &[Shapes<T>],
        placed: &[Placed],
        background: f64,
        mut tell: impl FnMut(&Placed, &MarkerSums),
    ) -> Sums {
        let mut all = [Placed::default(); J];
        let used = placed.len().min(J);
        all[..used].copy_from_slice(&placed[..used]);
        let loops = Loop::<P, T, J> { shapes, placed: &all, background, purpose: PhantomData };
        let (sums, marker_sums) = dispatch(loops);
        for (placed, sums) in placed.iter().zip(&marker_sums) {
            tell(placed, sums);
        }
        sums
    }
    match placed.len() {
        0..=1 => fixed::<P, T, 1>(shapes, placed, background, tell),
        2 => fixed::<P, T, 2>(shapes, placed, background, tell),
        3 => fixed::<P, T, 3>(shapes, placed, background, tell),
        4 => fixed::<P, T, 4>(shapes, placed, background, tell),
        5..=6 => fixed::<P, T, 6>(shapes, placed, background, tell),
        7..=12 => fixed::<P, T, 12>(shapes, placed, background, tell),
        _ => fixed::<P, T, MAX_MARKERS>(shapes, placed, background, tell),
    }
}

/// The loop over a window's packs.
struct Loop<'a, P, T, const J: usize> {
    shapes: &'a [Shapes<T>],
    placed: &'a [Placed; J],
    background: f64,
    purpose: PhantomData<P>,
}

impl<P: Purpose, T: Numbers, const J: usize> Kernel for Loop<'_, P, T, J> {
    type Output = (Sums, [MarkerSums; J]);

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> Self::Output {
        let zero = T::In::splat(unit, 0.0);
        let mut of_marker = [MarkerSums::nothing(zero); J];
        let mut sums = Sums { log_likelihood: LogSum::new(unit), background: zero, outer: [zero; 21] };
        let mut markers = [Spread::new(unit, &self.placed[0]); J];
        for (to, from) in markers.iter_mut().zip(self.placed) {
            *to = Spread::new(unit, from);
        }
        let share = T::In::splat(unit, self.background);
        for s in self.shapes {
            one_pack::<P, T, S, J>(unit, s, &markers, share, &mut of_marker, &mut sums);
        }
        let sums = Sums {
            log_likelihood: sums.log_likelihood.sum(),
            background: sums.background.numbers().sum(),
            outer: register::sums(&sums.outer),
        };
        let mut added = [MarkerSums::default(); J];
        for (to, from) in added.iter_mut().zip(&of_marker) {
            *to = from.added();
        }
        (sums, added)
    }
}

/// A marker in all lanes.
#[derive(Clone, Copy)]
struct Spread<R> {
    at: [R; 3],
    arm: [R; 3],
    weight: R,
}

impl<R: Register> Spread<R> {
    #[inline(always)]
    fn new(unit: R::Unit, of: &Placed) -> Self {
        Self { at: splat3(unit, &of.at_m), arm: splat3(unit, &of.arm_m), weight: R::splat(unit, of.weight) }
    }
}

/// A pack's lines, seen from a marker.
struct Densities<R> {
    /// Offsets u, m.
    offset_m: [R; 2],
    /// `c_k exp(-½ uᵀ P_k u)` times the marker's weight, 1/m².
    of_component: [R; COMPONENTS],
}

/// Offsets and densities of a pack's lines about a marker.
#[inline(always)]
fn densities<T: Numbers, S: Unit>(
    unit: S,
    s: &Shapes<T>,
    at: &[T::In<S>; 3],
    weight: T::In<S>,
) -> Densities<T::In<S>> {
    let (e1, e2, foot) = (load(unit, &s.e1), load(unit, &s.e2), load(unit, &s.at));
    let (x, y) = (foot[0] - dot(&e1, at), foot[1] - dot(&e2, at));
    let half = x.all(-0.5);
    let squares = [half * x * x, -(x * y), half * y * y];
    let of_component = three!(k => {
        let q = dot(&load(unit, &s.precision[k]), &squares);
        weight * T::In::of(unit, s.peak[k]) * q.exp()
    });
    Densities { offset_m: [x, y], of_component }
}

#[inline(always)]
fn one_pack<P: Purpose, T: Numbers, S: Unit, const J: usize>(
    unit: S,
    s: &Shapes<T>,
    markers: &[Spread<T::In<S>>; J],
    share: T::In<S>,
    of_marker: &mut [MarkerSums<T::In<S>>; J],
    sums: &mut Sums<LogSum<T::In<S>>, T::In<S>>,
) {
    let zero = T::In::splat(unit, 0.0);
    let (mut u, mut e) = ([[zero; 2]; J], [[zero; COMPONENTS]; J]);
    let from_background = share * T::In::of(unit, s.background);
    let mut total = from_background;
    for (j, marker) in markers.iter().enumerate() {
        let seen = densities::<T, S>(unit, s, &marker.at, marker.weight);
        (u[j], e[j]) = (seen.offset_m, seen.of_component);
        total = total + e[j][0] + e[j][1] + e[j][2];
    }
    let filled = T::In::of(unit, s.filled);
    sums.log_likelihood.add(total, filled);
    let inverse = filled / total;
    sums.background = from_background.mul_add(inverse, sums.background);
    let (e1, e2) = (load(unit, &s.e1), load(unit, &s.e2));
    let mut score = [zero; 6];
    for j in 0..J {
        let [x, y] = u[j];
        let mut w = [zero; 3];
        let (mut tx, mut ty, mut lines) = (zero, zero, zero);
        for k in 0..COMPONENTS {
            let p = load(unit, &s.precision[k]);
            let rho = e[j][k] * inverse;
            let (px, py) = (p[0].mul_add(x, p[1] * y), p[1].mul_add(x, p[2] * y));
            let (rx, ry) = (rho * px, rho * py);
            lines += rho;
            tx += rx;
            ty += ry;
            for i in 0..3 {
                w[i] = rho.mul_add(p[i], w[i]);
            }
            if P::OBSERVED {
                w[0] = rx.mul_sub_from(px, w[0]);
                w[1] = rx.mul_sub_from(py, w[1]);
                w[2] = ry.mul_sub_from(py, w[2]);
            }
        }
        let m = &mut of_marker[j];
        m.lines += lines;
        let force: [T::In<S>; 3] = three!(i => e1[i].mul_add(tx, e2[i] * ty));
        for i in 0..3 {
            m.force[i] += force[i];
        }
        // E^T W E, W symmetric.
        let a: [T::In<S>; 3] = three!(i => e1[i].mul_add(w[0], e2[i] * w[1]));
        let b: [T::In<S>; 3] = three!(i => e1[i].mul_add(w[1], e2[i] * w[2]));
        let mut n = 0;
        for i in 0..3 {
            for l in i..3 {
                m.curvature[n] = a[i].mul_add(e1[l], b[i].mul_add(e2[l], m.curvature[n]));
                n += 1;
            }
        }
        if P::OBSERVED {
            let torque = cross(&markers[j].arm, &force);
            for i in 0..3 {
                score[i] += force[i];
                score[i + 3] += torque[i];
            }
        }
    }
    if P::OBSERVED {
        let mut n = 0;
        for i in 0..6 {
            for l in i..6 {
                sums.outer[n] = score[i].mul_add(score[l], sums.outer[n]);
                n += 1;
            }
        }
    }
}

/// A symmetric 3 x 3 matrix from its upper triangle.
pub(crate) fn symmetric(upper: &[f64; 6]) -> Matrix3<f64> {
    let [xx, xy, xz, yy, yz, zz] = *upper;
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

impl Likelihood {
    /// Of markers at these places in the capsule's frame, m.
    pub fn new(markers_capsule_m: Vec<Vector3<f64>>) -> Self {
        Self { markers_capsule_m }
    }

    /// The markers at a pose, for a pass; returns how many.
    pub(crate) fn place(
        &self,
        pose: &Isometry3<f64>,
        origin_world_m: &Vector3<f64>,
        weights: &Weights,
        placed: &mut [Placed; MAX_MARKERS],
    ) -> usize {
        let used = self.markers_capsule_m.len().min(MAX_MARKERS);
        for ((to, at), share) in placed.iter_mut().zip(&self.markers_capsule_m).zip(&weights.shares) {
            to.arm_m = pose.rotation * at;
            to.at_m = pose.translation.vector + to.arm_m - origin_world_m;
            to.weight = (1.0 - weights.background) * share;
        }
        used
    }

    /// Value, gradient and observed information at a pose, into `out`, whose buffer is used again: no allocation after the first
    /// call. The window must have been prepared with its noise.
    pub fn evaluate(&self, window: &Window, pose: &Isometry3<f64>, weights: &Weights, out: &mut Evaluation) {
        self.evaluate_packs(&window.shapes, window, pose, weights, out);
    }

    /// As [`Self::evaluate`], in single precision: what decides a step. The value is told to 2e-6 per line that passes near, gradient and
    /// information to a thousandth of a standard deviation (`tests.rs`).
    pub(crate) fn evaluate_narrow(
        &self,
        window: &Window,
        pose: &Isometry3<f64>,
        weights: &Weights,
        out: &mut Evaluation,
    ) {
        self.evaluate_packs(&window.narrow_shapes, window, pose, weights, out);
    }

    fn evaluate_packs<T: Numbers>(
        &self,
        packs: &[Shapes<T>],
        window: &Window,
        pose: &Isometry3<f64>,
        weights: &Weights,
        out: &mut Evaluation,
    ) {
        let mut placed = [Placed::default(); MAX_MARKERS];
        let used = self.place(pose, &window.origin_world_m, weights, &mut placed);
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        let (mut pp, mut pr, mut rr) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        let lines_of_marker = &mut out.lines_of_marker;
        lines_of_marker.clear();
        let sums = pass::<OfPose, T>(packs, &placed[..used], weights.background, |p, m| {
            lines_of_marker.push(m.lines);
            let f = Vector3::from(m.force);
            let (c, k, a) = (symmetric(&m.curvature), skew(&p.arm_m), p.arm_m);
            force += f;
            torque += a.cross(&f);
            // M = p + Exp(φ) a: dM/dφ = -[a]x, f·d²M/dφ² = ½(f aᵀ + a fᵀ) - (a·f) 1.
            pp += c;
            pr -= c * k;
            rr -= k * c * k;
            rr -= (f * a.transpose() + a * f.transpose()) * 0.5 - Matrix3::identity() * a.dot(&f);
        });
        let mut information = Matrix6::zeros();
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&pp);
        information.fixed_view_mut::<3, 3>(0, 3).copy_from(&pr);
        information.fixed_view_mut::<3, 3>(3, 0).copy_from(&pr.transpose());
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(&rr);
        let mut n = 0;
        for i in 0..6 {
            for l in i..6 {
                let value = sums.outer[n];
                information[(i, l)] += value;
                if l != i {
                    information[(l, i)] += value;
                }
                n += 1;
            }
        }
        // φ in world axes is R θ.
        let r = pose.rotation.to_rotation_matrix().into_inner();
        out.log_likelihood = sums.log_likelihood;
        out.background_lines = sums.background;
        out.gradient.fixed_rows_mut::<3>(0).copy_from(&force);
        out.gradient.fixed_rows_mut::<3>(3).copy_from(&(r.transpose() * torque));
        out.information = to_capsule_axes(&information, &r);
    }

    /// `Σ ln p_i` alone.
    pub fn log_likelihood(&self, window: &Window, pose: &Isometry3<f64>, weights: &Weights) -> f64 {
        let mut placed = [Placed::default(); MAX_MARKERS];
        let used = self.place(pose, &window.origin_world_m, weights, &mut placed);
        value(&window.shapes, &placed[..used], weights.background)
    }

    /// Expected (Fisher) information about `[δp_world, δθ_capsule]` of lines that run as the window's do, if the model is right and
    /// the shares are known: what bounds and plans ask. Not for loops: a grid of a thousand points per line.
    pub fn expected_information(
        &self,
        window: &Window,
        pose: &Isometry3<f64>,
        weights: &Weights,
    ) -> Matrix6<f64> {
        self.expected_of_counts(window, pose, weights, |_| 1.0)
    }

    /// As [`Self::expected_information`], for `count(i)` lines like the i-th that the window was given: bundles of a plan.
    pub(crate) fn expected_of_counts(
        &self,
        window: &Window,
        pose: &Isometry3<f64>,
        weights: &Weights,
        count: impl Fn(usize) -> f64,
    ) -> Matrix6<f64> {
        let mut placed = [Placed::default(); MAX_MARKERS];
        let used = self.place(pose, &window.origin_world_m, weights, &mut placed);
        let mut information = Matrix6::zeros();
        for (shape, indices) in window.shapes.iter().zip(window.near_indices.chunks(super::lanes::LANES)) {
            let lines = super::expected::of_pack(shape, &placed[..used], weights.background);
            for (line, index) in lines.iter().zip(indices) {
                information += line * count(*index as usize);
            }
        }
        to_capsule_axes(&information, &pose.rotation.to_rotation_matrix().into_inner())
    }
}

fn to_capsule_axes(information: &Matrix6<f64>, r: &Matrix3<f64>) -> Matrix6<f64> {
    let mut turned = *information;
    let pr = information.fixed_view::<3, 3>(0, 3) * r;
    let rr = r.transpose() * information.fixed_view::<3, 3>(3, 3) * r;
    turned.fixed_view_mut::<3, 3>(0, 3).copy_from(&pr);
    turned.fixed_view_mut::<3, 3>(3, 0).copy_from(&pr.transpose());
    turned.fixed_view_mut::<3, 3>(3, 3).copy_from(&((rr + rr.transpose()) * 0.5));
    turned
}

/// `Σ ln p_i` of markers at these places.
pub(crate) fn value(shapes: &[Shapes], placed: &[Placed], background: f64) -> f64 {
    dispatch(Value { shapes, placed, background })
}

struct Value<'a> {
    shapes: &'a [Shapes],
    placed: &'a [Placed],
    background: f64,
}

impl Kernel for Value<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) -> f64 {
        let mut sum = LogSum::<Quad<S>>::new(unit);
        let share = Quad::splat(unit, self.background);
        for s in self.shapes {
            let mut total = share * Quad::of(unit, s.background);
            for p in self.placed {
                total += density::<Four, S>(unit, s, p);
            }
            sum.add(total, Quad::of(unit, s.filled));
        }
        sum.sum()
    }
}

/// The likeliest origin of each line: a marker's number, or -1 for the background.
pub(crate) fn likeliest_origins(
    shapes: &[Shapes<Eight>],
    placed: &[Placed],
    background: f64,
    found: &mut Vec<Eight>,
) {
    found.clear();
    dispatch(Origins { shapes, placed, background, found });
}

struct Origins<'a> {
    shapes: &'a [Shapes<Eight>],
    placed: &'a [Placed],
    background: f64,
    found: &'a mut Vec<Eight>,
}

impl Kernel for Origins<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Unit>(self, unit: S) {
        let all = |number: f64| Octet::splat(unit, number);
        for s in self.shapes {
            let mut most = all(self.background) * Octet::of(unit, s.background);
            let mut origin = all(-1.0);
            for (marker, p) in self.placed.iter().enumerate() {
                let of_marker = density::<Eight, S>(unit, s, p);
                origin = most.less_select(of_marker, all(marker as f64), origin);
                most = of_marker.max(most);
            }
            self.found.push(origin.numbers());
        }
    }
}

/// What one marker adds to the density of a pack's lines.
#[inline(always)]
fn density<T: Numbers, S: Unit>(unit: S, s: &Shapes<T>, p: &Placed) -> T::In<S> {
    let weight = T::In::splat(unit, p.weight);
    let Densities { of_component, .. } = densities::<T, S>(unit, s, &splat3(unit, &p.at_m), weight);
    of_component[0] + of_component[1] + of_component[2]
}

#[cfg(test)]
mod tests;
