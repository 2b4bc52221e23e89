//! The Gaussian stand-in for the likelihood: for each place an information matrix W and a centre y.
//!
//! ```text
//! ln L(θ_site) ≈ const − ½ (θ − y)ᵀ W (θ − y)
//! ```
//! It is fitted to pairs of latent values θ and gradients g, by regressing g on θ: W = −Cov(g, θ)
//! Cov(θ)⁻¹ and W (y − E θ) = E g. For a Gaussian likelihood this is exact whatever the pairs.
//!
//! A poor stand-in costs the sampler speed, never exactness.

use super::latent::{Group, Layout, Shape};
use crate::num::vector::axpy;
use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Latent values and the gradient of the log likelihood there.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Sample {
    /// `(group, block, place)`
    pub(super) theta: Vec<f64>,
    /// `(group, block, place)`
    pub(super) slope: Vec<f64>,
}

impl Sample {
    /// Whether it is one of so many latent values.
    pub(super) fn fits(&self, n_latent: usize) -> bool {
        [self.theta.len(), self.slope.len()] == [n_latent; 2]
    }
}

/// The stand-ins of all groups.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct StandIn {
    pub(super) groups: Vec<GroupStandIn>,
}

impl StandIn {
    /// Knows nothing.
    pub(super) fn new(layout: &Layout) -> Self {
        let mut first = 0;
        let next = |group: &Group| {
            first += group.n_latent();
            GroupStandIn::new(group, first - group.n_latent())
        };
        Self { groups: layout.groups.iter().map(next).collect() }
    }

    /// The same with this much of the information.
    pub(super) fn times(&self, share: f64) -> Self {
        let mut new = self.clone();
        for group in &mut new.groups {
            let gram = group.gram.iter_mut().flatten();
            group.information.iter_mut().chain(gram).for_each(|w| *w *= share);
        }
        new
    }

    /// The same, but knowing nothing of this place, `[group, place]`.
    pub(super) fn without(&self, group: usize, places: &[usize], layout: &Layout) -> Self {
        let mut new = self.clone();
        let own = &mut new.groups[group];
        for place in places {
            own.information.iter_mut().skip(*place).step_by(own.n_seen).for_each(|w| *w = 0.0);
        }
        own.set_gram(&layout.groups[group]);
        new
    }

    /// Between these, of which each has a weight and means of the latent values, `(group, block, place)`. The weights
    /// sum to one. W and W y are weighted means; then the covariance W⁻¹ of each place is widened by that of the
    /// means there. `None` where it has none.
    pub(super) fn between(parts: &[(f64, &Self, &[f64])], layout: &Layout) -> Option<Self> {
        let of_group = |(g, group): (usize, &Group)| {
            let parts =
                parts.iter().map(|(weight, part, theta)| (*weight, &part.groups[g], *theta));
            GroupStandIn::between(&parts.collect::<Vec<_>>(), group)
        };
        let groups = layout.groups.iter().enumerate().map(of_group).collect::<Option<_>>()?;
        Some(Self { groups })
    }

    /// Whether both are of the same layout.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.groups.len() == other.groups.len()
            && self.groups.iter().zip(&other.groups).all(|(one, other)| one.is_like(other))
    }

    /// Fits every place to `samples`.
    pub(super) fn fit(&mut self, samples: &[Sample], trust: Trust, layout: &Layout) {
        for (stand_in, group) in self.groups.iter_mut().zip(&layout.groups) {
            stand_in.fit(samples, trust, group);
        }
    }

    /// ½ (θ − y)ᵀ W (θ − y); adds its gradient W (θ − y) to `slope`.
    pub(super) fn add_quadratic(
        &self,
        theta: &[f64],
        scratch: &mut [f64],
        slope: &mut [f64],
    ) -> f64 {
        let mut quadratic = 0.0;
        for group in &self.groups {
            let of_group = group.first..group.first + group.centre.len();
            let d = &mut scratch[of_group.clone()];
            for ((d, theta), y) in d.iter_mut().zip(&theta[of_group.clone()]).zip(&group.centre) {
                *d = theta - y;
            }
            quadratic += group.add_product(d, &mut slope[of_group]);
        }
        quadratic
    }
}

/// W and y of every place of a group.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct GroupStandIn {
    /// Its first latent value.
    first: usize,
    n_seen: usize,
    n_blocks: usize,
    /// `(block, block, place)`
    information: Vec<f64>,
    /// `(block, place)`
    centre: Vec<f64>,
    /// [Φ 1]ᵀ W [Φ 1] of each pair of scaled blocks, `(block, block)`; empty for others.
    gram: Vec<Vec<f64>>,
}

/// How far a fit may go beyond the samples that it is made from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trust {
    /// Least information about a latent value, in units of 1/variance in the sample. There must be
    /// some, or y would not exist. The most is 1: the posterior itself cannot have more.
    pub(super) least: f64,
    /// Largest distance of y from the mean, in standard deviations of the sample.
    pub(super) reach: f64,
}

