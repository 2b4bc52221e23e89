//! Several independent strips side by side: one number of each, and a banded solve on them.
//!
//! Plain loops over fixed arrays that the compiler turns into vector instructions.  No operation
//! mixes lanes, and none is reordered or fused, so a lane's result depends neither on the machine's
//! vector width nor on the other lanes.

#![allow(clippy::needless_range_loop, reason = "`k` numbers the lanes of several arrays at once")]

use super::fem::{Banded, Matrices};

/// Strips that advance together.
pub(super) const LANES: usize = 8;

/// One number of each strip.
pub(super) type Lane = [f64; LANES];

#[inline(always)]
fn sub_product(acc: &mut Lane, a: &Lane, b: &Lane) {
    for k in 0..LANES {
        acc[k] -= a[k] * b[k];
    }
}

/// Puts `x` first and drops the last.
#[inline(always)]
fn push<const B: usize>(recent: &mut [Lane; B], x: Lane) {
    for o in (1..B).rev() {
        recent[o] = recent[o - 1];
    }
    recent[0] = x;
}

/// The Crank–Nicolson step `(M + ½ r K) δ = −r K V`, `r = D dt / spacing²` per lane, by a factor
/// `L D Lᵀ` of half-bandwidth `B`.
#[derive(Debug)]
pub(super) struct Diffusion<const B: usize> {
    /// The same in every lane.
    stiffness: Banded<B>,
    ratio: Lane,
    /// `lower[i][o]` = L(i + 1 + o, i).
    lower: Vec<[Lane; B]>,
    inv_pivot: Vec<Lane>,
    work: Vec<Lane>,
}

impl<const B: usize> Diffusion<B> {
    pub(super) fn new(matrices: &Matrices<B>, ratio: Lane) -> Self {
        let Matrices { mass, stiffness } = matrices;
        let n = mass.diagonal.len();
        let mut lower = vec![[[0.0; LANES]; B]; n];
        let mut inv_pivot = vec![[0.0; LANES]; n];
        for lane in 0..LANES {
            let half = 0.5 * ratio[lane];
            let mut diagonal: Vec<f64> =
                (0..n).map(|i| mass.diagonal[i] + half * stiffness.diagonal[i]).collect();
            let mut above: Vec<[f64; B]> = (0..n)
                .map(|i| std::array::from_fn(|o| mass.above[i][o] + half * stiffness.above[i][o]))
                .collect();
            for i in 0..n {
                inv_pivot[i][lane] = 1.0 / diagonal[i];
                for o in 0..B.min(n - 1 - i) {
                    let factor = above[i][o] / diagonal[i];
                    lower[i][o][lane] = factor;
                    diagonal[i + o + 1] -= factor * above[i][o];
                    for q in o + 1..B.min(n - 1 - i) {
                        above[i + o + 1][q - o - 1] -= factor * above[i][q];
                    }
                }
            }
        }
        let work = vec![[0.0; LANES]; n];
        Self { stiffness: stiffness.clone(), ratio, lower, inv_pivot, work }
    }

    /// Adds δ to `v`.
    #[inline(always)]
    pub(super) fn step(&mut self, v: &mut [Lane]) {
        self.forward(v);
        self.backward(v);
    }

    /// Solves `L y = −r K v` into `work`.
    #[inline(always)]
    fn forward(&mut self, v: &[Lane]) {
        let n = v.len();
        let mut recent = [[0.0; LANES]; B];
        for i in 0..n {
            let mut y = self.negative_stiffness_row(v, i);
            for k in 0..LANES {
                y[k] *= self.ratio[k];
            }
            // unrolled, so that what is recent stays in registers
            for o in (1..=B).rev() {
                if o <= i {
                    sub_product(&mut y, &self.lower[i - o][o - 1], &recent[o - 1]);
                }
            }
            push(&mut recent, y);
            self.work[i] = y;
        }
    }

    /// Row `i` of −K v.
    #[inline(always)]
    fn negative_stiffness_row(&self, v: &[Lane], i: usize) -> Lane {
        let mut row = [0.0; LANES];
        for k in 0..LANES {
            row[k] = -self.stiffness.diagonal[i] * v[i][k];
        }
        for o in 1..=B {
            if i + o < v.len() {
                let entry = self.stiffness.above[i][o - 1];
                for k in 0..LANES {
                    row[k] -= entry * v[i + o][k];
                }
            }
            if i >= o {
                let entry = self.stiffness.above[i - o][o - 1];
                for k in 0..LANES {
                    row[k] -= entry * v[i - o][k];
                }
            }
        }
        row
    }

