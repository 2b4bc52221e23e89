//! A group's latent values under G, one place after the other: θ = μ + L ε with a lower triangular L.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use std::rc::Rc;

use super::latent::Group;
use super::stand_in::GroupStandIn;
use crate::num::vector::{axpy, dot};

/// A latent value of which the values before leave less than this share of the variance is determined by them.
const ROUNDING: f64 = 1e-10;

/// G of a group: θ = μ + B z.
pub(super) struct Law {
    n_seen: usize,
    n_blocks: usize,
    n_coefficients: usize,
    /// μ `(block, place)`
    mean: Vec<f64>,
    /// B, row-major `(n_latent, n_coefficients)`.
    basis: Vec<f64>,
    /// B Bᵀ, row-major `(n_latent, n_latent)`.
    covariance: Vec<f64>,
}

impl Law {
    /// With this origin and these columns of a whitening's basis.
    pub(super) fn new(layout: &Group, (origin, columns): (&[f64], &[f64])) -> Self {
        let (n, n_coefficients) = (layout.n_latent(), layout.n_coefficients());
        let mut basis = vec![0.0; n * n_coefficients];
        for (i, row) in basis.chunks_exact_mut(n_coefficients).enumerate() {
            row.iter_mut().zip(columns.chunks_exact(n)).for_each(|(b, column)| *b = column[i]);
        }
        let mut covariance = vec![0.0; n * n];
        let row = |i: usize| &basis[i * n_coefficients..][..n_coefficients];
        for i in 0..n {
            for j in 0..=i {
                let product = dot::<4>(row(i), row(j));
                covariance[i * n + j] = product;
                covariance[j * n + i] = product;
            }
        }
        let (n_seen, n_blocks) = (layout.n_seen, layout.blocks.len());
        Self { n_seen, n_blocks, n_coefficients, mean: origin.to_vec(), basis, covariance }
    }

    pub(super) fn n_coefficients(&self) -> usize {
        self.n_coefficients
    }

    /// The group's places in their order.
    pub(super) fn order(&self) -> Order<'_> {
        let mut order = Order::new(self);
        (0..self.n_seen).for_each(|place| order.append(place));
        order
    }
}

/// The values of some places, in an order.
#[derive(Clone)]
pub(super) struct Order<'a> {
    law: &'a Law,
    pub(super) places: Vec<usize>,
    mean: Vec<f64>,
    /// The rows of L up to their diagonals, shared by orders that begin alike. The diagonal is zero where the values
    /// before determine one.
    rows: Vec<Rc<[f64]>>,
}

impl<'a> Order<'a> {
    /// Of no place.
    pub(super) fn new(law: &'a Law) -> Self {
        Self { law, places: vec![], mean: vec![], rows: vec![] }
    }

    /// Takes up the values of a further place.
    pub(super) fn append(&mut self, place: usize) {
        let law = self.law;
        self.places.push(place);
        for _ in 0..law.n_blocks {
            let own = self.latent(self.n());
            let covariances = &law.covariance[own * law.mean.len()..][..law.mean.len()];
            let covariance = |order: &Self, j: usize| covariances[order.latent(j)];
            self.push(law.mean[own], vec![], covariance);
        }
    }

    /// Adds a value with this mean and this beginning of its row, `own`. The rest of L Lᵀ is the covariance with each value from there on.
    fn push(&mut self, mean: f64, mut own: Vec<f64>, covariance: impl Fn(&Self, usize) -> f64) {
        let (i, first) = (self.n(), own.len());
        own.reserve(i + 1 - first);
        for j in first..i {
            let other = self.row(j);
            let left = covariance(self, j) - dot::<4>(&own[first..], &other[first..j]);
            own.push(if other[j] > 0.0 { left / other[j] } else { 0.0 });
        }
        let variance = covariance(self, i);
        let left = variance - dot::<4>(&own[first..], &own[first..]);
        own.push(if left > ROUNDING * variance { left.sqrt() } else { 0.0 });
        self.mean.push(mean);
        self.rows.push(own.into());
    }

    /// Which of the latent values `(block, place)` is number i.
    fn latent(&self, i: usize) -> usize {
        let n_blocks = self.law.n_blocks;
        (i % n_blocks) * self.law.n_seen + self.places[i / n_blocks]
    }

    pub(super) fn n(&self) -> usize {
        self.mean.len()
    }

    pub(super) fn n_blocks(&self) -> usize {
        self.law.n_blocks
    }

