//! What a mesh file holds, before it is known to be a surface.

use super::{Array, Data, MeshError, Units};

/// What a file holds, in its own unit, not yet checked to be a surface.
#[derive(Debug, Default)]
pub(super) struct Content {
    /// Coordinates.
    pub(super) vertices: Vec<[f64; 3]>,
    /// Triangles; every index exists.
    pub(super) triangles: Vec<[u32; 3]>,
    /// One row per vertex.
    pub(super) point_data: Data,
    /// One row per triangle.
    pub(super) cell_data: Data,
    /// The unit that the file or its format names.
    pub(super) units: Option<Units>,
    /// Sentences for the user: what of the file was split or left out.
    pub(super) remarks: Vec<String>,
}

/// The triangles of a file's cells, which may be polygons and strips too.
#[derive(Debug)]
pub(super) struct Cells {
    n_vertices: usize,
    triangles: Vec<[u32; 3]>,
    /// For each triangle the cell that it is of.
    cell_of: Vec<u32>,
    n_seen: usize,
    n_split: usize,
    n_skipped: usize,
}

impl Cells {
    /// No cells yet, of a file with this many vertices.
    pub(super) fn new(n_vertices: usize) -> Self {
        Self { n_vertices, triangles: vec![], cell_of: vec![], n_seen: 0, n_split: 0, n_skipped: 0 }
    }

    /// Number of cells so far: the number of the next one.
    pub(super) fn len(&self) -> usize {
        self.n_seen
    }

    /// The next cell is a polygon, cut into a fan of triangles; one of less than three corners, a point or
    /// a line, is left out.
    ///
    /// # Errors
    /// `IndexOutOfRange`.
    pub(super) fn polygon(&mut self, corners: &[i64]) -> Result<(), MeshError> {
        let [first, rest @ ..] = corners else {
            self.skip(1);
            return Ok(());
        };
        self.n_split += usize::from(rest.len() > 2);
        for pair in rest.windows(2) {
            self.push([*first, pair[0], pair[1]])?;
        }
        self.n_skipped += usize::from(rest.len() < 2);
        self.n_seen += 1;
        Ok(())
    }

    /// The next cell is a strip of triangles, every other of which runs the other way round.
    ///
    /// # Errors
    /// `IndexOutOfRange`.
    pub(super) fn strip(&mut self, corners: &[i64]) -> Result<(), MeshError> {
        for (i, t) in corners.windows(3).enumerate() {
            self.push(if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] })?;
        }
        self.n_seen += 1;
        Ok(())
    }

    /// The next `n` cells are points or lines.
    pub(super) fn skip(&mut self, n: usize) {
        self.n_seen += n;
        self.n_skipped += n;
    }

    fn push(&mut self, corners: [i64; 3]) -> Result<(), MeshError> {
        let index = |corner: i64| {
            let is_there = usize::try_from(corner).is_ok_and(|i| i < self.n_vertices);
            u32::try_from(corner).ok().filter(|_| is_there).ok_or(MeshError::IndexOutOfRange {
                triangle: self.n_seen,
                index: corner,
                n_vertices: self.n_vertices,
            })
        };
        let [a, b, c] = corners;
        self.triangles.push([index(a)?, index(b)?, index(c)?]);
        self.cell_of.push(self.n_seen as u32);
        Ok(())
    }

    /// The triangles, with the arrays of the cells that have a row for each.
    pub(super) fn into_content(
        self,
        vertices: Vec<[f64; 3]>,
        point_data: Data,
        cell_data: impl IntoIterator<Item = (String, Array)>,
    ) -> Content {
        let whole = cell_data.into_iter().filter(|(_, array)| array.n_rows() == self.n_seen);
        let cell_data = whole.map(|(name, array)| (name, array.pick(&self.cell_of))).collect();
        let mut remarks = vec![];
        if self.n_split > 0 {
            remarks.push(format!("{} cut into triangles", count(self.n_split, "polygon")));
        }
        if self.n_skipped > 0 {
            let what = count(self.n_skipped, "cell");
            remarks.push(format!("{what} left out: points or lines"));
        }
        Content { vertices, triangles: self.triangles, point_data, cell_data, units: None, remarks }
    }
}

/// `1 polygon`, `2 polygons`.
pub(super) fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_are_cut_and_keep_their_data() {
        let mut cells = Cells::new(5);
        cells.polygon(&[0, 1]).unwrap();
        cells.polygon(&[0, 1, 2, 3]).unwrap();
        cells.strip(&[0, 1, 2, 4]).unwrap();
        let data = [("n".to_owned(), Array::from(vec![5.0, 6.0, 7.0]))];
        let content = cells.into_content(vec![[0.0; 3]; 5], Data::new(), data);
        assert_eq!(content.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [2, 1, 4]]);
        assert_eq!(content.cell_data["n"].values(), [6.0, 6.0, 7.0, 7.0]);
        assert_eq!(
            content.remarks,
            ["1 polygon cut into triangles", "1 cell left out: points or lines"]
        );
        assert!(Cells::new(5).polygon(&[0, 1, 5]).is_err());
        assert!(Cells::new(5).polygon(&[0, 1, -1]).is_err());
    }
}
