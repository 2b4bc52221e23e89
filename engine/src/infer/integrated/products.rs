//! What the likelihood of a group comes to in coefficients, and the integral over them.

use crate::infer::blocked::{BlockLayout, Design, Group, Shape};
use crate::num::vector::{axpy, dot};
use faer::linalg::solvers::Llt;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par, Side};

/// Differences between two sets of numbers that rounding explains, relative to the largest.
const ROUNDING: f64 = 1e-9;

/// N(P⁻¹b, P⁻¹) of a group's coefficients.
pub(super) struct Conditional {
    pub(super) factor: Llt<f64>,
    pub(super) mean: Mat<f64>,
}

/// What a likelihood comes to in the coefficients of the modes, before they are scaled.
pub(super) struct Products {
    /// W, `(block, block, place)`.
    information: Vec<f64>,
    /// W times the steps of all free values, `(block, place)` and free; empty where there are none.
    along: Vec<f64>,
    /// g₀, `(block, place)` and free.
    slope: Vec<f64>,
    /// Offset of each block, and of each free value.
    offset: Vec<f64>,
    /// `ΦᵀWΦ`.
    gram: Mat<f64>,
    /// `Φᵀg₀`.
    moment: Vec<f64>,
    /// `ΦᵀW` 1 of each block, `(width, block)`: what a change of its offset does to the moment.
    of_offset: Mat<f64>,
}

/// A group at some outer unknowns, with the free values beside it.
pub(super) struct Here<'a> {
    pub(super) group: &'a Group,
    pub(super) design: &'a Design,
    pub(super) free_precision: &'a [f64],
    pub(super) free: Option<&'a Design>,
    pub(super) slope: &'a [f64],
    pub(super) beside: Vec<&'a [f64]>,
}