    /// Solves `D Lᵀ δ = y` and adds δ to `v`.
    #[inline(always)]
    fn backward(&mut self, v: &mut [Lane]) {
        let mut recent = [[0.0; LANES]; B];
        for i in (0..v.len()).rev() {
            let mut x = self.work[i];
            for k in 0..LANES {
                x[k] *= self.inv_pivot[i][k];
            }
            for o in (1..=B).rev() {
                sub_product(&mut x, &self.lower[i][o - 1], &recent[o - 1]);
            }
            push(&mut recent, x);
            for k in 0..LANES {
                v[i][k] += x[k];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::strip::Grid;
    use nalgebra::{DMatrix, DVector};
    use std::f64::consts::PI;

    const N_ALONG: usize = 81;

    fn ratios() -> Lane {
        std::array::from_fn(|k| 0.02 + 0.2 * k as f64)
    }

    /// cos(π x / length) in every lane.
    fn slowest_mode() -> Vec<Lane> {
        (0..2 * N_ALONG)
            .map(|i| [(PI * (i / 2) as f64 / (N_ALONG - 1) as f64).cos(); LANES])
            .collect()
    }

    #[test]
    fn the_banded_step_equals_a_dense_solve() {
        banded_equals_dense::<1>(1);
        banded_equals_dense::<3>(3);
        banded_equals_dense::<5>(7);
    }

    fn banded_equals_dense<const B: usize>(n_across: usize) {
        let matrices = Matrices::<B>::assemble(&Grid { n_along: 7, n_across, ..Grid::default() });
        let n = matrices.mass.diagonal.len();
        let dense = |banded: &Banded<B>| {
            DMatrix::from_fn(n, n, |r, c| match r.abs_diff(c) {
                0 => banded.diagonal[r],
                o => banded.above[r.min(c)].get(o - 1).copied().unwrap_or_default(),
            })
        };
        let (mass, stiffness) = (dense(&matrices.mass), dense(&matrices.stiffness));
        let start: Vec<Lane> =
            (0..n).map(|i| std::array::from_fn(|k| ((i * 7 + k * 3) as f64).sin())).collect();
        let mut v = start.clone();
        Diffusion::new(&matrices, ratios()).step(&mut v);
        for (k, r) in ratios().into_iter().enumerate() {
            let before = DVector::from_iterator(n, start.iter().map(|lane| lane[k]));
            let after = DVector::from_iterator(n, v.iter().map(|lane| lane[k]));
            let implicit = (&mass + 0.5 * r * &stiffness) * after;
            let explicit = (&mass - 0.5 * r * &stiffness) * before;
            assert!((implicit - explicit).amax() < 1e-13);
        }
    }

    #[test]
    fn the_slowest_mode_decays_as_the_heat_equation_says() {
        let n_steps = 500;
        let mut v = slowest_mode();
        let mut diffusion = Diffusion::new(&Matrices::<3>::assemble(&Grid::default()), ratios());
        (0..n_steps).for_each(|_| diffusion.step(&mut v));
        for (k, r) in ratios().into_iter().enumerate() {
            // D t π²/length² with D dt = r spacing²
            let exponent = r * f64::from(n_steps) * (PI / (N_ALONG - 1) as f64).powi(2);
            for (now, start) in v.iter().zip(slowest_mode()) {
                assert!((now[k] - start[k] * (-exponent).exp()).abs() < 5e-4);
            }
        }
    }

    #[test]
    fn diffusion_keeps_the_total() {
        let matrices = Matrices::<3>::assemble(&Grid::default());
        // Row sums of the mass matrix.
        let mut weight = vec![0.0; 2 * N_ALONG];
        for (i, row) in matrices.mass.above.iter().enumerate() {
            weight[i] += matrices.mass.diagonal[i];
            for (o, entry) in row.iter().enumerate().filter(|(_, entry)| **entry > 0.0) {
                weight[i] += entry;
                weight[i + 1 + o] += entry;
            }
        }
        let total = |v: &[Lane]| -> f64 { v.iter().zip(&weight).map(|(v, w)| v[5] * w).sum() };
        let mut v: Vec<Lane> =
            (0..2 * N_ALONG).map(|i| [f64::from(u8::from(i < 9)); LANES]).collect();
        let before = total(&v);
        let mut diffusion = Diffusion::new(&matrices, ratios());
        (0..1000).for_each(|_| diffusion.step(&mut v));
        assert!((total(&v) - before).abs() < 1e-12 * before);
    }
}
