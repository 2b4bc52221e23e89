//! Numbers of several kinds as arguments of one function: parameters, constants and columns.
//!
//! A function of a model, `f(CV_MAX, 0.05, tau_out(x))`, takes plain numbers in any place and gives what
//! its arguments are together: a number with derivatives if one of them is, otherwise a plain one.

use super::{Argument, Dual, Hyper, Num, Real, Third};

/// The number that an expression of two numbers is.
#[diagnostic::on_unimplemented(
    message = "`{Self}` and `{B}` are not numbers of one expression",
    label = "expected a number, a parameter, or an expression of these"
)]
pub trait Join<B> {
    /// `B` if this is a plain number, otherwise this.
    type Output;
}

impl<B: Real> Join<B> for f64 {
    type Output = B;
}

impl<B: Real> Join<B> for i32 {
    type Output = B;
}

impl Join<i32> for i32 {
    type Output = f64;
}

impl Join<i32> for f64 {
    type Output = Self;
}

macro_rules! join {
    ($D:ty $(, $W:ident)?) => {
        join!(@ $D, f64 $(, $W)?);
        join!(@ $D, i32 $(, $W)?);
        join!(@ $D, $D $(, $W)?);
    };
    (@ $D:ty, $B:ty $(, $W:ident)?) => {
        impl$(<const $W: usize>)? Join<$B> for $D {
            type Output = Self;
        }
    };
}
join!(Dual<W>, W);
join!(Hyper);
join!(Third);

impl<T: Real> Join<f64> for Num<T> {
    type Output = Self;
}

impl<T: Real> Join<i32> for Num<T> {
    type Output = Self;
}

impl<T: Real> Join<Self> for Num<T> {
    type Output = Self;
}

/// Arguments of a function, as a tuple of 2 to 5 numbers of several kinds.
#[diagnostic::on_unimplemented(
    message = "`{Self}` are not numbers",
    label = "expected numbers, parameters, columns, or expressions of these"
)]
pub trait Together<const N: usize> {
    /// What they are together.
    type Number: Real;
    /// All as such numbers.
    fn together(self) -> [Self::Number; N];
}

/// What a tuple's numbers are together.
pub type Common<T, const N: usize> = <T as Together<N>>::Number;

macro_rules! together {
    ($N:literal: $($T:ident $t:ident),*; $($A:ident $B:ident = $O:ident,)* => $A_last:ident $B_last:ident) => {
        impl<$($T,)* $($O,)* Last: Real> Together<$N> for ($($T,)*)
        where
            $($A: Join<$B, Output = $O>,)*
            $A_last: Join<$B_last, Output = Last>,
            $($T: Argument<Last>,)*
        {
            type Number = Last;
            #[inline(always)]
            fn together(self) -> [Last; $N] {
                let ($($t,)*) = self;
                [$($t.number()),*]
            }
        }
    };
}
together!(2: A a, B b; => A B);
together!(3: A a, B b, C c; A B = X, => X C);
together!(4: A a, B b, C c, D d; A B = X, X C = Y, => Y D);
together!(5: A a, B b, C c, D d, E e; A B = X, X C = Y, Y D = Z, => Z E);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{derivatives, variable};

    /// As a model's expression sees it: a number of an unknown kind.
    fn product<D: Real>(x: D) -> [D; 3] {
        fn f<A, B, C>(a: A, b: B, c: C) -> Common<(A, B, C), 3>
        where
            (A, B, C): Together<3>,
        {
            let [a, b, c] = (a, b, c).together();
            a * b * c
        }
        [f(2, 3.0, x), f(x, 3, 2.0) * 0.5, f(2.0, x, x)]
    }

    #[test]
    fn plain_numbers_may_stand_in_any_place() {
        let [a, b, c] = product(variable::<1>(5.0, 0));
        assert!((derivatives(&a)[0] - 6.0).abs() < 1e-15);
        assert!((derivatives(&b)[0] - 3.0).abs() < 1e-15);
        assert!((derivatives(&c)[0] - 20.0).abs() < 1e-15);
        let [a, _, c] = product(5.0);
        assert!((a - 30.0).abs() < 1e-15 && (c - 50.0).abs() < 1e-15);
    }
}
