//! A pacing log: one line for each stimulus that was tried, in any order. From the lines of a site and
//! protocol comes the bracket of its effective refractory period.
//!
//! ```text
//! lower = longest interval that did not capture,   upper = shortest interval that did
//! ```
//! An interval that captured though a longer one did not is a contradiction: it is shown, and nothing is
//! made of it.

use std::collections::BTreeMap;
use std::path::Path;

use super::{ImportError, Map, Point, Reading, Site, Study, Value};
use crate::table::{DataError, SITE, Table, VERTEX};

const WHO: &str = "a pacing log";
const YES: [&str; 8] = ["yes", "y", "true", "1", "captured", "capture", "ja", "+"];
const NO: [&str; 9] = ["no", "n", "false", "0", "failed", "lost", "not captured", "nein", "-"];

/// The columns of a log.
struct Columns {
    captured: String,
    s1: Option<String>,
    s2: String,
    s3: Option<String>,
    /// What else the table has.
    others: Vec<String>,
}

/// One stimulus that was tried.
struct Try {
    row: usize,
    /// The last coupling interval, ms.
    interval: f64,
    captured: bool,
}

/// A site, a protocol, S1, and S2 where S3 is looked for, as texts; in the order of first appearance.
type Key = (String, &'static str, String, String);

/// Whether the table is a pacing log: it says what captured.
pub(super) fn is_log(table: &Table) -> bool {
    named(table, "captured").is_some() && named(table, "s2").is_some()
}

/// Makes the brackets of a log.
///
/// # Errors
/// A missing column, a cell that is no number or no yes or no.
pub(super) fn read(path: &Path, table: &Table) -> Result<Study, ImportError> {
    let columns = Columns::of(table)?;
    let mut groups: Vec<(Key, Vec<Try>)> = vec![];
    let mut index = BTreeMap::new();
    for row in 0..table.len() {
        let (key, tried) = columns.tried(table, row)?;
        let k = *index.entry(key.clone()).or_insert_with(|| {
            groups.push((key, vec![]));
            groups.len() - 1
        });
        groups[k].1.push(tried);
    }
    let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut map = Map { name, ..Map::default() };
    let mut n_open = 0;
    for (key, tries) in &groups {
        match bracket(tries) {
            Ok(ends) => {
                n_open += usize::from(ends.0.is_none() || ends.1.is_none());
                map.points.push(columns.point(table, key, tries, ends)?);
            }
            Err(contradiction) => {
                map.remarks.push(told(table, key, &contradiction));
                map.leave_out("contradictory brackets");
            }
        }
    }
    if n_open > 0 {
        map.remarks.push(format!(
            "{n_open} brackets are open (nothing captured, or everything did): Interval likelihoods take them, TopHat (models/erp.rs) does not; --closed leaves them out"
        ));
    }
    map.remarks.extend(table.notes().iter().cloned());
    Ok(Study { format: "pacing log".into(), maps: vec![map], remarks: vec![] })
}

/// Lower and upper end; an open end is `None`.
type Ends = (Option<f64>, Option<f64>);

/// Tries that captured, and longer ones that did not.
struct Contradiction<'t> {
    captured: Vec<&'t Try>,
    failed: Vec<&'t Try>,
}

/// The ends of the bracket, or the tries that contradict each other.
fn bracket(tries: &[Try]) -> Result<Ends, Contradiction<'_>> {
    let (yes, no): (Vec<&Try>, Vec<&Try>) = tries.iter().partition(|t| t.captured);
    let upper = yes.iter().map(|t| t.interval).min_by(f64::total_cmp);
    let lower = no.iter().map(|t| t.interval).max_by(f64::total_cmp);
    match (lower, upper) {
        (Some(lower), Some(upper)) if upper <= lower => {
            let captured = yes.into_iter().filter(|t| t.interval <= lower).collect();
            let failed = no.into_iter().filter(|t| t.interval >= upper).collect();
            Err(Contradiction { captured, failed })
        }
        ends => Ok(ends),
    }
}

