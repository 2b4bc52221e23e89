//! Arrival times corrected by those on finer triangles.
//!
//! ```text
//! T(x) = T_rough(x) + mean over k of [T_fine(xₖ) − T_rough(xₖ)]
//! ```
//! `T_rough` is computed for every draw, on a triangulation of some 1,000 vertices, and off by two milliseconds where there are
//! fibres. With one x₀ the corrected times there are those of the finer triangles; away from it they are off by as much as the
//! difference has changed since. So a run begins with the x₀ that climbs lead to. Once its chains are where the posterior is, it takes
//! some of their draws: then times are off least in the middle of the posterior.

use std::sync::PoisonError;

use rayon::prelude::*;

use super::error::ModelError;
use super::laid_out::{Correction, Model};
use super::operator::Off;
use crate::table::ProbeError;

impl Model {
    /// Corrects arrival times by the mean of what they are off by at these unknowns. What they were corrected by before is forgotten. A
    /// model without arrival times stays as it is. Unknowns that are no tissue, such as NaN, are left out.
    ///
    /// # Errors
    /// [`ModelError::Surface`] for a fibre of the surface that has no direction in it.
    pub fn correct_at(&mut self, at: &[Vec<f64>]) -> Result<(), ModelError> {
        self.correct(at)?;
        Ok(())
    }

    /// Corrects arrival times where those of `fitted` are, the same model on other rows. Unknowns that `fitted` lacks are
    /// at a typical value.
    ///
    /// # Errors
    /// Those of [`Model::correct_at`].
    pub fn correct_as(&mut self, fitted: &Self) -> Result<(), ModelError> {
        let (from, initial) = (self.unknowns_in(fitted), self.initial());
        let own = |at: Vec<f64>| {
            let from = from.iter().zip(&initial);
            from.map(|(from, own)| from.map_or(*own, |i| at[i])).collect()
        };
        let at: Vec<Vec<f64>> = fitted.corrected_at().into_iter().map(own).collect();
        self.correct_at(&at)
    }

    /// Corrects arrival times at these draws, if they are corrected elsewhere so far. Returns whether it did. Evaluators that
    /// were made before are of no use then.
    pub(super) fn correct_at_draws(&self, draws: &[Vec<f64>]) -> bool {
        let at = self.corrected_at();
        // what can be wrong with a surface was found when it was corrected for the first time
        !at.is_empty() && at != draws && self.correct(draws).unwrap_or(false)
    }

    /// Whether there was something to correct.
    fn correct(&self, at: &[Vec<f64>]) -> Result<bool, ProbeError> {
        let off = |at: &Vec<f64>| {
            let mut t = self.tape();
            self.forward(&mut t, at);
            self.over.iter().map(|over| over.off(&t)).collect()
        };
        let off: Vec<Vec<Option<Off>>> = at.par_iter().map(off).collect::<Result<_, _>>()?;
        let mut n_vertices = None;
        for (k, over) in self.over.iter().enumerate() {
            let known: Vec<&Off> = off.iter().filter_map(|off| off[k].as_ref()).collect();
            let Some(first) = known.first() else { continue };
            n_vertices = Some(first.n_vertices);
            over.operator.correct(Off::mean(&known));
        }
        let Some(n_vertices) = n_vertices else { return Ok(false) };
        let is_tissue = |off: &Vec<Option<Off>>| off.iter().any(Option::is_some);
        let at = at.iter().zip(&off).filter(|(_, off)| is_tissue(off));
        let made = Correction { at: at.map(|(at, _)| at.clone()).collect(), n_vertices };
        *self.correction.write().unwrap_or_else(PoisonError::into_inner) = Some(made);
        Ok(true)
    }

    /// Where a climb begins: where arrival times were corrected, else at [`Model::initial`].
    pub fn climbs_from(&self) -> Vec<f64> {
        self.corrected_at().into_iter().next().unwrap_or_else(|| self.initial())
    }

    /// The unknowns that arrival times were corrected at, each `(dim)`; none if they were not corrected.
    pub fn corrected_at(&self) -> Vec<Vec<f64>> {
        self.of_correction(|correction| correction.at.clone()).unwrap_or_default()
    }

    /// Number of vertices of the triangles that arrival times were corrected by.
    pub fn n_finer(&self) -> Option<usize> {
        self.of_correction(|correction| correction.n_vertices)
    }

    fn of_correction<T>(&self, get: impl Fn(&Correction) -> T) -> Option<T> {
        self.correction.read().unwrap_or_else(PoisonError::into_inner).as_ref().map(get)
    }
}
