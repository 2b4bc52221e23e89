//! Rows whose likelihood is compiled with its model.

use num_dual::DualStruct;
use pulp::{Arch, Simd, WithSimd};

use super::error::ModelError;
use super::functions::{Columns, RowFn};
use super::map::ReadCell;
use super::row_line::{AddLns, Line};
use super::row_math::RowLikelihood;
use super::row_place::Place;
use super::tape::Tape;
use crate::likelihood::Likelihood;
use crate::num::lanes::LANES;
use crate::num::{Dual, Num, Real, derivatives, variable};

/// The likelihood F of N numbers, compiled with its model. The first W carry derivatives; the others are the
/// offsets of `let`s.
pub(super) struct CompiledRows<F: RowFn<N>, const N: usize, const W: usize> {
    columns: Vec<F::Columns>,
}

impl<F: RowFn<N>, const N: usize, const W: usize> CompiledRows<F, N, W> {
    /// A likelihood without rows.
    pub(super) fn new() -> Self {
        Self { columns: vec![] }
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

    /// The likelihood of row `i` with derivatives in the W numbers.
    #[inline(always)]
    fn dual_row(
        &self,
        place: &Place,
        v: &[f64],
        i: usize,
    ) -> impl Likelihood<Num<Dual<W>>, F::Y> + use<F, N, W> {
        F::likelihood(Self::gather(place, v, i), &self.columns[i])
    }

    /// Several rows at once.
    #[inline(always)]
    fn backward_lanes(&self, y: &[F::Y], place: &Place, t: &mut Tape) {
        let n = y.len();
        for first in (0..n).step_by(LANES) {
            let row = |lane: usize| {
                let i = (first + lane).min(n - 1); // the last fills up
                (self.dual_row(place, &t.v, i), &y[i])
            };
            let values = Likelihood::ln_likelihoods([row(0), row(1), row(2), row(3)]);
            for (i, value) in (first..n).zip(values) {
                scatter(place, i, &value.0, t);
            }
        }
    }

    /// The same bits row by row: less to compile for machines without vector registers.
    #[inline(always)]
    fn backward_rows(&self, y: &[F::Y], place: &Place, t: &mut Tape) {
        for (i, y) in y.iter().enumerate() {
            let value = self.dual_row(place, &t.v, i).ln_likelihood(y);
            scatter(place, i, &value.0, t);
        }
    }
}

impl<F: RowFn<N>, const N: usize, const W: usize> RowLikelihood for CompiledRows<F, N, W> {
    type Y = F::Y;

    fn columns(&self) -> Vec<(&'static str, Vec<String>)> {
        F::Columns::names()
    }

    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError> {
        self.columns.push(F::Columns::read(cell)?);
        Ok(())
    }

    fn compute(&self) -> Option<F::Y> {
        F::measured(self.columns.last()?)
    }

    fn n(&self) -> usize {
        N
    }

    /// It is not inlined, so that the expressions of a model are compiled only once for everything but the gradient.
    #[inline(never)]
    fn at<D: Real>(
        &self,
        i: usize,
        number: &dyn Fn(usize) -> Num<D>,
    ) -> impl Likelihood<Num<D>, F::Y> + use<D, F, N, W> {
        F::likelihood(std::array::from_fn(number), &self.columns[i])
    }

    fn backward(&self, y: &[F::Y], place: &Place, t: &mut Tape) {
        Arch::new().dispatch(Backward { rows: self, y, place, t });
    }

    fn add_lns(&self, i: usize, y: &F::Y, line: Line<'_>, theta: &[f64], out: &mut [f64]) {
        Arch::new().dispatch(AddLns::<F, N> { columns: &self.columns[i], y, line, theta, out });
    }
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
    rows: &'a CompiledRows<F, N, W>,
    y: &'a [F::Y],
    place: &'a Place,
    t: &'a mut Tape,
}

impl<F: RowFn<N>, const N: usize, const W: usize> WithSimd for Backward<'_, F, N, W> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { rows, y, place, t } = self;
        if S::IS_SCALAR {
            rows.backward_rows(y, place, t);
        } else {
            rows.backward_lanes(y, place, t);
        }
    }
}
