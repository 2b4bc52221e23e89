//! `surface(row, n, lengthscale)`

use super::form::{EffectForm, Extent, Form};
use crate::field::{Kernel as _, Matern32};
use crate::table::Measurements;

/// A field of unit amplitude by its first modes.
#[derive(Debug)]
pub(super) struct Surface {
    pub(super) modes: usize,
    /// mm
    pub(super) lengthscale: f64,
}

/// The value of a field at the row's place. The field has a Matérn-3/2 kernel of that lengthscale
/// in mm, and the first `modes` modes of the surface.
pub fn surface(modes: f64, lengthscale: f64) -> Form {
    Surface { modes: modes as usize, lengthscale }.into()
}

impl EffectForm for Surface {
    fn written(&self, number: fn(f64) -> String) -> String {
        format!("surface(row, {}, {})", self.modes, number(self.lengthscale))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        self.of_modes(table, false)
    }
    fn n_modes(&self) -> usize {
        self.modes
    }
    fn extent(&self) -> Extent {
        Extent::Sd("sd over the measurements".into())
    }
    fn in_words(&self, on: &str) -> String {
        format!("a field over the surface in {on}")
    }
}

impl Surface {
    /// The design of the field at each row, or, if `along` paths, of its integral.
    pub(super) fn of_modes(&self, table: &Measurements, along: bool) -> (Vec<f64>, usize) {
        let Some(probes) = table.probes() else { return (vec![], self.modes) };
        let kernel = Matern32(self.lengthscale);
        let frequencies = probes.frequencies().iter().take(self.modes);
        let root: Vec<f64> = frequencies.map(|w| kernel.sqrt_density(*w)).collect();
        let rows = probes.modes(along).chunks_exact(probes.n_modes().max(1));
        let design =
            rows.flat_map(|row| row.iter().zip(&root).map(|(phi, root)| phi * root)).collect();
        (design, self.modes)
    }
}
