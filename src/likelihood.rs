//! Kinds of measurement and their likelihoods.
//!
//! A likelihood compares one [`Observation`] with a few numbers that a model predicts for it.
//! Knows nothing of electrophysiology: a bracket is an interval, whatever was paced.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use crate::dist::{Normal, ln_gamma, ln_logistic, ln_normal_below, ln_normal_between, logistic};
use crate::num::lanes::{self, LANES};
use crate::num::{Argument, LN_SQRT_2PI, Real};

mod counts;
mod mixture;
mod numbers;
mod outliers;
mod widened;
pub use counts::{BinomialLogit, NegBinomialLog, OrderedLogit};
pub use mixture::Mixture;
pub use outliers::Outliers;
pub use widened::Widened;

/// How a measurement is read from a row of a table.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a kind of measurement",
    label = "expected Bracket, Number or Count"
)]
pub trait Observation: Copy + std::fmt::Debug + Send + Sync + 'static {
    /// Columns that hold it; the name of the `observe` statement may stand in for `value`.
    const COLUMNS: &'static [&'static str];
    /// From the values of [`Self::COLUMNS`], NaN where a cell is empty; `None` if nothing was measured.
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
    label = "a Bracket takes TopHat(f) or Interval(f, sigma); a Number takes Normal(mu, sd), StudentT, Cauchy, Laplace, LogNormal, Gamma or Exponential; a Count takes PoissonLog(eta), BernoulliLogit(eta), BinomialLogit(n, eta), NegBinomialLog(eta, phi) or OrderedLogit(eta, cut); any of these as Outliers(likelihood, share, sd), Mixture(share, A, B) or, of normal errors, Widened(likelihood, sd)"
)]
pub trait Likelihood<D: Real, Y: Observation> {
    /// Log likelihood of `y`.
    fn ln_likelihood(&self, y: &Y) -> D;
    /// Log likelihoods of several rows, each with its own likelihood and measurement.
    ///
    /// Worth writing where [`Likelihood::ln_likelihood`] is long: `TopHat`'s fills vector registers with
    /// a number from each row.
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Y); LANES]) -> [D; LANES]
    where
        Self: Sized,
    {
        rows.map(|(likelihood, y)| likelihood.ln_likelihood(y))
    }
    /// A measurement as the protocol behind `like` would give it.
    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y;
    /// As [`Likelihood::simulate`], if the predicted value were spread by a further normal error of this
    /// standard deviation; as there where [`Likelihood::ln_widened`] does not say how.
    fn simulate_widened(&self, like: &Y, sd: f64, rng: &mut dyn Rng) -> Y {
        let _ = sd;
        self.simulate(like, rng)
    }
    /// Whether [`Likelihood::ln_widened`] says how this likelihood is widened.
    const WIDENS: bool = false;
    /// Log likelihood of `y` if the predicted value were spread by a further normal error of this
    /// variance: what criticism widens a model by, and the error of an emulator. A likelihood that does not
    /// say how is not widened.
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        let _ = variance;
        self.ln_likelihood(y)
    }
    /// The predicted value itself, in the unit of the measurement, if the likelihood has one.
    fn location(&self) -> Option<f64> {
        None
    }
    /// Why this likelihood cannot take `y`, if it cannot.
    fn objection(&self, y: &Y) -> Option<&'static str> {
        let _ = y;
        None
    }
}

/// A value known only to lie between `lower` and `upper`; either end may be infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket {
    /// Lower end; −∞ if captured at every interval tried.
    pub lower: f64,
    /// Upper end; ∞ if never captured.
    pub upper: f64,
    inverse_s: f64,
    last: f64,
    ln_norm: f64,
}

impl Bracket {
    /// The bracket `[lower, upper]`, in sub-intervals as near to 1 as fit (for [`TopHat`]).
    ///
    /// # Errors
    /// `upper ≤ lower`, or both ends open.
    pub fn new(lower: f64, upper: f64) -> Result<Self, String> {
        if upper <= lower {
            return Err(format!("upper ({upper}) must be greater than lower ({lower})"));
        }
        if lower.is_nan() || upper.is_nan() || (lower.is_infinite() && upper.is_infinite()) {
            return Err(format!("[{lower}, {upper}] is not a bracket"));
        }
        let width = upper - lower;
        let n = width.round().max(1.0);
        let ln_norm = -width.ln() - LN_SQRT_2PI;
        Ok(Self { lower, upper, inverse_s: n / width, last: n - 1.0, ln_norm })
    }

