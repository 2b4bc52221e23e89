//! Experiments on known truth.
//!
//! The paper's synthetic experiment for any model whose fields declare a range: ground-truth fields
//! from a Matérn-5/2 prior, scaled into range and repaired, measured at maximin sites. And the paper's
//! validation: a [`Plan`] of many such experiments, block by block.

mod calibrate;
mod next;
mod plan;
mod results;

pub use calibrate::{INTERVALS, MapError, Outcome, Study, agree, coverage, rms_error, thinned};
pub use next::{Lesson, lessons};
pub use plan::{Block, Case, Choice, Estimate, Plan};
pub use results::{Group, Results, Table, summarise};

use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use thiserror::Error;

use crate::dsl::{DataError, Declare, MapName, Maps, Measurements, Model, ModelError, Tape};
use crate::field::{Matern52, unit_field};
use crate::infer::InferError;
use crate::manifold::{Basis, ManifoldError, interpolate_biharmonic, maximin};
use crate::mesh::TriMesh;

/// What messages call a table that was made here.
const SYNTHETIC: &str = "the synthetic experiment";

/// Modes of the ground truth.
pub const TRUTH_MODES: usize = 256;

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
}

impl Default for Design {
    /// The paper's example: 64 mm, 10 sites, 6 mm, 10 ms.
    fn default() -> Self {
        Self { lengthscale: 64.0, n_sites: 10, exclude: 6.0, resolution: 10.0, seed: 1 }
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
    let truth = Truth::new(&outline, basis, design.lengthscale, design.seed)?;
    let Design { resolution, seed, .. } = *design;
    let sites = maximin(mesh, design.n_sites, design.exclude, seed)?;
    let measurements = measure(model, &outline, basis, &truth.fields, &sites, resolution, seed)?;
    let names = Maps::new(&outline, basis).names().into_iter().map(|n| n.name);
    let Truth { fields, derived, repaired } = truth;
    let truth = names.zip(fields.into_iter().chain(derived)).collect();
    Ok(Experiment { measurements, truth, repaired })
}

/// Fields that are physical wherever they can be made so, and what follows from them.
struct Truth {
    /// Each n_vertices.
    fields: Vec<Vec<f64>>,
    /// Derived quantities, each n_vertices; NaN where unphysical even after repair.
    derived: Vec<Vec<f64>>,
    /// Share of vertices that were repaired.
    repaired: f64,
}

impl Truth {
    /// Drawn with this lengthscale, mm.
    fn new(
        outline: &Model,
        basis: &Basis,
        lengthscale: f64,
        seed: u64,
    ) -> Result<Self, StudyError> {
        let maps = Maps::new(outline, basis);
        let mut tape = outline.tape();
        outline.forward(&mut tape, &outline.initial());
        repaired(&maps, &tape, true_fields(&maps, basis, lengthscale, seed)?, basis)
    }

    /// Fields, then derived quantities.
    fn maps(&self) -> impl Iterator<Item = &Vec<f64>> {
        self.fields.iter().chain(&self.derived)
    }
}

/// Repairs fields where what follows from them is unphysical, at the parameters of the last forward
/// pass.
fn repaired(
    maps: &Maps<'_>,
    tape: &Tape,
    mut fields: Vec<Vec<f64>>,
    basis: &Basis,
) -> Result<Truth, StudyError> {
    let derived = maps.derived_fields(tape, &fields);
    let bad: Vec<bool> =
        (0..basis.n_vertices()).map(|v| derived.iter().any(|d| d[v].is_nan())).collect();
    repair(&mut fields, &bad, basis)?;
    let derived = maps.derived_fields(tape, &fields);
    let repaired = bad.iter().filter(|b| **b).count() as f64 / bad.len() as f64;
    Ok(Truth { fields, derived, repaired })
}

/// Independent Matérn-5/2 fields, each scaled onto its whole declared range.
fn true_fields(
    maps: &Maps<'_>,
    basis: &Basis,
    lengthscale: f64,
    seed: u64,
) -> Result<Vec<Vec<f64>>, StudyError> {
    let mut rng = stream(seed, 0);
    let ranged = maps.names().into_iter().take(maps.n_fields());
    ranged
        .map(|MapName { name: field, range, .. }| {
            let (low, high) = range.ok_or(StudyError::NoRange { field })?;
            let eta: Vec<f64> = (0..basis.n_modes()).map(|_| rng.sample(StandardNormal)).collect();
            let unit = unit_field(basis, &Matern52(lengthscale), &eta);
            let min = unit.iter().copied().fold(f64::INFINITY, f64::min);
            let max = unit.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            Ok(unit.iter().map(|x| low + (high - low) * (x - min) / (max - min)).collect())
        })
        .collect()
}

/// Replaces the fields at `bad` vertices by their average over the others, weighted by 1/d⁴ with d
/// the biharmonic distance.
///
/// Differs from the paper's code, which weights by 1/d⁸; this is its text.
fn repair(fields: &mut [Vec<f64>], bad: &[bool], basis: &Basis) -> Result<(), StudyError> {
    let good: Vec<usize> = (0..bad.len()).filter(|v| !bad[*v]).collect();
    if good.is_empty() {
        return Err(StudyError::NothingPhysical);
    }
    let vertices: Vec<usize> = (0..bad.len()).filter(|v| bad[*v]).collect();
    let averages = interpolate_biharmonic(basis, fields, &good, &vertices);
    for (vertex, average) in vertices.iter().zip(averages) {
        for (field, value) in fields.iter_mut().zip(average) {
            field[*vertex] = value;
        }
    }
    Ok(())
}

/// A table before it is measured: header and cells.
struct Blank {
    header: Vec<String>,
    cells: Vec<Vec<String>>,
    table: Measurements,
}

/// Every `observe` of the model once per site, with measurements that only fix the protocol's grid.
fn blank_table(
    outline: &Model,
    basis: &Basis,
    sites: &[u32],
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
    for (site, vertex) in sites.iter().enumerate() {
        for observe in &outline.observes {
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

/// Every `observe` of the model once per site, as its likelihood simulates it on the true fields.
fn measure(
    model: &dyn Declare,
    outline: &Model,
    basis: &Basis,
    fields: &[Vec<f64>],
    sites: &[u32],
    resolution: f64,
    seed: u64,
) -> Result<Measurements, StudyError> {
    let blank = blank_table(outline, basis, sites, resolution)?;
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
