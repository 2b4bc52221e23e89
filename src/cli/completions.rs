//! `eplat completions SHELL`: what makes a shell complete eplat's commands and options.

use std::io::Write as _;

use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::voice::stdout;
use crate::error::Failure;

/// `eplat completions SHELL`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// The shell
    shell: Shell,
}

impl Command {
    /// Prints the script.
    pub(super) fn run(&self) -> Result<(), Failure> {
        let mut script = vec![];
        clap_complete::generate(self.shell, &mut super::Cli::command(), "eplat", &mut script);
        Ok(stdout().write_all(&script)?)
    }
}
