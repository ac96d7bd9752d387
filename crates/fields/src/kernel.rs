//! The hot loop of the finite cylinder: field and gradient of one face pair, over [`Real`].
//!
//! derby2010 writes the field with four calls of `cel`. Here the two integrals of one face share one
//! arithmetic-geometric mean, and the iteration is rearranged so that nothing cancels that need not:
//!
//! ```text
//! lengths in units of S = a + rho,  zeta = (z +- b)/S,  g = (a - rho)/S
//! s = sqrt(1 + zeta^2),  g0 = sqrt(g^2 + zeta^2);   M = agm(s, g0),  c_1 = (s - g0)/2, c_(n+1) = (m_n - g_n)/2
//! alpha C(k, 1, 1, -1) = -(pi/2) Sigma / (4 rho M),  Sigma = sum over n >= 1 of 2^n c_n^2,  c_1 = a rho / m_1
//! beta  C(k, g^2, 1, g) = (pi/2) zeta (B + A m) / (m (m Q + P))      (Bulirsch, with p = P/Q and no division)
//! ```
//!
//! The derivative along z of a cylinder's field is the field of two current loops (its edges), with K and E
//! from the same M and Sigma; with `u = a^2 + rho^2 + z^2`:
//!
//! ```text
//! dB_z/dz          = Br/(4 M) [2 a^2 (z^2 + a^2 - rho^2) + Sigma (z^2 + rho^2 - a^2)/2] / (s g0)^2
//! (dB_rho/dz)/rho  = Br/(4 M) z [4 a^2 - u Sigma/(2 rho^2)] / (s g0)^2
//! ```
//!
//! (each: upper face minus lower face). The other elements follow from div B = 0 and curl B = 0.
//!
//! Steps: four means always; more for the points where the means still differ by 4e-8 of themselves (near an
//! edge), whose neighbours in the register are then left untouched. Beyond [`FAR_RATIO`] times the corner
//! distance the multipole series takes over, where differences of the two faces would start to cancel.
//!
//! Source: derby2010; Bulirsch 1969; Abramowitz and Stegun 17.6 for K and E from the mean.

use crate::lanes::Real;
use crate::multipole::{TERMS, far_field};

/// Beyond this multiple of `sqrt(radius^2 + half_length^2)` the multipole series is used. With
/// [`TERMS`] = 9 (degrees 1 to 17) the first neglected term is below 1e-15 there; nearer, the closed form
/// still has all its digits.
pub(crate) const FAR_RATIO: f64 = 8.0;

/// Difference of the two means, relative, below which one more mean is exact to double precision (its square).
const CONVERGED: f64 = 4.0e-8;

/// Most steps beyond the fourth: from the smallest g0 (1e-14) the mean needs ten in all.
const MOST_FURTHER_STEPS: usize = 8;

/// Floor of `g0` in units of a + rho: on the edge itself the field is that at this distance from it.
const EDGE_FLOOR: f64 = 1.0e-14;

/// What the kernel needs to know of a cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Constants {
    pub(crate) radius_m: f64,
    pub(crate) half_length_m: f64,
    pub(crate) remanence_tesla: f64,
    /// Multipole coefficients `C_l / R0^l` of l = 1, 3, ..., with R0 the corner distance; T m^2.
    pub(crate) multipoles: [f64; TERMS],
    pub(crate) corner_distance_m: f64,
}

/// Field of an axisymmetric source and its derivatives along z. Everything else is algebra
/// ([`crate::cylinder`]).
#[derive(Clone, Copy)]
pub(crate) struct Axisymmetric<R> {
    /// B_rho / rho, T/m; finite on the axis.
    pub(crate) radial_over_rho: R,
    /// B_z, T.
    pub(crate) axial: R,
    /// dB_z/dz, T/m (not meaningful without gradient).
    pub(crate) axial_dz: R,
    /// (dB_rho/dz)/rho, T/m^2 (not meaningful without gradient).
    pub(crate) radial_dz_over_rho: R,
}

impl<R: Real> Axisymmetric<R> {
    #[inline(always)]
    fn where_or(self, mask: R::Mask, other: Self) -> Self {
        Self {
            radial_over_rho: self.radial_over_rho.where_or(mask, other.radial_over_rho),
            axial: self.axial.where_or(mask, other.axial),
            axial_dz: self.axial_dz.where_or(mask, other.axial_dz),
            radial_dz_over_rho: self.radial_dz_over_rho.where_or(mask, other.radial_dz_over_rho),
        }
    }
}

