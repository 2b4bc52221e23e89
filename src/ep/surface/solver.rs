//! The monodomain equation on a triangle mesh: one time step.
//!
//! Split as on the strip: five forward-Euler substeps of the cells, the stimulus, then Crank–Nicolson in
//! increments, `(M + ½ dt K) δ = −dt K V`, by conjugate gradients with a Jacobi preconditioner from an
//! extrapolated first guess. Rows are in blocks; a block at rest, and next to no other, sleeps: V stays
//! 0 there, and its gates are brought up to date when it wakes. Sums go block by block, so that no bit
//! depends on the number of threads.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::operators::Operators;
use crate::ep::cell::{StepRates, Tissue, euler_step};
use crate::ep::precision::Precision;
use crate::mesh::TriMesh;

/// Cell substeps in one step.
const SUBSTEPS: u32 = 5;

/// Rows that sleep and wake together, and that one task works on.
pub(super) const BLOCK: usize = 512;

/// Below this everywhere, |V| of a block counts as rest, if its neighbours rest too: so nothing above a
/// thousandth of the threshold is ever nearer to a sleeping block than a block.
const AT_REST: f64 = 1e-4;

/// More iterations than this a step never needs: the first guess is good to 1 % and A is close to M.
const MOST_ITERATIONS: usize = 100;

/// A surface of tissue; values are by row of the operators.
#[derive(Debug)]
pub(super) struct Solver<F> {
    pub(super) operators: Operators<F>,
    pub(super) v: Vec<F>,
    h: Vec<F>,
    rates: Vec<StepRates<F>>,
    /// The last two increments of V by diffusion, and the one that is sought.
    last: [Vec<F>; 2],
    x: Vec<F>,
    r: Vec<F>,
    p: Vec<F>,
    q: Vec<F>,
    /// `r·D⁻¹ r` at which a step is solved: an error of [`Precision::TOLERANCE`] of V everywhere.
    enough: f64,
    neighbours: Vec<Vec<usize>>,
    pub(super) awake: Vec<bool>,
    /// Steps that each block has slept.
    slept: Vec<i32>,
    /// Iterations of conjugate gradients so far.
    pub(super) n_iterations: u64,
    arch: Arch,
}

impl<F: Precision> Solver<F> {
    /// Tissue at rest, V = 0 and h = 1; `tissue` by vertex.
    pub(super) fn new(mesh: &TriMesh, tissue: &[Tissue], dt: f64) -> Self {
        let operators = Operators::<F>::assemble(mesh, tissue, dt);
        let n = mesh.n_vertices();
        let rates = |v: &u32| tissue[*v as usize].step_rates(dt / f64::from(SUBSTEPS)).cast();
        let zeros = || vec![F::zero(); n];
        let n_blocks = n.div_ceil(BLOCK);
        Self {
            rates: operators.vertex.iter().map(rates).collect(),
            v: zeros(),
            h: vec![F::one(); n],
            last: [zeros(), zeros()],
            x: zeros(),
            r: zeros(),
            p: zeros(),
            q: zeros(),
            enough: F::TOLERANCE.powi(2)
                * operators.inverse_diagonal.iter().map(|d: &F| d.f64().recip()).sum::<f64>(),
            neighbours: operators.neighbours(BLOCK),
            operators,
            awake: vec![false; n_blocks],
            slept: vec![0; n_blocks],
            n_iterations: 0,
            arch: Arch::new(),
        }
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
                self.v[*row as usize] = self.v[*row as usize] + amplitude;
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
        let n = (SUBSTEPS as i32) * std::mem::take(&mut self.slept[block]);
        let rows = block * BLOCK..((block + 1) * BLOCK).min(self.h.len());
        for (h, rates) in self.h[rows.clone()].iter_mut().zip(&self.rates[rows]) {
            *h = F::one() - (F::one() - *h) * (F::one() - rates.open).powi(n);
        }
    }

    /// The cells' substeps, and the first guess of the increment.
    fn react(&mut self) {
        let (awake, arch) = (&self.awake, self.arch);
        let [last, before] = &self.last;
        let mine = |block: usize, of: &[F]| -> std::ops::Range<usize> {
            block * BLOCK..((block + 1) * BLOCK).min(of.len())
        };
        let blocks = self.v.par_chunks_mut(BLOCK).zip(self.h.par_chunks_mut(BLOCK));
        let blocks = blocks.zip(self.rates.par_chunks(BLOCK)).zip(self.x.par_chunks_mut(BLOCK));
        blocks.enumerate().filter(|(block, _)| awake[*block]).for_each(
            |(block, (((v, h), rates), x))| {
                arch.dispatch(React { v, h, rates });
                let rows = mine(block, last);
                for ((x, last), before) in x.iter_mut().zip(&last[rows.clone()]).zip(&before[rows])
                {
                    *x = *last + *last - *before;
                }
            },
        );
    }

