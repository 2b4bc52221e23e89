//! A strip for every row of a table of parameters.

use super::{CurveRow, OutcomeRow};
use crate::ep::cell::OutOfRange;
use crate::ep::{Grid, Parameters, Protocol, StripError, StripOutcome, simulate_strips};

/// What strips did, a row for each set of parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct StripTable {
    /// In the order of the parameters; a set out of range has no outcome, and the reason in its place.
    pub rows: Vec<OutcomeRow>,
    /// Every beat of every strip's restitution curve, if the protocol asks for one.
    pub curves: Vec<CurveRow>,
    /// How many sets were out of range and not simulated.
    pub n_refused: usize,
}

/// S2 of the beats of a restitution curve, ms.
pub fn curve_intervals() -> Vec<u32> {
    (200..=600).step_by(20).collect()
}

impl StripTable {
    /// Runs `protocol` on a strip of each set of `parameters` that is in range; `progress` is told how
    /// many further strips are done.
    ///
    /// # Errors
    /// A protocol that cannot be paced, or an impossible strip.
    pub fn simulate(
        parameters: &[Parameters],
        grid: &Grid,
        protocol: &Protocol,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Self, StripError> {
        let checked: Vec<Result<_, OutOfRange>> =
            parameters.iter().map(|p| p.validate().map(|()| p.tissue())).collect();
        let tissues: Vec<_> = checked.iter().flatten().copied().collect();
        let mut simulated = simulate_strips(&tissues, grid, protocol, progress)?.into_iter();
        let outcomes: Vec<Result<StripOutcome, OutOfRange>> = checked
            .into_iter()
            .map_while(|tissue| match tissue {
                Ok(_) => simulated.next().map(Ok),
                Err(out_of_range) => Some(Err(out_of_range)),
            })
            .collect();
        let numbered = parameters.iter().zip(&outcomes).enumerate();
        let rows = numbered.map(|(i, (p, outcome))| OutcomeRow::new(i, *p, outcome)).collect();
        let curves = outcomes.iter().enumerate().flat_map(|(row, outcome)| {
            let beats = outcome.iter().flat_map(|o| &o.restitution);
            beats.map(move |(s2, beat)| CurveRow::new(row, *s2, *beat))
        });
        let n_refused = outcomes.iter().filter(|outcome| outcome.is_err()).count();
        Ok(Self { rows, curves: curves.collect(), n_refused })
    }

    /// How many rows have no `ERP_S3`.
    pub fn n_without_erp_s3(&self) -> usize {
        self.rows.iter().filter(|row| row.erp_s3_ms.is_none()).count()
    }
}
