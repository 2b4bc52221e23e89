//! `group(row.c)`

use super::form::{EffectForm, Extent, Form, of_labels};
use crate::table::Measurements;

#[derive(Debug)]
struct Group {
    column: String,
}

/// One coefficient per label, in order of appearance in the table.
pub fn group(column: &str) -> Form {
    Group { column: column.into() }.into()
}

impl EffectForm for Group {
    fn written(&self, _: fn(f64) -> String) -> String {
        format!("group({})", Form::row(&self.column))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        of_labels(table, &self.column, &self.labels(table), |cell| cell)
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn labels(&self, table: &Measurements) -> Vec<String> {
        table.distinct(&self.column)
    }
    fn extent(&self) -> Extent {
        Extent::Labels
    }
}
