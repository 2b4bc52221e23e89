//! Measurements: the rows of an `observe` statement.

use rand::Rng;

use super::row_line::Line;
use super::row_math::{Measurement, OutlierShare, Row, RowMath};
use super::row_place::Place;
use super::tape::{LocalHessian, Tape};
use crate::num::Hyper;

/// Errors of a measurement beyond those of its likelihood, in the unit of the measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Variance of a further normal error of every measurement.
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

impl Curvature {
    /// The curvature in n scalars, with derivatives in those numbered `of`.
    fn new(n: usize, of: &[usize], at: impl Fn(usize, usize) -> Hyper) -> Self {
        let mut out = Self { value: 0.0, gradient: vec![0.0; n], hessian: vec![0.0; n * n] };
        for (k, &a) in of.iter().enumerate() {
            for &b in &of[k..] {
                let l = at(a, b);
                (out.value, out.gradient[a], out.gradient[b]) = (l.re, l.eps1, l.eps2);
                (out.hessian[a * n + b], out.hessian[b * n + a]) = (l.eps1eps2, l.eps1eps2);
            }
        }
        out
    }
}

/// All measurements of one kind, and what a model can do with them. The first W numbers of a row
/// carry derivatives; the others are the offsets of its `let`s.
#[derive(Debug)]
pub(super) struct Rows {
    pub(super) place: Place,
    /// Share of outlying measurements and the variance of their further error, where these were added to
    /// the model.
    pub(super) outliers: Option<OutlierShare>,
    pub(super) math: Box<dyn RowMath>,
}

