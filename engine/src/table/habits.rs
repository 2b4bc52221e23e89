//! Habits of spreadsheets: semicolons between cells, decimal commas, empty rows and columns, headers with
//! capitals and units.

use std::borrow::Cow;

use super::DataError;
use super::cells::Cells;
use super::columns::STRUCTURAL;

/// What the bytes are instead of text, and what to do.
pub(super) fn packed(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let kinds: [(&[u8], _, _); 3] = [
        (b"\x1F\x8B", "a gzip archive", "unpack it with `gunzip`, and name the file that it makes"),
        (
            b"PK\x03\x04",
            "an Excel workbook or another zip archive",
            "save the sheet as CSV, or unpack the archive",
        ),
        (b"\xD0\xCF\x11\xE0", "an old Excel workbook", "save the sheet as CSV"),
    ];
    let kind = kinds.into_iter().find(|(begin, ..)| bytes.starts_with(begin))?;
    Some((kind.1, kind.2))
}

/// The text with empty lines for those that begin with `#`, so that lines keep their numbers; and how
/// many these were. A line within a quoted cell is none of them.
pub(super) fn without_comments(text: Cow<'_, str>) -> (Cow<'_, str>, usize) {
    if !text.lines().any(|line| line.starts_with('#')) {
        return (text, 0);
    }
    let (mut is_quoted, mut n) = (false, 0);
    let kept = text.split_inclusive('\n').map(|line| {
        if !is_quoted && line.starts_with('#') {
            n += 1;
            return "\n";
        }
        is_quoted = ends_quoted(line, is_quoted);
        line
    });
    let kept = kept.collect();
    (Cow::Owned(kept), n)
}

/// Whether a quoted cell goes on after a line, if one did or did not before it. A quote opens a cell
/// only at its beginning; doubled within a quoted cell it closes nothing.
fn ends_quoted(line: &str, mut is_quoted: bool) -> bool {
    let (mut begins_cell, mut has_closed) = (true, false);
    for c in line.chars() {
        let was_quoted = is_quoted;
        is_quoted ^= c == '"' && (is_quoted || begins_cell || has_closed);
        has_closed = was_quoted && !is_quoted;
        begins_cell = matches!(c, ',' | ';' | '\t');
    }
    is_quoted
}

/// The first two columns of one name.
pub(super) fn doubled(header: &[String]) -> Option<(usize, usize)> {
    let second =
        (0..header.len()).find(|i| !header[*i].is_empty() && header[..*i].contains(&header[*i]))?;
    let first = header[..second].iter().position(|name| *name == header[second])?;
    Some((first, second))
}

/// What separates the cells, told by the header line: a comma, a semicolon or a tab, whichever is there
/// most often outside quotes.
pub(super) fn delimiter(text: &str) -> u8 {
    let header = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let count = |sign: char| {
        let mut is_quoted = false;
        let mut n = 0;
        for c in header.chars() {
            is_quoted ^= c == '"';
            n += usize::from(c == sign && !is_quoted);
        }
        n
    };
    // the first of the most frequent
    let signs = [',', ';', '\t'];
    let most = signs.into_iter().rev().max_by_key(|sign| count(*sign));
    most.map_or(b',', |sign| sign as u8)
}

/// Leaves out columns without a name and without a filled cell, which stand behind the others in
/// many sheets.
pub(super) fn without_empty_columns(header: &mut Vec<String>, cells: Cells) -> Cells {
    let mut kept: Vec<bool> = header.iter().map(|name| !name.is_empty()).collect();
    if kept.iter().all(|kept| *kept) {
        return cells;
    }
    cells.iter().for_each(|(_, column, text)| kept[column] |= !text.is_empty());
    let named = std::mem::take(header).into_iter().zip(&kept);
    *header = named.filter_map(|(name, kept)| kept.then_some(name)).collect();
    cells.kept(&kept)
}

/// Units that a header may name behind the columns that eplat knows, in which these are read.
const UNITS: [(&str, &[&str]); 6] = [
    ("x", &["mm"]),
    ("y", &["mm"]),
    ("z", &["mm"]),
    ("lower", &["ms"]),
    ("upper", &["ms"]),
    ("value", &["ms", "mV", "m/s", "ohm"]),
];

/// The name of a column that eplat knows by itself, whatever its case and with its unit behind it:
/// `lower` for `Lower [ms]`. Other headers, and those with another unit, stay as they are.
pub(super) fn plain(header: &str) -> String {
    let (name, unit) = match header.split_once(['[', '(']) {
        Some((name, rest)) => (name, Some(rest.trim_end_matches([']', ')', ' ']))),
        None => (header, None),
    };
    let name = name.trim().to_lowercase();
    let units = UNITS.iter().find(|(own, _)| *own == name).map_or(&[][..], |(_, units)| units);
    let is_its_unit = unit.is_none_or(|unit| units.contains(&unit.trim()));
    if STRUCTURAL.contains(&name.as_str()) && is_its_unit { name } else { header.to_owned() }
}

/// Where a cell stands, for an error.
type At<'a> = &'a dyn Fn(usize, usize, String) -> DataError;

