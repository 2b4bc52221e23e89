//! `eplat predict DIR TABLE`: what a finished run says of rows that it has not seen.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use serde_json::json;

use super::compile::run_compiled;
use super::inputs::telling;
use super::models::{Compiled, ModelFile};
use super::voice::{Voice, stdout, tell};
use crate::error::Failure;
use crate::run::{Forecast, Inputs, MeshSource, OutputFolder, Problem, Results, hash_file};
use crate::table::Measurements;

const EXAMPLE: &str = "The table needs the columns of the one that was fitted: where (vertex or x, y, z), protocol, and what else
the model reads. What was measured may be there, and is then compared with what is predicted; its cells
may be empty. A new site or patient is drawn from its prior.

  eplat run erp --out run
  eplat predict run new_sites.csv";

/// `eplat predict DIR TABLE`
#[derive(Debug, Args)]
#[command(after_help = EXAMPLE)]
pub(super) struct Command {
    /// Output folder of a finished run
    run: PathBuf,
    /// Rows to predict (CSV)
    table: PathBuf,
    /// The mesh of the run, if it is no longer where it was
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Output folder [default: predicted, in the folder of the run]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    pub(super) voice: Voice,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let results = Results::read(&self.run)?;
        let mut inputs = Inputs::of_run(&results)?;
        let file = ModelFile::of_run(&inputs);
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let out =
            OutputFolder::open(self.out.clone().unwrap_or_else(|| self.run.join("predicted")))?;
        // what an earlier prediction left has both
        if !out.file("predictions.zarr/zarr.json").exists() {
            out.refuse_foreign(Forecast::FILES.into_iter())?;
        }
        if let MeshSource::File { path, .. } = &mut inputs.mesh {
            *path = self.mesh.clone().unwrap_or_else(|| path.clone());
            if !path.exists() {
                return Err(Failure::new(format_args!(
                    "the mesh of the run is not at {}\nhelp: name it with --mesh FILE",
                    path.display()
                )));
            }
        }
        let table = Measurements::read(&self.table)?;
        let problem = Problem::load_watched(model, &inputs, &telling())?;
        let mut forecast = problem.predict(&results, &table)?;
        forecast.hashes.insert(Forecast::TABLE.into(), hash_file(&self.table)?);
        let files = forecast.write(&out)?;
        let mut stdout = stdout();
        if self.voice.json {
            writeln!(stdout, "{}", forecast.json())?;
        } else {
            writeln!(stdout, "\n{}", forecast.text())?;
        }
        let folder = out.path().display();
        let text = format_args!("wrote {} to {folder}", files.join(", "));
        tell(
            "written",
            text,
            json!({ "folder": out.path(), "files": files, "draws": forecast.n_draws() }),
        );
        Ok(ExitCode::SUCCESS)
    }
}
