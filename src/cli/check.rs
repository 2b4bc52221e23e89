//! `eplat check MODEL.rs`: validates input without sampling, and times one gradient.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::compile::run_compiled;
use super::inputs::InputArgs;
use super::models::{Compiled, ModelFile};
use crate::diagnostics::verdict::Colour;
use crate::error::Failure;

/// `eplat check MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), for instance models/erp.rs
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let file = ModelFile::read(&self.model)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let check = self.input.problem(&self.model, model)?.check()?;
        writeln!(std::io::stdout().lock(), "{check}")?;
        Ok(ExitCode::from(if check.colour() == Colour::Red { 4 } else { 0 }))
    }
}
