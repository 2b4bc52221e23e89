//! `eplat check MODEL.rs`: validates input without sampling, and times one gradient.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;

use super::compile::run_compiled;
use super::inputs::InputArgs;
use super::models::{Compiled, ModelFile};
use crate::error::Failure;
use crate::infer::LogDensity as _;
use crate::model::Model;

/// Evaluations that the gradient is timed over.
const EVALUATIONS: u32 = 20_000;

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
        let loaded = self.input.load(&self.model, model)?;
        let model = Model::new(model, loaded.basis(), &loaded.measurements)?;
        let (position, mut gradient) = (model.initial(), vec![0.0; model.dim()]);
        let mut evaluator = model.evaluator();
        let ln_density = evaluator.ln_density(&position, &mut gradient);
        if !ln_density.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            return Err(no_start(&model, &position, ln_density, &gradient));
        }
        let begun = Instant::now();
        for _ in 0..EVALUATIONS {
            std::hint::black_box(
                evaluator.ln_density(std::hint::black_box(&position), &mut gradient),
            );
        }
        let nanoseconds = begun.elapsed().as_secs_f64() * 1e9 / f64::from(EVALUATIONS);
        let mut out = std::io::stdout().lock();
        for observe in &model.observes {
            writeln!(out, "observe {}: {} measurements", observe.name, observe.rows.len())?;
        }
        for density in model.densities.iter().filter(|d| !d.rows.is_empty()) {
            writeln!(out, "density {}: {} measurements", density.name, density.rows.len())?;
        }
        for p in model.parameters.iter().filter(|p| !p.labels.is_empty()) {
            writeln!(out, "param {}: {} labels ({})", p.name, p.len, p.labels.join(", "))?;
        }
        writeln!(out, "{} unknowns", model.dim())?;
        writeln!(
            out,
            "log density {ln_density:.3} at the starting point; {nanoseconds:.0} ns with its gradient"
        )?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Where the log density or its gradient is no number: in a measurement, or in an unknown.
fn no_start(model: &Model, position: &[f64], ln_density: f64, gradient: &[f64]) -> Failure {
    let (mut tape, mut each) = (model.tape(), vec![]);
    model.forward(&mut tape, position);
    model.pointwise(&tape, &mut each);
    let rows = model.measured().flat_map(|(name, rows)| rows.iter().map(move |row| (name, row)));
    let row = rows.zip(&each).find(|(_, ln_likelihood)| !ln_likelihood.is_finite());
    let names = model.unknown_names();
    let unknown = gradient.iter().position(|g| !g.is_finite()).and_then(|i| names.get(i));
    let place = match (row, unknown) {
        (Some(((name, row), ln)), _) => {
            let is_observe = model.observes.iter().any(|o| o.name == name);
            let keyword = if is_observe { "observe" } else { "density" };
            format!("{keyword} {name}: the log likelihood of row {} of the table is {ln}", row + 1)
        }
        (None, Some(name)) => format!("the derivative of the log density in {name} is no number"),
        (None, None) => format!("the log density is {ln_density}, through a prior or a `density`"),
    };
    Failure::new(format_args!(
        "at the starting point (priors at typical values, fields in the middle of their ranges) {place}\nhelp: look for a logarithm, root or quotient there that leaves its domain; give the fields a range"
    ))
}
