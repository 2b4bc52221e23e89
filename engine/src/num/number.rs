//! The number of a model's expressions: any [`Real`], with plain numbers on either side of an operator.

use std::fmt;
use std::iter::{Product, Sum};
use std::ops::{
    Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Rem, RemAssign, Sub, SubAssign,
};

use num_dual::{DualNum, DualStruct, Mappable};
use num_traits::{FromPrimitive, Inv, One, Signed, Zero};

use super::{Made, Real};

/// A [`Real`] of which `2.0 * x` and `2 * x` can be written, as well as `x * 2.0`.
///
/// num-dual's own types cannot have a plain number on their left in generic code. Parameters and fields are such
/// numbers in the expressions of a `model!`; a function outside may be generic over `D: Real`, with plain
/// numbers on the right, or take `Num<T>`:
///
/// ```
/// # extern crate eplat_engine as eplat;
/// use eplat::prelude::*;
/// fn recovered<T: Real>(t: Num<T>, tau: Num<T>) -> Num<T> {
///     1 - 0.5 * exp(-t / tau)
/// }
/// assert!((recovered(Num(0.0), Num(3.0)).0 - 0.5).abs() < 1e-15);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
#[repr(transparent)]
pub struct Num<T>(pub T);

/// An operator between numbers, references to them and plain numbers.
macro_rules! operator {
    ($Op:ident $op:ident $OpAssign:ident $op_assign:ident) => {
        impl<T: Real> $Op for Num<T> {
            type Output = Self;
            #[inline(always)]
            fn $op(self, other: Self) -> Self {
                Self(self.0.$op(other.0))
            }
        }
        impl<T: Real> $Op<&Self> for Num<T> {
            type Output = Self;
            #[inline(always)]
            fn $op(self, other: &Self) -> Self {
                Self(self.0.$op(other.0))
            }
        }
        impl<T: Real> $Op<f64> for Num<T> {
            type Output = Self;
            #[inline(always)]
            fn $op(self, other: f64) -> Self {
                Self(self.0.$op(other))
            }
        }
        impl<T: Real> $Op<i32> for Num<T> {
            type Output = Self;
            #[inline(always)]
            fn $op(self, other: i32) -> Self {
                Self(self.0.$op(f64::from(other)))
            }
        }
        impl<T: Real> $Op<Num<T>> for f64 {
            type Output = Num<T>;
            #[inline(always)]
            fn $op(self, other: Num<T>) -> Num<T> {
                Num(T::from(self).$op(other.0))
            }
        }
        impl<T: Real> $Op<Num<T>> for i32 {
            type Output = Num<T>;
            #[inline(always)]
            fn $op(self, other: Num<T>) -> Num<T> {
                Num(T::from(f64::from(self)).$op(other.0))
            }
        }
        impl<T: Real> $OpAssign for Num<T> {
            #[inline(always)]
            fn $op_assign(&mut self, other: Self) {
                self.0.$op_assign(other.0);
            }
        }
        impl<T: Real> $OpAssign<f64> for Num<T> {
            #[inline(always)]
            fn $op_assign(&mut self, other: f64) {
                self.0.$op_assign(other);
            }
        }
    };
}
operator!(Add add AddAssign add_assign);
operator!(Sub sub SubAssign sub_assign);
operator!(Mul mul MulAssign mul_assign);
operator!(Div div DivAssign div_assign);
operator!(Rem rem RemAssign rem_assign);

impl<T: Real> Neg for Num<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<T: Real> Inv for Num<T> {
    type Output = Self;
    #[inline(always)]
    fn inv(self) -> Self {
        Self(self.0.inv())
    }
}

impl<T: Real> Sum for Num<T> {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        Self(terms.map(|x| x.0).sum())
    }
}

impl<T: Real> Product for Num<T> {
    fn product<I: Iterator<Item = Self>>(factors: I) -> Self {
        Self(factors.map(|x| x.0).product())
    }
}

impl<T: Real> From<f64> for Num<T> {
    #[inline(always)]
    fn from(x: f64) -> Self {
        Self(T::from(x))
    }
}

impl<T: Real> FromPrimitive for Num<T> {
    fn from_i64(n: i64) -> Option<Self> {
        T::from_i64(n).map(Self)
    }
    fn from_u64(n: u64) -> Option<Self> {
        T::from_u64(n).map(Self)
    }
    fn from_f64(x: f64) -> Option<Self> {
        T::from_f64(x).map(Self)
    }
}

impl<T: Real> Zero for Num<T> {
    fn zero() -> Self {
        Self(T::zero())
    }
    fn is_zero(&self) -> bool {
        self.0.is_zero()
    }
}

impl<T: Real> One for Num<T> {
    fn one() -> Self {
        Self(T::one())
    }
}

