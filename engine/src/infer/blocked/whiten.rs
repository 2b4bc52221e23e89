//! Coordinates in which a group's coefficients are nearly standard normal, at given hyperparameters.
//!
//! The stand-in is (W, y), the design (A, b). I₀ is the diagonal matrix of prior precisions, which
//! has a zero for a flat mean.
//!
//! ```text
//! B = I₀ + AᵀWA = UᵀU     s = U⁻ᵀ AᵀW(y − b)     w = U⁻¹(s + z)     θ = b + A w
//! −½ wᵀI₀w − ln|U| = −½ zᵀz + ½ (θ − y)ᵀW(θ − y) + κ
//! κ = ½ sᵀs − ½ (y − b)ᵀW(y − b) − ln|U|
//! ```
//! The second line is an identity. So the stand-in cancels from the density, and exp κ is its
//! evidence. If y − b is a further column of A, one factorisation gives U, s and κ.

use super::factor::{Lanes, Upper, add_lanes, columns, lanes};
use super::latent::{Design, Group, Shape};
use super::stand_in::GroupStandIn;
use crate::num::vector::{axpy, dot};
use pulp::{Arch, NullaryFnOnce};

/// The whitening of a group at one value of the hyperparameters.
#[derive(Clone, Debug)]
pub(super) struct GroupWhitening {
    n_seen: usize,
    n: usize,
    starts: Vec<usize>,
    /// The diagonal of I₀.
    prior_precision: Vec<f64>,
    /// Whether all designs are scaled modes. Their products are known beforehand.
    is_scaled: bool,
    /// `[A d]` with d = y − b, row after row `(n_latent)`; then W times this.
    augmented: [Vec<Lanes>; 2],
    /// The rows of `[A d]` that are not zero in each of its lanes.
    support: Vec<Vec<usize>>,
    /// U, and s as its further column.
    upper: Upper,
    /// κ
    pub(super) ln_evidence: f64,
    /// A U⁻¹, column after column `(n, n_latent)`; see [`GroupWhitening::set_basis`].
    basis: Vec<f64>,
    /// b + A U⁻¹ s
    origin: Vec<f64>,
    scratch: Vec<f64>,
}

impl GroupWhitening {
    /// Memory for this group.
    pub(super) fn new(group: &Group) -> Self {
        let (n, n_latent, starts) = (group.n_coefficients(), group.n_latent(), group.starts());
        let mut prior_precision = vec![1.0; n];
        for (block, start) in group.blocks.iter().zip(&starts) {
            if let Some(precision) = block.mean_precision {
                prior_precision[start + block.n_coefficients] = precision;
            }
        }
        let rows = vec![Lanes::default(); n_latent * lanes(n)];
        Self {
            n_seen: group.n_seen,
            n,
            prior_precision,
            is_scaled: group.blocks.iter().all(|f| matches!(f.shape, Shape::Scaled(_))),
            augmented: [rows.clone(), rows],
            support: support(group, &starts),
            starts,
            upper: Upper::new(n),
            ln_evidence: 0.0,
            basis: vec![0.0; n * n_latent],
            origin: vec![0.0; n_latent],
            scratch: vec![0.0; 2 * n_latent],
        }
    }

    fn n_blocks(&self) -> usize {
        self.starts.len()
    }

    fn width(&self, block: usize) -> usize {
        self.starts.get(block + 1).unwrap_or(&self.n) - self.starts[block]
    }

    /// Computes U, s and κ from the design; `false` if B is not positive definite.
    pub(super) fn prepare(&mut self, design: &Design, stand_in: &GroupStandIn) -> bool {
        Arch::new().dispatch(Prepare { whitening: self, design, stand_in })
    }

    /// `B = I₀ + AᵀWA`, with `AᵀWd` as a further column and `dᵀWd` at its end.
    #[inline(always)]
    fn set_upper(&mut self, design: &Design, stand_in: &GroupStandIn) {
        if self.is_scaled {
            self.set_gram(design, stand_in);
        } else {
            self.set_augmented(design, stand_in);
            let [left, right] = &self.augmented;
            self.upper.set_product(left, right, &self.support);
        }
        for (i, precision) in self.prior_precision.iter().enumerate() {
            self.upper.row_mut(i)[i] += precision;
        }
    }

