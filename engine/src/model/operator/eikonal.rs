//! Arrival times: `eikonal(SLOWNESS, RATIO, ANGLE, THICKNESS; row.source)`.

use std::ops::Range;
use std::sync::Arc;

use super::{Kept, Operator};
use crate::manifold::{Eikonal, Front, Medium, MediumBar};

/// What a slowness (ms/mm) and a ratio may be. Beyond, nothing arrives.
const LIMITS: Range<f64> = 1e-6..1e6;
/// What a thickness may be, ms.
const THICKNESSES: Range<f64> = 0.0..1e3;

/// Arrivals at rows from their sources. Operands are a slowness, then, as far as they are given, ratio, angle and
/// thickness.
#[derive(Debug)]
pub(in crate::model) struct Arrival {
    solver: Arc<Eikonal>,
    /// Every vertex at which activation starts, with the rows whose source it is: vertex, and number.
    sources: Vec<(u32, Vec<(u32, usize)>)>,
}

impl Arrival {
    /// At rows, each with its source and its vertex.
    pub(in crate::model) fn new(solver: Arc<Eikonal>, rows: &[(u32, u32)]) -> Self {
        let mut sources: Vec<(u32, Vec<(u32, usize)>)> = vec![];
        for (i, (source, vertex)) in rows.iter().enumerate() {
            match sources.iter_mut().find(|(own, _)| own == source) {
                Some((_, own)) => own.push((*vertex, i)),
                None => sources.push((*source, vec![(*vertex, i)])),
            }
        }
        Self { solver, sources }
    }

    fn medium<'a>(operands: &[&'a [f64]]) -> Medium<'a> {
        let of = |i: usize| operands.get(i).copied();
        Medium { slowness: operands[0], ratio: of(1), angle: of(2), thickness: of(3) }
    }

    /// Sources with their fronts, of those from which activation arrived.
    fn arrived<'a>(
        &'a self,
        kept: &'a Kept,
    ) -> impl Iterator<Item = (&'a (u32, Vec<(u32, usize)>), &'a Front)> {
        self.sources.iter().zip(&kept.fronts).filter(|(_, front)| !front.arrival.is_empty())
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
}

impl Operator for Arrival {
    fn forward(&self, operands: &[&[f64]], kept: &mut Kept, out: &mut [f64]) {
        let medium = Self::medium(operands);
        kept.fronts.resize_with(self.sources.len(), Front::default);
        let is_tissue = Self::is_tissue(&medium);
        for ((source, rows), front) in self.sources.iter().zip(&mut kept.fronts) {
            if is_tissue {
                self.solver.forward(&medium, &[(*source, 0.0)], front);
            } else {
                front.arrival.clear();
            }
            for (vertex, i) in rows {
                out[*i] = front.arrival.get(*vertex as usize).copied().unwrap_or(f64::NAN);
            }
        }
    }

    /// Exact but for the curvature of the operator itself, which is left out: Gauss and Newton's Hessian.
    fn push(&self, operands: &[&[f64]], kept: &Kept, changes: &[&[f64]], out: &mut [f64]) {
        let (medium, change) = (Self::medium(operands), Self::medium(changes));
        let mut arrival = vec![0.0; self.solver.n_vertices()];
        for ((_, rows), front) in self.arrived(kept) {
            self.solver.push(&medium, front, &change, &[0.0], &mut arrival);
            for (vertex, i) in rows {
                out[*i] = arrival[*vertex as usize];
            }
        }
    }

    fn pull(&self, operands: &[&[f64]], kept: &Kept, bars: &[f64], into: &mut [&mut [f64]]) {
        let medium = Self::medium(operands);
        let mut bar = vec![0.0; self.solver.n_vertices()];
        let mut into = into.iter_mut().map(|into| &mut **into);
        let Some(slowness) = into.next() else { return };
        let [mut ratio, mut angle, mut thickness] = [(); 3].map(|()| into.next());
        for ((_, rows), front) in self.arrived(kept) {
            bar.fill(0.0);
            for (vertex, i) in rows {
                bar[*vertex as usize] += bars[*i];
            }
            let mut bars = MediumBar {
                slowness: &mut *slowness,
                ratio: ratio.as_deref_mut(),
                angle: angle.as_deref_mut(),
                thickness: thickness.as_deref_mut(),
                onsets: &mut [0.0],
            };
            self.solver.backward(&medium, front, &bar, &mut bars);
        }
    }

    fn maps(&self, kept: &Kept) -> Vec<Vec<f64>> {
        kept.fronts.iter().map(|front| front.arrival.clone()).collect()
    }
}
