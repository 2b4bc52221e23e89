//! `eplat check MODEL.rs`: validates input without sampling, and times one gradient.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::compile::run_compiled;
use super::coverage;
use super::inputs::InputArgs;
use super::models::{Compiled, ModelFile};
use super::voice::stdout;
use crate::diagnostics::verdict::Colour;
use crate::error::Failure;
use crate::run::Problem;

/// `eplat check MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), or the name of a model that ships, for instance erp
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let file = ModelFile::read(&self.model, compiled)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let problem = self.input.problem(&file, model)?;
        let check = problem.check()?;
        let mut out = stdout();
        writeln!(out, "{check}")?;
        if self.input.has_data() {
            write!(out, "{}", self.coverage(&problem, compiled)?)?;
        }
        Ok(ExitCode::from(if check.colour() == Colour::Red { 4 } else { 0 }))
    }

    /// How far the sites lie from the surface, and what else the table suffices for.
    fn coverage(&self, problem: &Problem<'_>, compiled: &[Compiled]) -> Result<String, Failure> {
        let Some(domain) = &problem.loaded().domain else { return Ok(String::new()) };
        let off_surface =
            coverage::off_surface(&domain.surface, problem.measurements(), domain.scale);
        let Some(table) = self.input.table()? else { return Ok(off_surface) };
        let others: Vec<Compiled> =
            compiled.iter().filter(|c| c.model.name() != problem.model().name).copied().collect();
        let said = coverage::others(&others, &domain.surface, domain.scale, &table);
        Ok(off_surface + &said)
    }
}
