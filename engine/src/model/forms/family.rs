//! `family(row.c)`

use super::form::{EffectForm, Extent, Form, of_labels};
use crate::table::Measurements;

#[derive(Debug)]
struct Family {
    column: String,
}

/// One coefficient per family of labels. A family is a label without its trailing digits: PV1, PV2,
/// … are PV.
pub fn family(column: &str) -> Form {
    Family { column: column.into() }.into()
}

impl EffectForm for Family {
    fn written(&self, _: fn(f64) -> String) -> String {
        format!("family({})", Form::row(&self.column))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        of_labels(table, &self.column, &self.labels(table), without_digits)
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn labels(&self, table: &Measurements) -> Vec<String> {
        families(table, &self.column)
    }
    fn extent(&self) -> Extent {
        Extent::Labels
    }
}

/// A label without its trailing digits.
fn without_digits(label: &str) -> &str {
    label.trim_end_matches(|c: char| c.is_ascii_digit())
}

/// Labels of a column without their trailing digits, in order of appearance.
pub fn families(table: &Measurements, column: &str) -> Vec<String> {
    let mut all: Vec<String> = vec![];
    for label in table.distinct(column) {
        if !all.iter().any(|f| f == without_digits(&label)) {
            all.push(without_digits(&label).into());
        }
    }
    all
}
