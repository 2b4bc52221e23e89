//! Arrival times from every source over the whole surface, in draws of the unknowns.

use rayon::prelude::*;

use super::arrival::Arrival;
use super::maps::{MapSummary, Maps, five_numbers};
use super::tape::Tape;

/// Most draws whose arrivals are kept: each costs as much as a log density.
const DRAWS: usize = 100;

/// Arrivals from one source.
struct Wave<'m> {
    of: &'m Arrival,
    /// Its number among those of `of`.
    source: usize,
}

impl<'m> Maps<'m> {
    /// Every source of every activation.
    fn waves(&self) -> impl Iterator<Item = Wave<'m>> {
        let all = self.model.arrivals.iter();
        all.flat_map(|of| (0..of.sources.len()).map(|source| Wave { of, source }))
    }

    /// Names of all maps of [`Maps::summarise`]. Those of arrivals are the `let`, the cell of column `source`, and the
    /// cells of other columns on which they depend: `arrival[12]`.
    pub fn all_names(&self) -> Vec<&'m str> {
        let arrivals = self.model.arrivals.iter().flat_map(|of| &of.names).map(String::as_str);
        self.names().iter().map(|map| map.name).chain(arrivals).collect()
    }

    /// What 100 of the draws, evenly spaced, say of arrivals: of each source a map. Each vertex of the surface has what
    /// the triangulation says of it on which arrivals are computed. NaN where activation arrives in no draw.
    pub(super) fn arrivals(&self, draws: &[Vec<f64>]) -> Vec<Arrivals> {
        let waves: Vec<Wave<'_>> = self.waves().collect();
        if waves.is_empty() {
            return vec![];
        }
        let step = draws.len().div_ceil(DRAWS).max(1);
        let some: Vec<&Vec<f64>> = draws.iter().step_by(step).collect();
        // (draw, wave, vertex of the triangulation)
        let of_draw = |t: &mut Tape, u: &Vec<f64>| {
            self.model.forward(t, u);
            let front = |wave: &Wave<'_>| t.fronts[wave.of.front + wave.source].arrival.clone();
            waves.iter().map(front).collect()
        };
        let fronts: Vec<Vec<Vec<f64>>> =
            some.into_par_iter().map_init(|| self.model.tape(), of_draw).collect();
        let of_wave = |(i, wave): (usize, &Wave<'_>)| {
            let known = fronts.iter().map(|fronts| &fronts[i]).filter(|front| !front.is_empty());
            let maps: Vec<Vec<f64>> = known
                .map(|front| wave.of.places.as_ref().map_or(front.clone(), |at| at.carry(front)))
                .collect();
            let at = |vertex: usize| -> Vec<f64> {
                maps.iter().map(|map| map[vertex]).filter(|x| x.is_finite()).collect()
            };
            Arrivals {
                name: wave.of.names[wave.source].clone(),
                unit: wave.of.unit.clone(),
                draws: (0..self.basis.n_vertices()).into_par_iter().map(at).collect(),
            }
        };
        waves.iter().enumerate().map(of_wave).collect()
    }
}

/// Arrivals from one source.
pub(super) struct Arrivals {
    pub(super) name: String,
    pub(super) unit: String,
    /// (vertex, draw)
    pub(super) draws: Vec<Vec<f64>>,
}

impl Arrivals {
    pub(super) fn summary(mut self) -> MapSummary {
        let figures: Vec<[f64; 5]> =
            self.draws.par_iter_mut().map(|draws| five_numbers(draws)).collect();
        let [mean, sd, q5, q50, q95] =
            std::array::from_fn(|k| figures.iter().map(|figures| figures[k]).collect());
        let quantiles = [q5, q50, q95];
        MapSummary { name: self.name, unit: self.unit, mean, sd, quantiles, outside: None }
    }
}
