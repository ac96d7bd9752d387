//! One arithmetic for one point and for many: the trait [`Real`], carried by `f64` and by a SIMD register.
//!
//! Every formula of the hot loop is written once over [`Real`]. Only operations that IEEE 754 rounds exactly
//! are offered (add, subtract, multiply, divide, square root) plus comparison and selection, never a fused
//! multiply-add: each point's result has the same bytes on every processor, in every lane, alone or in a
//! batch.

use std::ops::{Add, Div, Mul, Sub};

use pulp::Simd;

/// A real number, or several of them side by side.
pub(crate) trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The answer of a comparison, lane by lane.
    type Mask: Copy;

    /// `value` in every lane (`self` only tells the width).
    fn constant(self, value: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Whether `self < other`; false where either is not a number.
    fn less_than(self, other: Self) -> Self::Mask;
    /// `self` where the mask holds, `otherwise` elsewhere.
    fn where_or(self, mask: Self::Mask, otherwise: Self) -> Self;
    /// Whether the mask holds in at least one lane.
    fn any(self, mask: Self::Mask) -> bool;

    /// The larger of two; `self` where the comparison is undefined.
    #[inline(always)]
    fn at_least(self, floor: Self) -> Self {
        floor.where_or(self.less_than(floor), self)
    }
}

impl Real for f64 {
    type Mask = bool;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn less_than(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn where_or(self, mask: bool, otherwise: Self) -> Self {
        if mask { self } else { otherwise }
    }
    #[inline(always)]
    fn any(self, mask: bool) -> bool {
        mask
    }
}

/// A SIMD register of `f64` together with the proof that the processor has it.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    simd: S,
    pub(crate) values: S::f64s,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, values: S::f64s) -> Self {
        Self { simd, values }
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $simd_method:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { simd: self.simd, values: self.simd.$simd_method(self.values, other.values) }
            }
        }
    };
}
operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd> Real for Lanes<S> {
    type Mask = S::m64s;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self { simd: self.simd, values: self.simd.splat_f64s(value) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self { simd: self.simd, values: self.simd.sqrt_f64s(self.values) }
    }
    #[inline(always)]
    fn less_than(self, other: Self) -> S::m64s {
        self.simd.less_than_f64s(self.values, other.values)
    }
    #[inline(always)]
    fn where_or(self, mask: S::m64s, otherwise: Self) -> Self {
        Self { simd: self.simd, values: self.simd.select_f64s(mask, self.values, otherwise.values) }
    }
    #[inline(always)]
    fn any(self, mask: S::m64s) -> bool {
        self.simd.first_true_m64s(mask) < S::F64_LANES
    }
}
