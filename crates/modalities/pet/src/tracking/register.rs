//! Vector registers: the arithmetic of the trackers' longest loops, on whatever unit the processor has.
//!
//! [`super::lanes`] leaves it to the compiler to find the vector unit's instructions, which tears long chains apart: of a pass half the
//! instructions moved lanes about. Here every operation is an instruction of the unit that [`dispatch`] found, or, where there is none,
//! plain ones. As there, only operations that IEEE 754 rounds exactly are used: the same bytes on every processor.
//!
//! A register holds four numbers of double precision ([`super::quad`]) or eight of single precision ([`super::octet`]); a loop that is
//! written for any [`Register`] runs on both. Single precision is for steps of an iteration: lines are told from an origin near the markers,
//! 30 mm from them to 2 nm, and a distance of 0.1 mm from a marker to 1 um. (A first window's origin is the middle of all lines' middles.)

use nalgebra::Vector3;
use pulp::{NullaryFnOnce, Scalar256b, Simd, cast, f32x8, f64x4, m32x8, m64x4, u32x8, u64x4};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A vector unit of 256 bits, or what stands for one.
pub(crate) trait Unit:
    Simd<f64s = f64x4, u64s = u64x4, m64s = m64x4, f32s = f32x8, u32s = u32x8, m32s = m32x8>
{
    fn shift_left_u64<const BITS: i32>(self, of: u64x4) -> u64x4;
    fn shift_right_u64<const BITS: i32>(self, of: u64x4) -> u64x4;
    fn shift_left_u32<const BITS: i32>(self, of: u32x8) -> u32x8;
    fn shift_right_u32<const BITS: i32>(self, of: u32x8) -> u32x8;
}

impl Unit for Scalar256b {
    #[inline(always)]
    fn shift_left_u64<const BITS: i32>(self, of: u64x4) -> u64x4 {
        u64x4(of.0 << BITS, of.1 << BITS, of.2 << BITS, of.3 << BITS)
    }

    #[inline(always)]
    fn shift_right_u64<const BITS: i32>(self, of: u64x4) -> u64x4 {
        u64x4(of.0 >> BITS, of.1 >> BITS, of.2 >> BITS, of.3 >> BITS)
    }

    #[inline(always)]
    fn shift_left_u32<const BITS: i32>(self, of: u32x8) -> u32x8 {
        cast(cast::<_, [u32; 8]>(of).map(|lane| lane << BITS))
    }

    #[inline(always)]
    fn shift_right_u32<const BITS: i32>(self, of: u32x8) -> u32x8 {
        cast(cast::<_, [u32; 8]>(of).map(|lane| lane >> BITS))
    }
}

#[cfg(target_arch = "x86_64")]
impl Unit for pulp::x86::V3 {
    #[inline(always)]
    fn shift_left_u64<const BITS: i32>(self, of: u64x4) -> u64x4 {
        self.shl_const_u64x4::<BITS>(of)
    }

    #[inline(always)]
    fn shift_right_u64<const BITS: i32>(self, of: u64x4) -> u64x4 {
        self.shr_const_u64x4::<BITS>(of)
    }

    #[inline(always)]
    fn shift_left_u32<const BITS: i32>(self, of: u32x8) -> u32x8 {
        self.shl_const_u32x8::<BITS>(of)
    }

    #[inline(always)]
    fn shift_right_u32<const BITS: i32>(self, of: u32x8) -> u32x8 {
        self.shr_const_u32x8::<BITS>(of)
    }
}

/// A loop that is compiled for every unit. A struct, not a closure: see [`super::lanes`].
pub(crate) trait Kernel {
    type Output;
    fn run<S: Unit>(self, unit: S) -> Self::Output;
}

/// Runs a loop on the best unit there is.
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    /// A kernel and its unit.
    struct On<S, K>(S, K);
    impl<S: Unit, K: Kernel> NullaryFnOnce for On<S, K> {
        type Output = K::Output;
        #[inline(always)]
        fn call(self) -> K::Output {
            self.1.run(self.0)
        }
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(unit) = pulp::x86::V3::try_new() {
        return unit.vectorize(On(unit, kernel));
    }
    On(Scalar256b, kernel).call()
}

/// Numbers as they are kept, a register's worth.
pub(crate) trait Numbers: Copy + Default {
    /// The register that holds them.
    type In<S: Unit>: Register<Unit = S, Numbers = Self>;

    /// Sum of the lanes, always in one order, in double precision.
    fn sum(self) -> f64;
}

/// A register of numbers.
pub(crate) trait Register:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    type Unit: Unit;
    type Numbers: Numbers;
    /// So many densities in 1/m², between 1 and 10⁷, have a normal number as their product.
    const FACTORS: u32;
    /// The smallest positive normal number.
    const LEAST: f64;

    fn of(unit: Self::Unit, numbers: Self::Numbers) -> Self;
    fn numbers(self) -> Self::Numbers;
    /// One number in all lanes.
    fn splat(unit: Self::Unit, number: f64) -> Self;
    /// Another number in all lanes, of the same unit.
    fn all(self, number: f64) -> Self;
    /// `self · factor + addend`, rounded once.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// `from - self · factor`, rounded once.
    fn mul_sub_from(self, factor: Self, from: Self) -> Self;
    fn sqrt(self) -> Self;
    fn max(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    /// `yes` where `self < limit`, else `no`.
    fn less_select(self, limit: Self, yes: Self, no: Self) -> Self;
    fn exp(self) -> Self;
    /// Of positive normal numbers.
    fn ln(self) -> Self;
    /// `self^(-1/3)` of positive normal numbers.
    fn inverse_cube_root(self) -> Self;
    /// `self^(-1/5)` of positive normal numbers.
    fn inverse_fifth_root(self) -> Self;

    /// A polynomial, terms from the highest power.
    #[inline(always)]
    fn polynomial<const N: usize>(self, terms: &[f64; N]) -> Self {
        let mut value = self.all(terms[0]);
        for term in &terms[1..] {
            value = value.mul_add(self, self.all(*term));
        }
        value
    }
}

