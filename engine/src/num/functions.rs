//! The functions of the model language, `exp(x)`: the methods of a number as free functions.
//!
//! Each takes a plain number, with decimals or without, or a number with derivatives.

use super::{Argument, Common, Join, Num, Real, Together};
use num_dual::{DualNum as _, DualStruct as _};

macro_rules! functions {
    ($($(#[$doc:meta])* $name:ident)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        pub fn $name<A, D: Real>(x: A) -> D
        where
            A: Join<A, Output = D> + Argument<D>,
        {
            x.number().$name()
        }
    )*};
}

functions! {
    /// |x|; its derivative at 0 is that of x.
    abs
    /// cos x, of an angle in radians.
    cos
    /// eˣ
    exp
    /// The natural logarithm.
    ln
    /// The logarithm to base 10.
    log10
    /// sin x, of an angle in radians.
    sin
    /// The square root.
    sqrt
    /// tan x, of an angle in radians.
    tan
    /// The hyperbolic tangent.
    tanh
}

/// The larger of two numbers, with its derivatives; the first where both are equal.
#[inline(always)]
pub fn max<A, B>(a: A, b: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    let [a, b] = (a, b).together();
    if b.re() > a.re() { b } else { a }
}

/// The smaller of two numbers, with its derivatives; the first where both are equal.
#[inline(always)]
pub fn min<A, B>(a: A, b: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    let [a, b] = (a, b).together();
    if b.re() < a.re() { b } else { a }
}

/// `base` to the power `exponent`. Where the exponent carries derivatives, the base is positive.
#[inline(always)]
pub fn pow<A: Power<B>, B>(base: A, exponent: B) -> <A as Power<B>>::Output {
    base.to_the(exponent)
}

/// A number that can be raised to a power.
#[diagnostic::on_unimplemented(
    message = "`pow` takes no `{Self}` to the power of `{B}`",
    label = "expected a number, a parameter, or an expression of these",
    note = "in a function of your own, a `D: Real` has `x.powi(2)`, `x.powf(0.5)` and `x.powd(y)`"
)]
pub trait Power<B> {
    /// What the power is.
    type Output;
    /// This to the power `exponent`.
    fn to_the(self, exponent: B) -> Self::Output;
}

macro_rules! power {
    ($($A:ty, $B:ty => $method:ident;)*) => {$(
        impl Power<$B> for $A {
            type Output = f64;
            #[inline(always)]
            fn to_the(self, exponent: $B) -> f64 {
                f64::from(self).$method(exponent)
            }
        }
    )*};
}
power! {
    f64, f64 => powf;
    f64, i32 => powi;
    i32, f64 => powf;
    i32, i32 => powi;
}

macro_rules! dual_power {
    ($($A:ty, $B:ty => |$base:ident, $exponent:ident| $value:expr;)*) => {$(
        impl<T: Real> Power<$B> for $A {
            type Output = Num<T>;
            #[inline(always)]
            fn to_the(self, $exponent: $B) -> Num<T> {
                let $base = self;
                $value
            }
        }
    )*};
}
dual_power! {
    Num<T>, i32 => |base, exponent| base.powi(exponent);
    Num<T>, f64 => |base, exponent| base.powf(exponent);
    Num<T>, Num<T> => |base, exponent| (base.ln() * exponent).exp();
    f64, Num<T> => |base, exponent| (exponent * base.ln()).exp();
    i32, Num<T> => |base, exponent| (exponent * f64::from(base).ln()).exp();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{derivatives, variable};

    /// Value and derivative of a function of a model's number, and the derivative by differences.
    fn checked(f: impl Fn(Num<crate::num::Dual<1>>) -> Num<crate::num::Dual<1>>, at: f64) -> f64 {
        let value = |x: f64| f(Num(variable::<1>(x, 0))).0;
        let (step, slope) = (1e-6, derivatives(&value(at))[0]);
        let by_differences = (value(at + step).re() - value(at - step).re()) / (2.0 * step);
        assert!(
            (slope - by_differences).abs() < 1e-7 * (1.0 + slope.abs()),
            "{slope} {by_differences}"
        );
        value(at).re()
    }

    #[test]
    fn each_function_has_its_value_and_its_derivative() {
        let near =
            |got: f64, expected: f64| assert!((got - expected).abs() < 1e-14, "{got} {expected}");
        near(checked(abs, -1.5), 1.5);
        near(checked(cos, 0.4), 0.4_f64.cos());
        near(checked(exp, 0.4), 0.4_f64.exp());
        near(checked(ln, 0.4), 0.4_f64.ln());
        near(checked(log10, 0.4), 0.4_f64.log10());
        near(checked(sin, 0.4), 0.4_f64.sin());
        near(checked(sqrt, 0.4), 0.4_f64.sqrt());
        near(checked(tan, 0.4), 0.4_f64.tan());
        near(checked(tanh, 0.4), 0.4_f64.tanh());
        near(checked(|x| max(x, 0), 0.4), 0.4);
        near(checked(|x| max(1.0, x), 0.4), 1.0);
        near(checked(|x| min(x, x * 2), 0.4), 0.4);
        near(checked(|x| pow(x, 2), -0.4), 0.16);
        near(checked(|x| pow(x, 2.5), 0.4), 0.4_f64.powf(2.5));
        near(checked(|x| pow(x, x), 0.4), 0.4_f64.powf(0.4));
        near(checked(|x| pow(2.0, x) + pow(10, x), 0.4), 2.0_f64.powf(0.4) + 10.0_f64.powf(0.4));
    }

    #[test]
    fn plain_numbers_stay_plain() {
        let total: f64 = exp(0) + sqrt(4.0) + max(1, 2) + pow(2, 3) + pow(2.0, 0.5) + pow(4, 0.5);
        assert!((total - (1.0 + 2.0 + 2.0 + 8.0 + 2.0_f64.sqrt() + 2.0)).abs() < 1e-14);
        assert!((exp(0.0) - 1.0).abs() < 1e-15);
    }
}
