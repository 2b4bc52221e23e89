//! Second derivatives of a model, exactly: the Hessian times a direction.
//!
//! ```text
//! forward    v̇ = (∂v/∂u) u̇                 along the operations
//! rows       ġ = H_row ṡ                   H_row from second-order numbers, once per position
//! backward   ġ on to u: d/dε of the adjoint pass at u + ε u̇
//! ```
//! Each operation states how its values and its adjoints change along a direction; nothing is
//! differenced. What an operation computes from a few scalars is differentiated by [`Hyper`].

use super::density::DensityAt;
use super::expansion::{Columns as _, DensityFn, KernelFn, PriorFn, RowFn, ScalarFn, Terms as _};
use super::gp::{Field, SpectrumAt};
use super::linear::Linear;
use super::model::Model;
use super::parameter::{ImputedOp, NormalOp, ParameterOp, SequenceFn, SequenceOp};
use super::rows::{Measured, Rows};
use super::scalar::ScalarAt;
use super::scope::Local;
use super::tape::{Bent, Curved, LocalHessian, Op, Second, Tape, add_rows, sum};
use crate::dist::{Dist, Sequence};
use crate::field::Kernel;
use crate::infer::{Evaluator, LogDensity};
use crate::likelihood::Likelihood;
use crate::num::{Dual, Hyper, Num, derivatives, dual};

/// The Hessian of a model at one position.
pub(super) struct Hessian<'m> {
    model: &'m Model,
    t: Tape,
    d: Tape,
    curved: Vec<LocalHessian>,
}

impl<'m> Hessian<'m> {
    /// At `u`; `with_rows` if the measurements count.
    pub(super) fn at(model: &'m Model, u: &[f64], with_rows: bool) -> Self {
        let (mut t, d) = (model.tape(), model.tape());
        let mut gradient = vec![0.0; u.len()];
        let mut curved = vec![];
        if with_rows {
            model.ln_density(&mut t, u, &mut gradient);
            for observe in &model.observes {
                curved.extend(observe.op.curvatures(&t));
            }
        } else {
            model.ln_prior(&mut t, u, &mut gradient);
        }
        for density in &model.densities {
            curved.extend(density.op.curvatures(&t));
        }
        Self { model, t, d, curved }
    }

    /// The Hessian times `direction`, both of the unknowns.
    pub(super) fn times(&mut self, direction: &[f64]) -> &[f64] {
        let Self { model, t, d, curved } = self;
        d.u.copy_from_slice(direction);
        for zero in [&mut d.v, &mut d.g, &mut d.gu] {
            zero.fill(0.0);
        }
        model.priors.iter().for_each(|op| op.push(t, d));
        model.fields.iter().for_each(|field| field.op.push(t, d));
        model.linear.iter().for_each(|op| op.push(t, d));
        for term in curved {
            term.pull(d);
        }
        model.linear.iter().rev().for_each(|op| op.pull(t, d));
        model.fields.iter().rev().for_each(|field| field.op.pull(t, d));
        model.priors.iter().rev().for_each(|op| op.pull(t, d));
        &d.gu
    }

    /// Column `i`.
    pub(super) fn column(&mut self, i: usize) -> &[f64] {
        let mut direction = vec![0.0; self.t.u.len()];
        direction[i] = 1.0;
        self.times(&direction)
    }
}

struct OnTape<'m> {
    model: &'m Model,
    tape: Tape,
}

impl Evaluator for OnTape<'_> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        self.model.ln_density(&mut self.tape, position, gradient)
    }
    fn hessian(&mut self, position: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let mut hessian = Hessian::at(self.model, position, true);
        (0..position.len()).for_each(|i| take(i, hessian.column(i)));
    }
}

impl LogDensity for Model {
    fn dim(&self) -> usize {
        self.layout[0]
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(OnTape { model: self, tape: self.tape() })
    }
}

impl Model {
    /// Columns `of` of the Hessian of the log density without the measurements, each `(dim)`.
    pub fn prior_hessian(&self, u: &[f64], of: &[usize]) -> Vec<Vec<f64>> {
        let mut hessian = Hessian::at(self, u, false);
        of.iter().map(|i| hessian.column(*i).to_vec()).collect()
    }
}

impl<const N: usize> Local<N> {
    /// The numbers with a derivative in number `j` of them, and along the direction.
    fn hyper(&self, j: usize, t: &Tape, d: &Tape) -> [Num<Hyper>; N] {
        std::array::from_fn(|i| {
            let at = self.at[i] as usize;
            Num(Hyper::new(t.v[at], unit(i == j), d.v[at], 0.0))
        })
    }

