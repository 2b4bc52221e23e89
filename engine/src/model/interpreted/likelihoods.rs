//! Likelihoods of an interpreted model: those that ship, with their arguments.

use num_dual::DualStruct as _;
use rand::Rng;

use super::program::{Numbers, Value};
use crate::dist::{Cauchy, Exponential, Gamma, Laplace, LogNormal, Normal, StudentT};
use crate::likelihood::{
    BernoulliLogit, BinomialLogit, Bracket, Censored, Count, Interval, Likelihood, Mixture,
    NegBinomialLog, Number, Observation, Outliers, PoissonLog, TopHat, Widened,
};
use crate::num::lanes::LANES;
use crate::num::{Num, Real};

/// At most so many arguments has a likelihood that stands around no other.
pub(super) const MOST: usize = 3;

/// A likelihood as written.
#[derive(Clone, Debug)]
pub(super) enum Written {
    /// One of the table below, with its arguments.
    Plain(Word, [Value; MOST]),
    /// `Outliers(…, share, sd)`
    Outliers(Box<Self>, u32, u32),
    /// `Widened(…, sd)`
    Widened(Box<Self>, Value),
    /// `Mixture(share, …, …)`
    Mixture(Value, Box<Self>, Box<Self>),
}

/// What an argument must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Takes {
    /// A number of any kind.
    Any,
    /// One with derivatives.
    Derivatives,
    /// One without.
    Plain,
}

use Takes::{Any, Derivatives, Plain};

macro_rules! words {
    ($($Kind:ident $Own:ident { $($Word:ident $widens:literal [$($takes:ident),*] $arguments:pat => $T:ty: $e:expr;)* })*) => {
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(super) enum Word { $($($Word,)*)* }

        impl Word {
            /// The likelihood of this name, and what its arguments are.
            pub(super) fn of(kind: &str, name: &str) -> Option<(Self, &'static [Takes])> {
                match (kind, name) {
                    $($((stringify!($Kind), stringify!($Word)) => {
                        Some((Self::$Word, &[$($takes),*]))
                    })*)*
                    _ => None,
                }
            }

            /// Whether a further normal error widens it.
            pub(super) fn widens(self) -> bool {
                match self { $($(Self::$Word => $widens,)*)* }
            }
        }

        $(
            /// Likelihoods of this kind that stand around no other.
            #[derive(Clone, Copy, Debug)]
            pub(super) enum $Own<D> { $($Word($T),)* }

            impl<D: Real> Likelihood<D, $Kind> for $Own<D> {
                const WIDENS: bool = true;
                fn ln_likelihood(&self, y: &$Kind) -> D {
                    match self { $(Self::$Word(own) => own.ln_likelihood(y),)* }
                }
                fn simulate(&self, like: &$Kind, rng: &mut dyn Rng) -> $Kind {
                    match self { $(Self::$Word(own) => own.simulate(like, rng),)* }
                }
                fn simulate_widened(&self, like: &$Kind, sd: f64, rng: &mut dyn Rng) -> $Kind {
                    match self { $(Self::$Word(own) => own.simulate_widened(like, sd, rng),)* }
                }
                fn ln_widened(&self, y: &$Kind, variance: D) -> D {
                    match self { $(Self::$Word(own) => own.ln_widened(y, variance),)* }
                }
                fn location(&self) -> Option<D> {
                    match self { $(Self::$Word(own) => Likelihood::<D, $Kind>::location(own),)* }
                }
                fn objection(&self, y: &$Kind) -> Option<&'static str> {
                    match self { $(Self::$Word(own) => Likelihood::<D, $Kind>::objection(own, y),)* }
                }
            }

            impl Kind for $Kind {
                type Own<D: Real> = $Own<D>;
                fn computed(x: f64) -> Option<Self> {
                    (&x as &dyn std::any::Any).downcast_ref().copied()
                }
                #[inline(always)]
                fn own<T: Real>(word: Word, numbers: [Num<T>; MOST]) -> $Own<Num<T>> {
                    match word {
                        $(Word::$Word => {
                            let $arguments = numbers;
                            $Own::$Word($e)
                        })*
                        _ => unreachable!("it is read only of the words of this kind"),
                    }
                }
                #[inline(always)]
                fn ln_likelihoods<T: Real>(
                    word: Word,
                    numbers: impl Fn(usize) -> [Num<T>; MOST],
                    y: [&$Kind; LANES],
                ) -> [Num<T>; LANES] {
                    match word {
                        $(Word::$Word => {
                            let row = |lane: usize| {
                                let $arguments = numbers(lane);
                                ($e, y[lane])
                            };
                            Likelihood::ln_likelihoods([row(0), row(1), row(2), row(3)])
                        })*
                        _ => unreachable!("it is read only of the words of this kind"),
                    }
                }
                #[inline(always)]
                fn ln_widened<T: Real>(
                    word: Word,
                    numbers: impl Fn(usize) -> ([Num<T>; MOST], Num<T>),
                    y: [&$Kind; LANES],
                ) -> [Num<T>; LANES] {
                    match word {
                        $(Word::$Word => {
                            let row = |lane: usize| {
                                let ($arguments, variance) = numbers(lane);
                                ($e, y[lane], variance)
                            };
                            Likelihood::ln_widened_rows([row(0), row(1), row(2), row(3)])
                        })*
                        _ => unreachable!("it is read only of the words of this kind"),
                    }
                }
            }
        )*
    };
}

