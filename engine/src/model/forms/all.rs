//! `all(row)`

use super::form::{EffectForm, Extent, Form};
use crate::table::Measurements;

#[derive(Debug)]
struct All;

/// 1 in every row.
pub fn all() -> Form {
    All.into()
}

impl EffectForm for All {
    fn written(&self, _: fn(f64) -> String) -> String {
        "all(row)".into()
    }
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize) {
        (vec![1.0; table.len()], 1)
    }
    fn extent(&self) -> Extent {
        Extent::Coefficient("everywhere".into())
    }
}
