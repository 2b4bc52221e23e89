//! Numbers that may carry derivatives: `f64`, [`Dual`] (W first derivatives), [`Hyper`] (one
//! entry of a Hessian) and [`Third`] (one third derivative), all from num-dual.

pub mod functions;
pub mod lanes;
mod moments;
mod number;
mod taylor;
mod together;
pub mod vector;
mod within;

pub use moments::Moments;
pub use number::Num;
pub(crate) use taylor::Partials;
pub use together::{Common, Join, Together};
pub use within::{Within, within};

use num_dual::{Derivative, DualNum, DualSVec64, HyperDual64, HyperHyperDual64};

/// A real number that may carry derivatives.
///
/// Arithmetic and elementary functions are num-dual's; a plain `f64` goes to the right of a
/// generic number (`x * 2.0`).  [`Real::chain`] brings in any other function of one variable.
pub trait Real:
    DualNum<Primitive = f64>
    + Made<f64>
    + Made<i32>
    + Made<Self>
    + Join<f64, Output = Self>
    + Join<i32, Output = Self>
    + Join<Self, Output = Self>
    + Copy
    + Send
    + Sync
{
    /// The highest derivative that it carries: 0 to 3.
    const ORDER: u32;
    /// `f(self)` from `f`, `f′`, `f″` and `f‴` at the real part.
    #[must_use]
    fn chain(self, f: [f64; 4]) -> Self;
}

/// Numbers made from a plain one, with decimals or without, or from one of their own kind. (`From<i32>`
/// would say so, but cannot be implemented for num-dual's types.)
pub trait Made<T> {
    /// The number.
    fn made(from: T) -> Self;
}

/// What may stand where a number `D` is expected: `2`, `2.0`, or a `D`.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a number",
    label = "expected a number, a parameter, or an expression of these"
)]
pub trait Argument<D> {
    /// As a `D`.
    fn number(self) -> D;
}

impl<T, D: Made<T>> Argument<D> for T {
    #[inline(always)]
    fn number(self) -> D {
        D::made(self)
    }
}

impl Made<f64> for f64 {
    #[inline(always)]
    fn made(from: f64) -> Self {
        from
    }
}

impl Made<i32> for f64 {
    #[inline(always)]
    fn made(from: i32) -> Self {
        from.into()
    }
}

macro_rules! made {
    ($D:ty $(, $W:ident)?) => {
        impl$(<const $W: usize>)? Made<$D> for $D {
            #[inline(always)]
            fn made(from: $D) -> Self {
                from
            }
        }
        impl$(<const $W: usize>)? Made<f64> for $D {
            #[inline(always)]
            fn made(from: f64) -> Self {
                from.into()
            }
        }
        impl$(<const $W: usize>)? Made<i32> for $D {
            #[inline(always)]
            fn made(from: i32) -> Self {
                f64::from(from).into()
            }
        }
    };
}
made!(Dual<W>, W);
made!(Hyper);
made!(Third);

/// A value and `W` first derivatives.
pub type Dual<const W: usize> = DualSVec64<W>;

/// A value, its derivatives in two directions, and the mixed second derivative.
pub type Hyper = HyperDual64;

/// A value, its derivatives in three directions, and the mixed second and third derivatives.
pub type Third = HyperHyperDual64;

impl Real for f64 {
    const ORDER: u32 = 0;
    #[inline(always)]
    fn chain(self, [f, ..]: [f64; 4]) -> Self {
        f
    }
}

impl<const W: usize> Real for Dual<W> {
    const ORDER: u32 = 1;
    #[inline(always)]
    fn chain(self, [f, df, ..]: [f64; 4]) -> Self {
        Self::new(f, Derivative::new(self.eps.0.map(|eps| eps * df)))
    }
}

impl Real for Hyper {
    const ORDER: u32 = 2;
    #[inline(always)]
    fn chain(self, [f, df, d2f, _]: [f64; 4]) -> Self {
        let mixed = self.eps1eps2 * df + self.eps1 * self.eps2 * d2f;
        Self::new(f, self.eps1 * df, self.eps2 * df, mixed)
    }
}

