//! Kernels, means and amplitudes of the fields of an interpreted model.

use std::sync::Arc;

use super::priors::WIDEST;
use super::program::{Program, Value};
use crate::field::{Authors, Kernel, Matern12, Matern32, Matern52, Rbf, authors};
use crate::model::expression::{AnyKernel, AnyScalar, Names, constant, kernel, lone, scalar};
use crate::model::functions::{KernelFn, ScalarFn};
use crate::num::{Num, Real};

macro_rules! kernels {
    ($($Kernel:ident)*) => {
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(super) enum Shape { $($Kernel),* }

        #[derive(Clone, Copy, Debug)]
        enum One<D> { $($Kernel($Kernel<D>)),* }

        impl Shape {
            /// The kernel of this name.
            pub(super) fn of(name: &str) -> Option<Self> {
                match name {
                    $(stringify!($Kernel) => Some(Self::$Kernel),)*
                    _ => None,
                }
            }

            fn at<D: Real>(self, lengthscale: D) -> One<D> {
                match self { $(Self::$Kernel => One::$Kernel($Kernel { lengthscale }),)* }
            }

            /// One that the library has compiled, whose lengthscale is a parameter and nothing else.
            fn shipped(self, of_authors: bool, mentions: Names) -> AnyKernel {
                let lengthscale = Num(1.0);
                match (self, of_authors) {
                    $((Self::$Kernel, false) => {
                        kernel::<$Kernel<Num<f64>>, 1>(mentions, $Kernel { lengthscale })
                    }
                    (Self::$Kernel, true) => kernel::<Authors<$Kernel<Num<f64>>>, 1>(
                        mentions,
                        authors($Kernel { lengthscale }),
                    ),)*
                }
            }
        }

        impl<D: Real> Kernel<D> for One<D> {
            #[inline(always)]
            fn sqrt_density(&self, w: f64) -> D {
                match self { $(Self::$Kernel(own) => own.sqrt_density(w)),* }
            }
        }
    };
}
kernels! { Rbf Matern12 Matern32 Matern52 }

/// A kernel of which the lengthscale is an expression.
#[derive(Clone, Debug)]
pub(super) struct Covariance {
    pub(super) shape: Shape,
    pub(super) of_authors: bool,
    pub(super) lengthscale: Quantity,
}

/// An expression of parameters.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    pub(super) mentions: Names,
    pub(super) program: Arc<Program>,
    pub(super) plain: Arc<[f64]>,
    pub(super) value: Value,
}

impl Quantity {
    fn at<T: Real>(&self, s: &[Num<T>]) -> Num<T> {
        self.program.value(self.value, &|i| s[i], &self.plain)
    }

    /// Whether it is one parameter and nothing else.
    fn is_lone(&self) -> bool {
        self.program.n == 1 && self.program.steps.is_empty() && self.value == Value::Number(0)
    }

    /// As a field's mean or amplitude.
    pub(super) fn object(&self) -> AnyScalar {
        match self.value {
            Value::Whole(n) => return constant(f64::from(n)),
            Value::Plain(i) => return constant(self.plain[i as usize]),
            Value::Number(_) if self.is_lone() => return lone(self.mentions),
            Value::Number(_) => {}
        }
        scalar::<_, WIDEST>(self.mentions, self.clone())
    }
}

impl<const N: usize> ScalarFn<N> for Quantity {
    fn value<T: Real>(&self, s: [Num<T>; N]) -> Num<T> {
        self.at(&s)
    }
}

/// A kernel, or one in the units of the paper's authors.
#[derive(Clone, Copy, Debug)]
enum Either<D> {
    Own(One<D>),
    OfAuthors(Authors<One<D>>),
}

impl<D: Real> Kernel<D> for Either<D> {
    fn sqrt_density(&self, w: f64) -> D {
        match self {
            Self::Own(own) => own.sqrt_density(w),
            Self::OfAuthors(own) => own.sqrt_density(w),
        }
    }
}

impl<const N: usize> KernelFn<N> for Covariance {
    fn kernel<T: Real>(&self, s: [Num<T>; N]) -> impl Kernel<Num<T>> + use<T, N> {
        let own = self.shape.at(self.lengthscale.at(&s));
        if self.of_authors { Either::OfAuthors(authors(own)) } else { Either::Own(own) }
    }
}

impl Covariance {
    /// The kernel as an object.
    pub(super) fn object(&self) -> AnyKernel {
        let mentions = self.lengthscale.mentions;
        if self.lengthscale.is_lone() {
            return self.shape.shipped(self.of_authors, mentions);
        }
        kernel::<_, WIDEST>(mentions, self.clone())
    }
}
