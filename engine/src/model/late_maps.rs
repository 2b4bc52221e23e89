//! Maps that need the whole surface at once, in at most 100 draws: arrivals from every source, gradients, and what is
//! computed of gradients.

use rayon::prelude::*;

use super::everywhere::Where;
use super::laid_out::Model;
use super::late::{LateMaps, LateSource};
use super::map::Source;
use super::maps::{MapSummary, five_numbers, summary};
use super::tape::Tape;
use crate::manifold::Basis;
use crate::mesh::Places;
use crate::num::vector::dot;

/// Most draws of which such maps are kept: each is as large as the surface.
const DRAWS: usize = 100;

/// A map in some draws.
pub(super) struct LateMap<'m> {
    pub(super) name: &'m str,
    unit: &'m str,
    range: Option<(f64, f64)>,
    /// Where the surface's vertices are on that of the values; `None` if they are the same.
    places: Option<&'m Places>,
    /// (draw, vertex), of draws that have a value.
    values: Vec<Vec<f64>>,
}

impl LateMap<'_> {
    /// Its values at a vertex of the surface, in the draws in which it has one within its range.
    pub(super) fn at(&self, vertex: usize) -> Vec<f64> {
        let at = |values: &Vec<f64>| {
            self.places.map_or_else(|| values[vertex], |p| p.at(vertex, values))
        };
        let is_physical = |x: &f64| {
            x.is_finite() && self.range.is_none_or(|(low, high)| (low..=high).contains(x))
        };
        self.values.iter().map(at).filter(is_physical).collect()
    }

    /// What its draws say of each vertex, and, if it has a range, the share of them that leaves it there (n_vertices).
    pub(super) fn summary(&self, n_vertices: usize) -> (MapSummary, Option<Vec<f64>>) {
        let at = |vertex| {
            let mut values = self.at(vertex);
            (five_numbers(&mut values), values.len())
        };
        let figures: Vec<([f64; 5], usize)> = (0..n_vertices).into_par_iter().map(at).collect();
        let n_draws = self.values.len().max(1) as f64;
        let share = |(_, n): &([f64; 5], usize)| 1.0 - *n as f64 / n_draws;
        let outside: Option<Vec<f64>> = self.range.map(|_| figures.iter().map(share).collect());
        let mean = outside.as_ref().map(|at| at.iter().sum::<f64>() / n_vertices as f64);
        let figures =
            std::array::from_fn(|k| figures.iter().map(|(figures, _)| figures[k]).collect());
        (summary(self.name.into(), self.unit.into(), figures, mean), outside)
    }
}

impl Model {
    /// Names, units, ranges and places of such maps, in their order.
    fn late(&self) -> Vec<LateMap<'_>> {
        let of_operators = self.over.iter().flat_map(|over| {
            let places = over.places.as_deref();
            over.names.iter().map(move |name| (name.as_str(), &over.unit, None, places))
        });
        let LateMaps { steepness, lets } = &self.late_maps;
        let steepness = steepness.iter().map(|own| (own.name, &own.unit, None, None));
        let lets = lets.iter().map(|own| (own.name, &own.unit, own.range, None));
        let all = of_operators.chain(steepness).chain(lets);
        all.map(|(name, unit, range, places)| LateMap { name, unit, range, places, values: vec![] })
            .collect()
    }

    /// What such maps are called.
    pub(super) fn late_names(&self) -> Vec<&str> {
        self.late().into_iter().map(|map| map.name).collect()
    }

    /// Such maps in at most 100 of the draws, evenly spaced.
    pub(super) fn late_maps(&self, basis: &Basis, draws: &[Vec<f64>]) -> Vec<LateMap<'_>> {
        let mut maps = self.late();
        if maps.is_empty() {
            return maps;
        }
        let some: Vec<&Vec<f64>> =
            draws.iter().step_by(draws.len().div_ceil(DRAWS).max(1)).collect();
        let of_draw = |t: &mut Tape, u: &Vec<f64>| {
            self.forward(t, u);
            let of_operators = self.over.iter();
            let mut all: Vec<_> =
                of_operators.flat_map(|over| over.maps(&t.kept[over.kept])).collect();
            all.extend(self.late_maps.of_draw(self, t, basis));
            all
        };
        // (draw, map, vertex)
        let all: Vec<Vec<Vec<f64>>> =
            some.into_par_iter().map_init(|| self.tape(), of_draw).collect();
        for draw in all {
            for (map, values) in maps.iter_mut().zip(draw).filter(|(_, values)| !values.is_empty())
            {
                map.values.push(values);
            }
        }
        maps
    }
}

impl LateMaps {
    /// Gradients, then what is computed of them, each (n_vertices), after a forward pass.
    fn of_draw(&self, model: &Model, t: &Tape, basis: &Basis) -> Vec<Vec<f64>> {
        if self.steepness.is_empty() {
            return vec![];
        }
        let n = basis.n_vertices();
        // the tape's values, then the sum of each field at every vertex
        let (mut v, first) = (t.v.clone(), t.v.len());
        for field in &model.fields {
            let (mean, w) = field.op.weights(t);
            let at = |vertex| mean + dot::<8>(w, &basis.at(vertex)[field.first..][..w.len()]);
            v.extend((0..n).map(at));
        }
        let place = |source: &Source| match *source {
            Source::Value(at) => Where::Same(at as u32),
            Source::Field(field) => Where::Each((first + field * n) as u32),
        };
        let mut all: Vec<Vec<f64>> = vec![];
        for own in &self.steepness {
            let from: Vec<Where> = own.sources.iter().map(place).collect();
            let (mut values, mut slopes) = (vec![0.0; n], vec![0.0; n * from.len()]);
            own.math.values(&v, &from, &mut values, &mut slopes);
            all.push((0..n).map(|vertex| own.gradient.length(vertex, &values)).collect());
        }
        let mut numbers = vec![];
        for own in &self.lets {
            let at = |vertex: usize| {
                numbers.clear();
                numbers.extend(own.sources.iter().map(|source| match source {
                    LateSource::Steepness(i) => all[*i][vertex],
                    LateSource::Early(source) => v[place(source).at(vertex)],
                }));
                own.at.value(&numbers, None)
            };
            let values = (0..n).map(at).collect();
            all.push(values);
        }
        all
    }
}
