//! The files of a loop, besides those of its fits.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use super::{LoopError, Story, kept};
use crate::criticism::{Cause, Findings, rewrite};
use crate::run::{OutputFolder, RunError, hash_file};

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
    let own = earlier_files(out);
    out.remove(&[FINDING, HELD_OUT, PAGE])?;
    out.remove(&own.iter().map(String::as_str).collect::<Vec<_>>())?;
    for fit in FITS.iter().filter(|fit| out.file(fit).exists()) {
        OutputFolder::open(out.file(fit))?.clear()?;
    }
    Ok(())
}

/// The files with their hashes.
fn seals(out: &OutputFolder, names: &[String]) -> Result<BTreeMap<String, String>, RunError> {
    let seal = |name: &String| Ok((name.clone(), hash_file(&out.file(name))?));
    names.iter().map(seal).collect()
}

/// The files that an earlier loop names in its record, as far as nobody has changed them since.
fn earlier_files(out: &OutputFolder) -> Vec<String> {
    let text = std::fs::read_to_string(out.file(FINDING)).unwrap_or_default();
    let record: Value = serde_json::from_str(&text).unwrap_or_default();
    let files = record["files"].as_object().into_iter().flatten();
    let is_own = |(name, hash): &(&String, &Value)| {
        let is_name = Path::new(name).components().count() == 1 && !name.starts_with('.');
        is_name && hash_file(&out.file(name)).is_ok_and(|found| hash.as_str() == Some(&found))
    };
    files.filter(is_own).map(|(name, _)| name.clone()).collect()
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
        let mut own = seals(out, &files)?;
        files.push(FINDING.into());
        let pages = self.fits().map(|told| format!("{}/report.html", told.which));
        files.extend(pages.collect::<Vec<_>>().into_iter().rev());
        out.save(PAGE, &self.page(&files))?;
        files.push(PAGE.into());
        own.extend(seals(out, &[PAGE.into()])?);
        let mut finding = self.finding();
        finding["files"] = json!(own);
        out.save(FINDING, &format!("{finding:#}\n"))?;
        kept::forget(out)?;
        Ok(files)
    }

    /// Refuses a folder in which files have the names of a loop's and there is no loop.
    ///
    /// # Errors
    /// [`RunError::Foreign`].
    pub fn refuse_foreign(out: &OutputFolder) -> Result<(), RunError> {
        let is_finding = |text: String| {
            let value = serde_json::from_str::<serde_json::Value>(&text);
            value.is_ok_and(|value| value.get("findings").is_some())
        };
        if std::fs::read_to_string(out.file(FINDING)).is_ok_and(is_finding) {
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
