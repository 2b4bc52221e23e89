//! Experiments on known truth.
//!
//! The paper's synthetic experiment for any model whose fields declare a range: ground-truth fields
//! from a Matérn-5/2 prior, scaled into range and repaired, measured at maximin sites. And the paper's
//! validation: a [`Plan`] of many such experiments, block by block.

mod calibrate;
mod experiment;
mod next;
mod plan;
mod recovery;
mod results;
mod truth;

pub use calibrate::{
    INTERVALS, MapError, Outcome, Study, Time, agree, coverage, rms_error, thinned,
};
pub use experiment::{Listener, Simulated, SimulationEvent, SimulationPlan};
pub use next::{Lesson, Minutes, lessons};
pub use plan::{Block, Case, Choice, Estimate, Plan};
pub use recovery::{RecoveredMap, Recovery, recover};
pub use results::{Group, Results, Table, summarise};
pub use truth::{TRUTH_MODES, conduction};

use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

use crate::infer::InferError;
use crate::manifold::{Basis, ManifoldError, maximin};
use crate::mesh::TriMesh;
use crate::model::{Declare, Maps, Model, ModelError};
use crate::table::{DataError, Measurements};
use truth::Truth;

/// What messages call a table that was made here.
const SYNTHETIC: &str = "the synthetic experiment";

/// How the paper's example experiment is made.
#[derive(Clone, Debug)]
pub struct Design {
    /// Lengthscale of the ground truth, mm.
    pub lengthscale: f64,
    /// Number of measurement sites.
    pub n_sites: usize,
    /// Distance that sites keep from openings, mm.
    pub exclude: f64,
    /// Width of a bracket, in the unit of the measurement.
    pub resolution: f64,
    /// Seed of the truth and of the sites.
    pub seed: u64,
    /// The true fields in the model's order, each (n_vertices), before they are repaired; drawn without them.
    pub fields: Option<Vec<Vec<f64>>>,
}

impl Default for Design {
    /// The paper's example: 64 mm, 10 sites, 6 mm, 10 ms.
    fn default() -> Self {
        Self {
            lengthscale: 64.0,
            n_sites: 10,
            exclude: 6.0,
            resolution: 10.0,
            seed: 1,
            fields: None,
        }
    }
}

/// Measurements made on a known truth.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The table, as a file would hold it.
    pub measurements: Measurements,
    /// Names and values (n_vertices) of the true fields and derived quantities; NaN where the truth
    /// is unphysical even after repair.
    pub truth: Vec<(&'static str, Vec<f64>)>,
    /// Share of vertices that were repaired.
    pub repaired: f64,
}

