//! `eplat report DIR`: says again what the end of a run said.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use crate::error::Failure;
use crate::report::{Row, RunRecord, end_of_run, read_summary_json, verdict};

/// `eplat report DIR`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Output folder of a finished run
    folder: PathBuf,
}

impl Command {
    /// The exit code is that of the run: 3 if its diagnostics failed.
    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let (record, rows) = read_run(&self.folder)?;
        let said = end_of_run(&rows, &record);
        writeln!(std::io::stdout().lock(), "{said}\n{}", where_is_the_page(&self.folder))?;
        Ok(if verdict(&record, &rows).converged { ExitCode::SUCCESS } else { ExitCode::from(3) })
    }
}

/// What a finished run left: its record and its summary.
pub(super) fn read_run(folder: &Path) -> Result<(RunRecord, Vec<Row>), Failure> {
    if !folder.is_dir() {
        return Err(Failure::new(format_args!(
            "no folder {}\nhelp: name the --out folder of a finished run; the default is out/NAME after the model file's name",
            folder.display()
        )));
    }
    let record = RunRecord::read(&folder.join("run.json"))?;
    let rows = read_summary_json(&folder.join("summary.json"))?;
    Ok((record, rows))
}

fn where_is_the_page(folder: &Path) -> String {
    let page = folder.join("report.html");
    if page.is_file() {
        format!("Open {} in a browser for fields and traces", page.display())
    } else {
        format!("{} is not there; repeat the run to make it", page.display())
    }
}
