//! What the blocked sampler asks of a density: blocks of correlated Gaussian latent values, made
//! from coefficients that the likelihood sees through these values alone.

use crate::infer::density::LogDensity;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// A density whose unknowns are the coefficients w of some blocks, and *outer* unknowns.
///
/// A block f is a map from its coefficients to `n_seen` correlated latent values `θ_f`, one for each
/// *place* where the likelihood sees the block. All blocks of a [`Group`] are seen at the same places.
///
/// ```text
/// ln π = ln p(outer) − ½ Σ τᵢ wᵢ² + Σ_sites ln L(θ_site, outer)      τᵢ = 1, of a flat mean 0
/// θ_f(place) = offset_f + A_f(place, ·) w_f
/// ```
/// The design A and the offsets depend on the *hyperparameters*, which are some of the outer
/// unknowns.
///
/// The likelihood of a place depends only on the values of the group's blocks at that place. So two
/// groups are connected through the outer unknowns alone.
///
/// Beside a single group there may be *free* latent values, which are at no place: each is
/// `offset + scale w` with a coefficient of its own, and any measurement may depend on it.
///
/// Some of the density's own unknowns may not be seen by the likelihood. [`Latent::join`] draws
/// them from their exact conditional.
pub trait LatentGaussian: LogDensity {
    /// Sizes and structure.
    fn layout(&self) -> &Layout;
    /// A function object with its own scratch memory, one per thread.
    fn latent(&self) -> Box<dyn Latent + '_>;
    /// Draws of the outer unknowns from their prior, or from about where it lies; `None` if it cannot be drawn from.
    fn prior_outer(&self, n: usize, rng: &mut ChaCha8Rng) -> Option<Vec<Vec<f64>>>;
}

/// Sizes and structure of a [`LatentGaussian`].
#[derive(Clone, Debug)]
pub struct Layout {
    /// The blocks, those together that are seen together.
    pub groups: Vec<Group>,
    /// The prior precision of each free latent value: 1, or 0 if it is flat. Only the integrated sampler takes any, and
    /// only beside a single group.
    pub free_precision: Vec<f64>,
    /// Which of the density's unknowns are outer.
    pub outer: Vec<usize>,
    /// Which of the outer unknowns are hyperparameters, ascending.
    pub hyper: Vec<usize>,
}

/// Blocks that the likelihood sees at the same places.
#[derive(Clone, Debug)]
pub struct Group {
    /// Number of places. It is also the number of values of each block that are seen.
    pub n_seen: usize,
    /// The blocks.
    pub blocks: Vec<BlockLayout>,
}

/// The columns of one block's design.
#[derive(Clone, Debug)]
pub struct BlockLayout {
    /// Number of standard normal coefficients.
    pub n_coefficients: usize,
    /// If a mean follows them as a last column, its prior precision: 1, or 0 if it is flat.
    pub mean_precision: Option<f64>,
    /// What is known of the design beforehand.
    pub shape: Shape,
}

/// What is known of a design for all hyperparameters.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Lower triangular, with a coefficient for each place.
    Triangular,
    /// These modes `(n_seen, n_coefficients)`, each multiplied by a scale that depends on the
    /// hyperparameters.
    Scaled(Arc<Vec<f64>>),
}

impl BlockLayout {
    /// Number of columns.
    pub(in crate::infer) fn width(&self) -> usize {
        self.n_coefficients + usize::from(self.mean_precision.is_some())
    }
}

impl Group {
    /// Number of coefficients of all blocks. The coefficients of a block are followed by its mean.
    pub fn n_coefficients(&self) -> usize {
        self.blocks.iter().map(BlockLayout::width).sum()
    }

    /// Number of latent values, `(block, place)`.
    pub fn n_latent(&self) -> usize {
        self.n_seen * self.blocks.len()
    }

    /// First column of each block.
    pub(in crate::infer) fn starts(&self) -> Vec<usize> {
        let mut at = 0;
        let next = |block: &BlockLayout| {
            at += block.width();
            at - block.width()
        };
        self.blocks.iter().map(next).collect()
    }
}

impl Layout {
    /// Number of coefficients, those of one group after the other, then those of free values.
    pub fn n_coefficients(&self) -> usize {
        self.groups.iter().map(Group::n_coefficients).sum::<usize>() + self.free_precision.len()
    }

    /// Number of latent values, `(group, block, place)`, then the free ones.
    pub fn n_latent(&self) -> usize {
        self.groups.iter().map(Group::n_latent).sum::<usize>() + self.free_precision.len()
    }

