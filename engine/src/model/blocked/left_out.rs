//! How each measurement is predicted from the others, from draws of the posterior that has seen it.

use super::Sampler;
use super::blocks::Blocks;
use crate::infer::without_rows;
use crate::model::laid_out::Model;
use crate::model::local::RowId;
use crate::random::Stream;

/// What is predicted of a row from the others at points of the other unknowns, with the coefficients of fields integrated out, or
/// with what shifts arrival times.
#[derive(Clone, Debug, Default)]
pub struct Predictive {
    /// ln of its density at the measurement.
    pub ln_density: Vec<f64>,
    /// ln of the weights that make the points those of the posterior without the row, but for a constant.
    pub ln_weight: Vec<f64>,
    /// Replicates of the measurement; of a bracket its lower end.
    pub replicates: Vec<f64>,
}

impl Model {
    /// What is predicted of these rows from the others, by `draws` of the unknowns given all rows, each `(dim)`. `None` for
    /// rows of which this cannot be told.
    pub fn predictive(
        &self,
        draws: &[Vec<f64>],
        rows: &[RowId],
        seed: u64,
    ) -> Vec<Option<Predictive>> {
        if let Some(told) = self.predictive_without_shifts(draws, rows, seed) {
            return told;
        }
        let mut out = vec![None; rows.len()];
        if !Sampler::Blocked.takes(self) {
            return out;
        }
        let blocks = Blocks::new(self);
        let wanted = |[observe, row]: &[usize; 2]| {
            rows.iter().position(|id| [id.observe, id.row] == [*observe, *row])
        };
        let mut places = vec![];
        for (group, own) in blocks.rows.iter().enumerate() {
            let has_wanted =
                |(_, rows): &(usize, &Vec<[usize; 2]>)| rows.iter().any(|id| wanted(id).is_some());
            places
                .extend(own.iter().enumerate().filter(has_wanted).map(|(place, _)| [group, place]));
        }
        let told = without_rows(&blocks, draws, &places, seed);
        let mut on = blocks.on_tape();
        for (p, [group, place]) in places.iter().enumerate() {
            for (k, id) in blocks.rows[*group][*place].iter().enumerate() {
                let Some(i) = wanted(id) else { continue };
                let op = &self.observes[id[0]].op;
                let cells = op.observed_row(id[1]);
                let mut rng = Stream::WithoutRow { row: i }.rng(seed);
                let mut predictive = Predictive::default();
                for (outer, rows) in told.outer.iter().zip(&told.rows) {
                    let row = rows[p].get(k).filter(|row| row.ln_weight > f64::NEG_INFINITY);
                    let Some(row) = row else { continue };
                    on.forward(outer);
                    on.set_place(*group, *place, &row.theta);
                    let local =
                        |(value, offset): (usize, usize)| on.tape.v[value] + on.tape.v[offset];
                    let locals: Vec<f64> = op.locals(id[1]).into_iter().map(local).collect();
                    predictive.ln_density.push(row.ln_density);
                    predictive.ln_weight.push(row.ln_weight);
                    predictive.replicates.push(op.replicate(id[1], &cells, &locals, &mut rng)[0]);
                }
                out[i] = (!predictive.ln_density.is_empty()).then_some(predictive);
            }
        }
        out
    }
}
