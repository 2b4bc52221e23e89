//! A measurement that comes from one of two likelihoods, and nobody knows from which.

use rand::{Rng, RngExt as _};

use super::{Likelihood, Observation};
use crate::num::{Real, ln_sum_exp};

/// `Mixture(share, A, B)`: the likelihood is `A` with the probability `share`, otherwise `B`. The
/// two cases are summed over.
#[derive(Clone, Copy, Debug)]
pub struct Mixture<D, A, B>(pub D, pub A, pub B);

impl<D: Real, Y: Observation, A: Likelihood<D, Y>, B: Likelihood<D, Y>> Likelihood<D, Y>
    for Mixture<D, A, B>
{
    fn ln_likelihood(&self, y: &Y) -> D {
        let Self(share, a, b) = self;
        let rest = -*share + 1.0;
        ln_sum_exp(&[share.ln() + a.ln_likelihood(y), rest.ln() + b.ln_likelihood(y)])
    }

    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y {
        let Self(share, a, b) = self;
        if rng.random::<f64>() < share.re() { a.simulate(like, rng) } else { b.simulate(like, rng) }
    }

    fn objection(&self, y: &Y) -> Option<&'static str> {
        self.1.objection(y).or(self.2.objection(y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dist::Normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn densities_add_up_and_draws_come_from_either() {
        let mixture = Mixture(0.3, Normal(-5.0, 1.0), Normal(2.0, 0.5));
        let density = |mu: f64, sd: f64, y: f64| {
            (-0.5 * ((y - mu) / sd).powi(2)).exp() / (sd * std::f64::consts::TAU.sqrt())
        };
        for y in [-6.0, -1.0, 2.3, 60.0] {
            let sum: f64 = 0.3 * density(-5.0, 1.0, y) + 0.7 * density(2.0, 0.5, y);
            let ln_p: f64 = mixture.ln_likelihood(&y);
            assert!(if sum > 0.0 { (ln_p - sum.ln()).abs() < 1e-12 } else { ln_p < -700.0 });
        }
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let n = (0..10_000).filter(|_| mixture.simulate(&0.0, &mut rng) < 0.0).count() as f64;
        assert!((n / 10_000.0 - 0.3).abs() < 4.5 * (0.3f64 * 0.7 / 10_000.0).sqrt(), "{n}");
    }
}
