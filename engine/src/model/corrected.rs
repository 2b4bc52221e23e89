//! Arrival times corrected by those on finer triangles.
//!
//! ```text
//! T(x) = T_rough(x) + T_fine(x₀) − T_rough(x₀)
//! ```
//! `T_rough` is computed for every draw, on a triangulation of some 1,000 vertices, and off by two milliseconds where there are
//! fibres. At x₀ the corrected times are those of the finer triangles; away from there they are off by as much as the difference has
//! changed since, which is less the nearer x₀ is. So x₀ is to be near the posterior's draws.

use super::error::ModelError;
use super::laid_out::{Correction, Model};

impl Model {
    /// Corrects arrival times at these unknowns. What they were corrected by before is forgotten. A model without arrival times
    /// stays as it is, and so do times at unknowns that are no tissue, such as NaN.
    ///
    /// # Errors
    /// [`ModelError::Surface`] for a fibre of the surface that has no direction in it.
    pub fn correct_at(&mut self, at: &[f64]) -> Result<(), ModelError> {
        let mut t = self.tape();
        self.forward(&mut t, at);
        for over in &mut self.over {
            if let Some(n_vertices) = over.correct(&t)? {
                self.correction = Some(Correction { at: at.to_vec(), n_vertices });
            }
        }
        Ok(())
    }

    /// Corrects arrival times where those of `fitted` are, the same model on other rows. Unknowns that `fitted` lacks are
    /// at a typical value.
    ///
    /// # Errors
    /// Those of [`Model::correct_at`].
    pub fn correct_as(&mut self, fitted: &Self) -> Result<(), ModelError> {
        let Some(Correction { at, .. }) = &fitted.correction else { return Ok(()) };
        let from = self.unknowns_in(fitted).into_iter().zip(self.initial());
        let at: Vec<f64> = from.map(|(from, own)| from.map_or(own, |i| at[i])).collect();
        self.correct_at(&at)
    }

    /// Where a climb begins: where arrival times were corrected, else at [`Model::initial`].
    pub fn climbs_from(&self) -> Vec<f64> {
        self.corrected_at().map_or_else(|| self.initial(), <[f64]>::to_vec)
    }

    /// Where arrival times are those of finer triangles; `None` if they were not corrected.
    pub fn corrected_at(&self) -> Option<&[f64]> {
        self.correction.as_ref().map(|correction| &correction.at[..])
    }

    /// Number of vertices of the triangles that arrival times were corrected by.
    pub fn n_finer(&self) -> Option<usize> {
        self.correction.as_ref().map(|correction| correction.n_vertices)
    }
}
