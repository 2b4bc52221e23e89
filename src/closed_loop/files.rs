//! The files of a loop, besides those of its fits.

use super::{LoopError, Story, kept};
use crate::criticism::{Cause, Findings, rewrite};
use crate::run::{OutputFolder, RunError};

/// The record of a loop.
pub(super) const FINDING: &str = "finding.json";
const HELD_OUT: &str = "heldout_predictions.csv";
const PAGE: &str = "report.html";
/// The folders of a loop's fits.
pub const FITS: [&str; 3] = ["declared", "before", "after"];

/// Removes what an earlier loop left, the record first, so that no file of it stands beside new ones.
///
/// # Errors
/// [`RunError::Write`], [`RunError::InUse`].
pub(super) fn clear(out: &OutputFolder) -> Result<(), RunError> {
    let (_, own) = out.earlier(FINDING);
    out.remove(&[FINDING, HELD_OUT, PAGE])?;
    out.remove(&own.iter().map(String::as_str).collect::<Vec<_>>())?;
    for fit in FITS.iter().filter(|fit| out.file(fit).exists()) {
        OutputFolder::open(out.file(fit))?.clear()?;
    }
    Ok(())
}

impl Story {
    /// Writes everything but the fits: the model with what was found, the predictions of held-out
    /// rows, `report.html` and, last, `finding.json`. `source` is the text of the model file,
    /// `stem` its name without its ending. Returns the names of all files, those of the fits
    /// included.
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
        let mut own = files.clone();
        own.push(PAGE.into());
        files.push(FINDING.into());
        let pages = self.fits().map(|told| format!("{}/report.html", told.which));
        files.extend(pages.collect::<Vec<_>>().into_iter().rev());
        out.save(PAGE, &self.page(&files))?;
        files.push(PAGE.into());
        out.save_record(FINDING, self.finding(), &own)?;
        kept::forget(out)?;
        Ok(files)
    }

    /// Refuses a folder in which files have the names of a loop's and there is no loop.
    ///
    /// # Errors
    /// [`RunError::Foreign`].
    pub fn refuse_foreign(out: &OutputFolder) -> Result<(), RunError> {
        if out.earlier(FINDING).0.get("findings").is_some() {
            return Ok(());
        }
        out.refuse_foreign([FINDING, HELD_OUT, PAGE].into_iter())
    }

    /// Names and contents of the files before the page, but for the record.
    fn texts(&self, source: &str, stem: &str) -> Result<Vec<(String, String)>, LoopError> {
        let mut texts = vec![];
        if self.after.is_some() || self.before.is_some() {
            let effects = self.effects.iter().map(|f| (f.effect.clone(), f.why.clone()));
            let findings = Findings {
                discrepancy: self.discrepancy.clone(),
                effects: effects.collect(),
                outliers: self.outliers(),
            };
            let text = rewrite(source, &findings).map_err(|mistake| LoopError::ModelText {
                name: stem.to_owned(),
                mistake: mistake.message,
            })?;
            let causes = self.criticism.findings().into_iter();
            let causes: Vec<String> = causes.map(Cause::name).collect();
            let what = if causes.is_empty() { "discrepancy".into() } else { causes.join("_") };
            texts.push((format!("{stem}_plus_{what}.rs"), text));
        }
        if let Some(held_out) = &self.held_out {
            texts.push((HELD_OUT.into(), held_out.csv()));
        }
        Ok(texts)
    }
}
