//! The files of a loop, besides those of its fits.

use super::{LoopError, Story};
use crate::criticism::{Cause, rewrite};
use crate::run::OutputFolder;

impl Story {
    /// Writes everything but the two fits, the page last: the model with what was found (`source` is the
    /// text of its file, `stem` that file's name without its ending), the predictions of held-out rows,
    /// `finding.json` and `report.html`. Gives the names of all files, those of the fits included.
    ///
    /// # Errors
    /// A text without a model; a file that cannot be written.
    pub fn write(
        &self,
        out: &OutputFolder,
        source: &str,
        stem: &str,
    ) -> Result<Vec<String>, LoopError> {
        let mut files: Vec<String> = vec![];
        for (name, text) in self.texts(source, stem)? {
            out.save(&name, &text)?;
            files.push(name);
        }
        files.push("before/report.html".into());
        if self.after.is_some() {
            files.push("after/report.html".into());
        }
        out.save("report.html", &self.page(&files))?;
        files.push("report.html".into());
        Ok(files)
    }

    /// Names and contents of the files before the page.
    fn texts(&self, source: &str, stem: &str) -> Result<Vec<(String, String)>, LoopError> {
        let mut texts = vec![];
        if self.after.is_some() {
            let effects = self.effects.iter().map(|f| (f.effect.clone(), f.why.clone()));
            let text = rewrite(source, &effects.collect::<Vec<_>>(), self.outliers()).map_err(
                |mistake| LoopError::ModelText { name: stem.to_owned(), mistake: mistake.message },
            )?;
            let causes: Vec<String> =
                self.criticism.findings().into_iter().map(Cause::name).collect();
            texts.push((format!("{stem}_plus_{}.rs", causes.join("_")), text));
        }
        if let Some(held_out) = &self.held_out {
            texts.push(("heldout_predictions.csv".into(), held_out.csv()));
        }
        texts.push(("finding.json".into(), format!("{:#}\n", self.finding())));
        Ok(texts)
    }
}
