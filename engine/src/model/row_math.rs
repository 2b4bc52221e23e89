//! The likelihood of an `observe` statement on its rows: the part of it that is compiled with each
//! model.

use num_dual::{DualNum, DualStruct};
use pulp::{Arch, Simd, WithSimd};
use rand::Rng;

use super::error::ModelError;
use super::functions::{Columns, RowFn};
use super::map::ReadCell;
use super::row_line::{AddLns, Line, Slope};
use super::row_place::{ERROR, Place};
use super::tape::Tape;
use crate::likelihood::{Likelihood, Observation, Outliers};
use crate::num::lanes::LANES;
use crate::num::{Dual, Hyper, Num, Real, Third, derivatives, variable};

/// Share of outlying measurements, and the variance of their further error.
pub(super) type OutlierShare = (f64, f64);

/// A row: the N numbers that its likelihood depends on, then the sd of a further error, which is 0
/// if there is none, and ln of a factor of that sd.
#[derive(Clone, Copy)]
pub(super) struct Row<'a> {
    pub(super) i: usize,
    pub(super) numbers: &'a [f64],
    pub(super) outliers: OutlierShare,
}

/// Where a measurement of a row comes from.
#[derive(Clone, Copy)]
pub(super) struct Measurement<'a> {
    /// The cells of the measurement. If these hold none, the row's own measurement is meant.
    pub(super) cells: &'a [f64],
    /// Variance of a normal error that it has beyond its likelihood.
    pub(super) variance: f64,
}

