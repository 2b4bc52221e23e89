//! What is doubtful about a table before anything is fitted to it: warnings with a name each, and
//! rows that are copies.

use std::collections::{BTreeMap, BTreeSet};

use super::units::{LEAST_UNITS, by_site, occasion_of, site_column};
use crate::table::{Content, MEASURED, Measurements, TypedColumn};

/// A doubt about a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// Name of the check: `repeated_rows`, `not_a_number`, `missing_in_group`, `scale_in_group` or
    /// `few_units`; for held-out rows `heldout_label`, `heldout_scale` or `heldout_not_a_number`.
    pub check: &'static str,
    /// The column, if it is about one.
    pub column: Option<String>,
    /// What, where, and what to do.
    pub text: String,
}

/// A column with more labels than this is not used to compare other columns by.
const MOST_GROUPS: usize = 12;
/// A group with fewer values than this is not compared.
const LEAST_VALUES: usize = 3;
/// Two groups hardly share a unit if their ranges are apart and their medians differ by more than
/// this factor.
const SCALE: f64 = 5.0;

/// Makes all checks of a table. `covariates` are the columns that may be tried.
pub(super) fn check(table: &Measurements, covariates: &[&String]) -> Vec<Warning> {
    let labels: Vec<&String> = covariates
        .iter()
        .copied()
        .filter(|c| numbers(table, c).is_none())
        .filter(|c| (2..=MOST_GROUPS).contains(&table.distinct(c).len()))
        .collect();
    let measured = MEASURED.map(String::from);
    let mut warnings: Vec<Warning> = repeated_rows(table, covariates).into_iter().collect();
    for column in covariates {
        warnings.extend(not_a_number(table, column));
        warnings.extend(few_units(table, column));
    }
    for column in covariates.iter().copied().chain(measured.iter().filter(|c| table.has(c))) {
        let Some(values) = numbers(table, column) else { continue };
        for by in &labels {
            let groups = groups(table, by, values);
            warnings.extend(missing_in_group(column, by, &groups));
            warnings.extend(scale_in_group(column, by, &groups));
        }
    }
    warnings
}

/// The values of a column of numbers.
fn numbers<'t>(table: &'t Measurements, column: &str) -> Option<&'t [f64]> {
    table.column(column).and_then(TypedColumn::numbers)
}

/// The values of a column by the label of another; NaN where a cell is empty.
fn groups(table: &Measurements, by: &str, values: &[f64]) -> BTreeMap<String, Vec<f64>> {
    let mut groups: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for (row, value) in values.iter().enumerate() {
        let label = table.cell(row, by).unwrap_or_default();
        if !label.is_empty() {
            groups.entry(label.into()).or_default().push(*value);
        }
    }
    groups
}

/// Rows that repeat an earlier row in every column, each with that row.
fn repeats(table: &Measurements) -> Vec<(usize, usize)> {
    let mut seen: BTreeMap<Vec<&str>, usize> = BTreeMap::new();
    let first = |row| *seen.entry(table.cells(row)).or_insert(row);
    let firsts: Vec<usize> = (0..table.len()).map(first).collect();
    firsts.into_iter().zip(0..table.len()).filter(|(first, row)| first != row).collect()
}

/// Rows that are copies of others: they repeat them in every column, at sites that have names, in a
/// table in which no measurement was repeated with another result. A column counts as a result if
/// it is not among `covariates` and does not say where and how the row was measured.
pub(super) fn copies<'t>(table: &'t Measurements, covariates: &[&String]) -> Vec<usize> {
    let is_result = |column: &String| {
        MEASURED.contains(&column.as_str())
            || table.role(column).is_cause() && !covariates.contains(&column)
    };
    let settings: Vec<&String> = table.columns().iter().filter(|c| !is_result(c)).collect();
    let setting = |row| -> Vec<&str> {
        settings.iter().map(|column| table.cell(row, column).unwrap_or_default()).collect()
    };
    let distinct = |of: &dyn Fn(usize) -> Vec<&'t str>| {
        (0..table.len()).map(of).collect::<BTreeSet<_>>().len()
    };
    let is_replicated = distinct(&setting) < distinct(&|row| table.cells(row));
    if is_replicated || site_column(table).is_none() {
        return vec![];
    }
    repeats(table).into_iter().map(|(_, row)| row).collect()
}

