//! What a model is run on: surface, basis, measurements, and the truth where it is known.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr as _;

use clap::Args;
use sha2::{Digest as _, Sha256};

use crate::error::Failure;
use crate::manifold::{Basis, eigenpairs_cached};
use crate::mesh::{self, Surface, Units};
use crate::model::{Declare, Model};
use crate::study::{Design, TRUTH_MODES, experiment};
use crate::table::{FIELD_MODES, Measurements};

/// Edge length of the embedded atrium, mm: about 5,000 vertices.
const ATRIUM_EDGE: f64 = 1.5;

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

/// Everything a model is run on.
pub(super) struct Inputs {
    /// Absent for models without fields.
    pub(super) surface: Option<(Surface, Basis)>,
    pub(super) measurements: Measurements,
    /// True fields and derived quantities, for a synthetic experiment.
    pub(super) truth: Vec<(&'static str, Vec<f64>)>,
    /// SHA-256 of the files read, by role.
    pub(super) hashes: BTreeMap<String, String>,
}

impl InputArgs {
    /// Whether measurements were given.
    pub(super) fn has_data(&self) -> bool {
        self.data.is_some()
    }

    /// Length in mm of the unit of the mesh file.
    pub(super) fn scale(&self) -> f64 {
        self.units.map_or(1.0, Units::in_mm)
    }

    /// Reads or makes everything that `model` needs; says on stderr what it is.
    pub(super) fn load(&self, model: &dyn Declare) -> Result<Inputs, Failure> {
        let outline = Model::outline(model)?;
        let mut hashes = BTreeMap::new();
        for (role, path) in [("mesh", &self.mesh), ("basis", &self.basis), ("data", &self.data)] {
            if let Some(path) = path {
                hashes.insert(role.into(), hash(path)?);
            }
        }
        let table = self.data.as_deref().map(Measurements::read).transpose()?;
        let is_on_a_surface = outline.has_fields() || self.mesh.is_some() && table.is_some();
        if !is_on_a_surface {
            let readers = outline.readers();
            let measurements = match table {
                Some(table) => checked(table, &outline)?,
                None if readers.is_empty() => Measurements::default(),
                None => {
                    return Err(Failure::usage(format_args!(
                        "the model {} observes {}: measurements are needed\nhelp: give them with --data FILE.csv",
                        outline.name, readers[0]
                    )));
                }
            };
            return Ok(Inputs { surface: None, measurements, truth: vec![], hashes });
        }
        let surface = self.surface()?;
        let basis = self.eigenpairs(&surface, &outline, table.is_none())?;
        let (measurements, truth) = match table {
            Some(table) => (self.place(checked(table, &outline)?, &surface, &basis)?, vec![]),
            None => self.synthetic(model, &surface, &basis)?,
        };
        Ok(Inputs { surface: Some((surface, basis)), measurements, truth, hashes })
    }

    fn surface(&self) -> Result<Surface, Failure> {
        surface(self.mesh.as_deref().zip(self.units))
    }

    fn eigenpairs(
        &self,
        surface: &Surface,
        outline: &Model,
        is_synthetic: bool,
    ) -> Result<Basis, Failure> {
        let most = surface.mesh.n_vertices() - 1;
        let needed = match outline.n_modes() {
            0 => FIELD_MODES.min(most), // for fields that `eplat loop` may add
            needed => needed,
        };
        let basis = if let Some(path) = &self.basis {
            let scale = self.units.map_or(1.0, Units::in_mm);
            on_kept_vertices(Basis::read_npz(path)?, surface).in_unit_of(scale)
        } else {
            let truth = if is_synthetic { TRUTH_MODES.min(most) } else { 0 };
            eigenpairs_cached(&surface.mesh, needed.max(truth))?
        };
        basis.require_fit(&surface.mesh)?;
        let wavelength =
            |k: usize| 2.0 * std::f64::consts::PI / basis.eigenvalues[k].max(0.0).sqrt();
        let used = needed.min(basis.n_modes());
        let last = used.saturating_sub(1);
        eprintln!("basis  {used} modes, down to a wavelength of {:.0} mm", wavelength(last));
        Ok(basis)
    }

    fn place(
        &self,
        mut table: Measurements,
        surface: &Surface,
        basis: &Basis,
    ) -> Result<Measurements, Failure> {
        table.place_on(surface, self.scale())?;
        table.probe(surface, basis)?;
        let sites = table.vertices().len();
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let (rows, sites) = (count(table.len(), "row"), count(sites, "site"));
        eprintln!("data   {}: {rows} at {sites}", table.file());
        Ok(table)
    }

    #[allow(clippy::type_complexity, reason = "the two halves of an experiment")]
    fn synthetic(
        &self,
        model: &dyn Declare,
        surface: &Surface,
        basis: &Basis,
    ) -> Result<(Measurements, Vec<(&'static str, Vec<f64>)>), Failure> {
        let design = Design { seed: self.seed, ..Design::default() };
        let made = experiment(model, &surface.mesh, basis, &design)?;
        eprintln!(
            "data   synthetic experiment: {} measurements at {} sites, truth with lengthscale {} mm, {:.1} % of vertices repaired",
            made.measurements.len(),
            design.n_sites,
            design.lengthscale,
            100.0 * made.repaired
        );
        Ok((made.measurements, made.truth))
    }
}

/// The surface in a file, or the embedded atrium; says on stderr what it is.
pub(super) fn surface(file: Option<(&Path, Units)>) -> Result<Surface, Failure> {
    let Some((path, units)) = file else {
        let surface = Surface::left_atrium(ATRIUM_EDGE);
        let (n, area) = (surface.mesh.n_vertices(), surface.mesh.area() / 100.0);
        eprintln!("mesh   embedded left atrium: {n} vertices, area {area:.0} cm²");
        return Ok(surface);
    };
    let surface = mesh::read(path, units)?;
    eprintln!("mesh   {}: {} vertices", path.display(), surface.mesh.n_vertices());
    for note in &surface.notes {
        eprintln!("       {note}");
    }
    Ok(surface)
}

fn checked(table: Measurements, outline: &Model) -> Result<Measurements, Failure> {
    table.check_protocols(&outline.readers())?;
    Ok(table)
}

/// A basis given for every vertex of the file, at the vertices that were kept.
fn on_kept_vertices(basis: Basis, surface: &Surface) -> Basis {
    if basis.n_vertices() != surface.n_source_vertices {
        return basis;
    }
    let rows = surface.source_vertex.iter().flat_map(|v| basis.at(*v as usize).to_vec());
    Basis { eigenfunctions: rows.collect(), eigenvalues: basis.eigenvalues.clone() }
}

/// SHA-256 of a file, hexadecimal.
pub(super) fn hash(path: &Path) -> Result<String, Failure> {
    let bytes = fs::read(path).map_err(|error| {
        Failure::new(format_args!(
            "cannot read {}: {error}\nhelp: check the path; it is relative to the folder you are in",
            path.display()
        ))
    })?;
    Ok(format!("{:x}", Sha256::digest(&bytes)))
}
