//! The unit over which a covariate varies: cross-validation must leave it out as a whole.

use std::collections::BTreeMap;

use crate::table::{Measurements, Role, SITE, VERTEX};

/// A partition of a table's rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Column that makes it.
    pub name: String,
    /// Group of each row.
    pub group: Vec<usize>,
    /// Number of groups.
    pub n: usize,
}

impl Unit {
    /// One column per group, row-major (rows of the table, groups).
    pub(super) fn design(&self) -> Vec<f64> {
        let mut design = vec![0.0; self.group.len() * self.n];
        for (row, own) in self.group.iter().enumerate() {
            design[row * self.n + own] = 1.0;
        }
        design
    }

    /// Whether a column's labels make the same groups.
    pub(super) fn is_the_same_as(&self, table: &Measurements, column: &str) -> bool {
        column == self.name
            || is_constant_within(table, column, &self.name)
                && is_constant_within(table, &self.name, column)
    }
}

/// Fewer units than this cannot confirm an effect.
pub(super) const LEAST_UNITS: usize = 5;

/// The column that names sites. Without it, each row is a site of its own.
pub fn site_column(table: &Measurements) -> Option<&'static str> {
    [SITE, VERTEX].into_iter().find(|column| table.has(column))
}

/// The site of a row in words: the column of sites with the row's cell, else the row's line.
pub fn site_name(table: &Measurements, row: usize) -> String {
    let cell = |column| Some(format!("{column} {}", table.cell(row, column)?));
    site_column(table).and_then(cell).unwrap_or_else(|| format!("line {}", table.line(row)))
}

/// Rows by site: column `site`, else `vertex`, else each row alone.
pub(super) fn by_site(table: &Measurements) -> Unit {
    site_column(table).map_or_else(
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

/// The unit that has a random effect in every fit, if there is one: the coarsest occasion within
/// which one of these columns is constant. It is there because a column that varies only over a few
/// recordings must explain more than recordings differ by anyway.
pub(super) fn random_unit<'t>(
    table: &Measurements,
    columns: impl Iterator<Item = &'t String>,
) -> Option<Unit> {
    let site = by_site(table);
    let varies =
        |column: &&String| table.distinct(column).len() > 1 && table.role(column) != Role::Unit;
    let units = columns.filter(varies).map(|column| occasion_of(table, column, &site));
    units.flatten().filter(|unit| unit.n >= LEAST_UNITS).min_by_key(|unit| unit.n)
}

/// The unit that is left out as a whole to see whether an effect of `column` (or of no column)
/// predicts. It is the folds of the table, else the coarsest occasion within which the column is
/// constant, else the site.
pub(super) fn unit_of(table: &Measurements, column: Option<&str>) -> Unit {
    if let Some(fold) = table.columns().iter().find(|c| table.role(c) == Role::Fold) {
        return by_label(table, fold);
    }
    let site = by_site(table);
    column.and_then(|column| occasion_of(table, column, &site)).unwrap_or(site)
}

/// The coarsest occasion within which `column` is constant.
pub(super) fn occasion_of(table: &Measurements, column: &str, site: &Unit) -> Option<Unit> {
    let mut coarsest: Option<Unit> = None;
    for other in table.columns().iter().filter(|c| *c != column && table.role(c) == Role::Unit) {
        let n_labels = table.distinct(other).len();
        if n_labels < 2 || n_labels >= site.n || !is_constant_within(table, column, other) {
            continue;
        }
        if coarsest.as_ref().is_none_or(|unit| n_labels < unit.n) {
            coarsest = Some(by_label(table, other));
        }
    }
    coarsest
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
