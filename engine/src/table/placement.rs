//! Where the rows of a table lie on a surface.

use super::{DataError, Table, VERTEX};
use crate::manifold::nearest_vertex;
use crate::mesh::Surface;

/// How far from the surface a measurement given as x, y, z may lie, mm.
const MAX_DISTANCE: f64 = 5.0;
/// How far a row's `vertex` may lie from its x, y, z, mm: these may be of an electrode within the chamber,
/// which is nowhere farther from its wall.
const MAX_APART: f64 = 30.0;
/// Who asks for the columns.
const WHO: &str = "the placement on the mesh";

/// The vertex of each row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Placement(Vec<u32>);

impl Placement {
    /// By column `vertex` (index in the mesh file), else the vertices nearest to columns `x`, `y`, `z` (in
    /// the mesh file's unit, `scale` mm each).
    ///
    /// # Errors
    /// Neither is there, the two disagree, or a row lies off the surface.
    pub fn on_surface(table: &Table, surface: &Surface, scale: f64) -> Result<Self, DataError> {
        let by_vertex = table.has(VERTEX);
        if !by_vertex && ["x", "y", "z"].iter().all(|name| !table.has(name)) {
            return Err(no_place(table));
        }
        let vertex = |row: usize| {
            if by_vertex {
                let vertex = by_index(table, row, VERTEX, surface)?;
                agrees(table, row, vertex, surface, scale).map(|()| vertex)
            } else {
                by_position(table, row, surface, scale)
            }
        };
        (0..table.len()).map(vertex).collect::<Result<_, _>>().map(Self)
    }

    /// Column `vertex` as it is, on a surface known only by its number of vertices.
    ///
    /// # Errors
    /// No such column, or a vertex out of range.
    pub fn at_indices(table: &Table, n_vertices: usize) -> Result<Self, DataError> {
        let vertex = |row: usize| Ok(index(table, row, VERTEX, n_vertices)? as u32);
        (0..table.len()).map(vertex).collect::<Result<_, _>>().map(Self)
    }

    /// By a column of indices in the mesh file, whatever its name.
    ///
    /// # Errors
    /// A cell that is no vertex of the surface.
    pub(super) fn by_column(
        table: &Table,
        column: &str,
        surface: &Surface,
    ) -> Result<Vec<u32>, DataError> {
        (0..table.len()).map(|row| by_index(table, row, column, surface)).collect()
    }

    /// The same, of a column whose cells may be empty.
    ///
    /// # Errors
    /// A cell that is no vertex of the surface.
    pub(super) fn by_column_if_filled(
        table: &Table,
        column: &str,
        surface: &Surface,
    ) -> Result<Vec<Option<u32>>, DataError> {
        let is_filled = |row: usize| table.cell(row, column).is_some_and(|cell| !cell.is_empty());
        let one = |row| is_filled(row).then(|| by_index(table, row, column, surface)).transpose();
        (0..table.len()).map(one).collect()
    }

    /// Vertex of a row.
    pub fn vertex(&self, row: usize) -> Option<u32> {
        self.0.get(row).copied()
    }

    /// Vertex of each row.
    pub fn of_rows(&self) -> &[u32] {
        &self.0
    }