    /// The bracket that contains `value` on the grid of a protocol that gave `self`.
    ///
    /// An open bracket says where the protocol ended: values on its open side stay in it, others get
    /// a bracket of width `step` counted from its closed end.
    fn containing(&self, value: f64, step: f64) -> Self {
        let width =
            if (self.upper - self.lower).is_finite() { self.upper - self.lower } else { step };
        let origin = if self.lower.is_finite() { self.lower } else { self.upper };
        let lower = origin + ((value - origin) / width).floor() * width;
        Self::new(lower, lower + width).unwrap_or(*self)
    }

    fn is_open(&self) -> bool {
        self.lower.is_infinite() || self.upper.is_infinite()
    }
}

/// Step assumed for a protocol of which only an open bracket is known, ms.
const OPEN_STEP: f64 = 10.0;

impl Observation for Bracket {
    const COLUMNS: &'static [&'static str] = &["lower", "upper"];
    fn read(cells: &[f64]) -> Result<Option<Self>, String> {
        if cells[0].is_nan() && cells[1].is_nan() {
            return Ok(None);
        }
        let open = |x: f64, end: f64| if x.is_nan() { end } else { x };
        let (lower, upper) = (open(cells[0], f64::NEG_INFINITY), open(cells[1], f64::INFINITY));
        Self::new(lower, upper).map(Some)
    }
    fn cells(&self) -> Vec<f64> {
        vec![self.lower, self.upper]
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

/// Log likelihood of a value known only to lie in a bracket: a smoothed top-hat.
///
/// ```text
/// ln (1/N) Σᵢ Normal(f; cᵢ, s),   cᵢ = lower + (i − ½) s,   s = width / N,   N = width / 1 ms
/// ```
/// Finite for every finite `f`, and integrates to 1 over `f`. Needs both ends of the bracket.
///
/// # Source
/// Coveney et al. 2022, Methods, "Bayesian calibration"
#[derive(Clone, Copy, Debug)]
pub struct TopHat<D>(
    /// The predicted value, in the unit of the bracket.
    pub D,
);

/// `e^(−m²/2)` for m = 1 … 8; a ninth neighbour would add 2e-18.
const GAUSS: [f64; 8] = [
    0.606_530_659_712_633_4,
    0.135_335_283_236_612_7,
    0.011_108_996_538_242_306,
    0.000_335_462_627_902_511_85,
    3.726_653_172_078_671e-6,
    1.522_997_974_471_263e-8,
    2.289_734_845_645_553e-11,
    1.266_416_554_909_417_6e-14,
];

impl TopHat<f64> {
    /// Log likelihood and its first two derivatives in `f`.
    ///
    /// With `z = (f − c_j)/s` at the nearest centre j the terms are `e^(−z²/2) e^(mz − m²/2)`,
    /// `m = i − j`: a geometric recurrence outwards, two exponentials in all. If m is drawn with
    /// these weights the derivatives in z are `E m − z` and `Var m − 1`.
    #[inline(always)]
    fn terms(f: f64, y: &Bracket) -> [f64; 3] {
        let x = (f - y.lower) * y.inverse_s - 0.5;
        let j = lanes::within(x.round_ties_even(), 0.0, y.last);
        let z = x - j;
        let step = lanes::exp(lanes::within(z, -40.0, 40.0)); // beyond, neighbours weigh nothing
        let steps = [step, step.recip()];
        let (mut t, n) = ([1.0; 2], [y.last - j, j]);
        let [mut s0, mut s1, mut s2] = [1.0, 0.0, 0.0];
        for (i, gauss) in GAUSS.iter().enumerate() {
            let m = (i + 1) as f64;
            let mut weight = [0.0; 2];
            for side in 0..2 {
                t[side] *= steps[side];
                weight[side] = if m <= n[side] { t[side] * gauss } else { 0.0 };
            }
            let [above, below] = weight;
            s0 += above + below;
            s1 += m * (above - below);
            s2 += m * m * (above + below);
        }
        let (mean, s) = (s1 / s0, y.inverse_s);
        let value = lanes::ln(s0) - 0.5 * z * z + y.ln_norm;
        [value, (mean - z) * s, (s2 / s0 - mean * mean - 1.0) * s * s]
    }
}

impl TopHat<f64> {
    /// [`TopHat::terms`], not inlined: compiled with eplat, not again with every model.
    #[inline(never)]
    fn terms_of_one(f: f64, y: &Bracket) -> [f64; 3] {
        TopHat::terms(f, y)
    }
}

impl<D: Real> Likelihood<D, Bracket> for TopHat<D> {
    const WIDENS: bool = true;
    fn ln_likelihood(&self, y: &Bracket) -> D {
        let [f, df, d2f] = TopHat::terms_of_one(self.0.re(), y);
        self.0.chain(f, df, d2f)
    }
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Bracket); LANES]) -> [D; LANES] {
        let (mut f, mut y) = ([0.0; LANES], [*rows[0].1; LANES]);
        for lane in 0..LANES {
            (f[lane], y[lane]) = (rows[lane].0.0.re(), *rows[lane].1);
        }
        let [mut value, mut slope, mut curvature] = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            [value[lane], slope[lane], curvature[lane]] = TopHat::terms(f[lane], &y[lane]);
        }
        let mut out = [D::from(0.0); LANES];
        for lane in 0..LANES {
            out[lane] = rows[lane].0.0.chain(value[lane], slope[lane], curvature[lane]);
        }
        out
    }
    fn ln_widened(&self, y: &Bracket, variance: D) -> D {
        self.ln_wide(y, variance)
    }
    fn location(&self) -> Option<f64> {
        Some(self.0.re())
    }
    fn simulate(&self, like: &Bracket, _: &mut dyn Rng) -> Bracket {
        like.containing(self.0.re(), OPEN_STEP)
    }
    fn simulate_widened(&self, like: &Bracket, sd: f64, rng: &mut dyn Rng) -> Bracket {
        let error: f64 = rng.sample(StandardNormal);
        like.containing(self.0.re() + sd * error, OPEN_STEP)
    }
    fn objection(&self, y: &Bracket) -> Option<&'static str> {
        y.is_open()
            .then_some("TopHat needs both ends of a bracket; Interval(f, sigma) takes open ones")
    }
}

