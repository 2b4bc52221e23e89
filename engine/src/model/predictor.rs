//! Linear predictors that a model file writes out, `a + b * row.dose`: what their factors are, and their values
//! in all rows at once.
//!
//! ```text
//! valueᵢ = constantᵢ + Σⱼ factorᵢⱼ parameterⱼ
//! ```
//! Constants and factors depend on the columns of row i alone, so they are computed once, when the
//! model is laid out on its data. The derivative of such an expression in a parameter is its factor.

use pulp::{Arch, NullaryFnOnce};

use super::error::ModelError;
use super::functions::{Columns, LetFn};
use super::map::ReadCell;
use super::tape::{Op, Second, Tape, add_rows};
use crate::num::vector::dot;
use crate::num::{Dual, Num, derivatives, dual};

/// Reads one row's columns, and gives the constant of a predictor there and its factor of each parameter.
pub(super) type Factors = dyn Fn(ReadCell<'_>) -> Result<(f64, Vec<f64>), ModelError>;

/// The [`Factors`] of the predictor F of N numbers.
pub(super) fn factors<F: LetFn<N>, const N: usize>(
    cell: ReadCell<'_>,
) -> Result<(f64, Vec<f64>), ModelError> {
    let row = F::Columns::read(cell)?;
    let along = |j: usize| -> Dual<1> {
        let unit = |i: usize| f64::from(u8::from(i == j));
        F::value(std::array::from_fn(|i| Num(dual(0.0, [unit(i)]))), &row).0
    };
    Ok((along(N).re, (0..N).map(|j| derivatives(&along(j))[0]).collect()))
}

/// A predictor in all rows of an `observe`.
#[derive(Debug)]
pub(super) struct Predictor {
    /// Where in `v` each parameter lives.
    from: Vec<u32>,
    /// Where copies of these lie side by side.
    copies: usize,
    /// (parameters, rows)
    factors: Vec<f64>,
    /// (rows)
    constants: Vec<f64>,
    /// First of its values, after all that they depend on.
    out: usize,
}

impl Predictor {
    /// The predictor of the parameters that live at `from`, with the constant and the factors of
    /// each row. Its values begin at `out`, behind as many places for copies as it has parameters.
    pub(super) fn new(from: Vec<u32>, rows: &[(f64, Vec<f64>)], out: usize) -> Self {
        let n = from.len();
        let factors = (0..n).flat_map(|j| rows.iter().map(move |(_, factors)| factors[j]));
        let constants = rows.iter().map(|(constant, _)| *constant).collect();
        Self { factors: factors.collect(), constants, copies: out - n, from, out }
    }

    /// Adds the sum over the parameters to its values.
    fn add(&self, v: &mut [f64]) {
        for (i, at) in self.from.iter().enumerate() {
            v[self.copies + i] = v[*at as usize];
        }
        let (before, values) = v.split_at_mut(self.out);
        let parameters = &before[self.copies..][..self.from.len()];
        add_rows(parameters, &self.factors, &mut values[..self.constants.len()]);
    }
}

impl Op for Predictor {
    fn forward(&self, t: &mut Tape) {
        t.v[self.out..][..self.constants.len()].copy_from_slice(&self.constants);
        self.add(&mut t.v);
    }

    fn backward(&self, t: &mut Tape) {
        Arch::new().dispatch(Backward(self, &mut t.g));
    }
}

impl Second for Predictor {
    fn push(&self, _: &Tape, d: &mut Tape) {
        d.v[self.out..][..self.constants.len()].fill(0.0);
        self.add(&mut d.v);
    }

    fn pull(&self, _: &Tape, d: &mut Tape) {
        self.backward(d);
    }
}

struct Backward<'a>(&'a Predictor, &'a mut [f64]);

impl NullaryFnOnce for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(of, g) = self;
        let (before, bars) = g.split_at_mut(of.out);
        let n = of.constants.len();
        for (at, factors) in of.from.iter().zip(of.factors.chunks_exact(n.max(1))) {
            before[*at as usize] += dot::<8>(factors, &bars[..n]);
        }
    }
}
