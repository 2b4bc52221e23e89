//! Priors of an interpreted model: one of those that ships, with its arguments.

use std::sync::Arc;

use rand::Rng;

use super::program::{Numbers, Program, Registers, Value};
use crate::dist::{
    Beta, Cauchy, Dirichlet, Dist, Exponential, Flat, FlatBetween, FlatPositive, Gamma, Gaussian,
    HalfCauchy, HalfNormal, HalfStudentT, InvGamma, Laplace, LkjCholesky, LogNormal, Normal,
    Ordered, Sequence, Step, StudentT, SumToZero, Support, TruncatedNormal, Uniform,
};
use crate::model::expression::{AnyPrior, Names, prior};
use crate::model::functions::PriorFn;
use crate::model::parameter::SequenceFn;
use crate::num::{Num, Real};

/// At most so many arguments has a prior.
const MOST: usize = 4;

macro_rules! families {
    ($($Family:ident($($argument:ident),*))*) => {
        /// The prior of one number.
        #[derive(Clone, Copy, Debug)]
        enum One<D> {
            Flat(Flat),
            FlatPositive(FlatPositive),
            $($Family($Family<D>)),*
        }

        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(super) enum Family { Flat, FlatPositive, $($Family),* }

        impl Family {
            /// The prior of this name, and how many arguments it takes.
            pub(super) fn of(name: &str) -> Option<(Self, usize)> {
                match name {
                    "Flat" => Some((Self::Flat, 0)),
                    "FlatPositive" => Some((Self::FlatPositive, 0)),
                    $(stringify!($Family) => {
                        Some((Self::$Family, [$(stringify!($argument)),*].len()))
                    })*
                    _ => None,
                }
            }

            fn at<D: Real>(self, arguments: [D; MOST]) -> One<D> {
                match self {
                    Self::Flat => One::Flat(Flat),
                    Self::FlatPositive => One::FlatPositive(FlatPositive),
                    $(Self::$Family => {
                        let [$($argument,)* ..] = arguments;
                        One::$Family($Family { $($argument),* })
                    })*
                }
            }
        }

        /// What `$of` is, as `$dist`.
        macro_rules! each {
            ($of:expr, $dist:ident => $e:expr) => {
                match $of {
                    One::Flat($dist) => $e,
                    One::FlatPositive($dist) => $e,
                    $(One::$Family($dist) => $e,)*
                }
            };
        }
    };
}
families! {
    Normal(mu, sd)
    StudentT(nu, mu, sd)
    Cauchy(mu, scale)
    Laplace(mu, scale)
    LogNormal(mu, sd)
    Gamma(shape, rate)
    Exponential(rate)
    HalfNormal(sd)
    HalfCauchy(scale)
    HalfStudentT(nu, sd)
    InvGamma(shape, scale)
    Beta(a, b)
    Uniform(lower, upper)
    TruncatedNormal(mu, sd, lower, upper)
    FlatBetween(lower, upper)
}

impl<D: Real> Dist<D> for One<D> {
    fn support(&self) -> Support {
        each!(self, dist => Dist::<D>::support(dist))
    }
    fn constrain(&self, u: D) -> D {
        each!(self, dist => dist.constrain(u))
    }
    fn unconstrain(&self, x: f64) -> f64 {
        each!(self, dist => Dist::<D>::unconstrain(dist, x))
    }
    fn ln_kernel(&self, u: D, x: D) -> D {
        each!(self, dist => dist.ln_kernel(u, x))
    }
    fn ln_norm(&self) -> D {
        each!(self, dist => dist.ln_norm())
    }
    fn centre(&self) -> f64 {
        each!(self, dist => Dist::<D>::centre(dist))
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        each!(self, dist => Dist::<D>::sample(dist, rng))
    }
    fn gaussian(&self) -> Option<Gaussian> {
        each!(self, dist => Dist::<D>::gaussian(dist))
    }
    fn at_deviation(&self, z: D) -> Option<D> {
        each!(self, dist => dist.at_deviation(z))
    }
    fn is_flat(&self) -> bool {
        each!(self, dist => Dist::<D>::is_flat(dist))
    }
}

impl Family {
    /// Whether [`Ordered`] takes it.
    pub(super) fn is_on_the_real_line(self) -> bool {
        matches!(self, Self::Normal | Self::StudentT | Self::Cauchy | Self::Laplace)
    }
}

/// A prior of a whole vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Whole {
    Dirichlet,
    LkjCholesky,
    SumToZero,
    Ordered(Family),
}

#[derive(Clone, Copy, Debug)]
enum Vector<D> {
    Dirichlet(Dirichlet<D, 1>),
    LkjCholesky(LkjCholesky<D>),
    SumToZero(SumToZero<D>),
    OrderedNormal(Ordered<Normal<D>>),
    OrderedStudentT(Ordered<StudentT<D>>),
    OrderedCauchy(Ordered<Cauchy<D>>),
    OrderedLaplace(Ordered<Laplace<D>>),
}

