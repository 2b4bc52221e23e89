//! Arrival times: `eikonal(SLOWNESS, RATIO, ANGLE, THICKNESS; row.source)`.

use std::ops::Range;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

use super::{Adjoints, Memo, Off, Operands, Operator};
use crate::manifold::{Eikonal, Front, Medium, MediumBar};
use crate::table::{Finer, ProbeError};

/// What a slowness (ms/mm) and a ratio may be. Beyond, nothing arrives.
const LIMITS: Range<f64> = 1e-6..1e6;
/// What a thickness may be, ms.
const THICKNESSES: Range<f64> = 0.0..1e3;

/// Where activation starts: a vertex, and which of the single numbers tells by how much later than at 0 ms.
pub(in crate::model) type Source = (u32, Option<usize>);

/// Arrivals at rows from their sources. Operands are a slowness, then, as far as they are given, ratio, angle and
/// thickness.
#[derive(Debug)]
pub(in crate::model) struct Arrival {
    solver: Arc<Eikonal>,
    finer: Arc<Finer>,
    activations: Vec<Activation>,
    /// By how much each of them arrives later than it is computed, ms (one per vertex): see [`Operator::correct`].
    later: RwLock<Vec<Vec<f64>>>,
}

/// One activation of the surface.
#[derive(Debug)]
struct Activation {
    sources: Vec<Source>,
    /// The rows in which it is seen: vertex, and number.
    rows: Vec<(u32, usize)>,
}

impl Arrival {
    /// At rows, each with its sources and its vertex.
    pub(in crate::model) fn new(
        solver: Arc<Eikonal>,
        finer: Arc<Finer>,
        rows: Vec<(Vec<Source>, u32)>,
    ) -> Self {
        let mut activations: Vec<Activation> = vec![];
        for (i, (sources, vertex)) in rows.into_iter().enumerate() {
            let row = (vertex, i);
            if let Some(own) = activations.iter_mut().find(|own| own.sources == sources) {
                own.rows.push(row);
            } else {
                activations.push(Activation { sources, rows: vec![row] });
            }
        }
        let later = RwLock::new(vec![vec![0.0; solver.n_vertices()]; activations.len()]);
        Self { solver, finer, activations, later }
    }

    /// What is in [`Arrival::later`]. It is only ever replaced as a whole, so it can be read after a panic elsewhere, too.
    fn later(&self) -> RwLockReadGuard<'_, Vec<Vec<f64>>> {
        self.later.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn medium<'a>(of: &Operands<'a>) -> Medium<'a> {
        let at = |i: usize| of.everywhere.get(i).copied();
        Medium { slowness: of.everywhere[0], ratio: at(1), angle: at(2), thickness: at(3) }
    }

    /// Activations with their fronts, of those that arrived.
    fn arrived<'a>(&'a self, kept: &'a Memo) -> impl Iterator<Item = (&'a Activation, &'a Front)> {
        self.activations.iter().zip(&kept.fronts).filter(|(_, front)| !front.arrival.is_empty())
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

impl Activation {
    /// The number of each source, of these.
    fn onsets(&self, numbers: &[f64]) -> Vec<f64> {
        self.sources.iter().map(|(_, number)| number.map_or(0.0, |i| numbers[i])).collect()
    }

    /// Its sources, each with its onset.
    fn born(&self, numbers: &[f64]) -> Vec<(u32, f64)> {
        let vertices = self.sources.iter().map(|(vertex, _)| *vertex);
        vertices.zip(self.onsets(numbers)).collect()
    }
}

impl Operator for Arrival {
    fn forward(&self, of: &Operands<'_>, kept: &mut Memo, out: &mut [f64]) {
        let medium = Self::medium(of);
        kept.fronts.resize_with(self.activations.len(), Front::default);
        let is_tissue = Self::is_tissue(&medium) && of.numbers.iter().all(|x| x.is_finite());
        if is_tissue {
            let born: Vec<_> = self.activations.iter().map(|own| own.born(&of.numbers)).collect();
            self.solver.forward_each(&medium, &born, &mut kept.fronts);
        } else {
            kept.fronts.iter_mut().for_each(|front| front.arrival.clear());
        }
        for ((own, front), later) in
            self.activations.iter().zip(&kept.fronts).zip(self.later().iter())
        {
            for (vertex, i) in &own.rows {
                let vertex = *vertex as usize;
                let arrival = front.arrival.get(vertex);
                out[*i] = arrival.map_or(f64::NAN, |arrival| arrival + later[vertex]);
            }
        }
    }