impl Real for Third {
    const ORDER: u32 = 3;
    #[inline(always)]
    fn chain(self, [f, df, d2f, d3f]: [f64; 4]) -> Self {
        let [a, b, c] = [self.eps1, self.eps2, self.eps3];
        let [ab, ac, bc] = [self.eps1eps2, self.eps1eps3, self.eps2eps3];
        let mixed = self.eps1eps2eps3 * df + (a * bc + b * ac + c * ab) * d2f + a * b * c * d3f;
        let second = [ab * df + a * b * d2f, ac * df + a * c * d2f, bc * df + b * c * d2f];
        Self::new(f, a * df, b * df, c * df, second[0], second[1], second[2], mixed)
    }
}

/// `eˣ` as [`lanes::exp`] computes it: a loop over it becomes vector instructions.
#[inline(always)]
pub fn exp<D: Real>(x: D) -> D {
    let e = lanes::exp(x.re());
    x.chain([e; 4])
}

/// ln Σ exp(terms), −∞ of none: the way to sum over what is not known (a mixture's kind, a hidden state).
pub fn ln_sum_exp<D: Real>(terms: &[D]) -> D {
    let larger = |a: D, b: &D| if b.re() > a.re() { *b } else { a };
    let top = terms.iter().fold(D::from(f64::NEG_INFINITY), larger);
    if top.re() == f64::NEG_INFINITY {
        return top;
    }
    terms.iter().fold(D::from(0.0), |sum, term| sum + (*term - top).exp()).ln() + top
}

/// ln of the mean of eˣ, −∞ where every x is.
pub fn ln_mean_exp(x: &[f64]) -> f64 {
    ln_sum_exp(x) - (x.len() as f64).ln()
}

/// The number `re` whose derivative `index` is 1.
#[inline(always)]
pub fn variable<const W: usize>(re: f64, index: usize) -> Dual<W> {
    Dual::from_re(re).derivative(index)
}

/// The number `re` with these derivatives.
#[inline(always)]
pub fn dual<const W: usize>(re: f64, eps: [f64; W]) -> Dual<W> {
    Dual::new(re, Derivative::some(eps.into()))
}

/// The `W` first derivatives of `x`.
#[inline(always)]
pub fn derivatives<const W: usize>(x: &Dual<W>) -> [f64; W] {
    x.eps.0.map_or([0.0; W], |eps| eps.data.0[0])
}

/// ln √(2π)
pub const LN_SQRT_2PI: f64 = 0.918_938_533_204_672_8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_exponentials_keep_their_derivatives_and_do_not_overflow() {
        let terms = [variable::<2>(800.0, 0), variable::<2>(801.0, 1)];
        let sum = ln_sum_exp(&terms);
        let share = 1.0 / (1.0 + 1f64.exp());
        assert!((sum.re - (801.0 + (-1f64).exp().ln_1p())).abs() < 1e-12);
        let slopes = derivatives(&sum);
        assert!((slopes[0] - share).abs() < 1e-12 && (slopes[1] - 1.0 + share).abs() < 1e-12);
        assert!(ln_sum_exp::<f64>(&[]) == f64::NEG_INFINITY);
        assert!((ln_sum_exp(&[f64::NEG_INFINITY, 2.0]) - 2.0).abs() < 1e-15);
    }

    #[test]
    fn chain_agrees_with_the_crate_for_every_derivative() {
        let x = variable::<2>(0.7, 1);
        let e = 0.7f64.exp();
        let (by_chain, by_crate) = (derivatives(&x.chain([e; 4])), derivatives(&x.exp()));
        assert!(by_chain.iter().zip(by_crate).all(|(a, b)| (a - b).abs() < 1e-15));
        let y = Hyper::new(0.7, 1.0, 2.0, 0.3);
        let (by_chain, by_crate) = (y.chain([e; 4]), y.exp());
        assert!((by_chain.eps1eps2 - by_crate.eps1eps2).abs() < 1e-15);
        let z = Third::new(0.7, 1.0, 2.0, 0.3, -0.4, 0.6, 1.1, 0.2);
        let (sin, cos) = 0.7f64.sin_cos();
        let (by_chain, by_crate) = (z.chain([sin, cos, -sin, -cos]), z.sin());
        for (a, b) in [
            (by_chain.eps3, by_crate.eps3),
            (by_chain.eps1eps3, by_crate.eps1eps3),
            (by_chain.eps2eps3, by_crate.eps2eps3),
            (by_chain.eps1eps2eps3, by_crate.eps1eps2eps3),
        ] {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
    }
}