words! {
    Bracket Brackets {
        TopHat true [Derivatives] [f, ..] => TopHat<D>: TopHat(f);
        Interval true [Any, Any] [f, sigma, ..] => Interval<D>: Interval { f, sigma };
    }
    Number Plains {
        Normal true [Any, Any] [mu, sd, ..] => Normal<D>: Normal { mu, sd };
        StudentT false [Any, Any, Any] [nu, mu, sd] => StudentT<D>: StudentT { nu, mu, sd };
        Cauchy false [Any, Any] [mu, scale, ..] => Cauchy<D>: Cauchy { mu, scale };
        Laplace false [Any, Any] [mu, scale, ..] => Laplace<D>: Laplace { mu, scale };
        LogNormal false [Any, Any] [mu, sd, ..] => LogNormal<D>: LogNormal { mu, sd };
        Gamma false [Any, Any] [shape, rate, ..] => Gamma<D>: Gamma { shape, rate };
        Exponential false [Any] [rate, ..] => Exponential<D>: Exponential { rate };
        CensoredNormal true [Any, Any, Plain] [mu, sd, floor] => Censored<Normal<D>>:
            Censored { inner: Normal { mu, sd }, floor: floor.re() };
        CensoredLogNormal false [Any, Any, Plain] [mu, sd, floor] => Censored<LogNormal<D>>:
            Censored { inner: LogNormal { mu, sd }, floor: floor.re() };
    }
    Count Counts {
        PoissonLog false [Derivatives] [eta, ..] => PoissonLog<D>: PoissonLog(eta);
        BernoulliLogit false [Derivatives] [eta, ..] => BernoulliLogit<D>: BernoulliLogit(eta);
        BinomialLogit false [Plain, Derivatives] [n, eta, ..] => BinomialLogit<D>: BinomialLogit(n.re(), eta);
        NegBinomialLog false [Derivatives, Derivatives] [eta, phi, ..] => NegBinomialLog<D>: NegBinomialLog(eta, phi);
    }
}

/// A kind of measurement, with the likelihoods that it takes.
pub(super) trait Kind: Observation {
    /// Likelihoods that stand around no other.
    type Own<D: Real>: Likelihood<D, Self> + Copy;
    /// A measurement that is computed, for kinds that are numbers.
    fn computed(x: f64) -> Option<Self>;
    /// One of these.
    fn own<T: Real>(word: Word, arguments: [Num<T>; MOST]) -> Self::Own<Num<T>>;
    /// Log likelihoods of several rows by one of these.
    fn ln_likelihoods<T: Real>(
        word: Word,
        numbers: impl Fn(usize) -> [Num<T>; MOST],
        y: [&Self; LANES],
    ) -> [Num<T>; LANES];
    /// The same where each has a further normal error of this variance.
    fn ln_widened<T: Real>(
        word: Word,
        numbers: impl Fn(usize) -> ([Num<T>; MOST], Num<T>),
        y: [&Self; LANES],
    ) -> [Num<T>; LANES];
}

/// A likelihood, one that stands around others or not.
#[derive(Clone, Debug)]
pub(super) enum Tree<D, L> {
    Own(L),
    Outliers(Outliers<Box<Self>>),
    Widened(Widened<D, Box<Self>>),
    Mixture(Mixture<D, Box<Self>, Box<Self>>),
}

