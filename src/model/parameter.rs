//! `param` statements and hyperparameters.

use std::marker::PhantomData;

use num_dual::DualStruct;
use rand::Rng;

use super::expansion::{JointFn, PriorFn};
use super::scope::Local;
use super::tape::{Op, Tape};
use crate::dist::{Dist, Gaussian, Normal, Sequence};
use crate::num::{Dual, LN_SQRT_2PI, Num, derivatives, variable};

/// One parameter, or `n` with the same prior; the last of the W derivatives is the parameter's own.
#[derive(Debug)]
pub(super) struct ParameterOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N>,
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    pub(super) n: usize,
    /// The normaliser of a prior whose own parameters are constants: computed once.
    pub(super) ln_norm: f64,
    pub(super) f: PhantomData<F>,
}

impl<F: PriorFn<N>, const N: usize, const W: usize> Op for ParameterOp<F, N, W> {
    fn gaussian(&self, v: &[f64]) -> Option<Gaussian> {
        F::prior(self.local.plain(v)).gaussian()
    }

    fn forward(&self, t: &mut Tape) {
        let dist = F::prior(self.local.plain(&t.v));
        for i in 0..self.n {
            t.v[self.v + i] = dist.constrain(Num(t.u[self.u + i])).0;
        }
    }

    fn initial(&self, t: &mut Tape) {
        let dist = F::prior(self.local.plain(&t.v));
        t.u[self.u..][..self.n].fill(dist.unconstrain(dist.centre()));
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let dist = F::prior(self.local.plain(&t.v));
        for i in 0..self.n {
            t.u[self.u + i] = dist.unconstrain(dist.sample(rng)?);
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let dist = F::prior::<Dual<W>>(self.local.dual(&t.v));
        t.lp += self.ln_norm * self.n as f64;
        for i in 0..self.n {
            let u = Num(variable::<W>(t.u[self.u + i], W - 1));
            let x = dist.constrain(u);
            let mut l = dist.ln_kernel(u, x);
            if W > 1 {
                l += dist.ln_norm();
            }
            t.lp += l.re();
            // the adjoint of x, carried on to u and to the prior's own parameters
            let e = derivatives(&(l + x * t.g[self.v + i]).0);
            t.gu[self.u + i] += e[W - 1];
            self.local.scatter_array(&e, &mut t.g);
        }
    }
}

/// The cells of a column, each with the same prior: the empty ones are unknowns, the others tell of what the prior
/// mentions. The last of the W derivatives is a cell's own.
#[derive(Debug)]
pub(super) struct ImputedOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N>,
    /// First unknown.
    pub(super) u: usize,
    /// Value of the first row.
    pub(super) v: usize,
    /// Rows whose cell is empty, in the order of their unknowns.
    pub(super) missing: Vec<usize>,
    /// Rows whose cell is filled, and what is in it.
    pub(super) seen: Vec<(usize, f64)>,
    pub(super) f: PhantomData<F>,
}

impl<F: PriorFn<N>, const N: usize, const W: usize> Op for ImputedOp<F, N, W> {
    fn forward(&self, t: &mut Tape) {
        let dist = F::prior(self.local.plain(&t.v));
        for (i, row) in self.missing.iter().enumerate() {
            t.v[self.v + row] = dist.constrain(Num(t.u[self.u + i])).0;
        }
    }