/// Warns of rows that are the same in every column, and says how often they count.
fn repeated_rows(table: &Measurements, covariates: &[&String]) -> Option<Warning> {
    let repeats = repeats(table);
    let (first, row) = repeats.first()?;
    let (first, row, n) = (table.line(*first), table.line(*row), repeats.len());
    let count = if copies(table, covariates).is_empty() {
        "each counts as a measurement of its own; drop it if it is none"
    } else {
        "the search counts each once, the fits before and after count all; drop the copies"
    };
    let text = format!(
        "{n} rows repeat another in every column, the first in lines {first} and {row}: {count}"
    );
    Some(Warning { check: "repeated_rows", column: None, text })
}

/// Warns of a column of numbers in which some cells are no numbers: it is read as a column of
/// labels.
fn not_a_number(table: &Measurements, column: &str) -> Option<Warning> {
    let own = table.column(column)?;
    let Content::Mixed { numbers, first } = own.content() else { return None };
    let filled = (0..table.len()).filter(|row| !own.text(*row).is_empty()).count();
    let odd = numbers.iter().filter(|number| number.is_none()).count();
    if 2 * odd >= filled {
        return None;
    }
    let text = format!(
        "{column}: {odd} of {filled} cells are no numbers, the first `{}` in line {}, so that the column is read as labels; leave a missing value empty",
        own.text(*first),
        table.line(*first)
    );
    Some(Warning { check: "not_a_number", column: Some(column.into()), text })
}

/// Warns of a covariate that varies over too few units to be confirmed.
fn few_units(table: &Measurements, column: &str) -> Option<Warning> {
    let unit = occasion_of(table, column, &by_site(table))?;
    if unit.n >= LEAST_UNITS || table.distinct(column).len() < 2 {
        return None;
    }
    let text = format!(
        "{column} varies only over {} units of `{}`: at least {LEAST_UNITS} are needed to confirm an effect of it",
        unit.n, unit.name
    );
    Some(Warning { check: "few_units", column: Some(column.into()), text })
}

/// Warns of a column that is empty throughout one group and filled in another.
fn missing_in_group(
    column: &str,
    by: &str,
    groups: &BTreeMap<String, Vec<f64>>,
) -> Option<Warning> {
    let n_filled = |values: &[f64]| values.iter().filter(|v| v.is_finite()).count();
    if groups.values().all(|values| n_filled(values) == 0) {
        return None;
    }
    let (label, values) =
        groups.iter().find(|(_, values)| values.len() >= LEAST_VALUES && n_filled(values) == 0)?;
    let text = format!(
        "{column} is empty in every row with {by} {label} ({} rows), and filled in with others: an effect of it is 0 there",
        values.len()
    );
    Some(Warning { check: "missing_in_group", column: Some(column.into()), text })
}

/// Warns of a column whose values in two groups are so far apart that they can hardly share a unit.
fn scale_in_group(column: &str, by: &str, groups: &BTreeMap<String, Vec<f64>>) -> Option<Warning> {
    let spans = groups.iter().filter_map(|(label, values)| Span::of(label, values)).collect();
    let [low, high] = apart(spans)?;
    let text = format!(
        "{column} is {:.0} times as large with {by} {} (median {}) as with {by} {} (median {}): is it in one unit?",
        high.median / low.median,
        high.label,
        high.median,
        low.label,
        low.median
    );
    Some(Warning { check: "scale_in_group", column: Some(column.into()), text })
}

