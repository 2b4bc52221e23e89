//! How each measurement is predicted from the others, from draws of the posterior that has seen it.

use super::Sampler;
use super::blocks::Blocks;
use crate::infer::{RowWithout, without_rows};
use crate::model::laid_out::Model;
use crate::model::local::RowId;
use crate::random::Stream;

/// The model is not asked if its blocks have more latent values than this: each draw takes the square of them.
const MOST_LATENT: usize = 200;

/// What is predicted of a row from the others in each draw, with the coefficients of fields integrated out, or with what shifts
/// arrival times.
#[derive(Clone, Debug, Default)]
pub struct Predictive {
    /// ln of its density at the measurement.
    pub ln_density: Vec<f64>,
    /// Replicates of the measurement; of a bracket its lower end.
    pub replicates: Vec<f64>,
}

impl Model {
    /// What is predicted of these rows from the others, in each of `draws` of the unknowns, each `(dim)`. Importance
    /// weights `1/density` make the draws those of the posterior without the row. `None` for rows of which this
    /// cannot be told.
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
        if blocks.layout.n_latent() > MOST_LATENT {
            return out;
        }
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
                for (draw, rows) in draws.iter().zip(&told) {
                    let Some(RowWithout { ln_density, theta }) = rows[p].get(k) else { continue };
                    on.forward(&blocks.layout.outer_of(draw));
                    on.set_place(*group, *place, theta);
                    let local =
                        |(value, offset): (usize, usize)| on.tape.v[value] + on.tape.v[offset];
                    let locals: Vec<f64> = op.locals(id[1]).into_iter().map(local).collect();
                    predictive.ln_density.push(*ln_density);
                    predictive.replicates.push(op.replicate(id[1], &cells, &locals, &mut rng)[0]);
                }
                // the weights are those of all draws, or of none
                out[i] = (predictive.ln_density.len() == draws.len()).then_some(predictive);
            }
        }
        out
    }
}
