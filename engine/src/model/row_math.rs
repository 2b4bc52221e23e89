//! The likelihood of an `observe` statement on its rows.

use num_dual::DualNum;
use rand::Rng;

use super::error::ModelError;
use super::map::ReadCell;
use super::row_line::{Line, Slope};
use super::row_place::{ERROR, Place};
use super::tape::Tape;
use crate::likelihood::{Likelihood, NOT_WIDENED, Observation, Outliers};
use crate::num::lanes::LANES;
use crate::num::{Dual, Hyper, Num, Real, Third, derivatives, variable};

/// In how many numbers of a row one pass takes derivatives, where something was added.
const WIDE: usize = 8;

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
    /// Adds the log likelihood of all rows to the density, and its derivatives to the adjoint.
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

/// The likelihood of the rows of an `observe` statement, of numbers of any kind: what a model brings with it.
pub(super) trait RowLikelihood: Send + Sync {
    /// What was measured.
    type Y: Observation;
    /// The numeric columns that the model reads.
    fn columns(&self) -> Vec<(&'static str, Vec<String>)>;
    /// Takes the columns of one more row.
    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError>;
    /// The measurement of the last row, where it is computed from columns.
    fn compute(&self) -> Option<Self::Y>;
    /// How many numbers it depends on: those that carry derivatives, then the offsets of `let`s.
    fn n(&self) -> usize;
    /// Whether a further normal error widens it, where the type of [`Self::at`] does not tell.
    fn widens(&self) -> bool {
        true
    }
    /// The likelihood of row `i` at these numbers.
    fn at<D: Real>(
        &self,
        i: usize,
        number: &dyn Fn(usize) -> Num<D>,
    ) -> impl Likelihood<Num<D>, Self::Y> + use<D, Self>;
    /// See [`RowMath::backward`]; without anything that was added.
    fn backward(&self, y: &[Self::Y], place: &Place, t: &mut Tape);
    /// See [`RowMath::add_lns`]; of row `i`, without anything that was added.
    fn add_lns(&self, i: usize, y: &Self::Y, line: Line<'_>, theta: &[f64], out: &mut [f64]);
}

fn with_outliers<L>(likelihood: L, (share, variance): OutlierShare) -> Outliers<L> {
    Outliers(likelihood, share, variance.sqrt())
}

/// A likelihood with its measurements.
pub(super) struct RowsOf<L: RowLikelihood> {
    of: L,
    y: Vec<L::Y>,
}

impl<L: RowLikelihood> RowsOf<L> {
    /// A likelihood without rows.
    pub(super) fn new(of: L) -> Self {
        Self { of, y: vec![] }
    }

    fn plain(&self, row: Row<'_>) -> Outliers<impl Likelihood<Num<f64>, L::Y> + use<L>> {
        with_outliers(self.of.at(row.i, &|j| Num(row.numbers[j])), row.outliers)
    }

    /// [`RowMath::backward`] with the outliers and the further error that were added, in one pass over the rows. It has the
    /// derivatives in the numbers `own` of a row. They are those from `first` on of [`Place::slots`]: the density is
    /// added in the first pass alone.
    fn backward_with_added(
        &self,
        place: &Place,
        outliers: OutlierShare,
        own: &[usize],
        first: usize,
        t: &mut Tape,
    ) {
        let n = self.y.len();
        for top in (0..n).step_by(LANES) {
            let rows: [_; LANES] = std::array::from_fn(|lane| {
                let i = (top + lane).min(n - 1); // the last fills up
                let number = |j: usize| {
                    let x = place.number(&t.v, i, j);
                    let k = own.iter().position(|slot| *slot == j);
                    Num(k.map_or(Dual::<WIDE>::from(x), |k| variable(x, k)))
                };
                let [sd, ln] = [0, 1].map(|k| number(place.error_slot() + k));
                let sd = sd * ln.exp();
                (with_outliers(self.of.at(i, &number), outliers), &self.y[i], sd * sd)
            });
            let values = if place.error.is_some() {
                Likelihood::ln_widened_rows(rows)
            } else {
                Likelihood::ln_likelihoods(rows.map(|(likelihood, y, _)| (likelihood, y)))
            };
            for (i, value) in (top..n).zip(values) {
                if place.left_out == Some(i) {
                    continue;
                }
                if first == 0 {
                    t.lp += value.0.re;
                }
                for (slot, slope) in own.iter().zip(derivatives(&value.0)) {
                    place.add_slope(&mut t.g, i, *slot, slope);
                }
            }
        }
    }

    /// The sd of the further error of a row.
    fn further_sd(&self, row: Row<'_>) -> f64 {
        let n = self.of.n();
        row.numbers[n] * row.numbers[n + 1].exp()
    }

    /// Its variance.
    fn further(&self, row: Row<'_>) -> f64 {
        self.further_sd(row).powi(2)
    }

    /// As [`Self::further`], with derivatives in the numbers `a` and `b`.
    fn further_hyper(&self, row: Row<'_>, a: usize, b: usize) -> Num<Hyper> {
        let n = self.of.n();
        let [sd, ln] = [n, n + 1].map(|j| Num(hyper(row.numbers[j], j, a, b)));
        let sd = sd * ln.exp();
        sd * sd
    }

    fn hyper(
        &self,
        row: Row<'_>,
        a: usize,
        b: usize,
    ) -> Outliers<impl Likelihood<Num<Hyper>, L::Y> + use<L>> {
        with_outliers(self.of.at(row.i, &|j| Num(hyper(row.numbers[j], j, a, b))), row.outliers)
    }

    /// A measurement of row `i` from its cells, or the row's own if these hold none.
    fn measurement(&self, i: usize, cells: &[f64]) -> L::Y {
        L::Y::read(cells).ok().flatten().unwrap_or(self.y[i])
    }
}

/// Number `j`, with derivatives if it is `a` or `b`.
fn hyper(x: f64, j: usize, a: usize, b: usize) -> Hyper {
    let is = |a: usize| f64::from(u8::from(a == j));
    Hyper::new(x, is(a), is(b), 0.0)
}

impl<L: RowLikelihood> RowMath for RowsOf<L> {
    fn columns(&self) -> Vec<(&'static str, Vec<String>)> {
        self.of.columns()
    }

    fn cells(&self) -> &'static [&'static str] {
        L::Y::COLUMNS
    }

    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError> {
        self.of.read(cell)
    }

    fn take(&mut self, cells: &[f64]) -> Result<bool, String> {
        let y = L::Y::read(cells)?;
        self.y.extend(y);
        Ok(y.is_some())
    }

    fn compute(&mut self) -> Option<Vec<f64>> {
        let y = self.of.compute()?;
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
        if outliers.is_none() && !place.has_added() {
            self.of.backward(&self.y, place, t);
            return;
        }
        let (slots, outliers) = (place.slots(), outliers.unwrap_or_default());
        for (k, own) in slots.chunks(WIDE).enumerate() {
            self.backward_with_added(place, outliers, own, k * WIDE, t);
        }
    }

    fn ln(&self, row: Row<'_>) -> f64 {
        let (likelihood, y) = (self.plain(row), &self.y[row.i]);
        match self.further(row) {
            0.0 => likelihood.ln_likelihood(y).0,
            variance => likelihood.ln_widened(y, Num(variance)).0,
        }
    }

    fn add_lns(&self, row: Row<'_>, line: Line<'_>, theta: &[f64], out: &mut [f64]) {
        let is_plain = row.outliers.0 == 0.0 && self.further_sd(row) == 0.0;
        if is_plain && line.slopes.iter().all(|slope| slope.number < self.of.n()) {
            self.of.add_lns(row.i, &self.y[row.i], line, theta, out);
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
        if self.further(row) == 0.0 {
            return likelihood.ln_likelihood(y).0;
        }
        likelihood.ln_widened(y, self.further_hyper(row, a, b)).0
    }

    fn ln_of(&self, row: Row<'_>, y: Measurement<'_>) -> f64 {
        let measured = self.measurement(row.i, y.cells);
        self.plain(row).ln_widened(&measured, Num(y.variance + self.further(row))).0
    }

    fn second_of(&self, row: Row<'_>, y: Measurement<'_>, a: usize, b: usize) -> Hyper {
        let measured = self.measurement(row.i, y.cells);
        let variance =
            self.further_hyper(row, a, b) + Num(hyper(y.variance, self.of.n() + ERROR, a, b));
        self.hyper(row, a, b).ln_widened(&measured, variance).0
    }

    fn third_of(&self, row: Row<'_>, y: Measurement<'_>, direction: &[f64], a: usize) -> Third {
        let measured = self.measurement(row.i, y.cells);
        let number = |j: usize, x: f64, along: f64| {
            let own = f64::from(u8::from(j == a));
            Num(Third::new(x, along, along, own, 0.0, 0.0, 0.0, 0.0))
        };
        let of_row = |j: usize| number(j, row.numbers[j], direction[j]);
        let [sd, ln] = [self.of.n(), self.of.n() + 1].map(of_row);
        let sd = sd * ln.exp();
        let variance = sd * sd + number(self.of.n() + ERROR, y.variance, 0.0);
        with_outliers(self.of.at(row.i, &of_row), row.outliers).ln_widened(&measured, variance).0
    }

    fn simulate(&self, row: Row<'_>, like: Option<&[f64]>, rng: &mut dyn Rng) -> Vec<f64> {
        let like = like.map_or(self.y[row.i], |cells| self.measurement(row.i, cells));
        let likelihood = self.plain(row);
        match self.further_sd(row) {
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
        if row.outliers.0 > 0.0 && !self.of.widens() {
            return Some(NOT_WIDENED);
        }
        self.plain(row).objection(&self.y[row.i])
    }
}
