//! What a model file sees: `use eplat::prelude::*;`.

pub use crate::dist::{
    Beta, Dirichlet, Dist, Exponential, Flat, Gamma, HalfCauchy, HalfNormal, InvGamma, LogNormal,
    Normal, Ordered, RealLine, StudentT, Support, Uniform, ln_gamma, ln_logistic, logistic,
};
pub use crate::field::{Kernel, Matern12, Matern32, Matern52, Rbf, authors};
pub use crate::likelihood::{
    BernoulliLogit, Bracket, Count, Interval, Likelihood, Number, Observation, PoissonLog, TopHat,
};
pub use crate::model;
pub use crate::num::Real;
pub use crate::surrogate;
pub use rand::{Rng, RngExt};
pub use rand_distr;
