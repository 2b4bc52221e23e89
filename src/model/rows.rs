//! Measurements: the rows of an `observe` statement.

use num_dual::DualStruct;
use pulp::{Arch, Simd, WithSimd};
use rand::Rng;

use super::functions::RowFn;
use super::tape::{Curved, Op, Tape};
use crate::likelihood::{Likelihood, Observation, Outliers};
use crate::num::lanes::LANES;
use crate::num::{Dual, Hyper, Num, Real, derivatives, variable};

/// Where the scalars of every row live in `v`.
#[derive(Debug)]
pub(super) struct Place {
    /// (rows, W): where each scalar that carries a derivative lives.
    pub(super) index: Vec<u32>,
    /// (rows, W): an offset added to it, or empty if no effect acts on a field here.
    pub(super) hook: Vec<u32>,
    /// First offset of each `let` in sight on which an effect acts.
    pub(super) lets: Vec<Option<usize>>,
}

impl Place {
    /// See [`Measured::locals`].
    fn locals(&self, i: usize, w: usize) -> Vec<(usize, usize)> {
        let hook = |j: usize| self.hook.get(i * w + j).map_or(0, |at| *at as usize);
        let value = |j: usize| (self.index[i * w + j] as usize, hook(j));
        let lets = self.lets.iter().flatten().map(|at| (at + i, 0));
        (0..w).map(value).chain(lets).collect()
    }
}

/// What a model can do with its measurements besides the gradient.
pub(super) trait Measured: Op + Curved {
    /// Log likelihood of each row, after a forward pass.
    fn pointwise(&self, t: &Tape, out: &mut Vec<f64>);
    /// A simulated measurement for each row, as cells (see [`Observation::cells`]).
    fn simulate(&self, t: &Tape, rng: &mut dyn Rng) -> Vec<Vec<f64>>;
    /// The measurements as cells.
    fn observed(&self) -> Vec<Vec<f64>>;
    /// Where in `v` the scalars of row `i` live: the value, and the offset added to it if an effect
    /// may act there (`v[0]`, which is zero, if not); then the offsets of its `let`s.
    fn locals(&self, i: usize) -> Vec<(usize, usize)>;
    /// Log likelihood of row `i` at these scalars, under `noise`, had `cells` been measured.
    fn ln_at(&self, i: usize, cells: &[f64], locals: &[f64], noise: &Noise) -> f64;
    /// As [`Measured::ln_at`], with gradient and Hessian `(n, n)` in the scalars numbered `of`, zero in the others.
    fn curvature(
        &self,
        i: usize,
        cells: &[f64],
        locals: &[f64],
        of: &[usize],
        noise: &Noise,
    ) -> Curvature;
    /// A simulated measurement for row `i` at these scalars, as cells, without noise, made as `cells` were.
    fn replicate(&self, i: usize, cells: &[f64], locals: &[f64], rng: &mut dyn Rng) -> Vec<f64>;
    /// The predicted value of row `i` at these scalars, if the likelihood has one.
    fn location(&self, i: usize, locals: &[f64]) -> Option<f64>;
    /// The measurement of row `i` as cells.
    fn observed_row(&self, i: usize) -> Vec<f64>;
    /// Puts another measurement in the place of row `i`'s.
    fn set_observed(&mut self, i: usize, cells: &[f64]);
    /// Takes row `i` out of the density; its log likelihood can still be had.
    fn leave_out(&mut self, i: usize);
    /// The first row whose measurement this likelihood cannot take, and why.
    fn objection(&self, t: &Tape) -> Option<(usize, &'static str)>;
}

/// What spreads a measurement beyond its likelihood, in the unit of the measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Variance of a normal error of every measurement.
    pub variance: f64,
    /// Share of outlying measurements, and the variance of their further error.
    pub outliers: Option<(f64, f64)>,
}

/// A row's log likelihood, its gradient and its Hessian in the row's scalars.
#[derive(Clone, Debug, Default)]
pub struct Curvature {
    /// Log likelihood.
    pub value: f64,
    /// Gradient, `(n)`.
    pub gradient: Vec<f64>,
    /// Hessian, row-major `(n, n)`.
    pub hessian: Vec<f64>,
}

/// All measurements of one kind. Of the N numbers of a row the first W carry derivatives, the others are the offsets
/// of its `let`s.
#[derive(Debug)]
pub(super) struct Rows<F: RowFn<N>, const N: usize, const W: usize> {
    pub(super) columns: Vec<F::Columns>,
    pub(super) y: Vec<F::Y>,
    pub(super) place: Place,
    /// Share of outlying measurements and the variance of their further error, where these were added to
    /// the model.
    pub(super) outliers: Option<(f64, f64)>,
    /// A row that does not count in the density.
    pub(super) left_out: Option<usize>,
}

