//! `param` statements and hyperparameters.

use num_dual::DualStruct;
use rand::Rng;

use super::coordinate::Coordinate;
use super::functions::{PriorFn, VectorFn};
use super::scope::Local;
use super::tape::{Op, Tape};
use crate::dist::{Dist, Gaussian, Normal, Sequence, Support, Vector as _};
use crate::num::{Dual, LN_SQRT_2PI, Num, Real, derivatives, variable};

/// One parameter, or `n` with the same prior. The last of the W derivatives is that in the
/// parameter itself.
pub(super) struct ParameterOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N>,
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    pub(super) n: usize,
    /// If the prior's own parameters are constants, its normaliser, which is computed once.
    pub(super) ln_norm: f64,
    pub(super) coordinate: Coordinate,
    pub(super) f: F,
}

/// The operation of a parameter, before and after its numbers have places.
pub(super) trait PriorOp: Op {
    /// The support of the prior.
    fn support(&self) -> Support;
    /// Whether the prior is flat.
    fn is_flat(&self) -> bool;
    /// Gives it places: those of what its prior mentions, its first unknown and its first value. It
    /// has `n` numbers.
    fn put(&mut self, mentions: &[u32], u: usize, v: usize, n: usize);
    /// Takes deviations in units of the sd as unknowns, if the prior is normal and its sd (or mean)
    /// is itself a parameter. A small sd then does not squeeze the space that is sampled. Returns
    /// whether it does.
    fn take_deviations(&mut self) -> bool;
}

impl<F: PriorFn<N>, const N: usize, const W: usize> ParameterOp<F, N, W> {
    /// The operation before it has places.
    pub(super) fn new(f: F) -> Self {
        // the normaliser of a prior that mentions nothing is computed once
        let ln_norm = if N == 0 { f.prior([Num(1.0); N]).ln_norm().0 } else { 0.0 };
        let coordinate = Coordinate::of_support(N > 0);
        Self { local: Local::new(&[]), u: 0, v: 0, n: 0, ln_norm, coordinate, f }
    }
}

impl<F: PriorFn<N>, const N: usize, const W: usize> PriorOp for ParameterOp<F, N, W> {
    fn support(&self) -> Support {
        support_of(&self.f)
    }

    fn is_flat(&self) -> bool {
        self.f.prior([Num(1.0); N]).is_flat()
    }

    fn put(&mut self, mentions: &[u32], u: usize, v: usize, n: usize) {
        (self.local, self.u, self.v, self.n) = (Local::new(mentions), u, v, n);
    }

    fn take_deviations(&mut self) -> bool {
        self.coordinate = self.coordinate.deviating(&self.f.prior([Num(1.0); N]));
        self.coordinate.is_deviation()
    }
}

/// The support of a prior. If its bounds depend on what the prior mentions, they are only known
/// while it runs.
pub(super) fn support_of<F: PriorFn<N>, const N: usize>(f: &F) -> Support {
    let support = |x: f64| f.prior([Num(x); N]).support();
    if support(1.0) == support(0.5) { support(1.0) } else { Support::Between }
}

impl<F: PriorFn<N>, const N: usize, const W: usize> Op for ParameterOp<F, N, W> {
    fn gaussian(&self, v: &[f64]) -> Option<Gaussian> {
        self.f.prior(self.local.plain(v)).gaussian()
    }

    fn unknown(&self, values: &[f64], value: f64) -> f64 {
        self.coordinate.u(&self.f.prior(self.local.plain(values)), value)
    }

    fn forward(&self, t: &mut Tape) {
        let dist = self.f.prior(self.local.plain(&t.v));
        for i in 0..self.n {
            t.v[self.v + i] = self.coordinate.x(&dist, Num(t.u[self.u + i])).0;
        }
    }

