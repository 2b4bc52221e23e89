//! `scaled(row.c, centre, scale)`

use super::form::{EffectForm, Extent, Form, of_number};
use crate::table::Measurements;

#[derive(Debug)]
struct Scaled {
    column: String,
    centre: f64,
    scale: f64,
}

/// (c − centre)/scale, 0 where the cell is empty.
pub fn scaled(column: &str, centre: f64, scale: f64) -> Form {
    Scaled { column: column.into(), centre, scale }.into()
}

impl EffectForm for Scaled {
    fn written(&self, number: fn(f64) -> String) -> String {
        let Self { column, centre, scale } = self;
        format!("scaled({}, {}, {})", Form::row(column), number(*centre), number(*scale))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        of_number(table, &self.column, 1, |x| [(x - self.centre) / self.scale])
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn extent(&self) -> Extent {
        Extent::Coefficient(format!("per {:.3} of {}", self.scale, self.column))
    }
}
