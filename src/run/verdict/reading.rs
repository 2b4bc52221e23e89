//! What a measurement says of the number that replicates are kept as, and which measurements belong together.

use crate::likelihood::OPEN_STEP;
use crate::table::{Measurements, Role};

/// A column with fewer rows per label than this, on average, makes no groups.
const ROWS_PER_LABEL: usize = 3;

/// What a measurement says of the number that replicates are kept as: the lower end of a bracket.
#[derive(Debug)]
pub(in crate::run) struct Reading {
    pub(super) low: f64,
    pub(super) high: f64,
    /// Width of the bracket, or the step assumed where it is open; 0 for a number.
    pub(in crate::run) width: f64,
}

impl Reading {
    pub(in crate::run) fn of(cells: &[f64]) -> Self {
        let width = OPEN_STEP;
        match *cells {
            [lower, upper] if lower.is_infinite() => {
                Self { low: lower, high: upper - width, width }
            }
            [lower, upper] if upper.is_infinite() => Self { low: lower, high: upper, width },
            [lower, upper] => Self { low: lower, high: lower, width: upper - lower },
            _ => Self { low: cells[0], high: cells[0], width: 0.0 },
        }
    }

    /// How far it lies outside an interval of replicates; 0 inside, up to rounding.
    pub(super) fn outside(&self, [from, to]: [f64; 2]) -> f64 {
        let outside = (self.low - to).max(from - self.high);
        if outside <= self.rounding(0.5 * (from + to)) { 0.0 } else { outside }
    }

    /// What two equal numbers about `near` may differ by.
    pub(super) fn rounding(&self, near: f64) -> f64 {
        1e-9 * (self.width + near.abs())
    }
}

/// All measurements, those of each statement, and those of each label of a column that says how they
/// were made: names, and indices into `rows`, which has statement and row of the table of each.
pub(super) fn groups(rows: &[(&str, usize)], table: &Measurements) -> Vec<(String, Vec<usize>)> {
    let where_ = |is_of: &dyn Fn(&str, usize) -> bool| -> Vec<usize> {
        (0..rows.len()).filter(|i| is_of(rows[*i].0, rows[*i].1)).collect()
    };
    let mut sets = vec![("all".to_owned(), (0..rows.len()).collect())];
    let mut statements: Vec<&str> = rows.iter().map(|(name, _)| *name).collect();
    statements.dedup();
    if statements.len() > 1 {
        sets.extend(statements.iter().map(|s| ((*s).to_owned(), where_(&|of, _| of == *s))));
    }
    for name in table.columns() {
        let labels = table.distinct(name);
        let is_group = table.column(name).is_some_and(|c| c.numbers().is_none())
            && !matches!(table.role(name), Role::Structural | Role::Fold)
            && labels.len() > 1
            && labels.len() * ROWS_PER_LABEL <= rows.len();
        for label in labels.iter().filter(|_| is_group) {
            let own = where_(&|_, row| table.cell(row, name) == Some(label));
            sets.push((format!("{name} {label}"), own));
        }
    }
    sets.retain(|(_, own)| !own.is_empty());
    sets
}