    fn initial(&self, t: &mut Tape) {
        let dist = self.f.prior(self.local.plain(&t.v));
        t.u[self.u..][..self.n].fill(self.coordinate.u(&dist, dist.centre()));
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let dist = self.f.prior(self.local.plain(&t.v));
        for i in 0..self.n {
            t.u[self.u + i] = self.coordinate.u(&dist, dist.sample(rng)?);
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let dist = self.f.prior::<Dual<W>>(self.local.dual(&t.v));
        t.lp += self.ln_norm * self.n as f64;
        for i in 0..self.n {
            let u = Num(variable::<W>(t.u[self.u + i], W - 1));
            let x = self.coordinate.x(&dist, u);
            let l = self.coordinate.ln_prior(&dist, u, x);
            t.lp += l.re();
            // the adjoint of x, carried on to u and to the prior's own parameters
            let e = derivatives(&(l + x * t.g[self.v + i]).0);
            t.gu[self.u + i] += e[W - 1];
            self.local.scatter_array(&e, &mut t.g);
        }
    }
}

/// The cells of a column, each with the same prior. The empty ones are unknowns; the filled ones
/// tell about what the prior mentions. The last of the W derivatives is that in the cell itself.
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
    pub(super) f: F,
}

impl<F: PriorFn<N>, const N: usize, const W: usize> Op for ImputedOp<F, N, W> {
    fn forward(&self, t: &mut Tape) {
        let dist = self.f.prior(self.local.plain(&t.v));
        for (i, row) in self.missing.iter().enumerate() {
            t.v[self.v + row] = dist.constrain(Num(t.u[self.u + i])).0;
        }
    }

