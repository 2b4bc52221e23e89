//! Arrival times from every source over the whole surface, in draws of the unknowns.

use rayon::prelude::*;

use super::laid_out::Model;
use super::tape::Tape;

/// Most draws whose arrivals are kept: each costs as much as a log density.
const DRAWS: usize = 100;

/// Arrivals from one source.
pub(super) struct Arrivals {
    pub(super) name: String,
    pub(super) unit: String,
    /// (vertex, draw); those that never come are left out.
    pub(super) draws: Vec<Vec<f64>>,
}

/// Arrivals in 100 of the draws, evenly spaced: from each source of each activation. Each of the `n_vertices` of the
/// surface has what the triangulation says of it on which arrivals are computed.
pub(super) fn arrivals(model: &Model, n_vertices: usize, draws: &[Vec<f64>]) -> Vec<Arrivals> {
    if model.arrivals.is_empty() {
        return vec![];
    }
    let step = draws.len().div_ceil(DRAWS).max(1);
    let some: Vec<&Vec<f64>> = draws.iter().step_by(step).collect();
    // (draw, front, vertex of the triangulation)
    let of_draw = |t: &mut Tape, u: &Vec<f64>| {
        model.forward(t, u);
        t.fronts.iter().map(|front| front.arrival.clone()).collect()
    };
    let fronts: Vec<Vec<Vec<f64>>> =
        some.into_par_iter().map_init(|| model.tape(), of_draw).collect();
    let mut all = vec![];
    for of in &model.arrivals {
        for (source, name) in of.names.iter().enumerate() {
            let known = fronts.iter().map(|fronts| &fronts[of.front + source]);
            let known = known.filter(|front| !front.is_empty());
            let maps: Vec<Vec<f64>> = known
                .map(|front| of.places.as_ref().map_or(front.clone(), |at| at.carry(front)))
                .collect();
            let at = |vertex: usize| -> Vec<f64> {
                maps.iter().map(|map| map[vertex]).filter(|x| x.is_finite()).collect()
            };
            let draws = (0..n_vertices).into_par_iter().map(at).collect();
            all.push(Arrivals { name: name.clone(), unit: of.unit.clone(), draws });
        }
    }
    all
}
