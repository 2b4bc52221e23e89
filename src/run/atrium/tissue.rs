//! The parameters on the surface, and the mesh that is simulated on.

use super::{AtriumError, Ground, Source, TissueSettings};
use crate::ep::Parameters;
use crate::ep::cell::RANGES;
use crate::ep::surface::Fibres;
use crate::mesh::{Refined, TriMesh, halfway};
use crate::store::memory;

/// The parameters on the surface as it was given, and the mesh that is simulated on.
#[derive(Debug)]
pub(super) struct TissueFields {
    pub(super) refined: Refined,
    /// The five parameters at the vertices before they were refined, in the order of [`RANGES`].
    pub(super) columns: [Column; 5],
    pub(super) n_coarse: usize,
    is_fitted: bool,
    pub(super) fibres: Option<Fibres>,
}

/// One of the five parameters at every vertex.
#[derive(Debug)]
pub(super) enum Column {
    Number(f64),
    Field { name: String, values: Vec<f64> },
}

/// Parameters at every vertex of the refined mesh.
#[derive(Debug)]
pub(super) struct InRange {
    pub(super) parameters: Vec<Parameters>,
    /// Where they were in their valid ranges; elsewhere they are the nearest valid ones.
    pub(super) was: Vec<bool>,
}

impl InRange {
    pub(super) fn of(parameters: Vec<Parameters>) -> Self {
        let was = parameters.iter().map(|p| p.validate().is_ok()).collect();
        Self { parameters: parameters.into_iter().map(nearest).collect(), was }
    }

    /// Vertices at which they were not.
    pub(super) fn n_outside(&self) -> usize {
        self.was.iter().filter(|was| !**was).count()
    }
}

/// Numbers that are held of each vertex, about: measured on 80,000 to 1,300,000.
const NUMBERS: u128 = 80;

/// Refuses what there is no memory for, before it is made.
fn require_memory(n_vertices: usize, times: u32) -> Result<(), AtriumError> {
    let n_vertices = 4_u128.saturating_pow(times).saturating_mul(n_vertices as u128);
    match memory::exceeds(n_vertices.saturating_mul(NUMBERS)) {
        Some((bytes, free)) => Err(AtriumError::Memory { times, n_vertices, bytes, free }),
        None => Ok(()),
    }
}

/// The nearest parameters in their valid ranges.
fn nearest(parameters: Parameters) -> Parameters {
    let mut values = parameters.to_array();
    for (value, (_, _, low, high)) in values.iter_mut().zip(RANGES) {
        *value = value.clamp(low, high);
    }
    Parameters::from_array(values)
}

impl TissueFields {
    pub(super) fn new(ground: &Ground, settings: &TissueSettings) -> Result<Self, AtriumError> {
        let mesh = &ground.surface.mesh;
        let columns = columns(ground, settings)?;
        require_memory(mesh.n_vertices(), settings.refine)?;
        let refined = Refined::new(mesh.clone(), settings.refine)?;
        let fibres = fibres(ground, settings, &refined)?;
        let (n_coarse, is_fitted) = (mesh.n_vertices(), ground.is_fitted);
        Ok(Self { refined, columns, n_coarse, is_fitted, fibres })
    }

    pub(super) fn mesh(&self) -> &TriMesh {
        &self.refined.mesh
    }

    /// The parameters at every vertex, from those before the mesh was refined.
    pub(super) fn refine(&self, coarse: Vec<[f64; 5]>) -> Vec<Parameters> {
        let mean = |a: [f64; 5], b: [f64; 5]| std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
        self.refined.carry(coarse, mean).into_iter().map(Parameters::from_array).collect()
    }

    /// The parameters at every vertex as they are given: checked, where a user gave them.
    pub(super) fn given(&self) -> Result<InRange, AtriumError> {
        let at = |vertex| self.columns.each_ref().map(|column| column.at(vertex));
        let parameters = self.refine((0..self.n_coarse).map(at).collect());
        if !self.is_fitted {
            for (vertex, given) in parameters.iter().enumerate() {
                given.validate().map_err(|source| AtriumError::Parameters { vertex, source })?;
            }
        }
        Ok(InRange::of(parameters))
    }
}

impl Column {
    pub(super) fn at(&self, vertex: usize) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Field { values, .. } => values[vertex],
        }
    }
}

/// The five parameters at the vertices of the surface.
fn columns(ground: &Ground, settings: &TissueSettings) -> Result<[Column; 5], AtriumError> {
    let TissueSettings { cv_max, tau_in, tau_out, tau_open, apd_max, .. } = settings;
    let column = |source: &Source, (name, ..): (&str, &str, f64, f64)| match source {
        Source::Number(number) => Ok(Column::Number(*number)),
        Source::Field(field) => match ground.surface.scalar(field) {
            Some(values) => Ok(Column::Field { name: field.clone(), values }),
            None => Err(AtriumError::NoPointData {
                what: format!("{name} is to be {field:?}, but the surface has no such field"),
                found: ground.names(),
                help: format!("give --{} a number or one of these names", name.replace('_', "-")),
            }),
        },
    };
    let [r_cv_max, r_tau_in, r_tau_out, r_tau_open, r_apd_max] = RANGES;
    Ok([
        column(cv_max, r_cv_max)?,
        column(tau_in, r_tau_in)?,
        column(tau_out, r_tau_out)?,
        column(tau_open, r_tau_open)?,
        column(apd_max, r_apd_max)?,
    ])
}

/// The fibres on the refined mesh, if there are any.
fn fibres(
    ground: &Ground,
    settings: &TissueSettings,
    refined: &Refined,
) -> Result<Option<Fibres>, AtriumError> {
    let (Some(name), Some(ratio)) = (&settings.fibres, settings.anisotropy) else {
        return Ok(None);
    };
    let Some(given) = ground.surface.fibres(name) else {
        return Err(AtriumError::NoPointData {
            what: format!("--fibres {name}: the surface has no vectors of this name"),
            found: ground.names(),
            help: "fibres are data of three components, of points or of triangles, NAME_0 to NAME_2 in this list"
                .to_owned(),
        });
    };
    Ok(Some(Fibres::new(&refined.mesh, &refined.carry(given, halfway), ratio)?))
}