/// Field at distance `sqrt(rho2)` from the axis and height `z` above the middle plane.
#[inline(always)]
pub(crate) fn field<R: Real, const GRADIENT: bool>(constants: &Constants, rho2: R, z: R) -> Axisymmetric<R> {
    let r2 = rho2 + z * z;
    let switch_m = FAR_RATIO * constants.corner_distance_m;
    let switch2 = z.constant(switch_m * switch_m);
    let far = switch2.less_than(r2);
    if !z.any(far) {
        return near_field::<R, GRADIENT>(constants, rho2, z);
    }
    let outside = far_field::<R, GRADIENT>(constants, r2, z);
    // `r2.less_than(..)` twice instead of a negation: a point that is not a number goes the near way.
    let near = r2.less_than(switch2);
    if !z.any(near) {
        return outside;
    }
    outside.where_or(far, near_field::<R, GRADIENT>(constants, rho2, z))
}

/// What both faces share.
#[derive(Clone, Copy)]
struct Shared<R> {
    one: R,
    /// g = (a - rho)/(a + rho), its absolute value, its square.
    g: R,
    g_abs: R,
    g2: R,
    /// sign(g) (1 + g): the first A of the iteration.
    first_a: R,
}

/// State of one face's iteration.
#[derive(Clone, Copy)]
struct Face<R> {
    s2: R,
    g02: R,
    /// First mean m_1, the current mean, and the product of the previous two (whose root is the next g).
    m_first: R,
    m: R,
    product: R,
    /// Bulirsch's a and b over a common denominator, and p = P/Q.
    a: R,
    b: R,
    p: R,
    q: R,
    /// Sum over n >= 2 of 2^n c_n^2.
    sum: R,
}

impl<R: Real> Face<R> {
    /// The face at height `zeta` below the point, after its first step.
    #[inline(always)]
    fn start(shared: &Shared<R>, zeta: R) -> Self {
        let zeta2 = zeta * zeta;
        let s2 = shared.one + zeta2;
        let g02 = (shared.g2 + zeta2).at_least(zeta.constant(EDGE_FLOOR * EDGE_FLOOR));
        let s = s2.sqrt();
        let g0 = g02.sqrt();
        let m = (s + g0) * zeta.constant(0.5);
        Self {
            s2,
            g02,
            m_first: m,
            m,
            product: s * g0,
            a: shared.first_a,
            b: shared.g * s + g0,
            p: shared.g2 * s + g0,
            q: shared.g_abs + shared.g_abs,
            sum: zeta.constant(0.0),
        }
    }

    /// One more mean; `weight` is 2^(n-2) for c_n of this step. Returns the state and the difference and mean
    /// that judge convergence.
    #[inline(always)]
    fn step(self, weight: f64) -> (Self, R) {
        let g = self.product.sqrt();
        let difference = self.m - g;
        let product = self.m * g;
        let product_q = product * self.q;
        let pq = self.p * self.q;
        let next = Self {
            m: (self.m + g) * g.constant(0.5),
            product,
            a: self.a * self.p + self.b * self.q,
            b: self.b * self.p + self.a * product_q,
            p: self.p * self.p + product_q * self.q,
            q: pq + pq,
            sum: self.sum + difference * difference * g.constant(weight),
            ..self
        };
        (next, difference)
    }

    /// The same integrals with numbers of moderate size (A, B, P and Q may be scaled together).
    #[inline(always)]
    fn rescaled(self) -> Self {
        let scale = self.m.constant(1.0) / self.p;
        Self { a: self.a * scale, b: self.b * scale, p: self.p * scale, q: self.q * scale, ..self }
    }

    #[inline(always)]
    fn where_or(self, mask: R::Mask, other: Self) -> Self {
        Self {
            m: self.m.where_or(mask, other.m),
            product: self.product.where_or(mask, other.product),
            a: self.a.where_or(mask, other.a),
            b: self.b.where_or(mask, other.b),
            p: self.p.where_or(mask, other.p),
            q: self.q.where_or(mask, other.q),
            sum: self.sum.where_or(mask, other.sum),
            ..other
        }
    }

    /// Four means, more for the lanes that need them.
    #[inline(always)]
    fn iterate(self) -> Self {
        let (face, _) = self.step(1.0);
        let (face, _) = face.step(2.0);
        let (last, difference) = face.step(4.0);
        let threshold = difference.constant(CONVERGED);
        let unfinished = (threshold * last.m).less_than(difference);
        if difference.any(unfinished) { last.iterate_further(unfinished) } else { last }
    }

    #[inline(always)]
    fn iterate_further(self, mut unfinished: R::Mask) -> Self {
        let mut face = self;
        let mut weight = 4.0;
        let threshold = face.m.constant(CONVERGED);
        for _ in 0..MOST_FURTHER_STEPS {
            weight *= 2.0;
            let (next, difference) = face.rescaled().step(weight);
            face = next.where_or(unfinished, face);
            // A finished lane's means agree, so its own test keeps it finished.
            unfinished = (threshold * next.m).less_than(difference);
            if !difference.any(unfinished) {
                break;
            }
        }
        face
    }
}

/// Integrals of one face.
struct Integrals<R> {
    /// 1/M
    inverse_mean: R,
    /// Sigma / rho^2, with rho in units of S.
    sum_over_rho2: R,
    /// (B + A m) / (m (m Q + P))
    axial: R,
}