/// Log probability that a value measured with noise falls into a bracket, exactly.
///
/// ```text
/// ln [Φ((upper − f)/σ) − Φ((lower − f)/σ)]
/// ```
/// No bias at the edges; open ends are natural; stable in both tails.
#[derive(Clone, Copy, Debug)]
pub struct Interval<D> {
    /// The predicted value.
    pub f: D,
    /// Standard deviation of the noise, same unit.
    pub sigma: D,
}

/// See the type [`struct@Interval`].
#[allow(non_snake_case)]
#[inline]
pub fn Interval<D: Real>(f: impl Argument<D>, sigma: impl Argument<D>) -> Interval<D> {
    Interval { f: f.number(), sigma: sigma.number() }
}

impl<D: Real> Likelihood<D, Bracket> for Interval<D> {
    const WIDENS: bool = true;
    #[inline]
    fn ln_likelihood(&self, y: &Bracket) -> D {
        let z = |end: f64| (-self.f + end) / self.sigma;
        match (y.lower.is_finite(), y.upper.is_finite()) {
            (true, true) => ln_normal_between(z(y.lower), z(y.upper)),
            (true, false) => ln_normal_below(-z(y.lower)),
            (false, _) => ln_normal_below(z(y.upper)),
        }
    }
    fn ln_widened(&self, y: &Bracket, variance: D) -> D {
        let sigma = (self.sigma * self.sigma + variance).sqrt();
        Interval { f: self.f, sigma }.ln_likelihood(y)
    }
    fn location(&self) -> Option<f64> {
        Some(self.f.re())
    }
    fn simulate(&self, like: &Bracket, rng: &mut dyn Rng) -> Bracket {
        self.simulate_widened(like, 0.0, rng)
    }
    fn simulate_widened(&self, like: &Bracket, sd: f64, rng: &mut dyn Rng) -> Bracket {
        let noise: f64 = rng.sample(StandardNormal);
        like.containing(self.f.re() + self.sigma.re().hypot(sd) * noise, OPEN_STEP)
    }
}