    /// Exact but for the curvature of the operator itself, which is left out: Gauss and Newton's Hessian.
    fn push(&self, of: &Operands<'_>, kept: &Memo, changes: &Operands<'_>, out: &mut [f64]) {
        let (medium, change) = (Self::medium(of), Self::medium(changes));
        let mut arrival = vec![0.0; self.solver.n_vertices()];
        for (own, front) in self.arrived(kept) {
            let onsets = own.onsets(&changes.numbers);
            self.solver.push(&medium, front, &change, &onsets, &mut arrival);
            for (vertex, i) in &own.rows {
                out[*i] = arrival[*vertex as usize];
            }
        }
    }

    fn pull(&self, of: &Operands<'_>, kept: &Memo, bars: &[f64], into: &mut Adjoints<'_>) {
        let medium = Self::medium(of);
        let mut bar = vec![0.0; self.solver.n_vertices()];
        let mut everywhere = into.everywhere.iter_mut().map(|into| &mut **into);
        let Some(slowness) = everywhere.next() else { return };
        let [mut ratio, mut angle, mut thickness] = [(); 3].map(|()| everywhere.next());
        for (own, front) in self.arrived(kept) {
            bar.fill(0.0);
            for (vertex, i) in &own.rows {
                bar[*vertex as usize] += bars[*i];
            }
            let mut onsets = vec![0.0; own.sources.len()];
            let mut medium_bar = MediumBar {
                slowness: &mut *slowness,
                ratio: ratio.as_deref_mut(),
                angle: angle.as_deref_mut(),
                thickness: thickness.as_deref_mut(),
                onsets: &mut onsets,
            };
            self.solver.backward(&medium, front, &bar, &mut medium_bar);
            for ((_, number), bar) in own.sources.iter().zip(onsets) {
                if let Some(i) = number {
                    into.numbers[*i] += bar;
                }
            }
        }
    }

    fn activations(&self) -> Vec<Vec<usize>> {
        let rows = |own: &Activation| own.rows.iter().map(|(_, i)| *i).collect();
        self.activations.iter().map(rows).collect()
    }

    fn started_at(&self, of: &Operands<'_>, vertex: u32) -> Vec<f64> {
        let mut front = Front::default();
        self.solver.forward(&Self::medium(of), &[(vertex, 0.0)], &mut front);
        let rows = self.activations.iter().flat_map(|own| &own.rows);
        let mut out = vec![f64::NAN; rows.clone().count()];
        rows.for_each(|(vertex, i)| out[*i] = front.arrival[*vertex as usize]);
        out
    }

    fn maps(&self, kept: &Memo) -> Vec<Vec<f64>> {
        let corrected = |(front, later): (&Front, &Vec<f64>)| {
            front.arrival.iter().zip(later).map(|(arrival, later)| arrival + later).collect()
        };
        kept.fronts.iter().zip(self.later().iter()).map(corrected).collect()
    }

    /// Nothing at vertices that no front reaches.
    fn off(&self, of: &Operands<'_>, kept: &Memo) -> Result<Option<Off>, ProbeError> {
        if kept.fronts.iter().any(|front| front.arrival.is_empty()) {
            return Ok(None); // what is no tissue here is none there
        }
        let born: Vec<_> = self.activations.iter().map(|own| own.born(&of.numbers)).collect();
        let finer = self.finer.arrivals(&Self::medium(of), &born)?;
        let later = |(finer, here): (f64, &f64)| Some(finer - here).filter(|by| by.is_finite());
        let of_front = |(finer, front): (Vec<f64>, &Front)| {
            let all = finer.into_iter().zip(&front.arrival);
            all.map(|pair| later(pair).unwrap_or(0.0)).collect()
        };
        let by = finer.into_iter().zip(&kept.fronts).map(of_front).collect();
        Ok(Some(Off { by, n_vertices: self.finer.n_vertices()? }))
    }

    fn correct(&self, by: Vec<Vec<f64>>) {
        *self.later.write().unwrap_or_else(PoisonError::into_inner) = by;
    }
}