/// A register's operations by the names of the unit's instructions, and `$functions`, which each precision has its own of.
macro_rules! register {
    (
        $register:ident of $numbers:ident, $number:ty:
        $splat:ident $neg:ident $add:ident $sub:ident $mul:ident $div:ident
        $mul_add:ident $negate_mul_add:ident $sqrt:ident $max:ident $min:ident $less:ident $select:ident;
        $($functions:tt)*
    ) => {
        impl<S: Unit> Register for $register<S> {
            type Unit = S;
            type Numbers = $numbers;
            const LEAST: f64 = <$number>::MIN_POSITIVE as f64;

            #[inline(always)]
            fn of(unit: S, numbers: $numbers) -> Self {
                Self { unit, value: cast(numbers.0) }
            }

            #[inline(always)]
            fn numbers(self) -> $numbers {
                $numbers(cast(self.value))
            }

            #[inline(always)]
            fn splat(unit: S, number: f64) -> Self {
                Self { unit, value: unit.$splat(number as $number) }
            }

            #[inline(always)]
            fn all(self, number: f64) -> Self {
                Self::splat(self.unit, number)
            }

            #[inline(always)]
            fn mul_add(self, factor: Self, addend: Self) -> Self {
                Self { value: self.unit.$mul_add(self.value, factor.value, addend.value), ..self }
            }

            #[inline(always)]
            fn mul_sub_from(self, factor: Self, from: Self) -> Self {
                Self { value: self.unit.$negate_mul_add(self.value, factor.value, from.value), ..self }
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                Self { value: self.unit.$sqrt(self.value), ..self }
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self { value: self.unit.$max(self.value, other.value), ..self }
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self { value: self.unit.$min(self.value, other.value), ..self }
            }

            #[inline(always)]
            fn less_select(self, limit: Self, yes: Self, no: Self) -> Self {
                let is_less = self.unit.$less(self.value, limit.value);
                Self { value: self.unit.$select(is_less, yes.value, no.value), ..self }
            }

            $($functions)*
        }

        impl Numbers for $numbers {
            type In<S: Unit> = $register<S>;

            #[inline(always)]
            fn sum(self) -> f64 {
                $numbers::sum(self)
            }
        }

        register!(@operator $register Add add $add);
        register!(@operator $register Sub sub $sub);
        register!(@operator $register Mul mul $mul);
        register!(@operator $register Div div $div);

        impl<S: Unit> Neg for $register<S> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self { value: self.unit.$neg(self.value), ..self }
            }
        }

        impl<S: Unit> AddAssign for $register<S> {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
    };
    (@operator $register:ident $trait:ident $method:ident $of_unit:ident) => {
        impl<S: Unit> $trait for $register<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { value: self.unit.$of_unit(self.value, other.value), ..self }
            }
        }
    };
}
pub(crate) use register;

/// `Σ ln x` of many positive numbers: products are taken until a logarithm is due.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LogSum<R> {
    /// In double precision: of two thousand lines it is told to 1e-4.
    logarithm: f64,
    product: R,
    factors: u32,
}

impl<R: Register> LogSum<R> {
    #[inline(always)]
    pub(crate) fn new(unit: R::Unit) -> Self {
        Self { logarithm: 0.0, product: R::splat(unit, 1.0), factors: 0 }
    }

    /// Adds the logarithm where `filled` is 1, nothing where it is 0.
    #[inline(always)]
    pub(crate) fn add(&mut self, x: R, filled: R) {
        let one = x.all(1.0);
        self.product = self.product * x.mul_add(filled, one - filled);
        self.factors += 1;
        if self.factors == R::FACTORS {
            self.logarithm += self.product.ln().numbers().sum();
            self.product = one;
            self.factors = 0;
        }
    }

    #[inline(always)]
    pub(crate) fn sum(&self) -> f64 {
        self.logarithm + self.product.ln().numbers().sum()
    }
}

/// Components as they are kept.
#[inline(always)]
pub(crate) fn load<S: Unit, T: Numbers, const N: usize>(unit: S, numbers: &[T; N]) -> [T::In<S>; N] {
    let mut all = [T::In::<S>::splat(unit, 0.0); N];
    for (to, from) in all.iter_mut().zip(numbers) {
        *to = T::In::<S>::of(unit, *from);
    }
    all
}

/// Sum of each register's lanes. (A loop: `array::map` is not always inlined.)
#[inline(always)]
pub(crate) fn sums<R: Register, const N: usize>(registers: &[R; N]) -> [f64; N] {
    let mut all = [0.0; N];
    for (to, from) in all.iter_mut().zip(registers) {
        *to = from.numbers().sum();
    }
    all
}

/// One vector in all lanes.
#[inline(always)]
pub(crate) fn splat3<R: Register>(unit: R::Unit, v: &Vector3<f64>) -> [R; 3] {
    [R::splat(unit, v.x), R::splat(unit, v.y), R::splat(unit, v.z)]
}

/// `a · b`, lane by lane.
#[inline(always)]
pub(crate) fn dot<R: Register>(a: &[R; 3], b: &[R; 3]) -> R {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// `a x b`, lane by lane.
#[inline(always)]
pub(crate) fn cross<R: Register>(a: &[R; 3], b: &[R; 3]) -> [R; 3] {
    let component = |i: usize, k: usize| a[k].mul_sub_from(b[i], a[i] * b[k]);
    [component(1, 2), component(2, 0), component(0, 1)]
}