/// `a2` and `rho2` in units of S^2; `inverse_rho2` finite on the axis as well.
#[inline(always)]
fn integrals<R: Real>(face: &Face<R>, a2: R, rho2: R, inverse_rho2: R) -> Integrals<R> {
    let bulirsch = face.m * face.q + face.p;
    let m_first2 = face.m_first * face.m_first;
    let product = face.m * bulirsch;
    let reciprocal = face.m.constant(1.0) / (product * m_first2);
    let with_first = reciprocal * m_first2;
    let leading = (a2 + a2) * (reciprocal * product);
    // Near the axis the further terms, differences of means, are rounding only: of relative size
    // eps^2 m^4/(2 a^2 rho^2), while without them a^2 rho^2/(8 m^4) is missing. Both are eps/4 at the limit.
    let noise = face.m.constant(2.0 * f64::EPSILON) * m_first2 * m_first2;
    let significant = noise.less_than(a2 * rho2);
    let further = (face.sum * inverse_rho2).where_or(significant, face.m.constant(0.0));
    Integrals {
        inverse_mean: with_first * bulirsch,
        sum_over_rho2: leading + further,
        axial: (face.b + face.a * face.m) * with_first,
    }
}

/// Both derivatives along z of one face, without the factor Br/4 and in units of S.
#[inline(always)]
fn edge_loop<R: Real>(face: &Face<R>, integrals: &Integrals<R>, zeta: R, a2: R, rho2: R) -> (R, R) {
    let half = zeta.constant(0.5);
    let zeta2 = zeta * zeta;
    let scale = integrals.inverse_mean / (face.s2 * face.g02);
    let sum = integrals.sum_over_rho2 * rho2;
    let difference = a2 - rho2;
    let axial = (a2 + a2) * (zeta2 + difference) + half * sum * (zeta2 - difference);
    let u = a2 + rho2 + zeta2;
    let radial = zeta * (zeta.constant(4.0) * a2 - half * u * integrals.sum_over_rho2);
    (axial * scale, radial * scale)
}

#[inline(always)]
fn near_field<R: Real, const GRADIENT: bool>(constants: &Constants, rho2: R, z: R) -> Axisymmetric<R> {
    let one = z.constant(1.0);
    let zero = z.constant(0.0);
    let radius = z.constant(constants.radius_m);
    let rho = rho2.sqrt();
    let total = radius + rho;
    // Any small floor does: what is multiplied by 1/rho^2 counts as zero long before (see `integrals`).
    let rho2_floored = rho2.at_least(z.constant(1.0e-20 * constants.radius_m * constants.radius_m));
    let reciprocal = one / (total * rho2_floored);
    let inverse_total = reciprocal * rho2_floored;
    let inverse_rho2 = reciprocal * total * total * total;

    let g = (radius - rho) * inverse_total;
    let inside = zero.less_than(g);
    let outside = g.less_than(zero);
    let g_abs = g.where_or(inside, zero - g);
    let one_plus_g = one + g;
    // On the mantle itself (g = 0) neither holds: the mean of the two limits.
    let first_a = one_plus_g.where_or(inside, (zero - one_plus_g).where_or(outside, zero));
    let shared = Shared { one, g, g_abs, g2: g * g, first_a };

    let half_length = z.constant(constants.half_length_m);
    let upper_zeta = (z + half_length) * inverse_total;
    let lower_zeta = (z - half_length) * inverse_total;
    let upper = Face::start(&shared, upper_zeta).iterate();
    let lower = Face::start(&shared, lower_zeta).iterate();

    let a = radius * inverse_total;
    let a2 = a * a;
    let rho_scaled = rho * inverse_total;
    let rho2_scaled = rho_scaled * rho_scaled;
    let plus = integrals(&upper, a2, rho2_scaled, inverse_rho2);
    let minus = integrals(&lower, a2, rho2_scaled, inverse_rho2);

    let radial = minus.inverse_mean * minus.sum_over_rho2 - plus.inverse_mean * plus.sum_over_rho2;
    let axial = upper_zeta * plus.axial - lower_zeta * minus.axial;
    let remanence = z.constant(constants.remanence_tesla);
    let mut field = Axisymmetric {
        radial_over_rho: remanence * z.constant(0.125) * inverse_total * radial,
        axial: remanence * z.constant(0.5) * a * axial,
        axial_dz: zero,
        radial_dz_over_rho: zero,
    };
    if GRADIENT {
        let (upper_axial, upper_radial) = edge_loop(&upper, &plus, upper_zeta, a2, rho2_scaled);
        let (lower_axial, lower_radial) = edge_loop(&lower, &minus, lower_zeta, a2, rho2_scaled);
        let scale = remanence * z.constant(0.25) * inverse_total;
        field.axial_dz = scale * (upper_axial - lower_axial);
        field.radial_dz_over_rho = scale * inverse_total * (upper_radial - lower_radial);
    }
    field
}
