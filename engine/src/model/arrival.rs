//! Arrival times over the whole surface, as an operation: `eikonal(SLOWNESS, RATIO, ANGLE, THICKNESS; row.source)`.
//!
//! ```text
//! unknowns → fields at every vertex → slowness, ratio, angle, thickness there → arrival at the rows' vertices
//! ```
//! The solver and its adjoint are in [`Eikonal`]; this file carries values and adjoints between it and
//! the tape.

use std::ops::Range;
use std::sync::Arc;

use super::everywhere::{PlaceFn, Where, pull, push};
use super::tape::{Op, Second, Tape};
use crate::manifold::{Eikonal, Front, Medium, MediumBar};
use crate::mesh::Places;

/// Slowness, ratio, angle and thickness: what the tissue is like at a place.
pub(super) const OPERANDS: usize = 4;

/// One of them: an expression, and where its numbers live.
#[derive(Debug)]
pub(super) struct Operand {
    pub(super) from: Vec<Where>,
    pub(super) math: Box<dyn PlaceFn>,
}

/// A row: its vertex, and the place of its arrival in `v`.
pub(super) type At = (u32, usize);

/// What a slowness (ms/mm) and a ratio may be. Beyond, nothing arrives.
const LIMITS: Range<f64> = 1e-6..1e6;
/// What a thickness may be, ms.
const THICKNESSES: Range<f64> = 0.0..1e3;

/// Arrival times at rows.
#[derive(Debug)]
pub(super) struct Arrival {
    pub(super) solver: Arc<Eikonal>,
    /// Where the surface's vertices are on the solver's triangulation; `None` if they are the same.
    pub(super) places: Option<Arc<Places>>,
    pub(super) operands: [Option<Operand>; OPERANDS],
    /// Every vertex at which activation starts, with the rows whose source it is.
    pub(super) sources: Vec<(u32, Vec<At>)>,
    /// What the map of each source's arrivals is called.
    pub(super) names: Vec<String>,
    pub(super) unit: String,
    /// Its part of `work`: the operands at every vertex and their slopes, then, as scratch memory, the operands'
    /// adjoints and the adjoint of one map of arrivals.
    pub(super) work: usize,
    /// The first of its fronts on the tape: one for each source.
    pub(super) front: usize,
}

impl Arrival {
    fn n(&self) -> usize {
        self.solver.n_vertices()
    }

    /// How many numbers of `work` it needs.
    pub(super) fn n_work(&self) -> usize {
        self.n_kept() + (OPERANDS + 1) * self.n()
    }

    /// How many of them a forward pass leaves.
    fn n_kept(&self) -> usize {
        OPERANDS * self.n() + self.slopes(OPERANDS).start
    }

    /// Where the slopes of operand `i` are among those of all.
    fn slopes(&self, i: usize) -> Range<usize> {
        let n = |of: &Option<Operand>| of.as_ref().map_or(0, |of| self.n() * of.from.len());
        let start = self.operands[..i].iter().map(n).sum();
        start..start + self.operands.get(i).map_or(0, n)
    }

