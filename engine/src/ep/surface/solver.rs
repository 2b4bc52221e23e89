//! The monodomain equation on a triangle mesh: one time step.
//!
//! Split as on the strip: five forward-Euler substeps of the cells (their gates by degrees), the stimulus,
//! then Crank–Nicolson in increments, `(M + ½ dt K) δ = −dt K V`, scaled to a unit diagonal (which is the Jacobi
//! preconditioner), by conjugate gradients from an extrapolated first guess. Rows are in blocks; a block at rest, and next to no other,
//! sleeps: V stays 0 there, and its gates are brought up to date when it wakes. Sums go block by block, so that no
//! bit depends on the number of threads.
//!
//! # Source
//! One meeting of the threads for both scalar products of an iteration: Chronopoulos and Gear 1989.

use pulp::Arch;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Substrate;
use super::lanes::{BLOCK, add_product, add_scaled, add_to, dot, extrapolate, peak, react};
use super::operators::Operators;
use crate::ep::cell::StepRates;
use crate::ep::precision::Precision;

/// Cell substeps in one step.
const SUBSTEPS: u32 = 5;

/// Below this everywhere, |V| of a block counts as rest, if its neighbours rest too: so nothing above a
/// hundredth of the threshold is ever nearer to a sleeping block than a block.
const AT_REST: f64 = 1e-4;

/// More iterations than this a step never needs: the first guess is good to 1 % and A is close to M.
const MOST_ITERATIONS: usize = 100;

/// At most so many blocks, asleep or awake, are one thread's before another may take its share of the rest.
const TASK: usize = 32;

/// A value of every row, by block.
type Blocks<F> = Vec<[F; BLOCK]>;

/// A surface of tissue; values are by row of the operators.
#[derive(Debug)]
pub(super) struct Solver<F> {
    pub(super) operators: Operators<F>,
    pub(super) v: Blocks<F>,
    h: Blocks<F>,
    rates: Vec<StepRates<[F; BLOCK]>>,
    /// The last increment of V by diffusion, scaled, and the one that is sought: before that, the one before the last.
    last: Blocks<F>,
    x: Blocks<F>,
    /// Residual `r`, `w = A r`; search direction `p` and `s = A p`.
    r: Blocks<F>,
    w: Blocks<F>,
    p: Blocks<F>,
    s: Blocks<F>,
    /// `r · r` at which a step is solved: an error of [`Precision::TOLERANCE`] of V, rms.
    enough: f64,
    neighbours: Vec<Vec<usize>>,
    pub(super) awake: Vec<bool>,
    /// Steps that each block has slept.
    slept: Vec<i32>,
    /// Iterations of conjugate gradients so far.
    pub(super) n_iterations: u64,
    pub(super) arch: Arch,
}

/// All that the steps to come depend on; the rest follows from the substrate.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct SolverState<F> {
    /// V, h and the last two increments.
    values: [Vec<F>; 4],
    awake: Vec<bool>,
    slept: Vec<i32>,
    n_iterations: u64,
}

impl<F: Precision> Solver<F> {
    /// Tissue at rest, V = 0 and h = 1.
    pub(super) fn new(substrate: &Substrate<'_>, dt: f64) -> Self {
        let operators = Operators::<F>::assemble(substrate, dt);
        let n_blocks = operators.scale.len();
        let all = |value: F| vec![[value; BLOCK]; n_blocks];
        let scale = operators.scale.as_flattened()[..operators.vertex.len()].iter();
        let substep = dt / f64::from(SUBSTEPS);
        let mut rates = vec![StepRates::uniform(F::zero()); n_blocks];
        for (row, v) in operators.vertex.iter().enumerate() {
            rates[row / BLOCK]
                .set(row % BLOCK, substrate.tissue[*v as usize].step_rates(substep).cast());
        }
        Self {
            rates,
            v: all(F::zero()),
            h: all(F::one()),
            last: all(F::zero()),
            x: all(F::zero()),
            r: all(F::zero()),
            w: all(F::zero()),
            p: all(F::zero()),
            s: all(F::zero()),
            enough: F::TOLERANCE.powi(2) * scale.map(|s| s.f64().powi(-2)).sum::<f64>(),
            neighbours: operators.neighbours(),
            operators,
            awake: vec![false; n_blocks],
            slept: vec![0; n_blocks],
            n_iterations: 0,
            arch: Arch::new(),
        }
    }

