//! What is wrong with measurements before anything is sampled: they exclude each other, are all the same,
//! or lie far from everything that the model can mean.
//!
//! The first and the last are told by a comparison with measurements simulated at draws from the prior.

use std::collections::{BTreeMap, BTreeSet};

use super::fits::in_words;
use crate::diagnostics::verdict::Doubt;
use crate::model::{Maps, Model, Observe, RowId, Tape};
use crate::random::Stream;
use crate::run::Loaded;
use crate::table::Measurements;
use rayon::prelude::*;

/// Draws from the prior.
const DRAWS: usize = 400;
/// Draws at which rows are computed side by side.
const AT_ONCE: usize = 32;
/// Fewer physical draws than this at a measurement tell nothing about its range.
const FEWEST: usize = 40;
/// Draws at which two measurements must be predicted alike to be of one quantity.
const ALIKE: usize = 3;
/// So few measurements may all be the same.
const MAY_BE_ALIKE: usize = 2;
/// Most measurements that are named.
const MOST_NAMED: usize = 6;
/// What a table in another unit is multiplied by: s, µs, cm, dm and the like.
const FACTORS: [f64; 6] = [1e3, 1e-3, 10.0, 0.1, 1e6, 1e-6];

/// Doubts about the measurements that `model` is laid out on.
pub(in crate::run) fn doubts(model: &Model, loaded: &Loaded) -> Vec<Doubt> {
    [against_prior(model, loaded), alike(model)].concat()
}

/// What draws from the prior tell of them; nothing where a prior cannot be drawn from.
fn against_prior(model: &Model, loaded: &Loaded) -> Vec<Doubt> {
    let ids = model.row_ids();
    let mut rng = Stream::Expected.rng(0);
    if ids.is_empty() {
        return vec![];
    }
    let Some(draws) = model.plausible(DRAWS, &mut rng) else { return vec![] };
    let physical = Physical::new(model, loaded, &draws);
    let simulated = Simulated::new(model, &ids, &draws, &loaded.measurements, &physical);
    let mut found = simulated.contradictions(&loaded.measurements);
    found.extend(simulated.out_of_range(&loaded.measurements));
    found
}

/// The statements whose measurements are all the same. Counts may be.
fn alike(model: &Model) -> Vec<Doubt> {
    let Ok(tree) = model.syntax() else { return vec![] };
    let is_count = |o: &Observe| tree.observes().any(|of| of.name == o.name && of.kind == "Count");
    let doubtful = |o: &&Observe| {
        let bits = |cells: Vec<f64>| cells.into_iter().map(f64::to_bits).collect::<Vec<u64>>();
        let distinct: BTreeSet<Vec<u64>> = o.observed().into_iter().map(bits).collect();
        distinct.len() == 1 && o.rows.len() > MAY_BE_ALIKE && !is_count(o)
    };
    let doubt = |o: &Observe| Doubt::Alike {
        observe: o.name.to_owned(),
        unit: o.unit.clone(),
        n: o.rows.len(),
        measured: in_words(&o.observed_row(0)),
    };
    model.observes.iter().filter(doubtful).map(doubt).collect()
}

/// What measurements simulated at draws from the prior tell. No replicate is kept: a table may have many rows.
struct Simulated<'m> {
    model: &'m Model,
    ids: &'m [RowId],
    /// What physical draws predict of each.
    expected: Vec<Expected>,
    /// Those of one quantity.
    groups: Vec<Group>,
}

/// Measurements of one quantity.
struct Group {
    /// Their numbers, ascending.
    own: Vec<usize>,
    /// How far their replicates lie apart, in each draw in which all have one.
    gaps: Vec<f64>,
}

/// Smallest and largest of the cells.
fn ends(cells: &[f64]) -> [f64; 2] {
    [cells[0], cells[cells.len() - 1]]
}

