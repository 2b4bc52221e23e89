//! Coordinates in which the block is nearly standard normal, at given hyperparameters.
//!
//! With the stand-in (W, y) and the design (A, b), I₀ the prior precisions, a zero for a flat mean:
//!
//! ```text
//! B = I₀ + AᵀWA = UᵀU     s = U⁻ᵀ AᵀW(y − b)     w = U⁻¹(s + z)     θ = b + A w
//! −½ wᵀI₀w − ln|U| = −½ zᵀz + ½ (θ − y)ᵀW(θ − y) + κ
//! κ = ½ sᵀs − ½ (y − b)ᵀW(y − b) − ln|U|
//! ```
//! an identity, so that the stand-in cancels from the density and exp κ is its evidence.

use super::latent::{Design, Layout, Shape};
use super::stand_in::StandIn;
use crate::infer::vector::{add_scaled, dot};

/// The whitening at one value of the hyperparameters.
#[derive(Clone, Debug)]
pub(super) struct Whitening {
    pub(super) design: Design,
    n_sites: usize,
    n: usize,
    starts: Vec<usize>,
    triangular: Vec<bool>,
    /// The diagonal of I₀.
    prior_precision: Vec<f64>,
    /// U, row-major `(n, n)`; below the diagonal anything.
    upper: Vec<f64>,
    /// s
    shift: Vec<f64>,
    /// κ
    pub(super) ln_evidence: f64,
    /// A U⁻¹, column after column `(n, n_latent)`; see [`Whitening::set_basis`].
    basis: Vec<f64>,
    /// b + A U⁻¹ s
    origin: Vec<f64>,
    scratch: Vec<f64>,
}

impl Whitening {
    /// Memory for this layout.
    pub(super) fn new(layout: &Layout) -> Self {
        let (n, n_latent, starts) = (layout.n_block(), layout.n_latent(), layout.starts());
        let mut prior_precision = vec![1.0; n];
        for (field, start) in layout.fields.iter().zip(&starts) {
            if let Some(precision) = field.mean_precision {
                prior_precision[start + field.n_coefficients] = precision;
            }
        }
        Self {
            design: Design::new(layout),
            n_sites: layout.n_sites,
            n,
            triangular: layout
                .fields
                .iter()
                .map(|f| matches!(f.shape, Shape::Triangular))
                .collect(),
            prior_precision,
            starts,
            upper: vec![0.0; n * n],
            shift: vec![0.0; n],
            ln_evidence: 0.0,
            basis: vec![0.0; n * n_latent],
            origin: vec![0.0; n_latent],
            scratch: vec![0.0; 2 * n_latent],
        }
    }

    fn n_fields(&self) -> usize {
        self.starts.len()
    }

    fn width(&self, field: usize) -> usize {
        self.starts.get(field + 1).unwrap_or(&self.n) - self.starts[field]
    }

    /// Computes U, s and κ from the design; `false` if B is not positive definite.
    pub(super) fn prepare(&mut self, stand_in: &StandIn) -> bool {
        self.upper.fill(0.0);
        for f in 0..self.n_fields() {
            for g in f..self.n_fields() {
                if self.triangular[f] || self.triangular[g] {
                    self.add_products(stand_in, f, g);
                } else {
                    self.add_gram(stand_in, f, g);
                }
            }
        }
        for (i, precision) in self.prior_precision.iter().enumerate() {
            self.upper[i * self.n + i] += precision;
        }
        let quadratic = self.set_moment(stand_in);
        let Some(ln_det) = factorise(&mut self.upper, self.n) else { return false };
        solve_transposed(&self.upper, &mut self.shift);
        self.ln_evidence = 0.5 * dot(&self.shift, &self.shift) - quadratic - ln_det;
        self.ln_evidence.is_finite()
    }

    /// Block (f, g) of `AᵀWA`, site by site; of its diagonal blocks the upper triangle.
    fn add_products(&mut self, stand_in: &StandIn, f: usize, g: usize) {
        let (wf, wg) = (self.width(f), self.width(g));
        let information = stand_in.information(f, g);
        for (site, w) in information.iter().enumerate() {
            let left = &self.design.rows[f][site * wf..][..wf];
            let right = &self.design.rows[g][site * wg..][..wg];
            for (j, a) in left.iter().enumerate() {
                if *a != 0.0 {
                    let from = if f == g { j } else { 0 };
                    let row = &mut self.upper[(self.starts[f] + j) * self.n + self.starts[g]..];
                    add_scaled(&mut row[from..wg], w * a, &right[from..]);
                }
            }
        }
    }

    /// Block (f, g) of `AᵀWA` of two scaled fields.
    fn add_gram(&mut self, stand_in: &StandIn, f: usize, g: usize) {
        let (scale_f, scale_g) = (&self.design.scale[f], &self.design.scale[g]);
        let gram = stand_in.gram(f, g).chunks_exact(scale_g.len());
        for ((j, a), gram) in scale_f.iter().enumerate().zip(gram) {
            let row = &mut self.upper[(self.starts[f] + j) * self.n + self.starts[g]..];
            for ((entry, gram), b) in row.iter_mut().zip(gram).zip(scale_g) {
                *entry = a * gram * b;
            }
        }
    }

