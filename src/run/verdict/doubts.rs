//! What is wrong with measurements before anything is sampled: they exclude each other, are all the same,
//! or lie far from everything that the model can mean.
//!
//! The first and the last are told by a comparison with measurements simulated at draws from the prior.

use std::collections::{BTreeMap, BTreeSet};

use super::fits::in_words;
use crate::diagnostics::verdict::Doubt;
use crate::model::{Maps, Model, Observe, RowId};
use crate::random::Stream;
use crate::run::Loaded;
use crate::table::Measurements;

/// Draws from the prior.
const DRAWS: usize = 400;
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
    let simulated = Simulated::new(model, &ids, &draws);
    let physical = Physical::new(model, loaded, &draws);
    let mut found = simulated.contradictions(&loaded.measurements);
    found.extend(simulated.out_of_range(&loaded.measurements, &physical));
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

/// Measurements simulated at draws from the prior.
struct Simulated<'m> {
    model: &'m Model,
    ids: &'m [RowId],
    /// Ends of each measurement's replicates (measurement, draw); `None` where nothing is predicted.
    replicates: Vec<Vec<Option<[f64; 2]>>>,
    /// The predicted value of each measurement in the first draws, as bits.
    locations: Vec<Vec<u64>>,
}

/// Smallest and largest of the cells.
fn ends(cells: &[f64]) -> [f64; 2] {
    [cells[0], cells[cells.len() - 1]]
}

impl<'m> Simulated<'m> {
    fn new(model: &'m Model, ids: &'m [RowId], draws: &[Vec<f64>]) -> Self {
        let mut rng = Stream::Expected.rng(1);
        let (mut tape, mut locals) = (model.tape(), vec![]);
        let mut replicates = vec![Vec::with_capacity(draws.len()); ids.len()];
        let mut locations = vec![vec![]; ids.len()];
        let measured: Vec<Vec<f64>> = ids.iter().map(|id| model.measured_row(*id)).collect();
        for (d, draw) in draws.iter().enumerate() {
            model.locals_at(&mut tape, draw, ids, &mut locals);
            let mut rest = locals.as_slice();
            for (i, id) in ids.iter().enumerate() {
                let (own, others) = rest.split_at(model.n_locals(*id));
                rest = others;
                let location = model.row_location(*id, own);
                if let (true, Some(x)) = (d < ALIKE, location) {
                    locations[i].push(x.to_bits());
                }
                let is_sound = own.iter().chain(&location).all(|x| x.is_finite());
                let replicate =
                    is_sound.then(|| ends(&model.row_replicate(*id, &measured[i], own, &mut rng)));
                replicates[i].push(replicate.filter(|ends| ends.iter().all(|x| x.is_finite())));
            }
        }
        Self { model, ids, replicates, locations }
    }

    /// Measurements of one quantity that lie farther apart than replicates of them do.
    fn contradictions(&self, table: &Measurements) -> Vec<Doubt> {
        let mut alike: BTreeMap<(usize, &[u64]), Vec<usize>> = BTreeMap::new();
        for (i, (id, bits)) in self.ids.iter().zip(&self.locations).enumerate() {
            if bits.len() == ALIKE {
                alike.entry((id.observe, bits)).or_default().push(i);
            }
        }
        let groups = alike.into_values().filter(|group| group.len() > 1);
        groups
            .filter(|group| self.exclude_each_other(group))
            .map(|g| self.contradiction(&g, table))
            .collect()
    }

    fn exclude_each_other(&self, group: &[usize]) -> bool {
        let measured = group.iter().map(|i| ends(&self.model.measured_row(self.ids[*i])));
        let measured: Vec<[f64; 2]> = measured.collect();
        let in_draw = |d: usize| {
            let own: Option<Vec<[f64; 2]>> = group.iter().map(|i| self.replicates[*i][d]).collect();
            own.map(|own| gap(&own))
        };
        let mut gaps: Vec<f64> = (0..DRAWS).filter_map(in_draw).collect();
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
    fn out_of_range(&self, table: &Measurements, physical: &Physical) -> Vec<Doubt> {
        let of_observe = |o: usize| {
            let own = (0..self.ids.len()).filter(|i| self.ids[*i].observe == o);
            let ranges: Vec<(usize, Expected)> =
                own.filter_map(|i| Some((i, self.expected(i, table, physical)?))).collect();
            let far: Vec<&(usize, Expected)> =
                ranges.iter().filter(|(i, range)| !range.allows(self.measured(*i), 1.0)).collect();
            (!far.is_empty()).then(|| self.range(o, &far, table))
        };
        (0..self.model.observes.len()).filter_map(of_observe).collect()
    }

    fn measured(&self, i: usize) -> [f64; 2] {
        ends(&self.model.measured_row(self.ids[i]))
    }

    fn expected(&self, i: usize, table: &Measurements, physical: &Physical) -> Option<Expected> {
        let vertex = table.vertex(self.model.table_row(self.ids[i]));
        let draws = self.replicates[i].iter().enumerate();
        let sound = draws.filter(|(d, _)| vertex.is_none_or(|v| physical.is_at(v, *d)));
        let ends: Vec<[f64; 2]> = sound.filter_map(|(_, replicate)| *replicate).collect();
        let low = ends.iter().map(|e| e[0]).fold(f64::INFINITY, f64::min);
        let high = ends.iter().map(|e| e[1]).fold(f64::NEG_INFINITY, f64::max);
        (ends.len() >= FEWEST && high > low).then_some(Expected { low, high })
    }

    fn range(&self, o: usize, far: &[&(usize, Expected)], table: &Measurements) -> Doubt {
        let observe = &self.model.observes[o];
        let measured = far.iter().map(|(i, _)| self.measured(*i));
        let allowed = |f: f64| far.iter().all(|(i, range)| range.allows(self.measured(*i), f));
        let line = |(i, _): &&(usize, Expected)| table.line(self.model.table_row(self.ids[*i]));
        Doubt::Range {
            observe: observe.name.to_owned(),
            unit: observe.unit.clone(),
            n: far.len(),
            of: observe.rows.len(),
            lines: far.iter().take(MOST_NAMED).map(line).collect(),
            measured: hull(measured),
            expected: hull(far.iter().map(|(_, range)| [range.low, range.high])),
            factor: FACTORS.into_iter().find(|f| allowed(*f)),
        }
    }
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
struct Expected {
    low: f64,
    high: f64,
}

impl Expected {
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
        let draws: Vec<&[f64]> = draws.iter().map(Vec::as_slice).collect();
        let indices: Vec<usize> = vertices.iter().map(|v| *v as usize).collect();
        let values = maps.draws_at(&draws, &indices);
        let is_inside = |at: &[Vec<f64>], d: usize| {
            let mut maps = at.iter().zip(&names);
            maps.all(|(map, name)| {
                let range = name.range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
                range.0 <= map[d] && map[d] <= range.1
            })
        };
        let each = |at: &Vec<Vec<f64>>| (0..draws.len()).map(|d| is_inside(at, d)).collect();
        Self { at: vertices.into_iter().zip(values.iter().map(each)).collect() }
    }

    fn is_at(&self, vertex: u32, draw: usize) -> bool {
        self.at.get(&vertex).is_none_or(|draws| draws[draw])
    }
}