/// Turns decimal commas into points, in a table whose cells are not separated by commas; tells
/// whether there were any.
///
/// # Errors
/// A number that may be read in two ways, such as `1,234`, in a table where nothing tells which is
/// meant; a column with both commas and points.
pub(super) fn decimal_commas(cells: &mut Cells, at: At) -> Result<bool, DataError> {
    let mut seen = Seen::default();
    cells.iter().for_each(|(row, column, cell)| seen.note(row, column, cell));
    if let Some((row, column)) = seen.both {
        let problem = format!("`{}` has both a comma and a point", cells.get(row, column));
        return Err(at(row, column, problem));
    }
    if let (Some((row, column)), true) =
        (seen.doubtful, seen.clear.is_none() || seen.point.is_some())
    {
        let cell = cells.get(row, column);
        let (whole, rest) = cell.split_once(',').unwrap_or((cell, ""));
        let problem = format!("`{cell}` may mean {whole}.{rest} or {whole}{rest}");
        return Err(at(row, column, problem));
    }
    if seen.clear.is_none() {
        return Ok(false);
    }
    cells.replace(|cell| comma(cell).map(|_| cell.replace(',', ".")));
    Ok(true)
}

/// The first cell of each kind.
#[derive(Default)]
struct Seen {
    /// Surely a decimal comma: not three digits behind it, or none but zeros before it.
    clear: Option<(usize, usize)>,
    /// A decimal point.
    point: Option<(usize, usize)>,
    /// Three digits behind the comma: it may separate thousands.
    doubtful: Option<(usize, usize)>,
    /// A comma and a point.
    both: Option<(usize, usize)>,
}

impl Seen {
    fn note(&mut self, row: usize, column: usize, cell: &str) {
        let is_number = |cell: &str| cell.parse::<f64>().is_ok_and(f64::is_finite);
        let kind = match comma(cell) {
            Some(is_clear) => {
                if is_clear {
                    &mut self.clear
                } else {
                    &mut self.doubtful
                }
            }
            None if cell.contains('.') && is_number(cell) => &mut self.point,
            None if cell.contains(',')
                && is_number(&cell.replace(',', ""))
                && cell.contains('.') =>
            {
                &mut self.both
            }
            None => return,
        };
        kind.get_or_insert((row, column));
    }
}

/// Whether a number with one comma in it surely has a decimal comma; `None` for anything else.
fn comma(cell: &str) -> Option<bool> {
    let (whole, rest) = cell.split_once(',')?;
    let digits = whole.trim_start_matches(['+', '-']);
    let fraction = rest.split(['e', 'E']).next().unwrap_or_default();
    let are_digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let is_number = are_digits(digits)
        && are_digits(fraction)
        && format!("{whole}.{rest}").parse::<f64>().is_ok();
    let is_thousands = fraction.len() == 3 && rest.len() == 3 && (1..=3).contains(&digits.len());
    is_number.then_some(!is_thousands || digits.bytes().all(|b| b == b'0'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(cells: &[&str]) -> Result<(bool, Vec<String>), String> {
        let mut rows: Cells = cells.iter().map(|cell| vec![*cell]).collect();
        let at = |row: usize, _: usize, problem: String| DataError::Cell {
            file: "t.csv".into(),
            line: row as u64,
            column: "a".into(),
            problem,
            help: String::new(),
        };
        let found = decimal_commas(&mut rows, &at).map_err(|e| e.to_string())?;
        Ok((found, rows.iter().map(|(.., text)| text.to_owned()).collect()))
    }

    #[test]
    fn the_separator_is_that_of_the_header() {
        assert_eq!(delimiter("a,b\n1;2;3\n"), b',');
        assert_eq!(delimiter("\na;b;c\n"), b';');
        assert_eq!(delimiter("a\t\"b,c,d\"\te"), b'\t');
        assert_eq!(delimiter("alone"), b',');
    }

    #[test]
    fn decimal_commas_are_read_and_doubtful_ones_refused() {
        assert_eq!(
            read(&["12,5", "-0,125", "1,234", "A,B"]).unwrap(),
            (true, vec!["12.5".into(), "-0.125".into(), "1.234".into(), "A,B".into()])
        );
        assert!(!read(&["12.5", "A,B"]).unwrap().0);
        assert!(read(&["1,234"]).unwrap_err().contains("`1,234` may mean 1.234 or 1234"));
        // commas and points in one table: a comma may be anything
        assert!(read(&["12,5", "3.5", "1,234"]).unwrap_err().contains("may mean"));
        assert!(read(&["12,5", "3.5"]).unwrap().0);
        assert!(read(&["1,234.5"]).unwrap_err().contains("both a comma and a point"));
    }

    #[test]
    fn headers_that_eplat_knows_lose_case_and_unit() {
        let names = ["Vertex", "Lower [ms]", "UPPER (ms)", "x [cm]", "Force [g]", "Value [µV]"];
        let plain: Vec<String> = names.iter().map(|name| plain(name)).collect();
        assert_eq!(plain, ["vertex", "lower", "upper", "x [cm]", "Force [g]", "Value [µV]"]);
    }

    #[test]
    fn empty_columns_behind_the_others_go() {
        let mut header = vec!["a".to_owned(), String::new(), String::new()];
        let cells = [vec!["1", "2", ""], vec!["", "", ""]].into_iter().collect();
        let cells = without_empty_columns(&mut header, cells);
        assert_eq!((header, cells.n_rows()), (vec!["a".to_owned(), String::new()], 2));
        assert_eq!((cells.get(0, 1), cells.get(1, 0)), ("2", ""));
    }
}