impl<D: Real> Likelihood<D, f64> for Normal<D> {
    const WIDENS: bool = true;
    #[inline]
    fn ln_likelihood(&self, y: &f64) -> D {
        let z = (self.mu - *y) / self.sd;
        z * z * -0.5 - self.sd.ln() - LN_SQRT_2PI
    }
    fn ln_widened(&self, y: &f64, variance: D) -> D {
        let square = self.sd * self.sd + variance;
        let z = self.mu - *y;
        z * z / square * -0.5 - square.ln() * 0.5 - LN_SQRT_2PI
    }
    fn location(&self) -> Option<f64> {
        Some(self.mu.re())
    }
    fn simulate(&self, like: &f64, rng: &mut dyn Rng) -> f64 {
        self.simulate_widened(like, 0.0, rng)
    }
    fn simulate_widened(&self, _: &f64, sd: f64, rng: &mut dyn Rng) -> f64 {
        let noise: f64 = rng.sample(StandardNormal);
        self.mu.re() + self.sd.re().hypot(sd) * noise
    }
}

/// An event (0 or 1) with log odds `logit`.
#[derive(Clone, Copy, Debug)]
pub struct BernoulliLogit<D>(
    /// Log odds of the event.
    pub D,
);

impl<D: Real> Likelihood<D, u32> for BernoulliLogit<D> {
    #[inline]
    fn ln_likelihood(&self, y: &u32) -> D {
        ln_logistic(if *y == 0 { -self.0 } else { self.0 })
    }
    fn location(&self) -> Option<f64> {
        Some(logistic(self.0.re()))
    }
    fn simulate(&self, _: &u32, rng: &mut dyn Rng) -> u32 {
        u32::from(rng.random_bool(logistic(self.0.re())))
    }
    fn objection(&self, y: &u32) -> Option<&'static str> {
        (*y > 1).then_some("BernoulliLogit takes 0 or 1")
    }
}

/// A count with log rate `log_rate`.
#[derive(Clone, Copy, Debug)]
pub struct PoissonLog<D>(
    /// Natural logarithm of the expected count.
    pub D,
);

