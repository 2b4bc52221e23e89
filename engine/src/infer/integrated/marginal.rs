//! The density of the outer unknowns with the coefficients integrated out.
//!
//! ```text
//! ln L(θ) = ℓ₀ + g₀ᵀ(θ − θ₀) − ½ (θ − θ₀)ᵀ W (θ − θ₀)      θ = θ₀ + A w,  w ~ N(0, T⁻¹),  A = Φ diag(s)
//! P = T + AᵀWA,  b = Aᵀg₀:    ln ∫ = ℓ₀ + ½ bᵀP⁻¹b − ½ ln |P| + const,    w | data ~ N(P⁻¹b, P⁻¹)
//! ```
//! ℓ₀, g₀ and W are asked of the likelihood at θ₀, where all coefficients are 0, and one unit beside it. The products
//! `ΦᵀWΦ` cost n K² for n places. Where the outer unknowns change W by a factor alone, as a noise does that all
//! measurements share, they are those of the first time, times the factor.

use crate::infer::blocked::{BlockLayout, Design, Group, Latent, Layout, Shape};
use crate::num::vector::dot;
use faer::linalg::solvers::Llt;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par, Side};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use std::sync::Arc;

/// Differences between two sets of numbers that rounding explains, relative to the largest.
const ROUNDING: f64 = 1e-9;

/// Evaluates the marginal density.
pub(super) struct Marginal<'d> {
    latent: Box<dyn Latent + 'd>,
    layout: &'d Layout,
    /// Offsets and scales; without rows, which nobody asks for.
    designs: Vec<Design>,
    products: Vec<Option<Arc<Products>>>,
    theta: Vec<f64>,
    slope: Vec<f64>,
    /// The slope one unit beside, for each number of a block in its group.
    beside: Vec<Vec<f64>>,
}

/// The marginal at some outer unknowns, and the coefficients' conditional there.
pub(super) struct At {
    /// ln p(outer) plus the log of the integrated likelihood, up to a constant.
    pub(super) ln_density: f64,
    /// Of each group.
    conditionals: Vec<Conditional>,
}

/// N(P⁻¹b, P⁻¹) of a group's coefficients.
struct Conditional {
    factor: Llt<f64>,
    mean: Mat<f64>,
}

/// What a likelihood comes to in the coefficients of the modes, before they are scaled.
struct Products {
    /// W, `(block, block, place)`.
    information: Vec<f64>,
    /// g₀, `(block, place)`.
    slope: Vec<f64>,
    /// Offset of each block.
    offset: Vec<f64>,
    /// `ΦᵀWΦ`.
    gram: Mat<f64>,
    /// `Φᵀg₀`.
    moment: Vec<f64>,
    /// `ΦᵀW` 1 of each block, `(width, block)`: what a change of its offset does to the moment.
    of_offset: Mat<f64>,
}

impl<'d> Marginal<'d> {
    pub(super) fn new(latent: Box<dyn Latent + 'd>, layout: &'d Layout) -> Self {
        let n_latent = layout.n_latent();
        let most = layout.groups.iter().map(|group| group.blocks.len()).max().unwrap_or(0);
        Self {
            latent,
            layout,
            designs: layout.groups.iter().map(Design::without_rows).collect(),
            products: layout.groups.iter().map(|_| None).collect(),
            theta: vec![0.0; n_latent],
            slope: vec![0.0; n_latent],
            beside: vec![vec![0.0; n_latent]; most],
        }
    }

    /// Takes the products that another of the same density has made, so that they are made once.
    pub(super) fn share(&mut self, other: &Self) {
        self.products.clone_from(&other.products);
    }

    /// The marginal at these outer unknowns; `None` out of support.
    pub(super) fn at(&mut self, outer: &[f64]) -> Option<At> {
        let ln_prior = self.latent.set_outer(outer, &mut self.designs);
        if !ln_prior.is_finite() {
            return None;
        }
        let mut ln_density = ln_prior + self.expand()?;
        let (mut conditionals, mut first) = (vec![], 0);
        for (g, group) in self.layout.groups.iter().enumerate() {
            let n = group.n_latent();
            let here = Here {
                group,
                design: &self.designs[g],
                slope: &self.slope[first..][..n],
                beside: self.beside.iter().map(|beside| &beside[first..][..n]).collect(),
            };
            let (value, conditional) = here.integrated(&mut self.products[g])?;
            ln_density += value;
            conditionals.push(conditional);
            first += n;
        }
        ln_density.is_finite().then_some(At { ln_density, conditionals })
    }