    /// Row i of L up to its diagonal.
    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.rows[i]
    }

    /// θᵢ of each particle, from ε `(n, particle)`; from the values before alone if these are all that there are.
    pub(super) fn values(&self, i: usize, eps: &[f64], out: &mut [f64]) {
        out.fill(self.mean[i]);
        for (l, eps) in self.row(i).iter().zip(eps.chunks_exact(out.len())) {
            axpy(*l, eps, out);
        }
    }

    /// εᵢ of each particle, from θᵢ and the values of ε before, `(i, particle)`.
    pub(super) fn standard(&self, i: usize, before: &[f64], theta: &[f64], out: &mut [f64]) {
        let row = self.row(i);
        let inverse = if row[i] > 0.0 { 1.0 / row[i] } else { 0.0 };
        out.iter_mut().zip(theta).for_each(|(out, theta)| *out = theta - self.mean[i]);
        for (l, eps) in row[..i].iter().zip(before.chunks_exact(out.len())) {
            axpy(-l, eps, out);
        }
        for out in out {
            *out *= inverse;
        }
    }

    /// The next of ε, L⁻¹ x, after these; 0 where L has no pivot.
    fn next(&self, eps: &[f64], x: f64) -> f64 {
        let (row, i) = (self.row(eps.len()), eps.len());
        let left = x - dot::<4>(&row[..i], eps);
        if row[i] > 0.0 { left / row[i] } else { 0.0 }
    }

    /// Completes ε, of which the first values are given, at θ `(block, place)`.
    pub(super) fn complete(&self, theta: &[f64], eps: &mut Vec<f64>) {
        for i in eps.len()..self.n() {
            eps.push(self.next(eps, theta[self.latent(i)] - self.mean[i]));
        }
    }

    /// Draws z given ε, or its first values: `z = ξ + Bᵀ L⁻ᵀ (ε − L⁻¹ B ξ)` for ξ standard normal.
    pub(super) fn coefficients(&self, eps: &[f64], rng: &mut impl Rng, z: &mut [f64]) {
        z.fill_with(|| rng.sample(StandardNormal));
        let width = self.law.n_coefficients;
        let row_of = |i: usize| &self.law.basis[self.latent(i) * width..][..width];
        let mut seen: Vec<f64> = Vec::with_capacity(self.n());
        for i in 0..self.n() {
            seen.push(self.next(&seen, dot::<4>(row_of(i), z)));
        }
        let mut d: Vec<f64> = eps.iter().zip(seen).map(|(eps, seen)| eps - seen).collect();
        for i in (0..d.len()).rev() {
            let row = self.row(i);
            d[i] = if row[i] > 0.0 { d[i] / row[i] } else { 0.0 };
            let (before, own) = d.split_at_mut(i);
            before.iter_mut().zip(row).for_each(|(d, l)| *d -= l * own[0]);
        }
        for (i, d) in d.iter().enumerate() {
            z.iter_mut().zip(row_of(i)).for_each(|(z, b)| *z += b * d);
        }
    }

    /// With a stand-in for the likelihood of the values from number `first` on: G of them, given those before, and what
    /// it says of those before. `None` where that cannot be told.
    ///
    /// ```text
    /// θ = μ + A ε + L ε′      ε before, ε′ from `first` on      d = y − μ
    /// Σ′ = L (I + LᵀWL)⁻¹ Lᵀ = L′L′ᵀ
    /// θ = μ + Σ′W d + (I − Σ′W) A ε + L′ ε″
    /// ∫ p(ε′) q dε′ = |I + LᵀWL|^−½ exp(−½ (d − A ε)ᵀ (W − WΣ′W) (d − A ε))
    /// ```
    pub(super) fn ahead(&self, first: usize, stand_in: &GroupStandIn) -> Option<(Self, Ahead)> {
        let (n, n_blocks) = (self.n() - first, self.law.n_blocks);
        let lower =
            DMatrix::from_fn(n, n, |i, j| if j > i { 0.0 } else { self.row(first + i)[first + j] });
        let before = DMatrix::from_fn(n, first, |i, j| self.row(first + i)[j]);
        let mut information = DMatrix::zeros(n, n);
        let mut d = DVector::from_fn(n, |i, _| -self.mean[first + i]);
        let places = &self.places[first / n_blocks..];
        for (start, place) in places.iter().enumerate().map(|(k, place)| (k * n_blocks, place)) {
            let (own, centre) = stand_in.at(*place);
            information.view_mut((start, start), (n_blocks, n_blocks)).copy_from(&own);
            let mut d = d.rows_mut(start, n_blocks);
            d += centre;
        }
        let weighted = &information * &lower;
        let product = Cholesky::new(DMatrix::identity(n, n) + lower.transpose() * &weighted)?;
        let ln_volume = -product.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        let covariance = &lower * product.solve(&lower.transpose());
        let gain = &covariance * &information;
        let mean = &gain * &d;
        let rows = &before - &gain * &before;
        let mut order = self.clone();
        order.mean.truncate(first);
        order.rows.truncate(first);
        for i in 0..n {
            let given = rows.row(i).iter().copied().collect();
            let at = |_: &Self, j: usize| covariance[(i, j - first)];
            order.push(self.mean[first + i] + mean[i], given, at);
        }
        let information = &information - &information * gain;
        Some((order, Ahead { before, d, information, ln_volume }))
    }
}

/// What a stand-in for the likelihood of some places says of the values before them, as in [`Order::ahead`].
pub(super) struct Ahead {
    /// A
    before: DMatrix<f64>,
    d: DVector<f64>,
    /// W − WΣ′W
    information: DMatrix<f64>,
    /// `−½ ln|I + LᵀWL|`
    ln_volume: f64,
}

impl Ahead {
    /// Adds its logarithm to `out`, for each of the particles ε `(n, particle)`.
    pub(super) fn add_ln(&self, eps: &[f64], out: &mut [f64]) {
        let n_particles = out.len();
        let left = |i: usize| {
            let mut left = vec![self.d[i]; n_particles];
            for (a, eps) in self.before.row(i).iter().zip(eps.chunks_exact(n_particles)) {
                axpy(-a, eps, &mut left);
            }
            left
        };
        let left: Vec<Vec<f64>> = (0..self.d.len()).map(left).collect();
        for out in out.iter_mut() {
            *out += self.ln_volume;
        }
        let mut product = vec![0.0; n_particles];
        for (i, own) in left.iter().enumerate() {
            product.fill(0.0);
            for (w, other) in self.information.row(i).iter().zip(&left) {
                axpy(*w, other, &mut product);
            }
            for ((out, own), product) in out.iter_mut().zip(own).zip(&product) {
                *out -= 0.5 * own * product;
            }
        }
    }
}
