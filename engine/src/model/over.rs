//! An operator over the whole surface as a step of the model.
//!
//! ```text
//! unknowns → fields at every vertex → operands there → the operator's numbers at rows
//! ```
//! The operator and its derivatives are in [`operator`](super::operator); this file carries values and adjoints between
//! it and the tape.

use std::ops::Range;
use std::sync::Arc;

use super::everywhere::{PlaceFn, Where, pull, push};
use super::operator::{Kept, Operator};
use super::tape::{Op, Second, Tape};
use crate::mesh::Places;

/// An operand: an expression, and where its numbers live.
#[derive(Debug)]
pub(super) struct Operand {
    pub(super) from: Vec<Where>,
    pub(super) math: Box<dyn PlaceFn>,
}

/// An operator with its operands, at rows.
#[derive(Debug)]
pub(super) struct Over {
    pub(super) operator: Box<dyn Operator>,
    pub(super) operands: Vec<Operand>,
    /// Number of vertices of the triangulation.
    pub(super) n: usize,
    /// Where the surface's vertices are on the triangulation; `None` if they are the same.
    pub(super) places: Option<Arc<Places>>,
    /// The place of each of its numbers in `v`.
    pub(super) rows: Vec<usize>,
    /// What its maps are called.
    pub(super) names: Vec<String>,
    pub(super) unit: String,
    /// Its part of `work`: the operands at every vertex and their slopes, then, as scratch memory, the operands'
    /// adjoints.
    pub(super) work: usize,
    /// What is kept of it on the tape.
    pub(super) kept: usize,
}

impl Over {
    fn n_operands(&self) -> usize {
        self.operands.len() * self.n
    }

    /// How many numbers of `work` it needs.
    pub(super) fn n_work(&self) -> usize {
        self.n_left() + self.n_operands()
    }

    /// How many of them a forward pass leaves.
    fn n_left(&self) -> usize {
        self.n_operands() + self.slopes(self.operands.len()).start
    }

    /// Where the slopes of operand `i` are among those of all.
    fn slopes(&self, i: usize) -> Range<usize> {
        let n = |of: &Operand| self.n * of.from.len();
        let start = self.operands[..i].iter().map(n).sum();
        start..start + self.operands.get(i).map_or(0, n)
    }

    /// What a forward pass has left: the operands, and their slopes.
    fn left<'a>(&self, work: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        work[self.work..][..self.n_left()].split_at(self.n_operands())
    }

    /// Each operand of those that lie in `values` one after the other.
    fn split<'a>(&self, values: &'a [f64]) -> Vec<&'a [f64]> {
        values.chunks_exact(self.n).collect()
    }

    /// Carries adjoints of its numbers, in `g`, to what the operands depend on, in `g` too.
    fn carry_back(
        &self,
        (values, slopes): (&[f64], &[f64]),
        kept: &Kept,
        bars: &mut [f64],
        g: &mut [f64],
    ) {
        bars.fill(0.0);
        let of_rows: Vec<f64> = self.rows.iter().map(|at| g[*at]).collect();
        let mut into: Vec<&mut [f64]> = bars.chunks_exact_mut(self.n).collect();
        self.operator.pull(&self.split(values), kept, &of_rows, &mut into);
        for (i, (operand, bars)) in self.operands.iter().zip(into).enumerate() {
            pull(&slopes[self.slopes(i)], &operand.from, bars, g);
        }
    }
}

impl Op for Over {
    fn forward(&self, t: &mut Tape) {
        let (values, slopes) = t.work[self.work..][..self.n_left()].split_at_mut(self.n_operands());
        for (i, (operand, out)) in
            self.operands.iter().zip(values.chunks_exact_mut(self.n)).enumerate()
        {
            operand.math.values(&t.v, &operand.from, out, &mut slopes[self.slopes(i)]);
        }
        let mut out = vec![0.0; self.rows.len()];
        self.operator.forward(&self.split(values), &mut t.kept[self.kept], &mut out);
        for (at, x) in self.rows.iter().zip(out) {
            t.v[*at] = x;
        }
    }

    fn backward(&self, t: &mut Tape) {
        let own = &mut t.work[self.work..][..self.n_work()];
        let (left, bars) = own.split_at_mut(self.n_left());
        let left = left.split_at(self.n_operands());
        self.carry_back(left, &t.kept[self.kept], bars, &mut t.g);
    }

    fn ln_density(&self, _: &mut Tape) {}
}

/// As exact as what the operator says of its changes.
impl Second for Over {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let (values, slopes) = self.left(&t.work);
        let changes = &mut d.work[self.work..][..self.n_operands()];
        for (i, (operand, out)) in
            self.operands.iter().zip(changes.chunks_exact_mut(self.n)).enumerate()
        {
            push(&slopes[self.slopes(i)], &operand.from, &d.v, out);
        }
        let mut out = vec![0.0; self.rows.len()];
        let kept = &t.kept[self.kept];
        self.operator.push(&self.split(values), kept, &self.split(changes), &mut out);
        for (at, x) in self.rows.iter().zip(out) {
            d.v[*at] = x;
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let bars = &mut d.work[self.work + self.n_left()..][..self.n_operands()];
        self.carry_back(self.left(&t.work), &t.kept[self.kept], bars, &mut d.g);
    }
}