/// Doubts about these columns of held-out rows, in comparison with those of `train`.
pub fn check_heldout(
    train: &Measurements,
    heldout: &Measurements,
    columns: &[&str],
) -> Vec<Warning> {
    let one = |column: &&str| match (numbers(train, column), numbers(heldout, column)) {
        (None, _) => heldout_label(heldout, column, &train.distinct(column)),
        (Some(x), Some(y)) => heldout_scale(column, x, y),
        (Some(_), None) => {
            let text = format!(
                "{column} is a number in every row trained on, and not in every held-out row: an effect of it is 0 where it is none"
            );
            Some(Warning { check: "heldout_not_a_number", column: Some((*column).into()), text })
        }
    };
    columns.iter().filter(|column| heldout.has(column)).filter_map(one).collect()
}

/// Warns of a label that does not occur in the rows for training.
fn heldout_label(heldout: &Measurements, column: &str, known: &[String]) -> Option<Warning> {
    let labels = heldout.distinct(column);
    let label = labels.iter().find(|label| !known.contains(label))?;
    let is_new =
        |row: &usize| !known.iter().any(|k| Some(k.as_str()) == heldout.cell(*row, column));
    let text = format!(
        "{column} {label} is held out and not trained on: {} held-out rows are predicted without an effect of {column}",
        (0..heldout.len()).filter(is_new).count()
    );
    Some(Warning { check: "heldout_label", column: Some(column.into()), text })
}

/// Warns of numbers that can hardly be in the same unit as those for training.
fn heldout_scale(column: &str, train: &[f64], heldout: &[f64]) -> Option<Warning> {
    let spans = [Span::of("rows trained on", train)?, Span::of("held-out rows", heldout)?];
    let [low, high] = apart(spans.into())?;
    let text = format!(
        "{column} is {:.0} times as large in {} (median {}) as in {} (median {}): is it in one unit?",
        high.median / low.median,
        high.label,
        high.median,
        low.label,
        low.median
    );
    Some(Warning { check: "heldout_scale", column: Some(column.into()), text })
}

/// Sorts the groups by their medians. Gives the first two neighbours that can hardly share a unit.
fn apart(mut spans: Vec<Span<'_>>) -> Option<[Span<'_>; 2]> {
    spans.sort_by(|a, b| a.median.total_cmp(&b.median));
    let pair = spans
        .windows(2)
        .find(|pair| pair[1].least > pair[0].greatest && pair[1].median > SCALE * pair[0].median)?;
    Some([pair[0], pair[1]])
}

/// Where the values of a group lie.
#[derive(Clone, Copy)]
struct Span<'a> {
    label: &'a str,
    least: f64,
    median: f64,
    greatest: f64,
}

