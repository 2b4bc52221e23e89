//! GARCH(1, 1): a time series whose spread follows how far it strayed before.
//!
//! `eplat run models/garch.rs --data FILE.csv`, where FILE.csv has a column `y`, a row per time. Shows a
//! log density written by hand that goes through the rows in their order, and bounds that depend on
//! another parameter. With flat priors: the density of posteriordb's `garch-garch11`.
use eplat::prelude::*;

/// Standard deviation of the first value.
const FIRST_SD: f64 = 0.5;

model! {
    /// The variance of each value is `alpha0 + alpha1 deviation² + beta1 variance` of the one before.
    model Garch;

    /// The series, in order of time.
    column y;

    param mu ~ Flat;
    param alpha0 ~ FlatPositive;
    param alpha1 ~ FlatBetween(0.0, 1.0);
    /// `alpha1 + beta1 < 1`: a variance that stays finite.
    param beta1 ~ FlatBetween(0.0, -alpha1 + 1.0);

    density series(data) = garch(mu, alpha0, alpha1, beta1, data.y);
}

/// The log density of each value, given those before it.
fn garch<D: Real>(mu: D, alpha0: D, alpha1: D, beta1: D, y: &[f64]) -> Vec<D> {
    let mut variance = D::from(FIRST_SD * FIRST_SD);
    let mut step = |y: &f64| {
        let term = Normal(mu, sqrt(variance)).ln_likelihood(y);
        variance = alpha0 + alpha1 * (mu - *y).powi(2) + beta1 * variance;
        term
    };
    y.iter().map(&mut step).collect()
}
