//! Deviations of places as blocks beside the fields there: `group(row.site) ~ Normal(0, sd)`.

use super::blocks::{Block, gaussian};
use crate::infer::{BlockLayout, Shape};
use crate::model::laid_out::Model;
use crate::model::tape::Tape;

/// One deviation for each place, all with the same normal prior. Given the fields' values, the
/// deviations are what is left over. So they are whitened together with the fields: if the two were
/// moved in turn, neither could move far.
#[derive(Debug)]
pub(super) struct PlaceBlock {
    /// Which of the model's priors is theirs.
    pub(super) prior: usize,
    /// The first unknown, and the first value.
    u: usize,
    v: usize,
    /// Which of the deviations each place has.
    number: Vec<usize>,
    is_triangular: bool,
}

impl PlaceBlock {
    /// The deviations of the model whose places are those of all its fields, if the fields are in
    /// one group.
    pub(super) fn all(model: &Model, fields: &[Block]) -> Vec<Self> {
        let Some(first) = fields.first() else { return vec![] };
        let places = &model.fields[first.field].probes;
        if fields.iter().any(|block| block.at.0 > 0) {
            return vec![];
        }
        let all = model.spreads.iter().filter_map(|spread| {
            let number = |vertex: &u32| spread.vertices.iter().position(|own| own == vertex);
            let number: Option<Vec<usize>> = places.iter().map(number).collect();
            let entry = &model.prior_entries[spread.prior];
            Some(Self {
                prior: spread.prior,
                u: entry.u.start,
                v: entry.v,
                number: number.filter(|number| number.len() == entry.len)?,
                is_triangular: first.is_triangular,
            })
        });
        all.collect()
    }

    /// Number of places.
    pub(super) fn n(&self) -> usize {
        self.number.len()
    }

    pub(super) fn layout(&self) -> BlockLayout {
        let n = self.n();
        let one = |(i, j): (usize, usize)| f64::from(u8::from(i == j));
        let modes: Vec<f64> = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(one).collect();
        BlockLayout {
            n_coefficients: n,
            mean_precision: None,
            shape: if self.is_triangular { Shape::Triangular } else { Shape::Scaled(modes.into()) },
        }
    }

    /// Writes offset, rows and scale of the design.
    pub(super) fn set_design(
        &self,
        model: &Model,
        values: &[f64],
        (offset, rows, scale): (&mut f64, &mut [f64], &mut [f64]),
    ) {
        let prior = gaussian(model, self.prior, values);
        *offset = prior.location;
        scale.fill(prior.scale);
        for (place, row) in rows.chunks_exact_mut(self.n()).enumerate() {
            row[place] = prior.scale;
        }
    }

    /// Writes the values to where effects read them.
    pub(super) fn set_values(&self, theta: &[f64], t: &mut Tape) {
        for (theta, number) in theta.iter().zip(&self.number) {
            t.v[self.v + number] = *theta;
        }
    }

    /// Writes the value of one place.
    pub(super) fn set_value(&self, place: usize, theta: f64, t: &mut Tape) {
        t.v[self.v + self.number[place]] = theta;
    }

    /// The adjoints of the values at the places.
    pub(super) fn slopes(&self, t: &Tape, out: &mut [f64]) {
        for (out, number) in out.iter_mut().zip(&self.number) {
            *out = t.g[self.v + number];
        }
    }

    /// The deviations at a position of the model's unknowns.
    pub(super) fn coefficients(&self, position: &[f64], out: &mut [f64]) {
        for (out, number) in out.iter_mut().zip(&self.number) {
            *out = position[self.u + number];
        }
    }

    /// Writes the deviations into a position.
    pub(super) fn put(&self, coefficients: &[f64], position: &mut [f64]) {
        for (x, number) in coefficients.iter().zip(&self.number) {
            position[self.u + number] = *x;
        }
    }
}
