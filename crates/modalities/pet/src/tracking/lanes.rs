//! Four numbers side by side, with exponential and logarithm: the arithmetic of the trackers' loops.
//!
//! Loops run over packs of four lines inside `pulp::Arch::dispatch`, which compiles them for the processor's vector unit. Only
//! operations that IEEE 754 rounds exactly are used (fused multiply-add among them, written out: the compiler makes none of its own),
//! and sums are always kept in four partial sums added in one order: the same bytes on every processor.
//!
//! A loop is a struct that implements `pulp::WithSimd`, not a closure: the call of a closure is a function of its own, compiled for
//! the oldest processor.
//!
//! [`Four::exp`]: argument clamped to ±700, reduced to |r| <= ln 2 / 2, Taylor polynomial of degree 11: relative error below 1e-14.
//! [`Four::inverse_cube_root`]: positive normal numbers, relative error below 1e-15; [`Four::inverse_fifth_root`]: below 1.2e-15.
//! [`Four::ln`]: positive normal numbers; `2 artanh s` with |s| <= 0.1716, ten terms: absolute error below 1e-15 (1 + |ln x|).

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// The expression for each lane, written out four times: `array::from_fn` is not always inlined, and then not compiled for the vector
/// unit.
macro_rules! lanes {
    ($i:ident => $of:expr) => {
        [
            {
                let $i = 0;
                $of
            },
            {
                let $i = 1;
                $of
            },
            {
                let $i = 2;
                $of
            },
            {
                let $i = 3;
                $of
            },
        ]
    };
}

pub(crate) use lanes;

/// The expression for each axis, written out three times.
macro_rules! three {
    ($i:ident => $of:expr) => {
        [
            {
                let $i = 0;
                $of
            },
            {
                let $i = 1;
                $of
            },
            {
                let $i = 2;
                $of
            },
        ]
    };
}
pub(crate) use three;

/// Lines per pack.
pub(crate) const LANES: usize = 4;

/// Four numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub(crate) struct Four(pub(crate) [f64; LANES]);

/// First guess of an inverse cube root: high word of its bits, plus a third of the number's own.
const CUBE_ROOT_BITS: f64 = 0x553e_f0ff_u32 as f64;
/// As [`CUBE_ROOT_BITS`], of an inverse fifth root, plus a fifth of the number's own.
const FIFTH_ROOT_BITS: f64 = 0x4cb8_a769_u32 as f64;
/// `ln 2` in two parts: the first has 32 trailing zero bits, so that its product with an exponent is exact.
const LN2_HIGH: f64 = 6.93147180369123816490e-01;
const LN2_LOW: f64 = 1.90821492927058770002e-10;
/// Added to a small number, it leaves the nearest integer in the low bits: 1.5 · 2^52.
const ROUNDING: f64 = 6755399441055744.0;
/// 2^52: an integer below it, put into the mantissa, is that number beyond 2^52.
const INTEGER_BITS: u64 = 0x4330_0000_0000_0000;
const TWO_52: f64 = 4503599627370496.0;
const MANTISSA: u64 = 0x000f_ffff_ffff_ffff;
const ONE_BITS: u64 = 0x3ff0_0000_0000_0000;
/// Arguments of an exponential are cut to this: beyond it, it is no normal number.
const LARGEST: f64 = 700.0;
/// `1/n!` for n = 11 … 0.
const EXP_TERMS: [f64; 12] = [
    1.0 / 39916800.0,
    1.0 / 3628800.0,
    1.0 / 362880.0,
    1.0 / 40320.0,
    1.0 / 5040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];
/// `2/(2n + 1)` for n = 9 … 0.
const LN_TERMS: [f64; 10] = [
    2.0 / 19.0,
    2.0 / 17.0,
    2.0 / 15.0,
    2.0 / 13.0,
    2.0 / 11.0,
    2.0 / 9.0,
    2.0 / 7.0,
    2.0 / 5.0,
    2.0 / 3.0,
    2.0,
];

impl Four {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    #[inline(always)]
    pub(crate) fn splat(value: f64) -> Self {
        Self([value; LANES])
    }