impl<'m> Simulated<'m> {
    fn new(
        model: &'m Model,
        ids: &'m [RowId],
        draws: &[Vec<f64>],
        table: &Measurements,
        physical: &Physical,
    ) -> Self {
        let mut rng = Stream::Expected.rng(1);
        let mut expected = vec![Expected::NONE; ids.len()];
        let mut groups = groups(model, ids, &draws[..draws.len().min(ALIKE)]);
        let vertices: Vec<Option<u32>> =
            ids.iter().map(|id| table.vertex(model.table_row(*id))).collect();
        let measured: Vec<Vec<f64>> = ids.iter().map(|id| model.measured_row(*id)).collect();
        let mut replicates = vec![None; ids.len()];
        let locals_of = |tape: &mut Tape, draw: &Vec<f64>| {
            let mut locals = vec![];
            model.locals_at(tape, draw, ids, &mut locals);
            locals
        };
        let some = draws.chunks(AT_ONCE).flat_map(|some| -> Vec<Vec<f64>> {
            some.par_iter().map_init(|| model.tape(), locals_of).collect()
        });
        for (d, locals) in some.enumerate() {
            let mut rest = locals.as_slice();
            for (i, id) in ids.iter().enumerate() {
                let (own, others) = rest.split_at(model.n_locals(*id));
                rest = others;
                let location = model.row_location(*id, own);
                let is_sound = own.iter().chain(&location).all(|x| x.is_finite());
                let replicate =
                    is_sound.then(|| ends(&model.row_replicate(*id, &measured[i], own, &mut rng)));
                replicates[i] = replicate.filter(|ends| ends.iter().all(|x| x.is_finite()));
                if vertices[i].is_none_or(|v| physical.is_at(v, d)) {
                    expected[i].add(replicates[i]);
                }
            }
            for group in &mut groups {
                let own: Option<Vec<[f64; 2]>> = group.own.iter().map(|i| replicates[*i]).collect();
                group.gaps.extend(own.map(|own| gap(&own)));
            }
        }
        Self { model, ids, expected, groups }
    }

    /// Measurements of one quantity that lie farther apart than replicates of them do.
    fn contradictions(&self, table: &Measurements) -> Vec<Doubt> {
        let groups = self.groups.iter().filter(|group| self.exclude_each_other(group));
        groups.map(|group| self.contradiction(&group.own, table)).collect()
    }

    fn exclude_each_other(&self, group: &Group) -> bool {
        let measured: Vec<[f64; 2]> = group.own.iter().map(|i| self.measured(*i)).collect();
        let mut gaps = group.gaps.clone();
        if gaps.len() < FEWEST {
            return false;
        }
        gaps.sort_by(f64::total_cmp);
        let (median, most) = (gaps[gaps.len() / 2], gaps[gaps.len() - 1]);
        let widths = measured.iter().map(|[low, high]| high - low).filter(|w| w.is_finite());
        let width = widths.fold(0.0, f64::max);
        gap(&measured) > most.max(0.0) + (most - median).max(width)
    }

    fn contradiction(&self, group: &[usize], table: &Measurements) -> Doubt {
        let row = |i: &usize| self.model.table_row(self.ids[*i]);
        let observe = &self.model.observes[self.ids[group[0]].observe];
        let named = || group.iter().take(MOST_NAMED);
        Doubt::Contradiction {
            place: format!("{} {}", observe.name, table.place(row(&group[0]))),
            unit: observe.unit.clone(),
            lines: named().map(|i| table.line(row(i))).collect(),
            measured: named().map(|i| in_words(&self.model.measured_row(self.ids[*i]))).collect(),
        }
    }

    /// For each statement its measurements that are far from what physical draws predict.
    fn out_of_range(&self, table: &Measurements) -> Vec<Doubt> {
        let of_observe = |o: usize| {
            let own = (0..self.ids.len()).filter(|i| self.ids[*i].observe == o);
            let is_told = |i: &usize| {
                let Expected { low, high, n } = self.expected[*i];
                n >= FEWEST && high > low
            };
            let far: Vec<usize> = own
                .filter(is_told)
                .filter(|i| !self.expected[*i].allows(self.measured(*i), 1.0))
                .collect();
            (!far.is_empty()).then(|| self.range(o, &far, table))
        };
        (0..self.model.observes.len()).filter_map(of_observe).collect()
    }

    fn measured(&self, i: usize) -> [f64; 2] {
        ends(&self.model.measured_row(self.ids[i]))
    }

    fn range(&self, o: usize, far: &[usize], table: &Measurements) -> Doubt {
        let observe = &self.model.observes[o];
        let measured = far.iter().map(|i| self.measured(*i));
        let expected = far.iter().map(|i| [self.expected[*i].low, self.expected[*i].high]);
        let allowed = |f: f64| far.iter().all(|i| self.expected[*i].allows(self.measured(*i), f));
        let line = |i: &usize| table.line(self.model.table_row(self.ids[*i]));
        Doubt::Range {
            observe: observe.name.to_owned(),
            unit: observe.unit.clone(),
            n: far.len(),
            of: observe.rows.len(),
            lines: far.iter().take(MOST_NAMED).map(line).collect(),
            measured: hull(measured),
            expected: hull(expected),
            factor: FACTORS.into_iter().find(|f| allowed(*f)),
        }
    }
}

