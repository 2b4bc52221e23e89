//! From a declared model to one that is laid out.

use super::builder::Builder;
use super::error::ModelError;
use super::laid_out::Model;
use crate::manifold::Basis;
use crate::table::Measurements;

/// Implemented by [`model!`](crate::model): a model as declared, without data.
pub trait Declare: Sync {
    /// The model's name.
    fn name(&self) -> &'static str;
    /// The model as it stands in its file, between the brackets of `model! { … }`.
    fn source(&self) -> String;
    /// Calls the builder, once for each statement.
    ///
    /// # Errors
    /// What does not fit between the model and the builder's data.
    fn declare(&self, b: &mut Builder<'_>) -> Result<(), ModelError>;
}

/// A model that is compiled into this program.
#[derive(Clone, Copy)]
pub struct Compiled {
    /// Name of its file, without folders.
    pub file: &'static str,
    /// Its source, as it was compiled.
    pub source: &'static str,
    /// The model.
    pub model: &'static dyn Declare,
}

impl std::fmt::Debug for Compiled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Compiled").field("model", &self.model.name()).finish_non_exhaustive()
    }
}

impl Model {
    /// Lays `model` out on `basis` and `data`.
    ///
    /// # Errors
    /// What does not fit between them.
    pub fn new(
        model: &dyn Declare,
        basis: Option<&Basis>,
        data: &Measurements,
    ) -> Result<Self, ModelError> {
        let mut b = Builder::new(Self::empty(model.name(), model.source()), basis, Some(data));
        model.declare(&mut b)?;
        b.finish()
    }

    /// As [`Model::new`], with an offset in every row for each of these fields and `let`s that its
    /// likelihood depends on. An offset is zero unless somebody sets it. This is how criticism adds
    /// what it tries.
    ///
    /// # Errors
    /// Those of [`Model::new`].
    pub fn with_offsets(
        model: &dyn Declare,
        basis: Option<&Basis>,
        data: &Measurements,
        offsets_on: &[String],
    ) -> Result<Self, ModelError> {
        let mut b = Builder::new(Self::empty(model.name(), model.source()), basis, Some(data));
        b.want_offsets(offsets_on.iter().cloned());
        model.declare(&mut b)?;
        b.finish()
    }

    /// The model without data: its statements and parameters.
    ///
    /// # Errors
    /// An effect on nothing.
    pub fn outline(model: &dyn Declare) -> Result<Self, ModelError> {
        let mut b = Builder::new(Self::empty(model.name(), model.source()), None, None);
        model.declare(&mut b)?;
        b.finish()
    }
}
