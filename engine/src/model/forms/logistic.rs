//! `logistic(row.c, centre, scale)`

use super::form::{EffectForm, Extent, Form, of_number};
use crate::table::Measurements;

#[derive(Debug)]
struct Logistic {
    column: String,
    centre: f64,
    scale: f64,
}

/// A soft edge, from 0 to 1 around the centre: 1/(1 + exp(−(c − centre)/scale)), the scale greater
/// than 0. Two scales below and above the centre it is 0.12 and 0.88. It is 0 where the cell is
/// empty.
pub fn logistic(column: &str, centre: f64, scale: f64) -> Form {
    Logistic { column: column.into(), centre, scale }.into()
}

impl EffectForm for Logistic {
    fn written(&self, number: fn(f64) -> String) -> String {
        let Self { column, centre, scale } = self;
        format!("logistic({}, {}, {})", Form::row(column), number(*centre), number(*scale))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        let z = |x: f64| 1.0 / (1.0 + (-(x - self.centre) / self.scale).exp());
        of_number(table, &self.column, 1, |x| [z(x)])
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn extent(&self) -> Extent {
        let Self { column, centre, .. } = self;
        Extent::Coefficient(format!("well above {centre} of {column}, more than well below"))
    }
}
