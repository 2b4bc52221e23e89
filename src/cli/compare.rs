//! `eplat compare A B`: which of two models predicts the same measurements better.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::voice::stdout;
use crate::error::Failure;
use crate::run::Comparison;

/// `eplat compare A B`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Output folder of a run
    a: PathBuf,
    /// Output folder of another run on the same measurements
    b: PathBuf,
    /// Print the comparison as JSON on stdout
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let comparison = Comparison::of(&self.a, &self.b)?;
        let mut stdout = stdout();
        if self.json {
            writeln!(stdout, "{:#}", comparison.json())?;
        } else {
            writeln!(stdout, "{}", comparison.text())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