    fn initial(&self, t: &mut Tape) {
        let dist = self.f.prior(self.local.plain(&t.v));
        t.u[self.u..][..self.missing.len()].fill(dist.unconstrain(dist.centre()));
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let dist = self.f.prior(self.local.plain(&t.v));
        for i in 0..self.missing.len() {
            t.u[self.u + i] = dist.unconstrain(dist.sample(rng)?);
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let dist = self.f.prior::<Dual<W>>(self.local.dual(&t.v));
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

/// `n` coefficients `~ Normal(0, sd)`, where the sd is known only at run time.
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
    fn gaussian(&self, _: &[f64]) -> Option<Gaussian> {
        Some(Gaussian { location: 0.0, scale: self.sd, precision: 1.0 })
    }

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

/// A prior of a whole vector as a function of the N numbers that it mentions.
pub(super) trait SequenceFn<const N: usize>: Send + Sync + 'static {
    /// The prior.
    fn sequence<T: Real>(&self, s: [Num<T>; N]) -> impl Sequence<Num<T>> + use<Self, T, N>;
}

/// A [`VectorFn`] as the kind of prior that it turns out to be.
#[derive(Clone)]
pub(super) struct Known<F>(pub(super) F);

impl<F: VectorFn<N>, const N: usize> PriorFn<N> for Known<F> {
    #[inline]
    fn prior<T: Real>(&self, s: [Num<T>; N]) -> impl Dist<Num<T>> + use<F, T, N> {
        self.0.prior(s).of_numbers()
    }
}

impl<F: VectorFn<N>, const N: usize> SequenceFn<N> for Known<F> {
    #[inline]
    fn sequence<T: Real>(&self, s: [Num<T>; N]) -> impl Sequence<Num<T>> + use<F, T, N> {
        self.0.prior(s).of_vector()
    }
}

/// A vector of `n` numbers that depend on each other. Of the W derivatives, the last is that in a
/// number's own unknown, and the one before it that in a number of the carry.
pub(super) struct SequenceOp<F, const N: usize, const W: usize> {
    pub(super) local: Local<N>,
    /// First unknown.
    pub(super) u: usize,
    /// First value.
    pub(super) v: usize,
    /// Where the carry that each number finds is kept: what the numbers before it leave behind.
    pub(super) work: usize,
    pub(super) n: usize,
    pub(super) n_carry: usize,
    pub(super) f: F,
}

impl<F: SequenceFn<N>, const N: usize, const W: usize> SequenceOp<F, N, W> {
    /// The carry that number `i` finds, in `work`.
    pub(super) fn found(&self, i: usize) -> std::ops::Range<usize> {
        self.work + i * self.n_carry..self.work + (i + 1) * self.n_carry
    }

    /// Carries the adjoint of number `i` and of the carry that it leaves back to its unknown, to the
    /// prior's parameters and to the carry that it finds; adds its part of the log density.
    ///
    /// Each number of the carry takes an evaluation of its own.
    fn step_back(
        &self,
        i: usize,
        prior: &impl Sequence<Num<Dual<W>>>,
        t: &mut Tape,
        bar: &mut [f64],
        carry: &mut [Num<Dual<W>>],
        found_bar: &mut [f64],
    ) {
        let u = Num(variable::<W>(t.u[self.u + i], W - 1));
        let found = self.found(i);
        for c in 0..self.n_carry {
            for (carry, x) in carry.iter_mut().zip(&t.work[found.clone()]) {
                *carry = Num::from(*x);
            }
            carry[c] = Num(variable::<W>(t.work[found.start + c], W - 2));
            let step = prior.step(i, self.n, u, carry);
            let made = step.ln_kernel + step.x * t.g[self.v + i];
            let sum = carry.iter().zip(&*bar).fold(made, |sum, (carry, bar)| sum + *carry * *bar);
            let e = derivatives(&sum.0);
            found_bar[c] = e[W - 2];
            if c == 0 {
                t.lp += step.ln_kernel.re();
                t.gu[self.u + i] += e[W - 1];
                self.local.scatter_array(&e, &mut t.g);
            }
        }
        bar.copy_from_slice(found_bar);
    }
}

impl<F: SequenceFn<N>, const N: usize, const W: usize> Op for SequenceOp<F, N, W> {
    fn forward(&self, t: &mut Tape) {
        let prior = self.f.sequence(self.local.plain(&t.v));
        let free = prior.n_unknowns(self.n);
        t.work[self.found(0)].fill(prior.begin());
        // most priors carry one number: no memory is asked for
        let (mut one, mut few) = ([Num(0.0)], vec![]);
        let carry = if self.n_carry == 1 {
            &mut one[..]
        } else {
            few.resize(self.n_carry, Num(0.0));
            &mut few[..]
        };
        for i in 0..free {
            let found = self.found(i);
            let carry = &mut carry[..];
            for (carry, x) in carry.iter_mut().zip(&t.work[found.clone()]) {
                *carry = Num(*x);
            }
            t.v[self.v + i] = prior.step(i, self.n, Num(t.u[self.u + i]), carry).x.0;
            for (kept, x) in t.work[found.end..].iter_mut().zip(&*carry) {
                *kept = x.0;
            }
        }
        let left = t.work[self.found(free).start];
        t.v[self.v + free..self.v + self.n].fill(left);
    }

    fn initial(&self, t: &mut Tape) {
        let prior = self.f.sequence(self.local.plain(&t.v));
        for i in 0..prior.n_unknowns(self.n) {
            t.u[self.u + i] = prior.initial(i);
        }
        self.forward(t);
    }

    fn draw(&self, t: &mut Tape, rng: &mut dyn Rng) -> Option<()> {
        let prior = self.f.sequence(self.local.plain(&t.v));
        let x = prior.sample(self.n, rng)?;
        let mut carry = vec![Num(prior.begin()); self.n_carry];
        for (i, x) in x.iter().enumerate().take(prior.n_unknowns(self.n)) {
            let found: Vec<f64> = carry.iter().map(|carry| carry.0).collect();
            let u = prior.unconstrain(i, self.n, *x, &found);
            t.u[self.u + i] = u;
            prior.step(i, self.n, Num(u), &mut carry);
        }
        self.forward(t);
        Some(())
    }

    fn backward(&self, t: &mut Tape) {
        let prior = self.f.sequence::<Dual<W>>(self.local.dual(&t.v));
        let ln_norm = prior.ln_norm(self.n);
        t.lp += ln_norm.re();
        self.local.scatter(&ln_norm, &mut t.g);
        let free = prior.n_unknowns(self.n);
        let left: f64 = t.g[self.v + free..self.v + self.n].iter().sum();
        // most priors carry one number: no memory is asked for
        let (mut one, mut few) = ([0.0; 2], vec![]);
        let (mut one_carry, mut few_carry) = ([Num::from(0.0)], vec![]);
        let (bars, carry) = if self.n_carry == 1 {
            (&mut one[..], &mut one_carry[..])
        } else {
            few.resize(2 * self.n_carry, 0.0);
            few_carry.resize(self.n_carry, Num::from(0.0));
            (&mut few[..], &mut few_carry[..])
        };
        let (bar, found_bar) = bars.split_at_mut(self.n_carry);
        bar[0] = left;
        for i in (0..free).rev() {
            self.step_back(i, &prior, t, bar, carry, found_bar);
        }
    }
}