    /// `self · factor + addend`, rounded once.
    #[inline(always)]
    pub(crate) fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(lanes!(i => self.0[i].mul_add(factor.0[i], addend.0[i])))
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self(lanes!(i => self.0[i].sqrt()))
    }

    /// The larger of two, lane by lane; `other` where `self` is not a number.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        Self(lanes!(i => if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }

    /// The smaller of two, lane by lane; `other` where `self` is not a number.
    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        Self(lanes!(i => if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }

    /// `yes` where `self < limit`, else `no`.
    #[inline(always)]
    pub(crate) fn less_select(self, limit: Self, yes: Self, no: Self) -> Self {
        Self(lanes!(i => if self.0[i] < limit.0[i] { yes.0[i] } else { no.0[i] }))
    }

    /// Sum of the lanes, always in one order.
    #[inline(always)]
    pub(crate) fn sum(self) -> f64 {
        (self.0[0] + self.0[1]) + (self.0[2] + self.0[3])
    }

    #[inline(always)]
    pub(crate) fn exp(self) -> Self {
        exp_of([self])[0]
    }

    /// `self^(-1/3)` of positive normal numbers.
    #[inline(always)]
    pub(crate) fn inverse_cube_root(self) -> Self {
        let third = Self::splat(1.0 / 3.0);
        let high = Self(lanes!(i => f64::from_bits((self.0[i].to_bits() >> 32) | INTEGER_BITS)));
        let high = high - Self::splat(TWO_52);
        let bits = high.mul_add(-third, Self::splat(CUBE_ROOT_BITS + TWO_52));
        let mut root = Self(lanes!(i => f64::from_bits(bits.0[i].to_bits() << 32)));
        // y (1 + r/3 + 2r²/9), r = 1 - x y³: three steps of third order from 3 per cent.
        for _ in 0..3 {
            let rest = (self * root).mul_add(-(root * root), Self::splat(1.0));
            let factor = rest.mul_add(Self::splat(2.0 / 9.0), third);
            root = (root * rest).mul_add(factor, root);
        }
        root
    }

    /// `self^(-1/5)` of positive normal numbers.
    #[inline(always)]
    pub(crate) fn inverse_fifth_root(self) -> Self {
        let high = Self(lanes!(i => f64::from_bits((self.0[i].to_bits() >> 32) | INTEGER_BITS)));
        let high = high - Self::splat(TWO_52);
        let bits = high.mul_add(Self::splat(-0.2), Self::splat(FIFTH_ROOT_BITS + TWO_52));
        let mut root = Self(lanes!(i => f64::from_bits(bits.0[i].to_bits() << 32)));
        // y (1 + r/5 + 3r²/25 + 11r³/125 + 44r⁴/625), r = 1 - x y⁵: two steps of fifth order from 3 per cent.
        for _ in 0..2 {
            let square = root * root;
            let rest = (self * root).mul_add(-(square * square), Self::splat(1.0));
            let factor = rest.mul_add(Self::splat(44.0 / 625.0), Self::splat(11.0 / 125.0));
            let factor = rest.mul_add(factor, Self::splat(3.0 / 25.0));
            let factor = rest.mul_add(factor, Self::splat(0.2));
            root = (root * rest).mul_add(factor, root);
        }
        root
    }

    #[inline(always)]
    pub(crate) fn ln(self) -> Self {
        let exponent = Self(lanes!(i => f64::from_bits((self.0[i].to_bits() >> 52) | INTEGER_BITS)));
        let exponent = exponent - Self::splat(TWO_52 + 1023.0);
        let m = Self(lanes!(i => f64::from_bits((self.0[i].to_bits() & MANTISSA) | ONE_BITS)));
        let root = Self::splat(std::f64::consts::SQRT_2);
        let e = m.less_select(root, exponent, exponent + Self::splat(1.0));
        let m = m.less_select(root, m, m * Self::splat(0.5));
        let s = (m - Self::splat(1.0)) / (m + Self::splat(1.0));
        let s2 = s * s;
        let mut series = Self::splat(LN_TERMS[0]);
        for term in &LN_TERMS[1..] {
            series = series.mul_add(s2, Self::splat(*term));
        }
        e.mul_add(Self::splat(LN2_HIGH), series.mul_add(s, e * Self::splat(LN2_LOW)))
    }
}

