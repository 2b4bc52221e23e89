//! `saturating(row.c, centre)`

use super::form::{EffectForm, Extent, Form, of_number};
use crate::table::Measurements;

#[derive(Debug)]
struct Saturating {
    column: String,
    centre: f64,
}

/// (c − centre)/(c + centre), with a positive centre: it goes from −1 at c = 0 towards 1 as c
/// grows, and changes most around the centre. A negative c counts as 0. It is 0 at the centre, and
/// where the cell is empty.
pub fn saturating(column: &str, centre: f64) -> Form {
    Saturating { column: column.into(), centre }.into()
}

impl EffectForm for Saturating {
    fn written(&self, number: fn(f64) -> String) -> String {
        format!("saturating({}, {})", Form::row(&self.column), number(self.centre))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        of_number(table, &self.column, 1, |x| {
            let x = x.max(0.0);
            [(x - self.centre) / (x + self.centre)]
        })
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn extent(&self) -> Extent {
        Extent::Range(format!("from end to end of its curve in {}", self.column))
    }
}
