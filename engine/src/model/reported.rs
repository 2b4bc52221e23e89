//! Parameters as they are reported.

use crate::dist::Support;

/// What a parameter is, for tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One number.
    Scalar,
    /// Several.
    Vector,
    /// Standard normal coefficients of a GP term.
    Eta,
}

/// A declared parameter as it is reported.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// `sigma`, or `field.name` for a hyperparameter.
    pub name: String,
    /// Declared unit, empty if none.
    pub unit: String,
    /// How many numbers.
    pub len: usize,
    /// What it is.
    pub kind: Kind,
    /// The labels behind the numbers, for `param b(operator)`.
    pub labels: Vec<String>,
    /// The prior as written.
    pub prior: String,
    /// Whether its prior is flat: a density without end, so that there is no prior width.
    pub is_flat: bool,
    /// Its support.
    pub support: Support,
    pub(super) position: Position,
}

impl Parameter {
    /// Name of its `i`-th number: `b[2]`, or the name alone if it is one.
    pub fn element(&self, i: usize) -> String {
        match (self.kind, self.labels.get(i)) {
            (Kind::Scalar, _) => self.name.clone(),
            (_, Some(label)) => format!("{}[{label}]", self.name),
            (_, None) => format!("{}[{i}]", self.name),
        }
    }
}

/// Where a parameter's numbers come from.
#[derive(Clone, Debug)]
pub(super) enum Position {
    /// Values from here on.
    Values(usize),
    /// Unknowns from here on; `first` is 1 where the constant mode is drawn afterwards.
    Eta { u: usize, first: usize, field: usize, term: usize },
    /// The mean of a field whose constant mode is drawn afterwards.
    CollapsedMean { field: usize },
    /// The values of these rows, from `v` on.
    Cells { v: usize, rows: Vec<usize> },
}