impl<F: RowFn<N>, const N: usize, const W: usize> Rows<F, N, W> {
    /// The numbers of row `i`; `number` makes them of (which, value), offsets of `let`s being number W and up. An
    /// offset that nobody sets is a constant, which the compiler sees.
    #[inline(always)]
    fn gather<D: Real>(
        &self,
        v: &[f64],
        i: usize,
        number: impl Fn(usize, f64) -> D,
    ) -> [Num<D>; N] {
        let mut s = [Num(D::from(0.0)); N];
        let index = &self.place.index[i * W..][..W];
        for j in 0..W {
            let mut x = v[index[j] as usize];
            if !self.place.hook.is_empty() {
                x += v[self.place.hook[i * W + j] as usize];
            }
            s[j] = Num(number(j, x));
        }
        for (j, at) in self.place.lets.iter().enumerate().take(const { N - W }) {
            if let Some(at) = at {
                s[W + j] = Num(number(W + j, v[at + i]));
            }
        }
        s
    }

    fn plain(&self, v: &[f64], i: usize) -> [Num<f64>; N] {
        self.gather(v, i, |_, x| x)
    }

    /// The likelihood of row `i`, with the outliers that were added. Not inlined, so that a model's expressions are
    /// compiled once for all that is not the gradient.
    #[inline(never)]
    pub(super) fn likelihood<D: Real>(
        &self,
        s: [Num<D>; N],
        i: usize,
    ) -> Outliers<impl Likelihood<Num<D>, F::Y> + use<D, F, N, W>> {
        let (share, variance) = self.outliers.unwrap_or_default();
        Outliers(F::likelihood(s, &self.columns[i]), share, variance.sqrt())
    }

    fn likelihood_at(&self, v: &[f64], i: usize) -> impl Likelihood<Num<f64>, F::Y> + use<F, N, W> {
        self.likelihood(self.plain(v, i), i)
    }

