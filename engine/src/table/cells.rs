//! The texts of a table's cells, row after row in one piece of memory: a cell is often one letter.

use csv::StringRecord;

/// Rows of as many texts as there are columns.
#[derive(Debug)]
pub(super) struct Cells {
    texts: StringRecord,
    n_columns: usize,
}

impl Cells {
    pub(super) fn new(n_columns: usize) -> Self {
        Self { texts: StringRecord::new(), n_columns }
    }

    /// Appends a row, which has a text for each column.
    pub(super) fn push<'t>(&mut self, row: impl IntoIterator<Item = &'t str>) {
        row.into_iter().for_each(|text| self.texts.push_field(text));
    }

    pub(super) fn n_rows(&self) -> usize {
        self.texts.len() / self.n_columns.max(1)
    }

    pub(super) fn get(&self, row: usize, column: usize) -> &str {
        &self.texts[row * self.n_columns + column]
    }

    /// Every cell, with its row and column.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, usize, &str)> {
        let n = self.n_columns.max(1);
        self.texts.iter().enumerate().map(move |(i, text)| (i / n, i % n, text))
    }

    /// Puts another text into each cell for which there is one.
    pub(super) fn replace(&mut self, by: impl Fn(&str) -> Option<String>) {
        let text = |cell: &str| by(cell).unwrap_or_else(|| cell.to_owned());
        self.texts = self.texts.iter().map(text).collect();
    }

    /// The columns that are to be kept.
    pub(super) fn kept(&self, kept: &[bool]) -> Self {
        let n_columns = kept.iter().filter(|kept| **kept).count();
        let texts = self.iter().filter(|(_, column, _)| kept[*column]).map(|(.., text)| text);
        Self { texts: texts.collect(), n_columns }
    }
}

impl<T: AsRef<str>> FromIterator<Vec<T>> for Cells {
    fn from_iter<I: IntoIterator<Item = Vec<T>>>(rows: I) -> Self {
        let mut cells = Self::new(0);
        for row in rows {
            cells.n_columns = row.len();
            cells.push(row.iter().map(AsRef::as_ref));
        }
        cells
    }
}