    /// The numbers with their derivative along the direction.
    fn pushed(&self, t: &Tape, d: &Tape) -> [Num<Dual<1>>; N] {
        std::array::from_fn(|i| {
            let at = self.at[i] as usize;
            Num(dual(t.v[at], [d.v[at]]))
        })
    }

    /// Where number `j` lives.
    fn place(&self, j: usize) -> usize {
        self.at[j] as usize
    }
}

/// 1 if this is the one that is differentiated.
fn unit(is_this: bool) -> f64 {
    f64::from(u8::from(is_this))
}

/// The change of a number along the direction.
fn change(x: Num<Dual<1>>) -> f64 {
    derivatives(&x.0)[0]
}

impl<F: PriorFn<N>, const N: usize, const W: usize> Second for ParameterOp<F, N, W> {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let prior = F::prior(self.local.pushed(t, d));
        for i in 0..self.n {
            let u = Num(dual(t.u[self.u + i], [d.u[self.u + i]]));
            d.v[self.v + i] = change(prior.constrain(u));
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let values = |i: usize| (self.u + i, self.v + i);
        pull_prior::<F, N>(&self.local, (0..self.n).map(values), N > 0, t, d);
    }
}

/// The pull of unknowns and their values `(u, v)` with the same prior.
fn pull_prior<F: PriorFn<N>, const N: usize>(
    local: &Local<N>,
    values: impl Iterator<Item = (usize, usize)> + Clone,
    has_norm: bool,
    t: &Tape,
    d: &mut Tape,
) {
    for j in 0..=N {
        let prior = F::prior::<Hyper>(local.hyper(j, t, d));
        for (u, v) in values.clone() {
            let x_u = Num(Hyper::new(t.u[u], unit(j == N), d.u[u], 0.0));
            let x = prior.constrain(x_u);
            let mut l = prior.ln_kernel(x_u, x);
            if has_norm {
                l += prior.ln_norm();
            }
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
        let prior = F::prior(self.local.pushed(t, d));
        for (i, row) in self.missing.iter().enumerate() {
            let u = Num(dual(t.u[self.u + i], [d.u[self.u + i]]));
            d.v[self.v + row] = change(prior.constrain(u));
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let missing = self.missing.iter().enumerate();
        let values = missing.map(|(i, row)| (self.u + i, self.v + row));
        pull_prior::<F, N>(&self.local, values, true, t, d);
        for j in 0..N {
            let prior = F::prior::<Hyper>(self.local.hyper(j, t, d));
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
        let prior = F::sequence(self.local.pushed(t, d));
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
        let free = F::sequence(self.local.plain(&t.v)).n_unknowns(self.n);
        for j in 0..N {
            let prior = F::sequence::<Hyper>(self.local.hyper(j, t, d));
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
            let prior = F::sequence::<Hyper>(self.local.hyper(j, t, d));
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

impl<F: ScalarFn<N>, const N: usize> Bent for ScalarAt<F, N> {
    fn bend(&self, t: &Tape, bars: &[f64], _: &[f64], d: &mut Tape) {
        for j in 0..N {
            let x: Num<Hyper> = F::value(self.local.hyper(j, t, d));
            d.g[self.local.place(j)] += bars[0] * x.0.eps1eps2;
        }
    }
}

impl<F: KernelFn<N>, const N: usize> Bent for SpectrumAt<F, N> {
    fn bend(&self, t: &Tape, bars: &[f64], frequency: &[f64], d: &mut Tape) {
        for j in 0..N {
            let kernel = F::kernel::<Hyper>(self.local.hyper(j, t, d));
            let term = |(bar, w): (&f64, &f64)| bar * kernel.sqrt_density(*w).0.eps1eps2;
            d.g[self.local.place(j)] += bars.iter().zip(frequency).map(term).sum::<f64>();
        }
    }
}

/// A term at a point and its change: amplitude, √S and coefficients.
struct TermAt {
    amplitude: [f64; 2],
    c: [Vec<f64>; 2],
    eta: [Vec<f64>; 2],
}

impl Field {
    fn term_at(&self, i: usize, t: &Tape, d: &Tape) -> TermAt {
        let (term, tail) = (&self.terms[i], &t.work[self.work + 2 * self.stride..]);
        let (c, dc) = tail[term.work..].split_at(term.k);
        let mut change = vec![0.0; term.k];
        for (place, dc) in term.spectrum.mentions().into_iter().zip(dc.chunks_exact(term.k)) {
            change.iter_mut().zip(dc).for_each(|(change, dc)| *change += dc * d.v[place]);
        }
        let eta = [&t.u, &d.u].map(|u| u[term.eta..][..term.k].to_vec());
        let amplitude = [term.amplitude.value(&t.v), along(&*term.amplitude, t, d)];
        TermAt { amplitude, c: [c.to_vec(), change], eta }
    }
}

/// The change of a scalar.
fn along(scalar: &dyn super::scalar::Scalar, t: &Tape, d: &Tape) -> f64 {
    let mut slope = vec![0.0; t.v.len()];
    scalar.pull(&t.v, 1.0, &mut slope);
    scalar.mentions().into_iter().map(|at| slope[at] * d.v[at]).sum()
}

impl Second for Field {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let mut w = vec![0.0; self.stride];
        for i in 0..self.terms.len() {
            let TermAt { amplitude: [a, da], c: [c, dc], eta: [eta, d_eta] } =
                self.term_at(i, t, d);
            for k in 0..c.len() {
                w[k] += da * c[k] * eta[k] + a * dc[k] * eta[k] + a * c[k] * d_eta[k];
            }
        }
        let mean = along(&*self.mean, t, d);
        let theta = &mut d.v[self.theta..][..super::gp::padded(self.n_probes())];
        theta.fill(mean);
        add_rows(&w, &self.modes, theta);
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let q = &t.work[self.work + self.stride..][..self.stride];
        let mut dq = vec![0.0; self.stride];
        let theta_bar = d.g[self.theta..][..self.n_probes()].to_vec();
        add_rows(&theta_bar, &self.probes, &mut dq);
        for (i, term) in self.terms.iter().enumerate() {
            let TermAt { amplitude: [a, da], c: [c, dc], eta: [eta, d_eta] } =
                self.term_at(i, t, d);
            let (mut a_bar, mut da_bar) = (0.0, 0.0);
            let (mut c_bar, mut dc_bar) = (vec![0.0; term.k], vec![0.0; term.k]);
            for k in 0..term.k {
                a_bar += c[k] * eta[k] * q[k];
                da_bar += (dc[k] * eta[k] + c[k] * d_eta[k]) * q[k] + c[k] * eta[k] * dq[k];
                c_bar[k] = a * eta[k] * q[k];
                dc_bar[k] = (da * eta[k] + a * d_eta[k]) * q[k] + a * eta[k] * dq[k];
                d.gu[term.eta + k] += (da * c[k] + a * dc[k]) * q[k] + a * c[k] * dq[k] - d_eta[k];
            }
            let tail = &t.work[self.work + 2 * self.stride + term.work + term.k..];
            term.spectrum.pull(&dc_bar, &tail[..term.k * term.spectrum.width()], &mut d.g);
            term.spectrum.bend(t, &c_bar, &self.frequency[..term.k], d);
            term.amplitude.pull(&t.v, da_bar, &mut d.g);
            term.amplitude.bend(t, &[a_bar], &[], d);
        }
        self.mean.pull(&t.v, sum(&theta_bar), &mut d.g);
        let mean_bar = sum(&t.g[self.theta..][..self.n_probes()]);
        self.mean.bend(t, &[mean_bar], &[], d);
    }
}

impl Second for Linear {
    fn push(&self, _: &Tape, d: &mut Tape) {
        self.forward(d);
    }

    fn pull(&self, _: &Tape, d: &mut Tape) {
        self.backward(d);
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> Second for Rows<F, N, W> {}

impl<F: RowFn<N>, const N: usize, const W: usize> Curved for Rows<F, N, W> {
    fn curvatures(&self, t: &Tape) -> Vec<LocalHessian> {
        let one = |i: usize| {
            let places = self.locals(i);
            let locals: Vec<f64> = places.iter().map(|(v, o)| t.v[*v] + t.v[*o]).collect();
            LocalHessian::new(places, |a, b| {
                let number = |j, x| Hyper::new(x, unit(j == a), unit(j == b), 0.0);
                let likelihood = self.likelihood(self.fill(&locals, number), i);
                likelihood.ln_likelihood(&self.y[i]).0.eps1eps2
            })
        };
        (0..self.y.len()).map(one).collect()
    }
}

impl<F: DensityFn<N>, const N: usize> Second for DensityAt<F, N> {}

impl<F: DensityFn<N>, const N: usize> Curved for DensityAt<F, N> {
    fn curvatures(&self, t: &Tape) -> Vec<LocalHessian> {
        let data = F::Columns::data(&self.cells);
        let places = (0..N).map(|j| (self.local.place(j), 0)).collect();
        vec![LocalHessian::new(places, |a, b| {
            let number = |i: usize| {
                let re = t.v[self.local.place(i)];
                Num(Hyper::new(re, unit(i == a), unit(i == b), 0.0))
            };
            let terms = F::terms::<Hyper>(std::array::from_fn(number), &data);
            terms.terms().iter().fold(Num::from(0.0), |sum: Num<Hyper>, x| sum + x).0.eps1eps2
        })]
    }
}

#[cfg(test)]
#[path = "second_tests.rs"]
mod tests;