    /// What a forward pass has left: the operands, and their slopes.
    fn kept<'a>(&self, work: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        work[self.work..][..self.n_kept()].split_at(OPERANDS * self.n())
    }

    /// The operands that are written, with their number.
    fn written(&self) -> impl Iterator<Item = (usize, &Operand)> {
        self.operands.iter().enumerate().filter_map(|(i, of)| of.as_ref().map(|of| (i, of)))
    }

    /// The operands, which lie in `values` one after the other.
    fn medium<'a>(&self, values: &'a [f64]) -> Medium<'a> {
        let n = self.n();
        let of = |i: usize| self.operands[i].as_ref().map(|_| &values[i * n..(i + 1) * n]);
        Medium { slowness: &values[..n], ratio: of(1), angle: of(2), thickness: of(3) }
    }

    /// Sources with their fronts, of those from which activation arrived.
    fn arrived<'a>(
        &'a self,
        fronts: &'a [Front],
    ) -> impl Iterator<Item = (&'a (u32, Vec<At>), &'a Front)> {
        self.sources.iter().zip(fronts).filter(|(_, front)| !front.arrival.is_empty())
    }

    /// Whether the solver can have this medium: velocities are numbers, and not out of all reason.
    fn is_tissue(medium: &Medium<'_>) -> bool {
        let all = |of: Option<&[f64]>, range: &Range<f64>| {
            of.is_none_or(|x| x.iter().all(|x| range.contains(x)))
        };
        all(Some(medium.slowness), &LIMITS)
            && all(medium.ratio, &LIMITS)
            && all(medium.thickness, &THICKNESSES)
            && medium.angle.is_none_or(|angle| angle.iter().all(|x| x.is_finite()))
    }

    /// Carries adjoints of the arrivals at the rows, in `g`, to what the operands depend on, in `g` too. What is `kept`
    /// and the `fronts` are from a forward pass.
    fn carry_back(
        &self,
        (values, slopes): (&[f64], &[f64]),
        fronts: &[Front],
        scratch: &mut [f64],
        g: &mut [f64],
    ) {
        let n = self.n();
        let medium = self.medium(values);
        let (bars, bar) = scratch.split_at_mut(OPERANDS * n);
        bars.fill(0.0);
        for ((_, rows), front) in self.arrived(fronts) {
            bar.fill(0.0);
            for (vertex, at) in rows {
                bar[*vertex as usize] += g[*at];
            }
            let [slowness, ratio, angle, thickness] = split(bars, n);
            let mut into = MediumBar {
                slowness,
                ratio: self.operands[1].as_ref().map(|_| ratio),
                angle: self.operands[2].as_ref().map(|_| angle),
                thickness: self.operands[3].as_ref().map(|_| thickness),
                onsets: &mut [0.0],
            };
            self.solver.backward(&medium, front, bar, &mut into);
        }
        for (i, operand) in self.written() {
            pull(&slopes[self.slopes(i)], &operand.from, &bars[i * n..(i + 1) * n], g);
        }
    }
}

/// Pieces of `n` numbers.
fn split(mut all: &mut [f64], n: usize) -> [&mut [f64]; OPERANDS] {
    [(); OPERANDS].map(|()| {
        let (own, rest) = std::mem::take(&mut all).split_at_mut(n);
        all = rest;
        own
    })
}

impl Op for Arrival {
    fn forward(&self, t: &mut Tape) {
        let n = self.n();
        let (values, slopes) = t.work[self.work..][..self.n_kept()].split_at_mut(OPERANDS * n);
        for (i, operand) in self.written() {
            let (out, slopes) = (&mut values[i * n..(i + 1) * n], &mut slopes[self.slopes(i)]);
            operand.math.values(&t.v, &operand.from, out, slopes);
        }
        let medium = self.medium(values);
        let fronts = t.fronts[self.front..].iter_mut();
        let is_tissue = Self::is_tissue(&medium);
        for ((source, rows), front) in self.sources.iter().zip(fronts) {
            if !is_tissue {
                front.arrival.clear();
                for (_, at) in rows {
                    t.v[*at] = f64::NAN;
                }
                continue;
            }
            self.solver.forward(&medium, &[(*source, 0.0)], front);
            for (vertex, at) in rows {
                t.v[*at] = front.arrival[*vertex as usize];
            }
        }
    }

    fn backward(&self, t: &mut Tape) {
        let own = &mut t.work[self.work..][..self.n_work()];
        let (kept, scratch) = own.split_at_mut(self.n_kept());
        let kept = kept.split_at(OPERANDS * self.n());
        self.carry_back(kept, &t.fronts[self.front..], scratch, &mut t.g);
    }

    fn ln_density(&self, _: &mut Tape) {}
}

/// Exact but for the curvature of the operator itself, which is left out: Gauss and Newton's Hessian.
impl Second for Arrival {
    fn push(&self, t: &Tape, d: &mut Tape) {
        let n = self.n();
        let (values, slopes) = self.kept(&t.work);
        let (changes, rest) = d.work[self.work..].split_at_mut(OPERANDS * n);
        for (i, operand) in self.written() {
            let out = &mut changes[i * n..(i + 1) * n];
            push(&slopes[self.slopes(i)], &operand.from, &d.v, out);
        }
        let (medium, change) = (self.medium(values), self.medium(changes));
        let arrival = &mut rest[..n];
        for ((_, rows), front) in self.arrived(&t.fronts[self.front..]) {
            self.solver.push(&medium, front, &change, &[0.0], arrival);
            for (vertex, at) in rows {
                d.v[*at] = arrival[*vertex as usize];
            }
        }
    }

    fn pull(&self, t: &Tape, d: &mut Tape) {
        let scratch = &mut d.work[self.work + self.n_kept()..][..(OPERANDS + 1) * self.n()];
        self.carry_back(self.kept(&t.work), &t.fronts[self.front..], scratch, &mut d.g);
    }
}
