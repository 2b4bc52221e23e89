//! Options that say what a model is run on.

use std::path::{Path, PathBuf};

use clap::Args;

use super::models::ModelFile;
use super::progress::tell_event;
use super::reading::ReadingArgs;
use crate::error::Failure;
use crate::mesh::Reading;
use crate::model::{Declare, Model};
use crate::run::{
    DataSource, Design, Inputs, Loaded, MeshSource, ModelText, Problem, RunError, Watch,
};
use crate::table::Measurements;

/// What `--mesh` calls the procedural left atrium.
const EMBEDDED: &str = "embedded";

/// The command with these arguments, as a shell takes it.
fn command_line(arguments: impl Iterator<Item = String>) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    let word = |argument: String| {
        if !argument.is_empty() && argument.chars().all(is_plain) {
            return format!(" {argument}");
        }
        format!(" '{}'", argument.replace('\'', r"'\''"))
    };
    format!("eplat{}", arguments.map(word).collect::<String>())
}

/// Options that say what a model is run on.
#[derive(Debug, Args)]
pub(super) struct InputArgs {
    /// Surface mesh: VTK (.vtp, .vtu, .vtk), .ply, .stl, .obj, openCARP's .pts, or .npz. `embedded` is the
    /// procedural left atrium, the default for a synthetic experiment
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingArgs,
    /// Keep every vertex of a mesh of more than 100,000, which is otherwise decimated to 20,000
    #[arg(long)]
    whole_mesh: bool,
    /// Eigenpairs of the mesh from elsewhere, in its unit: arrays `eigenvalues` (K) and
    /// `eigenfunctions` (vertices, K); `eplat mesh basis` writes the same
    #[arg(long, value_name = "FILE.npz")]
    pub(super) basis: Option<PathBuf>,
    /// Table of measurements: vertex or x, y, z; protocol; lower and upper, or value; one row each
    /// [default: a synthetic experiment on the surface]
    #[arg(long, value_name = "FILE.csv")]
    data: Option<PathBuf>,
    /// Seed of every random stream
    #[arg(long, default_value_t = 1)]
    pub(super) seed: u64,
}

impl InputArgs {
    /// Whether measurements were given.
    pub(super) fn has_data(&self) -> bool {
        self.data.is_some()
    }

    /// The table that was given, as it is read.
    pub(super) fn table(&self) -> Result<Option<Measurements>, Failure> {
        Ok(self.data.as_deref().map(Measurements::read).transpose()?)
    }

    /// As the library takes them; the draws depend on the file of the model too.
    pub(super) fn inputs(
        &self,
        model: &ModelFile,
        declared: &dyn Declare,
    ) -> Result<Inputs, Failure> {
        let mesh = self.mesh(declared)?;
        let data = match &self.data {
            Some(path) => DataSource::File(path.clone()),
            None => DataSource::Synthetic(Design { seed: self.seed, ..Design::default() }),
        };
        let path = std::path::absolute(&model.path).ok();
        let text = Some(ModelText { text: model.source.clone(), path });
        let arguments = std::env::args_os().skip(1);
        let command = command_line(arguments.map(|a| a.to_string_lossy().into_owned()));
        Ok(Inputs { mesh, basis: self.basis.clone(), data, model: text, command })
    }

    /// The surface that is named. A table must name its own: its vertices are not those of another.
    fn mesh(&self, declared: &dyn Declare) -> Result<MeshSource, Failure> {
        let fields = || Ok::<_, Failure>(Model::outline(declared)?.has_fields());
        let ReadingArgs { units, piece } = self.reading;
        let is_said = units.is_some() || piece.is_some() || self.whole_mesh;
        match self.mesh.as_deref() {
            Some(path) if path == Path::new(EMBEDDED) && is_said => Err(Failure::usage(
                "--mesh embedded is in mm and in one piece\nhelp: leave --units, --piece and --whole-mesh out; for a file of this name write ./embedded",
            )),
            Some(path) if path == Path::new(EMBEDDED) => Ok(MeshSource::ATRIUM),
            None if is_said => Err(Failure::usage(
                "--units, --piece and --whole-mesh say how a mesh is read, and there is no --mesh\nhelp: name it with --mesh FILE",
            )),
            None if self.data.is_some() && fields()? => Err(Failure::usage(
                "--data without --mesh: the model has a field, and the table's rows lie on a surface\nhelp: name it with --mesh FILE; --mesh embedded is the procedural left atrium",
            )),
            file => Ok(source(file.map(|path| (path, self.reading.of(path))), self.whole_mesh)),
        }
    }

    /// The model declared in `file` on everything that it needs; says on stderr what that is.
    pub(super) fn problem<'m>(
        &self,
        file: &ModelFile,
        declared: &'m dyn Declare,
    ) -> Result<Problem<'m>, Failure> {
        Problem::load_watched(declared, &self.inputs(file, declared)?, &telling()).map_err(usage)
    }

    /// Reads or makes everything that the model declared in `file` needs; says on stderr what it is.
    pub(super) fn load(&self, file: &ModelFile, declared: &dyn Declare) -> Result<Loaded, Failure> {
        Loaded::new(declared, &self.inputs(file, declared)?, &telling()).map_err(usage)
    }
}

/// Tells every event on stderr.
pub(super) fn telling() -> Watch<'static> {
    Watch { on_event: &tell_event, ..Watch::default() }
}

/// A model that needs measurements is a matter of the command line.
pub(super) fn usage(error: RunError) -> Failure {
    match error {
        RunError::NoMeasurements { .. }
        | RunError::NoField
        | RunError::NoProtocol { .. }
        | RunError::Exceedance(_) => Failure::usage(error),
        other => other.into(),
    }
}

/// The surface in a file, or the embedded atrium.
pub(super) fn source(file: Option<(&Path, Reading)>, whole: bool) -> MeshSource {
    file.map_or_else(MeshSource::default, |(path, reading)| MeshSource::File {
        path: path.to_owned(),
        reading,
        whole,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_recorded_command_can_be_given_again() {
        let arguments = ["run", "a b/erp.rs", "--exceed", "erp_s2 > 250", "--out", "it's", ""];
        let line = command_line(arguments.iter().map(ToString::to_string));
        assert_eq!(line, r"eplat run 'a b/erp.rs' --exceed 'erp_s2 > 250' --out 'it'\''s' ''");
    }
}
