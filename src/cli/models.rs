//! Which compiled model belongs to a model file: one in this program, or one compiled on the spot.

use std::fs;
use std::path::{Path, PathBuf};

use super::mistake::{self, Mistake};
use crate::error::Failure;
use crate::model::{Declare, Model};

/// A model that is compiled into this program.
#[derive(Clone, Copy)]
pub struct Compiled {
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

/// A model file and its text.
pub(super) struct ModelFile {
    pub(super) path: PathBuf,
    pub(super) source: String,
}

impl ModelFile {
    /// Reads it.
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        if path.extension().is_none_or(|e| e != "rs") {
            return Err(Failure::new(format_args!(
                "{}: expected a model file (.rs)\nhelp: a model is Rust source with one `model! {{ … }}`; see models/erp.rs",
                path.display()
            )));
        }
        let source = fs::read_to_string(path).map_err(|error| {
            Failure::new(format_args!(
                "cannot read the model file {}: {error}\nhelp: the models that ship are in the folder models, for instance models/erp.rs",
                path.display()
            ))
        })?;
        Ok(Self { path: path.to_owned(), source })
    }

    /// The name in `model NAME;`, which the compiled program must export.
    pub(super) fn model_name(&self) -> Result<&str, Failure> {
        let code = mistake::code(&self.source);
        let mut models = code.match_indices("model!").map(|(at, word)| at..at + word.len());
        let mistake = match (models.next(), models.next()) {
            (None, _) => {
                return Err(Failure::new(format_args!(
                    "{}: expected `model! {{ model NAME; … }}`, found none\nhelp: a model file declares one; see models/normal.rs",
                    self.path.display()
                )));
            }
            (Some(one), None) => match declared_name(&self.source[one.end..]) {
                Some(name) => return Ok(name),
                None => Mistake::new(
                    "a model begins with `model NAME;`",
                    one,
                    "name it in the first line: `model Atrium;`",
                ),
            },
            (_, Some(second)) => Mistake::new(
                "expected one model in a file, found another",
                second,
                "put it into a file of its own",
            ),
        };
        Err(Failure::new(mistake.show(self)))
    }

    /// The model among those compiled into this program, if its source is the same.
    ///
    /// # Errors
    /// A model that contradicts itself, in its units for instance, with the place in the file.
    pub(super) fn find(
        &self,
        compiled: &[Compiled],
    ) -> Result<Option<&'static dyn Declare>, Failure> {
        let Some(found) = compiled.iter().find(|c| c.source == self.source) else {
            return Ok(None);
        };
        Model::outline(found.model).map_err(|error| {
            let mistake = Mistake::of_model(&error, &self.source);
            mistake.map_or_else(|| error.into(), |mistake| Failure::new(mistake.show(self)))
        })?;
        Ok(Some(found.model))
    }
}

/// The identifier after `{ /// … model` at the start of a `model!` body.
fn declared_name(body: &str) -> Option<&str> {
    let body = body.trim_start().strip_prefix(['{', '('])?;
    let mut code = body.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with("//"));
    let rest = code.next()?.strip_prefix("model ")?;
    let end = rest.find(';')?;
    Some(rest[..end].trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(source: &str) -> ModelFile {
        ModelFile { path: "m.rs".into(), source: source.into() }
    }

    #[test]
    fn the_name_is_found_below_its_doc_comment() {
        let source =
            "use eplat::prelude::*;\nmodel! {\n    /// Doc.\n\n    model Erp;\n param a ~ Flat; }";
        assert_eq!(file(source).model_name().unwrap(), "Erp");
    }

    #[test]
    fn no_model_and_two_models_are_errors() {
        assert!(file("fn main() {}").model_name().unwrap_err().to_string().contains("found none"));
        let two = "model! { model A; }\nmodel! { model B; }";
        let said = file(two).model_name().unwrap_err().to_string();
        assert!(said.contains("found another\n --> m.rs:2:1\n"), "{said}");
        let one = "// model! in a comment\nmodel! { model A; }";
        assert_eq!(file(one).model_name().unwrap(), "A");
    }
}
