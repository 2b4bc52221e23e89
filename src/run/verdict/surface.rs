//! What is asked of fields and parameters: inside their ranges, narrower than before, near a site?

use crate::diagnostics::quantile;
use crate::diagnostics::verdict::{Informed, Physical, Reach, Share, Trusted};
use crate::manifold::Geodesic;
use crate::model::{Kind, Maps, Parameter};
use crate::random::Stream;
use crate::report::Row;
use crate::run::Fit;

/// Draws from the prior that the posterior is compared with.
const PRIOR_DRAWS: usize = 400;
/// Vertices at which it is compared.
const VERTICES: usize = 500;
/// Part of a range that a 90 % interval covers if nothing but the range is known.
const OF_RANGE: f64 = 0.9;
/// A field is informed where its interval is at most this part of what it was.
const INFORMED: f64 = 0.5;
/// A parameter is not informed if its interval is at least this part of what it was.
const UNINFORMED: f64 = 0.9;

impl Fit<'_> {
    /// Fields and derived quantities against their ranges; `None` if there are none.
    pub(super) fn physical(&self) -> Option<Physical> {
        let unphysical = self.unphysical()?;
        let named = |name: &String, share| Share { name: name.clone(), share };
        let maps = self.maps().iter().filter_map(|m| Some(named(&m.name, m.outside?)));
        let maps: Vec<Share> = maps.collect();
        let n = unphysical.len() as f64;
        let void = unphysical.iter().filter(|share| **share >= 1.0).count() as f64 / n;
        let outside = unphysical.iter().sum::<f64>() / n;
        (!maps.is_empty()).then_some(Physical { outside, maps, void })
    }

    /// The posterior against the prior; `None` for a model without measurements.
    pub(super) fn informed(&self) -> Option<Informed> {
        let model = self.model();
        if model.measured().all(|(_, rows)| rows.is_empty()) {
            return None;
        }
        let mut rng = Stream::Expected.rng(self.settings.seed);
        let prior = model.plausible(PRIOR_DRAWS, &mut rng).unwrap_or_default();
        let (uninformed, n_parameters) = self.uninformed(&prior);
        let fields = self.informed_fields(&prior);
        Some(Informed { fields, uninformed, n_parameters })
    }

    /// Of each field that can be compared, the share of the surface on which it is informed.
    fn informed_fields(&self, prior: &[Vec<f64>]) -> Vec<Share> {
        let Some(basis) = self.problem().loaded().basis() else { return vec![] };
        let maps = Maps::new(self.model(), basis);
        let step = basis.n_vertices().div_ceil(VERTICES).max(1);
        let vertices: Vec<usize> = (0..basis.n_vertices()).step_by(step).collect();
        let (has_prior, before) = (!prior.is_empty(), maps.draws_at(prior, &vertices));
        let names = maps.names();
        let share = |i: usize| {
            let range = names[i].range.map_or(f64::INFINITY, |(low, high)| OF_RANGE * (high - low));
            let [low, _, high] = &self.maps()[i].quantiles;
            let is_flat = names[i].has_flat_mean;
            let prior = |draws: &[f64]| if is_flat { f64::INFINITY } else { width(draws) };
            let is_informed = |(v, before): (&usize, &Vec<Vec<f64>>)| {
                high[*v] - low[*v] <= INFORMED * prior(&before[i]).min(range)
            };
            let n = vertices.iter().zip(&before).filter(|at| is_informed(*at)).count();
            let is_known = range.is_finite() || has_prior && !is_flat;
            let share = n as f64 / vertices.len() as f64;
            is_known.then(|| Share { name: names[i].name.to_owned(), share })
        };
        (0..maps.n_fields()).filter_map(share).collect()
    }

    /// Parameters that are as wide as their prior, and how many were compared.
    fn uninformed(&self, prior: &[Vec<f64>]) -> (Vec<String>, usize) {
        let model = self.model();
        let mut rng = Stream::Expected.rng(self.settings.seed);
        let (mut tape, mut values) = (model.tape(), vec![]);
        for draw in prior {
            model.forward_fields(&mut tape, draw);
            model.report(&tape, &mut rng, &mut values);
        }
        let (n_reported, mut first, mut compared) = (model.n_reported(), 0, 0);
        let mut uninformed = vec![];
        for parameter in &model.parameters {
            for i in (0..parameter.len).filter(|_| is_compared(parameter)) {
                let before: Vec<f64> =
                    values.iter().skip(first + i).step_by(n_reported.max(1)).copied().collect();
                let name = parameter.element(i);
                let Some(row) = self.summary().iter().find(|row| row.name == name) else {
                    continue;
                };
                compared += usize::from(!before.is_empty());
                if !before.is_empty() && after(row) >= UNINFORMED * width(&before) {
                    uninformed.push(name);
                }
            }
            first += parameter.len;
        }
        (uninformed, compared)
    }

    /// The surface against the sites; `None` without sites or lengthscales.
    pub(super) fn trusted(&self) -> Option<Trusted> {
        let surface = self.problem().loaded().surface()?;
        let sites = self.problem().measurements().vertices();
        if sites.is_empty() {
            return None;
        }
        let median = |name: &String| {
            self.summary().iter().find(|row| row.name == *name).map(|row| row.summary.q50)
        };
        let longest = |names: &[String]| names.iter().filter_map(median).reduce(f64::max);
        let lengthscales = self.model().lengthscales();
        let known: Vec<(&str, f64)> =
            lengthscales.iter().filter_map(|(f, names)| Some((*f, longest(names)?))).collect();
        let distance = Geodesic::distance_once(&surface.mesh, &sites).ok()?;
        let reach = |&(field, lengthscale): &(&str, f64)| {
            let beyond = distance.iter().filter(|d| **d > lengthscale).count();
            let beyond = beyond as f64 / distance.len() as f64;
            Reach { field: field.to_owned(), lengthscale, beyond }
        };
        let farthest = distance.iter().copied().fold(0.0, f64::max);
        (!known.is_empty()).then(|| Trusted { fields: known.iter().map(reach).collect(), farthest })
    }
}

/// Whether a parameter has a proper prior of its own to be compared with.
fn is_compared(parameter: &Parameter) -> bool {
    parameter.kind != Kind::Eta && !parameter.is_flat
}

/// Width of the 90 % interval of draws; infinite without draws.
fn width(draws: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = draws.iter().copied().filter(|x| !x.is_nan()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    if sorted.is_empty() {
        return f64::INFINITY;
    }
    quantile(&sorted, 0.95) - quantile(&sorted, 0.05)
}

/// The same of a posterior.
fn after(row: &Row) -> f64 {
    row.summary.q95 - row.summary.q5
}