/// A likelihood with its measurements and the columns that it reads.
pub(super) trait RowMath: Send + Sync {
    /// The numeric columns that the model reads: each one's name, and the table's columns behind it.
    fn columns(&self) -> Vec<(&'static str, Vec<String>)>;
    /// Names of the numbers that a measurement consists of.
    fn cells(&self) -> &'static [&'static str];
    /// Takes the columns of one more row.
    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError>;
    /// Takes the measurement of one more row from its cells; says whether they hold one.
    fn take(&mut self, cells: &[f64]) -> Result<bool, String>;
    /// Takes the measurement of the last row from its columns, and gives its cells.
    fn compute(&mut self) -> Option<Vec<f64>>;
    /// How many measurements there are.
    fn len(&self) -> usize;
    /// The measurement of row `i` as cells.
    fn measured(&self, i: usize) -> Vec<f64>;
    /// Adds the log likelihood of all rows to the density, and its derivatives to the adjoint. They
    /// are those in the numbers that carry derivatives.
    fn backward(&self, place: &Place, outliers: Option<OutlierShare>, t: &mut Tape);
    /// Log likelihood of a row.
    fn ln(&self, row: Row<'_>) -> f64;
    /// Adds the log likelihood of a row at each of these latent values `(n, n_blocks)`.
    fn add_lns(&self, row: Row<'_>, line: Line<'_>, theta: &[f64], out: &mut [f64]);
    /// As [`RowMath::ln`], with derivatives in its numbers `a` and `b`.
    fn second(&self, row: Row<'_>, a: usize, b: usize) -> Hyper;
    /// Log likelihood of a row, if `y` had been measured.
    fn ln_of(&self, row: Row<'_>, y: Measurement<'_>) -> f64;
    /// As [`RowMath::ln_of`], with derivatives in its numbers `a` and `b`. The number after the
    /// last one stands for the variance of the measurement.
    fn second_of(&self, row: Row<'_>, y: Measurement<'_>, a: usize, b: usize) -> Hyper;
    /// As [`RowMath::ln_of`], with two derivatives along `direction` of its numbers and one in
    /// number `a`, which may be the variance as in [`RowMath::second_of`].
    fn third_of(&self, row: Row<'_>, y: Measurement<'_>, direction: &[f64], a: usize) -> Third;
    /// A simulated measurement. It is made as the measurement `like` was, or else as the row's own:
    /// a bracket has its width.
    fn simulate(&self, row: Row<'_>, like: Option<&[f64]>, rng: &mut dyn Rng) -> Vec<f64>;
    /// The predicted value, if the likelihood has one.
    fn location(&self, row: Row<'_>) -> Option<f64>;
    /// Its derivative in number `a`.
    fn location_slope(&self, row: Row<'_>, a: usize) -> Option<f64>;
    /// Why this likelihood cannot take the row's measurement, if it cannot.
    fn objection(&self, row: Row<'_>) -> Option<&'static str>;
}

/// The likelihood F of N numbers. The first W carry derivatives; the others are the offsets of
/// `let`s.
pub(super) struct RowsOf<F: RowFn<N>, const N: usize, const W: usize> {
    columns: Vec<F::Columns>,
    y: Vec<F::Y>,
}

impl<F: RowFn<N>, const N: usize, const W: usize> RowsOf<F, N, W> {
    /// A likelihood without rows.
    pub(super) fn new() -> Self {
        Self { columns: vec![], y: vec![] }
    }

    /// The numbers of row `i`. The offsets of `let`s are those from W on. An offset that nobody
    /// sets is a constant, and the compiler sees that.
    #[inline(always)]
    fn gather(place: &Place, v: &[f64], i: usize) -> [Num<Dual<W>>; N] {
        let mut s = [Num(Dual::from(0.0)); N];
        let index = &place.index[i * W..][..W];
        for j in 0..W {
            let mut x = v[index[j] as usize];
            if !place.hook.is_empty() {
                x += v[place.hook[i * W + j] as usize];
            }
            s[j] = Num(variable(x, j));
        }
        for (j, at) in place.lets.iter().enumerate().take(const { N - W }) {
            if let Some(at) = at {
                s[W + j] = Num(Dual::from_re(v[at + i]));
            }
        }
        s
    }

    /// The likelihood of a row, with the outliers that were added. It is not inlined, so that the
    /// expressions of a model are compiled only once for everything but the gradient.
    #[inline(never)]
    fn likelihood<D: Real>(
        &self,
        s: [Num<D>; N],
        i: usize,
        (share, variance): OutlierShare,
    ) -> Outliers<impl Likelihood<Num<D>, F::Y> + use<D, F, N, W>> {
        Outliers(F::likelihood(s, &self.columns[i]), share, variance.sqrt())
    }

    fn plain(&self, row: Row<'_>) -> Outliers<impl Likelihood<Num<f64>, F::Y> + use<F, N, W>> {
        self.likelihood(std::array::from_fn(|j| Num(row.numbers[j])), row.i, row.outliers)
    }

    /// The sd of the further error of a row.
    fn further_sd(row: Row<'_>) -> f64 {
        row.numbers[N] * row.numbers[N + 1].exp()
    }

    /// Its variance.
    fn further(row: Row<'_>) -> f64 {
        Self::further_sd(row).powi(2)
    }

    /// As [`Self::further`], with derivatives in the numbers `a` and `b`.
    fn further_hyper(row: Row<'_>, a: usize, b: usize) -> Num<Hyper> {
        let [sd, ln] = [N, N + 1].map(|j| Num(hyper(row.numbers[j], j, a, b)));
        let sd = sd * ln.exp();
        sd * sd
    }

    fn hyper(
        &self,
        row: Row<'_>,
        a: usize,
        b: usize,
    ) -> Outliers<impl Likelihood<Num<Hyper>, F::Y> + use<F, N, W>> {
        let number = |j: usize| Num(hyper(row.numbers[j], j, a, b));
        self.likelihood(std::array::from_fn(number), row.i, row.outliers)
    }

    /// A measurement of row `i` from its cells, or the row's own if these hold none.
    fn measurement(&self, i: usize, cells: &[f64]) -> F::Y {
        F::Y::read(cells).ok().flatten().unwrap_or(self.y[i])
    }

    /// The likelihood of row `i` with derivatives in the W numbers, and its measurement.
    #[inline(always)]
    fn dual_row(
        &self,
        place: &Place,
        v: &[f64],
        i: usize,
    ) -> (impl Likelihood<Num<Dual<W>>, F::Y>, &F::Y) {
        (F::likelihood(Self::gather(place, v, i), &self.columns[i]), &self.y[i])
    }

    /// Several rows at once.
    #[inline(always)]
    fn backward_lanes(&self, place: &Place, t: &mut Tape) {
        let n = self.y.len();
        for first in (0..n).step_by(LANES) {
            let row = |lane: usize| self.dual_row(place, &t.v, (first + lane).min(n - 1)); // the last fills up
            let values = Likelihood::ln_likelihoods([row(0), row(1), row(2), row(3)]);
            for (i, value) in (first..n).zip(values) {
                scatter(place, i, &value.0, t);
            }
        }
    }

    /// The same bits row by row: less to compile for machines without vector registers.
    #[inline(always)]
    fn backward_rows(&self, place: &Place, t: &mut Tape) {
        for i in 0..self.y.len() {
            let value = {
                let (likelihood, y) = self.dual_row(place, &t.v, i);
                likelihood.ln_likelihood(y)
            };
            scatter(place, i, &value.0, t);
        }
    }

    /// As [`Self::backward_rows`], with the outliers and the further error that were added.
    #[inline(never)]
    fn backward_with_added(&self, place: &Place, outliers: OutlierShare, t: &mut Tape) {
        for i in 0..self.y.len() {
            let likelihood = self.likelihood(Self::gather(place, &t.v, i), i, outliers);
            let value = match place.error {
                Some(error) => {
                    let ln = error.scatter.map_or(0.0, |at| t.v[at + i]);
                    let variance = (t.v[error.sd] * ln.exp()).powi(2);
                    likelihood.ln_widened(&self.y[i], Num(Dual::from_re(variance)))
                }
                None => likelihood.ln_likelihood(&self.y[i]),
            };
            scatter(place, i, &value.0, t);
        }
    }
}

/// Number `j`, with derivatives if it is `a` or `b`.
fn hyper(x: f64, j: usize, a: usize, b: usize) -> Hyper {
    let is = |a: usize| f64::from(u8::from(a == j));
    Hyper::new(x, is(a), is(b), 0.0)
}

/// Adds row `i`'s log likelihood to the density, and its derivatives to the adjoint.
#[inline(always)]
fn scatter<const W: usize>(place: &Place, i: usize, value: &Dual<W>, t: &mut Tape) {
    if place.left_out == Some(i) {
        return;
    }
    t.lp += value.re();
    let e = &derivatives(value);
    for (at, e) in place.index[i * W..][..W].iter().zip(e) {
        t.g[*at as usize] += e;
    }
    if !place.hook.is_empty() {
        for (at, e) in place.hook[i * W..][..W].iter().zip(e) {
            t.g[*at as usize] += e;
        }
    }
}

struct Backward<'a, F: RowFn<N>, const N: usize, const W: usize> {
    rows: &'a RowsOf<F, N, W>,
    place: &'a Place,
    t: &'a mut Tape,
}

impl<F: RowFn<N>, const N: usize, const W: usize> WithSimd for Backward<'_, F, N, W> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { rows, place, t } = self;
        if S::IS_SCALAR { rows.backward_rows(place, t) } else { rows.backward_lanes(place, t) }
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> RowMath for RowsOf<F, N, W> {
    fn columns(&self) -> Vec<(&'static str, Vec<String>)> {
        F::Columns::names()
    }

    fn cells(&self) -> &'static [&'static str] {
        F::Y::COLUMNS
    }

    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError> {
        self.columns.push(F::Columns::read(cell)?);
        Ok(())
    }

    fn take(&mut self, cells: &[f64]) -> Result<bool, String> {
        let y = F::Y::read(cells)?;
        self.y.extend(y);
        Ok(y.is_some())
    }

    fn compute(&mut self) -> Option<Vec<f64>> {
        let y = F::measured(self.columns.last()?)?;
        self.y.push(y);
        Some(y.cells())
    }

    fn len(&self) -> usize {
        self.y.len()
    }

    fn measured(&self, i: usize) -> Vec<f64> {
        self.y[i].cells()
    }

    fn backward(&self, place: &Place, outliers: Option<OutlierShare>, t: &mut Tape) {
        if outliers.is_some() || place.error.is_some() {
            self.backward_with_added(place, outliers.unwrap_or_default(), t);
        } else {
            Arch::new().dispatch(Backward { rows: self, place, t });
        }
    }

    fn ln(&self, row: Row<'_>) -> f64 {
        let (likelihood, y) = (self.plain(row), &self.y[row.i]);
        match Self::further(row) {
            0.0 => likelihood.ln_likelihood(y).0,
            variance => likelihood.ln_widened(y, Num(variance)).0,
        }
    }

    fn add_lns(&self, row: Row<'_>, line: Line<'_>, theta: &[f64], out: &mut [f64]) {
        let is_plain = row.outliers.0 == 0.0 && Self::further_sd(row) == 0.0;
        if is_plain && line.slopes.iter().all(|slope| slope.number < N) {
            let (columns, y) = (&self.columns[row.i], &self.y[row.i]);
            Arch::new().dispatch(AddLns::<F, N> { columns, y, line, theta, out });
            return;
        }
        let mut numbers = line.base.to_vec();
        for (out, theta) in out.iter_mut().zip(theta.chunks_exact(line.n_blocks)) {
            numbers.copy_from_slice(line.base);
            for Slope { number, block, per_unit } in line.slopes {
                numbers[*number] += per_unit * theta[*block];
            }
            *out += self.ln(Row { numbers: &numbers, ..row });
        }
    }

    fn second(&self, row: Row<'_>, a: usize, b: usize) -> Hyper {
        let (likelihood, y) = (self.hyper(row, a, b), &self.y[row.i]);
        if Self::further(row) == 0.0 {
            return likelihood.ln_likelihood(y).0;
        }
        likelihood.ln_widened(y, Self::further_hyper(row, a, b)).0
    }

    fn ln_of(&self, row: Row<'_>, y: Measurement<'_>) -> f64 {
        let measured = self.measurement(row.i, y.cells);
        self.plain(row).ln_widened(&measured, Num(y.variance + Self::further(row))).0
    }

    fn second_of(&self, row: Row<'_>, y: Measurement<'_>, a: usize, b: usize) -> Hyper {
        let measured = self.measurement(row.i, y.cells);
        let variance = Self::further_hyper(row, a, b) + Num(hyper(y.variance, N + ERROR, a, b));
        self.hyper(row, a, b).ln_widened(&measured, variance).0
    }

    fn third_of(&self, row: Row<'_>, y: Measurement<'_>, direction: &[f64], a: usize) -> Third {
        let measured = self.measurement(row.i, y.cells);
        let number = |j: usize, x: f64, along: f64| {
            let own = f64::from(u8::from(j == a));
            Num(Third::new(x, along, along, own, 0.0, 0.0, 0.0, 0.0))
        };
        let numbers = std::array::from_fn(|j| number(j, row.numbers[j], direction[j]));
        let [sd, ln] = [N, N + 1].map(|j| number(j, row.numbers[j], direction[j]));
        let sd = sd * ln.exp();
        let variance = sd * sd + number(N + ERROR, y.variance, 0.0);
        self.likelihood(numbers, row.i, row.outliers).ln_widened(&measured, variance).0
    }

    fn simulate(&self, row: Row<'_>, like: Option<&[f64]>, rng: &mut dyn Rng) -> Vec<f64> {
        let like = like.map_or(self.y[row.i], |cells| self.measurement(row.i, cells));
        let likelihood = self.plain(row);
        match Self::further_sd(row) {
            0.0 => likelihood.simulate(&like, rng).cells(),
            sd => likelihood.simulate_widened(&like, sd, rng).cells(),
        }
    }

    fn location(&self, row: Row<'_>) -> Option<f64> {
        self.plain(row).location().map(|location| location.0)
    }

    fn location_slope(&self, row: Row<'_>, a: usize) -> Option<f64> {
        self.hyper(row, a, usize::MAX).location().map(|location| location.0.eps1)
    }

    fn objection(&self, row: Row<'_>) -> Option<&'static str> {
        self.plain(row).objection(&self.y[row.i])
    }
}
