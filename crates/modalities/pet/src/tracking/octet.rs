//! Eight numbers of single precision in a vector register ([`super::register`]), with exponential, logarithm and roots.
//!
//! [`Register::exp`]: argument clamped to ±87, reduced to |r| <= ln 2 / 2, Taylor polynomial of degree 6: relative error below 3e-7.
//! [`Register::inverse_cube_root`], [`Register::inverse_fifth_root`]: relative error below 3e-7.
//! [`Register::ln`]: `2 artanh s` with |s| <= 0.1716, four terms: absolute error below 1e-7 (2 + |ln x|).

use super::lanes::Eight;
use super::register::{Numbers, Register, Unit, register};
use pulp::{cast, f32x8, u32x8};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Eight numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Octet<S: Unit> {
    unit: S,
    value: f32x8,
}

/// First guess of an inverse cube root: upper 24 bits, plus a third of the number's own. As [`super::quad`], with the bias of a short
/// exponent: `4/3 (127 - 0.0494) 2^15`.
const CUBE_ROOT_BITS: f64 = 5_546_556.0;
/// As [`CUBE_ROOT_BITS`], of an inverse fifth root, plus a fifth of the number's own: `6/5 (127 - 0.0494) 2^15`.
const FIFTH_ROOT_BITS: f64 = 4_991_898.0;
/// `ln 2` in two parts: the first has 15 trailing zero bits, so that its product with an exponent is exact.
const LN2_HIGH: f64 = 0.693359375;
const LN2_LOW: f64 = -2.12194440e-4;
/// Added to a small number, it leaves the nearest integer in the low bits: 1.5 · 2^23.
const ROUNDING: f64 = 12_582_912.0;
/// 2^23: an integer below it, put into the mantissa, is that number beyond 2^23.
const INTEGER_BITS: u32 = 0x4b00_0000;
const TWO_23: f64 = 8_388_608.0;
const MANTISSA: u32 = 0x007f_ffff;
const ONE_BITS: u32 = 0x3f80_0000;
/// Arguments of an exponential are cut to this: beyond it, it is no normal number.
const LARGEST: f64 = 87.0;
/// `1/n!` for n = 6 … 0.
const EXP_TERMS: [f64; 7] = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
/// `2/(2n + 1)` for n = 3 … 0.
const LN_TERMS: [f64; 4] = [2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0];

impl<S: Unit> Octet<S> {
    #[inline(always)]
    fn bits(self) -> u32x8 {
        self.unit.transmute_u32s_f32s(self.value)
    }

    #[inline(always)]
    fn with_bits(self, bits: u32x8) -> Self {
        Self { value: self.unit.transmute_f32s_u32s(bits), ..self }
    }

    /// First guess of a root, to 3 per cent: `bits` and a share of the number's own upper bits are its.
    #[inline(always)]
    fn root_guess(self, share: f64, bits: f64) -> Self {
        let high = self.unit.shift_right_u32::<8>(self.bits());
        let high = self.with_bits(self.unit.or_u32s(high, self.unit.splat_u32s(INTEGER_BITS)));
        let high = high - self.all(TWO_23);
        let guess = high.mul_add(self.all(share), self.all(bits + TWO_23));
        self.with_bits(self.unit.shift_left_u32::<8>(guess.bits()))
    }
}

