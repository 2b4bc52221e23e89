//! The density of the outer unknowns with the coefficients integrated out.
//!
//! ```text
//! ln L(θ) = ℓ₀ + g₀ᵀ(θ − θ₀) − ½ (θ − θ₀)ᵀ W (θ − θ₀)      θ = θ₀ + A w,  w ~ N(0, T⁻¹),  A = Φ diag(s)
//! P = T + AᵀWA,  b = Aᵀg₀:    ln ∫ = ℓ₀ + ½ bᵀP⁻¹b − ½ ln |P| + const,    w | data ~ N(P⁻¹b, P⁻¹)
//! ```
//! ℓ₀, g₀ and W are asked of the likelihood at θ₀, where all coefficients are 0, and one unit beside it. A free latent
//! value is one more row of Φ, and one more column, with a 1 where they meet. The products `ΦᵀWΦ` cost n K² for n places.
//! Where the outer unknowns change W by a factor alone, as a noise does that all measurements share, they are those of
//! the first time, times the factor.

use super::products::{Conditional, Here, Products};
use crate::infer::blocked::{Design, Latent, Layout};
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Mat, Par};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use std::sync::Arc;

/// Evaluates the marginal density.
pub(super) struct Marginal<'d> {
    latent: Box<dyn Latent + 'd>,
    layout: &'d Layout,
    /// Offsets and scales; without rows, which nobody asks for.
    designs: Vec<Design>,
    /// Of each group those that were made last, and the first, which all chains share.
    products: Vec<Option<Arc<Products>>>,
    first: Vec<Option<Arc<Products>>>,
    made_at: MadeAt,
    theta: Vec<f64>,
    slope: Vec<f64>,
    /// The slope one unit beside, for each number of a block in its group; last, all free values moved together.
    beside: Vec<Vec<f64>>,
}

/// The outer unknowns at which the products of each group were made; `None` for the first. The last bits of what is
/// computed with them depend on it.
pub(super) type MadeAt = Vec<Option<Vec<f64>>>;

/// Where latent values are moved to.
#[derive(Clone, Copy, PartialEq)]
enum Moved {
    Nothing,
    /// The blocks of this number in their groups, at all places, by one unit.
    Block(usize),
    /// A free value, by one unit.
    Free(usize),
    /// All free values, each by another step, so that what they do to the slope cannot cancel.
    AllFree,
}

/// The marginal at some outer unknowns, and the coefficients' conditional there.
pub(super) struct At {
    /// ln p(outer) plus the log of the integrated likelihood, up to a constant.
    pub(super) ln_density: f64,
    /// Of each group.
    conditionals: Vec<Conditional>,
    /// Where the products were made that it was computed with.
    pub(super) products: MadeAt,
}

impl<'d> Marginal<'d> {
    pub(super) fn new(latent: Box<dyn Latent + 'd>, layout: &'d Layout) -> Self {
        let n_latent = layout.n_latent();
        let most = layout.groups.iter().map(|group| group.blocks.len()).max().unwrap_or(0);
        let most = most + usize::from(!layout.free_precision.is_empty());
        Self {
            latent,
            layout,
            designs: layout.designs_without_rows(),
            products: layout.groups.iter().map(|_| None).collect(),
            first: layout.groups.iter().map(|_| None).collect(),
            made_at: vec![None; layout.groups.len()],
            theta: vec![0.0; n_latent],
            slope: vec![0.0; n_latent],
            beside: vec![vec![0.0; n_latent]; most],
        }
    }

    /// Takes the products that another of the same density has made, so that they are made once.
    pub(super) fn share(&mut self, other: &Self) {
        self.products.clone_from(&other.products);
        self.first.clone_from(&other.products);
    }

    /// Which products are known.
    pub(super) fn made_at(&self) -> &MadeAt {
        &self.made_at
    }

