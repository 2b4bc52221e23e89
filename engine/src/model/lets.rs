//! `let`s as numbers to report: the value of an expression at each draw.

use super::map::MapFn;
use super::tape::Tape;

/// The place of a value on the tape, and that of an offset that effects may have added to it
/// (`v[0]`, which is zero, if none).
pub(super) type Local = [u32; 2];

/// The values of a `let` that depends on rows or on labels, or on parameters of a model without fields.
#[derive(Debug)]
pub struct LetValues {
    /// Its name in the model file.
    pub name: &'static str,
    /// Declared unit, empty if none.
    pub unit: String,
    /// What tells its values apart: labels, or lines of the table; none if it is a single number.
    pub labels: Vec<String>,
    /// Number of values.
    pub len: usize,
    pub(super) of: Values,
}

/// Where the values come from.
#[derive(Debug)]
pub(super) enum Values {
    /// A linear predictor: they lie on the tape one after the other.
    Linear(Vec<Local>),
    /// An expression: the places of its scalars `(len, n)`, and the offset of each value.
    Expression { at: Box<dyn MapFn>, scalars: Vec<Local>, offset: Vec<u32> },
}

impl LetValues {
    /// Its values after a forward pass.
    pub(super) fn values(&self, t: &Tape, out: &mut Vec<f64>) {
        let number = |[value, offset]: &Local| t.v[*value as usize] + t.v[*offset as usize];
        match &self.of {
            Values::Linear(places) => out.extend(places.iter().map(number)),
            Values::Expression { at, scalars, offset } => {
                let n = scalars.len() / self.len;
                for (row, offset) in offset.iter().enumerate() {
                    let s: Vec<f64> = scalars[row * n..][..n].iter().map(number).collect();
                    out.push(at.value(&s, Some(row)) + t.v[*offset as usize]);
                }
            }
        }
    }
}