    /// `[A d]` and `W [A d]`.
    #[inline(always)]
    fn set_augmented(&mut self, design: &Design, stand_in: &GroupStandIn) {
        let (n_seen, lanes) = (self.n_seen, lanes(self.n));
        let [rows, products] = &mut self.augmented;
        let flat = rows.as_flattened_mut();
        let stride = flat.len() / stand_in.centre().len();
        for (f, start) in self.starts.iter().enumerate() {
            let (from, offset) = (&design.rows[f], design.offset[f]);
            let centre = &stand_in.centre()[f * n_seen..][..n_seen];
            let rows = flat[f * n_seen * stride..].chunks_exact_mut(stride);
            let width = from.len() / n_seen;
            for ((row, from), y) in rows.zip(from.chunks_exact(width)).zip(centre) {
                row[*start..][..width].copy_from_slice(from);
                row[self.n] = y - offset;
            }
        }
        products.fill(Lanes::default());
        for f in 0..self.starts.len() {
            for g in 0..self.starts.len() {
                for (place, w) in stand_in.information(f, g).iter().enumerate() {
                    let row = &rows[(g * n_seen + place) * lanes..][..lanes];
                    let product = &mut products[(f * n_seen + place) * lanes..][..lanes];
                    product.iter_mut().zip(row).for_each(|(sum, x)| add_lanes(sum, *w, x));
                }
            }
        }
    }

    /// Everything but I₀, where the blocks are scaled: from products that are known beforehand.
    #[inline(always)]
    fn set_gram(&mut self, design: &Design, stand_in: &GroupStandIn) {
        for f in 0..self.n_blocks() {
            for g in f..self.n_blocks() {
                let (scale_f, scale_g) = (&design.scale[f], &design.scale[g]);
                let gram = stand_in.gram(f, g).chunks_exact(scale_g.len());
                for ((j, a), gram) in scale_f.iter().enumerate().zip(gram) {
                    let row = &mut self.upper.row_mut(self.starts[f] + j)[self.starts[g]..];
                    for ((entry, gram), b) in row.iter_mut().zip(gram).zip(scale_g) {
                        *entry = a * gram * b;
                    }
                }
            }
        }
        self.set_moment(design, stand_in);
    }

    /// `AᵀWd` and `dᵀWd`.
    #[inline(always)]
    fn set_moment(&mut self, design: &Design, stand_in: &GroupStandIn) {
        let n = self.n_seen;
        let (d, product) = self.scratch.split_at_mut(n * self.starts.len());
        d.copy_from_slice(stand_in.centre());
        for (d, offset) in d.chunks_exact_mut(n).zip(&design.offset) {
            for d in d.iter_mut() {
                *d -= offset;
            }
        }
        product.fill(0.0);
        let quadratic = stand_in.add_product(d, product);
        let moment = &mut self.augmented[0].as_flattened_mut()[..self.n];
        moment.fill(0.0);
        for (f, product) in product.chunks_exact(n).enumerate() {
            let rows = &design.rows[f];
            let width = rows.len() / n;
            for (row, p) in rows.chunks_exact(width).zip(product) {
                axpy(*p, row, &mut moment[self.starts[f]..][..width]);
            }
        }
        for (i, m) in moment.iter().enumerate() {
            self.upper.row_mut(i)[self.n] = *m;
        }
        self.upper.row_mut(self.n)[self.n] = 2.0 * quadratic;
    }

    /// w = U⁻¹(s + z)
    pub(super) fn coefficients(&self, z: &[f64], w: &mut [f64]) {
        for i in (0..self.n).rev() {
            let row = self.upper.row(i);
            w[i] = (self.upper.last(i) + z[i] - dot::<4>(&row[1..], &w[i + 1..])) / row[0];
        }
    }

    /// z = U w − s
    pub(super) fn whitened(&self, w: &[f64], z: &mut [f64]) {
        for (i, z) in z.iter_mut().enumerate() {
            *z = dot::<4>(self.upper.row(i), &w[i..]) - self.upper.last(i);
        }
    }

