//! Models whose unseen labels, states and groups Stan users know from posteriordb.
use eplat::prelude::*;

/// Two groups of unknown members (`low_dim_gauss_mix`, with one spread).
pub(crate) mod mixture {
    use super::*;
    model! {
        model TwoGroups;
        param mu(2) ~ Ordered(Normal(0.0, 2.0));
        param sigma ~ HalfNormal(2.0);
        param theta ~ Beta(5.0, 5.0);
        observe y(row): Number ~ Mixture(theta, Normal(mu[0], sigma), Normal(mu[1], sigma));
    }
}

/// A hidden Markov chain of two states with normal emissions (`hmm_example`): states summed over by
/// the forward algorithm, a term per row given the rows before.
pub(crate) mod markov {
    use super::*;
    model! {
        model HiddenMarkov;
        column y;
        param stay(2) ~ Beta(4.0, 2.0);
        param mu(2) ~ Ordered(Normal(5.0, 4.0));
        density states(data) = forward(stay, mu, data.y);
    }

    fn forward<D: Real>(stay: [D; 2], mu: [D; 2], y: &[f64]) -> Vec<D> {
        let mut state = [D::from(0.5f64.ln()); 2];
        let mut terms = vec![];
        for (t, y) in y.iter().enumerate() {
            let from = |k: usize| {
                let arrive = [state[k] + stay[k].ln(), state[1 - k] + (-stay[1 - k] + 1.0).ln()];
                if t == 0 { state[k] } else { ln_sum_exp(&arrive) }
            };
            let emitted: [D; 2] = mu.map(|mu| Normal(mu, 1.0).ln_likelihood(y));
            let joint = [0, 1].map(|k| from(k) + emitted[k]);
            let term = ln_sum_exp(&joint);
            state = joint.map(|ln_p| ln_p - term);
            terms.push(term);
        }
        terms
    }
}

/// Intercepts of counties about a common mean, and a slope (`radon_hierarchical_intercept`).
pub(crate) mod radon {
    use super::*;
    model! {
        model Radon;
        column floor;
        param mu ~ Flat;
        param tau ~ HalfNormal(2.0);
        param alpha(county) ~ Normal(mu, tau);
        param beta ~ Flat;
        param sigma ~ HalfNormal(2.0);
        let level(row) = alpha(row) + beta * row.floor;
        observe log_radon(row): Number ~ Normal(level(row), sigma);
    }
}
