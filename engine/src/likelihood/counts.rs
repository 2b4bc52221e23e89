//! Likelihoods of counts: events, rates, shares, overdispersion, ordered answers.

use rand::{Rng, RngExt};

use super::Likelihood;
use crate::dist::{ln_gamma, ln_logistic, logistic};
use crate::num::Real;

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
    fn location(&self) -> Option<D> {
        Some(logistic(self.0))
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

/// A count out of `n`, each with log odds `logit`.
#[derive(Clone, Copy, Debug)]
pub struct BinomialLogit<D>(
    /// How many there could be.
    pub f64,
    /// Log odds of each.
    pub D,
);

impl<D: Real> Likelihood<D, u32> for BinomialLogit<D> {
    #[inline]
    fn ln_likelihood(&self, y: &u32) -> D {
        let (n, y) = (self.0, f64::from(*y));
        let ways = ln_gamma(n + 1.0) - ln_gamma(y + 1.0) - ln_gamma(n - y + 1.0);
        ln_logistic(self.1) * y + ln_logistic(-self.1) * (n - y) + ways
    }
    fn simulate(&self, _: &u32, rng: &mut dyn Rng) -> u32 {
        rand_distr::Binomial::new(self.0 as u64, logistic(self.1.re()))
            .map_or(u32::MAX, |binomial| rng.sample::<u64, _>(binomial) as u32)
    }
    fn objection(&self, y: &u32) -> Option<&'static str> {
        (!(f64::from(*y) <= self.0)).then_some("BinomialLogit(n, logit) takes 0 to n")
    }
}

/// A count with log mean `log_mean` and variance `mean + mean²/phi`.
///
/// ```text
/// Γ(y + φ) / (y! Γ(φ)) (μ/(μ + φ))ʸ (φ/(μ + φ))^φ,   μ = e^log_mean
/// ```
#[derive(Clone, Copy, Debug)]
pub struct NegBinomialLog<D>(
    /// Natural logarithm of the expected count.
    pub D,
    /// φ: the larger, the nearer to a Poisson distribution.
    pub D,
);

impl<D: Real> Likelihood<D, u32> for NegBinomialLog<D> {
    #[inline]
    fn ln_likelihood(&self, y: &u32) -> D {
        let (log_mean, phi, y) = (self.0, self.1, f64::from(*y));
        let odds = log_mean - phi.ln();
        let ways = ln_gamma(phi + y) - ln_gamma(phi) - ln_gamma(y + 1.0);
        ln_logistic(odds) * y + ln_logistic(-odds) * phi + ways
    }
    fn simulate(&self, _: &u32, rng: &mut dyn Rng) -> u32 {
        let (mean, phi) = (self.0.re().exp(), self.1.re());
        let rate = rand_distr::Gamma::new(phi, mean / phi).map_or(f64::NAN, |g| rng.sample(g));
        rand_distr::Poisson::new(rate)
            .map_or(u32::MAX, |poisson| rng.sample::<f64, _>(poisson) as u32)
    }
}

/// One of K + 1 ordered answers 0, 1, … K, from `eta` and K increasing cut points:
/// `P(y > k) = logistic(eta − cut[k])`.
#[derive(Clone, Copy, Debug)]
pub struct OrderedLogit<D, const K: usize>(
    /// Tendency to a high answer.
    pub D,
    /// Cut points, increasing.
    pub [D; K],
);