    /// θ = b + A w
    pub(super) fn latent(&self, design: &Design, w: &[f64], theta: &mut [f64]) {
        for f in 0..self.n_blocks() {
            let width = self.width(f);
            let w = &w[self.starts[f]..][..width];
            let theta = &mut theta[f * self.n_seen..][..self.n_seen];
            for (theta, row) in theta.iter_mut().zip(design.rows[f].chunks_exact(width)) {
                *theta = design.offset[f] + dot::<4>(row, w);
            }
        }
    }

    /// Computes A U⁻¹, for [`GroupWhitening::latent_at`] and [`GroupWhitening::pull`].
    pub(super) fn set_basis(&mut self, design: &Design) {
        let (n, m) = (self.n, self.origin.len());
        self.basis.fill(0.0);
        for f in 0..self.n_blocks() {
            let width = self.width(f);
            for (place, row) in design.rows[f].chunks_exact(width).enumerate() {
                let at = f * self.n_seen + place;
                self.origin[at] = design.offset[f];
                for (j, a) in row.iter().enumerate() {
                    self.basis[(self.starts[f] + j) * m + at] = *a;
                }
            }
        }
        for k in 0..n {
            let row = self.upper.row(k);
            let (done, rest) = self.basis.split_at_mut((k + 1) * m);
            let column = &mut done[k * m..];
            let inverse = 1.0 / row[0];
            for x in column.iter_mut() {
                *x *= inverse;
            }
            for (next, u) in rest.chunks_exact_mut(m).zip(&row[1..]) {
                axpy(-u, column, next);
            }
            axpy(self.upper.last(k), column, &mut self.origin);
        }
    }

    /// b + A U⁻¹ s, and A U⁻¹, column after column.
    pub(super) fn basis(&self) -> (&[f64], &[f64]) {
        (&self.origin, &self.basis)
    }

    /// θ at z, by the basis.
    pub(super) fn latent_at(&self, z: &[f64], theta: &mut [f64]) {
        theta.copy_from_slice(&self.origin);
        for (z, column) in z.iter().zip(self.basis.chunks_exact(theta.len())) {
            axpy(*z, column, theta);
        }
    }

    /// The gradient in z of a function with this gradient in θ.
    pub(super) fn pull(&self, theta_bar: &[f64], z_bar: &mut [f64]) {
        for (z_bar, column) in z_bar.iter_mut().zip(self.basis.chunks_exact(theta_bar.len())) {
            *z_bar = dot::<4>(column, theta_bar);
        }
    }
}

/// [`GroupWhitening::prepare`], compiled for the machine's vector registers.
struct Prepare<'a> {
    whitening: &'a mut GroupWhitening,
    design: &'a Design,
    stand_in: &'a GroupStandIn,
}

impl NullaryFnOnce for Prepare<'_> {
    type Output = bool;
    #[inline(always)]
    fn call(self) -> bool {
        let Self { whitening, design, stand_in } = self;
        whitening.set_upper(design, stand_in);
        let Some((ln_det, left)) = whitening.upper.factorise() else { return false };
        whitening.ln_evidence = -0.5 * left - ln_det;
        whitening.ln_evidence.is_finite()
    }
}

/// For each lane of `[A d]`, the rows `(block, place)` that are not zero there.
fn support(group: &Group, starts: &[usize]) -> Vec<Vec<usize>> {
    let n = group.n_coefficients();
    let is_zero = |row: usize, column: usize| {
        let (f, place) = (row / group.n_seen, row % group.n_seen);
        let block = &group.blocks[f];
        match column.checked_sub(starts[f]) {
            _ if column == n => false,
            Some(j) if j < block.n_coefficients => {
                matches!(block.shape, Shape::Triangular) && j > place
            }
            j => j.is_none_or(|j| j >= block.width()),
        }
    };
    let of_lane = |lane: std::ops::Range<usize>| {
        (0..group.n_latent())
            .filter(|row| lane.clone().any(|column| !is_zero(*row, column)))
            .collect()
    };
    columns(n).map(of_lane).collect()
}