    pub(super) fn state(&self) -> SolverState<F> {
        let values = [&self.v, &self.h, &self.last, &self.x];
        SolverState {
            values: values.map(|blocks| blocks.as_flattened().to_vec()),
            awake: self.awake.clone(),
            slept: self.slept.clone(),
            n_iterations: self.n_iterations,
        }
    }

    /// Goes on from `state`; whether it is one of this surface after so many steps.
    #[must_use = "false: the state is of another surface"]
    pub(super) fn restore(&mut self, state: &SolverState<F>, step: u64) -> bool {
        let n_blocks = self.v.len();
        let has_slept = |n: &i32| u64::try_from(*n).is_ok_and(|n| n <= step);
        let fits = state.values.iter().all(|values| values.len() == n_blocks * BLOCK)
            && [state.awake.len(), state.slept.len()] == [n_blocks; 2]
            && state.slept.iter().all(has_slept);
        if fits {
            let blocks = [&mut self.v, &mut self.h, &mut self.last, &mut self.x];
            for (blocks, values) in blocks.into_iter().zip(&state.values) {
                blocks.as_flattened_mut().copy_from_slice(values);
            }
            // what blocks at rest have left of other steps would reach their neighbours
            for blocks in [&mut self.r, &mut self.w, &mut self.p, &mut self.s] {
                blocks.as_flattened_mut().fill(F::zero());
            }
            self.awake.clone_from(&state.awake);
            self.slept.clone_from(&state.slept);
            self.n_iterations = state.n_iterations;
        }
        fits
    }

    /// One time step; `stimulus` is what it adds to V at which rows.
    #[must_use = "false: the step was not solved"]
    pub(super) fn step(&mut self, stimulus: Option<(F, &[u32])>) -> bool {
        if let Some((_, rows)) = stimulus {
            for row in rows {
                self.wake(*row as usize / BLOCK);
            }
        }
        self.react();
        if let Some((amplitude, rows)) = stimulus {
            for row in rows {
                let v = &mut self.v.as_flattened_mut()[*row as usize];
                *v = *v + amplitude;
            }
        }
        let is_solved = self.diffuse();
        let peaks = self.advance();
        self.settle(&peaks);
        is_solved
    }

    /// Brings the gates of a sleeping block up to date.
    fn wake(&mut self, block: usize) {
        if std::mem::replace(&mut self.awake[block], true) {
            return;
        }
        let n = SUBSTEPS as i32 * std::mem::take(&mut self.slept[block]);
        for (h, open) in self.h[block].iter_mut().zip(&self.rates[block].open) {
            *h = F::of(1.0 - (1.0 - h.f64()) * (1.0 - open.f64()).powi(n));
        }
    }

    /// The cells' substeps, and the first guess of the increment.
    fn react(&mut self) {
        let Self { operators, awake, arch, v, h, rates, x, last, .. } = self;
        let blocks = v
            .par_iter_mut()
            .with_max_len(TASK)
            .zip(h)
            .zip(rates)
            .zip(x)
            .zip(last)
            .zip(&operators.scale);
        let blocks = blocks.zip(awake).filter(|(_, awake)| **awake);
        blocks.for_each(|((((((v, h), rates), x), last), scale), _)| {
            arch.dispatch(|| {
                react(v, h, last, scale, rates, SUBSTEPS);
                extrapolate(last, x);
            });
        });
    }