impl Trust {
    /// For samples of the posterior.
    pub(super) const FULL: Self = Self { least: 1e-4, reach: f64::INFINITY };
    /// For samples of an approximation. Each fit may at most double its spread, or move it by two
    /// standard deviations.
    pub(super) const CAUTIOUS: Self = Self { least: 0.25, reach: 2.0 };
}

impl GroupStandIn {
    /// Knows nothing: W = 0.
    fn new(group: &Group, first: usize) -> Self {
        let (n_seen, n_blocks) = (group.n_seen, group.blocks.len());
        Self {
            first,
            n_seen,
            n_blocks,
            information: vec![0.0; n_blocks * n_blocks * n_seen],
            centre: vec![0.0; n_blocks * n_seen],
            gram: vec![vec![]; n_blocks * n_blocks],
        }
    }

    fn is_like(&self, other: &Self) -> bool {
        let lengths = |of: &Self| {
            let grams: Vec<usize> = of.gram.iter().map(Vec::len).collect();
            let own = [of.first, of.n_seen, of.n_blocks, of.information.len(), of.centre.len()];
            (own, grams)
        };
        lengths(self) == lengths(other)
    }

    /// Fits every place to `samples`. A place whose samples do not vary keeps its stand-in.
    fn fit(&mut self, samples: &[Sample], trust: Trust, group: &Group) {
        // many places share what is known of few coefficients
        let share = (group.n_coefficients() as f64 / group.n_latent() as f64).min(1.0);
        let trust = Trust { least: share * trust.least, ..trust };
        for place in 0..self.n_seen {
            if let Some((information, centre)) = self.fit_place(samples, trust, place) {
                self.set(place, &information, &centre);
            }
        }
        self.set_gram(group);
    }

