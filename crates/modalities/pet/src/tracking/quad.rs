//! Four numbers of double precision in a vector register ([`super::register`]), with exponential, logarithm and roots.
//!
//! [`Register::exp`]: argument clamped to ±700, reduced to |r| <= ln 2 / 2, Taylor polynomial of degree 11: relative error below 1e-14.
//! [`Register::inverse_cube_root`]: relative error below 1e-15; [`Register::inverse_fifth_root`]: below 1.2e-15.
//! [`Register::ln`]: `2 artanh s` with |s| <= 0.1716, ten terms: absolute error below 1e-15 (1 + |ln x|).

use super::lanes::Four;
use super::register::{Numbers, Register, Unit, register};
use pulp::{cast, f64x4, u64x4};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Four numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quad<S: Unit> {
    unit: S,
    value: f64x4,
}

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

impl<S: Unit> Quad<S> {
    #[inline(always)]
    fn bits(self) -> u64x4 {
        self.unit.transmute_u64s_f64s(self.value)
    }

    #[inline(always)]
    fn with_bits(self, bits: u64x4) -> Self {
        Self { value: self.unit.transmute_f64s_u64s(bits), ..self }
    }

    /// First guess of a root, to 3 per cent: `bits` and a share of the number's own high word are its.
    #[inline(always)]
    fn root_guess(self, share: f64, bits: f64) -> Self {
        let high = self.unit.shift_right_u64::<32>(self.bits());
        let high = self.with_bits(self.unit.or_u64s(high, self.unit.splat_u64s(INTEGER_BITS)));
        let high = high - self.all(TWO_52);
        let guess = high.mul_add(self.all(share), self.all(bits + TWO_52));
        self.with_bits(self.unit.shift_left_u64::<32>(guess.bits()))
    }
}

register! {
    Quad of Four, f64:
    splat_f64s neg_f64s add_f64s sub_f64s mul_f64s div_f64s
    mul_add_f64s negate_mul_add_f64s sqrt_f64s max_f64s min_f64s less_than_f64s select_f64s;

    const FACTORS: u32 = 16;

    #[inline(always)]
    fn exp(self) -> Self {
        let x = self.max(self.all(-LARGEST)).min(self.all(LARGEST));
        let shifted = x.mul_add(x.all(std::f64::consts::LOG2_E), x.all(ROUNDING));
        let whole = x.all(ROUNDING) - shifted;
        let rest = whole.mul_add(x.all(LN2_LOW), whole.mul_add(x.all(LN2_HIGH), x));
        let exponent = self.unit.shift_left_u64::<52>(shifted.bits());
        let scale = self.with_bits(self.unit.add_u64s(exponent, self.unit.splat_u64s(ONE_BITS)));
        rest.polynomial(&EXP_TERMS) * scale
    }

    #[inline(always)]
    fn inverse_cube_root(self) -> Self {
        let one = self.all(1.0);
        // y (1 + r/3 + 2r²/9 + 14r³/81 + 35r⁴/243), r = 1 - x y³: a step up to r² leaves 1.3e-4 of 3 per cent, one up to r⁴ the rest.
        let root = self.root_guess(-1.0 / 3.0, CUBE_ROOT_BITS);
        let rest = (self * root).mul_sub_from(root * root, one);
        let root = (root * rest).mul_add(rest.polynomial(&[2.0 / 9.0, 1.0 / 3.0]), root);
        let rest = (self * root).mul_sub_from(root * root, one);
        let series = rest.polynomial(&[35.0 / 243.0, 14.0 / 81.0, 2.0 / 9.0, 1.0 / 3.0]);
        (root * rest).mul_add(series, root)
    }

    #[inline(always)]
    fn inverse_fifth_root(self) -> Self {
        let mut root = self.root_guess(-0.2, FIFTH_ROOT_BITS);
        // y (1 + r/5 + 3r²/25 + 11r³/125 + 44r⁴/625), r = 1 - x y⁵: two steps of fifth order from 3 per cent.
        for _ in 0..2 {
            let square = root * root;
            let rest = (self * root).mul_sub_from(square * square, self.all(1.0));
            let series = rest.polynomial(&[44.0 / 625.0, 11.0 / 125.0, 3.0 / 25.0, 0.2]);
            root = (root * rest).mul_add(series, root);
        }
        root
    }

    #[inline(always)]
    fn ln(self) -> Self {
        let unit = self.unit;
        let exponent = unit.or_u64s(unit.shift_right_u64::<52>(self.bits()), unit.splat_u64s(INTEGER_BITS));
        let exponent = self.with_bits(exponent) - self.all(TWO_52 + 1023.0);
        let mantissa = unit.and_u64s(self.bits(), unit.splat_u64s(MANTISSA));
        let m = self.with_bits(unit.or_u64s(mantissa, unit.splat_u64s(ONE_BITS)));
        let (root, one) = (self.all(std::f64::consts::SQRT_2), self.all(1.0));
        let e = m.less_select(root, exponent, exponent + one);
        let m = m.less_select(root, m, m * self.all(0.5));
        let s = (m - one) / (m + one);
        let series = (s * s).polynomial(&LN_TERMS);
        e.mul_add(self.all(LN2_HIGH), series.mul_add(s, e * self.all(LN2_LOW)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::register::{Kernel, dispatch};
    use pulp::Scalar256b;

    #[derive(Clone, Copy)]
    struct All(f64);

    impl Kernel for All {
        type Output = [Four; 4];
        fn run<S: Unit>(self, unit: S) -> [Four; 4] {
            let x = Quad::splat(unit, self.0);
            [x.exp(), x.exp().ln(), x.exp().inverse_cube_root(), x.exp().inverse_fifth_root()]
                .map(Register::numbers)
        }
    }

    #[test]
    fn cross_exp_ln_and_roots_agree_with_the_standard_library() {
        for i in -69_900..69_900 {
            let x = f64::from(i) * 0.01 + 0.003;
            let [exp, ln, cube_root, fifth_root] = dispatch(All(x));
            let there = x.exp();
            assert!(((exp.0[2] - there) / there).abs() < 1e-14, "exp {x}");
            let positive = exp.0[1];
            let there = positive.ln();
            assert!((ln.0[1] - there).abs() < 1e-15 * (1.0 + there.abs()), "ln {positive}");
            let there = 1.0 / positive.cbrt();
            assert!(((cube_root.0[3] - there) / there).abs() < 1e-15, "inverse cube root {positive}");
            // The fifth power is off by five times the root's error, and rounded itself.
            let fifth = positive * fifth_root.0[1].powi(5);
            assert!((fifth - 1.0).abs() < 6e-15, "inverse fifth root {positive}");
        }
        assert!(dispatch(All(-1e9))[0].0[0] < 1e-300);
        assert_eq!(dispatch(All(0.0))[1].0[0], 0.0);
    }

    /// Same bytes on every processor.
    #[test]
    fn law_all_units_give_the_same_bytes() {
        for i in -1000..1000 {
            let x = All(f64::from(i) * 0.6971);
            assert_eq!(dispatch(x), x.run(Scalar256b));
        }
    }
}