impl Rows {
    fn row<'a>(&self, i: usize, numbers: &'a [f64]) -> Row<'a> {
        Row { i, numbers, outliers: self.outliers.unwrap_or_default() }
    }

    /// Adds the log likelihood, and carries its derivatives to the adjoint.
    pub(super) fn backward(&self, t: &mut Tape) {
        self.math.backward(&self.place, self.outliers, t);
    }

    /// The Hessian of each row.
    pub(super) fn curvatures(&self, t: &Tape) -> Vec<LocalHessian> {
        let slots = self.place.slots();
        let one = |i: usize| {
            let numbers = self.place.numbers_at(&t.v, i);
            let row = self.row(i, &numbers);
            LocalHessian::new(self.place.locals(i), |a, b| {
                self.math.second(row, slots[a], slots[b]).eps1eps2
            })
        };
        let counts = |i: &usize| self.place.left_out != Some(*i);
        (0..self.math.len()).filter(counts).map(one).collect()
    }

    /// Log likelihood of each row, after a forward pass.
    pub(super) fn pointwise(&self, t: &Tape, out: &mut Vec<f64>) {
        let one = |i: usize| self.math.ln(self.row(i, &self.place.numbers_at(&t.v, i)));
        out.extend((0..self.math.len()).map(one));
    }

    /// Adds the log likelihood of row `i` at each of these values of its place.
    pub(super) fn add_lns(&self, i: usize, line: Line<'_>, theta: &[f64], out: &mut [f64]) {
        if self.place.left_out != Some(i) {
            self.math.add_lns(self.row(i, line.base), line, theta, out);
        }
    }

    /// A simulated measurement for each row, as cells (see [`Observation::cells`]).
    ///
    /// [`Observation::cells`]: crate::likelihood::Observation::cells
    pub(super) fn simulate(&self, t: &Tape, rng: &mut dyn Rng) -> Vec<Vec<f64>> {
        let one = |i| self.math.simulate(self.row(i, &self.place.numbers_at(&t.v, i)), None, rng);
        (0..self.math.len()).map(one).collect()
    }

    /// The measurements as cells.
    pub(super) fn observed(&self) -> Vec<Vec<f64>> {
        (0..self.math.len()).map(|i| self.math.measured(i)).collect()
    }

    /// The measurement of row `i` as cells.
    pub(super) fn observed_row(&self, i: usize) -> Vec<f64> {
        self.math.measured(i)
    }

    /// Where in `v` the scalars of row `i` live: the value, and the offset added to it if an effect
    /// may act there (`v[0]`, which is zero, if not); then the offsets of its `let`s.
    pub(super) fn locals(&self, i: usize) -> Vec<(usize, usize)> {
        self.place.locals(i)
    }

    /// A row under `noise`.
    fn noisy<'a>(&self, i: usize, numbers: &'a [f64], noise: &Noise) -> Row<'a> {
        Row { i, numbers, outliers: noise.outliers.or(self.outliers).unwrap_or_default() }
    }

    /// Log likelihood of row `i` at these scalars, with the further errors of `noise`, if `cells`
    /// had been measured.
    pub(super) fn ln_at(&self, i: usize, cells: &[f64], locals: &[f64], noise: &Noise) -> f64 {
        let y = Measurement { cells, variance: noise.variance };
        self.math.ln_of(self.noisy(i, &self.place.numbers(locals), noise), y)
    }

    /// As [`Rows::ln_at`], with gradient and Hessian `(n, n)` in the scalars numbered `of`; in the
    /// others they are zero.
    pub(super) fn curvature(
        &self,
        i: usize,
        cells: &[f64],
        locals: &[f64],
        of: &[usize],
        noise: &Noise,
    ) -> Curvature {
        let (slots, numbers) = (self.place.slots(), self.place.numbers(locals));
        let (row, y) =
            (self.noisy(i, &numbers, noise), Measurement { cells, variance: noise.variance });
        Curvature::new(locals.len(), of, |a, b| self.math.second_of(row, y, slots[a], slots[b]))
    }

    /// As [`Rows::curvature`], but in every scalar and, as the last one, in the variance of
    /// `noise`.
    pub(super) fn whole_curvature(
        &self,
        i: usize,
        cells: &[f64],
        locals: &[f64],
        noise: &Noise,
    ) -> Curvature {
        let numbers = self.place.numbers(locals);
        let (row, y) =
            (self.noisy(i, &numbers, noise), Measurement { cells, variance: noise.variance });
        let mut slots = self.place.slots();
        slots.push(numbers.len());
        let all: Vec<usize> = (0..slots.len()).collect();
        Curvature::new(all.len(), &all, |a, b| self.math.second_of(row, y, slots[a], slots[b]))
    }

    /// The gradient of the second derivative of [`Rows::ln_at`] along `direction`, `(n)`. It is in
    /// every scalar and, as the last one, in the variance of `noise`.
    pub(super) fn bend(
        &self,
        i: usize,
        cells: &[f64],
        locals: &[f64],
        direction: &[f64],
        noise: &Noise,
    ) -> Vec<f64> {
        let numbers = self.place.numbers(locals);
        let direction = self.place.numbers(direction);
        let (row, y) =
            (self.noisy(i, &numbers, noise), Measurement { cells, variance: noise.variance });
        let one = |slot| self.math.third_of(row, y, &direction, slot).eps1eps2eps3;
        self.place.slots().into_iter().chain([numbers.len()]).map(one).collect()
    }

    /// A simulated measurement for row `i` at these scalars, as cells, without further errors. It
    /// is made as `cells` were: a bracket has the width of theirs.
    pub(super) fn replicate(
        &self,
        i: usize,
        cells: &[f64],
        locals: &[f64],
        rng: &mut dyn Rng,
    ) -> Vec<f64> {
        self.math.simulate(self.row(i, &self.place.numbers(locals)), Some(cells), rng)
    }

    /// The predicted value of row `i` at these scalars, if the likelihood has one.
    pub(super) fn location(&self, i: usize, locals: &[f64]) -> Option<f64> {
        self.math.location(self.row(i, &self.place.numbers(locals)))
    }

    /// Its derivative in each scalar.
    pub(super) fn location_slopes(&self, i: usize, locals: &[f64]) -> Option<Vec<f64>> {
        let numbers = self.place.numbers(locals);
        let slope = |slot| self.math.location_slope(self.row(i, &numbers), slot);
        self.place.slots().into_iter().map(slope).collect()
    }

    /// First and second derivative of the log likelihood of row `i` in its number `slot`, after a forward pass.
    pub(super) fn derivatives(&self, t: &Tape, i: usize, slot: usize) -> [f64; 2] {
        let numbers = self.place.numbers_at(&t.v, i);
        let ln = self.math.second(self.row(i, &numbers), slot, slot);
        [ln.eps1, ln.eps1eps2]
    }

    /// The first row whose measurement this likelihood cannot take, and why.
    pub(super) fn objection(&self, t: &Tape) -> Option<(usize, &'static str)> {
        let one = |i: usize| {
            let why = self.math.objection(self.row(i, &self.place.numbers_at(&t.v, i)));
            why.map(|why| (i, why))
        };
        (0..self.math.len()).find_map(one)
    }
}
