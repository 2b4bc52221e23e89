//! Which model belongs to a model file: one that is compiled into this program, or the file's own, evaluated as it is
//! written. A file that only a compiler understands has neither.

use std::fs;
use std::path::{Path, PathBuf};

use eplat_language::{File, Mistake};

use crate::error::Failure;
pub use crate::model::Compiled;
use crate::model::{Beyond, Declare, Interpreted};
use crate::run::Inputs;

/// A model file and its text.
pub(super) struct ModelFile {
    pub(super) path: PathBuf,
    pub(super) source: String,
}

impl ModelFile {
    /// Reads it, or takes the model that ships under this name, such as `erp`.
    pub(super) fn read(path: &Path, compiled: &[Compiled]) -> Result<Self, Failure> {
        let names = || compiled.iter().filter_map(|c| c.file.strip_suffix(".rs"));
        if let Some(shipped) =
            compiled.iter().find(|c| Path::new(c.file).with_extension("") == path)
        {
            return Ok(Self { path: shipped.file.into(), source: shipped.source.into() });
        }
        if path.extension().is_none_or(|e| e != "rs") {
            return Err(Failure::new(format_args!(
                "{}: expected a model file (.rs), or the name of a model that ships\nhelp: these are {}; `eplat show NAME --source` prints one to edit",
                path.display(),
                names().collect::<Vec<_>>().join(", ")
            )));
        }
        Self::of_file(path)
    }

    /// Reads it.
    pub(super) fn of_file(path: &Path) -> Result<Self, Failure> {
        if path.extension().is_none_or(|e| e != "rs") {
            return Err(Failure::new(format_args!(
                "{}: expected a model file (.rs)\nhelp: a model is Rust source with one `model! {{ … }}`; `eplat show erp --source` prints one",
                path.display()
            )));
        }
        let source = fs::read_to_string(path).map_err(|error| {
            Failure::new(format_args!(
                "cannot read the model file {}: {error}\nhelp: `eplat show erp --source` prints a model that ships, for a file of your own",
                path.display()
            ))
        })?;
        Ok(Self { path: path.to_owned(), source })
    }

    /// That of a finished run.
    pub(super) fn of_run(inputs: &Inputs) -> Self {
        let model = inputs.model.clone();
        let (text, path) = model.map_or_else(Default::default, |m| (m.text, m.path));
        Self { path: path.unwrap_or_default(), source: text }
    }

    /// Its model's tree.
    ///
    /// # Errors
    /// All mistakes that its text shows, each at its place.
    pub(super) fn checked(&self) -> Result<File, Failure> {
        let file = File::read(&self.source).map_err(|mistake| self.mistakes(&[mistake]))?;
        match &file.check()[..] {
            [] => Ok(file),
            mistakes => Err(self.mistakes(mistakes)),
        }
    }

    fn mistakes(&self, mistakes: &[Mistake]) -> Failure {
        let path = self.path.display().to_string();
        let shown: Vec<String> = mistakes.iter().map(|m| m.show(&path, &self.source)).collect();
        Failure::new(shown.join("\n\nerror: "))
    }

    /// The model: among those compiled into this program, if its source is the same, otherwise as it is written.
    /// `None` of one that only a compiler understands.
    ///
    /// # Errors
    /// Those of [`ModelFile::checked`].
    pub(super) fn find(
        &self,
        compiled: &[Compiled],
    ) -> Result<Option<&'static dyn Declare>, Failure> {
        if let Some(found) = compiled.iter().find(|c| c.source == self.source) {
            return Ok(Some(found.model));
        }
        // a process has one model or two, and keeps them until it ends
        let own = Interpreted::of(&self.checked()?).ok();
        Ok(own.map(|own| &*Box::leak(Box::new(own)) as &dyn Declare))
    }

    /// What of it only a compiler understands.
    pub(super) fn needs_a_compiler_for(&self) -> String {
        let read = self.checked().map(|file| Interpreted::of(&file));
        if let Ok(Err(Beyond(what))) = read { what } else { String::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(source: &str) -> ModelFile {
        ModelFile { path: "m.rs".into(), source: source.into() }
    }

    #[test]
    fn all_mistakes_are_shown_with_their_places() {
        let two = "use eplat::prelude::*;\nmodel! {\n    model M;\n    param a ~ Nromal(0, 1);\n    param b ~ Flat();\n}\n";
        let said = file(two).checked().unwrap_err().to_string();
        let places = [
            "unknown name `Nromal`\n --> m.rs:4:15\n",
            "\n\nerror: `Flat` takes no arguments\n --> m.rs:5:15\n",
        ];
        assert!(places.iter().all(|place| said.contains(place)), "{said}");
        let none = file("fn main() {}").checked().unwrap_err().to_string();
        assert!(none.contains("found none"), "{none}");
    }
}