    /// Designs of all groups, without rows, for who asks for offsets and scales alone. If there are free values, theirs
    /// is the last, with an offset and a scale for each.
    pub(in crate::infer) fn designs_without_rows(&self) -> Vec<Design> {
        let mut designs: Vec<Design> = self.groups.iter().map(Design::without_rows).collect();
        let n = self.free_precision.len();
        if n > 0 {
            designs.push(Design { offset: vec![0.0; n], rows: vec![], scale: vec![vec![1.0; n]] });
        }
        designs
    }

    /// Number of latent values of the groups before this one.
    pub(super) fn n_latent_before(&self, group: usize) -> usize {
        self.groups[..group].iter().map(Group::n_latent).sum()
    }

    /// The outer unknowns of a position.
    pub(crate) fn outer_of(&self, position: &[f64]) -> Vec<f64> {
        self.outer.iter().map(|i| position[*i]).collect()
    }

    /// The outer unknowns that are no hyperparameters.
    pub(super) fn free(&self) -> Vec<usize> {
        (0..self.outer.len()).filter(|i| self.hyper.binary_search(i).is_err()).collect()
    }
}

/// The map from a group's coefficients to its latent values at some hyperparameters.
#[derive(Clone, Debug)]
pub struct Design {
    /// One number per block, added at every place.
    pub offset: Vec<f64>,
    /// Per block, row-major `(n_seen, width)`; the column of a mean is ones from the start.
    pub rows: Vec<Vec<f64>>,
    /// Per block `(width)`: what each mode is multiplied by (only for [`Shape::Scaled`]), and a 1
    /// for a mean.
    pub scale: Vec<Vec<f64>>,
}

impl Design {
    /// The design of this group, with columns of ones for the means.
    pub fn new(group: &Group) -> Self {
        let rows = |block: &BlockLayout| {
            let width = block.width();
            let mut rows = vec![0.0; group.n_seen * width];
            if block.mean_precision.is_some() {
                rows.chunks_exact_mut(width).for_each(|row| row[width - 1] = 1.0);
            }
            rows
        };
        Self { rows: group.blocks.iter().map(rows).collect(), ..Self::without_rows(group) }
    }

    /// As [`Design::new`], for who asks for offsets and scales alone.
    fn without_rows(group: &Group) -> Self {
        Self {
            offset: vec![0.0; group.blocks.len()],
            rows: group.blocks.iter().map(|_| vec![]).collect(),
            scale: group.blocks.iter().map(|block| vec![1.0; block.width()]).collect(),
        }
    }
}

/// Evaluates a [`LatentGaussian`]; holds scratch memory.
pub trait Latent: Send {
    /// Writes the coefficients of all blocks at a position `(dim)`.
    fn coefficients(&mut self, position: &[f64], coefficients: &mut [f64]);

    /// Writes a position with these outer unknowns and coefficients, and draws what they do not
    /// determine. Returns the density's own log density there.
    fn join(
        &mut self,
        outer: &[f64],
        coefficients: &[f64],
        rng: &mut dyn Rng,
        position: &mut [f64],
    ) -> f64;

    /// Sets the outer unknowns for [`Latent::ln_likelihood`] and [`Latent::slope`], and writes the
    /// designs of the groups and of free values. Returns ln p(outer), which is −∞ out of support.
    fn set_outer(&mut self, outer: &[f64], designs: &mut [Design]) -> f64;

    /// Log likelihood of all places at these latent values, in the order of [`Layout::n_latent`].
    fn ln_likelihood(&mut self, theta: &[f64]) -> f64;

    /// Log likelihood of one place of a group, `[group, place]`, at each of these values there, `(n, n_blocks)`.
    fn ln_likelihoods(&mut self, at: [usize; 2], theta: &[f64], out: &mut [f64]);

    /// As [`Latent::ln_likelihoods`], but of each row of the place on its own, `(row, n)`.
    fn ln_of_rows(&mut self, at: [usize; 2], theta: &[f64]) -> Vec<Vec<f64>>;

    /// As [`Latent::ln_likelihood`], with its gradient in the latent values.
    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64;

    /// ln p(outer) plus log likelihood, with the gradient in the outer unknowns and in the latent
    /// values. The design is not changed, so that the gradient in a hyperparameter means nothing.
    fn slopes(
        &mut self,
        outer: &[f64],
        theta: &[f64],
        theta_bar: &mut [f64],
        outer_bar: &mut [f64],
    ) -> f64;
}