/// The measurements that are predicted alike in these draws: of one statement, at the same value in each.
fn groups(model: &Model, ids: &[RowId], draws: &[Vec<f64>]) -> Vec<Group> {
    let (mut tape, mut locals) = (model.tape(), vec![]);
    let mut locations: Vec<Vec<u64>> = vec![vec![]; ids.len()];
    for draw in draws {
        model.locals_at(&mut tape, draw, ids, &mut locals);
        let mut rest = locals.as_slice();
        for (id, bits) in ids.iter().zip(&mut locations) {
            let (own, others) = rest.split_at(model.n_locals(*id));
            rest = others;
            bits.extend(model.row_location(*id, own).map(f64::to_bits));
        }
    }
    let mut alike: BTreeMap<(usize, &[u64]), Vec<usize>> = BTreeMap::new();
    for (i, (id, bits)) in ids.iter().zip(&locations).enumerate() {
        if bits.len() == ALIKE {
            alike.entry((id.observe, bits)).or_default().push(i);
        }
    }
    let several = alike.into_values().filter(|own| own.len() > 1);
    several.map(|own| Group { own, gaps: vec![] }).collect()
}

/// Smallest lower and largest upper end, infinite ones left out.
fn hull(all: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let finite = all.flatten().filter(|x| x.is_finite());
    finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}

/// How far the highest of some intervals lies above the lowest; negative if all have a point in common.
fn gap(all: &[[f64; 2]]) -> f64 {
    let highest = all.iter().map(|e| e[0]).fold(f64::NEG_INFINITY, f64::max);
    highest - all.iter().map(|e| e[1]).fold(f64::INFINITY, f64::min)
}

/// What physical draws predict of a measurement.
#[derive(Clone, Copy)]
struct Expected {
    low: f64,
    high: f64,
    /// Number of draws that predict anything.
    n: usize,
}

impl Expected {
    const NONE: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, n: 0 };

    /// Takes in the ends of a replicate, if there is one.
    fn add(&mut self, replicate: Option<[f64; 2]>) {
        if let Some([low, high]) = replicate {
            (self.low, self.high) = (self.low.min(low), self.high.max(high));
            self.n += 1;
        }
    }

    /// Whether a measurement, times `factor`, is near: within a factor of two for what is always
    /// positive, else within half of the spread.
    fn allows(&self, [low, high]: [f64; 2], factor: f64) -> bool {
        let (least, most) = if self.low > 0.0 {
            (0.5 * self.low, 2.0 * self.high)
        } else {
            let half = 0.5 * (self.high - self.low);
            (self.low - half, self.high + half)
        };
        high * factor >= least && low * factor <= most
    }
}

/// Where the draws are inside every declared range.
struct Physical {
    /// By vertex, one per draw; absent for a model without fields.
    at: BTreeMap<u32, Vec<bool>>,
}

impl Physical {
    fn new(model: &Model, loaded: &Loaded, draws: &[Vec<f64>]) -> Self {
        let vertices = loaded.measurements.vertices();
        let Some(basis) = loaded.basis() else { return Self { at: BTreeMap::new() } };
        let maps = Maps::new(model, basis);
        let names = maps.names();
        let indices: Vec<usize> = vertices.iter().map(|v| *v as usize).collect();
        let is_inside = |at: &[Vec<f64>], d: usize| {
            let mut maps = at.iter().zip(&names);
            maps.all(|(map, name)| {
                let range = name.range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
                range.0 <= map[d] && map[d] <= range.1
            })
        };
        let each = |at: Vec<Vec<f64>>| (0..draws.len()).map(|d| is_inside(&at, d)).collect();
        let inside: Vec<Vec<bool>> = maps.of_draws_at(draws, &indices, each);
        Self { at: vertices.into_iter().zip(inside).collect() }
    }

    fn is_at(&self, vertex: u32, draw: usize) -> bool {
        self.at.get(&vertex).is_none_or(|draws| draws[draw])
    }
}