impl<D: Real> Likelihood<D, u32> for PoissonLog<D> {
    #[inline]
    fn ln_likelihood(&self, y: &u32) -> D {
        self.0 * f64::from(*y) - self.0.exp() - ln_gamma(f64::from(*y) + 1.0)
    }
    fn simulate(&self, _: &u32, rng: &mut dyn Rng) -> u32 {
        let rate = self.0.re().exp();
        rand_distr::Poisson::new(rate)
            .map_or(u32::MAX, |poisson| rng.sample::<f64, _>(poisson) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, Hyper, derivatives, variable};

    fn bracket(lower: f64, upper: f64) -> Bracket {
        Bracket::new(lower, upper).unwrap()
    }

    /// The paper's sum, term by term.
    fn top_hat_by_definition(f: f64, y: &Bracket) -> f64 {
        let n = (y.upper - y.lower).round();
        let s = (y.upper - y.lower) / n;
        let term = |i: i32| {
            let z = (f - (y.lower + (f64::from(i) - 0.5) * s)) / s;
            (-0.5 * z * z - s.ln() - LN_SQRT_2PI).exp()
        };
        ((1..=n as i32).map(term).sum::<f64>() / n).ln()
    }

    #[test]
    fn top_hat_equals_the_papers_sum() {
        for (lower, upper) in [(200.0, 210.0), (180.0, 220.0), (100.0, 101.0), (3.0, 5.5)] {
            let y = bracket(lower, upper);
            for i in 0..200 {
                let f = lower - 15.0 + 0.37 * f64::from(i);
                let (got, expected) = (TopHat(f).ln_likelihood(&y), top_hat_by_definition(f, &y));
                if expected > -600.0 {
                    assert!(
                        (got - expected).abs() < 1e-12 * (1.0 + expected.abs()),
                        "{f} in {y:?}: {got} {expected}"
                    );
                }
                assert!(got.is_finite());
            }
        }
    }

    #[test]
    fn top_hat_integrates_to_one_and_derivatives_match_differences() {
        let y = bracket(200.0, 210.0);
        let mass: f64 = (0..40_000)
            .map(|i| TopHat(185.0 + 1e-3 * f64::from(i)).ln_likelihood(&y).exp() * 1e-3)
            .sum();
        assert!((mass - 1.0).abs() < 1e-9, "{mass}");
        for f in [150.0, 199.0, 203.3, 209.99, 213.0, 260.0] {
            let value = |f: f64| TopHat(f).ln_likelihood(&y);
            let d = TopHat(variable::<1>(f, 0)).ln_likelihood(&y);
            let h = Hyper::new(f, 1.0, 1.0, 0.0);
            let h = TopHat(h).ln_likelihood(&y);
            let e = 1e-4;
            let first = (value(f + e) - value(f - e)) / (2.0 * e);
            let second = (value(f + e) - 2.0 * value(f) + value(f - e)) / (e * e);
            assert!((derivatives(&d)[0] - first).abs() < 1e-6 * (1.0 + first.abs()), "{f}");
            assert!((h.eps1eps2 - second).abs() < 1e-4, "{f}: {} {second}", h.eps1eps2);
        }
    }

    #[test]
    fn interval_is_exact_in_both_tails_and_with_open_ends() {
        let y = bracket(200.0, 210.0);
        let left = Interval::<f64>(100.0, 2.0).ln_likelihood(&y);
        let right = Interval::<f64>(310.0, 2.0).ln_likelihood(&y);
        assert!((left - right).abs() < 1e-9 * left.abs() && left.is_finite(), "{left} {right}");
        let (closed, below, above) = (
            Interval::<f64>(205.0, 3.0).ln_likelihood(&y).exp(),
            Interval::<f64>(205.0, 3.0).ln_likelihood(&bracket(f64::NEG_INFINITY, 200.0)).exp(),
            Interval::<f64>(205.0, 3.0).ln_likelihood(&bracket(210.0, f64::INFINITY)).exp(),
        );
        assert!((closed + below + above - 1.0).abs() < 1e-14);
    }

    #[test]
    fn interval_derivatives_match_differences() {
        for (lower, upper) in
            [(200.0, 210.0), (f64::NEG_INFINITY, 200.0), (210.0, f64::INFINITY), (150.0, 160.0)]
        {
            let y = bracket(lower, upper);
            let at = |f: f64, s: f64| Interval::<f64>(f, s).ln_likelihood(&y);
            let (f, s, e) = (207.0, 3.0, 1e-3);
            let d = Interval::<Dual<2>>(variable(f, 0), variable(s, 1)).ln_likelihood(&y);
            let by_f = (at(f + e, s) - at(f - e, s)) / (2.0 * e);
            let by_s = (at(f, s + e) - at(f, s - e)) / (2.0 * e);
            let [df, ds] = derivatives(&d);
            assert!((df - by_f).abs() < 1e-5 * (1.0 + by_f.abs()), "{y:?} {df} {by_f}");
            assert!((ds - by_s).abs() < 1e-5 * (1.0 + by_s.abs()), "{y:?} {ds} {by_s}");
            let mixed = (at(f + e, s + e) - at(f + e, s - e) - at(f - e, s + e) + at(f - e, s - e))
                / (4.0 * e * e);
            let h = Interval::<Hyper>(Hyper::new(f, 1.0, 0.0, 0.0), Hyper::new(s, 0.0, 1.0, 0.0));
            let h = h.ln_likelihood(&y).eps1eps2;
            assert!((h - mixed).abs() < 1e-4 * (1.0 + mixed.abs()), "{y:?} {h} {mixed}");
        }
    }

    #[test]
    fn brackets_are_read_with_open_ends_and_absences() {
        let read = |a, b| <Bracket as Observation>::read(&[a, b]);
        assert_eq!(read(f64::NAN, f64::NAN), Ok(None));
        assert!(read(200.0, f64::NAN).unwrap().unwrap().upper.is_infinite());
        assert!(read(f64::NAN, 60.0).unwrap().unwrap().lower.is_infinite());
        assert!(read(210.0, 200.0).unwrap_err().contains("greater than lower"));
        assert!(<u32 as Observation>::read(&[1.5]).is_err());
    }

    #[test]
    fn a_simulated_bracket_contains_the_value_on_the_protocols_grid() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([0; 32]);
        let y = TopHat(227.3).simulate(&bracket(203.0, 213.0), &mut rng);
        assert_eq!(y, bracket(223.0, 233.0));
    }
}
