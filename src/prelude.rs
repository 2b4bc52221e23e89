//! What a model file sees: `use eplat::prelude::*;`.

pub use crate::dist::{
    Beta, Cauchy, Dirichlet, Dist, Exponential, Flat, FlatBetween, FlatPositive, Gamma, HalfCauchy,
    HalfNormal, HalfStudentT, InvGamma, Laplace, LogNormal, Normal, Ordered, RealLine, StudentT,
    Support, TruncatedNormal, Uniform, ln_gamma, ln_logistic, logistic,
};
pub use crate::field::{Kernel, Matern12, Matern32, Matern52, Rbf, authors};
pub use crate::likelihood::{
    BernoulliLogit, BinomialLogit, Bracket, Count, Interval, Likelihood, Mixture, NegBinomialLog,
    Number, Observation, OrderedLogit, Outliers, PoissonLog, TopHat, Widened,
};
pub use eplat_macros::model;
pub use crate::num::{Num, Real, ln_sum_exp};
pub use crate::surrogate;
pub use rand::{Rng, RngExt};
pub use rand_distr;
