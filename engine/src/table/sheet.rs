//! Texts of a user's as cells of a table that is opened in a spreadsheet, too.

/// First signs of a cell that a spreadsheet takes for a formula.
const FORMULA: [char; 6] = ['=', '+', '-', '@', '\t', '\r'];

/// The text as a cell that no spreadsheet takes for a formula: with an apostrophe before it, if it begins like
/// one and is no number. [`from_cell`] takes it away again.
///
/// ```
/// use eplat_engine::table::{as_cell, from_cell};
/// assert_eq!(["=cmd", "-", "-3", "a=b"].map(as_cell), ["'=cmd", "'-", "-3", "a=b"]);
/// assert!(["=cmd", "'=cmd", "-", "-3", "'-3", "'"].iter().all(|text| from_cell(&as_cell(text)) == *text));
/// ```
pub fn as_cell(text: &str) -> String {
    let is_number = text.parse::<f64>().is_ok();
    if is_formula(text) && !is_number { format!("'{text}") } else { text.to_owned() }
}

/// The text that was written by [`as_cell`].
pub fn from_cell(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|_| is_formula(cell)).unwrap_or(cell)
}

/// Whether it begins like a formula, but for apostrophes before it.
fn is_formula(text: &str) -> bool {
    text.trim_start_matches('\'').starts_with(FORMULA)
}

/// A line of CSV with its end. A cell that holds a separator stands in quotes, and so does one that begins with
/// `#`: it is no comment. So does an only cell that is empty: the line is not blank, for blank lines are no rows.
pub fn csv_line<'t>(cells: impl IntoIterator<Item = &'t str>) -> String {
    let quoted = |cell: &str| {
        let cell = as_cell(cell);
        if cell.contains([',', ';', '\t', '"', '\n', '\r']) || cell.starts_with('#') {
            format!("\"{}\"", cell.replace('"', "\"\""))
        } else {
            cell
        }
    };
    let line = cells.into_iter().map(quoted).collect::<Vec<_>>().join(",");
    if line.is_empty() { "\"\"\n".into() } else { line + "\n" }
}

#[cfg(test)]
mod tests {
    use super::super::Measurements;

    #[test]
    fn a_table_comes_back_whatever_its_texts() {
        let texts = [
            "=cmd|' /C calc'!A0",
            "+1 mm",
            "-",
            "@here",
            "'=x",
            "'",
            "#1",
            "a,b;c",
            "say \"so\"",
            "-3",
            "é",
        ];
        let header = vec!["=site".to_owned(), "force (g), tip".to_owned()];
        let rows = texts.iter().map(|text| vec![(*text).to_owned(), "1".into()]).collect();
        let table = Measurements::from_cells("made", header, rows).unwrap();
        let csv = table.to_csv();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        std::fs::write(&path, &csv).unwrap();
        let read = Measurements::read(&path).unwrap();
        assert_eq!(read.columns(), table.columns());
        for row in 0..texts.len() {
            assert_eq!(read.cells(row), table.cells(row));
        }
        let is_formula = |line: &str| line.trim_start_matches('"').starts_with(['=', '+', '@']);
        assert!(!csv.lines().any(is_formula), "{csv}");
    }

    #[test]
    fn an_empty_cell_that_is_a_row_stays_one() {
        let rows = ["a", "", "b"].map(|text| vec![text.to_owned()]).to_vec();
        let csv = Measurements::from_cells("made", vec!["site".into()], rows).unwrap().to_csv();
        assert_eq!(csv, "site\na\n\"\"\nb\n");
        let file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
        std::fs::write(file.path(), csv).unwrap();
        assert_eq!(Measurements::read(file.path()).unwrap().len(), 3);
    }
}
