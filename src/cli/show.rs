//! `eplat show MODEL.rs`

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::models::{Compiled, ModelFile};
use super::voice::stdout;
use crate::error::Failure;
use crate::model::{Model, equations};

/// `eplat show MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), or the name of a model that ships, for instance erp
    model: PathBuf,
    /// Print the text of the model file instead, to be edited
    #[arg(long)]
    source: bool,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let file = ModelFile::read(&self.model, compiled)?;
        if self.source {
            write!(stdout(), "{}", file.source)?;
            return Ok(ExitCode::SUCCESS);
        }
        let Some(model) = file.find(compiled)? else { return super::compile::run_compiled(&file) };
        let text = equations(&Model::outline(model)?);
        write!(stdout(), "{text}")?;
        Ok(ExitCode::SUCCESS)
    }
}