impl Here<'_> {
    /// ½ bᵀP⁻¹b − ½ ln |P| + ½ Σ ln s² of a flat mean, and the conditional; `None` where P is not positive definite.
    /// The information is that of `known`, times `factor`.
    pub(super) fn integrated(&self, known: &Products, factor: f64) -> Option<(f64, Conditional)> {
        let mut scale = self.design.scale.concat();
        scale.extend(self.free.iter().flat_map(|free| &free.scale[0]));
        let n = scale.len();
        let precision = self.prior_precision();
        let moment = self.moment(known, factor);
        let p = Mat::from_fn(n, n, |i, j| {
            let prior = if i == j { precision[i] } else { 0.0 };
            prior + factor * scale[i] * scale[j] * known.gram[(i, j)]
        });
        let b = Mat::from_fn(n, 1, |i, _| scale[i] * moment[i]);
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
        self.group.blocks.iter().flat_map(of_block).chain(self.free_precision.to_vec()).collect()
    }

    /// Offsets of blocks and of free values.
    fn offset(&self) -> Vec<f64> {
        let free = self.free.iter().flat_map(|free| &free.offset);
        self.design.offset.iter().chain(free).copied().collect()
    }

    /// W between two blocks at a place.
    fn information(&self, f: usize, h: usize, place: usize) -> f64 {
        let at = f * self.group.n_seen + place;
        self.slope[at] - self.beside[h][at]
    }

    /// By what factor the information has changed since `known`, if by that alone.
    pub(super) fn factor(&self, known: &Products) -> Option<f64> {
        let (n, blocks) = (self.group.n_seen, self.group.blocks.len());
        let by_size = known.information.iter().enumerate();
        let (first, most) = by_size.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        let (pair, place) = (first / n, first % n);
        let factor = self.information(pair / blocks, pair % blocks, place) / most;
        let is_same = |own: f64, known: f64, most: f64| {
            (own - factor * known).abs() <= ROUNDING * factor * most
        };
        let pairs = (0..blocks).flat_map(|f| (0..blocks).map(move |h| (f, h)));
        let is_scaled = pairs.zip(known.information.chunks_exact(n)).all(|((f, h), known)| {
            let places = known.iter().enumerate();
            places
                .into_iter()
                .all(|(place, w)| is_same(self.information(f, h, place), *w, most.abs()))
        });
        let most = largest(&known.along);
        let along = known.along.iter().zip(self.along());
        let is_scaled = is_scaled && along.into_iter().all(|(w, own)| is_same(own, *w, most));
        (factor > 0.0 && is_scaled).then_some(factor)
    }

    /// W times the steps of all free values.
    fn along(&self) -> impl Iterator<Item = f64> {
        let moved = self.free.and_then(|_| self.beside.last());
        moved
            .into_iter()
            .flat_map(|moved| self.slope.iter().zip(*moved))
            .map(|(g, moved)| g - moved)
    }

    /// Φᵀg₀: that of `known` where the slope has changed as the offsets of blocks say, else made anew.
    fn moment(&self, known: &Products, factor: f64) -> Vec<f64> {
        let (n, blocks) = (self.group.n_seen, self.group.blocks.len());
        let moved: Vec<f64> =
            self.offset().iter().zip(&known.offset).map(|(new, old)| new - old).collect();
        let (moved, moved_free) = moved.split_at(blocks);
        let information =
            |f: usize, h: usize, place: usize| known.information[(f * blocks + h) * n + place];
        let most = largest(&known.slope).max(largest(&known.information));
        let is_foreseen = |f: usize, place: usize| {
            let change: f64 =
                moved.iter().enumerate().map(|(h, d)| information(f, h, place) * d).sum();
            let at = f * n + place;
            (self.slope[at] - factor * (known.slope[at] - change)).abs() <= ROUNDING * factor * most
        };
        if moved_free.iter().any(|d| d.abs() > 0.0)
            || !(0..blocks).all(|f| (0..n).all(|place| is_foreseen(f, place)))
        {
            return self.moment_anew();
        }
        let change = |i: usize| -> f64 {
            moved.iter().enumerate().map(|(h, d)| known.of_offset[(i, h)] * d).sum()
        };
        known.moment.iter().enumerate().map(|(i, own)| factor * (own - change(i))).collect()
    }

    fn moment_anew(&self) -> Vec<f64> {
        let n = self.group.n_seen;
        let mut moment = vec![];
        for (block, slope) in self.group.blocks.iter().zip(self.slope.chunks_exact(n.max(1))) {
            let first = moment.len();
            moment.resize(first + block.width(), 0.0);
            for (place, slope) in slope.iter().enumerate() {
                let row = row(block, place);
                axpy(*slope, row, &mut moment[first..][..row.len()]);
                if block.mean_precision.is_some() {
                    moment[first + row.len()] += slope;
                }
            }
        }
        moment.extend_from_slice(&self.slope[self.group.n_latent()..]);
        moment
    }

    /// The products at the present outer unknowns. `of_free` is W times one unit of each free value.
    pub(super) fn products(&self, of_free: &[Vec<f64>]) -> Products {
        let (n, blocks) = (self.group.n_seen, &self.group.blocks);
        let modes: Vec<Mat<f64>> = blocks.iter().map(|block| modes(block, n)).collect();
        let starts = self.group.starts();
        let (of_blocks, n_free) = (self.group.n_coefficients(), of_free.len());
        let width = of_blocks + n_free;
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
            let free = Mat::from_fn(n, n_free, |place, k| of_free[k][f * n + place]);
            let product = left.transpose() * &free;
            for k in 0..n_free {
                for i in 0..left.ncols() {
                    gram[(starts[f] + i, of_blocks + k)] = product[(i, k)];
                    gram[(of_blocks + k, starts[f] + i)] = product[(i, k)];
                }
                of_offset[(of_blocks + k, f)] = of_free[k][f * n..][..n].iter().sum();
            }
        }
        for (k, column) in of_free.iter().enumerate() {
            for (i, w) in column[self.group.n_latent()..].iter().enumerate() {
                gram[(of_blocks + i, of_blocks + k)] = *w;
            }
        }
        Products {
            information,
            along: self.along().collect(),
            slope: self.slope.to_vec(),
            offset: self.offset(),
            moment: self.moment_anew(),
            gram,
            of_offset,
        }
    }
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// The modes of a block at a place. A triangular design, of which there is no product to keep, has none.
fn row(block: &BlockLayout, place: usize) -> &[f64] {
    match &block.shape {
        Shape::Scaled(modes) => &modes[place * block.n_coefficients..][..block.n_coefficients],
        Shape::Triangular => &[],
    }
}

/// Φ of a block, `(places, width)`, with the ones of its mean.
fn modes(block: &BlockLayout, n: usize) -> Mat<f64> {
    Mat::from_fn(n, block.width(), |place, j| row(block, place).get(j).copied().unwrap_or(1.0))
}
