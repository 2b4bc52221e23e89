//! Options that say what a model is run on.

use std::path::{Path, PathBuf};
use std::str::FromStr as _;

use clap::Args;

use crate::error::Failure;
use crate::mesh::Units;
use crate::model::Declare;
use crate::run::{
    DataSource, Design, Inputs, Loaded, MeshSource, Problem, RunError, Watch, hash_file,
};

/// Options that say what a model is run on.
#[derive(Debug, Args)]
pub(super) struct InputArgs {
    /// Surface mesh, VTK; needs --units [default: the embedded procedural left atrium]
    #[arg(long, value_name = "FILE.vtk", requires = "units")]
    mesh: Option<PathBuf>,
    /// Unit of the mesh's coordinates: mm, cm, um or m
    #[arg(long, value_name = "UNIT", value_parser = Units::from_str, requires = "mesh")]
    units: Option<Units>,
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

    /// As the library takes them; the draws depend on the file of the model too.
    pub(super) fn inputs(&self, model: &Path) -> Result<Inputs, Failure> {
        let mesh = source(self.mesh.as_deref().zip(self.units));
        let data = match &self.data {
            Some(path) => DataSource::File(path.clone()),
            None => DataSource::Synthetic(Design { seed: self.seed, ..Design::default() }),
        };
        let hashes = [("model".to_owned(), hash_file(model)?)].into();
        Ok(Inputs { mesh, basis: self.basis.clone(), data, hashes })
    }

    /// The model declared in `file` on everything that it needs; says on stderr what that is.
    pub(super) fn problem<'m>(
        &self,
        file: &Path,
        declared: &'m dyn Declare,
    ) -> Result<Problem<'m>, Failure> {
        Problem::load_watched(declared, &self.inputs(file)?, &telling()).map_err(usage)
    }

    /// Reads or makes everything that the model declared in `file` needs; says on stderr what it is.
    pub(super) fn load(&self, file: &Path, declared: &dyn Declare) -> Result<Loaded, Failure> {
        Loaded::new(declared, &self.inputs(file)?, &telling()).map_err(usage)
    }
}

/// Prints every event to stderr.
pub(super) fn telling() -> Watch<'static> {
    Watch { on_event: &|event| eprintln!("{event}"), ..Watch::default() }
}

/// A model that needs measurements is a matter of the command line.
pub(super) fn usage(error: RunError) -> Failure {
    match error {
        RunError::NoMeasurements { .. } | RunError::NoField | RunError::NoProtocol { .. } => {
            Failure::usage(error)
        }
        other => other.into(),
    }
}

/// The surface in a file, or the embedded atrium.
pub(super) fn source(file: Option<(&Path, Units)>) -> MeshSource {
    file.map_or_else(MeshSource::default, |(path, units)| MeshSource::File {
        path: path.to_owned(),
        units,
    })
}