    /// ℓ₀, and sets g₀ and what it is one unit beside.
    fn expand(&mut self) -> Option<f64> {
        self.set_theta(None);
        let value = self.latent.slope(&self.theta, &mut self.slope);
        for block in 0..self.beside.len() {
            self.set_theta(Some(block));
            self.latent.slope(&self.theta, &mut self.beside[block]);
        }
        value.is_finite().then_some(value)
    }

    /// θ₀, in every group one more at all places of this block.
    fn set_theta(&mut self, beside: Option<usize>) {
        let mut rest = &mut self.theta[..];
        for (group, design) in self.layout.groups.iter().zip(&self.designs) {
            for (block, offset) in design.offset.iter().enumerate() {
                let (own, others) = rest.split_at_mut(group.n_seen);
                own.fill(offset + f64::from(u8::from(beside == Some(block))));
                rest = others;
            }
        }
    }

    /// A position of the density's own unknowns: these outer ones, and coefficients from their conditional; returns the density's own log density there.
    pub(super) fn draw(
        &mut self,
        outer: &[f64],
        at: &At,
        rng: &mut dyn Rng,
        position: &mut [f64],
    ) -> f64 {
        let mut coefficients = vec![];
        for conditional in &at.conditionals {
            let n = conditional.mean.nrows();
            let mut w = Mat::from_fn(n, 1, |_, _| rng.sample::<f64, _>(StandardNormal));
            // P = L Lᵀ, so that L⁻ᵀ z has the covariance P⁻¹
            let lower = conditional.factor.L();
            solve_upper_triangular_in_place(lower.transpose(), w.as_mut(), Par::Seq);
            coefficients.extend((0..n).map(|i| conditional.mean[(i, 0)] + w[(i, 0)]));
        }
        self.latent.join(outer, &coefficients, rng, position)
    }
}

/// A group at some outer unknowns.
struct Here<'a> {
    group: &'a Group,
    design: &'a Design,
    slope: &'a [f64],
    beside: Vec<&'a [f64]>,
}

