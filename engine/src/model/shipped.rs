//! Priors and kernels that ship, compiled with the library.
//!
//! Most priors of a model file are a shipped word with plain numbers, `InvGamma(1.0, 5.0)`. Most
//! kernels are a shipped word with one parameter, `Rbf(rho)`. What the sampler needs of these
//! (values, first and second derivatives) is compiled here, and not with the model.
//!
//! The macro puts such an expression into [`Written`]. A file may declare a type of its own with
//! the same name as a shipped one. The compiler decides which of them it is: a method of the type
//! itself goes before a method of a trait.

use super::expression::{AnyKernel, AnyPrior, Names, kernel, prior};
use super::functions::{KernelFn, PriorFn};
use crate::dist::{
    Beta, Cauchy, Dist, Exponential, Flat, FlatBetween, FlatPositive, Gamma, HalfCauchy,
    HalfNormal, HalfStudentT, InvGamma, Laplace, LogNormal, Normal, StudentT, TruncatedNormal,
    Uniform,
};
use crate::field::{Authors, Kernel, Matern12, Matern32, Matern52, Rbf, authors};
use crate::num::{Num, Real};

/// A prior or a kernel as written, of plain numbers.
#[derive(Debug)]
pub struct Written<E>(pub E);

/// A prior that does not ship: its code is compiled with the model.
pub trait OwnPrior: Sized {
    /// The prior `f`.
    fn prior<F: PriorFn<0>>(self, f: F) -> AnyPrior {
        prior::<F, 0, 1>(&[], f)
    }
}

impl<P: Dist<Num<f64>>> OwnPrior for Written<P> {}

/// A kernel that does not ship: its code is compiled with the model.
pub trait OwnKernel: Sized {
    /// The kernel F, of one parameter.
    fn kernel<F: KernelFn<1>>(self, mentions: Names, f: F) -> AnyKernel {
        kernel::<F, 1>(mentions, f)
    }
}

impl<K: Kernel<Num<f64>>> OwnKernel for Written<K> {}

/// Priors of plain numbers.
macro_rules! priors {
    ($($Family:ident { $($number:ident),* })*) => {$(
        impl PriorFn<0> for $Family<Num<f64>> {
            #[inline]
            fn prior<T: Real>(&self, _: [Num<T>; 0]) -> impl Dist<Num<T>> + use<T> {
                $Family { $($number: Num::<T>::from(self.$number.0)),* }
            }
        }
        shipped!($Family<Num<f64>>);
    )*};
}

/// A prior whose code is in the library.
macro_rules! shipped {
    ($Prior:ty) => {
        impl Written<$Prior> {
            /// The prior, whatever stands for it in the model's program.
            pub fn prior<F>(self, _: F) -> AnyPrior {
                self.shipped()
            }

            #[inline(never)]
            fn shipped(self) -> AnyPrior {
                prior::<$Prior, 0, 1>(&[], self.0)
            }
        }
    };
}

priors! {
    Normal { mu, sd }
    StudentT { nu, mu, sd }
    Cauchy { mu, scale }
    Laplace { mu, scale }
    LogNormal { mu, sd }
    Gamma { shape, rate }
    Exponential { rate }
    HalfNormal { sd }
    HalfCauchy { scale }
    HalfStudentT { nu, sd }
    InvGamma { shape, scale }
    Beta { a, b }
    Uniform { lower, upper }
    TruncatedNormal { mu, sd, lower, upper }
    FlatBetween { lower, upper }
}

impl PriorFn<0> for Flat {
    #[inline]
    fn prior<T: Real>(&self, _: [Num<T>; 0]) -> impl Dist<Num<T>> + use<T> {
        Self
    }
}
shipped!(Flat);

impl PriorFn<0> for FlatPositive {
    #[inline]
    fn prior<T: Real>(&self, _: [Num<T>; 0]) -> impl Dist<Num<T>> + use<T> {
        Self
    }
}
shipped!(FlatPositive);

/// Kernels with one parameter, the lengthscale: in mm, or in the units of the paper's code.
macro_rules! kernels {
    ($($Kernel:ident)*) => {$(
        impl KernelFn<1> for $Kernel<Num<f64>> {
            #[inline(always)]
            fn kernel<T: Real>(&self, [lengthscale]: [Num<T>; 1]) -> impl Kernel<Num<T>> + use<T> {
                $Kernel { lengthscale }
            }
        }

        impl KernelFn<1> for Authors<$Kernel<Num<f64>>> {
            #[inline(always)]
            fn kernel<T: Real>(&self, [lengthscale]: [Num<T>; 1]) -> impl Kernel<Num<T>> + use<T> {
                authors($Kernel { lengthscale })
            }
        }
        shipped_kernel!($Kernel<Num<f64>>);
        shipped_kernel!(Authors<$Kernel<Num<f64>>>);
    )*};
}

/// A kernel whose code is in the library.
macro_rules! shipped_kernel {
    ($Kernel:ty) => {
        impl Written<$Kernel> {
            /// The kernel, whatever stands for it in the model's program.
            pub fn kernel<F>(self, mentions: Names, _: F) -> AnyKernel {
                self.shipped(mentions)
            }

            #[inline(never)]
            fn shipped(self, mentions: Names) -> AnyKernel {
                kernel::<$Kernel, 1>(mentions, self.0)
            }
        }
    };
}

kernels! { Rbf Matern12 Matern32 Matern52 }
