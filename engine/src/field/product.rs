//! Kernels that multiply.
//!
//! The spectral density of a product of covariances is the Hankel transform
//!
//! ```text
//! S(w) = 2π ∫₀^∞ k₁(r) k₂(r) J₀(wr) r dr
//! ```
//! It is computed by Gauss and Legendre's rule on panels. Each panel ends at twice the distance of
//! the one before it; the last ends where the product has decayed to 1e-13. The nodes do not depend
//! on derivatives, so a sum over numbers that carry derivatives has the derivatives of the
//! integral.

use std::f64::consts::TAU;
use std::ops::{Add, Mul};

use super::{Covariance, Kernel, Rbf, Sum};
use crate::num::Real;

/// The kernel `k₁ k₂`, of unit variance if both are.
///
/// It is written `Rbf(a) * Matern52(b)`. The product of two squared exponentials is another one, in
/// closed form. Other products are computed by quadrature. This takes about 4 µs, and 1.6 µs per
/// mode, for every gradient; a kernel that ships takes a few ns per mode. Frequencies above 128
/// over the distance at which the product has decayed take several times that. Where the density is
/// less than 1e-13 of the largest, it is 0.
#[derive(Clone, Copy, Debug)]
pub struct Product<D, A, B> {
    a: A,
    b: B,
    /// The product as one squared exponential, if it is.
    closed: Option<D>,
    /// The distance at which it has decayed, mm.
    reach: f64,
    /// `2π k₁ k₂ r dr` at the nodes of the undivided panels.
    terms: [D; PANELS.len() * NODES],
    /// `S(0)`.
    largest: f64,
}

/// Beginning and end of the panels, in reaches.
const PANELS: [(f64, f64); 4] = [(0.0, 0.125), (0.125, 0.25), (0.25, 0.5), (0.5, 1.0)];

/// Largest `w (end − begin)` that a panel resolves.
const RESOLVED: f64 = 16.0;

/// What is left of a covariance, as a share of the variance, where it has decayed.
const DECAYED: f64 = 1e-13;

const NODES: usize = 16;

/// Gauss and Legendre's nodes in (0, 1) and their weights. The nodes in (−1, 0) are their
/// negatives.
const RULE: [(f64, f64); NODES / 2] = [
    (0.095_012_509_837_637_44, 0.189_450_610_455_068_5),
    (0.281_603_550_779_258_9, 0.182_603_415_044_923_58),
    (0.458_016_777_657_227_37, 0.169_156_519_395_002_54),
    (0.617_876_244_402_643_8, 0.149_595_988_816_576_74),
    (0.755_404_408_355_003, 0.124_628_971_255_533_88),
    (0.865_631_202_387_831_8, 0.095_158_511_682_492_79),
    (0.944_575_023_073_232_6, 0.062_253_523_938_647_894),
    (0.989_400_934_991_649_9, 0.027_152_459_411_754_096),
];

/// Distance and weight of a node of the panel from `begin` to `end`.
#[inline(always)]
fn node(i: usize, begin: f64, end: f64) -> (f64, f64) {
    let (x, weight) = RULE[i / 2];
    let half = 0.5 * (end - begin);
    (0.5 * (begin + end) + if i.is_multiple_of(2) { half * x } else { -half * x }, half * weight)
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>> Product<D, A, B> {
    /// `a * b`, where `a` is a kernel without operators of its own.
    pub fn new(a: A, b: B) -> Self {
        let closed = a.squared_exponential().zip(b.squared_exponential());
        let closed = closed.map(|(a, b)| (a.powi(-2) + b.powi(-2)).sqrt().recip());
        let terms = [D::from(0.0); PANELS.len() * NODES];
        let product = Self { a, b, closed, reach: 0.0, terms, largest: 0.0 };
        if closed.is_some() { product } else { product.tabulated() }
    }

    /// With terms for the quadrature.
    fn tabulated(mut self) -> Self {
        self.reach = self.decayed();
        for (panel, (begin, end)) in PANELS.into_iter().enumerate() {
            for i in 0..NODES {
                let (r, weight) = node(i, begin * self.reach, end * self.reach);
                let term = self.covariance(r) * (TAU * r * weight);
                self.terms[panel * NODES + i] = term;
                self.largest += term.re();
            }
        }
        self
    }

    /// The distance at which the product has decayed, to the next eighth.
    fn decayed(&self) -> f64 {
        let floor = self.covariance(0.0).re().abs() * DECAYED;
        let is_left = |r: f64| self.covariance(r).re().abs() > floor;
        let mut doublings = (-40..=40).rev().map(|power| 2f64.powi(power));
        let last = doublings.find(|r| is_left(*r)).unwrap_or(0.5);
        let mut eighths = (9..=16).map(|eighths| last * 0.125 * f64::from(eighths));
        eighths.find(|r| !is_left(*r)).unwrap_or(2.0 * last)
    }

    /// `S(w)` by the quadrature.
    fn density(&self, w: f64) -> D {
        let mut sum = D::from(0.0);
        for (panel, (begin, end)) in PANELS.iter().enumerate() {
            let (begin, length) = (begin * self.reach, (end - begin) * self.reach);
            let pieces = (w * length / RESOLVED).ceil().max(1.0);
            let piece = length / pieces;
            for i in 0..pieces as usize {
                let begin = begin + piece * i as f64;
                for j in 0..NODES {
                    let (r, weight) = node(j, begin, begin + piece);
                    let term = if pieces > 1.0 {
                        self.covariance(r) * (TAU * r * weight)
                    } else {
                        self.terms[panel * NODES + j]
                    };
                    sum += term * libm::j0(w * r);
                }
            }
        }
        sum
    }
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>> Kernel<D> for Product<D, A, B> {
    fn sqrt_density(&self, w: f64) -> D {
        if let Some(lengthscale) = self.closed {
            return Rbf { lengthscale }.sqrt_density(w);
        }
        let density = self.density(w);
        // what is below is rounding, and may be negative
        if density.re() > self.largest * DECAYED { density.sqrt() } else { D::from(0.0) }
    }
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>> Covariance<D> for Product<D, A, B> {
    fn covariance(&self, r: f64) -> D {
        self.a.covariance(r) * self.b.covariance(r)
    }
    fn squared_exponential(&self) -> Option<D> {
        self.closed
    }
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>, K: Kernel<D>> Add<K> for Product<D, A, B> {
    type Output = Sum<D, Self, K>;
    fn add(self, other: K) -> Self::Output {
        Sum::new(self, other)
    }
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>, K: Covariance<D>> Mul<K> for Product<D, A, B> {
    type Output = Product<D, Self, K>;
    fn mul(self, other: K) -> Self::Output {
        Product::new(self, other)
    }
}
