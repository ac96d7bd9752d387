//! Four numbers side by side: how the trackers' loops keep lines, and the arithmetic of all but the longest of them ([`super::register`]).
//!
//! Loops run over packs of four lines inside `pulp::Arch::dispatch` or [`super::register::dispatch`], which compiles them for the processor's vector unit. Only
//! operations that IEEE 754 rounds exactly are used (fused multiply-add among them, written out: the compiler makes none of its own),
//! and sums are always kept in four partial sums added in one order: the same bytes on every processor.
//!
//! A loop is a struct that implements `pulp::WithSimd`, not a closure: the call of a closure is a function of its own, compiled for
//! the oldest processor.

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

/// Eight numbers of single precision, two packs of four.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(crate) struct Eight(pub(crate) [f32; 2 * LANES]);

impl Eight {
    /// Two packs' numbers, rounded.
    #[inline(always)]
    pub(crate) fn of(first: Four, second: Four) -> Self {
        let [a, b, c, d] = lanes!(i => first.0[i] as f32);
        let [e, f, g, h] = lanes!(i => second.0[i] as f32);
        Self([a, b, c, d, e, f, g, h])
    }

    /// Sum of the lanes, always in one order, in double precision.
    #[inline(always)]
    pub(crate) fn sum(self) -> f64 {
        let at = |lane: usize| f64::from(self.0[lane]);
        ((at(0) + at(1)) + (at(2) + at(3))) + ((at(4) + at(5)) + (at(6) + at(7)))
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
