//! `eplat mesh …`

use crate::error::Failure;
use clap::Subcommand;

/// `eplat mesh …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {}

impl Command {
    pub(super) fn run(self) -> Result<(), Failure> {
        match self {}
    }
}