impl<D: Real, const K: usize> Likelihood<D, u32> for OrderedLogit<D, K> {
    #[inline]
    fn ln_likelihood(&self, y: &u32) -> D {
        let k = *y as usize;
        let above = |k: usize| self.0 - self.1[k];
        match k {
            0 => ln_logistic(-above(0)),
            _ if k == K => ln_logistic(above(K - 1)),
            _ => {
                // σ(a) − σ(b) = σ(a) σ(−b) (1 − e^(b − a))
                let (a, b) = (above(k - 1), above(k));
                ln_logistic(a) + ln_logistic(-b) + (-(b - a).exp()).ln_1p()
            }
        }
    }
    fn simulate(&self, _: &u32, rng: &mut dyn Rng) -> u32 {
        let p: f64 = rng.random();
        self.1.iter().filter(|cut| p < logistic(self.0.re() - cut.re())).count() as u32
    }
    fn objection(&self, y: &u32) -> Option<&'static str> {
        (*y as usize > K).then_some("OrderedLogit(eta, cut) takes 0 up to the number of cuts")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    /// Probabilities of 0, 1, … sum to 1; draws have their mean and variance (4.5 standard errors).
    fn check(name: &str, likelihood: &impl Likelihood<f64, u32>, last: u32) {
        const DRAWS: u32 = 20_000;
        let p: Vec<f64> = (0..=last).map(|y| likelihood.ln_likelihood(&y).exp()).collect();
        let moment = |k: i32, about: f64| -> f64 {
            (0..=last).zip(&p).map(|(y, p)| (f64::from(y) - about).powi(k) * p).sum()
        };
        assert!((moment(0, 0.0) - 1.0).abs() < 1e-9, "{name}: {}", moment(0, 0.0));
        let (mean, mut rng) = (moment(1, 0.0), rand::SeedableRng::from_seed([4; 32]));
        let rng: &mut rand_chacha::ChaCha8Rng = &mut rng;
        let draws: Vec<f64> =
            (0..DRAWS).map(|_| f64::from(likelihood.simulate(&0, rng)) - mean).collect();
        for power in [1, 2] {
            let expected = moment(power, mean);
            let sd = (moment(2 * power, mean) - expected.powi(2)).sqrt();
            let drawn = draws.iter().map(|x| x.powi(power)).sum::<f64>() / f64::from(DRAWS);
            let z = (drawn - expected) / (sd / f64::from(DRAWS).sqrt());
            assert!(z.abs() < 4.5, "{name}: power {power}: {drawn} against {expected}");
        }
    }

    #[test]
    fn probabilities_sum_to_one_and_draws_follow_them() {
        check("BinomialLogit", &BinomialLogit(12.0, 0.7), 12);
        check("NegBinomialLog", &NegBinomialLog(1.2, 2.5), 400);
        check("OrderedLogit", &OrderedLogit(0.4, [-1.0, 0.2, 3.0]), 3);
    }

    #[test]
    fn derivatives_match_differences() {
        let e = 1e-5;
        let at = |eta: f64, phi: f64| NegBinomialLog(eta, phi).ln_likelihood(&7);
        let d = NegBinomialLog::<Dual<2>>(variable(0.8, 0), variable(2.5, 1)).ln_likelihood(&7);
        let [by_eta, by_phi] = derivatives(&d);
        assert!((by_eta - (at(0.8 + e, 2.5) - at(0.8 - e, 2.5)) / (2.0 * e)).abs() < 1e-8);
        assert!((by_phi - (at(0.8, 2.5 + e) - at(0.8, 2.5 - e)) / (2.0 * e)).abs() < 1e-8);
        for y in 0..3 {
            let at = |c: f64| OrderedLogit(0.3, [c, 1.1]).ln_likelihood(&y);
            let cut = [variable::<1>(-0.4, 0), Dual::from(1.1)];
            let [by_cut] = derivatives(&OrderedLogit(Dual::from(0.3), cut).ln_likelihood(&y));
            let difference = (at(-0.4 + e) - at(-0.4 - e)) / (2.0 * e);
            assert!((by_cut - difference).abs() < 1e-8, "{y}: {by_cut} {difference}");
        }
    }

    #[test]
    fn values_known_in_closed_form() {
        // 4 of 5 at even odds: 5/32; a wide negative binomial is nearly a Poisson: e⁻² 2³/3!
        assert!((BinomialLogit(5.0, 0.0).ln_likelihood(&4).exp() - 5.0 / 32.0).abs() < 1e-14);
        let wide = NegBinomialLog(2f64.ln(), 1e9).ln_likelihood(&3).exp();
        assert!((wide - (-2f64).exp() * 8.0 / 6.0).abs() < 1e-6, "{wide}");
        assert!(Likelihood::<f64, _>::objection(&BinomialLogit(5.0, 0.0), &6).is_some());
        assert!(Likelihood::<f64, _>::objection(&OrderedLogit(0.0, [0.0]), &2).is_some());
    }
}
