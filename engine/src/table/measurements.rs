//! A table of measurements with a place on a surface.

use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::sync::Arc;

use super::{DataError, Ground, PATH, Placement, ProbeError, Probes, Table, read};
use crate::manifold::Basis;
use crate::mesh::Surface;

/// A table of measurements. Everything that a [`Table`] can do, it can do; besides, its rows have a place
/// on a surface once [`Measurements::place_on`] has given them one.
#[derive(Clone, Debug, Default)]
pub struct Measurements {
    table: Table,
    placement: Placement,
    /// Modes at the rows, once probed.
    probes: Option<Arc<Probes>>,
}

impl Deref for Measurements {
    type Target = Table;
    fn deref(&self) -> &Table {
        &self.table
    }
}

impl DerefMut for Measurements {
    fn deref_mut(&mut self) -> &mut Table {
        &mut self.table
    }
}

impl From<Table> for Measurements {
    fn from(table: Table) -> Self {
        Self { table, ..Self::default() }
    }
}

impl Measurements {
    /// Reads a CSV file with a header line.
    ///
    /// # Errors
    /// No such file, ragged rows, no rows.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        read::read(path).map(Self::from)
    }

    /// A table made in memory, under a name for messages.
    ///
    /// # Errors
    /// No rows; a row with more cells than the header, or fewer.
    pub fn from_cells(
        name: &str,
        header: Vec<String>,
        cells: Vec<Vec<String>>,
    ) -> Result<Self, DataError> {
        let lines: Vec<u64> = (2..).take(cells.len()).collect();
        if let Some((line, row)) =
            lines.iter().zip(&cells).find(|(_, row)| row.len() != header.len())
        {
            let (n, of) = (row.len(), header.len());
            let reason = format!("line {line} has {n} cells, the header has {of}");
            return Err(DataError::Unreadable { file: name.into(), reason });
        }
        Table::new(name.into(), header, lines, &cells.into_iter().collect()).map(Self::from)
    }

    /// Finds the vertex of every row: see [`Placement::on_surface`].
    ///
    /// # Errors
    /// There is no column that tells, or a row lies off the surface.
    pub fn place_on(&mut self, surface: &Surface, scale: f64) -> Result<(), DataError> {
        self.placement = Placement::on_surface(&self.table, surface, scale)?;
        Ok(())
    }

    /// Takes column `vertex` as it is, on a surface known only by its number of vertices (`--basis`
    /// without a mesh, and tests).
    ///
    /// # Errors
    /// No such column, or a vertex out of range.
    pub fn place_at_indices(&mut self, n_vertices: usize) -> Result<(), DataError> {
        self.placement = Placement::at_indices(&self.table, n_vertices)?;
        Ok(())
    }

    /// Keeps the modes at the rows of a placed table, for effects that are fields. Where a column `source` says
    /// at which vertex activation starts, the modes along the paths from there too, and the paths' lengths
    /// in a column `path_mm`, unless there is one.
    ///
    /// # Errors
    /// A source that is no vertex of the surface.
    pub fn probe(&mut self, surface: &Surface, basis: &Basis) -> Result<(), ProbeError> {
        let probes = Probes::new(&self.table, &self.placement, surface, basis)?;
        if !probes.lengths().is_empty() && !self.has(PATH) {
            self.table.set_numbers(PATH, probes.lengths());
        }
        self.probes = Some(Arc::new(probes));
        Ok(())
    }

    /// Modes at the rows, once probed.
    pub fn probes(&self) -> Option<&Probes> {
        self.probes.as_deref()
    }

    /// The surface below the rows, once probed.
    pub fn ground(&self) -> Option<&Ground> {
        self.probes.as_deref()?.ground()
    }

    /// Vertex of a row, once placed.
    pub fn vertex(&self, row: usize) -> Option<u32> {
        self.placement.vertex(row)
    }

    /// All vertices, ascending, each once.
    pub fn vertices(&self) -> Vec<u32> {
        self.placement.vertices()
    }

    /// This table, then the rows of another, not yet placed: columns that it lacks are empty there. Where a
    /// column of `lent` is empty or missing in the other, the first row here of the same protocol lends
    /// its cell.
    #[must_use]
    pub fn followed_by(&self, other: &Self, lent: &[&str]) -> Self {
        self.table.followed_by(&other.table, lent).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Measurements {
        let mut lines = text.lines().map(|line| line.split(',').map(String::from).collect());
        let header = lines.next().unwrap_or_default();
        Measurements::from_cells("t.csv", header, lines.collect()).unwrap()
    }

    #[test]
    fn a_file_is_read_with_its_lines() {
        let file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
        std::fs::write(file.path(), "a,b\n1, x\n\n2,y\n").unwrap();
        let t = Measurements::read(file.path()).unwrap();
        assert_eq!((t.line(1), t.cell(0, "b")), (4, Some("x")));
        assert_eq!(t.to_csv(), "a,b\n1,x\n2,y\n");
        std::fs::write(file.path(), "a,b\n1\n").unwrap();
        let e = Measurements::read(file.path()).unwrap_err().to_string();
        assert!(e.contains("line 2 has 1 cells, the header has 2"), "{e}");
    }

    fn of_file(bytes: &[u8]) -> Result<Measurements, DataError> {
        let file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        Measurements::read(file.path())
    }

    #[test]
    fn what_is_no_plain_table_is_named() {
        let said = |bytes: &[u8]| of_file(bytes).unwrap_err().to_string();
        assert!(
            said(b"\x1F\x8B\x08\0a,b").contains("a gzip archive, not a CSV text\nhelp: unpack")
        );
        assert!(said(b"PK\x03\x04xl").contains("an Excel workbook"));
        let doubled = said(b"a,Value,value\n1,2,3\n");
        assert!(doubled.contains("columns 2 and 3 are both called `value`"), "{doubled}");
        let commented = of_file(b"# made by hand\n\na,b\n1,2\n# later\n3,x\n").unwrap();
        assert_eq!((commented.len(), commented.line(0), commented.line(1)), (2, 4, 6));
        assert_eq!(commented.notes(), ["2 lines that begin with # are left out"]);
        let marked = of_file("\u{feff}\u{feff}site,value\na,1\n".as_bytes()).unwrap();
        assert_eq!(marked.columns(), ["site", "value"]);
        // a line of a quoted cell is no comment; a quote within a cell quotes nothing
        let quoted = of_file(b"a,b\n\"first\n#2 \"\"x\"\"\",1\n5\"\"\",2\n# out\n3,x\n").unwrap();
        assert_eq!(quoted.cell(0, "a"), Some("first\n#2 \"x\""));
        assert_eq!(
            (quoted.len(), quoted.notes()),
            (3, &["1 lines that begin with # are left out".into()][..])
        );
    }

    #[test]
    fn the_habits_of_spreadsheets_are_read() {
        let t = of_file(b"sep=;\r\nVertex;Lower [ms];Force [g];Ort;;\r\n3;250,5;12,25;Vorhof \xE4;;\r\n;;;;;\r\n4;240;9;\"a;b\";;\r\n").unwrap();
        assert_eq!(t.columns(), ["vertex", "lower", "Force [g]", "Ort"]);
        assert!((t.number(0, "lower", "it").unwrap() - 250.5).abs() < 1e-12);
        assert!((t.number(0, "force_g", "it").unwrap() - 12.25).abs() < 1e-12);
        assert_eq!((t.cell(0, "Ort"), t.cell(1, "Ort")), (Some("Vorhof \u{e4}"), Some("a;b")));
        assert_eq!((t.len(), t.line(1)), (2, 5));
        assert_eq!(t.notes(), ["read with semicolons between cells and decimal commas"]);
        let doubtful = of_file(b"a;b\n1,234;x\n").unwrap_err().to_string();
        let expected = "line 2, column `a`: `1,234` may mean 1.234 or 1234";
        assert!(doubtful.contains(expected), "{doubtful}");
        assert!(of_file(b"a,b\n1,2\n").unwrap().notes().is_empty());
    }

    #[test]
    fn rows_made_in_memory_are_as_long_as_the_header() {
        let header = ["a", "b"].map(String::from).to_vec();
        let cells = vec![vec!["1".to_owned(), "2".into()], vec!["3".to_owned()]];
        let said = Measurements::from_cells("t", header, cells).unwrap_err().to_string();
        assert!(said.contains("line 3 has 1 cells, the header has 2"), "{said}");
    }

    #[test]
    fn cells_are_quoted_where_they_need_it() {
        let t = of_file(b"a;b\n\"x,y\";\"say \"\"no\"\"\"\n").unwrap();
        assert_eq!(t.to_csv(), "a,b\n\"x,y\",\"say \"\"no\"\"\"\n");
    }

    #[test]
    fn rows_of_an_export_that_nothing_reads_are_dropped() {
        let text = "protocol,value\nbipolar,1\nlat,20\nUnipolar,3\nlat,21\ns1s2,7\n";
        let mut t = table(text);
        assert_eq!(
            t.drop_unread(&["lat", "s1s2"]),
            [("bipolar".into(), 1), ("Unipolar".into(), 1)]
        );
        assert_eq!(t.to_csv(), "protocol,value\nlat,20\nlat,21\ns1s2,7\n");
        assert_eq!(t.line(0), 3);
        // others than those of an export are not dropped, nor is everything
        let mut other = table("protocol,value\nS1S3,1\n");
        assert!(other.drop_unread(&["s1s2"]).is_empty());
        let mut all = table("protocol,value\nlat,1\n");
        assert!(all.drop_unread(&["s1s2"]).is_empty() && all.len() == 1);
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
        assert!(t.labels("a", "it").unwrap_err().to_string().contains("line 3"));
    }

    #[test]
    fn simulated_numbers_take_the_place_of_a_column() {
        let mut t = table("site,value\nA,1\nB,2\n");
        t.set_numbers("value", &[0.25, f64::NAN]);
        assert_eq!(t.to_csv(), "site,value\nA,0.25\nB,\n");
        assert!((t.number(0, "value", "it").unwrap() - 0.25).abs() < 1e-15);
    }
}
