//! Draws of a posterior to take parameters from.

use super::AtriumError;
use super::tissue::{Column, TissueFields};
use crate::ep::Parameters;
use crate::ep::cell::RANGES;
use crate::report::FieldDraws;

/// Suffix of the fields that a draw takes the place of.
const MEAN: &str = "_mean";

/// Draws of a posterior to take parameters from.
#[derive(Debug)]
pub(super) struct Posterior {
    pub(super) draws: FieldDraws,
    /// How many of them are simulated.
    pub(super) n: usize,
}

/// Parameters at every vertex.
pub(super) struct Drawn {
    pub(super) parameters: Vec<Parameters>,
    /// Where they were in their valid ranges; elsewhere they are the nearest valid ones.
    pub(super) in_range: Vec<bool>,
}

impl Posterior {
    /// `n` of `draws`, checked against the surface.
    pub(super) fn new(
        draws: FieldDraws,
        n: usize,
        tissue: &TissueFields,
    ) -> Result<Self, AtriumError> {
        let (kept, n_vertices) = (draws.n_draws(), draws.n_vertices());
        if kept < n || n_vertices != tissue.n_coarse {
            let expected = tissue.n_coarse;
            return Err(AtriumError::Draws { asked: n, kept, n_vertices, expected });
        }
        let posterior = Self { draws, n };
        if posterior.drawn(tissue).is_empty() {
            let drawn = posterior.draws.coefficients.keys().cloned().collect();
            return Err(AtriumError::NothingDrawn { asked: n, drawn });
        }
        Ok(posterior)
    }

    /// Names of the fields whose draws take the place of a column.
    pub(super) fn drawn<'c>(&self, tissue: &'c TissueFields) -> Vec<&'c str> {
        tissue.columns.iter().filter_map(|column| self.field(column)).collect()
    }

    /// The field whose draws take the place of a column, if there are some.
    fn field<'c>(&self, column: &'c Column) -> Option<&'c str> {
        let Column::Field { name, .. } = column else { return None };
        name.strip_suffix(MEAN).filter(|name| self.draws.coefficients.contains_key(*name))
    }

    /// The parameters of draw `i` of `n`, evenly spaced over those that were kept.
    pub(super) fn parameters(&self, tissue: &TissueFields, i: usize) -> Drawn {
        let draw = i * self.draws.n_draws() / self.n;
        let drawn = |column: &Column| self.draws.at_vertices(self.field(column)?, draw);
        let columns = tissue.columns.each_ref().map(|c| (drawn(c), c));
        let at = |v: usize| {
            let value = |(drawn, column): &(Option<Vec<f64>>, &Column)| {
                drawn.as_ref().map_or_else(|| column.at(v), |values| values[v])
            };
            columns.each_ref().map(value)
        };
        let parameters = tissue.refine((0..tissue.n_coarse).map(at).collect());
        let in_range = parameters.iter().map(|p| p.validate().is_ok()).collect();
        Drawn { parameters: parameters.into_iter().map(nearest).collect(), in_range }
    }
}

/// The nearest parameters in their valid ranges.
fn nearest(parameters: Parameters) -> Parameters {
    let mut values = parameters.to_array();
    for (value, (_, _, low, high)) in values.iter_mut().zip(RANGES) {
        *value = value.clamp(low, high);
    }
    Parameters::from_array(values)
}
