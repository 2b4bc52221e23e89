//! Fields and derived quantities at every vertex of the surface.

use rayon::prelude::*;

use super::exceedance::Exceedance;
use super::laid_out::Model;
use super::map_columns::{Coefficients, Draws, Here};
use super::tape::Tape;
use crate::diagnostics::{mean_and_sd, quantiles};
use crate::manifold::Basis;
use crate::num::Within;

/// Vertices whose figures are computed before they are put where they stay.
const BLOCK: usize = 1 << 12;

/// Mean, sd and three quantiles of a map, each (n_vertices).
type Figures = [Vec<f64>; 5];

/// What a field or derived quantity is called.
#[derive(Clone, Copy, Debug)]
pub struct MapName<'m> {
    /// Name in the model file, with the label of a field that there is for each.
    pub name: &'m str,
    /// Declared unit.
    pub unit: &'m str,
    /// Declared range.
    pub range: Option<(f64, f64)>,
    /// Whether it is a field whose mean has a flat prior.
    pub has_flat_mean: bool,
}

/// What draws say of a field or derived quantity at every vertex.
#[derive(Clone, Debug)]
pub struct MapSummary {
    /// Name in the model file, with the label of a field that there is for each.
    pub name: String,
    /// Declared unit.
    pub unit: String,
    /// Mean (n_vertices); NaN where no draw is physical.
    pub mean: Vec<f64>,
    /// Standard deviation (n_vertices); NaN where fewer than two draws are physical.
    pub sd: Vec<f64>,
    /// 5, 50 and 95 % quantiles (n_vertices); NaN where no draw is physical.
    pub quantiles: [Vec<f64>; 3],
    /// Share of (vertex, draw) pairs outside the declared range; `None` if there is none.
    pub outside: Option<f64>,
    /// Where the truth ranks: the share of physical draws below it (n_vertices). NaN where there are no such draws or no
    /// truth; `None` for a map of which no truth was given.
    pub rank: Option<Vec<f64>>,
}

/// What draws say of the whole surface.
#[derive(Clone, Debug)]
pub struct Summaries {
    /// Fields, derived quantities, then what needs the whole surface: arrivals from each source, and gradients.
    pub maps: Vec<MapSummary>,
    /// Share of draws at each vertex in which a field or derived quantity is outside its range; of those that need the
    /// whole surface, the largest share.
    pub unphysical: Vec<f64>,
    /// For each exceedance that was asked for, its probability at each vertex over the physical
    /// draws. NaN where there are no such draws, or if there is no such map.
    pub exceeded: Vec<Vec<f64>>,
}

/// What is asked of draws besides their figures.
#[derive(Clone, Copy, Debug, Default)]
pub struct Asked<'a> {
    /// Events whose probability is asked for.
    pub exceed: &'a [Exceedance],
    /// The true fields and derived quantities, each (n_vertices), in the model's order; empty where they are not known.
    pub truth: &'a [&'a [f64]],
}

/// What draws say of one vertex.
struct AtVertex {
    /// Mean, sd and three quantiles of each map.
    maps: Vec<[f64; 5]>,
    /// Number of draws in which each map is outside its range.
    outside: Vec<usize>,
    unphysical: f64,
    exceeded: Vec<f64>,
    /// Of each map of which the truth is known.
    ranks: Vec<f64>,
}

/// Everything a model says about each vertex: its fields, then its derived quantities.
#[derive(Debug)]
pub struct Maps<'m> {
    model: &'m Model,
    basis: &'m Basis,
}

impl<'m> Maps<'m> {
    /// The maps of `model` on the surface of `basis`.
    pub fn new(model: &'m Model, basis: &'m Basis) -> Self {
        Self { model, basis }
    }

    /// Number of fields; they come first.
    pub fn n_fields(&self) -> usize {
        self.model.fields.len()
    }

