//! `scaled_by(row.c, row.label, centre, scale)`

use super::family::{families, family};
use super::form::{EffectForm, Form};
use super::scaled::scaled;
use crate::table::Measurements;

#[derive(Debug)]
struct ScaledBy {
    column: String,
    by: String,
    centre: f64,
    scale: f64,
}

/// (c − centre)/scale, with a coefficient of its own for each family of labels of the column `by`:
/// an effect that differs from region to region. A family is a label without its trailing digits.
/// It is 0 where the cell of c is empty.
pub fn scaled_by(column: &str, by: &str, centre: f64, scale: f64) -> Form {
    ScaledBy { column: column.into(), by: by.into(), centre, scale }.into()
}

impl EffectForm for ScaledBy {
    fn written(&self, number: fn(f64) -> String) -> String {
        let [column, by] = [&self.column, &self.by].map(|c| Form::row(c));
        format!("scaled_by({column}, {by}, {}, {})", number(self.centre), number(self.scale))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        let (z, _) = scaled(&self.column, self.centre, self.scale).design(table);
        let (mut design, n) = family(&self.by).design(table);
        for (own, z) in design.chunks_exact_mut(n.max(1)).zip(z) {
            for label in own {
                *label *= z;
            }
        }
        (design, n)
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn also_requires(&self) -> Option<&str> {
        Some(&self.by)
    }
    fn in_words(&self, on: &str) -> String {
        format!("an effect of {} on {on} that differs by {}", self.column, self.by)
    }
    fn labels(&self, table: &Measurements) -> Vec<String> {
        families(table, &self.by)
    }
}
