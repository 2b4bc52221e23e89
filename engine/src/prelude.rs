//! What a model file sees: `use eplat::prelude::*;`.

pub use crate::dist::{
    Beta, Cauchy, CholeskyFactor, Dirichlet, Dist, Exponential, Flat, FlatBetween, FlatPositive,
    Gamma, HalfCauchy, HalfNormal, HalfStudentT, InvGamma, Laplace, LkjCholesky, LogNormal,
    MultivariateNormal, Normal, Ordered, RealLine, Sequence, Step, StudentT, SumToZero, Support,
    TruncatedNormal, Uniform, cholesky, correlation_cholesky, ln_gamma, ln_logistic, logistic,
};
pub use crate::field::{Covariance, Kernel, Matern12, Matern32, Matern52, Rbf, authors};
pub use crate::likelihood::{
    BernoulliLogit, BinomialLogit, Bracket, Censored, Count, Interval, Likelihood, Mixture,
    NegBinomialLog, Number, Observation, OrderedLogit, Outliers, PoissonLog, TopHat, Widened,
};
pub use crate::model::{
    Adjoints, EffectForm, Everywhere, Memo, Operands, Operator, forms, operator_error,
};
pub use crate::num::functions::{abs, cos, exp, ln, log10, max, min, pow, sin, sqrt, tan, tanh};
pub use crate::num::{Argument, Num, Real, ln_sum_exp};
pub use crate::surrogate;
pub use crate::table::Measurements;
pub use eplat_macros::model;
pub use num_dual::DualNum as _;
pub use num_traits::Signed as _;
pub use rand::{Rng, RngExt};
pub use rand_distr;
