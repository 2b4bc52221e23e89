//! What an interpreted model says of its rows: likelihoods, `let`s, operands and predictors.

use std::marker::PhantomData;
use std::sync::Arc;

use num_dual::DualStruct as _;
use pulp::{Arch, NullaryFnOnce};

use super::functions::each;
use super::likelihoods::{Kind, Written};
use super::program::{Numbers, Program, Registers, Value};
use crate::likelihood::Likelihood;
use crate::model::error::ModelError;
use crate::model::everywhere::{PlaceFn, Where};
use crate::model::map::{MapFn, ReadCell};
use crate::model::row_line::{Line, Slope};
use crate::model::row_math::RowLikelihood;
use crate::model::row_place::Place;
use crate::model::tape::Tape;
use crate::num::lanes::LANES;
use crate::num::{Dual, Num, Real, derivatives, dual, variable};

/// The numeric columns that a model reads: each one's name, and the table's columns behind it.
pub(super) type Columns = Vec<(&'static str, Vec<String>)>;

/// The cells of a row, of these columns alone; others are NaN.
fn cells_of(
    columns: &Columns,
    is_read: impl Fn(&str) -> bool,
    cell: ReadCell<'_>,
) -> Result<Vec<f64>, ModelError> {
    let mut cells = vec![];
    for (name, own) in columns {
        for column in own {
            cells.push(if is_read(name) { cell(column)? } else { f64::NAN });
        }
    }
    Ok(cells)
}

/// An expression of a row.
#[derive(Clone, Debug)]
pub(super) struct RowValue {
    pub(super) program: Program,
    pub(super) value: Value,
    pub(super) columns: Arc<Columns>,
}

impl RowValue {
    fn at<T: Real>(&self, number: &dyn Fn(usize) -> Num<T>, plain: &[f64]) -> Num<T> {
        self.program.value(self.value, number, plain)
    }

    /// What only its columns decide, in the row of this cell.
    fn plain(&self, cell: ReadCell<'_>) -> Result<Vec<f64>, ModelError> {
        Ok(self.program.plain(&cells_of(&self.columns, |_| true, cell)?))
    }

    fn nowhere(&self) -> Vec<f64> {
        let n = self.columns.iter().map(|(_, own)| own.len()).sum();
        self.program.plain(&vec![f64::NAN; n])
    }

    /// The constant of a predictor in a row, and its factor of each parameter.
    pub(super) fn factors(&self, cell: ReadCell<'_>) -> Result<(f64, Vec<f64>), ModelError> {
        let plain = self.plain(cell)?;
        let along = |j: usize| -> Dual<1> {
            self.at(&|i| Num(dual(0.0, [f64::from(u8::from(i == j))])), &plain).0
        };
        let n = self.program.n;
        Ok((along(n).re, (0..n).map(|j| derivatives(&along(j))[0]).collect()))
    }
}

/// A `let`.
pub(super) struct LetOf {
    of: Arc<RowValue>,
    nowhere: Vec<f64>,
    rows: Vec<Vec<f64>>,
}

impl LetOf {
    pub(super) fn new(of: Arc<RowValue>) -> Self {
        Self { nowhere: of.nowhere(), of, rows: vec![] }
    }
}

impl MapFn for LetOf {
    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError> {
        self.rows.push(self.of.plain(cell)?);
        Ok(())
    }

    fn value(&self, s: &[f64], row: Option<usize>) -> f64 {
        self.of.at(&|i| Num(s[i]), row.map_or(&self.nowhere, |row| &self.rows[row])).0
    }
}

/// How many derivatives one pass carries.
macro_rules! by_width {
    ($width:expr, $of:ident.$f:ident($($argument:expr),*)) => {
        match $width {
            0..=2 => $of.$f::<2>($($argument),*),
            _ => $of.$f::<8>($($argument),*),
        }
    };
}

/// An operand of an operator over the whole surface.
pub(super) struct OperandOf {
    of: Arc<RowValue>,
    plain: Vec<f64>,
}

impl OperandOf {
    pub(super) fn new(of: Arc<RowValue>) -> Self {
        Self { plain: of.nowhere(), of }
    }

    fn values_by<const W: usize>(
        &self,
        v: &[f64],
        from: &[Where],
        out: &mut [f64],
        slopes: &mut [f64],
    ) {
        let w = from.len();
        for (vertex, out) in out.iter_mut().enumerate() {
            let mut first = 0;
            loop {
                let number = |i: usize| match from.get(i) {
                    Some(from) => Num(chosen::<W>(v[from.at(vertex)], i, first)),
                    None => Num(Dual::from_re(0.0)),
                };
                let value = self.of.at(&number, &self.plain).0;
                *out = value.re;
                let own = &mut slopes[vertex * w..][..w][first..];
                own.iter_mut().zip(derivatives(&value)).for_each(|(slope, own)| *slope = own);
                first += W;
                if first >= w {
                    break;
                }
            }
        }
    }
}

impl PlaceFn for OperandOf {
    fn read(&mut self, columns: &[&str], cell: ReadCell<'_>) -> Result<(), ModelError> {
        let cells = cells_of(&self.of.columns, |name| columns.contains(&name), cell)?;
        self.plain = self.of.program.plain(&cells);
        Ok(())
    }

    fn values(&self, v: &[f64], from: &[Where], out: &mut [f64], slopes: &mut [f64]) {
        by_width!(from.len(), self.values_by(v, from, out, slopes));
    }
}

/// Number `i`, with a derivative if it is one of the W from `first` on.
#[inline(always)]
fn chosen<const W: usize>(x: f64, i: usize, first: usize) -> Dual<W> {
    if (first..first + W).contains(&i) { variable(x, i - first) } else { Dual::from_re(x) }
}

/// A likelihood on its rows.
pub(super) struct LikelihoodOf<Y> {
    pub(super) program: Program,
    pub(super) written: Written,
    /// How many numbers carry derivatives.
    pub(super) width: usize,
    /// A measurement that is computed from columns.
    pub(super) computed: Option<u32>,
    pub(super) columns: Arc<Columns>,
    /// What only columns decide, of each row.
    pub(super) rows: Vec<Vec<f64>>,
    pub(super) y: PhantomData<Y>,
}

impl<Y: Kind> LikelihoodOf<Y> {
    /// Number `j` of row `i`.
    #[inline(always)]
    fn number(&self, place: &Place, v: &[f64], i: usize, j: usize) -> f64 {
        let w = self.width;
        if j >= w {
            return place.lets[j - w].map_or(0.0, |at| v[at + i]);
        }
        let x = v[place.index[i * w + j] as usize];
        if place.hook.is_empty() { x } else { x + v[place.hook[i * w + j] as usize] }
    }

    /// Number `j` of row `i`, with one of the W derivatives from number `first` on.
    #[inline(always)]
    fn dual<const W: usize>(
        &self,
        place: &Place,
        v: &[f64],
        (i, j): (usize, usize),
        first: usize,
    ) -> Num<Dual<W>> {
        let x = self.number(place, v, i, j);
        Num(if j < self.width { chosen(x, j, first) } else { Dual::from_re(x) })
    }

    /// Log likelihoods of several rows.
    #[inline(always)]
    fn ln_likelihoods<T: Real>(
        &self,
        i: [usize; LANES],
        y: [&Y; LANES],
        number: impl Fn(usize, usize) -> Num<T>,
    ) -> [Num<T>; LANES] {
        let mut numbers = Registers::<T, LANES>::new();
        let mut plain: [&[f64]; LANES] = [&[]; LANES];
        for lane in 0..LANES {
            plain[lane] = &self.rows[i[lane]];
        }
        for j in 0..self.program.n {
            numbers.push(each(|lane| number(j, lane)));
        }
        self.program.run(plain, &mut numbers);
        self.written.ln_likelihoods(Numbers { numbers: &numbers, plain }, y)
    }

    #[inline(always)]
    fn backward_by<const W: usize>(&self, y: &[Y], place: &Place, t: &mut Tape) {
        let n = y.len();
        for first in (0..self.width.max(1)).step_by(W) {
            for top in (0..n).step_by(LANES) {
                let (mut i, mut own) = ([0; LANES], [&y[top]; LANES]);
                for lane in 0..LANES {
                    i[lane] = (top + lane).min(n - 1); // the last fills up
                    own[lane] = &y[i[lane]];
                }
                let number =
                    |j: usize, lane: usize| self.dual::<W>(place, &t.v, (i[lane], j), first);
                let values = self.ln_likelihoods(i, own, number);
                for (i, value) in (top..n).zip(values) {
                    self.scatter(place, i, first, &value.0, t);
                }
            }
        }
    }

    /// Adds row `i`'s log likelihood to the density, and its derivatives from number `first` on to the adjoint.
    #[inline(always)]
    fn scatter<const W: usize>(
        &self,
        place: &Place,
        i: usize,
        first: usize,
        value: &Dual<W>,
        t: &mut Tape,
    ) {
        if place.left_out == Some(i) {
            return;
        }
        if first == 0 {
            t.lp += value.re();
        }
        let e = &derivatives(value);
        let own = (i * self.width + first)..(i + 1) * self.width;
        for (at, e) in place.index[own.clone()].iter().zip(e) {
            t.g[*at as usize] += e;
        }
        if !place.hook.is_empty() {
            for (at, e) in place.hook[own].iter().zip(e) {
                t.g[*at as usize] += e;
            }
        }
    }
}

impl<Y: Kind> RowLikelihood for LikelihoodOf<Y> {
    type Y = Y;

    fn columns(&self) -> Columns {
        (*self.columns).clone()
    }

    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError> {
        let cells = cells_of(&self.columns, |_| true, cell)?;
        self.rows.push(self.program.plain(&cells));
        Ok(())
    }

    fn compute(&self) -> Option<Y> {
        Y::computed(self.rows.last()?[self.computed? as usize])
    }

    fn n(&self) -> usize {
        self.program.n
    }

    fn widens(&self) -> bool {
        self.written.widens()
    }

    fn at<D: Real>(
        &self,
        i: usize,
        number: &dyn Fn(usize) -> Num<D>,
    ) -> impl Likelihood<Num<D>, Y> + use<D, Y> {
        let (mut numbers, plain) = (Registers::<D, 1>::new(), [&*self.rows[i]]);
        numbers.extend((0..self.program.n).map(|j| [number(j)]));
        self.program.run(plain, &mut numbers);
        self.written.at::<Y, D, 1>(Numbers { numbers: &numbers, plain }, 0)
    }

    fn backward(&self, y: &[Y], place: &Place, t: &mut Tape) {
        Arch::new().dispatch(Backward { rows: self, y, place, t });
    }

    fn add_lns(&self, i: usize, y: &Y, line: Line<'_>, theta: &[f64], out: &mut [f64]) {
        Arch::new().dispatch(AddLns { rows: self, i, y, line, theta, out });
    }
}

struct Backward<'a, Y> {
    rows: &'a LikelihoodOf<Y>,
    y: &'a [Y],
    place: &'a Place,
    t: &'a mut Tape,
}

impl<Y: Kind> NullaryFnOnce for Backward<'_, Y> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { rows, y, place, t } = self;
        by_width!(rows.width, rows.backward_by(y, place, t));
    }
}

/// Log likelihoods of one row at many latent values.
struct AddLns<'a, Y> {
    rows: &'a LikelihoodOf<Y>,
    i: usize,
    y: &'a Y,
    line: Line<'a>,
    theta: &'a [f64],
    out: &'a mut [f64],
}

impl<Y: Kind> NullaryFnOnce for AddLns<'_, Y> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { rows, i, y, line, theta, out } = self;
        let n = out.len();
        for top in (0..n).step_by(LANES) {
            let number = |j: usize, lane: usize| {
                let theta = &theta[(top + lane).min(n - 1) * line.n_blocks..]; // the last fills up
                let own = line.slopes.iter().filter(|slope| slope.number == j);
                Num(own.fold(line.base[j], |x, Slope { block, per_unit, .. }| {
                    x + per_unit * theta[*block]
                }))
            };
            let values = rows.ln_likelihoods([i; LANES], [y; LANES], number);
            for (out, value) in out[top..].iter_mut().zip(values) {
                *out += value.0;
            }
        }
    }
}