/// `Σ ln x` of many positive numbers: products are taken until a logarithm is due.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LogSum {
    logarithm: Four,
    product: Four,
    factors: u32,
}

impl Default for LogSum {
    fn default() -> Self {
        Self { logarithm: Four::ZERO, product: Four::splat(1.0), factors: 0 }
    }
}

impl LogSum {
    /// Factors between two logarithms: densities in 1/m² lie between 1 and 10¹², so their product is a normal number.
    const MOST: u32 = 16;

    /// Adds the logarithm where `filled` is 1, nothing where it is 0.
    #[inline(always)]
    pub(crate) fn add(&mut self, x: Four, filled: Four) {
        let one = Four::splat(1.0);
        self.product = self.product * x.mul_add(filled, one - filled);
        self.factors += 1;
        if self.factors == Self::MOST {
            self.logarithm += self.product.ln();
            self.product = one;
            self.factors = 0;
        }
    }

    pub(crate) fn sum(&self) -> f64 {
        (self.logarithm + self.product.ln()).sum()
    }
}

/// Exponentials side by side: a term of the series is loaded once for all, and none waits for another's sum.
#[inline(always)]
pub(crate) fn exp_of<const N: usize>(x: [Four; N]) -> [Four; N] {
    let mut x = x;
    for n in 0..N {
        x[n] = exp_one(x[n]);
    }
    x
}

#[inline(always)]
fn exp_one(x: Four) -> Four {
    let x = x.max(Four::splat(-LARGEST)).min(Four::splat(LARGEST));
    let shifted = x.mul_add(Four::splat(std::f64::consts::LOG2_E), Four::splat(ROUNDING));
    let whole = Four::splat(ROUNDING) - shifted;
    let rest = whole.mul_add(Four::splat(LN2_LOW), whole.mul_add(Four::splat(LN2_HIGH), x));
    let scale = Four(lanes!(i => f64::from_bits((shifted.0[i].to_bits() << 52).wrapping_add(ONE_BITS))));
    let mut value = Four::splat(EXP_TERMS[0]);
    for term in &EXP_TERMS[1..] {
        value = value.mul_add(rest, Four::splat(*term));
    }
    value * scale
}

impl Default for Four {
    fn default() -> Self {
        Self::ZERO
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Four {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(lanes!(i => self.0[i] $op other.0[i]))
            }
        }
    };
}
operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl Neg for Four {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(lanes!(i => -self.0[i]))
    }
}

impl AddAssign for Four {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Three components, each for four lines.
pub(crate) type Three = [Four; 3];

/// `a · b`, lane by lane.
#[inline(always)]
pub(crate) fn dot(a: &Three, b: &Three) -> Four {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// `a x b`, lane by lane.
#[inline(always)]
pub(crate) fn cross(a: &Three, b: &Three) -> Three {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// One vector in all lanes.
#[inline(always)]
pub(crate) fn splat3(v: &nalgebra::Vector3<f64>) -> Three {
    [Four::splat(v.x), Four::splat(v.y), Four::splat(v.z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cross_exp_ln_and_cube_root_agree_with_the_standard_library() {
        for i in -69_900..69_900 {
            let x = f64::from(i) * 0.01 + 0.003;
            let (here, there) = (Four::splat(x).exp().0[2], x.exp());
            assert!(((here - there) / there).abs() < 1e-14, "exp {x}");
            let positive = there.max(1e-300);
            let (here, there) = (Four::splat(positive).ln().0[1], positive.ln());
            assert!((here - there).abs() < 1e-15 * (1.0 + there.abs()), "ln {positive}");
            let (here, there) = (Four::splat(positive).inverse_cube_root().0[3], 1.0 / positive.cbrt());
            assert!(((here - there) / there).abs() < 1e-15, "inverse cube root {positive}");
            // The fifth power is off by five times the root's error, and rounded itself.
            let root = Four::splat(positive).inverse_fifth_root().0[1];
            assert!((positive * root.powi(5) - 1.0).abs() < 6e-15, "inverse fifth root {positive}");
        }
        assert!(Four::splat(-1e9).exp().0[0] < 1e-300);
        assert_eq!(Four::splat(1.0).ln().0[0], 0.0);
    }
}
