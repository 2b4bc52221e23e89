//! Arrival times from every source over the whole surface, in draws of the unknowns.

use rayon::prelude::*;

use super::arrival::Arrival;
use super::laid_out::Model;
use super::tape::Tape;

/// Most draws whose arrivals are kept: each costs as much as a log density.
const DRAWS: usize = 100;

/// Arrivals from one source of one activation.
pub(super) struct Arrivals<'m> {
    of: &'m Arrival,
    source: usize,
    /// (draw, vertex of the triangulation on which they are computed), of draws in which activation arrives.
    fronts: Vec<Vec<f64>>,
}

/// Arrivals in at most 100 of the draws, evenly spaced, from each source of each activation.
pub(super) fn arrivals<'m>(model: &'m Model, draws: &[Vec<f64>]) -> Vec<Arrivals<'m>> {
    if model.arrivals.is_empty() {
        return vec![];
    }
    let some: Vec<&Vec<f64>> = draws.iter().step_by(draws.len().div_ceil(DRAWS).max(1)).collect();
    let of_draw = |t: &mut Tape, u: &Vec<f64>| {
        model.forward(t, u);
        t.fronts.iter().map(|front| front.arrival.clone()).collect()
    };
    // (draw, front, vertex of the triangulation)
    let fronts: Vec<Vec<Vec<f64>>> =
        some.into_par_iter().map_init(|| model.tape(), of_draw).collect();
    let sources = model.arrivals.iter().flat_map(|of| (0..of.sources.len()).map(move |i| (of, i)));
    let wave = |(of, source): (&'m Arrival, usize)| {
        let own = fronts.iter().map(|fronts| fronts[of.front + source].clone());
        Arrivals { of, source, fronts: own.filter(|front| !front.is_empty()).collect() }
    };
    sources.map(wave).collect()
}

impl<'m> Arrivals<'m> {
    /// What their map is called.
    pub(super) fn name(&self) -> &'m str {
        &self.of.names[self.source]
    }

    pub(super) fn unit(&self) -> &'m str {
        &self.of.unit
    }

    /// Arrivals at a vertex of the surface, but for draws in which there is none.
    pub(super) fn at(&self, vertex: usize) -> Vec<f64> {
        let at = |front: &Vec<f64>| match &self.of.places {
            Some(places) => places.at(vertex, front),
            None => front[vertex],
        };
        self.fronts.iter().map(at).filter(|x| x.is_finite()).collect()
    }
}
