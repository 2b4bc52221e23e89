//! `param` statements and hyperparameters.

use std::marker::PhantomData;

use num_dual::DualStruct;
use rand::Rng;

use super::scope::Local;
use super::tape::{Op, Tape};
use crate::dist::{Dist, Gaussian, Normal, Sequence};
use crate::num::{Dual, LN_SQRT_2PI, Real, derivatives, variable};

/// A prior as a function of the names in its scope.
pub trait PriorFn: Send + Sync + std::fmt::Debug {
    /// The prior at the scope's scalars.
    fn dist<D: Real>(s: &[D]) -> impl Dist<D> + use<Self, D>;
}

/// One parameter, or `n` with the same prior; the last of the W derivatives is the parameter's own.
#[derive(Debug)]
pub(super) struct ParameterOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N, W>,
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    pub(super) n: usize,
    /// The normaliser of a prior whose own parameters are constants: computed once.
    pub(super) ln_norm: f64,
    pub(super) f: PhantomData<F>,
}

impl<F: PriorFn, const N: usize, const W: usize> Op for ParameterOp<F, N, W> {
    fn gaussian(&self, v: &[f64]) -> Option<Gaussian> {
        F::dist::<f64>(&self.local.plain(v)).gaussian()
    }

    fn forward(&self, t: &mut Tape) {
        let dist = F::dist::<f64>(&self.local.plain(&t.v));
        for i in 0..self.n {
            t.v[self.v + i] = dist.constrain(t.u[self.u + i]);
        }
    }

    fn initial(&self, t: &mut Tape) {
        let dist = F::dist::<f64>(&self.local.plain(&t.v));
        t.u[self.u..][..self.n].fill(dist.unconstrain(dist.centre()));
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let dist = F::dist::<f64>(&self.local.plain(&t.v));
        for i in 0..self.n {
            t.u[self.u + i] = dist.unconstrain(dist.sample(rng)?);
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let dist = F::dist::<Dual<W>>(&self.local.dual(&t.v));
        t.lp += self.ln_norm * self.n as f64;
        for i in 0..self.n {
            let u = variable::<W>(t.u[self.u + i], W - 1);
            let x = dist.constrain(u);
            let mut l = dist.ln_kernel(u, x);
            if W > 1 {
                l += dist.ln_norm();
            }
            t.lp += l.re();
            // the adjoint of x, carried on to u and to the prior's own parameters
            let e = derivatives(&(l + x * t.g[self.v + i]));
            t.gu[self.u + i] += e[W - 1];
            self.local.scatter_array(&e, &mut t.g);
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

/// A vector's prior as a function of the names in its scope.
pub trait SequenceFn: Send + Sync + std::fmt::Debug {
    /// The prior at the scope's scalars.
    fn sequence<D: Real>(s: &[D]) -> impl Sequence<D> + use<Self, D>;
}

/// A vector of `n` numbers that constrain each other; of the W derivatives the last is a number's
/// own unknown, the one before it what the numbers before left.
#[derive(Debug)]
pub(super) struct SequenceOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N, W>,
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    /// Where what each number finds is kept.
    pub(super) work: usize,
    pub(super) n: usize,
    pub(super) f: PhantomData<F>,
}

impl<F: SequenceFn, const N: usize, const W: usize> Op for SequenceOp<F, N, W> {
    fn forward(&self, t: &mut Tape) {
        let prior = F::sequence::<f64>(&self.local.plain(&t.v));
        let free = prior.n_unknowns(self.n);
        let mut carry = prior.begin();
        for i in 0..free {
            t.work[self.work + i] = carry;
            let step = prior.step(i, self.n, t.u[self.u + i], carry);
            t.v[self.v + i] = step.x;
            carry = step.carry;
        }
        t.v[self.v + free..self.v + self.n].fill(carry);
    }

    fn initial(&self, t: &mut Tape) {
        let prior = F::sequence::<f64>(&self.local.plain(&t.v));
        for i in 0..prior.n_unknowns(self.n) {
            t.u[self.u + i] = prior.initial(i);
        }
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let prior = F::sequence::<f64>(&self.local.plain(&t.v));
        let x = prior.sample(self.n, rng)?;
        let mut carry = prior.begin();
        for (i, x) in x.iter().enumerate().take(prior.n_unknowns(self.n)) {
            let u = prior.unconstrain(i, self.n, *x, carry);
            t.u[self.u + i] = u;
            carry = prior.step(i, self.n, u, carry).carry;
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let prior = F::sequence::<Dual<W>>(&self.local.dual(&t.v));
        let ln_norm = prior.ln_norm(self.n);
        t.lp += ln_norm.re();
        self.local.scatter(&ln_norm, &mut t.g);
        let free = prior.n_unknowns(self.n);
        let mut carry_bar: f64 = t.g[self.v + free..self.v + self.n].iter().sum();
        for i in (0..free).rev() {
            let u = variable::<W>(t.u[self.u + i], W - 1);
            let carry = variable::<W>(t.work[self.work + i], W - 2);
            let step = prior.step(i, self.n, u, carry);
            t.lp += step.ln_kernel.re();
            let bar = step.ln_kernel + step.x * t.g[self.v + i] + step.carry * carry_bar;
            let e = derivatives(&bar);
            t.gu[self.u + i] += e[W - 1];
            carry_bar = e[W - 2];
            self.local.scatter_array(&e, &mut t.g);
        }
    }
}