    /// AᵀW(y − b) into the shift; returns ½ (y − b)ᵀW(y − b).
    fn set_moment(&mut self, stand_in: &StandIn) -> f64 {
        let n = self.n_sites;
        let (d, product) = self.scratch.split_at_mut(n * self.starts.len());
        d.copy_from_slice(stand_in.centre());
        for (d, offset) in d.chunks_exact_mut(n).zip(&self.design.offset) {
            for d in d.iter_mut() {
                *d -= offset;
            }
        }
        product.fill(0.0);
        let quadratic = stand_in.add_product(d, product);
        self.shift.fill(0.0);
        for (f, product) in product.chunks_exact(n).enumerate() {
            let rows = &self.design.rows[f];
            let width = rows.len() / n;
            for (row, p) in rows.chunks_exact(width).zip(product) {
                add_scaled(&mut self.shift[self.starts[f]..][..width], *p, row);
            }
        }
        quadratic
    }

    /// w = U⁻¹(s + z)
    pub(super) fn block(&self, z: &[f64], w: &mut [f64]) {
        for ((w, s), z) in w.iter_mut().zip(&self.shift).zip(z) {
            *w = s + z;
        }
        let n = self.n;
        for i in (0..n).rev() {
            let row = &self.upper[i * n..][..n];
            w[i] = (w[i] - dot(&row[i + 1..], &w[i + 1..])) / row[i];
        }
    }

    /// z = U w − s
    pub(super) fn whitened(&self, w: &[f64], z: &mut [f64]) {
        for (i, (z, s)) in z.iter_mut().zip(&self.shift).enumerate() {
            *z = dot(&self.upper[i * self.n..][i..self.n], &w[i..]) - s;
        }
    }

    /// θ = b + A w
    pub(super) fn latent(&self, w: &[f64], theta: &mut [f64]) {
        for f in 0..self.n_fields() {
            let width = self.width(f);
            let w = &w[self.starts[f]..][..width];
            let theta = &mut theta[f * self.n_sites..][..self.n_sites];
            for (theta, row) in theta.iter_mut().zip(self.design.rows[f].chunks_exact(width)) {
                *theta = self.design.offset[f] + dot(row, w);
            }
        }
    }

    /// Computes A U⁻¹, for [`Whitening::latent_at`] and [`Whitening::pull`].
    pub(super) fn set_basis(&mut self) {
        let (n, m) = (self.n, self.origin.len());
        self.basis.fill(0.0);
        for f in 0..self.n_fields() {
            let width = self.width(f);
            for (site, row) in self.design.rows[f].chunks_exact(width).enumerate() {
                let at = f * self.n_sites + site;
                self.origin[at] = self.design.offset[f];
                for (j, a) in row.iter().enumerate() {
                    self.basis[(self.starts[f] + j) * m + at] = *a;
                }
            }
        }
        for k in 0..n {
            let row = &self.upper[k * n..][..n];
            let (done, rest) = self.basis.split_at_mut((k + 1) * m);
            let column = &mut done[k * m..];
            let inverse = 1.0 / row[k];
            for x in column.iter_mut() {
                *x *= inverse;
            }
            for (next, u) in rest.chunks_exact_mut(m).zip(&row[k + 1..]) {
                add_scaled(next, -u, column);
            }
            add_scaled(&mut self.origin, self.shift[k], column);
        }
    }

    /// θ at z, by the basis.
    pub(super) fn latent_at(&self, z: &[f64], theta: &mut [f64]) {
        theta.copy_from_slice(&self.origin);
        for (z, column) in z.iter().zip(self.basis.chunks_exact(theta.len())) {
            add_scaled(theta, *z, column);
        }
    }

    /// The gradient in z of a function with this gradient in θ.
    pub(super) fn pull(&self, theta_bar: &[f64], z_bar: &mut [f64]) {
        for (z_bar, column) in z_bar.iter_mut().zip(self.basis.chunks_exact(theta_bar.len())) {
            *z_bar = dot(column, theta_bar);
        }
    }
}

/// `B = UᵀU` in place, upper triangle, row-major; ln|U|, or `None` if B is not positive definite.
fn factorise(upper: &mut [f64], n: usize) -> Option<f64> {
    let (mut ln_det, mut product) = (0.0, 1.0);
    for k in 0..n {
        let (head, rest) = upper.split_at_mut((k + 1) * n);
        let row = &mut head[k * n + k..];
        if !(row[0] > 0.0 && row[0] < f64::INFINITY) {
            return None;
        }
        let pivot = row[0].sqrt();
        row[0] = pivot;
        product *= pivot;
        if !(1e-150..1e150).contains(&product) {
            ln_det += product.ln();
            product = 1.0;
        }
        let inverse = 1.0 / pivot;
        row[1..].iter_mut().for_each(|x| *x *= inverse);
        for (i, next) in (k + 1..n).zip(rest.chunks_exact_mut(n)) {
            add_scaled(&mut next[i..], -row[i - k], &row[i - k..]);
        }
    }
    Some(ln_det + product.ln())
}

/// x ← U⁻ᵀ x
fn solve_transposed(upper: &[f64], x: &mut [f64]) {
    let n = x.len();
    for (k, row) in upper.chunks_exact(n).enumerate() {
        let (done, rest) = x.split_at_mut(k + 1);
        done[k] /= row[k];
        add_scaled(rest, -done[k], &row[k + 1..]);
    }
}
