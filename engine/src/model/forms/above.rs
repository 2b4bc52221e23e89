//! `above(row.c, threshold)`

use super::form::{EffectForm, Extent, Form, of_number};
use crate::table::Measurements;

/// A sharp edge: 1 beyond a threshold.
#[derive(Debug)]
pub struct Above {
    /// Column.
    pub column: String,
    /// Threshold.
    pub threshold: f64,
}

/// 1 beyond the threshold, else 0.
pub fn above(column: &str, threshold: f64) -> Form {
    Above { column: column.into(), threshold }.into()
}

impl EffectForm for Above {
    fn written(&self, number: fn(f64) -> String) -> String {
        format!("above({}, {})", Form::row(&self.column), number(self.threshold))
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        of_number(table, &self.column, 1, |x| [f64::from(u8::from(x > self.threshold))])
    }
    fn column(&self) -> Option<&str> {
        Some(&self.column)
    }
    fn extent(&self) -> Extent {
        Extent::Coefficient(format!("where {} is above {:.3}", self.column, self.threshold))
    }
}
