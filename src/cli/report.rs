//! `eplat report DIR`: says again what the end of a run said.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use super::voice::stdout;
use crate::error::Failure;
use crate::run::Results;

/// `eplat report DIR`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Output folder of a finished run
    folder: PathBuf,
}

impl Command {
    /// The exit code is that of the run: 3 where it did not converge, 4 where its verdict is red.
    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let results = Results::read(&self.folder)?;
        let page = where_is_the_page(&self.folder);
        writeln!(stdout(), "{}\n{page}", results.text())?;
        Ok(ExitCode::from(results.verdict().exit_code()))
    }
}

/// Whether to rely on the results.
pub(super) fn exit_code(converged: bool) -> ExitCode {
    if converged { ExitCode::SUCCESS } else { ExitCode::from(3) }
}

fn where_is_the_page(folder: &Path) -> String {
    let page = folder.join("report.html");
    if page.is_file() {
        format!("Open {} in a browser for fields and traces", page.display())
    } else {
        format!("{} is not there; repeat the run to make it", page.display())
    }
}
