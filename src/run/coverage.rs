//! Whether a table suffices for a model, before anything is computed on its surface.

use crate::manifold::Basis;
use crate::mesh::Surface;
use crate::model::{Declare, Model};
use crate::table::Measurements;

/// What a table has for a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// Name and number of rows of each `observe` that has any.
    pub observes: Vec<(String, usize)>,
    /// What is missing, in a line; nothing if the model can be run.
    pub missing: Option<String>,
}

/// What `table`, which may not be placed yet, has for `model` on a surface, in whose file's unit (mm each)
/// places are. `None` where no row is of a protocol of the
/// model, so that the two have nothing to do with each other.
///
/// The model is laid out as for a run, on a basis of made-up numbers: what it reads of the table does not
/// depend on them.
pub fn coverage(
    model: &dyn Declare,
    surface: Option<(&Surface, f64)>,
    table: &Measurements,
) -> Option<Coverage> {
    let outline = Model::outline(model).ok()?;
    let readers = outline.readers();
    if !table.has(crate::table::PROTOCOL) || readers.is_empty() {
        return None;
    }
    let observes: Vec<(String, usize)> = readers
        .iter()
        .map(|name| ((*name).to_owned(), table.rows_of(name).len()))
        .filter(|(_, n)| *n > 0)
        .collect();
    if observes.is_empty() {
        return None;
    }
    let missing = laid_out(model, &outline, surface, table).err();
    Some(Coverage { observes, missing })
}

/// Lays the model out; the error is the first line of the complaint.
fn laid_out(
    model: &dyn Declare,
    outline: &Model,
    surface: Option<(&Surface, f64)>,
    table: &Measurements,
) -> Result<(), String> {
    let first = |text: String| text.lines().next().unwrap_or_default().to_owned();
    let mut table = table.clone();
    let readers = outline.readers();
    table.drop_unread(&readers);
    table.check_protocols(&readers).map_err(|e| first(e.to_string()))?;
    let Some((surface, scale)) = surface else {
        let is_free = !outline.has_fields();
        let laid_out = Model::new(model, None, &table).map(drop);
        return if is_free { laid_out.map_err(|e| first(e.to_string())) } else { Ok(()) };
    };
    let n_vertices = surface.mesh.n_vertices();
    let n_modes = outline.n_modes();
    if n_modes > n_vertices {
        return Err(format!("{n_modes} modes, more than the surface has vertices ({n_vertices})"));
    }
    table.place_on(surface, scale).map_err(|e| first(e.to_string()))?;
    // one mode is enough for the lengths of paths
    let one = made_up(n_vertices, 1);
    table.probe(surface, &one).map_err(|e| first(e.to_string()))?;
    let basis = made_up(n_vertices, n_modes.max(1));
    Model::new(model, Some(&basis), &table).map(drop).map_err(|e| first(e.to_string()))
}

fn made_up(n_vertices: usize, n_modes: usize) -> Basis {
    Basis {
        eigenvalues: (0..n_modes).map(|k| 1e-3 * k as f64).collect(),
        eigenfunctions: vec![1.0; n_vertices * n_modes],
    }
}
