//! A table of measurements: one row each, columns by name, kept as text until a model asks for them.

mod probes;

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use thiserror::Error;

pub use probes::{FIELD_MODES, PATH, ProbeError, Probes, SOURCE};

use crate::manifold::{Basis, nearest_vertex};
use crate::mesh::Surface;

/// How far from the surface a measurement given as x, y, z may lie, mm.
const MAX_DISTANCE: f64 = 5.0;

/// What can be wrong with a table of measurements.
#[derive(Debug, Error)]
pub enum DataError {
    /// The file cannot be opened.
    #[error(
        "cannot read {file}: {reason}\nhelp: give a CSV file with a header line and one row per measurement"
    )]
    Unreadable {
        /// File name.
        file: String,
        /// From the operating system or the CSV reader.
        reason: String,
    },
    /// A header at most.
    #[error(
        "{file}: the table is empty\nhelp: one row per measurement is expected below the header line"
    )]
    Empty {
        /// File name.
        file: String,
    },
    /// A column that is needed and not there.
    #[error("{file}: no column `{column}`, which {who} reads\n  the file has: {available}{guess}")]
    NoColumn {
        /// File name.
        file: String,
        /// The column asked for.
        column: String,
        /// Who asks.
        who: String,
        /// The header.
        available: String,
        /// "help: …" with the nearest name, or what to do.
        guess: String,
    },
    /// A cell that does not hold what it should.
    #[error("{file}, line {line}, column `{column}`: {problem}\nhelp: {help}")]
    Cell {
        /// File name.
        file: String,
        /// Line in the file, from 1.
        line: u64,
        /// Column name or names.
        column: String,
        /// Expected and got.
        problem: String,
        /// What to do.
        help: String,
    },
}

/// One row of a table.
#[derive(Clone, Debug)]
struct Row {
    line: u64,
    cells: Vec<String>,
}

/// A table of measurements.
#[derive(Clone, Debug, Default)]
pub struct Measurements {
    file: String,
    header: Vec<String>,
    rows: Vec<Row>,
    /// Vertex of each row, once placed on a surface.
    vertex: Vec<u32>,
    /// Modes at the rows, once probed.
    probes: Option<Arc<Probes>>,
}