register! {
    Octet of Eight, f32:
    splat_f32s neg_f32s add_f32s sub_f32s mul_f32s div_f32s
    mul_add_f32s negate_mul_add_f32s sqrt_f32s max_f32s min_f32s less_than_f32s select_f32s;

    const FACTORS: u32 = 4;

    #[inline(always)]
    fn exp(self) -> Self {
        let x = self.max(self.all(-LARGEST)).min(self.all(LARGEST));
        let shifted = x.mul_add(x.all(std::f64::consts::LOG2_E), x.all(ROUNDING));
        let whole = x.all(ROUNDING) - shifted;
        let rest = whole.mul_add(x.all(LN2_LOW), whole.mul_add(x.all(LN2_HIGH), x));
        let exponent = self.unit.shift_left_u32::<23>(shifted.bits());
        let scale = self.with_bits(self.unit.add_u32s(exponent, self.unit.splat_u32s(ONE_BITS)));
        rest.polynomial(&EXP_TERMS) * scale
    }

    #[inline(always)]
    fn inverse_cube_root(self) -> Self {
        let one = self.all(1.0);
        // y (1 + r/3 + 2r²/9 + …), r = 1 - x y³: a step up to r² leaves 1.3e-4 of 3 per cent, one up to r the rest.
        let root = self.root_guess(-1.0 / 3.0, CUBE_ROOT_BITS);
        let rest = (self * root).mul_sub_from(root * root, one);
        let root = (root * rest).mul_add(rest.polynomial(&[2.0 / 9.0, 1.0 / 3.0]), root);
        let rest = (self * root).mul_sub_from(root * root, one);
        (root * rest).mul_add(self.all(1.0 / 3.0), root)
    }

    #[inline(always)]
    fn inverse_fifth_root(self) -> Self {
        let one = self.all(1.0);
        // y (1 + r/5 + 3r²/25 + 11r³/125 + …), r = 1 - x y⁵: from 3 per cent to 5e-5, then the rest.
        let root = self.root_guess(-0.2, FIFTH_ROOT_BITS);
        let square = root * root;
        let rest = (self * root).mul_sub_from(square * square, one);
        let root = (root * rest).mul_add(rest.polynomial(&[11.0 / 125.0, 3.0 / 25.0, 0.2]), root);
        let square = root * root;
        let rest = (self * root).mul_sub_from(square * square, one);
        (root * rest).mul_add(self.all(0.2), root)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        let unit = self.unit;
        let exponent = unit.or_u32s(unit.shift_right_u32::<23>(self.bits()), unit.splat_u32s(INTEGER_BITS));
        let exponent = self.with_bits(exponent) - self.all(TWO_23 + 127.0);
        let mantissa = unit.and_u32s(self.bits(), unit.splat_u32s(MANTISSA));
        let m = self.with_bits(unit.or_u32s(mantissa, unit.splat_u32s(ONE_BITS)));
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
        type Output = [Eight; 4];
        fn run<S: Unit>(self, unit: S) -> [Eight; 4] {
            let x = Octet::splat(unit, self.0);
            [x.exp(), x.exp().ln(), x.exp().inverse_cube_root(), x.exp().inverse_fifth_root()]
                .map(Register::numbers)
        }
    }

    #[test]
    fn cross_exp_ln_and_roots_agree_with_the_standard_library() {
        for i in -8_600..8_600 {
            // A number that single precision holds: the argument's own rounding is not the function's.
            let x = f64::from((f64::from(i) * 0.01 + 0.003) as f32);
            let [exp, ln, cube_root, fifth_root] = dispatch(All(x)).map(|found| f64::from(found.0[3]));
            let off = |found: f64, there: f64| ((found - there) / there).abs();
            assert!(off(exp, x.exp()) < 3e-7, "exp {x}: {exp}");
            assert!((ln - exp.ln()).abs() < 1e-7 * (2.0 + exp.ln().abs()), "ln {exp}: {ln}");
            assert!(off(cube_root, 1.0 / exp.cbrt()) < 3e-7, "inverse cube root {exp}: {cube_root}");
            assert!(off(fifth_root, exp.powf(-0.2)) < 3e-7, "inverse fifth root {exp}: {fifth_root}");
        }
        assert!(dispatch(All(-1e9))[0].0[0] < 1e-37);
        assert_eq!(dispatch(All(0.0))[1].0[0], 0.0);
    }

    /// Same bytes on every processor.
    #[test]
    fn law_all_units_give_the_same_bytes() {
        for i in -1000..1000 {
            let x = All(f64::from(i) * 0.0869);
            assert_eq!(dispatch(x), x.run(Scalar256b));
        }
    }
}