    /// All vertices, ascending, each once.
    pub fn vertices(&self) -> Vec<u32> {
        let mut all = self.0.clone();
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// A whole number below `n`.
fn index(table: &Table, row: usize, column: &str, n: usize) -> Result<usize, DataError> {
    let index = table.number(row, column, WHO)?;
    if index >= 0.0 && index.fract() == 0.0 && index < n as f64 {
        return Ok(index as usize);
    }
    let problem = format!("expected a vertex of the mesh (0 to {}), got {index}", n - 1);
    Err(table.cell_error(row, column, problem, "check that the table belongs to this mesh"))
}

fn by_index(table: &Table, row: usize, column: &str, surface: &Surface) -> Result<u32, DataError> {
    let index = index(table, row, column, surface.n_source_vertices)?;
    surface.vertex_of_source(index).ok_or_else(|| {
        // joined vertices are on the surface where they were joined
        let why = if surface.dropped.is_empty() {
            "it belongs to no triangle that is left"
        } else {
            "it belongs to another piece, or to no triangle that is left"
        };
        let problem = format!("vertex {index} is not on the surface: {why}");
        let help = "the surface is one connected piece, without triangles that have no area or are there twice; name another vertex, or give the site as x, y, z";
        table.cell_error(row, column, problem, help)
    })
}

/// Where a row has both, the vertex lies at its x, y, z.
fn agrees(
    table: &Table,
    row: usize,
    vertex: u32,
    surface: &Surface,
    scale: f64,
) -> Result<(), DataError> {
    let cell = |name: &str| table.column(name)?.numbers()?.get(row).copied();
    let point = [cell("x"), cell("y"), cell("z")].map(|x| x.map_or(f64::NAN, |x| scale * x));
    let here = surface.mesh.vertices()[vertex as usize];
    let distance = (0..3).map(|i| (here[i] - point[i]).powi(2)).sum::<f64>().sqrt();
    if distance.is_nan() || distance <= MAX_APART {
        return Ok(());
    }
    let index = table.cell(row, VERTEX).unwrap_or_default();
    let problem = format!(
        "vertex {index} is {distance:.1} mm from this row's x, y, z; at most {MAX_APART} mm is expected"
    );
    let help =
        "one of the two is of another mesh, or in another unit (--units); leave the wrong one out";
    Err(table.cell_error(row, "vertex, x, y, z", problem, help))
}

fn by_position(table: &Table, row: usize, surface: &Surface, scale: f64) -> Result<u32, DataError> {
    let who = "the placement on the mesh (as there is no column `vertex`)";
    let mut point = [0.0; 3];
    for (p, name) in point.iter_mut().zip(["x", "y", "z"]) {
        *p = scale * table.number(row, name, who)?;
    }
    let (vertex, distance) = nearest_vertex(&surface.mesh, point);
    if distance <= MAX_DISTANCE {
        return Ok(vertex);
    }
    let problem = format!(
        "the site at ({:.1}, {:.1}, {:.1}) mm is {distance:.1} mm from the surface, at most {MAX_DISTANCE} mm is expected",
        point[0], point[1], point[2]
    );
    let help = "check that the table and the mesh share one frame and one unit (--units)";
    Err(table.cell_error(row, "x, y, z", problem, help))
}

/// Neither `vertex` nor any of `x`, `y`, `z`.
fn no_place(table: &Table) -> DataError {
    match table.no_column(VERTEX, WHO) {
        DataError::NoColumn { file, column, who, available, guess } if guess.contains("add") => {
            let guess = "\nhelp: add a column `vertex` (index in the mesh file), or columns `x`, `y`, `z` (in the mesh's unit)".into();
            DataError::NoColumn { file, column, who, available, guess }
        }
        near_miss => near_miss,
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::Surface;
    use crate::table::Measurements;

    #[test]
    fn a_vertex_must_lie_at_its_row_s_position() {
        let surface = Surface::left_atrium(3.0);
        let [x, y, z] = surface.mesh.vertices()[7];
        let place = |shift: f64, x_cell: bool| {
            let x = if x_cell { (x + shift).to_string() } else { String::new() };
            let cells = ["7".to_owned(), x, y.to_string(), z.to_string()].to_vec();
            let header = ["vertex", "x", "y", "z"].map(String::from).to_vec();
            let mut table = Measurements::from_cells("t.csv", header, vec![cells]).unwrap();
            table.place_on(&surface, 1.0).map(|()| table.vertex(0)).map_err(|e| e.to_string())
        };
        assert_eq!(place(12.0, true), Ok(Some(7)));
        assert_eq!(place(40.0, false), Ok(Some(7)), "a position is not whole without its x");
        let error = place(40.0, true).unwrap_err();
        assert!(error.contains("vertex 7 is 40.0 mm from this row's x, y, z"), "{error}");
    }
}