    /// Works in the coordinates x = L⁻¹(θ − E θ) with L Lᵀ = Cov θ, where Cov x = I and g becomes
    /// Lᵀg.
    fn fit_place(
        &self,
        samples: &[Sample],
        trust: Trust,
        place: usize,
    ) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let n = samples.len() as f64;
        let at = |all: &[f64]| self.values(all, place);
        let zero = || DVector::zeros(self.n_blocks);
        let mean = samples.iter().fold(zero(), |sum, s| sum + at(&s.theta)) / n;
        let slope = samples.iter().fold(zero(), |sum, s| sum + at(&s.slope)) / n;
        let mut covariance = DMatrix::zeros(self.n_blocks, self.n_blocks);
        let mut cross = covariance.clone();
        for sample in samples {
            let d = at(&sample.theta) - &mean;
            covariance += &d * d.transpose() / n;
            cross += (at(&sample.slope) - &slope) * d.transpose() / n;
        }
        let factor = Cholesky::new(covariance)?.l();
        let inverse = factor.clone().try_inverse()?;
        let raw = -(factor.transpose() * cross * inverse.transpose());
        let mut eigen = ((&raw + raw.transpose()) * 0.5).symmetric_eigen();
        eigen.eigenvalues.apply(|x| *x = x.clamp(trust.least, 1.0));
        let whitened = eigen.recompose();
        let step = whitened.clone().try_inverse()? * (factor.transpose() * slope);
        let shrink = (trust.reach / step.norm()).min(1.0);
        let centre = mean + &factor * step * shrink;
        let information = inverse.transpose() * whitened * inverse;
        let finite = |x: &f64| x.is_finite();
        (information.iter().all(finite) && centre.iter().all(finite))
            .then_some((information, centre))
    }

    /// See [`StandIn::between`].
    fn between(parts: &[(f64, &Self, &[f64])], group: &Group) -> Option<Self> {
        let mut new = parts.first()?.1.clone();
        new.information.fill(0.0);
        let mut pull = vec![0.0; new.centre.len()];
        let mut product = pull.clone();
        for (weight, part, _) in parts {
            axpy(*weight, &part.information, &mut new.information);
            product.fill(0.0);
            part.add_product(&part.centre, &mut product);
            axpy(*weight, &product, &mut pull);
        }
        let n = new.n_blocks;
        for place in 0..new.n_seen {
            let pull = DVector::from_fn(n, |f, _| pull[f * new.n_seen + place]);
            let factor = Cholesky::new(new.at(place).0)?;
            // without new vectors for each part: this is asked for at every estimate
            let value = |theta: &[f64], f: usize| theta[new.first + f * new.n_seen + place];
            let mut mean = vec![0.0; n];
            let mut wider = factor.inverse();
            for (weight, _, theta) in parts {
                (0..n).for_each(|f| mean[f] += value(theta, f) * weight);
            }
            for (weight, _, theta) in parts {
                let d = |f: usize| value(theta, f) - mean[f];
                for (f, g) in (0..n).flat_map(|f| (0..n).map(move |g| (f, g))) {
                    wider[(f, g)] += d(f) * d(g) * weight;
                }
            }
            new.set(place, &Cholesky::new(wider)?.inverse(), &factor.solve(&pull));
        }
        new.set_gram(group);
        Some(new)
    }

    /// Those of one place of all latent values, `(block)`.
    fn values(&self, all: &[f64], place: usize) -> DVector<f64> {
        DVector::from_fn(self.n_blocks, |f, _| all[self.first + f * self.n_seen + place])
    }

    /// W and y of one place.
    pub(super) fn at(&self, place: usize) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.n_blocks;
        let information = DMatrix::from_fn(n, n, |f, g| self.information(f, g)[place]);
        (information, DVector::from_fn(n, |f, _| self.centre[f * self.n_seen + place]))
    }

    /// Sets them. [`GroupStandIn::set_gram`] is to follow.
    pub(super) fn set(&mut self, place: usize, information: &DMatrix<f64>, centre: &DVector<f64>) {
        for f in 0..self.n_blocks {
            self.centre[f * self.n_seen + place] = centre[f];
            for g in 0..self.n_blocks {
                let at = (f * self.n_blocks + g) * self.n_seen + place;
                self.information[at] = information[(f, g)];
            }
        }
    }

    /// After a change of the information.
    pub(super) fn set_gram(&mut self, group: &Group) {
        for (f, first) in group.blocks.iter().enumerate() {
            for (g, second) in group.blocks.iter().enumerate() {
                let (Shape::Scaled(left), Shape::Scaled(right)) = (&first.shape, &second.shape)
                else {
                    continue;
                };
                let entry = |modes: &[f64], n: usize, place: usize, j: usize| {
                    if j < n { modes[place * n + j] } else { 1.0 }
                };
                let w = self.information(f, g);
                let mut gram = vec![];
                for j in 0..first.width() {
                    for k in 0..second.width() {
                        let product = |place: usize| {
                            let a = entry(left, first.n_coefficients, place, j);
                            w[place] * a * entry(right, second.n_coefficients, place, k)
                        };
                        gram.push((0..self.n_seen).map(product).sum());
                    }
                }
                self.gram[f * self.n_blocks + g] = gram;
            }
        }
    }

    /// ½ (θ − y)ᵀ W (θ − y) at one place, for θ `(block)`.
    pub(super) fn quadratic(&self, place: usize, theta: &[f64]) -> f64 {
        let d = |f: usize| theta[f] - self.centre[f * self.n_seen + place];
        let row = |f: usize| {
            (0..self.n_blocks).map(move |g| self.information(f, g)[place] * d(g)).sum::<f64>()
        };
        (0..self.n_blocks).map(|f| 0.5 * d(f) * row(f)).sum()
    }

    /// ½ (θ − y)ᵀ W (θ − y) of all places, for θ `(block, place)`.
    pub(super) fn whole_quadratic(&self, theta: &[f64]) -> f64 {
        let n = self.n_seen;
        let mut quadratic = 0.0;
        for f in 0..self.n_blocks {
            for g in 0..self.n_blocks {
                let pairs = self.information(f, g).iter().enumerate();
                let at = |f: usize, i: usize| theta[f * n + i] - self.centre[f * n + i];
                quadratic += pairs.map(|(i, w)| 0.5 * at(f, i) * w * at(g, i)).sum::<f64>();
            }
        }
        quadratic
    }

    /// W between two blocks, one number per place.
    pub(super) fn information(&self, f: usize, g: usize) -> &[f64] {
        &self.information[(f * self.n_blocks + g) * self.n_seen..][..self.n_seen]
    }

    /// [Φ 1]ᵀ W [Φ 1] between two scaled blocks, `(width, width)`.
    pub(super) fn gram(&self, f: usize, g: usize) -> &[f64] {
        &self.gram[f * self.n_blocks + g]
    }

    /// y `(block, place)`.
    pub(super) fn centre(&self) -> &[f64] {
        &self.centre
    }

    /// Adds W d to `out` for d `(block, place)`; returns ½ dᵀ W d.
    pub(super) fn add_product(&self, d: &[f64], out: &mut [f64]) -> f64 {
        let n = self.n_seen;
        let mut quadratic = 0.0;
        for f in 0..self.n_blocks {
            for g in 0..self.n_blocks {
                let w = self.information(f, g);
                let (left, right) = (&d[f * n..][..n], &d[g * n..][..n]);
                for (((out, w), left), right) in
                    out[f * n..][..n].iter_mut().zip(w).zip(left).zip(right)
                {
                    let product = w * right;
                    *out += product;
                    quadratic += 0.5 * left * product;
                }
            }
        }
        quadratic
    }
}
