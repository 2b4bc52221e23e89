//! All maps at one vertex in every draw, in columns.

use pulp::Arch;

use super::laid_out::Model;
use super::map::Source;
use crate::num::vector::axpy;

/// What maps read of some draws.
pub(super) struct Draws {
    /// The value vector of each, as far as maps read it.
    pub(super) v: Vec<Vec<f64>>,
    pub(super) fields: Vec<Coefficients>,
}

/// Of a field in every draw: the mean of its sum, and the weights of its modes `(mode, draw)`.
pub(super) struct Coefficients {
    pub(super) mean: Vec<f64>,
    pub(super) weights: Vec<f64>,
}

impl Coefficients {
    /// The sum at a place of these modes in every draw. The modes come one after the other, so that draws share
    /// vector registers.
    #[inline(always)]
    fn sums(&self, modes: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&self.mean);
        for (weights, mode) in self.weights.chunks_exact(out.len().max(1)).zip(modes) {
            axpy(*mode, weights, out);
        }
    }
}

/// All maps at a vertex.
pub(super) struct Here {
    /// `(map, draw)`; derived quantities are NaN where unphysical.
    pub(super) values: Vec<Vec<f64>>,
    /// Number of draws in which each map is outside its range, and in which any is.
    pub(super) outside: Vec<usize>,
    pub(super) unphysical: usize,
}

impl Model {
    /// Derived quantities at one place, from the sums of the fields there. They are NaN if a field
    /// or a derived quantity is outside its declared range, because a surrogate means nothing
    /// there. `outside` gets, for each field and derived quantity, whether it is outside its own
    /// range.
    pub(super) fn derived_at(
        &self,
        v: &[f64],
        sums: &[f64],
        scratch: &mut Vec<f64>,
        out: &mut [f64],
        outside: &mut [bool],
    ) {
        let (of_fields, of_lets) = outside.split_at_mut(self.fields.len());
        for ((field, sum), outside) in self.fields.iter().zip(sums).zip(of_fields.iter_mut()) {
            *outside = !within(field.value(*sum), field.range);
        }
        for ((map, out), outside) in self.maps.iter().zip(out.iter_mut()).zip(of_lets.iter_mut()) {
            scratch.clear();
            scratch.extend(map.sources.iter().map(|source| match *source {
                Source::Value(at) => v[at],
                Source::Field(field) => sums[field],
            }));
            *out = map.at.value(scratch, None);
            *outside = !within(*out, map.range);
        }
        let labels = self.fields.iter().map(|f| f.label);
        let labels = labels.chain(self.maps.iter().map(|m| m.label));
        for (label, _) in labels.zip(outside.iter()).filter(|(_, outside)| **outside) {
            for (map, out) in self.maps.iter().zip(out.iter_mut()) {
                if label.is_none() || map.label.is_none() || label == map.label {
                    *out = f64::NAN;
                }
            }
        }
    }

    /// What maps read of these draws of the unknowns.
    pub(super) fn read_by_maps(&self, draws: &[Vec<f64>]) -> Draws {
        let mut t = self.tape();
        let read = self.maps.iter().flat_map(|map| &map.sources).map(|source| match *source {
            Source::Value(at) => at + 1,
            Source::Field(_) => 0,
        });
        let n_values = read.max().unwrap_or(0);
        let n = draws.len();
        let room = |k| Coefficients { mean: vec![0.0; n], weights: vec![0.0; k * n] };
        let mut fields: Vec<Coefficients> = self.fields.iter().map(|f| room(f.op.k)).collect();
        let mut one = |(draw, u): (usize, &Vec<f64>)| {
            self.forward_fields(&mut t, u);
            for (own, field) in fields.iter_mut().zip(&self.fields) {
                let (mean, w) = field.op.weights(&t);
                own.mean[draw] = mean;
                own.weights.iter_mut().skip(draw).step_by(n).zip(w).for_each(|(to, w)| *to = *w);
            }
            t.v[..n_values].to_vec()
        };
        let v = draws.iter().enumerate().map(&mut one).collect();
        Draws { v, fields }
    }

    /// All maps at a vertex with these modes in every draw.
    pub(super) fn maps_at(&self, phi: &[f64], draws: &Draws) -> Here {
        Arch::new().dispatch(|| self.maps_by_lanes(phi, draws))
    }

    #[inline(always)]
    fn maps_by_lanes(&self, phi: &[f64], draws: &Draws) -> Here {
        let n_fields = self.fields.len();
        let n = n_fields + self.maps.len();
        let mut here =
            Here { values: vec![vec![0.0; draws.v.len()]; n], outside: vec![0; n], unphysical: 0 };
        let (fields, lets) = here.values.split_at_mut(n_fields);
        for ((sums, own), entry) in fields.iter_mut().zip(&draws.fields).zip(&self.fields) {
            own.sums(&phi[entry.first..][..entry.op.k], sums);
        }
        let (mut at, mut derived) = (vec![0.0; n_fields], vec![0.0; lets.len()]);
        let (mut scratch, mut outside) = (vec![], vec![false; n]);
        for (draw, v) in draws.v.iter().enumerate() {
            at.iter_mut().zip(&*fields).for_each(|(sum, sums)| *sum = sums[draw]);
            self.derived_at(v, &at, &mut scratch, &mut derived, &mut outside);
            lets.iter_mut().zip(&derived).for_each(|(to, x)| to[draw] = *x);
            here.unphysical += usize::from(outside.contains(&true));
            here.outside.iter_mut().zip(&outside).for_each(|(n, o)| *n += usize::from(*o));
        }
        for (values, entry) in fields.iter_mut().zip(&self.fields) {
            for x in values.iter_mut() {
                *x = entry.value(*x);
            }
        }
        here
    }
}

fn within(x: f64, range: Option<(f64, f64)>) -> bool {
    range.is_none_or(|(low, high)| (low..=high).contains(&x))
}
