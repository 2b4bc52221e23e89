//! What the blocked sampler asks of a density: a block of Gaussian coefficients that the likelihood
//! sees only through a few latent values.

use crate::infer::LogDensity;
use rand::Rng;

/// A density whose unknowns are a block of coefficients w and *outer* unknowns.
///
/// ```text
/// ln π = ln p(outer) − ½ Σ τᵢ wᵢ² + Σ_sites ln L(θ_site, outer)      τᵢ = 1, of a flat mean 0
/// θ_f(site) = offset_f + A_f(site, ·) w_f
/// ```
/// The design A and the offsets depend on the *hyperparameters*, which are some of the outer
/// unknowns; a site's likelihood depends on the values of all fields there, and on no other site's.
/// Whatever of the density's own unknowns the likelihood does not see is drawn from its exact
/// conditional by [`Latent::join`].
pub trait LatentGaussian: LogDensity {
    /// Sizes and structure.
    fn layout(&self) -> &Layout;
    /// A function object with its own scratch memory, one per thread.
    fn latent(&self) -> Box<dyn Latent + '_>;
}

/// Sizes and structure of a [`LatentGaussian`].
#[derive(Clone, Debug)]
pub struct Layout {
    /// Number of sites.
    pub n_sites: usize,
    /// The fields.
    pub fields: Vec<FieldLayout>,
    /// Which of the density's unknowns are outer.
    pub outer: Vec<usize>,
    /// Which of the outer unknowns are hyperparameters, ascending.
    pub hyper: Vec<usize>,
}

/// The columns of one field's design.
#[derive(Clone, Debug)]
pub struct FieldLayout {
    /// Number of standard normal coefficients.
    pub n_coefficients: usize,
    /// The prior precision of a mean that follows them, with a last column: 1, or 0 if it is flat.
    pub mean_precision: Option<f64>,
    /// What is known of the design beforehand.
    pub shape: Shape,
}

/// What is known of a design for all hyperparameters.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Lower triangular, a coefficient per site.
    Triangular,
    /// These modes `(n_sites, n_coefficients)`, each times a scale.
    Scaled(Vec<f64>),
}

impl FieldLayout {
    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.n_coefficients + usize::from(self.mean_precision.is_some())
    }
}

impl Layout {
    /// Length of the block: the coefficients of all fields, each followed by its mean.
    pub fn n_block(&self) -> usize {
        self.fields.iter().map(FieldLayout::width).sum()
    }

    /// Number of latent values, `(field, site)`.
    pub fn n_latent(&self) -> usize {
        self.n_sites * self.fields.len()
    }

    /// The outer unknowns of a position.
    pub(super) fn outer_of(&self, position: &[f64]) -> Vec<f64> {
        self.outer.iter().map(|i| position[*i]).collect()
    }

    /// The outer unknowns that are no hyperparameters.
    pub(super) fn free(&self) -> Vec<usize> {
        (0..self.outer.len()).filter(|i| self.hyper.binary_search(i).is_err()).collect()
    }

    /// First column of each field.
    pub(super) fn starts(&self) -> Vec<usize> {
        let mut at = 0;
        let next = |field: &FieldLayout| {
            at += field.width();
            at - field.width()
        };
        self.fields.iter().map(next).collect()
    }
}

/// The map from coefficients to latent values at some hyperparameters.
#[derive(Clone, Debug)]
pub struct Design {
    /// One number per field, added at every site.
    pub offset: Vec<f64>,
    /// Per field, row-major `(n_sites, width)`; the column of a mean is ones from the start.
    pub rows: Vec<Vec<f64>>,
    /// Per field `(width)`: what each mode is multiplied by ([`Shape::Scaled`]), and the ones of a
    /// mean.
    pub scale: Vec<Vec<f64>>,
}

impl Design {
    /// For this layout, with columns of ones for the means.
    pub fn new(layout: &Layout) -> Self {
        let rows = |field: &FieldLayout| {
            let width = field.width();
            let mut rows = vec![0.0; layout.n_sites * width];
            if field.mean_precision.is_some() {
                rows.chunks_exact_mut(width).for_each(|row| row[width - 1] = 1.0);
            }
            rows
        };
        Self {
            offset: vec![0.0; layout.fields.len()],
            rows: layout.fields.iter().map(rows).collect(),
            scale: layout.fields.iter().map(|field| vec![1.0; field.width()]).collect(),
        }
    }
}

/// Evaluates a [`LatentGaussian`]; holds scratch memory.
pub trait Latent {
    /// The block's coefficients at a position `(dim)`.
    fn block(&mut self, position: &[f64], block: &mut [f64]);

    /// A position of these outer unknowns and coefficients, drawing what they do not determine;
    /// returns the density's own log density there.
    fn join(
        &mut self,
        outer: &[f64],
        block: &[f64],
        rng: &mut dyn Rng,
        position: &mut [f64],
    ) -> f64;

    /// Takes these outer unknowns for [`Latent::ln_likelihood`] and [`Latent::slope`], and writes
    /// their design; returns ln p(outer). Out of support: −∞.
    fn set_outer(&mut self, outer: &[f64], design: &mut Design) -> f64;

    /// Log likelihood of all sites at these latent values `(field, site)`.
    fn ln_likelihood(&mut self, theta: &[f64]) -> f64;

    /// As [`Latent::ln_likelihood`], with its gradient in the latent values.
    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64;

    /// ln p(outer) plus log likelihood, with the gradient in both; the design stays as it is, so
    /// that the gradient in a hyperparameter is meaningless.
    fn slopes(
        &mut self,
        outer: &[f64],
        theta: &[f64],
        theta_bar: &mut [f64],
        outer_bar: &mut [f64],
    ) -> f64;
}
