//! Second derivatives of priors: of single numbers, of vectors, of imputed cells.

use super::{change, unit};
use crate::dist::{Dist, Sequence};
use crate::model::coordinate::Coordinate;
use crate::model::functions::PriorFn;
use crate::model::parameter::{ImputedOp, NormalOp, ParameterOp, SequenceFn, SequenceOp};
use crate::model::scope::Local;
use crate::model::tape::{Second, Tape};
use crate::num::{Hyper, Num, dual};

impl<F: PriorFn<N>, const N: usize, const W: usize> Second for ParameterOp<F, N, W> {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let prior = self.f.prior(self.local.pushed(t, d));
        for i in 0..self.n {
            let u = Num(dual(t.u[self.u + i], [d.u[self.u + i]]));
            d.v[self.v + i] = change(self.coordinate.x(&prior, u));
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let values = |i: usize| (self.u + i, self.v + i);
        pull_prior(&self.f, &self.local, &(0..self.n).map(values), self.coordinate, t, d);
    }
}

/// The pull of unknowns and their values `(u, v)` with the same prior.
fn pull_prior<F: PriorFn<N>, const N: usize>(
    f: &F,
    local: &Local<N>,
    values: &(impl Iterator<Item = (usize, usize)> + Clone),
    coordinate: Coordinate,
    t: &Tape,
    d: &mut Tape,
) {
    for j in 0..=N {
        let prior = f.prior::<Hyper>(local.hyper(j, t, d));
        for (u, v) in values.clone() {
            let x_u = Num(Hyper::new(t.u[u], unit(j == N), d.u[u], 0.0));
            let x = coordinate.x(&prior, x_u);
            let l = coordinate.ln_prior(&prior, x_u, x);
            let bar = l.0.eps1eps2 + x.0.eps1eps2 * t.g[v] + x.0.eps1 * d.g[v];
            if j == N {
                d.gu[u] += bar;
            } else {
                d.g[local.place(j)] += bar;
            }
        }
    }
}

impl<F: PriorFn<N>, const N: usize, const W: usize> Second for ImputedOp<F, N, W> {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let prior = self.f.prior(self.local.pushed(t, d));
        for (i, row) in self.missing.iter().enumerate() {
            let u = Num(dual(t.u[self.u + i], [d.u[self.u + i]]));
            d.v[self.v + row] = change(prior.constrain(u));
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let missing = self.missing.iter().enumerate();
        let values = missing.map(|(i, row)| (self.u + i, self.v + row));
        pull_prior(&self.f, &self.local, &values, Coordinate::of_support(true), t, d);
        for j in 0..N {
            let prior = self.f.prior::<Hyper>(self.local.hyper(j, t, d));
            let norm = prior.ln_norm();
            for (_, x) in &self.seen {
                let u = Num::from(prior.unconstrain(*x));
                let l = prior.ln_kernel(u, Num::from(*x)) + norm;
                d.g[self.local.place(j)] += l.0.eps1eps2;
            }
        }
    }
}

impl Second for NormalOp {
    fn push(&self, _: &Tape, d: &mut Tape) {
        d.v[self.v..][..self.n].copy_from_slice(&d.u[self.u..][..self.n]);
    }

    fn pull(&self, _: &Tape, d: &mut Tape) {
        for i in 0..self.n {
            d.gu[self.u + i] += d.g[self.v + i] - d.u[self.u + i] / (self.sd * self.sd);
        }
    }
}

impl<F: SequenceFn<N>, const N: usize, const W: usize> Second for SequenceOp<F, N, W> {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let prior = self.f.sequence(self.local.pushed(t, d));
        let free = prior.n_unknowns(self.n);
        d.work[self.found(0)].fill(0.0);
        let mut carry = vec![Num::from(0.0); self.n_carry];
        for i in 0..free {
            for (carry, at) in carry.iter_mut().zip(self.found(i)) {
                *carry = Num(dual(t.work[at], [d.work[at]]));
            }
            let u = Num(dual(t.u[self.u + i], [d.u[self.u + i]]));
            d.v[self.v + i] = change(prior.step(i, self.n, u, &mut carry).x);
            for (carry, at) in carry.iter().zip(self.found(i + 1)) {
                d.work[at] = change(*carry);
            }
        }
        let left = d.work[self.found(free).start];
        d.v[self.v + free..self.v + self.n].fill(left);
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let free = self.f.sequence(self.local.plain(&t.v)).n_unknowns(self.n);
        for j in 0..N {
            let prior = self.f.sequence::<Hyper>(self.local.hyper(j, t, d));
            d.g[self.local.place(j)] += prior.ln_norm(self.n).0.eps1eps2;
        }
        let rest = self.v + free..self.v + self.n;
        let (mut bar, mut d_bar) = (vec![0.0; self.n_carry], vec![0.0; self.n_carry]);
        bar[0] = t.g[rest.clone()].iter().sum();
        d_bar[0] = d.g[rest].iter().sum();
        for i in (0..free).rev() {
            self.step_change(i, t, d, (&mut bar, &mut d_bar));
        }
    }
}

impl<F: SequenceFn<N>, const N: usize, const W: usize> SequenceOp<F, N, W> {
    /// Adds the change of the adjoints that number `i` passes on. The adjoint of the carry and its change are
    /// those of what number `i` leaves, and then of what it finds.
    fn step_change(
        &self,
        i: usize,
        t: &Tape,
        d: &mut Tape,
        (bar, d_bar): (&mut Vec<f64>, &mut Vec<f64>),
    ) {
        let (of_u, of_v) = (self.u + i, self.v + i);
        let (mut before, mut d_before) = (vec![0.0; self.n_carry], vec![0.0; self.n_carry]);
        // the numbers that are mentioned, the carry, the unknown
        for j in 0..=N + self.n_carry {
            let prior = self.f.sequence::<Hyper>(self.local.hyper(j, t, d));
            let own = j == N + self.n_carry;
            let u = Num(Hyper::new(t.u[of_u], unit(own), d.u[of_u], 0.0));
            let found = self.found(i).enumerate();
            let mut carry: Vec<Num<Hyper>> = found
                .map(|(c, at)| Num(Hyper::new(t.work[at], unit(j == N + c), d.work[at], 0.0)))
                .collect();
            let step = prior.step(i, self.n, u, &mut carry);
            let mut all = step.ln_kernel + step.x * t.g[of_v];
            let mut change = step.x.0.eps1 * d.g[of_v];
            for (carry, (bar, d_bar)) in carry.iter().zip(bar.iter().zip(&*d_bar)) {
                all += *carry * *bar;
                change += carry.0.eps1 * d_bar;
            }
            change += all.0.eps1eps2;
            if own {
                d.gu[of_u] += change;
            } else if j < N {
                d.g[self.local.place(j)] += change;
            } else {
                (before[j - N], d_before[j - N]) = (all.0.eps1, change);
            }
        }
        (*bar, *d_bar) = (before, d_before);
    }
}