/// Why there can be no experiment.
#[derive(Debug, Error)]
pub enum StudyError {
    /// A field whose range is not declared.
    #[error(
        "no synthetic experiment: field {field} declares no range\nhelp: give measurements (--data FILE.csv), or a range in the model file: `field {field}(x) [unit] in 1.0..30.0 = …`"
    )]
    NoRange {
        /// The field.
        field: &'static str,
    },
    /// A model without fields, or one that reads columns.
    #[error("no synthetic experiment: {why}\nhelp: give measurements (--data FILE.csv)")]
    NotSynthetic {
        /// What it needs.
        why: String,
    },
    /// No vertex is physical.
    #[error(
        "no synthetic experiment: no vertex of the ground truth is physical\nhelp: widen the ranges of the derived quantities in the model file"
    )]
    NothingPhysical,
    /// Sites cannot be placed.
    #[error(transparent)]
    Sites(#[from] ManifoldError),
    /// The model does not fit.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The table cannot be made.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A calibration cannot begin.
    #[error(transparent)]
    Infer(#[from] InferError),
    /// A plan that cannot be read, or says nothing that can be done.
    #[error("{}: {why}", path.display())]
    Plan {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        why: String,
    },
    /// Results that are of another plan, not complete or not readable.
    #[error("{}: {why}", path.display())]
    Results {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

/// Stream `index` of this module: chains own the streams from 0 on, reports those from 2³² on.
fn stream(seed: u64, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((1 << 33) + index);
    rng
}

/// Makes the experiment. `basis` should have [`TRUTH_MODES`] modes; all it has are used.
///
/// # Errors
/// [`StudyError`].
pub fn experiment(
    model: &dyn Declare,
    mesh: &TriMesh,
    basis: &Basis,
    design: &Design,
) -> Result<Experiment, StudyError> {
    let outline = Model::outline(model)?;
    if !outline.has_fields() {
        return Err(StudyError::NotSynthetic { why: "the model has no field".into() });
    }
    let truth = match &design.fields {
        Some(fields) => Truth::of(&outline, basis, fields.clone())?,
        None => Truth::new(&outline, basis, design.lengthscale, design.seed)?,
    };
    let Design { resolution, seed, .. } = *design;
    let visits = visits(&outline, &maximin(mesh, design.n_sites, design.exclude, seed)?);
    let measurements = measure(model, &outline, basis, &truth.fields, &visits, resolution, seed)?;
    let names = Maps::new(&outline, basis).names().into_iter().map(|n| n.name);
    let repaired = truth.repaired();
    let truth = names.zip(truth.fields.into_iter().chain(truth.derived)).collect();
    Ok(Experiment { measurements, truth, repaired })
}

/// Where something is measured, and what.
#[derive(Clone, Debug)]
struct Visit {
    vertex: u32,
    /// Names of `observe`s.
    observes: Vec<&'static str>,
}

/// Everything at every site.
fn visits(outline: &Model, sites: &[u32]) -> Vec<Visit> {
    let observes: Vec<&str> = outline.observes.iter().map(|observe| observe.name).collect();
    sites.iter().map(|&vertex| Visit { vertex, observes: observes.clone() }).collect()
}

/// A table before it is measured: header and cells.
struct Blank {
    header: Vec<String>,
    cells: Vec<Vec<String>>,
    table: Measurements,
}

/// A row for every measurement of these visits, with values that only fix the protocol's grid.
fn blank_table(
    outline: &Model,
    basis: &Basis,
    visits: &[Visit],
    resolution: f64,
) -> Result<Blank, StudyError> {
    let mut columns: Vec<&str> = vec![];
    for observe in &outline.observes {
        columns.extend(observe.columns.iter().filter(|c| !columns.contains(c)).collect::<Vec<_>>());
    }
    let header: Vec<String> =
        ["site", "vertex", "protocol"].iter().chain(&columns).map(ToString::to_string).collect();
    // One is a value that every likelihood takes.
    let blank = |column: &str| match column {
        "lower" => 0.0,
        "upper" => resolution,
        _ => 1.0,
    };
    let mut cells = vec![];
    for (site, Visit { vertex, observes }) in visits.iter().enumerate() {
        for observe in outline.observes.iter().filter(|o| observes.contains(&o.name)) {
            let mut row = vec![site.to_string(), vertex.to_string(), observe.name.to_string()];
            row.extend(columns.iter().map(|c| {
                if observe.columns.contains(c) { blank(c).to_string() } else { String::new() }
            }));
            cells.push(row);
        }
    }
    let mut table = Measurements::from_cells(SYNTHETIC, header.clone(), cells.clone())?;
    table.place_at_indices(basis.n_vertices())?;
    Ok(Blank { header, cells, table })
}

/// The model on a table before it is measured.
fn on_blank(model: &dyn Declare, basis: &Basis, blank: &Blank) -> Result<Model, StudyError> {
    Model::new(model, Some(basis), &blank.table).map_err(|error| match error {
        ModelError::Data(DataError::NoColumn { column, .. }) => {
            StudyError::NotSynthetic { why: format!("the model reads the column `{column}`") }
        }
        other => other.into(),
    })
}

/// Every measurement of these visits, as its likelihood simulates it on the true fields.
fn measure(
    model: &dyn Declare,
    outline: &Model,
    basis: &Basis,
    fields: &[Vec<f64>],
    visits: &[Visit],
    resolution: f64,
    seed: u64,
) -> Result<Measurements, StudyError> {
    let blank = blank_table(outline, basis, visits, resolution)?;
    let blank_model = on_blank(model, basis, &blank)?;
    let Blank { header, mut cells, table } = blank;
    let mut tape = blank_model.tape();
    blank_model.forward(&mut tape, &blank_model.initial());
    Maps::new(&blank_model, basis).set_at_probes(&mut tape, &table.vertices(), fields);
    let mut rng = stream(seed, 1);
    for observe in &blank_model.observes {
        for (row, values) in observe.rows.iter().zip(observe.simulate(&tape, &mut rng)) {
            for (column, value) in observe.columns.iter().zip(values) {
                let at = header.iter().position(|h| h == column).unwrap_or(0);
                cells[*row][at] = value.to_string();
            }
        }
    }
    let mut measured = Measurements::from_cells(SYNTHETIC, header, cells)?;
    measured.place_at_indices(basis.n_vertices())?;
    Ok(measured)
}