/// The contradiction in words, with its lines.
fn told(table: &Table, key: &Key, contradiction: &Contradiction) -> String {
    let list = |tries: &[&Try]| {
        let one = |t: &&Try| format!("{} ms (line {})", t.interval, table.line(t.row));
        tries.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let (site, protocol, s1, s2) = key;
    let [s1, s2] = [("S1", s1), ("S2", s2)].map(|(name, text)| match text.as_str() {
        "" => String::new(),
        text => format!(", {name} {text} ms"),
    });
    format!(
        "contradiction at site {site}, {protocol}{s1}{s2}: captured at {}, but not at {}",
        list(&contradiction.captured),
        list(&contradiction.failed)
    )
}

impl Columns {
    fn of(table: &Table) -> Result<Self, DataError> {
        let found = |name: &str| named(table, name);
        let needed = |name: &str| match found(name) {
            Some(column) => Ok(column),
            None => table.require(name, WHO).map(|column| column.name().to_owned()),
        };
        let (captured, s2) = (needed("captured")?, needed("s2")?);
        let (s1, s3) = (found("s1"), found("s3"));
        let own = [Some(&captured), Some(&s2), s1.as_ref(), s3.as_ref()];
        let is_known = |name: &&String| {
            [SITE, VERTEX, "x", "y", "z"].contains(&name.as_str()) || own.contains(&Some(*name))
        };
        let others = table.columns().iter().filter(|name| !is_known(name)).cloned().collect();
        Ok(Self { captured, s1, s2, s3, others })
    }

    /// What was tried in a row, and what it belongs to.
    fn tried(&self, table: &Table, row: usize) -> Result<(Key, Try), DataError> {
        let s2 = table.number(row, &self.s2, WHO)?;
        let s3 = match &self.s3 {
            Some(column) => Some(table.number_or_empty(row, column, WHO)?).filter(|x| !x.is_nan()),
            None => None,
        };
        let interval = s3.unwrap_or(s2);
        if !(interval > 0.0 && interval < 5_000.0) {
            let column = if s3.is_some() { self.s3.as_ref() } else { None };
            let problem = format!("expected an interval between 0 and 5000 ms, got {interval}");
            let help = "coupling intervals are in ms";
            return Err(table.cell_error(row, column.unwrap_or(&self.s2), problem, help));
        }
        let cell = table.cell(row, &self.captured).unwrap_or_default().to_lowercase();
        let captured = match cell.as_str() {
            yes if YES.contains(&yes) => true,
            no if NO.contains(&no) => false,
            _ => {
                let problem = format!("expected yes or no, got `{cell}`");
                let help =
                    "say whether the last stimulus captured: yes or no, true or false, 1 or 0";
                return Err(table.cell_error(row, &self.captured, problem, help));
            }
        };
        let text = |column: &Option<String>| {
            let cell = column.as_ref().and_then(|column| table.cell(row, column));
            cell.unwrap_or_default().to_owned()
        };
        let (protocol, fixed) =
            if s3.is_some() { ("s1s2s3", s2.to_string()) } else { ("s1s2", String::new()) };
        let key = (site(table, row), protocol, text(&self.s1), fixed);
        Ok((key, Try { row, interval, captured }))
    }

    /// The point of a bracket: at the place of its first line, with what all of its lines agree on.
    fn point(
        &self,
        table: &Table,
        (site, protocol, s1, s2): &Key,
        tries: &[Try],
        (lower, upper): Ends,
    ) -> Result<Point, DataError> {
        let first = tries[0].row;
        let mut point = Point::at(site.clone(), place(table, first)?);
        for t in tries {
            if place(table, t.row)? != point.site {
                let problem =
                    format!("site {site} lies elsewhere than in line {}", table.line(first));
                let help = "give the lines of one site one place, or another name";
                return Err(table.cell_error(t.row, SITE, problem, help));
            }
        }
        let value = Value::Bracket(lower, upper);
        point.readings.push(Reading { protocol: (*protocol).into(), value });
        for (column, text) in [("s1_ms", s1), ("s2_ms", s2)] {
            if !text.is_empty() {
                point.cells.insert(column.into(), text.clone());
            }
        }
        for column in &self.others {
            let cell = |t: &Try| table.cell(t.row, column).unwrap_or_default();
            let own = cell(&tries[0]);
            if !own.is_empty() && tries.iter().all(|t| cell(t) == own) {
                point.cells.insert(column.clone(), own.into());
            }
        }
        Ok(point)
    }
}

/// The name of a row's site: its column, else its place.
fn site(table: &Table, row: usize) -> String {
    let cell = |name: &str| table.cell(row, name).filter(|cell| !cell.is_empty());
    if let Some(site) = cell(SITE) {
        return site.into();
    }
    if let Some(vertex) = cell(VERTEX) {
        return format!("V{vertex}");
    }
    ["x", "y", "z"].map(|name| cell(name).unwrap_or_default()).join(" ")
}

fn place(table: &Table, row: usize) -> Result<Site, DataError> {
    if table.has(VERTEX) {
        let vertex = table.number(row, VERTEX, WHO)?;
        if !(vertex >= 0.0 && vertex.fract() == 0.0 && vertex < 4e9) {
            let problem = format!("expected a vertex of the mesh, got {vertex}");
            return Err(table.cell_error(row, VERTEX, problem, "vertices are counted from 0"));
        }
        return Ok(Site::Vertex(vertex as usize));
    }
    let mut place = [0.0; 3];
    for (x, name) in place.iter_mut().zip(["x", "y", "z"]) {
        *x = table.number(row, name, "a pacing log without a column `vertex`")?;
    }
    Ok(Site::At(place))
}

/// The column of this name, whatever its case and with its unit behind it (`S2 [ms]`).
fn named(table: &Table, name: &str) -> Option<String> {
    let is = |header: &&String| {
        let (own, unit) = header.split_once(['[', '(']).unwrap_or((header, "ms"));
        let own = own.trim().to_lowercase();
        let is_ms = unit.trim_end_matches([']', ')', ' ']) == "ms";
        is_ms && (own == name || own == format!("{name}_ms"))
    };
    table.columns().iter().find(is).cloned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Measurements;

    fn log(text: &str) -> Result<Study, ImportError> {
        let file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(Path::new("log.csv"), &Measurements::read(file.path()).unwrap())
    }

    #[test]
    fn brackets_are_found_in_any_order() {
        let study = log("Site;Vertex;S1 [ms];S2 [ms];S3 [ms];Captured;catheter
A;3;600;280;;yes;N1
A;3;600;240;;no;N1
A;3;600;260,5;;Yes;N1
A;3;600;250;;no;N1
B;5;600;300;;ja;N2
A;3;600;300;200;no;N1
A;3;600;300;220;yes;N2
")
        .unwrap();
        let points = &study.maps[0].points;
        let told: Vec<_> =
            points.iter().map(|p| (p.name.as_str(), p.readings[0].clone())).collect();
        let reading = |protocol: &str, lower, upper| Reading {
            protocol: protocol.into(),
            value: Value::Bracket(lower, upper),
        };
        assert_eq!(
            told,
            [
                ("A", reading("s1s2", Some(250.0), Some(260.5))),
                ("B", reading("s1s2", None, Some(300.0))),
                ("A", reading("s1s2s3", Some(200.0), Some(220.0))),
            ]
        );
        assert_eq!(points[0].cells["catheter"], "N1");
        assert_eq!((points[2].cells.get("catheter"), &points[2].cells["s2_ms"][..]), (None, "300"));
        assert!(study.maps[0].remarks[0].starts_with("1 brackets are open"));
    }

    #[test]
    fn contradictions_are_shown_and_nothing_is_made_of_them() {
        let study = log("site,vertex,s2,captured
A,3,250,yes
A,3,260,no
A,3,240,no
A,3,280,yes
")
        .unwrap();
        assert!(study.maps[0].points.is_empty());
        assert_eq!(
            study.maps[0].remarks[0],
            "contradiction at site A, s1s2: captured at 250 ms (line 2), but not at 260 ms (line 3)"
        );
    }

    #[test]
    fn cells_that_say_nothing_are_named() {
        for (text, expected) in [
            (
                "site,vertex,s2,captured\nA,3,250,maybe\n",
                "line 2, column `captured`: expected yes or no, got `maybe`",
            ),
            (
                "site,vertex,s2,captured\nA,3,-5,yes\n",
                "expected an interval between 0 and 5000 ms, got -5",
            ),
            (
                "site,vertex,s2,captured\nA,3,250,yes\nA,4,240,no\n",
                "site A lies elsewhere than in line 2",
            ),
            (
                "site,s2,captured\nA,250,yes\n",
                "no column `x`, which a pacing log without a column `vertex` reads",
            ),
            (
                "site,vertex,s2 [s],captured\nA,3,0.25,yes\n",
                "no column `s2`, which a pacing log reads",
            ),
        ] {
            let error = log(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
