//! Draws of a posterior to take parameters from.

use super::AtriumError;
use super::tissue::{Column, InRange, TissueFields};
use crate::report::FieldDraws;

/// Suffix of the fields that a draw takes the place of.
const MEAN: &str = "_mean";

/// Draws of a posterior to take parameters from.
#[derive(Debug)]
pub(super) struct Posterior {
    pub(super) draws: FieldDraws<'static>,
    /// How many of them are simulated.
    pub(super) n: usize,
}

impl Posterior {
    /// `n` of `draws`, checked against the surface.
    pub(super) fn new(
        draws: FieldDraws<'static>,
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
    pub(super) fn parameters(&self, tissue: &TissueFields, i: usize) -> InRange {
        let draw = i * self.draws.n_draws() / self.n;
        let drawn = |column: &Column| self.draws.at_vertices(self.field(column)?, draw);
        let columns = tissue.columns.each_ref().map(|c| (drawn(c), c));
        let at = |v: usize| {
            let value = |(drawn, column): &(Option<Vec<f64>>, &Column)| {
                drawn.as_ref().map_or_else(|| column.at(v), |values| values[v])
            };
            columns.each_ref().map(value)
        };
        InRange::of(tissue.refine((0..tissue.n_coarse).map(at).collect()))
    }
}
