//! Between a field's coefficients η and the combinations of them that its sites see.
//!
//! ```text
//! ζ_k = Σ_terms a_k η_k,  a_k = amplitude √S_k / √s_k        Σ_terms a_k² = 1
//! diag(√s) Φᵀ = V Lᵀ      w = Vᵀ ζ                           VᵀV = I
//! ```
//! So w and ζ are standard normal if η is. Given w, ζ = V w + (I − V Vᵀ) ε. Given ζ, η = a ζ + (I −
//! a aᵀ) ε. In both, ε is standard normal.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::gp::{Field, Term};
use crate::num::vector::{axpy, dot};

/// What the sites of a field determine of its coefficients.
pub(super) struct Seen<'a> {
    /// w of every site, or ζ of every mode.
    pub(super) w: &'a [f64],
    /// Whether it is w.
    pub(super) is_collapsed: bool,
}

/// √s, and a of each term.
struct Shares {
    scale: Vec<f64>,
    terms: Vec<Vec<f64>>,
}

impl Shares {
    fn new(op: &Field, v: &[f64]) -> Self {
        let weight = |term: &Term| {
            let amplitude = term.amplitude.value(v);
            let mut c = vec![0.0; op.k];
            term.spectrum.values(v, &op.frequency[..term.k], &mut c[..term.k]);
            for c in &mut c {
                *c *= amplitude;
            }
            c
        };
        let mut terms: Vec<Vec<f64>> = op.terms.iter().map(weight).collect();
        let norm = |k: usize| terms.iter().map(|a| a[k] * a[k]).sum::<f64>().sqrt();
        let scale: Vec<f64> = (0..op.k).map(norm).collect();
        for a in &mut terms {
            for (a, scale) in a.iter_mut().zip(&scale).filter(|(_, scale)| **scale > 0.0) {
                *a /= scale;
            }
        }
        Self { scale, terms }
    }
}

/// w, or ζ, at a position of the model's unknowns.
pub(super) fn coefficients(
    op: &Field,
    modes: &[f64],
    v: &[f64],
    position: &[f64],
    is_collapsed: bool,
) -> Vec<f64> {
    let shares = Shares::new(op, v);
    let mut zeta = vec![0.0; op.k];
    for (term, a) in op.terms.iter().zip(&shares.terms) {
        for ((zeta, a), eta) in zeta.iter_mut().zip(a).zip(&position[term.eta..][..term.k]) {
            *zeta += a * eta;
        }
    }
    if !is_collapsed {
        return zeta;
    }
    directions(modes, &shares.scale).chunks_exact(op.k).map(|row| dot::<8>(row, &zeta)).collect()
}

/// Writes η of every term into a position. It is drawn from its conditional given what the sites
/// see.
pub(super) fn weights_of(
    op: &Field,
    modes: &[f64],
    v: &[f64],
    seen: &Seen<'_>,
    rng: &mut dyn Rng,
    position: &mut [f64],
) {
    let shares = Shares::new(op, v);
    let mut zeta = seen.w.to_vec();
    if seen.is_collapsed {
        zeta = normal(op.k, rng);
        for (direction, w) in directions(modes, &shares.scale).chunks_exact(op.k).zip(seen.w) {
            // the directions are orthonormal, so one after the other is all at once
            if direction.iter().any(|x| *x != 0.0) {
                let excess = w - dot::<8>(direction, &zeta);
                axpy(excess, direction, &mut zeta);
            }
        }
    }
    if let [term] = &op.terms[..] {
        // with one term a = ±1; a mode of no weight at all keeps a standard normal of its own
        for (k, zeta) in zeta.iter().enumerate() {
            let a = shares.terms[0][k];
            position[term.eta + k] = if a < 0.0 { -zeta } else { *zeta };
        }
        return;
    }
    split(op, &shares, &zeta, rng, position);
}

/// η of several terms given their sum ζ.
fn split(op: &Field, shares: &Shares, zeta: &[f64], rng: &mut dyn Rng, position: &mut [f64]) {
    let epsilon: Vec<Vec<f64>> = op.terms.iter().map(|_| normal(op.k, rng)).collect();
    for (k, zeta) in zeta.iter().enumerate() {
        let sum: f64 = shares.terms.iter().zip(&epsilon).map(|(a, e)| a[k] * e[k]).sum();
        for ((term, a), e) in op.terms.iter().zip(&shares.terms).zip(&epsilon) {
            if k < term.k {
                position[term.eta + k] = e[k] + a[k] * (zeta - sum);
            }
        }
    }
}

fn normal(n: usize, rng: &mut dyn Rng) -> Vec<f64> {
    (0..n).map(|_| rng.sample(StandardNormal)).collect()
}

/// V, one direction `(k)` per site, by Gram–Schmidt on the rows of Φ diag(√s), each orthogonalised
/// twice. If the rows before one determine it to rounding, its direction is zero.
fn directions(modes: &[f64], scale: &[f64]) -> Vec<f64> {
    const ROUNDING: f64 = 1e-14;
    let k = scale.len();
    let mut v: Vec<f64> = modes.iter().zip(scale.iter().cycle()).map(|(m, s)| m * s).collect();
    for i in 0..v.len() / k {
        let (done, rest) = v.split_at_mut(i * k);
        let row = &mut rest[..k];
        let length = dot::<8>(row, row).sqrt();
        for _ in 0..2 {
            for other in done.chunks_exact(k) {
                axpy(-dot::<8>(row, other), other, row);
            }
        }
        let left = dot::<8>(row, row).sqrt();
        let inverse = if left > ROUNDING * length { 1.0 / left } else { 0.0 };
        for x in row.iter_mut() {
            *x *= inverse;
        }
    }
    v
}
