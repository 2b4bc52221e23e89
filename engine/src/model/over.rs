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
use super::operator::{Adjoints, Memo, Off, Operands, Operator};
use super::tape::{Op, Second, Tape};
use crate::mesh::Places;
use crate::table::ProbeError;

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
    /// The place in `v` of each single number that it depends on.
    pub(super) numbers: Vec<usize>,
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

    /// Its maps that have a name.
    pub(super) fn maps(&self, kept: &Memo) -> Vec<Vec<f64>> {
        self.operator.maps(kept).into_iter().take(self.names.len()).collect()
    }

    /// See [`Operator::activations`].
    pub(super) fn activations(&self) -> Vec<Vec<usize>> {
        self.operator.activations()
    }

    /// See [`Operator::started_at`], with the operands of the last forward pass.
    pub(super) fn started_at(&self, t: &Tape, vertex: u32) -> Vec<f64> {
        let (values, _) = self.left(&t.work);
        self.operator.started_at(&self.operands(values, &t.v), vertex)
    }

    /// See [`Operator::off`], with the operands of the last forward pass.
    pub(super) fn off(&self, t: &Tape) -> Result<Option<Off>, ProbeError> {
        let (values, _) = self.left(&t.work);
        self.operator.off(&self.operands(values, &t.v), &t.kept[self.kept])
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

    /// What it depends on: expressions, which lie in `values` one after the other, and numbers of `v`.
    fn operands<'a>(&self, values: &'a [f64], v: &[f64]) -> Operands<'a> {
        let numbers = self.numbers.iter().map(|at| v[*at]).collect();
        Operands { everywhere: values.chunks_exact(self.n).collect(), numbers }
    }

    /// Carries adjoints of its numbers, in `g`, to what the operands depend on, in `g` too.
    fn carry_back(
        &self,
        of: &Operands<'_>,
        (slopes, kept): (&[f64], &Memo),
        bars: &mut [f64],
        g: &mut [f64],
    ) {
        bars.fill(0.0);
        let of_rows: Vec<f64> = self.rows.iter().map(|at| g[*at]).collect();
        let everywhere = bars.chunks_exact_mut(self.n).collect();
        let mut into = Adjoints { everywhere, numbers: vec![0.0; self.numbers.len()] };
        self.operator.pull(of, kept, &of_rows, &mut into);
        for (i, (operand, bars)) in self.operands.iter().zip(into.everywhere).enumerate() {
            pull(&slopes[self.slopes(i)], &operand.from, bars, g);
        }
        for (at, bar) in self.numbers.iter().zip(into.numbers) {
            g[*at] += bar;
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
        let of = self.operands(values, &t.v);
        self.operator.forward(&of, &mut t.kept[self.kept], &mut out);
        for (at, x) in self.rows.iter().zip(out) {
            t.v[*at] = x;
        }
    }

    fn backward(&self, t: &mut Tape) {
        let own = &mut t.work[self.work..][..self.n_work()];
        let (left, bars) = own.split_at_mut(self.n_left());
        let (values, slopes) = left.split_at(self.n_operands());
        let of = self.operands(values, &t.v);
        self.carry_back(&of, (slopes, &t.kept[self.kept]), bars, &mut t.g);
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
        let (of, changes) = (self.operands(values, &t.v), self.operands(changes, &d.v));
        self.operator.push(&of, kept, &changes, &mut out);
        for (at, x) in self.rows.iter().zip(out) {
            d.v[*at] = x;
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let bars = &mut d.work[self.work + self.n_left()..][..self.n_operands()];
        let (values, slopes) = self.left(&t.work);
        let of = self.operands(values, &t.v);
        self.carry_back(&of, (slopes, &t.kept[self.kept]), bars, &mut d.g);
    }
}
