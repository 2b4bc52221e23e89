//! The functions that [`model!`](crate::prelude::model) writes. Every expression of a model file
//! becomes the body of one function, in an implementation of one of these traits. They are not
//! meant to be written by hand.
//!
//! Such a function takes exactly the numbers that its expression mentions, in the order in which
//! the builder is told their names. It is generic over the number type, so values, first
//! derivatives and second derivatives come from the same text.

use std::borrow::Cow;

use crate::dist::{Dist, Vector};
use crate::field::Kernel;
use crate::likelihood::{Likelihood, Observation};
use crate::num::{Argument, Num, Real};

/// A statement's name, unit and text, for tables and messages.
#[derive(Clone, Debug, Default)]
pub struct Decl {
    /// Declared name.
    pub name: Cow<'static, str>,
    /// Declared unit, empty if none.
    pub unit: Cow<'static, str>,
    /// The prior, the likelihood or the value, as written.
    pub text: Cow<'static, str>,
}

impl Decl {
    /// Made of words that stand in a model file.
    pub const fn new(name: &'static str, unit: &'static str, text: &'static str) -> Self {
        Self { name: Cow::Borrowed(name), unit: Cow::Borrowed(unit), text: Cow::Borrowed(text) }
    }
}

/// A prior as a function of the N numbers that it mentions.
pub trait PriorFn<const N: usize>: Clone + Send + Sync + 'static {
    /// The prior.
    fn prior<T: Real>(&self, s: [Num<T>; N]) -> impl Dist<Num<T>> + use<Self, T, N>;
}

/// The prior of a vector as a function of the N numbers that it mentions: a prior of each number,
/// or of the whole.
pub trait VectorFn<const N: usize>: Clone + Send + Sync + 'static {
    /// The prior.
    fn prior<T: Real>(&self, s: [Num<T>; N]) -> impl Vector<Num<T>> + use<Self, T, N>;
}

/// A field's mean or amplitude as a function of the N numbers that it mentions.
pub trait ScalarFn<const N: usize>: Clone + Send + Sync + 'static {
    /// The value.
    fn value<T: Real>(&self, s: [Num<T>; N]) -> Num<T>;
}

/// A kernel as a function of the N numbers that it mentions.
pub trait KernelFn<const N: usize>: Clone + Send + Sync + 'static {
    /// The kernel.
    fn kernel<T: Real>(&self, s: [Num<T>; N]) -> impl Kernel<Num<T>> + use<Self, T, N>;
}

/// A `let` as a function of its row. Its arguments are the numbers that it mentions, then an offset
/// for each `let` among these.
pub trait LetFn<const N: usize>: Send + Sync + 'static {
    /// The numeric columns that the model reads.
    type Columns: Columns;
    /// The value.
    fn value<T: Real>(s: [Num<T>; N], row: &Self::Columns) -> Num<T>;
}

/// A likelihood as a function of its row. Its arguments are the numbers that it mentions, then an
/// offset for each `let` among these.
pub trait RowFn<const N: usize>: Send + Sync + 'static {
    /// The numeric columns that the model reads.
    type Columns: Columns;
    /// What was measured.
    type Y: Observation;
    /// The likelihood.
    fn likelihood<T: Real>(
        s: [Num<T>; N],
        row: &Self::Columns,
    ) -> impl Likelihood<Num<T>, Self::Y> + use<Self, T, N>;
    /// The measurement, where it is computed from the row's columns.
    fn measured(_: &Self::Columns) -> Option<Self::Y> {
        None
    }
}

/// A log density as a function of the N numbers that it mentions and of the table's columns.
pub trait DensityFn<const N: usize>: Send + Sync + 'static {
    /// The numeric columns that the model reads.
    type Columns: Columns;
    /// The log density, or its terms.
    fn terms<T: Real>(
        s: [Num<T>; N],
        data: &<Self::Columns as Columns>::Data<'_>,
    ) -> impl Terms<Num<T>> + use<Self, T, N>;
}

/// The value of a density: one number, or one for each of the table's last rows.
#[diagnostic::on_unimplemented(
    message = "a density gives a `D` (all in one) or a `Vec<D>` (a term per row), not `{Self}`",
    label = "expected a function `fn f<D: Real>(…) -> D` or `-> Vec<D>`"
)]
pub trait Terms<D> {
    /// Whether there is one for each row.
    const PER_ROW: bool;
    /// The terms.
    fn terms(&self) -> &[D];
}

impl<D: Real> Terms<D> for D {
    const PER_ROW: bool = false;
    #[inline]
    fn terms(&self) -> &[D] {
        std::slice::from_ref(self)
    }
}

impl<D: Real> Terms<D> for Vec<D> {
    const PER_ROW: bool = true;
    #[inline]
    fn terms(&self) -> &[D] {
        self
    }
}

/// The numeric columns of one row that a model reads, as a struct that the macro declares.
pub trait Columns: Sized + Send + Sync + 'static {
    /// The same columns over many rows, a slice each.
    type Data<'a>;
    /// Each column's name, and the table's columns behind it.
    fn names() -> Vec<(&'static str, Vec<String>)>;
    /// Reads each column by name.
    ///
    /// # Errors
    /// Those of `column`.
    fn read<E>(column: &mut dyn FnMut(&str) -> Result<f64, E>) -> Result<Self, E>;
    /// Cells of each column, row after row, as slices.
    fn data(cells: &[Vec<f64>]) -> Self::Data<'_>;
}

/// A numeric column as it appears in `row`: one number, or the N numbers x1, x2, … xN.
pub trait Column: Copy {
    /// The table's columns behind it.
    fn names(name: &str) -> Vec<String>;
    /// Their cells, row after row, as one value per row.
    fn rows(cells: &[f64]) -> &[Self];
}

impl Column for f64 {
    fn names(name: &str) -> Vec<String> {
        vec![name.into()]
    }
    fn rows(cells: &[f64]) -> &[f64] {
        cells
    }
}

impl<const N: usize> Column for [f64; N] {
    fn names(name: &str) -> Vec<String> {
        (1..=N).map(|i| format!("{name}{i}")).collect()
    }
    fn rows(cells: &[f64]) -> &[[f64; N]] {
        cells.as_chunks().0
    }
}

/// One row of a column, by name.
///
/// # Errors
/// Those of `column`.
pub fn read_column<C: Column, E>(
    name: &str,
    column: &mut dyn FnMut(&str) -> Result<f64, E>,
) -> Result<C, E> {
    let cells = C::names(name).iter().map(|n| column(n)).collect::<Result<Vec<_>, E>>()?;
    Ok(C::rows(&cells)[0])
}

/// The cells of a column over many rows.
pub fn column_of<'a, C: Column>(cells: &mut std::slice::Iter<'a, Vec<f64>>) -> &'a [C] {
    cells.next().map_or(&[], |cells| C::rows(cells))
}

/// Makes a number with derivatives of a plain number; a number with derivatives stays what it is.
#[inline(always)]
pub fn number<T: Real>(x: impl Argument<Num<T>>) -> Num<T> {
    x.number()
}
