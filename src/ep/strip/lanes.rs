//! Several independent strips side by side: one number of each, and a banded solve on them.
//!
//! Plain loops over fixed arrays that the compiler turns into vector instructions.  No operation
//! mixes lanes, and none is reordered or fused, so a lane's result depends neither on the machine's
//! vector width nor on the other lanes.

use super::fem::{BAND, Matrices};

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

/// The Crank–Nicolson step `(M + ½ r K) δ = −r K V`, `r = D dt / spacing²` per lane, by banded LDLᵀ.
#[derive(Debug)]
pub(super) struct Diffusion {
    /// `stiffness[i][o]` = K(i, i + o), the same in every lane.
    stiffness: Vec<[f64; BAND + 1]>,
    ratio: Lane,
    /// `lower[i][o]` = L(i + 1 + o, i).
    lower: Vec<[Lane; BAND]>,
    inv_pivot: Vec<Lane>,
    work: Vec<Lane>,
}

impl Diffusion {
    pub(super) fn new(matrices: &Matrices, ratio: Lane) -> Self {
        let n = matrices.mass.len();
        let mut lower = vec![[[0.0; LANES]; BAND]; n];
        let mut inv_pivot = vec![[0.0; LANES]; n];
        for lane in 0..LANES {
            let pairs = matrices.mass.iter().zip(&matrices.stiffness);
            let mut a: Vec<[f64; BAND + 1]> = pairs
                .map(|(m, k)| std::array::from_fn(|o| m[o] + 0.5 * ratio[lane] * k[o]))
                .collect();
            for i in 0..n {
                let pivot = a[i][0];
                inv_pivot[i][lane] = 1.0 / pivot;
                for o in 1..=BAND.min(n - 1 - i) {
                    let factor = a[i][o] / pivot;
                    lower[i][o - 1][lane] = factor;
                    for q in o..=BAND.min(n - 1 - i) {
                        a[i + o][q - o] -= factor * a[i][q];
                    }
                }
            }
        }
        let work = vec![[0.0; LANES]; n];
        Self { stiffness: matrices.stiffness.clone(), ratio, lower, inv_pivot, work }
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
        let mut recent = [[0.0; LANES]; BAND];
        for i in 0..n {
            let mut y = self.negative_stiffness_row(v, i);
            for k in 0..LANES {
                y[k] *= self.ratio[k];
            }
            for o in (1..=BAND.min(i)).rev() {
                sub_product(&mut y, &self.lower[i - o][o - 1], &recent[o - 1]);
            }
            recent = [y, recent[0], recent[1]];
            self.work[i] = y;
        }
    }

    /// Row `i` of −K v.
    #[inline(always)]
    fn negative_stiffness_row(&self, v: &[Lane], i: usize) -> Lane {
        let mut row = [0.0; LANES];
        for k in 0..LANES {
            row[k] = -self.stiffness[i][0] * v[i][k];
        }
        for o in 1..=BAND {
            if i + o < v.len() {
                let entry = self.stiffness[i][o];
                for k in 0..LANES {
                    row[k] -= entry * v[i + o][k];
                }
            }
            if i >= o {
                let entry = self.stiffness[i - o][o];
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
        let mut recent = [[0.0; LANES]; BAND];
        for i in (0..v.len()).rev() {
            let mut x = self.work[i];
            for k in 0..LANES {
                x[k] *= self.inv_pivot[i][k];
            }
            for o in (1..=BAND).rev() {
                sub_product(&mut x, &self.lower[i][o - 1], &recent[o - 1]);
            }
            recent = [x, recent[0], recent[1]];
            for k in 0..LANES {
                v[i][k] += x[k];
            }
        }
    }
}