impl<'a> Span<'a> {
    /// `None` if they are too few, or not all positive.
    fn of(label: &'a str, values: &[f64]) -> Option<Self> {
        let mut x: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        x.sort_by(f64::total_cmp);
        let (least, greatest) = (*x.first()?, *x.last()?);
        let is_span = x.len() >= LEAST_VALUES && least > 0.0;
        is_span.then(|| Self { label, least, median: x[x.len() / 2], greatest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twelve sites, two catheters, forces about 10 g.
    fn rows() -> Vec<Vec<String>> {
        let row = |i: usize| {
            let force = (8.0 + (i * 7 % 5) as f64).to_string();
            let catheter = ["A", "B"][i % 2];
            [&i.to_string(), "200", &force, catheter, ["s1", "s2", "s3"][i / 4]]
                .map(String::from)
                .to_vec()
        };
        (0..12).map(row).collect()
    }

    fn warnings(rows: Vec<Vec<String>>) -> Vec<(&'static str, String)> {
        let header = ["site", "value", "force_g", "catheter", "session"].map(String::from).to_vec();
        let table = Measurements::from_cells("made", header, rows).unwrap();
        let covariates: Vec<&String> = table.columns()[2..].iter().collect();
        check(&table, &covariates).into_iter().map(|w| (w.check, w.text)).collect()
    }

    #[test]
    fn a_clean_table_gives_no_warning() {
        assert_eq!(warnings(rows()), []);
    }

    /// Shocks that captured out of ten, a column of its own: two sets gave the same, a third another result.
    #[test]
    fn replicates_are_no_copies_whatever_column_holds_the_result() {
        let table = |captured: &[&str]| {
            let header = ["site", "force_g", "captured"].map(String::from).to_vec();
            let row = |captured: &&str| ["7", "12", captured].map(String::from).to_vec();
            Measurements::from_cells("made", header, captured.iter().map(row).collect()).unwrap()
        };
        let force = "force_g".to_owned();
        assert_eq!(copies(&table(&["3", "3"]), &[&force]), [1]);
        assert!(copies(&table(&["3", "3", "4"]), &[&force]).is_empty());
    }

    #[test]
    fn every_check_names_what_it_sees_and_where() {
        let mut repeated = rows();
        repeated.push(repeated[4].clone());
        let said = &warnings(repeated)[0];
        assert_eq!(said.0, "repeated_rows");
        assert!(said.1.contains("lines 6 and 14"), "{}", said.1);

        let one = |change: &dyn Fn(usize, &mut Vec<String>)| {
            let mut rows = rows();
            rows.iter_mut().enumerate().for_each(|(i, row)| change(i, row));
            let said = warnings(rows);
            assert_eq!(said.len(), 1, "{said:?}");
            said[0].clone()
        };
        let not = one(&|i, row| {
            if i == 2 {
                row[2] = "NA".into();
            }
        });
        assert!(not.0 == "not_a_number" && not.1.contains("`NA` in line 4"), "{not:?}");
        let missing = one(&|_, row| {
            if row[3] == "B" {
                row[2] = String::new();
            }
        });
        assert!(
            missing.0 == "missing_in_group" && missing.1.contains("catheter B (6 rows)"),
            "{missing:?}"
        );
        let scale = one(&|_, row| {
            if row[3] == "B" {
                row[2] += "000";
            }
        });
        assert!(scale.0 == "scale_in_group" && scale.1.contains("catheter B"), "{scale:?}");
        let unit = one(&|_, row| {
            if row[3] == "A" {
                row[1] = "0.2".into();
            }
        });
        assert!(
            unit.0 == "scale_in_group" && unit.1.starts_with("value is 1000 times"),
            "{unit:?}"
        );
        let few = one(&|i, row| row[2] = (i / 4 + 9).to_string());
        assert!(few.0 == "few_units" && few.1.contains("3 units of `session`"), "{few:?}");
    }

    #[test]
    fn held_out_rows_are_compared_with_those_trained_on() {
        let said = |change: &dyn Fn(usize, &mut Vec<String>)| {
            let mut held = rows();
            held.iter_mut().enumerate().for_each(|(i, row)| change(i, row));
            let header = ["site", "value", "force_g", "catheter", "session"].map(String::from);
            let table = |rows| Measurements::from_cells("made", header.to_vec(), rows).unwrap();
            let columns = ["force_g", "catheter", "session"];
            let warnings = check_heldout(&table(rows()), &table(held), &columns);
            warnings.into_iter().map(|w| (w.check, w.text)).collect::<Vec<_>>()
        };
        assert_eq!(said(&|_, _| {}), []);
        let label = said(&|i, row| row[3] = ["A", "D"][i % 2].into());
        assert!(label.len() == 1 && label[0].0 == "heldout_label", "{label:?}");
        assert!(label[0].1.starts_with("catheter D") && label[0].1.contains("6 held-out rows"));
        let scale = said(&|_, row| row[2] += "0");
        assert!(scale.len() == 1 && scale[0].0 == "heldout_scale", "{scale:?}");
        assert!(scale[0].1.starts_with("force_g is 10 times as large"), "{scale:?}");
        let text = said(&|i, row| {
            if i == 3 {
                row[2] = "low".into();
            }
        });
        assert!(text.len() == 1 && text[0].0 == "heldout_not_a_number", "{text:?}");
    }
}