    fn initial(&self, t: &mut Tape) {
        let dist = F::prior(self.local.plain(&t.v));
        t.u[self.u..][..self.missing.len()].fill(dist.unconstrain(dist.centre()));
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let dist = F::prior(self.local.plain(&t.v));
        for i in 0..self.missing.len() {
            t.u[self.u + i] = dist.unconstrain(dist.sample(rng)?);
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let dist = F::prior::<Dual<W>>(self.local.dual(&t.v));
        let norm = dist.ln_norm();
        for (i, row) in self.missing.iter().enumerate() {
            let u = Num(variable::<W>(t.u[self.u + i], W - 1));
            let x = dist.constrain(u);
            let l = dist.ln_kernel(u, x) + norm;
            t.lp += l.re();
            let e = derivatives(&(l + x * t.g[self.v + row]).0);
            t.gu[self.u + i] += e[W - 1];
            self.local.scatter_array(&e, &mut t.g);
        }
        for (_, x) in &self.seen {
            let u = Num(variable::<W>(dist.unconstrain(*x), W - 1));
            // the density of a cell, which is no unknown: without the Jacobian of its transform
            let slope = derivatives(&dist.constrain(u).0)[W - 1];
            let l = dist.ln_kernel(u, Num::from(*x)) + norm - slope.abs().ln();
            t.lp += l.re();
            self.local.scatter(&l, &mut t.g);
        }
    }
}

/// `n` coefficients `~ Normal(0, sd)`, the sd known only at run time.
#[derive(Debug)]
pub(super) struct NormalOp {
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    pub(super) n: usize,
    pub(super) sd: f64,
}

impl Op for NormalOp {
    fn forward(&self, t: &mut Tape) {
        t.v[self.v..][..self.n].copy_from_slice(&t.u[self.u..][..self.n]);
    }

    fn initial(&self, t: &mut Tape) {
        t.u[self.u..][..self.n].fill(0.0);
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let prior = Normal { mu: 0.0, sd: self.sd };
        for u in &mut t.u[self.u..][..self.n] {
            *u = prior.sample(rng)?;
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        t.lp -= (self.sd.ln() + LN_SQRT_2PI) * self.n as f64;
        for i in 0..self.n {
            let z = t.u[self.u + i] / self.sd;
            t.lp -= 0.5 * z * z;
            t.gu[self.u + i] += t.g[self.v + i] - z / self.sd;
        }
    }
}

/// A vector of `n` numbers that constrain each other; of the W derivatives the last is a number's
/// own unknown, the one before it what the numbers before left.
#[derive(Debug)]
pub(super) struct SequenceOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N>,
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    /// Where what each number finds is kept.
    pub(super) work: usize,
    pub(super) n: usize,
    pub(super) f: PhantomData<F>,
}

impl<F: JointFn<N>, const N: usize, const W: usize> Op for SequenceOp<F, N, W> {
    fn forward(&self, t: &mut Tape) {
        let prior = F::prior(self.local.plain(&t.v));
        let free = prior.n_unknowns(self.n);
        let mut carry = prior.begin();
        for i in 0..free {
            t.work[self.work + i] = carry.0;
            let step = prior.step(i, self.n, Num(t.u[self.u + i]), carry);
            t.v[self.v + i] = step.x.0;
            carry = step.carry;
        }
        t.v[self.v + free..self.v + self.n].fill(carry.0);
    }

    fn initial(&self, t: &mut Tape) {
        let prior = F::prior(self.local.plain(&t.v));
        for i in 0..prior.n_unknowns(self.n) {
            t.u[self.u + i] = prior.initial(i);
        }
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let prior = F::prior(self.local.plain(&t.v));
        let x = prior.sample(self.n, rng)?;
        let mut carry = prior.begin();
        for (i, x) in x.iter().enumerate().take(prior.n_unknowns(self.n)) {
            let u = prior.unconstrain(i, self.n, *x, carry.0);
            t.u[self.u + i] = u;
            carry = prior.step(i, self.n, Num(u), carry).carry;
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let prior = F::prior::<Dual<W>>(self.local.dual(&t.v));
        let ln_norm = prior.ln_norm(self.n);
        t.lp += ln_norm.re();
        self.local.scatter(&ln_norm, &mut t.g);
        let free = prior.n_unknowns(self.n);
        let mut carry_bar: f64 = t.g[self.v + free..self.v + self.n].iter().sum();
        for i in (0..free).rev() {
            let u = Num(variable::<W>(t.u[self.u + i], W - 1));
            let carry = Num(variable::<W>(t.work[self.work + i], W - 2));
            let step = prior.step(i, self.n, u, carry);
            t.lp += step.ln_kernel.re();
            let bar = step.ln_kernel + step.x * t.g[self.v + i] + step.carry * carry_bar;
            let e = derivatives(&bar.0);
            t.gu[self.u + i] += e[W - 1];
            carry_bar = e[W - 2];
            self.local.scatter_array(&e, &mut t.g);
        }
    }
}