    /// Derivative of row `i`'s log likelihood in the offset of `let` number `a`. Not inlined: offsets
    /// are rare, and one copy serves them all.
    #[inline(never)]
    fn offset_derivative(&self, v: &[f64], i: usize, a: usize) -> f64 {
        let number = |j: usize, re| Hyper::new(re, f64::from(u8::from(j == W + a)), 0.0, 0.0);
        self.likelihood(self.gather(v, i, number), i).ln_likelihood(&self.y[i]).0.eps1
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> Rows<F, N, W> {
    /// The likelihood of row `i` with derivatives in the W numbers, and its measurement.
    #[inline(always)]
    fn dual_row(&self, v: &[f64], i: usize) -> (impl Likelihood<Num<Dual<W>>, F::Y>, &F::Y) {
        let s = self.gather(v, i, |j, x| if j < W { variable(x, j) } else { Dual::from_re(x) });
        (F::likelihood(s, &self.columns[i]), &self.y[i])
    }

    /// Several rows at once.
    #[inline(always)]
    fn backward_lanes(&self, t: &mut Tape) {
        let n = self.y.len();
        for first in (0..n).step_by(LANES) {
            let row = |lane: usize| self.dual_row(&t.v, (first + lane).min(n - 1)); // the last fills up
            let values = Likelihood::ln_likelihoods([row(0), row(1), row(2), row(3)]);
            for (i, value) in (first..n).zip(values) {
                self.scatter(i, &value.0, t);
            }
        }
    }

    /// The same bits row by row: less to compile for machines without vector registers.
    #[inline(always)]
    fn backward_rows(&self, t: &mut Tape) {
        for i in 0..self.y.len() {
            let value = {
                let (likelihood, y) = self.dual_row(&t.v, i);
                likelihood.ln_likelihood(y)
            };
            self.scatter(i, &value.0, t);
        }
    }

    /// As [`Self::backward_rows`], with the outliers that were added.
    #[inline(never)]
    fn backward_with_outliers(&self, t: &mut Tape) {
        for i in 0..self.y.len() {
            let number = |j, x| if j < W { variable(x, j) } else { Dual::from_re(x) };
            let value = self.likelihood(self.gather(&t.v, i, number), i).ln_likelihood(&self.y[i]);
            self.scatter(i, &value.0, t);
        }
    }

    /// Adds row `i`'s log likelihood to the density, and its derivatives to the adjoint.
    #[inline(always)]
    fn scatter(&self, i: usize, value: &Dual<W>, t: &mut Tape) {
        if self.left_out == Some(i) {
            return;
        }
        t.lp += value.re();
        let e = &derivatives(value);
        for (at, e) in self.place.index[i * W..][..W].iter().zip(e) {
            t.g[*at as usize] += e;
        }
        if !self.place.hook.is_empty() {
            for (at, e) in self.place.hook[i * W..][..W].iter().zip(e) {
                t.g[*at as usize] += e;
            }
        }
        for (j, at) in self.place.lets.iter().enumerate() {
            if let Some(at) = at {
                t.g[at + i] += self.offset_derivative(&t.v, i, j);
            }
        }
    }
}

struct Backward<'a, F: RowFn<N>, const N: usize, const W: usize>(&'a Rows<F, N, W>, &'a mut Tape);

impl<F: RowFn<N>, const N: usize, const W: usize> WithSimd for Backward<'_, F, N, W> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        if S::IS_SCALAR { self.0.backward_rows(self.1) } else { self.0.backward_lanes(self.1) }
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> Rows<F, N, W> {
    /// The numbers of a row from those of [`Measured::locals`]: `number` makes them of (which, value).
    pub(super) fn fill<D: Real>(
        &self,
        locals: &[f64],
        number: impl Fn(usize, f64) -> D,
    ) -> [Num<D>; N] {
        let mut s = [Num(D::from(0.0)); N];
        let lets = self.place.lets.iter().enumerate();
        let lets = lets.filter_map(|(j, at)| at.map(|_| W + j));
        for (j, (slot, x)) in (0..W).chain(lets).zip(locals).enumerate() {
            s[slot] = Num(number(j, *x));
        }
        s
    }

    /// A measurement of row `i` from its cells; the row's own where these hold none.
    fn measurement(&self, i: usize, cells: &[f64]) -> F::Y {
        F::Y::read(cells).ok().flatten().unwrap_or(self.y[i])
    }

    /// Not inlined: criticism is rare, and one copy serves it all.
    #[inline(never)]
    fn ln_noisy<D: Real>(&self, s: [Num<D>; N], i: usize, y: &F::Y, noise: &Noise) -> D {
        let mut likelihood = self.likelihood(s, i);
        if let Some((share, variance)) = noise.outliers {
            (likelihood.share, likelihood.sd) = (share, variance.sqrt());
        }
        likelihood.ln_widened(y, Num::from(noise.variance)).0
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> Op for Rows<F, N, W> {
    fn backward(&self, t: &mut Tape) {
        if self.outliers.is_some() {
            self.backward_with_outliers(t);
        } else {
            Arch::new().dispatch(Backward(self, t));
        }
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> Measured for Rows<F, N, W> {
    fn pointwise(&self, t: &Tape, out: &mut Vec<f64>) {
        let one = |i: usize| self.likelihood_at(&t.v, i).ln_likelihood(&self.y[i]).0;
        out.extend((0..self.y.len()).map(one));
    }

    fn simulate(&self, t: &Tape, rng: &mut dyn Rng) -> Vec<Vec<f64>> {
        let one = |i: usize| self.likelihood_at(&t.v, i).simulate(&self.y[i], rng).cells();
        (0..self.y.len()).map(one).collect()
    }

    fn observed(&self) -> Vec<Vec<f64>> {
        self.y.iter().map(Observation::cells).collect()
    }

    fn locals(&self, i: usize) -> Vec<(usize, usize)> {
        self.place.locals(i, W)
    }

    fn ln_at(&self, i: usize, cells: &[f64], locals: &[f64], noise: &Noise) -> f64 {
        self.ln_noisy(self.fill(locals, |_, x| x), i, &self.measurement(i, cells), noise)
    }

    fn curvature(
        &self,
        i: usize,
        cells: &[f64],
        locals: &[f64],
        of: &[usize],
        noise: &Noise,
    ) -> Curvature {
        let (n, y) = (locals.len(), self.measurement(i, cells));
        let mut out = Curvature { value: 0.0, gradient: vec![0.0; n], hessian: vec![0.0; n * n] };
        let is = |a: usize, j: usize| f64::from(u8::from(a == j));
        for (k, &a) in of.iter().enumerate() {
            for &b in &of[k..] {
                let s = self.fill(locals, |j, x| Hyper::new(x, is(a, j), is(b, j), 0.0));
                let l = self.ln_noisy(s, i, &y, noise);
                (out.value, out.gradient[a], out.gradient[b]) = (l.re, l.eps1, l.eps2);
                (out.hessian[a * n + b], out.hessian[b * n + a]) = (l.eps1eps2, l.eps1eps2);
            }
        }
        out
    }

    fn replicate(&self, i: usize, cells: &[f64], locals: &[f64], rng: &mut dyn Rng) -> Vec<f64> {
        let like = self.measurement(i, cells);
        self.likelihood(self.fill(locals, |_, x| x), i).simulate(&like, rng).cells()
    }

    fn location(&self, i: usize, locals: &[f64]) -> Option<f64> {
        self.likelihood(self.fill(locals, |_, x| x), i).location()
    }

    fn observed_row(&self, i: usize) -> Vec<f64> {
        self.y[i].cells()
    }

    fn set_observed(&mut self, i: usize, cells: &[f64]) {
        if let Ok(Some(y)) = F::Y::read(cells) {
            self.y[i] = y;
        }
    }

    fn leave_out(&mut self, i: usize) {
        self.left_out = Some(i);
    }

    fn objection(&self, t: &Tape) -> Option<(usize, &'static str)> {
        (0..self.y.len())
            .find_map(|i| self.likelihood_at(&t.v, i).objection(&self.y[i]).map(|why| (i, why)))
    }
}
