//! How rows are predicted from the others, with what shifts them integrated out.

use super::integral::Integrated;
use super::layout::{PartRow, Shifts};
use crate::model::blocked::Predictive;
use crate::model::local::RowId;
use crate::num::LN_SQRT_2PI;
use crate::num::vector::dot;
use crate::random::Stream;
use rand::RngExt as _;
use rand_distr::StandardNormal;
use rayon::prelude::*;

impl Shifts<'_> {
    /// As `Model::predictive`. Of y ~ N(μ, 1/W) at the coefficients' mean, of which the row has variance v by them, the others
    /// leave a residual (y − μ)/(1 − W v) and a variance 1/W/(1 − W v).
    pub(super) fn predictive(
        &self,
        draws: &[Vec<f64>],
        rows: &[RowId],
        seed: u64,
    ) -> Vec<Option<Predictive>> {
        let found = |id: &RowId| {
            let is_it = |row: &PartRow| row.id == [id.observe, id.row];
            self.parts
                .iter()
                .enumerate()
                .find_map(|(p, part)| Some((p, part.rows.iter().position(is_it)?)))
        };
        let places: Vec<Option<(usize, usize)>> = rows.iter().map(found).collect();
        let known: Vec<(usize, usize)> = places.iter().flatten().copied().collect();
        let told: Vec<Vec<[f64; 2]>> = draws
            .par_iter()
            .map_init(|| Integrated::new(self), |on, draw| on.left_out(draw, &known))
            .collect();
        let mut nth = 0..;
        let of_row = |(i, id): (usize, &RowId)| {
            places[i]?;
            let nth = nth.next()?;
            let y = self.model.observes[id.observe].op.observed_row(id.row)[0];
            let mut rng = Stream::WithoutRow { row: i }.rng(seed);
            let mut predictive = Predictive::default();
            for row in &told {
                let [residual, variance] = *row.get(nth)?;
                let ln_norm = -0.5 * variance.ln() - LN_SQRT_2PI;
                let ln_density = ln_norm - 0.5 * residual * residual / variance;
                predictive.ln_density.push(ln_density);
                predictive.ln_weight.push(-ln_density);
                let z: f64 = rng.sample(StandardNormal);
                predictive.replicates.push(y - residual + variance.sqrt() * z);
            }
            Some(predictive)
        };
        rows.iter().enumerate().map(of_row).collect()
    }
}

impl Integrated<'_> {
    /// Residual and variance that the other rows leave each of these, (part, row), at a position; nothing where there is no integral.
    fn left_out(&mut self, position: &[f64], rows: &[(usize, usize)]) -> Vec<[f64; 2]> {
        if !self.value_at(position).is_finite() {
            return vec![];
        }
        self.set_mean(position);
        let Some(known) = &self.known else { return vec![] };
        let one = |(p, row): &(usize, usize)| {
            let (part, factor) = (&self.of.parts[*p], &known.factors[*p]);
            let [slope, w] = part.rows[*row].normal(self.of.model, &self.tape);
            let design = &part.design[row * part.of.len()..][..part.of.len()];
            let mut x: Vec<f64> =
                part.of.iter().zip(design).map(|(j, d)| known.c[*j] * d).collect();
            factor.solve(&mut x);
            let left = 1.0 - w * dot::<4>(&x, &x);
            [slope / w / left, 1.0 / w / left]
        };
        rows.iter().map(one).collect()
    }
}