    /// Name, unit and declared range of each.
    pub fn names(&self) -> Vec<MapName<'m>> {
        let fields = self.model.fields.iter().map(|f| MapName {
            name: &f.name,
            unit: &f.unit,
            range: f.range,
            has_flat_mean: f.has_flat_mean,
        });
        let lets = self.model.maps.iter().map(|m| MapName {
            name: &m.name,
            unit: &m.unit,
            range: m.range,
            has_flat_mean: false,
        });
        fields.chain(lets).collect()
    }

    /// Names of all maps of [`Maps::summarise`]; of arrivals with the cells on which they depend: `arrival[12]`.
    pub fn all_names(&self) -> Vec<&'m str> {
        let late = self.model.late_names();
        self.names().iter().map(|map| map.name).chain(late).collect()
    }

    /// Derived quantities, vertex by vertex, from whole fields (each n_vertices) and the values of
    /// the last forward pass.
    pub fn derived_fields(&self, t: &Tape, fields: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let n_lets = self.model.maps.len();
        let mut out = vec![vec![0.0; self.basis.n_vertices()]; n_lets];
        let (mut at, mut lets) = (vec![0.0; fields.len()], vec![0.0; n_lets]);
        let (mut scratch, mut outside) = (vec![], vec![false; fields.len() + n_lets]);
        for vertex in 0..self.basis.n_vertices() {
            for ((sum, field), entry) in at.iter_mut().zip(fields).zip(&self.model.fields) {
                *sum = entry.sum(field[vertex]);
            }
            self.model.derived_at(&t.v, &at, &mut scratch, &mut lets, &mut outside);
            for (out, value) in out.iter_mut().zip(&lets) {
                out[vertex] = *value;
            }
        }
        out
    }

    /// Sets the values of the fields at the places of the measurements, as if a draw had had these
    /// `fields`.
    pub fn set_at_probes(&self, t: &mut Tape, fields: &[Vec<f64>]) {
        for (entry, field) in self.model.fields.iter().zip(fields) {
            for (i, vertex) in entry.probes.iter().enumerate() {
                t.v[entry.op.theta + i] = entry.sum(field[*vertex as usize]);
            }
        }
    }

    /// Means, standard deviations and quantiles over draws of unknowns, the share of unphysical
    /// draws at each vertex, and what was asked for. Fields are averaged over
    /// all draws, derived quantities over the physical ones. For each thread one vertex with all its
    /// draws is in memory.
    pub fn summarise(&self, draws: &[Vec<f64>], asked: &Asked<'_>) -> Summaries {
        let late = self.model.late_maps(self.basis, draws);
        let (names, n_vertices, n_draws) = (self.names(), self.basis.n_vertices(), draws.len());
        let draws = self.model.read_by_maps(draws);
        let of = |e: &Exceedance| names.iter().position(|n| n.name == e.map);
        let (exceed, truth) = (asked.exceed, asked.truth);
        let of_maps: Vec<(Option<usize>, &Exceedance)> =
            exceed.iter().map(|e| (of(e), e)).collect();
        let room = || Vec::with_capacity(n_vertices);
        let mut figures: Vec<Figures> = names.iter().map(|_| [(); 5].map(|()| room())).collect();
        let (mut outside, mut unphysical) = (vec![0; names.len()], room());
        let mut exceeded: Vec<Vec<f64>> = exceed.iter().map(|_| room()).collect();
        let mut ranks: Vec<Vec<f64>> = truth.iter().map(|_| room()).collect();
        for first in (0..n_vertices).step_by(BLOCK) {
            let block = first..n_vertices.min(first + BLOCK);
            let at = |vertex| self.at_vertex(vertex, &draws, &of_maps, truth);
            for vertex in block.into_par_iter().map(at).collect::<Vec<AtVertex>>() {
                for (all, own) in figures.iter_mut().zip(vertex.maps) {
                    all.iter_mut().zip(own).for_each(|(all, figure)| all.push(figure));
                }
                outside.iter_mut().zip(vertex.outside).for_each(|(all, own)| *all += own);
                unphysical.push(vertex.unphysical);
                exceeded.iter_mut().zip(vertex.exceeded).for_each(|(all, own)| all.push(own));
                ranks.iter_mut().zip(vertex.ranks).for_each(|(all, own)| all.push(own));
            }
        }
        let n_pairs = (n_vertices * n_draws) as f64;
        let mut ranks = ranks.into_iter();
        let maps = names.iter().zip(figures).zip(outside);
        let named = |((name, figures), outside): ((&MapName<'_>, Figures), usize)| {
            let outside = name.range.map(|_| outside as f64 / n_pairs);
            let summary = summary(name.name.into(), name.unit.into(), figures, outside);
            MapSummary { rank: ranks.next(), ..summary }
        };
        let mut maps: Vec<MapSummary> = maps.map(named).collect();
        for (exceeded, asked) in exceeded.iter_mut().zip(exceed) {
            if let Some(of) = late.iter().find(|of| of.name == asked.map) {
                let share = |vertex| asked.share(&of.at(vertex));
                *exceeded = (0..n_vertices).into_par_iter().map(share).collect();
            }
        }
        for of in &late {
            let (summary, outside) = of.summary(n_vertices);
            maps.push(summary);
            // of other draws: how many leave both ranges is not known
            let shares = unphysical.iter_mut().zip(outside.into_iter().flatten());
            shares.for_each(|(all, own)| *all = all.max(own));
        }
        Summaries { maps, unphysical, exceeded }
    }

    /// For each field and draw of unknowns, the mean of its sum and the weights of the first
    /// `n_modes` eigenfunctions, (draw, 1 + n_modes); and `n_modes`, which is that of the field
    /// with most modes.
    pub fn coefficients(&self, draws: &[Vec<f64>]) -> (usize, Vec<(&'m str, Vec<f64>)>) {
        let (n_draws, draws, fields) =
            (draws.len(), self.model.read_by_maps(draws), &self.model.fields);
        let n_modes = fields.iter().map(|f| f.first + f.op.k).max().unwrap_or(0);
        let of_field = |i: usize| {
            let (field, Coefficients { mean, weights }) = (&fields[i], &draws.fields[i]);
            let mut all = vec![0.0; n_draws * (1 + n_modes)];
            for (draw, row) in all.chunks_exact_mut(1 + n_modes).enumerate() {
                row[0] = mean[draw];
                for (mode, to) in row[1 + field.first..][..field.op.k].iter_mut().enumerate() {
                    *to = weights[mode * n_draws + draw];
                }
            }
            (field.name.as_str(), all)
        };
        (n_modes, (0..fields.len()).map(of_field).collect())
    }

    /// The fields whose sums are bent into an interval, and the interval.
    pub fn links(&self) -> impl Iterator<Item = (&'m str, Within)> {
        let fields = self.model.fields.iter();
        fields.filter_map(|f| f.within.map(|within| (f.name.as_str(), within)))
    }

    /// All maps at these vertices in every draw of the unknowns, (vertex, map, draw); derived quantities are
    /// NaN where unphysical.
    pub fn draws_at(&self, draws: &[Vec<f64>], vertices: &[usize]) -> Vec<Vec<Vec<f64>>> {
        self.of_draws_at(draws, vertices, |maps| maps)
    }

    /// What `of` makes of all maps at a vertex in every draw of the unknowns, (map, draw), for each of these vertices.
    /// For each thread one vertex is in memory.
    pub fn of_draws_at<T: Send>(
        &self,
        draws: &[Vec<f64>],
        vertices: &[usize],
        of: impl Fn(Vec<Vec<f64>>) -> T + Sync,
    ) -> Vec<T> {
        let draws = self.model.read_by_maps(draws);
        vertices
            .par_iter()
            .map(|vertex| of(self.model.maps_at(self.basis.at(*vertex), &draws).values))
            .collect()
    }

    fn at_vertex(
        &self,
        vertex: usize,
        draws: &Draws,
        exceed: &[(Option<usize>, &Exceedance)],
        truth: &[&[f64]],
    ) -> AtVertex {
        let Here { mut values, outside, unphysical } =
            self.model.maps_at(self.basis.at(vertex), draws);
        for values in &mut values {
            values.retain(|x| !x.is_nan());
        }
        let of = |i: &Option<usize>| i.map_or([].as_slice(), |i| &values[i]);
        let exceeded = exceed.iter().map(|(i, exceedance)| exceedance.share(of(i))).collect();
        let rank = |(values, truth): (&Vec<f64>, &&[f64])| {
            let below = values.iter().filter(|x| **x < truth[vertex]).count();
            if truth[vertex].is_nan() { f64::NAN } else { below as f64 / values.len() as f64 }
        };
        let ranks = values.iter().zip(truth).map(rank).collect();
        AtVertex {
            maps: values.iter_mut().map(|values| five_numbers(values)).collect(),
            outside,
            unphysical: unphysical as f64 / draws.v.len() as f64,
            exceeded,
            ranks,
        }
    }
}

pub(super) fn summary(
    name: String,
    unit: String,
    figures: Figures,
    outside: Option<f64>,
) -> MapSummary {
    let [mean, sd, q5, q50, q95] = figures;
    MapSummary { name, unit, mean, sd, quantiles: [q5, q50, q95], outside, rank: None }
}

/// Mean, standard deviation and 5, 50, 95 % quantiles; NaN where there are too few values.
pub(super) fn five_numbers(values: &mut [f64]) -> [f64; 5] {
    let (mean, sd) = mean_and_sd(&[values]);
    let [q5, q50, q95] = quantiles(values, [0.05, 0.5, 0.95]);
    [mean, if values.len() < 2 { f64::NAN } else { sd }, q5, q50, q95]
}
