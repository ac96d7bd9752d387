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

use super::lanes::{Four, LogSum, Three, cross, dot, exp_of, splat3, three};
use super::noise::COMPONENTS;
use super::window::{Shapes, Window};
use lumenav_core::pose::skew;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};
use pulp::{Arch, Simd, WithSimd};
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
pub(crate) struct MarkerSums {
    /// Responsibilities.
    pub(crate) lines: Four,
    /// Force, 1/m.
    pub(crate) force: Three,
    /// `Σ E^T [...] E`: xx, xy, xz, yy, yz, zz, 1/m².
    pub(crate) curvature: [Four; 6],
}

/// What a pass sums over all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    pub(crate) log_likelihood: LogSum,
    pub(crate) background: Four,
    /// Upper triangle of `Σ g g^T`, rows first, force before torque about the capsule's origin, world.
    pub(crate) outer: [Four; 21],
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

/// One pass over a window.
pub(crate) fn pass<P: Purpose>(
    shapes: &[Shapes],
    placed: &[Placed],
    background: f64,
    of_marker: &mut [MarkerSums],
) -> Sums {
    /// A loop for a fixed number of markers; empty places have no weight.
    fn fixed<P: Purpose, const J: usize>(
        shapes: &[Shapes],
        placed: &[Placed],
        background: f64,
        of_marker: &mut [MarkerSums],
    ) -> Sums {
        let mut all = [Placed::default(); J];
        let used = placed.len().min(J);
        all[..used].copy_from_slice(&placed[..used]);
        let loops = Loop::<P, J> { shapes, placed: &all, background, purpose: PhantomData };
        let (sums, marker_sums) = Arch::new().dispatch(loops);
        of_marker[..used].copy_from_slice(&marker_sums[..used]);
        sums
    }
    match placed.len() {
        0..=1 => fixed::<P, 1>(shapes, placed, background, of_marker),
        2 => fixed::<P, 2>(shapes, placed, background, of_marker),
        3 => fixed::<P, 3>(shapes, placed, background, of_marker),
        4 => fixed::<P, 4>(shapes, placed, background, of_marker),
        5..=6 => fixed::<P, 6>(shapes, placed, background, of_marker),
        7..=12 => fixed::<P, 12>(shapes, placed, background, of_marker),
        _ => fixed::<P, MAX_MARKERS>(shapes, placed, background, of_marker),
    }
}

/// The loop over a window's packs.
struct Loop<'a, P, const J: usize> {
    shapes: &'a [Shapes],
    placed: &'a [Placed; J],
    background: f64,
    purpose: PhantomData<P>,
}

impl<P: Purpose, const J: usize> WithSimd for Loop<'_, P, J> {
    type Output = (Sums, [MarkerSums; J]);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let mut of_marker = [MarkerSums::default(); J];
        let mut sums =
            Sums { log_likelihood: LogSum::default(), background: Four::ZERO, outer: [Four::ZERO; 21] };
        let at: [Three; J] = std::array::from_fn(|j| splat3(&self.placed[j].at_m));
        let arms: [Three; J] = std::array::from_fn(|j| splat3(&self.placed[j].arm_m));
        let weights: [Four; J] = std::array::from_fn(|j| Four::splat(self.placed[j].weight));
        let share = Four::splat(self.background);
        for s in self.shapes {
            one_pack::<P, J>(s, &at, &arms, &weights, share, &mut of_marker, &mut sums);
        }
        (sums, of_marker)
    }
}