    /// Solves for the increment by conjugate gradients; whether that was reached.
    fn diffuse(&mut self) -> bool {
        let mut gamma = self.first_residual();
        let (mut alpha, mut beta) = (1.0, 0.0);
        for _ in 0..MOST_ITERATIONS {
            if gamma <= self.enough {
                return true;
            }
            self.n_iterations += 1;
            let delta = self.energy();
            alpha = gamma / (delta - beta * gamma / alpha);
            let next = self.descend(F::of(alpha), F::of(beta));
            beta = next / gamma;
            gamma = next;
        }
        false
    }

    /// Residual `r` of the first guess; `r · r`.
    fn first_residual(&mut self) -> f64 {
        let Self { operators, arch, awake, v, x, r, .. } = self;
        let (v, x) = (v.as_flattened(), x.as_flattened());
        let blocks =
            r.par_iter_mut().with_max_len(TASK).enumerate().filter(|(block, _)| awake[*block]);
        let sums = blocks.map(|(block, r)| {
            arch.dispatch(|| {
                operators.residual(block, v, x, r);
                dot(r, r)
            })
        });
        sums.collect::<Vec<f64>>().into_iter().sum()
    }

    /// `w = A r` and `r · w`.
    fn energy(&mut self) -> f64 {
        let Self { operators, arch, awake, r, w, .. } = self;
        let all = r.as_flattened();
        let blocks = w
            .par_iter_mut()
            .with_max_len(TASK)
            .zip(&*r)
            .enumerate()
            .filter(|(block, _)| awake[*block]);
        let sums = blocks.map(|(block, (w, r))| {
            arch.dispatch(|| {
                operators.implicit(block, all, w);
                dot(r, w)
            })
        });
        sums.collect::<Vec<f64>>().into_iter().sum()
    }

    /// Goes `alpha` along the next search direction, `p = r + beta p`; `r · r` there.
    fn descend(&mut self, alpha: F, beta: F) -> f64 {
        let Self { arch, awake, x, r, w, p, s, .. } = self;
        let blocks = p.par_iter_mut().with_max_len(TASK).zip(s).zip(x).zip(r).zip(w).zip(awake);
        let blocks = blocks.filter(|(_, awake)| **awake);
        let sums = blocks.map(|(((((p, s), x), r), w), _)| {
            arch.dispatch(|| {
                add_scaled(r, beta, p);
                add_scaled(w, beta, s);
                add_to(alpha, p, x);
                add_to(-alpha, s, r);
                dot(r, r)
            })
        });
        sums.collect::<Vec<f64>>().into_iter().sum()
    }

    /// Adds the increment to V and keeps it; the largest |V| of each block.
    fn advance(&mut self) -> Vec<F> {
        let Self { operators, awake, arch, v, x, last, .. } = self;
        std::mem::swap(last, x);
        let blocks = v.par_iter_mut().with_max_len(TASK).zip(last).zip(&operators.scale).zip(awake);
        let peaks = blocks.map(|(((v, last), scale), awake)| {
            if !*awake {
                return F::zero();
            }
            arch.dispatch(|| {
                add_product(scale, last, v);
                peak(v)
            })
        });
        peaks.collect()
    }

    /// Wakes the neighbours of blocks that are not at rest, and puts to sleep who has no such neighbour.
    fn settle(&mut self, peaks: &[F]) {
        let alive = |block: usize| peaks[block] > F::of(AT_REST);
        let stays: Vec<bool> =
            self.neighbours.iter().map(|list| list.iter().any(|b| alive(*b))).collect();
        for (block, stays) in stays.into_iter().enumerate() {
            match (stays, self.awake[block]) {
                (true, _) => self.wake(block),
                (false, true) => self.put_to_sleep(block),
                (false, false) => self.slept[block] += 1,
            }
        }
    }

    fn put_to_sleep(&mut self, block: usize) {
        self.awake[block] = false;
        let Self { v, x, last, r, p, s, .. } = self;
        for values in [v, x, last, r, p, s] {
            values[block] = [F::zero(); BLOCK];
        }
    }
}
