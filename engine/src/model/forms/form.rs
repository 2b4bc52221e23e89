//! What a form of an effect is.

use std::any::Any;
use std::fmt::Debug;
use std::ops::Deref;
use std::sync::Arc;

use eplat_language::as_name;

use crate::table::Measurements;

/// How an effect depends on a row: the right-hand side of an `effect` statement.
///
/// The effect's offset in a row is the row of the [design](Self::design) times the coefficients.
pub trait EffectForm: Any + Debug + Send + Sync {
    /// The design, row-major (rows of the table, n), and n, the number of coefficients. It is 0
    /// where a cell is empty.
    fn design(&self, table: &Measurements) -> (Vec<f64>, usize);

    /// The form as it is written in a model file, with `row` for the row. `number` writes a number;
    /// [`Form::row`] writes a column. It is needed only for forms that `eplat loop` tries, or that
    /// code adds to a model.
    fn written(&self, _number: fn(f64) -> String) -> String {
        format!("{self:?}")
    }

    /// The column that it reads. A table without it is refused.
    fn column(&self) -> Option<&str> {
        None
    }

    /// A further column that the table must have.
    fn also_requires(&self) -> Option<&str> {
        None
    }

    /// The labels behind its coefficients, if these belong to labels.
    fn labels(&self, _table: &Measurements) -> Vec<String> {
        vec![]
    }

    /// The number of modes of the surface that it needs.
    fn n_modes(&self) -> usize {
        0
    }

    /// What is called the size of such an effect.
    fn extent(&self) -> Extent {
        Extent::Range("from its least to its greatest over the measurements".into())
    }

    /// The effect in words, as something that a model lacks. `on` are the quantities that it acts
    /// on.
    fn in_words(&self, on: &str) -> String {
        match self.column() {
            Some(column) => format!("an effect of {column} on {on}"),
            None => format!("an offset of {on}"),
        }
    }
}

/// What is called the size of an effect. In a text it stands behind a number and a unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Extent {
    /// Its one coefficient.
    Coefficient(String),
    /// The greatest difference between two labels.
    Labels,
    /// The range of its offsets over the measurements.
    Range(String),
    /// The standard deviation of its offsets over the measurements.
    Sd(String),
}

/// A form of any kind. Two forms are equal if they are written in the same way.
#[derive(Clone, Debug)]
pub struct Form(Arc<dyn EffectForm>);

impl<F: EffectForm> From<F> for Form {
    fn from(form: F) -> Self {
        Self(Arc::new(form))
    }
}

impl Deref for Form {
    type Target = dyn EffectForm;
    fn deref(&self) -> &Self::Target {
        self.0.as_ref()
    }
}

impl PartialEq for Form {
    fn eq(&self, other: &Self) -> bool {
        self.text() == other.text()
    }
}

impl Form {
    /// As it is written in a model file, with `row` for the row.
    pub fn text(&self) -> String {
        self.written(|x| format!("{x:?}"))
    }

    /// The same without `row` and with three decimals, for reading.
    pub fn rounded(&self) -> String {
        self.written(|x| format!("{x:.3}")).replace("row.", "")
    }

    /// A column of the row as it is written in a model file: `row.contact_force` for `contact force`.
    pub fn row(column: &str) -> String {
        format!("row.{}", as_name(column))
    }

    /// The form as one of the type `F`, if it is one.
    pub fn downcast<F: EffectForm>(&self) -> Option<&F> {
        (self.0.as_ref() as &dyn Any).downcast_ref()
    }
}

/// The design of `n` functions of a column of numbers; 0 where its cell is empty.
pub fn of_number<Z: AsRef<[f64]>>(
    table: &Measurements,
    column: &str,
    n: usize,
    functions: impl Fn(f64) -> Z,
) -> (Vec<f64>, usize) {
    let mut z = vec![0.0; table.len() * n];
    if let Some(column) = table.column(column) {
        for (row, own) in z.chunks_exact_mut(n).enumerate() {
            if let Some(x) = column.number(row).filter(|x| x.is_finite()) {
                own.copy_from_slice(functions(x).as_ref());
            }
        }
    }
    (z, n)
}

/// A design with a column for each label. `label` gives the label of a cell.
pub fn of_labels(
    table: &Measurements,
    column: &str,
    labels: &[String],
    label: impl Fn(&str) -> &str,
) -> (Vec<f64>, usize) {
    let mut z = vec![0.0; table.len() * labels.len()];
    for row in 0..table.len() {
        let own = label(table.cell(row, column).unwrap_or_default());
        if let Some(own) = labels.iter().position(|l| l == own) {
            z[row * labels.len() + own] = 1.0;
        }
    }
    (z, labels.len())
}
