//! The unit over which a covariate varies: what cross-validation must leave out as a whole.

use std::collections::BTreeMap;

use crate::dsl::{Measurements, distinct};

/// A partition of a table's rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Unit {
    /// Column that makes it.
    pub name: String,
    /// Group of each row.
    pub group: Vec<usize>,
    /// Number of groups.
    pub n: usize,
}

/// Fewer units than this cannot confirm an effect.
pub(super) const LEAST_UNITS: usize = 5;

/// Words in the names of columns that say which occasion a row belongs to.
const OCCASIONS: [&str; 10] =
    ["session", "rec", "heart", "patient", "subject", "day", "date", "run", "study", "case"];

/// Rows by site: column `site`, else `vertex`, else each row alone.
pub(super) fn by_site(table: &Measurements) -> Unit {
    let column = ["site", "vertex"].into_iter().find(|c| table.has(c));
    column.map_or_else(
        || Unit { name: "row".into(), group: (0..table.len()).collect(), n: table.len() },
        |column| by_label(table, column),
    )
}

/// Rows by the text of a column; an empty cell is a group of its own.
fn by_label(table: &Measurements, column: &str) -> Unit {
    let mut groups: BTreeMap<&str, usize> = BTreeMap::new();
    let group = (0..table.len()).map(|row| {
        let next = groups.len();
        *groups.entry(table.cell(row, column).unwrap_or_default()).or_insert(next)
    });
    let group = group.collect();
    Unit { name: column.into(), group, n: groups.len() }
}

/// The coarsest occasion within which `column` is constant; the site if there is none.
pub(super) fn unit_of(table: &Measurements, column: &str) -> Unit {
    let site = by_site(table);
    let is_occasion = |name: &str| {
        let name = name.to_lowercase();
        OCCASIONS.iter().any(|word| name.starts_with(word))
    };
    let mut coarsest: Option<Unit> = None;
    for other in table.columns().iter().filter(|c| *c != column && is_occasion(c)) {
        let n_labels = distinct(table, other).len();
        if n_labels < 2 || n_labels >= site.n || !is_constant_within(table, column, other) {
            continue;
        }
        if coarsest.as_ref().is_none_or(|unit| n_labels < unit.n) {
            coarsest = Some(by_label(table, other));
        }
    }
    coarsest.unwrap_or(site)
}

/// Whether `column` has one value for each label of `other`.
pub(super) fn is_constant_within(table: &Measurements, column: &str, other: &str) -> bool {
    let mut seen: BTreeMap<&str, &str> = BTreeMap::new();
    (0..table.len()).all(|row| {
        let label = table.cell(row, other).unwrap_or_default();
        let cell = table.cell(row, column).unwrap_or_default();
        *seen.entry(label).or_insert(cell) == cell
    })
}