impl Whole {
    fn at<D: Real>(self, arguments: [D; MOST]) -> Vector<D> {
        let [a, ..] = arguments;
        match self {
            Self::Dirichlet => Vector::Dirichlet(Dirichlet { concentration: [a] }),
            Self::LkjCholesky => Vector::LkjCholesky(LkjCholesky { eta: a }),
            Self::SumToZero => Vector::SumToZero(SumToZero { sd: a }),
            Self::Ordered(family) => match family.at(arguments) {
                One::Normal(own) => Vector::OrderedNormal(Ordered(own)),
                One::StudentT(own) => Vector::OrderedStudentT(Ordered(own)),
                One::Cauchy(own) => Vector::OrderedCauchy(Ordered(own)),
                One::Laplace(own) => Vector::OrderedLaplace(Ordered(own)),
                _ => unreachable!("it is read only of priors on the real line"),
            },
        }
    }
}

macro_rules! each_vector {
    ($of:expr, $own:ident => $e:expr) => {
        match $of {
            Vector::Dirichlet($own) => $e,
            Vector::LkjCholesky($own) => $e,
            Vector::SumToZero($own) => $e,
            Vector::OrderedNormal($own) => $e,
            Vector::OrderedStudentT($own) => $e,
            Vector::OrderedCauchy($own) => $e,
            Vector::OrderedLaplace($own) => $e,
        }
    };
}

impl<D: Real> Sequence<D> for Vector<D> {
    fn support(&self) -> Support {
        each_vector!(self, own => Sequence::<D>::support(own))
    }
    fn n_unknowns(&self, n: usize) -> usize {
        each_vector!(self, own => Sequence::<D>::n_unknowns(own, n))
    }
    fn length(&self, n: usize) -> usize {
        each_vector!(self, own => Sequence::<D>::length(own, n))
    }
    fn n_carry(&self, n: usize) -> usize {
        each_vector!(self, own => Sequence::<D>::n_carry(own, n))
    }
    fn begin(&self) -> f64 {
        each_vector!(self, own => Sequence::<D>::begin(own))
    }
    fn step(&self, i: usize, n: usize, u: D, carry: &mut [D]) -> Step<D> {
        each_vector!(self, own => own.step(i, n, u, carry))
    }
    fn unconstrain(&self, i: usize, n: usize, x: f64, carry: &[f64]) -> f64 {
        each_vector!(self, own => Sequence::<D>::unconstrain(own, i, n, x, carry))
    }
    fn ln_norm(&self, n: usize) -> D {
        each_vector!(self, own => own.ln_norm(n))
    }
    fn initial(&self, i: usize) -> f64 {
        each_vector!(self, own => Sequence::<D>::initial(own, i))
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        each_vector!(self, own => Sequence::<D>::sample(own, n, rng))
    }
}

/// A prior, of one number or of a vector, with its arguments.
#[derive(Clone, Debug)]
pub(super) struct Prior<F> {
    pub(super) mentions: Names,
    pub(super) family: F,
    pub(super) program: Arc<Program>,
    pub(super) plain: Arc<[f64]>,
    pub(super) arguments: Vec<Value>,
}

impl<F> Prior<F> {
    /// Its arguments.
    fn at<T: Real>(&self, s: &[Num<T>]) -> [Num<T>; MOST] {
        let mut numbers = Registers::<T, 1>::new();
        numbers.extend(s[..self.program.n].iter().map(|x| [*x]));
        self.program.run([&self.plain], &mut numbers);
        let of = Numbers { numbers: &numbers, plain: [&self.plain] };
        let argument = |i: usize| self.arguments.get(i).map_or(Num::from(0.0), |x| of.of(*x, 0));
        std::array::from_fn(argument)
    }
}

impl<const N: usize> PriorFn<N> for Prior<Family> {
    fn prior<T: Real>(&self, s: [Num<T>; N]) -> impl Dist<Num<T>> + use<T, N> {
        self.family.at(self.at(&s))
    }
}

impl<const N: usize> SequenceFn<N> for Prior<Whole> {
    fn sequence<T: Real>(&self, s: [Num<T>; N]) -> impl Sequence<Num<T>> + use<T, N> {
        self.family.at(self.at(&s))
    }
}

/// At most so many numbers does a prior, a kernel or an amplitude mention. One that mentions fewer gets zeros for the
/// rest, and passes them over.
pub(super) const WIDEST: usize = 4;

fn shipped<F: PriorFn<0>>(of: F) -> AnyPrior {
    prior::<F, 0, 1>(&[], of)
}

impl Prior<Family> {
    /// The prior as an object: of plain numbers, the one that the library has compiled.
    pub(super) fn object(&self) -> AnyPrior {
        if self.program.n == 0 {
            return each!(self.family.at(self.at::<f64>(&[])), own => shipped(own));
        }
        match self.program.n {
            1 | 2 => prior::<_, 2, 3>(self.mentions, self.clone()),
            _ => prior::<_, WIDEST, { WIDEST + 1 }>(self.mentions, self.clone()),
        }
    }
}