impl<T: Real> num_traits::Num for Num<T> {
    type FromStrRadixErr = T::FromStrRadixErr;
    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        T::from_str_radix(text, radix).map(Self)
    }
}

impl<T: Real> Signed for Num<T> {
    #[inline(always)]
    fn abs(&self) -> Self {
        Self(self.0.abs())
    }
    fn abs_sub(&self, other: &Self) -> Self {
        Self(self.0.abs_sub(&other.0))
    }
    fn signum(&self) -> Self {
        Self(self.0.signum())
    }
    fn is_positive(&self) -> bool {
        self.0.is_positive()
    }
    fn is_negative(&self) -> bool {
        self.0.is_negative()
    }
}

impl<T: Real> PartialEq<f64> for Num<T> {
    #[inline(always)]
    fn eq(&self, other: &f64) -> bool {
        self.0.re() == *other
    }
}

impl<T: Real> PartialOrd<f64> for Num<T> {
    #[inline(always)]
    fn partial_cmp(&self, other: &f64) -> Option<std::cmp::Ordering> {
        self.0.re().partial_cmp(other)
    }
}

impl<T: Real> fmt::Display for Num<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

impl<T: Real> DualStruct for Num<T> {
    type Real = f64;
    type Inner = T::Inner;
    #[inline(always)]
    fn re(&self) -> f64 {
        self.0.re()
    }
    fn from_inner(inner: &Self::Inner) -> Self {
        Self(T::from_inner(inner))
    }
}

impl<T: Real> Mappable<Self> for Num<T> {
    type Output<O> = O;
    fn map_dual<M: Fn(Self) -> O, O>(self, f: M) -> O {
        f(self)
    }
}

/// Functions of one number, which the wrapped number has.
macro_rules! functions {
    ($($name:ident)*) => {$(
        #[inline(always)]
        fn $name(&self) -> Self {
            Self(self.0.$name())
        }
    )*};
}

impl<T: Real> DualNum for Num<T> {
    type Primitive = f64;
    const NDERIV: usize = T::NDERIV;
    type InnerDual = T::InnerDual;

    fn from_re(re: Self::InnerDual) -> Self {
        Self(T::from_re(re))
    }
    fn scale(self, factor: &Self::InnerDual) -> Self {
        Self(self.0.scale(factor))
    }
    functions! {
        recip sqrt cbrt exp exp2 exp_m1 ln log2 log10 ln_1p sin cos tan asin acos atan sinh cosh tanh
        asinh acosh atanh sph_j0 sph_j1 sph_j2
    }
    #[inline(always)]
    fn powi(&self, n: i32) -> Self {
        Self(self.0.powi(n))
    }
    #[inline(always)]
    fn powf(&self, n: f64) -> Self {
        Self(self.0.powf(n))
    }
    fn log(&self, base: f64) -> Self {
        Self(self.0.log(base))
    }
    fn sin_cos(&self) -> (Self, Self) {
        let (sin, cos) = self.0.sin_cos();
        (Self(sin), Self(cos))
    }
    fn atan2(&self, other: Self) -> Self {
        Self(self.0.atan2(other.0))
    }
    fn powd(&self, exponent: Self) -> Self {
        Self(self.0.powd(exponent.0))
    }
}

impl<T: Real> Made<f64> for Num<T> {
    #[inline(always)]
    fn made(from: f64) -> Self {
        from.into()
    }
}

impl<T: Real> Made<i32> for Num<T> {
    #[inline(always)]
    fn made(from: i32) -> Self {
        f64::from(from).into()
    }
}

impl<T: Real> Made<Self> for Num<T> {
    #[inline(always)]
    fn made(from: Self) -> Self {
        from
    }
}

impl<T: Real> Real for Num<T> {
    const ORDER: u32 = T::ORDER;
    #[inline(always)]
    fn chain(self, f: [f64; 4]) -> Self {
        Self(self.0.chain(f))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    #[test]
    fn plain_numbers_stand_on_either_side() {
        let x: Num<Dual<1>> = Num(variable(3.0, 0));
        let cases = [
            (2 * x, 6.0, 2.0),
            (2.0 * x, 6.0, 2.0),
            (x * 2, 6.0, 2.0),
            (1 - x, -2.0, -1.0),
            (6.0 / x, 2.0, -2.0 / 3.0),
            (x / 2, 1.5, 0.5),
            (2 + x * x - 1.0, 10.0, 6.0),
        ];
        for (y, value, slope) in cases {
            assert!((y.re() - value).abs() < 1e-15 && (derivatives(&y.0)[0] - slope).abs() < 1e-15);
        }
        assert!(x > 2.0 && x.powi(2) < 10.0);
    }
}