#[inline(always)]
fn one_pack<P: Purpose, const J: usize>(
    s: &Shapes,
    at: &[Three; J],
    arms: &[Three; J],
    weights: &[Four; J],
    share: Four,
    of_marker: &mut [MarkerSums; J],
    sums: &mut Sums,
) {
    let half = Four::splat(-0.5);
    let mut u = [[Four::ZERO; 2]; J];
    let mut e = [[Four::ZERO; COMPONENTS]; J];
    let from_background = share * s.background;
    let mut total = from_background;
    for j in 0..J {
        let x = s.at[0] - dot(&s.e1, &at[j]);
        let y = s.at[1] - dot(&s.e2, &at[j]);
        u[j] = [x, y];
        let (xx, xy, yy) = (half * x * x, -(x * y), half * y * y);
        let q = exp_of(three!(k => quadratic(&s.precision[k], xx, xy, yy)));
        e[j] = three!(k => weights[j] * s.peak[k] * q[k]);
    }
    for of_marker in &e {
        total = total + of_marker[0] + of_marker[1] + of_marker[2];
    }
    sums.log_likelihood.add(total, s.filled);
    let inverse = s.filled / total;
    sums.background = from_background.mul_add(inverse, sums.background);
    let mut score = [Four::ZERO; 6];
    for j in 0..J {
        let [x, y] = u[j];
        let mut w = [Four::ZERO; 3];
        let (mut tx, mut ty, mut lines) = (Four::ZERO, Four::ZERO, Four::ZERO);
        for k in 0..COMPONENTS {
            let p = &s.precision[k];
            let rho = e[j][k] * inverse;
            let (px, py) = (p[0].mul_add(x, p[1] * y), p[1].mul_add(x, p[2] * y));
            let (rx, ry) = (rho * px, rho * py);
            lines += rho;
            tx += rx;
            ty += ry;
            if P::OBSERVED {
                w[0] = rho.mul_add(p[0], (-rx).mul_add(px, w[0]));
                w[1] = rho.mul_add(p[1], (-rx).mul_add(py, w[1]));
                w[2] = rho.mul_add(p[2], (-ry).mul_add(py, w[2]));
            } else {
                for i in 0..3 {
                    w[i] = rho.mul_add(p[i], w[i]);
                }
            }
        }
        let m = &mut of_marker[j];
        m.lines += lines;
        let force: Three = three!(i => s.e1[i].mul_add(tx, s.e2[i] * ty));
        for i in 0..3 {
            m.force[i] += force[i];
        }
        // E^T W E, W symmetric.
        let a: Three = three!(i => s.e1[i].mul_add(w[0], s.e2[i] * w[1]));
        let b: Three = three!(i => s.e1[i].mul_add(w[1], s.e2[i] * w[2]));
        let mut n = 0;
        for i in 0..3 {
            for l in i..3 {
                m.curvature[n] = a[i].mul_add(s.e1[l], b[i].mul_add(s.e2[l], m.curvature[n]));
                n += 1;
            }
        }
        if P::OBSERVED {
            let torque = cross(&arms[j], &force);
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

/// `P · (xx, xy, yy)`.
#[inline(always)]
fn quadratic(precision: &Three, xx: Four, xy: Four, yy: Four) -> Four {
    dot(precision, &[xx, xy, yy])
}

/// A symmetric 3 x 3 matrix from its upper triangle.
pub(crate) fn symmetric(upper: &[Four; 6]) -> Matrix3<f64> {
    let [xx, xy, xz, yy, yz, zz] = upper.map(Four::sum);
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
        let mut placed = [Placed::default(); MAX_MARKERS];
        let used = self.place(pose, &window.origin_world_m, weights, &mut placed);
        let mut of_marker = [MarkerSums::default(); MAX_MARKERS];
        let sums = pass::<OfPose>(&window.shapes, &placed[..used], weights.background, &mut of_marker);
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        let (mut pp, mut pr, mut rr) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        out.lines_of_marker.clear();
        for (m, p) in of_marker[..used].iter().zip(&placed) {
            out.lines_of_marker.push(m.lines.sum());
            let f = Vector3::from(m.force.map(Four::sum));
            let (c, k, a) = (symmetric(&m.curvature), skew(&p.arm_m), p.arm_m);
            force += f;
            torque += a.cross(&f);
            // M = p + Exp(φ) a: dM/dφ = -[a]x, f·d²M/dφ² = ½(f aᵀ + a fᵀ) - (a·f) 1.
            pp += c;
            pr -= c * k;
            rr -= k * c * k;
            rr -= (f * a.transpose() + a * f.transpose()) * 0.5 - Matrix3::identity() * a.dot(&f);
        }
        let mut information = Matrix6::zeros();
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&pp);
        information.fixed_view_mut::<3, 3>(0, 3).copy_from(&pr);
        information.fixed_view_mut::<3, 3>(3, 0).copy_from(&pr.transpose());
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(&rr);
        let mut n = 0;
        for i in 0..6 {
            for l in i..6 {
                let value = sums.outer[n].sum();
                information[(i, l)] += value;
                if l != i {
                    information[(l, i)] += value;
                }
                n += 1;
            }
        }
        // φ in world axes is R θ.
        let r = pose.rotation.to_rotation_matrix().into_inner();
        out.log_likelihood = sums.log_likelihood.sum();
        out.background_lines = sums.background.sum();
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
    Arch::new().dispatch(Value { shapes, placed, background })
}

struct Value<'a> {
    shapes: &'a [Shapes],
    placed: &'a [Placed],
    background: f64,
}

impl WithSimd for Value<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let mut sum = LogSum::default();
        for s in self.shapes {
            let mut total = Four::splat(self.background) * s.background;
            for p in self.placed {
                total += density(s, p);
            }
            sum.add(total, s.filled);
        }
        sum.sum()
    }
}

/// The likeliest origin of each line: a marker's number, or -1 for the background.
pub(crate) fn likeliest_origins(
    shapes: &[Shapes],
    placed: &[Placed],
    background: f64,
    found: &mut Vec<Four>,
) {
    found.clear();
    Arch::new().dispatch(Origins { shapes, placed, background, found });
}

struct Origins<'a> {
    shapes: &'a [Shapes],
    placed: &'a [Placed],
    background: f64,
    found: &'a mut Vec<Four>,
}

impl WithSimd for Origins<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for s in self.shapes {
            let mut most = Four::splat(self.background) * s.background;
            let mut origin = Four::splat(-1.0);
            for (marker, p) in self.placed.iter().enumerate() {
                let of_marker = density(s, p);
                origin = most.less_select(of_marker, Four::splat(marker as f64), origin);
                most = of_marker.max(most);
            }
            self.found.push(origin);
        }
    }
}

/// What one marker adds to the density of four lines.
#[inline(always)]
fn density(s: &Shapes, p: &Placed) -> Four {
    let at = splat3(&p.at_m);
    let x = s.at[0] - dot(&s.e1, &at);
    let y = s.at[1] - dot(&s.e2, &at);
    let half = Four::splat(-0.5);
    let (xx, xy, yy) = (half * x * x, -(x * y), half * y * y);
    let q = exp_of(three!(k => quadratic(&s.precision[k], xx, xy, yy)));
    dot(&s.peak, &q) * Four::splat(p.weight)
}
