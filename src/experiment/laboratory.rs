//! Where truths are made and measured: a model on a surface.

use super::{ExperimentError, Truth};
use crate::manifold::Basis;
use crate::model::{Declare, Maps, Model, ModelError};
use crate::random::Stream;
use crate::table::{DataError, Measurements};

/// What messages call a table that was made here.
const SYNTHETIC: &str = "the synthetic experiment";

/// A model on a surface, before anything is measured.
pub struct Laboratory<'a> {
    model: &'a dyn Declare,
    basis: &'a Basis,
    outline: Model,
}

/// Where something is measured, and what.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Visit {
    /// The vertex.
    pub vertex: u32,
    /// Names of `observe`s.
    pub observes: Vec<&'static str>,
}

impl std::fmt::Debug for Laboratory<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Laboratory").field("model", &self.outline.name).finish_non_exhaustive()
    }
}

impl<'a> Laboratory<'a> {
    /// Of a model whose fields are on the surface of `basis`.
    ///
    /// # Errors
    /// [`ExperimentError::Model`].
    pub fn new(model: &'a dyn Declare, basis: &'a Basis) -> Result<Self, ExperimentError> {
        Ok(Self { model, basis, outline: Model::outline(model)? })
    }

    /// The model as it is declared.
    pub fn declared(&self) -> &'a dyn Declare {
        self.model
    }

    /// The model without measurements.
    pub fn outline(&self) -> &Model {
        &self.outline
    }

    /// The eigenfunctions of the surface.
    pub fn basis(&self) -> &'a Basis {
        self.basis
    }

    /// Names of all maps: fields, then derived quantities.
    pub fn map_names(&self) -> Vec<String> {
        Maps::new(&self.outline, self.basis).names().iter().map(|map| map.name.into()).collect()
    }

    /// A truth that is drawn with this lengthscale, mm.
    ///
    /// # Errors
    /// [`ExperimentError::NoRange`], [`ExperimentError::NothingPhysical`].
    pub fn truth(&self, lengthscale: f64, seed: u64) -> Result<Truth, ExperimentError> {
        Truth::new(&self.outline, self.basis, lengthscale, seed)
    }

    /// The truth with these fields, each (n_vertices), in the model's order.
    ///
    /// # Errors
    /// [`ExperimentError::NothingPhysical`].
    pub fn truth_of(&self, fields: Vec<Vec<f64>>) -> Result<Truth, ExperimentError> {
        Truth::of(&self.outline, self.basis, fields)
    }

    /// Visits at which everything is measured, one at each site.
    pub fn visits(&self, sites: &[u32]) -> Vec<Visit> {
        let observes: Vec<&str> = self.outline.observes.iter().map(|o| o.name).collect();
        sites.iter().map(|&vertex| Visit { vertex, observes: observes.clone() }).collect()
    }

    /// Every measurement of these visits, as its likelihood simulates it on the true `fields`, each
    /// (n_vertices), in the model's order. `resolution` is the width of a bracket.
    ///
    /// # Errors
    /// [`ExperimentError::NotSynthetic`] for a model that reads further columns.
    pub fn measure(
        &self,
        fields: &[Vec<f64>],
        visits: &[Visit],
        resolution: f64,
        seed: u64,
    ) -> Result<Measurements, ExperimentError> {
        let (mut table, blank) = self.blank(visits, resolution)?;
        let mut tape = blank.tape();
        blank.forward(&mut tape, &blank.initial());
        Maps::new(&blank, self.basis).set_at_probes(&mut tape, fields);
        let mut rng = Stream::Noise.rng(seed);
        let mut columns = value_columns(&self.outline, table.len());
        for observe in &blank.observes {
            for (row, values) in observe.rows.iter().zip(observe.simulate(&tape, &mut rng)) {
                for (name, value) in observe.columns.iter().zip(values) {
                    for (_, column) in columns.iter_mut().filter(|(own, _)| own == name) {
                        column[*row] = value;
                    }
                }
            }
        }
        for (name, values) in &columns {
            table.set_numbers(name, values);
        }
        Ok(table)
    }

    /// A row for every measurement of these visits with values that only fix the protocol's grid, and the
    /// model on it.
    pub(super) fn blank(
        &self,
        visits: &[Visit],
        resolution: f64,
    ) -> Result<(Measurements, Model), ExperimentError> {
        let mut cells = vec![];
        let mut observes = vec![];
        for (site, Visit { vertex, observes: here }) in visits.iter().enumerate() {
            for observe in self.outline.observes.iter().filter(|o| here.contains(&o.name)) {
                cells.push(vec![site.to_string(), vertex.to_string(), observe.name.to_string()]);
                observes.push(observe);
            }
        }
        let mut columns = value_columns(&self.outline, observes.len());
        for (name, column) in &mut columns {
            for (value, observe) in column.iter_mut().zip(&observes) {
                if observe.columns.contains(name) {
                    *value = blank_value(name, resolution);
                }
            }
        }
        let header = ["site", "vertex", "protocol"].map(str::to_owned).to_vec();
        let mut table = Measurements::from_cells(SYNTHETIC, header, cells)?;
        for (name, values) in &columns {
            table.set_numbers(name, values);
        }
        table.place_at_indices(self.basis.n_vertices())?;
        let model = Model::new(self.model, Some(self.basis), &table).map_err(needs_a_column)?;
        Ok((table, model))
    }
}

/// The columns that measurements are read from, without a value in any of `n` rows.
fn value_columns(outline: &Model, n: usize) -> Vec<(&'static str, Vec<f64>)> {
    let mut columns: Vec<(&str, Vec<f64>)> = vec![];
    for name in outline.observes.iter().flat_map(|observe| observe.columns.iter().copied()) {
        if columns.iter().all(|(own, _)| *own != name) {
            columns.push((name, vec![f64::NAN; n]));
        }
    }
    columns
}

/// What stands in a column before it is measured. One is a value that every likelihood takes.
fn blank_value(column: &str, resolution: f64) -> f64 {
    match column {
        "lower" => 0.0,
        "upper" => resolution,
        _ => 1.0,
    }
}

fn needs_a_column(error: ModelError) -> ExperimentError {
    match error {
        ModelError::Data(DataError::NoColumn { column, .. }) => {
            ExperimentError::NotSynthetic { why: format!("the model reads the column `{column}`") }
        }
        ModelError::NoSource { name, .. } => ExperimentError::NotSynthetic {
            why: format!("`{name}` depends on where activation starts"),
        },
        ModelError::NoMesh { name } => ExperimentError::NotSynthetic {
            why: format!("`{name}` depends on the surface between the places of fields"),
        },
        other => other.into(),
    }
}