    /// Makes the products again that were known; `None` if they cannot have been.
    pub(super) fn remake(&mut self, made_at: &MadeAt) -> Option<()> {
        let mut remade = self.first.clone();
        for (g, outer) in made_at.iter().enumerate() {
            let Some(outer) = outer else { continue };
            self.products[g] = None;
            self.at(outer);
            remade[g] = Some(self.products[g].clone()?);
        }
        (self.products, self.made_at) = (remade, made_at.clone());
        Some(())
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
            let n = group.n_latent() + self.layout.free_precision.len();
            let here = Here {
                group,
                design: &self.designs[g],
                free_precision: &self.layout.free_precision,
                free: self.designs.get(self.layout.groups.len()),
                slope: &self.slope[first..][..n],
                beside: self.beside.iter().map(|beside| &beside[first..][..n]).collect(),
            };
            let factor = self.products[g].as_ref().and_then(|known| here.factor(known));
            if factor.is_none() {
                let of_free = Self::of_free(
                    &mut *self.latent,
                    (self.layout, &self.designs),
                    &mut self.theta,
                    here.slope,
                );
                self.products[g] = Some(Arc::new(here.products(&of_free)));
                self.made_at[g] = Some(outer.to_vec());
            }
            let known = self.products[g].as_ref()?;
            let (value, conditional) = here.integrated(known, factor.unwrap_or(1.0))?;
            ln_density += value;
            conditionals.push(conditional);
            first += n;
        }
        ln_density.is_finite().then_some(At {
            ln_density,
            conditionals,
            products: self.made_at.clone(),
        })
    }

    /// ℓ₀, and sets g₀ and what it is beside.
    fn expand(&mut self) -> Option<f64> {
        let at = (self.layout, &self.designs[..]);
        set_theta(at, Moved::Nothing, &mut self.theta);
        let value = self.latent.slope(&self.theta, &mut self.slope);
        let n_blocks = self.beside.len() - usize::from(!self.layout.free_precision.is_empty());
        for (k, beside) in self.beside.iter_mut().enumerate() {
            let moved = if k < n_blocks { Moved::Block(k) } else { Moved::AllFree };
            set_theta(at, moved, &mut self.theta);
            self.latent.slope(&self.theta, beside);
        }
        value.is_finite().then_some(value)
    }

    /// W times one unit of each free value, `(value, latent)`.
    fn of_free(
        latent: &mut dyn Latent,
        at: (&Layout, &[Design]),
        theta: &mut [f64],
        slope: &[f64],
    ) -> Vec<Vec<f64>> {
        let column = |k: usize| {
            set_theta(at, Moved::Free(k), theta);
            let mut column = vec![0.0; theta.len()];
            latent.slope(theta, &mut column);
            column.iter_mut().zip(slope).for_each(|(beside, here)| *beside = here - *beside);
            column
        };
        (0..at.0.free_precision.len()).map(column).collect()
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

/// Writes θ₀ with some of its values moved.
fn set_theta((layout, designs): (&Layout, &[Design]), moved: Moved, theta: &mut [f64]) {
    let mut rest = theta;
    for (group, design) in layout.groups.iter().zip(designs) {
        for (block, offset) in design.offset.iter().enumerate() {
            let (own, others) = rest.split_at_mut(group.n_seen);
            own.fill(offset + f64::from(u8::from(moved == Moved::Block(block))));
            rest = others;
        }
    }
    if let Some(free) = designs.get(layout.groups.len()) {
        for (k, (theta, offset)) in rest.iter_mut().zip(&free.offset).enumerate() {
            let by = match moved {
                Moved::AllFree => step(k),
                moved => f64::from(u8::from(moved == Moved::Free(k))),
            };
            *theta = offset + by;
        }
    }
}

/// How far a free value moves where all do: between 1 and 2, by the golden section.
fn step(k: usize) -> f64 {
    1.0 + (k as f64 * 0.618_033_988_749_895).fract()
}
