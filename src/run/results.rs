//! A finished run as its folder has it.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::RunError;
use crate::diagnostics::verdict::Verdict;
use crate::report::{Row, RunRecord, end_of_run, read_summary_json, verdict};

/// Of this build.
pub(super) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The model's text in a run's folder.
pub(super) const MODEL: &str = "model.rs";
/// The table that was fitted.
pub(super) const MEASUREMENTS: &str = "measurements.csv";

/// A finished run as its folder has it.
#[derive(Clone, Debug)]
pub struct Results {
    /// The folder.
    pub folder: PathBuf,
    /// `run.json`.
    pub record: RunRecord,
    /// `summary.json`.
    pub rows: Vec<Row>,
    /// Names of the files that were written; empty where the run was read.
    pub files: Vec<&'static str>,
}

impl Results {
    /// Reads what an earlier run left.
    ///
    /// # Errors
    /// [`RunError::NoRun`]; [`RunError::Report`] for a file that is not there or was edited.
    pub fn read(folder: impl AsRef<Path>) -> Result<Self, RunError> {
        let folder = folder.as_ref().to_owned();
        if !folder.is_dir() {
            return Err(RunError::NoRun { folder });
        }
        let record = RunRecord::read(&folder.join("run.json"))?;
        let rows = read_summary_json(&record.own(&folder, "summary.json")?)?;
        Ok(Self { folder, record, rows, files: vec![] })
    }

    /// Whether the posterior is worth believing, and why.
    pub fn verdict(&self) -> Verdict {
        verdict(&self.record, &self.rows)
    }

    /// Whether the draws come from the posterior, whatever they say.
    pub fn converged(&self) -> bool {
        self.verdict().converged()
    }

    /// What the end of the run says.
    pub fn text(&self) -> String {
        end_of_run(&self.rows, &self.record)
    }

    /// Summary, record and verdict as one object.
    pub fn json(&self) -> Value {
        let rows = self.rows.iter().map(|r| (r.name.clone(), json!(r.summary)));
        let summary: Map<String, Value> = rows.collect();
        let verdict = self.verdict();
        json!({
            "summary": summary,
            "run": self.record,
            "converged": verdict.converged(),
            "verdict": { "colour": verdict.colour(), "answers": verdict.answers },
        })
    }
}
