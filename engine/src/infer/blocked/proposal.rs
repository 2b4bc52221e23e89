//! Proposals for the hyperparameters, shaped by the warm-up's draws.
//!
//! ```text
//! yᵢ = (hᵢ − cᵢ)/sᵢ,  sᵢ below or above the centre cᵢ        y ~ t₅(0, L Lᵀ)
//! ```
//! Each hyperparameter has one scale below the centre and one above it, because hyperparameters are
//! skew: the logarithm of a short lengthscale or of a small amplitude falls off slowly on one side.
//! After this scaling y is elliptical enough.

use super::mixture::student_scale;
use nalgebra::{Cholesky, DMatrix};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Three kinds of proposals in turn: random-walk steps, independent draws of all hyperparameters,
/// and draws of one hyperparameter given the others.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(in crate::infer) struct Proposal {
    centre: Vec<f64>,
    /// Scale below and above the centre.
    scale: Vec<[f64; 2]>,
    /// L, row-major.
    factor: Vec<f64>,
    /// (L Lᵀ)⁻¹, row-major.
    precision: Vec<f64>,
    /// Whether it knows the posterior well enough for independent draws.
    is_fitted: bool,
}

/// What is proposed in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// A random-walk step. Its length is this number times the length that adapts.
    Walk(f64),
    All,
    One(usize),
}

impl Proposal {
    /// Mean acceptance that the random walk's length is tuned to.
    pub(in crate::infer) const TARGET: f64 = 0.3;
    /// Long steps find other regimes, short ones are accepted at the edge of one.
    const LENGTHS: [f64; 3] = [1.0, 2.0, 0.4];
    /// Degrees of freedom of independent draws. Their tails are to be heavier than the posterior's.
    const NU: usize = 5;

    /// Independent steps with these scales.
    pub(in crate::infer) fn new(scales: &[f64]) -> Self {
        let n = scales.len();
        let unit: Vec<f64> =
            (0..n * n).map(|k| f64::from(u8::from(k.is_multiple_of(n + 1)))).collect();
        let scale = scales.iter().map(|s| [*s; 2]).collect();
        Self {
            centre: vec![0.0; n],
            scale,
            factor: unit.clone(),
            precision: unit,
            is_fitted: false,
        }
    }

    /// Whether both are of as many hyperparameters.
    pub(in crate::infer) fn is_like(&self, other: &Self) -> bool {
        let lengths =
            |of: &Self| [of.centre.len(), of.scale.len(), of.factor.len(), of.precision.len()];
        lengths(self) == lengths(other)
    }

