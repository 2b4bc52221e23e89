//! The surface of a simulation and the tissue on it.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use crate::ep::cell::RANGES;
use crate::ep::surface::{Fibres, halfway};
use crate::error::Failure;
use crate::mesh::{self, Refined, Surface, TriMesh, Units};
use crate::run::embedded_atrium;

/// Edges of the embedded atrium, mm: short enough for a front.
const EDGE: f64 = 0.4;

/// Fibres that leave the surface by more than this are worth a word, degrees.
const TILT: f64 = 10.0;

#[derive(Debug, Args, Serialize)]
pub(super) struct TissueArgs {
    /// Surface with parameter fields as point data (.vtp or .vtk), such as fields.vtp of a run; the
    /// embedded left atrium with 0.4 mm edges without it
    #[arg(long, value_name = "F.vtp", conflicts_with = "run")]
    #[serde(skip)]
    fields: Option<PathBuf>,
    /// Output folder of a run: its fields.vtp is the surface
    #[arg(long, value_name = "DIR")]
    #[serde(skip)]
    pub(super) run: Option<PathBuf>,
    /// Unit of the file's coordinates: mm, cm, um or m
    #[arg(long, default_value = "mm")]
    #[serde(skip)]
    units: Units,
    /// Cut every triangle into four, this many times: fronts need edges below 0.5 mm
    #[arg(long, value_name = "N", default_value_t = 0)]
    refine: u32,
    /// CV_max, with fibres along them: a number, m/s, or the name of a field
    #[arg(long, value_name = "X", default_value = "0.7")]
    cv_max: String,
    /// tau_in: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "0.05")]
    tau_in: String,
    /// tau_out: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "tau_out_mean")]
    tau_out: String,
    /// tau_open: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "120")]
    tau_open: String,
    /// APD_max: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "apd_max_mean")]
    apd_max: String,
    /// Point data with a vector at every vertex, along which conduction is faster
    #[arg(long, value_name = "NAME", requires = "anisotropy")]
    fibres: Option<String>,
    /// CV along the fibres over CV across, 1 or more
    #[arg(long, value_name = "R", requires = "fibres")]
    anisotropy: Option<f64>,
}

/// One of the five parameters of every vertex.
pub(super) enum Column {
    Number(f64),
    Field { name: String, values: Vec<f64> },
}

impl Column {
    pub(super) fn at(&self, vertex: usize) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Field { values, .. } => values[vertex],
        }
    }
}

impl TissueArgs {
    /// The file of the surface, if it is from one.
    pub(super) fn file(&self) -> Option<PathBuf> {
        self.run.as_ref().map(|run| run.join("fields.vtp")).or_else(|| self.fields.clone())
    }

    /// The surface as it is given.
    pub(super) fn surface(&self) -> Result<Surface, Failure> {
        Ok(match self.file() {
            Some(file) => mesh::read(&file, self.units)?,
            None => embedded_atrium(EDGE),
        })
    }

    /// The mesh that is simulated on.
    pub(super) fn refined(&self, mesh: TriMesh) -> Refined {
        let refined = Refined::new(mesh, self.refine);
        if refined.mesh.mean_edge_length() > 0.5 {
            eprintln!(
                "warning: fronts need edges below 0.5 mm, or they slow down and block\nhelp: --refine N halves edges N times"
            );
        }
        refined
    }

    /// The five parameters at the vertices of `surface`, in the order of [`RANGES`].
    pub(super) fn columns(&self, surface: &Surface) -> Result<[Column; 5], Failure> {
        let column = |text: &String, (name, ..): (&str, &str, f64, f64)| {
            if let Ok(number) = text.parse() {
                return Ok(Column::Number(number));
            }
            match surface.point_data.get(text) {
                Some(values) => Ok(Column::Field { name: text.clone(), values: values.clone() }),
                None => Err(Failure::new(format_args!(
                    "{name} is to be {text:?}, but the surface has no such field; it has: {}\n\
                     help: give --{} a number or one of these names",
                    names(surface),
                    name.replace('_', "-")
                ))),
            }
        };
        let [cv_max, tau_in, tau_out, tau_open, apd_max] = RANGES;
        Ok([
            column(&self.cv_max, cv_max)?,
            column(&self.tau_in, tau_in)?,
            column(&self.tau_out, tau_out)?,
            column(&self.tau_open, tau_open)?,
            column(&self.apd_max, apd_max)?,
        ])
    }

    /// The fibres on the refined mesh, if there are any.
    pub(super) fn fibres(
        &self,
        surface: &Surface,
        refined: &Refined,
    ) -> Result<Option<Fibres>, Failure> {
        let (Some(name), Some(ratio)) = (&self.fibres, self.anisotropy) else { return Ok(None) };
        let component = |k: usize| surface.point_data.get(&format!("{name}_{k}"));
        let (Some(x), Some(y), Some(z), None) =
            (component(0), component(1), component(2), component(3))
        else {
            return Err(Failure::new(format_args!(
                "--fibres {name}: the surface has no vectors of this name; it has: {}\n\
                 help: fibres are point data of three components, NAME_0 to NAME_2 in this list; \
                 vectors of cells become so by ParaView's filter Cell Data to Point Data",
                names(surface)
            )));
        };
        let given = (0..x.len()).map(|v| [x[v], y[v], z[v]]).collect();
        let fibres = Fibres::new(&refined.mesh, &refined.carry(given, halfway), ratio)?;
        if fibres.tilt() > TILT {
            eprintln!(
                "warning: fibres leave the surface at up to {:.0}° and are laid into it",
                fibres.tilt()
            );
        }
        Ok(Some(fibres))
    }
}

fn names(surface: &Surface) -> String {
    let names: Vec<&str> = surface.point_data.keys().map(String::as_str).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}