impl Measurements {
    /// Reads a CSV file with a header line.
    ///
    /// # Errors
    /// No such file, ragged rows, no rows.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        let file = path.display().to_string();
        let unreadable = |e: csv::Error| {
            let reason = match e.kind() {
                csv::ErrorKind::Io(io) => io.to_string(),
                csv::ErrorKind::UnequalLengths { pos, expected_len, len } => format!(
                    "line {} has {len} cells, the header has {expected_len}",
                    pos.as_ref().map_or(0, csv::Position::line)
                ),
                _ => e.to_string(),
            };
            DataError::Unreadable { file: file.clone(), reason }
        };
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(unreadable)?;
        let header = reader.headers().map_err(unreadable)?.iter().map(String::from).collect();
        let mut rows = vec![];
        for record in reader.records() {
            let record = record.map_err(unreadable)?;
            let line = record.position().map_or(0, csv::Position::line);
            rows.push(Row { line, cells: record.iter().map(String::from).collect() });
        }
        Self::new(file, header, rows)
    }

    /// A table made in memory, under a name for messages.
    ///
    /// # Errors
    /// No rows.
    pub fn from_cells(
        name: &str,
        header: Vec<String>,
        cells: Vec<Vec<String>>,
    ) -> Result<Self, DataError> {
        let rows = (2..).zip(cells).map(|(line, cells)| Row { line, cells }).collect();
        Self::new(name.into(), header, rows)
    }

    fn new(file: String, header: Vec<String>, rows: Vec<Row>) -> Result<Self, DataError> {
        if rows.is_empty() {
            return Err(DataError::Empty { file });
        }
        Ok(Self { file, header, rows, vertex: vec![], probes: None })
    }

    /// Finds the vertex of every row: column `vertex` (index in the mesh file), else the vertex nearest
    /// to columns `x`, `y`, `z` (in the mesh file's unit, `scale` mm each).
    ///
    /// # Errors
    /// Neither is there, or a row lies off the surface.
    pub fn place_on(&mut self, surface: &Surface, scale: f64) -> Result<(), DataError> {
        let by_vertex = self.column("vertex").is_some();
        if !by_vertex && ["x", "y", "z"].iter().all(|name| self.column(name).is_none()) {
            return Err(self.no_place());
        }
        let mut vertices = Vec::with_capacity(self.rows.len());
        for row in 0..self.rows.len() {
            let vertex = if by_vertex {
                self.vertex_by_index(row, "vertex", surface)?
            } else {
                self.vertex_by_position(row, surface, scale)?
            };
            vertices.push(vertex);
        }
        self.vertex = vertices;
        Ok(())
    }

    /// Takes column `vertex` as it is, on a surface known only by its number of vertices (`--basis`
    /// without a mesh, and tests).
    ///
    /// # Errors
    /// No such column, or a vertex out of range.
    pub fn place_at_indices(&mut self, n_vertices: usize) -> Result<(), DataError> {
        let mut vertices = Vec::with_capacity(self.rows.len());
        for row in 0..self.rows.len() {
            let index = self.number(row, "vertex", "the placement on the mesh")?;
            if !(index >= 0.0 && index.fract() == 0.0 && index < n_vertices as f64) {
                return Err(self.no_such_vertex(row, "vertex", index, n_vertices));
            }
            vertices.push(index as u32);
        }
        self.vertex = vertices;
        Ok(())
    }

    /// Keeps the modes at the rows of a placed table, for effects that are fields. Where a column `source` says
    /// at which vertex activation starts, the modes along the paths from there too, and the paths' lengths
    /// in a column `path_mm`, unless there is one.
    ///
    /// # Errors
    /// A source that is no vertex of the surface.
    pub fn probe(&mut self, surface: &Surface, basis: &Basis) -> Result<(), ProbeError> {
        let probes = Probes::new(self, surface, basis)?;
        if !probes.lengths().is_empty() && !self.has(PATH) {
            self.header.push(PATH.into());
            for (row, length) in self.rows.iter_mut().zip(probes.lengths()) {
                row.cells.push(length.to_string());
            }
        }
        self.probes = Some(Arc::new(probes));
        Ok(())
    }

    /// Modes at the rows, once probed.
    pub fn probes(&self) -> Option<&Probes> {
        self.probes.as_deref()
    }

    /// The vertices of the surface that a column names by their index in the mesh file.
    ///
    /// # Errors
    /// A cell that is none.
    pub(super) fn vertices_of(
        &self,
        column: &str,
        surface: &Surface,
    ) -> Result<Vec<u32>, DataError> {
        (0..self.rows.len()).map(|row| self.vertex_by_index(row, column, surface)).collect()
    }

    fn no_such_vertex(&self, row: usize, column: &str, index: f64, n: usize) -> DataError {
        let problem = format!("expected a vertex of the mesh (0 to {}), got {index}", n - 1);
        self.cell_error(row, column, problem, "check that the table belongs to this mesh")
    }

    fn vertex_by_index(
        &self,
        row: usize,
        column: &str,
        surface: &Surface,
    ) -> Result<u32, DataError> {
        let index = self.number(row, column, "the placement on the mesh")?;
        let n = surface.n_source_vertices;
        if !(index >= 0.0 && index.fract() == 0.0 && index < n as f64) {
            return Err(self.no_such_vertex(row, column, index, n));
        }
        surface.vertex_of_source(index as usize).ok_or_else(|| {
            let problem = format!(
                "vertex {index} is not on the surface: it belongs to a piece that was dropped"
            );
            self.cell_error(
                row,
                column,
                problem,
                "only the mesh's largest connected piece is used; move the site or mend the mesh",
            )
        })
    }

    fn vertex_by_position(
        &self,
        row: usize,
        surface: &Surface,
        scale: f64,
    ) -> Result<u32, DataError> {
        let who = "the placement on the mesh (as there is no column `vertex`)";
        let mut point = [0.0; 3];
        for (p, name) in point.iter_mut().zip(["x", "y", "z"]) {
            *p = scale * self.number(row, name, who)?;
        }
        let (vertex, distance) = nearest_vertex(&surface.mesh, point);
        if !(distance <= MAX_DISTANCE) {
            let problem = format!(
                "the site at ({:.1}, {:.1}, {:.1}) mm is {distance:.1} mm from the surface, at most {MAX_DISTANCE} mm is expected",
                point[0], point[1], point[2]
            );
            return Err(self.cell_error(
                row,
                "x, y, z",
                problem,
                "check that the table and the mesh share one frame and one unit (--units)",
            ));
        }
        Ok(vertex)
    }

    /// Rows that an `observe` statement takes: those whose `protocol` is its name, upper and lower case
    /// alike, or all of them if there is no such column.
    pub fn rows_of(&self, observe: &str) -> Vec<usize> {
        let Some(column) = self.column("protocol") else { return (0..self.rows.len()).collect() };
        (0..self.rows.len())
            .filter(|&row| self.rows[row].cells[column].eq_ignore_ascii_case(observe))
            .collect()
    }

    /// Complains about the first row whose `protocol` is none of `observes`.
    ///
    /// # Errors
    /// That row.
    pub fn check_protocols(&self, observes: &[&str]) -> Result<(), DataError> {
        let Some(column) = self.column("protocol") else { return Ok(()) };
        let known = |cell: &str| observes.iter().any(|o| o.eq_ignore_ascii_case(cell));
        match (0..self.rows.len()).find(|&row| !known(&self.rows[row].cells[column])) {
            None => Ok(()),
            Some(row) => Err(self.cell_error(
                row,
                "protocol",
                format!("`{}` is not observed by the model", self.rows[row].cells[column]),
                &format!(
                    "the model observes {}; drop these rows or add an `observe` statement",
                    observes.join(", ")
                ),
            )),
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The header.
    pub fn columns(&self) -> &[String] {
        &self.header
    }

    /// This table, then the rows of another: columns that it lacks are empty there. Where a column of
    /// `lent` is empty or missing in the other, the first row here of the same protocol lends its cell.
    #[must_use]
    pub fn followed_by(&self, other: &Self, lent: &[&str]) -> Self {
        let mut all = self.clone();
        all.vertex.clear();
        all.probes = None;
        for row in 0..other.len() {
            let protocol = other.cell(row, "protocol");
            let lender =
                (0..self.len()).find(|r| self.cell(*r, "protocol") == protocol).unwrap_or(0);
            let cells = self.header.iter().enumerate().map(|(column, name)| {
                let own = other.cell(row, name).unwrap_or_default();
                let is_lent =
                    own.is_empty() && lent.contains(&name.as_str()) && !other.is_open(row, name);
                if is_lent { self.rows[lender].cells[column].clone() } else { own.to_owned() }
            });
            all.rows.push(Row { line: other.rows[row].line, cells: cells.collect() });
        }
        all
    }

    /// Whether an empty cell is the open end of a bracket: the other end is there.
    fn is_open(&self, row: usize, name: &str) -> bool {
        let is_there = |end: &str| self.cell(row, end).is_some_and(|cell| !cell.is_empty());
        ["lower", "upper"].contains(&name) && (is_there("lower") || is_there("upper"))
    }

    /// Complains unless there is such a column (`who` asks for it).
    ///
    /// # Errors
    /// No such column.
    pub fn require(&self, name: &str, who: &str) -> Result<(), DataError> {
        self.column(name).map(|_| ()).ok_or_else(|| self.no_column(name, who))
    }

    /// Line of a row in its file, from 1.
    pub fn line(&self, row: usize) -> u64 {
        self.rows[row].line
    }

    /// A cell as text; `None` if there is no such column.
    pub fn cell(&self, row: usize, name: &str) -> Option<&str> {
        self.column(name).map(|column| self.rows[row].cells[column].as_str())
    }

    /// Number of columns.
    pub fn n_columns(&self) -> usize {
        self.header.len()
    }

    /// File name, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// A row in words: its site, if there is such a column, else its line.
    pub fn place(&self, row: usize) -> String {
        match self.column("site") {
            Some(column) => format!("at site {}", self.rows[row].cells[column]),
            None => format!("in line {}", self.rows[row].line),
        }
    }

    /// Vertex of a row, once placed.
    pub fn vertex(&self, row: usize) -> Option<u32> {
        self.vertex.get(row).copied()
    }

    /// All vertices, ascending, each once.
    pub fn vertices(&self) -> Vec<u32> {
        let mut all = self.vertex.clone();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Whether the table has this column.
    pub fn has(&self, name: &str) -> bool {
        self.column(name).is_some()
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|h| h == name)
    }

    fn text(&self, row: usize, name: &str, who: &str) -> Result<&str, DataError> {
        let column = self.column(name).ok_or_else(|| self.no_column(name, who))?;
        Ok(&self.rows[row].cells[column])
    }

    /// A cell as a number; NaN if it is empty.
    ///
    /// # Errors
    /// No such column (`who` asks for it), or not a number.
    pub fn number_or_empty(&self, row: usize, name: &str, who: &str) -> Result<f64, DataError> {
        let text = self.text(row, name, who)?;
        if text.is_empty() {
            return Ok(f64::NAN);
        }
        text.parse().map_err(|_| {
            self.cell_error(
                row,
                name,
                format!("expected a number, got `{text}`"),
                "numbers are written 12.5 or 1.25e1; leave a missing value empty",
            )
        })
    }

    /// A cell as a number that must be there.
    ///
    /// # Errors
    /// No such column, not a number, or empty.
    pub fn number(&self, row: usize, name: &str, who: &str) -> Result<f64, DataError> {
        let x = self.number_or_empty(row, name, who)?;
        if x.is_nan() {
            let problem = format!("expected a number, which {who} needs, got an empty cell");
            return Err(self.cell_error(row, name, problem, "fill in the value or drop the row"));
        }
        Ok(x)
    }

    /// A column as labels: the distinct ones in order of appearance, and each row's index among them.
    ///
    /// # Errors
    /// No such column, or an empty cell.
    pub fn labels(&self, name: &str, who: &str) -> Result<(Vec<String>, Vec<usize>), DataError> {
        let mut levels: Vec<String> = vec![];
        let mut index = Vec::with_capacity(self.rows.len());
        for row in 0..self.rows.len() {
            let text = self.text(row, name, who)?;
            if text.is_empty() {
                let problem = format!("expected a label, which {who} needs, got an empty cell");
                return Err(self.cell_error(
                    row,
                    name,
                    problem,
                    "fill in the label or drop the row",
                ));
            }
            let at = levels.iter().position(|l| l == text).unwrap_or_else(|| {
                levels.push(text.into());
                levels.len() - 1
            });
            index.push(at);
        }
        Ok((levels, index))
    }

    /// An error at a cell.
    pub(crate) fn cell_error(
        &self,
        row: usize,
        column: &str,
        problem: String,
        help: &str,
    ) -> DataError {
        DataError::Cell {
            file: self.file.clone(),
            line: self.rows[row].line,
            column: column.into(),
            problem,
            help: help.into(),
        }
    }

    fn no_column(&self, column: &str, who: &str) -> DataError {
        let near = self.header.iter().map(|h| (distance(h, column), h)).min();
        let guess = match near {
            Some((d, h)) if d <= 2 => format!("\nhelp: rename `{h}` to `{column}`?"),
            _ => format!("\nhelp: add a column `{column}` to the header and to every row"),
        };
        DataError::NoColumn {
            file: self.file.clone(),
            column: column.into(),
            who: who.into(),
            available: self.header.join(", "),
            guess,
        }
    }

    /// Neither `vertex` nor any of `x`, `y`, `z`.
    fn no_place(&self) -> DataError {
        let who = "the placement on the mesh";
        match self.no_column("vertex", who) {
            DataError::NoColumn { file, column, who, available, guess }
                if guess.contains("add") =>
            {
                let guess = "\nhelp: add a column `vertex` (index in the mesh file), or columns `x`, `y`, `z` (in the mesh's unit)".into();
                DataError::NoColumn { file, column, who, available, guess }
            }
            near_miss => near_miss,
        }
    }

    /// The table as CSV text.
    pub fn to_csv(&self) -> String {
        let mut out = self.header.join(",") + "\n";
        for row in &self.rows {
            let _ = writeln!(out, "{}", row.cells.join(","));
        }
        out
    }
}

/// Edit distance of two names.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.to_lowercase().chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Measurements {
        let file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
        std::fs::write(file.path(), text).unwrap();
        Measurements { file: "t.csv".into(), ..Measurements::read(file.path()).unwrap() }
    }

    #[test]
    fn rows_go_to_the_observe_of_their_protocol() {
        let t = table("protocol,lower,upper\nS1S2,1,2\nS1S2S3,3,4\ns1s2,5,6\n");
        assert_eq!(t.rows_of("s1s2"), [0, 2]);
        let e = t.check_protocols(&["s1s2"]).unwrap_err().to_string();
        assert!(e.starts_with("t.csv, line 3, column `protocol`: `S1S2S3` is not observed"), "{e}");
    }

    #[test]
    fn what_was_not_measured_is_lent_and_an_open_end_stays_open() {
        let train = table("protocol,lower,upper\nS1S2,70,80\n");
        let heldout = table("protocol,lower,upper\nS1S2,,\nS1S2,,60\n");
        let all = train.followed_by(&heldout, &["lower", "upper"]);
        assert_eq!([1, 2].map(|row| all.cell(row, "lower").unwrap()), ["70", ""]);
        assert_eq!([1, 2].map(|row| all.cell(row, "upper").unwrap()), ["80", "60"]);
    }

    #[test]
    fn a_missing_column_names_its_nearest_neighbour() {
        let e = table("protocol,Lowr,upper\nS1S2,1,2\n").number(0, "lower", "observe s1s2");
        let e = e.unwrap_err().to_string();
        assert!(e.contains("no column `lower`") && e.contains("rename `Lowr`"), "{e}");
    }

    #[test]
    fn cells_are_numbers_labels_or_errors_with_their_line() {
        let t = table("a,b\n1.5,x\n,y\nz,x\n");
        assert!((t.number(0, "a", "it").unwrap() - 1.5).abs() < 1e-15);
        assert!(t.number_or_empty(1, "a", "it").unwrap().is_nan());
        let e = t.number(2, "a", "it").unwrap_err().to_string();
        assert!(e.contains("line 4") && e.contains("got `z`"), "{e}");
        assert!(t.number(1, "a", "it").unwrap_err().to_string().contains("empty cell"));
        assert_eq!(t.labels("b", "it").unwrap(), (vec!["x".into(), "y".into()], vec![0, 1, 0]));
    }
}
