//! `eplat init DIR`: a folder to begin in, with a model, a table and what to do with them.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use super::inputs::telling;
use super::models::{Compiled, ModelFile};
use super::voice::stdout;
use crate::error::Failure;
use crate::model::Model;
use crate::run::{DataSource, Design, Inputs, Loaded, MeshSource};
use crate::store::write_folder;

const TABLE: &str = "measurements.csv";
/// Models to begin with.
const EXAMPLES: &str = "erp, erp_robust or voltage";

/// `eplat init DIR`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Folder to make; it must not be there yet
    dir: PathBuf,
    /// Model to begin with: `erp` or `erp_robust` (refractory periods), or `voltage`
    #[arg(long, default_value = "erp")]
    model: PathBuf,
    /// Seed of the example's measurements
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Command {
    /// Makes the folder, whole or not at all.
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<(), Failure> {
        let dir = &self.dir;
        if dir.exists() {
            return Err(Failure::usage(format_args!(
                "{} is there already\nhelp: name a folder that eplat may make",
                dir.display()
            )));
        }
        let file = ModelFile::read(&self.model, compiled)?;
        let unshipped = || {
            Failure::usage(format_args!(
                "{} is no model that ships\nhelp: a model of your own needs no folder made for it",
                self.model.display()
            ))
        };
        let shipped = compiled.iter().find(|c| c.source == file.source);
        let model = shipped.ok_or_else(unshipped)?.model;
        let design = Design { seed: self.seed, ..Design::default() };
        let inputs = Inputs {
            mesh: MeshSource::default(),
            data: DataSource::Synthetic(design),
            ..Inputs::default()
        };
        let made = if Model::outline(model)?.has_fields() {
            Loaded::new(model, &inputs, &telling()).map_err(|error| error.to_string())
        } else {
            Err("the model has no fields on a surface".into())
        };
        let loaded = made.map_err(|why| self.without_example(&why))?;
        let name = file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let texts = [
            (name.clone(), file.source.clone()),
            (TABLE.into(), loaded.measurements.to_csv()),
            ("README.md".into(), readme(&name, loaded.measurements.columns())),
        ];
        let write = |folder: &Path| {
            texts.iter().try_for_each(|(name, text)| std::fs::write(folder.join(name), text))
        };
        write_folder(dir, write).map_err(|error| Failure::io("write", dir, &error))?;
        let mut out = stdout();
        writeln!(out, "{}: {name}, {TABLE}, README.md", dir.display())?;
        writeln!(out, "next: cd {} && {}", dir.display(), command("run", &name))?;
        Ok(())
    }

    /// Why no example of this model can be made, and which have one.
    fn without_example(&self, why: &str) -> Failure {
        let why = why.lines().next().unwrap_or_default();
        Failure::usage(format_args!(
            "{0} has no example measurements: {why}\nhelp: choose {EXAMPLES}, or print the model with `eplat show {0} --source`",
            self.model.display()
        ))
    }
}

fn command(what: &str, model: &str) -> String {
    format!("eplat {what} {model} --mesh embedded --data {TABLE}")
}

/// What the folder is for, and what to do in it.
fn readme(model: &str, columns: &[String]) -> String {
    let stem = model.trim_end_matches(".rs");
    format!(
        "# A calibration with eplat

- `{model}` is the model. Change it as you like: it runs as it is written. Only Rust functions or types of your own
  need a compiler (https://rustup.rs).
- `{TABLE}` holds measurements of an example, which eplat made on its own atrium. Put yours in
  their place, in the same columns: `{columns}`.
  A row is placed by a `vertex` of the mesh, counted from 0, or by `x`, `y`, `z` in the mesh's unit.
  Further columns are kept; `eplat loop` tries each as a cause.
- Your mesh (.vtp, .vtk, .ply, .stl, .obj, openCARP) takes the place of `embedded`. `eplat import`
  makes mesh and table of a study that a mapping system exported.

Look at what is there, before anything is computed; then compute the posterior (`out/{stem}`); then ask
what the model lacks (`out/{stem}-loop`; this needs 10 sites or more):

```sh
{check}
{run}
{close}
```

Open `out/{stem}/report.html`. Its verdict says what to believe, and what to do about the rest.
",
        columns = columns.join("`, `"),
        check = command("check", model),
        run = command("run", model),
        close = command("loop", model),
    )
}
