//! `path(row, n, lengthscale)`

use super::form::{EffectForm, Extent, Form};
use super::surface::Surface;
use crate::table::{Measurements, SOURCE};

#[derive(Debug)]
struct Path(Surface);

/// The integral of a field along the geodesic path from the vertex in the column `source`. The
/// field is as that of [`surface`](super::surface()).
pub fn path(modes: f64, lengthscale: f64) -> Form {
    Path(Surface { modes: modes as usize, lengthscale }).into()
}

impl EffectForm for Path {
    fn written(&self, number: fn(f64) -> String) -> String {
        format!("path(row, {}, {})", self.0.modes, number(self.0.lengthscale))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        self.0.of_modes(table, true)
    }
    fn also_requires(&self) -> Option<&str> {
        Some(SOURCE)
    }
    fn n_modes(&self) -> usize {
        self.0.modes
    }
    fn extent(&self) -> Extent {
        self.0.extent()
    }
    fn in_words(&self, on: &str) -> String {
        format!("a slowness that varies along the paths, in {on}")
    }
}