macro_rules! each {
    ($of:expr, $own:ident => $e:expr) => {
        match $of {
            Tree::Own($own) => $e,
            Tree::Outliers($own) => $e,
            Tree::Widened($own) => $e,
            Tree::Mixture($own) => $e,
        }
    };
}

/// What cannot be widened is not read inside what widens, so that each tree may say that it can.
impl<D: Real, Y: Observation, L: Likelihood<D, Y> + Copy> Likelihood<D, Y> for Tree<D, L> {
    const WIDENS: bool = true;
    fn ln_likelihood(&self, y: &Y) -> D {
        each!(self, own => own.ln_likelihood(y))
    }
    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y {
        each!(self, own => Likelihood::<D, Y>::simulate(own, like, rng))
    }
    fn simulate_widened(&self, like: &Y, sd: f64, rng: &mut dyn Rng) -> Y {
        each!(self, own => Likelihood::<D, Y>::simulate_widened(own, like, sd, rng))
    }
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        each!(self, own => own.ln_widened(y, variance))
    }
    fn location(&self) -> Option<D> {
        each!(self, own => Likelihood::<D, Y>::location(own))
    }
    fn objection(&self, y: &Y) -> Option<&'static str> {
        each!(self, own => Likelihood::<D, Y>::objection(own, y))
    }
}

impl Written {
    /// Whether a further normal error widens it.
    pub(super) fn widens(&self) -> bool {
        match self {
            Self::Plain(word, _) => word.widens(),
            Self::Outliers(inner, ..) | Self::Widened(inner, _) => inner.widens(),
            Self::Mixture(..) => false,
        }
    }

    /// The likelihood at the numbers of a lane.
    pub(super) fn at<Y: Kind, T: Real, const L: usize>(
        &self,
        of: Numbers<'_, T, L>,
        lane: usize,
    ) -> Tree<Num<T>, Y::Own<Num<T>>> {
        let inner = |inner: &Self| Box::new(inner.at::<Y, T, L>(of, lane));
        match self {
            Self::Plain(word, arguments) => Tree::Own(Y::own(*word, all(of, arguments, lane))),
            Self::Outliers(own, share, sd) => {
                let (share, sd) = (of.plain(*share, lane), of.plain(*sd, lane));
                Tree::Outliers(Outliers { inner: inner(own), share, sd })
            }
            Self::Widened(own, sd) => {
                Tree::Widened(Widened { inner: inner(own), sd: of.of(*sd, lane) })
            }
            Self::Mixture(share, a, b) => {
                Tree::Mixture(Mixture(of.of(*share, lane), inner(a), inner(b)))
            }
        }
    }

    /// What is inside of all that widens it.
    fn inmost(&self) -> &Self {
        match self {
            Self::Widened(inner, _) => inner.inmost(),
            other => other,
        }
    }

    /// The variance by which [`Self::inmost`] is widened, in a lane.
    #[inline(always)]
    fn variance<T: Real, const L: usize>(&self, of: Numbers<'_, T, L>, lane: usize) -> Num<T> {
        let (mut own, mut variance) = (self, Num::from(0.0));
        while let Self::Widened(inner, sd) = own {
            let sd = of.of(*sd, lane);
            (own, variance) = (inner, variance + sd * sd);
        }
        variance
    }

    /// Log likelihoods of these rows, one in each lane.
    #[inline(always)]
    pub(super) fn ln_likelihoods<Y: Kind, T: Real>(
        &self,
        of: Numbers<'_, T, LANES>,
        y: [&Y; LANES],
    ) -> [Num<T>; LANES] {
        if let Self::Plain(word, arguments) = self {
            return Y::ln_likelihoods(*word, |lane| all(of, arguments, lane), y);
        }
        if let Self::Plain(word, arguments) = self.inmost() {
            let row = |lane| (all(of, arguments, lane), self.variance(of, lane));
            return Y::ln_widened(*word, row, y);
        }
        let mut out = [Num::from(0.0); LANES];
        for lane in 0..LANES {
            out[lane] = self.at::<Y, T, LANES>(of, lane).ln_likelihood(y[lane]);
        }
        out
    }
}

/// The numbers of these arguments in a lane.
#[inline(always)]
fn all<T: Real, const L: usize>(
    of: Numbers<'_, T, L>,
    [a, b, c]: &[Value; MOST],
    lane: usize,
) -> [Num<T>; MOST] {
    [of.of(*a, lane), of.of(*b, lane), of.of(*c, lane)]
}
