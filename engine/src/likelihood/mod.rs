//! Kinds of measurement and their likelihoods.
//!
//! A likelihood compares one [`Observation`] with a few numbers that a model predicts for it.
//! Knows nothing of electrophysiology: a bracket is an interval, whatever was paced.

use rand::Rng;

use crate::num::Real;
use crate::num::lanes::LANES;

mod bracket;
mod censored;
mod counts;
mod interval;
mod mixture;
mod numbers;
mod outliers;
mod top_hat;
mod widened;

pub use bracket::{Bracket, OPEN_STEP};
pub use censored::{Censored, Cumulative};
pub use counts::{BernoulliLogit, BinomialLogit, NegBinomialLog, OrderedLogit, PoissonLog};
pub use interval::Interval;
pub use mixture::Mixture;
pub use outliers::Outliers;
pub use top_hat::TopHat;
pub(crate) use widened::NOT_WIDENED;
pub use widened::Widened;

/// How a measurement is read from a row of a table.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a kind of measurement",
    label = "expected Bracket, Number or Count"
)]
pub trait Observation: Copy + std::fmt::Debug + Send + Sync + 'static {
    /// Columns that hold it. For the column `value`, a column with the name of the `observe`
    /// statement will do, too.
    const COLUMNS: &'static [&'static str];
    /// The measurement from the values of [`Self::COLUMNS`], which are NaN where a cell is empty.
    /// `None` if nothing was measured.
    ///
    /// # Errors
    /// What is wrong with the values, as a sentence.
    fn read(cells: &[f64]) -> Result<Option<Self>, String>;
    /// The values of [`Self::COLUMNS`].
    fn cells(&self) -> Vec<f64>;
}

/// A likelihood of a measurement of kind `Y`.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a likelihood of a `{Y}`",
    label = "a Bracket takes TopHat(f) or Interval(f, sigma); a Number takes Normal(mu, sd), StudentT, Cauchy, Laplace, LogNormal, Gamma or Exponential, or Censored(Normal(mu, sd), floor); a Count takes PoissonLog(eta), BernoulliLogit(eta), BinomialLogit(n, eta), NegBinomialLog(eta, phi) or OrderedLogit(eta, cut); any of these as Outliers(likelihood, share, sd), Mixture(share, A, B) or, of normal errors, Widened(likelihood, sd)"
)]
pub trait Likelihood<D: Real, Y: Observation> {
    /// Log likelihood of `y`.
    fn ln_likelihood(&self, y: &Y) -> D;
    /// Log likelihoods of several rows, each with its own likelihood and measurement.
    ///
    /// A likelihood should have a version of its own if [`Likelihood::ln_likelihood`] is long: that
    /// of `TopHat` fills vector registers with a number from each row.
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Y); LANES]) -> [D; LANES]
    where
        Self: Sized,
    {
        each(rows, |(likelihood, y)| likelihood.ln_likelihood(y))
    }
    /// A measurement as the protocol behind `like` would give it.
    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y;
    /// As [`Likelihood::simulate`], but the predicted value is spread by a further normal error of
    /// this standard deviation. If [`Likelihood::ln_widened`] does not say how to widen the
    /// likelihood, it is the same as [`Likelihood::simulate`].
    fn simulate_widened(&self, like: &Y, sd: f64, rng: &mut dyn Rng) -> Y {
        let _ = sd;
        self.simulate(like, rng)
    }
    /// Whether [`Likelihood::ln_widened`] says how this likelihood is widened.
    const WIDENS: bool = false;
    /// Log likelihood of `y` if the predicted value were spread by a further normal error of this
    /// variance. Criticism widens a model in this way, and so does the error of an emulator. A
    /// likelihood that does not say how is not widened.
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        let _ = variance;
        self.ln_likelihood(y)
    }
    /// As [`Likelihood::ln_widened`], of several rows: see [`Likelihood::ln_likelihoods`].
    #[inline(always)]
    fn ln_widened_rows(rows: [(Self, &Y, D); LANES]) -> [D; LANES]
    where
        Self: Sized,
    {
        each(rows, |(likelihood, y, variance)| likelihood.ln_widened(y, variance))
    }
    /// The predicted value itself, in the unit of the measurement, if the likelihood has one.
    fn location(&self) -> Option<D> {
        None
    }
    /// Why this likelihood cannot take `y`, if it cannot.
    fn objection(&self, y: &Y) -> Option<&'static str> {
        let _ = y;
        None
    }
}

/// What `of` makes of each lane. The standard library's `map` is not always inlined, and what it calls is then
/// compiled without vector registers.
#[inline(always)]
pub(crate) fn each<T, U>(lanes: [T; LANES], of: impl Fn(T) -> U) -> [U; LANES] {
    let [a, b, c, d] = lanes;
    [of(a), of(b), of(c), of(d)]
}

impl<D: Real, Y: Observation, L: Likelihood<D, Y>> Likelihood<D, Y> for Box<L> {
    const WIDENS: bool = L::WIDENS;
    fn ln_likelihood(&self, y: &Y) -> D {
        L::ln_likelihood(self, y)
    }
    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y {
        L::simulate(self, like, rng)
    }
    fn simulate_widened(&self, like: &Y, sd: f64, rng: &mut dyn Rng) -> Y {
        L::simulate_widened(self, like, sd, rng)
    }
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        L::ln_widened(self, y, variance)
    }
    fn location(&self) -> Option<D> {
        L::location(self)
    }
    fn objection(&self, y: &Y) -> Option<&'static str> {
        L::objection(self, y)
    }
}

/// A plain number.
pub type Number = f64;

/// A count, or 0 and 1 for an event.
pub type Count = u32;

impl Observation for f64 {
    const COLUMNS: &'static [&'static str] = &["value"];
    fn read(cells: &[f64]) -> Result<Option<Self>, String> {
        if cells[0].is_infinite() {
            return Err(format!("expected a finite number, got {}", cells[0]));
        }
        Ok(Some(cells[0]).filter(|x| !x.is_nan()))
    }
    fn cells(&self) -> Vec<f64> {
        vec![*self]
    }
}

impl Observation for u32 {
    const COLUMNS: &'static [&'static str] = &["value"];
    fn read(cells: &[f64]) -> Result<Option<Self>, String> {
        let x = cells[0];
        if x.is_nan() {
            return Ok(None);
        }
        if x < 0.0 || x.fract() != 0.0 || x > f64::from(u32::MAX) {
            return Err(format!("expected a count (0, 1, 2, …), got {x}"));
        }
        Ok(Some(x as Self))
    }
    fn cells(&self) -> Vec<f64> {
        vec![f64::from(*self)]
    }
}