impl Here<'_> {
    /// ½ bᵀP⁻¹b − ½ ln |P| + ½ Σ ln s² of a flat mean, and the conditional; `None` where P is not positive definite.
    fn integrated(&self, products: &mut Option<Arc<Products>>) -> Option<(f64, Conditional)> {
        let factor = products.as_ref().and_then(|known| self.factor(known));
        let (known, factor) = match (products, factor) {
            (Some(known), Some(factor)) => (&**known, factor),
            (products, _) => (&**products.insert(Arc::new(self.products())), 1.0),
        };
        let scale = self.design.scale.concat();
        let n = scale.len();
        let precision = self.prior_precision();
        let p = Mat::from_fn(n, n, |i, j| {
            let prior = if i == j { precision[i] } else { 0.0 };
            prior + factor * scale[i] * scale[j] * known.gram[(i, j)]
        });
        let moved: Vec<f64> =
            self.design.offset.iter().zip(&known.offset).map(|(new, old)| new - old).collect();
        let moment = |i: usize| {
            let change: f64 =
                moved.iter().enumerate().map(|(h, d)| known.of_offset[(i, h)] * d).sum();
            factor * scale[i] * (known.moment[i] - change)
        };
        let b = Mat::from_fn(n, 1, |i, _| moment(i));
        let cholesky = p.llt(Side::Lower).ok()?;
        let lower = cholesky.L();
        let mut whitened = b;
        solve_lower_triangular_in_place(lower, whitened.as_mut(), Par::Seq);
        let quadratic: f64 = (0..n).map(|i| whitened[(i, 0)].powi(2)).sum();
        let ln_root: f64 = (0..n).map(|i| lower[(i, i)].ln()).sum();
        let mut mean = whitened;
        solve_upper_triangular_in_place(lower.transpose(), mean.as_mut(), Par::Seq);
        Some((0.5 * quadratic - ln_root, Conditional { factor: cholesky, mean }))
    }

    /// τ of every coefficient.
    fn prior_precision(&self) -> Vec<f64> {
        let of_block = |block: &BlockLayout| {
            vec![1.0; block.n_coefficients].into_iter().chain(block.mean_precision)
        };
        self.group.blocks.iter().flat_map(of_block).collect()
    }

    /// W between two blocks at a place.
    fn information(&self, f: usize, h: usize, place: usize) -> f64 {
        let at = f * self.group.n_seen + place;
        self.slope[at] - self.beside[h][at]
    }

    /// By what factor the information has changed since `known`, if by that alone, and if the slope has changed as the
    /// offsets say.
    fn factor(&self, known: &Products) -> Option<f64> {
        let (n, blocks) = (self.group.n_seen, self.group.blocks.len());
        let each = || (0..blocks).flat_map(move |f| (0..blocks).map(move |h| (f, h)));
        let largest = |x: &[f64]| x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let by_size = known.information.iter().enumerate();
        let (first, most) = by_size.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        let most = most.abs();
        let (pair, place) = (first / n, first % n);
        let factor =
            self.information(pair / blocks, pair % blocks, place) / known.information[first];
        let is_same = each().zip(known.information.chunks_exact(n)).all(|((f, h), known)| {
            let own = known.iter().enumerate();
            own.into_iter().all(|(place, w)| {
                (self.information(f, h, place) - factor * w).abs() <= ROUNDING * factor * most
            })
        });
        let most = largest(&known.slope).max(most);
        let moved: Vec<f64> =
            self.design.offset.iter().zip(&known.offset).map(|(new, old)| new - old).collect();
        let is_moved = (0..blocks).all(|f| {
            (0..n).all(|place| {
                let change: f64 = (0..blocks)
                    .map(|h| known.information[(f * blocks + h) * n + place] * moved[h])
                    .sum();
                let at = f * n + place;
                (self.slope[at] - factor * (known.slope[at] - change)).abs()
                    <= ROUNDING * factor * most
            })
        });
        (factor > 0.0 && is_same && is_moved).then_some(factor)
    }

    /// The products at the present outer unknowns.
    fn products(&self) -> Products {
        let (n, blocks) = (self.group.n_seen, &self.group.blocks);
        let modes: Vec<Mat<f64>> = blocks.iter().map(|block| modes(block, n)).collect();
        let starts = self.group.starts();
        let width = self.group.n_coefficients();
        let mut gram = Mat::zeros(width, width);
        let mut of_offset = Mat::zeros(width, blocks.len());
        let mut information = vec![];
        for (f, left) in modes.iter().enumerate() {
            for (h, right) in modes.iter().enumerate() {
                let w: Vec<f64> = (0..n).map(|place| self.information(f, h, place)).collect();
                let weighted =
                    Mat::from_fn(n, right.ncols(), |place, k| w[place] * right[(place, k)]);
                let product = left.transpose() * &weighted;
                for i in 0..left.ncols() {
                    for j in 0..right.ncols() {
                        gram[(starts[f] + i, starts[h] + j)] = product[(i, j)];
                    }
                    of_offset[(starts[f] + i, h)] = dot::<4>(left.col_as_slice(i), &w);
                }
                information.extend(w);
            }
        }
        let moment = |f: usize| {
            let slope = &self.slope[f * n..][..n];
            (0..modes[f].ncols())
                .map(|i| dot::<4>(modes[f].col_as_slice(i), slope))
                .collect::<Vec<_>>()
        };
        Products {
            information,
            slope: self.slope.to_vec(),
            offset: self.design.offset.clone(),
            moment: (0..blocks.len()).flat_map(moment).collect(),
            gram,
            of_offset,
        }
    }
}

/// Φ of a block, `(places, width)`, with the ones of its mean. A triangular design, of which there is no product to
/// keep, has none.
fn modes(block: &BlockLayout, n: usize) -> Mat<f64> {
    let k = block.n_coefficients;
    let entry = |place: usize, j: usize| match &block.shape {
        Shape::Scaled(modes) if j < k => modes[place * k + j],
        _ => 1.0,
    };
    Mat::from_fn(n, block.width(), entry)
}