    /// Takes medians, scales and covariance of these draws; what cannot be factorised changes nothing. `floor` is added to
    /// each variance: a hyperparameter that did not move must move.
    pub(in crate::infer) fn fit(&mut self, draws: &[Vec<f64>], floor: f64) {
        let (n, count) = (self.centre.len(), draws.len() as f64);
        let mut new = self.clone();
        for i in 0..n {
            let mut h: Vec<f64> = draws.iter().map(|h| h[i]).collect();
            h.sort_by(f64::total_cmp);
            let centre = h[h.len() / 2];
            let side = |half: &[f64]| {
                let squares: f64 = half.iter().map(|h| (h - centre).powi(2)).sum();
                (squares / half.len().max(1) as f64 + floor).sqrt()
            };
            new.centre[i] = centre;
            new.scale[i] = [side(&h[..h.len() / 2]), side(&h[h.len() / 2..])];
        }
        let y: Vec<Vec<f64>> = draws.iter().map(|h| new.standard(h)).collect();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let sum: f64 = y.iter().map(|y| y[i] * y[j]).sum();
            sum / count + if i == j { floor / new.middle(i).powi(2) } else { 0.0 }
        });
        if let Some(cholesky) = Cholesky::new(covariance) {
            let (factor, precision) = (cholesky.l(), cholesky.inverse());
            new.factor = (0..n * n).map(|k| factor[(k / n, k % n)]).collect();
            new.precision = (0..n * n).map(|k| precision[(k / n, k % n)]).collect();
            new.is_fitted = true;
            *self = new;
        }
    }

    fn step(&self, k: usize) -> Step {
        match (self.is_fitted, k) {
            (false, k) => Step::Walk(Self::LENGTHS[(k / 2) % 3]),
            (true, 1) => Step::Walk(1.0),
            (true, k) if k.is_multiple_of(2) => Step::One(k / 2 % self.centre.len()),
            _ => Step::All,
        }
    }

    /// Whether step `k` of a transition is a random-walk step, whose length adapts.
    pub(in crate::infer) fn is_walk(&self, k: usize) -> bool {
        matches!(self.step(k), Step::Walk(_))
    }

    /// Writes the `k`-th proposal of a transition from `present`; returns the ln ratio of the
    /// densities of proposing the way back and the way there.
    pub(in crate::infer) fn draw(
        &self,
        k: usize,
        length: f64,
        present: &[f64],
        rng: &mut impl Rng,
        proposed: &mut [f64],
    ) -> f64 {
        proposed.copy_from_slice(present);
        match self.step(k) {
            Step::Walk(relative) => {
                let step = self.correlated(length * relative, rng);
                for (i, step) in step.into_iter().enumerate() {
                    proposed[i] += self.middle(i) * step;
                }
                return 0.0;
            }
            Step::All => {
                let y = self.correlated(student_scale(Self::NU, rng), rng);
                y.into_iter().enumerate().for_each(|(i, y)| proposed[i] = self.place(i, y));
            }
            Step::One(i) => {
                proposed[i] = self.place(i, self.given_the_others(i, &self.standard(present), rng));
            }
        }
        // of one given the others too: what they do to its density is the same on both ways
        self.ln_student(present) - self.ln_student(proposed)
    }

    /// `scale` L x, x standard normal.
    fn correlated(&self, scale: f64, rng: &mut impl Rng) -> Vec<f64> {
        let n = self.centre.len();
        let mut y = vec![0.0; n];
        for j in 0..n {
            let x = scale * rng.sample::<f64, _>(StandardNormal);
            for (y, row) in y.iter_mut().zip(self.factor.chunks_exact(n)).skip(j) {
                *y += row[j] * x;
            }
        }
        y
    }

    /// Draws y(i) given the other y. This is Student's t with more degrees of freedom (Ding 2016,
    /// "On the conditional distribution of the multivariate t distribution").
    fn given_the_others(&self, i: usize, y: &[f64], rng: &mut impl Rng) -> f64 {
        let n = y.len();
        let row = &self.precision[i * n..][..n];
        let product: f64 = row.iter().zip(y).map(|(p, y)| p * y).sum();
        let mean = y[i] - product / row[i];
        let others = (self.distance(y) - product * product / row[i]).max(0.0);
        let nu = Self::NU + n - 1;
        let spread = ((Self::NU as f64 + others) / (nu as f64 * row[i])).sqrt();
        mean + spread * student_scale(nu, rng) * rng.sample::<f64, _>(StandardNormal)
    }

    /// yᵀ (L Lᵀ)⁻¹ y
    fn distance(&self, y: &[f64]) -> f64 {
        let rows = self.precision.chunks_exact(y.len()).zip(y);
        rows.map(|(row, y_i)| y_i * row.iter().zip(y).map(|(p, y)| p * y).sum::<f64>()).sum()
    }

    /// ln of the density of independent draws at `h`, up to a constant.
    fn ln_student(&self, h: &[f64]) -> f64 {
        let (nu, y) = (Self::NU as f64, self.standard(h));
        let ln_scales: f64 = (0..h.len()).map(|i| self.scale_at(i, y[i]).ln()).sum();
        -0.5 * (nu + h.len() as f64) * (self.distance(&y) / nu).ln_1p() - ln_scales
    }

    /// y of h
    fn standard(&self, h: &[f64]) -> Vec<f64> {
        let one =
            |(i, h): (usize, &f64)| (h - self.centre[i]) / self.scale_at(i, h - self.centre[i]);
        h.iter().enumerate().map(one).collect()
    }

    /// h(i) of y(i)
    fn place(&self, i: usize, y: f64) -> f64 {
        self.centre[i] + y * self.scale_at(i, y)
    }

    /// The scale on this side of the centre.
    fn scale_at(&self, i: usize, y: f64) -> f64 {
        self.scale[i][usize::from(y >= 0.0)]
    }

    fn middle(&self, i: usize) -> f64 {
        0.5 * (self.scale[i][0] + self.scale[i][1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Metropolis steps under these proposals on a density that they do not match must leave it as it is;
    /// a twin that forgets the ratio of the densities of proposing does not.
    #[test]
    fn independent_draws_leave_a_skew_density_as_it_is() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut proposal = Proposal::new(&[1.0, 1.0]);
        let skew = |rng: &mut ChaCha8Rng| {
            let x: f64 = rng.sample(StandardNormal);
            vec![x + 0.5 * x * x, 0.7 * x - rng.random::<f64>().ln()]
        };
        proposal.fit(&(0..400).map(|_| skew(&mut rng)).collect::<Vec<_>>(), 1e-3);
        // h₀ ~ Gamma(2, 1), h₁ | h₀ ~ N(h₀, 1)
        let ln_p = |h: &[f64]| {
            if h[0] > 0.0 {
                h[0].ln() - h[0] - 0.5 * (h[1] - h[0]).powi(2)
            } else {
                f64::NEG_INFINITY
            }
        };
        let mut moments = |forget: f64| {
            let (mut h, mut proposed) = (vec![1.0, 1.0], vec![0.0; 2]);
            let (n, mut sums) = (200_000, [0.0; 4]);
            for k in 0..n {
                let ratio = forget * proposal.draw(k % 4, 1.0, &h, &mut rng, &mut proposed);
                if rng.random::<f64>().ln() < ln_p(&proposed) - ln_p(&h) + ratio {
                    h.copy_from_slice(&proposed);
                }
                let terms = [h[0], h[1], h[0] * h[0], h[1] * h[1]];
                sums.iter_mut().zip(terms).for_each(|(s, x)| *s += x / n as f64);
            }
            sums
        };
        // E = 2, 2, 6, 6 + 1; of the squares, 5 % are four standard errors at 20,000 effective draws
        let exact = [2.0, 2.0, 6.0, 7.0];
        let worst = |sums: [f64; 4]| {
            sums.iter().zip(exact).map(|(s, e)| (s - e).abs() / e).fold(0.0, f64::max)
        };
        let (right, broken) = (worst(moments(1.0)), worst(moments(0.0)));
        assert!(right < 0.05, "{right}");
        assert!(broken > 0.1, "a forgotten ratio goes unseen: {broken}");
    }
}