    /// Solves for the increment by conjugate gradients; whether that was reached.
    fn diffuse(&mut self) -> bool {
        let mut rz = self.first_residual();
        for _ in 0..MOST_ITERATIONS {
            if rz <= self.enough {
                return true;
            }
            self.n_iterations += 1;
            let alpha = F::of(rz / self.search_direction_energy());
            let next = self.descend(alpha);
            self.turn(F::of(next / rz));
            rz = next;
        }
        false
    }

    /// Residual `r`, search direction `p = D⁻¹ r`; `r·D⁻¹ r`.
    fn first_residual(&mut self) -> f64 {
        let Self { operators, awake, v, x, r, p, .. } = self;
        let blocks = r.par_chunks_mut(BLOCK).zip(p.par_chunks_mut(BLOCK)).enumerate();
        let of_block = |(block, (r, p)): (usize, (&mut [F], &mut [F]))| {
            let mut rz = F::zero();
            for (k, (r, p)) in r.iter_mut().zip(p).enumerate() {
                let i = block * BLOCK + k;
                let inverse = operators.inverse_diagonal[i];
                *r = operators.residual(i, v, x);
                *p = *r * inverse;
                rz = rz + *r * *p;
            }
            rz.f64()
        };
        let blocks = blocks.filter(|(block, _)| awake[*block]);
        blocks.map(of_block).collect::<Vec<_>>().into_iter().sum()
    }

    /// `q = A p` and `p·q`.
    fn search_direction_energy(&mut self) -> f64 {
        let Self { operators, awake, p, q, .. } = self;
        let of_block = |(block, q): (usize, &mut [F])| {
            let mut pq = F::zero();
            for (k, q) in q.iter_mut().enumerate() {
                let i = block * BLOCK + k;
                *q = operators.implicit(i, p);
                pq = pq + p[i] * *q;
            }
            pq.f64()
        };
        let blocks = q.par_chunks_mut(BLOCK).enumerate().filter(|(block, _)| awake[*block]);
        blocks.map(of_block).collect::<Vec<_>>().into_iter().sum()
    }

    /// Goes `alpha` along p; `r·D⁻¹ r` there.
    fn descend(&mut self, alpha: F) -> f64 {
        let Self { operators, awake, p, q, x, r, .. } = self;
        let of_block = |(block, (x, r)): (usize, (&mut [F], &mut [F]))| {
            let mut rz = F::zero();
            for (k, (x, r)) in x.iter_mut().zip(r).enumerate() {
                let i = block * BLOCK + k;
                *x = *x + alpha * p[i];
                *r = *r - alpha * q[i];
                rz = rz + *r * *r * operators.inverse_diagonal[i];
            }
            rz.f64()
        };
        let blocks = x.par_chunks_mut(BLOCK).zip(r.par_chunks_mut(BLOCK)).enumerate();
        let blocks = blocks.filter(|(block, _)| awake[*block]);
        blocks.map(of_block).collect::<Vec<_>>().into_iter().sum()
    }

    /// The next search direction, `p = D⁻¹ r + beta p`.
    fn turn(&mut self, beta: F) {
        let Self { operators, awake, p, r, .. } = self;
        let blocks = p.par_chunks_mut(BLOCK).enumerate().filter(|(block, _)| awake[*block]);
        blocks.for_each(|(block, p)| {
            for (k, p) in p.iter_mut().enumerate() {
                let i = block * BLOCK + k;
                *p = r[i] * operators.inverse_diagonal[i] + beta * *p;
            }
        });
    }

    /// Adds the increment to V and keeps it; the largest |V| of each block.
    fn advance(&mut self) -> Vec<F> {
        let Self { awake, v, x, last, .. } = self;
        let [last, before] = last;
        let blocks = v.par_chunks_mut(BLOCK).zip(x.par_chunks(BLOCK));
        let blocks = blocks.zip(last.par_chunks_mut(BLOCK)).zip(before.par_chunks_mut(BLOCK));
        let blocks = blocks.enumerate().map(|(block, (((v, x), last), before))| {
            if !awake[block] {
                return F::zero();
            }
            before.copy_from_slice(last);
            last.copy_from_slice(x);
            let mut peak = F::zero();
            for (v, x) in v.iter_mut().zip(x) {
                *v = *v + *x;
                peak = peak.max(v.abs());
            }
            peak
        });
        blocks.collect()
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
        let rows = block * BLOCK..((block + 1) * BLOCK).min(self.v.len());
        let [last, before] = &mut self.last;
        for values in
            [&mut self.v, &mut self.x, &mut self.r, &mut self.p, &mut self.q, last, before]
        {
            values[rows.clone()].fill(F::zero());
        }
    }
}

/// The cells' substeps of a block, compiled once for each set of vector instructions.
struct React<'a, F> {
    v: &'a mut [F],
    h: &'a mut [F],
    rates: &'a [StepRates<F>],
}

impl<F: Precision> NullaryFnOnce for React<'_, F> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for ((v, h), rates) in self.v.iter_mut().zip(self.h).zip(self.rates) {
            for _ in 0..SUBSTEPS {
                (*v, *h) = euler_step(*v, *h, *rates);
            }
        }
    }
}
