//! A simulation before its first step: refined mesh, parameters, fibres, pacing.

use super::compare::Earlier;
use super::ensemble::Posterior;
use super::{AtriumError, AtriumSettings, Ground, Source, TissueSettings};
use crate::ep::cell::RANGES;
use crate::ep::surface::{Fibres, Pacing, Simulation, Substrate, halfway};
use crate::ep::{Parameters, Precision, Tissue};
use crate::mesh::{Refined, TriMesh};
use crate::store::Identity;

/// Longer edges slow fronts down, mm.
const LONGEST_EDGE: f64 = 0.5;
/// Fibres that leave the surface by more than this are worth a word, degrees.
const TILT: f64 = 10.0;

/// A simulation that is ready to begin.
#[derive(Debug)]
pub struct Atrium {
    pub(super) settings: AtriumSettings,
    pub(super) identity: Identity,
    pub(super) tissue: TissueFields,
    pub(super) pacing: Pacing,
    pub(super) subject: Subject,
    pub(super) earlier: Option<Earlier>,
    warnings: Vec<Warning>,
}

/// What a user should know before a simulation begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warning {
    /// The mean edge is longer than 0.5 mm: fronts slow down and block.
    LongEdges {
        /// Mean edge length, mm.
        mean: f64,
    },
    /// Fibres leave the surface by more than 10° somewhere, and are laid into it.
    TiltedFibres {
        /// The largest angle, degrees.
        degrees: f64,
    },
}

/// The parameters on the surface as it was given, and the mesh that is simulated on.
#[derive(Debug)]
pub(super) struct TissueFields {
    pub(super) refined: Refined,
    /// The five parameters at the vertices before they were refined, in the order of [`RANGES`].
    pub(super) columns: [Column; 5],
    pub(super) n_coarse: usize,
    fibres: Option<Fibres>,
}

/// One of the five parameters at every vertex.
#[derive(Debug)]
pub(super) enum Column {
    Number(f64),
    Field { name: String, values: Vec<f64> },
}

/// Whose tissue is simulated.
#[derive(Debug)]
pub(super) enum Subject {
    /// One set of parameters for each vertex.
    Given(Vec<Parameters>),
    /// Draws of them.
    Posterior(Posterior),
}

impl Atrium {
    /// Prepares the simulation of `settings` on `ground`. The draws of `ground` are used if
    /// `settings.draws` says how many.
    ///
    /// # Errors
    /// [`AtriumError`] for whatever makes the simulation impossible.
    pub fn new(ground: Ground, settings: &AtriumSettings) -> Result<Self, AtriumError> {
        let dt = settings.numerics.dt;
        if let Some(every) = settings.numerics.snapshots.filter(|every| !(*every >= dt)) {
            return Err(AtriumError::Snapshots(every));
        }
        let tissue = TissueFields::new(&ground, &settings.tissue)?;
        let pacing = settings.pacing.on(&ground, &tissue.refined)?;
        pacing.validate(tissue.mesh().n_vertices(), dt)?;
        let earlier = settings.compare.as_deref();
        let earlier = earlier.map(|file| Earlier::read(file, tissue.mesh())).transpose()?;
        let mut identity = settings.identity()?;
        identity.extend(ground.hashes);
        let subject = match (settings.draws, ground.draws) {
            (Some(n), Some(draws)) => {
                Subject::Posterior(Posterior::new(draws, n as usize, &tissue)?)
            }
            (Some(n), None) => {
                let drawn = vec![];
                return Err(AtriumError::NothingDrawn { asked: n as usize, drawn });
            }
            (None, _) => Subject::Given(tissue.given()?),
        };
        let warnings = tissue.warnings();
        let settings = settings.clone();
        Ok(Self { settings, identity, tissue, pacing, subject, earlier, warnings })
    }

    /// What it was prepared with.
    pub fn settings(&self) -> &AtriumSettings {
        &self.settings
    }

    /// The mesh that is simulated on.
    pub fn mesh(&self) -> &TriMesh {
        self.tissue.mesh()
    }

    /// Where and when it is paced.
    pub fn pacing(&self) -> &Pacing {
        &self.pacing
    }

    /// What a user should know before it begins.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// How long all simulations take together, ms.
    pub fn total_time(&self) -> f64 {
        let n = if let Subject::Posterior(posterior) = &self.subject { posterior.n } else { 1 };
        self.pacing.end * n as f64
    }

    /// The fields whose draws are simulated, and how many draws there are of them; `None` if the
    /// fields are simulated as they are.
    pub fn drawn(&self) -> Option<(Vec<&str>, usize)> {
        let Subject::Posterior(posterior) = &self.subject else { return None };
        Some((posterior.drawn(&self.tissue), posterior.draws.n_draws()))
    }

    /// Tissue at rest with these parameters at every vertex of the refined mesh.
    pub(super) fn begin<F: Precision>(
        &self,
        parameters: &[Parameters],
    ) -> Result<Simulation<F>, AtriumError> {
        let tissue: Vec<Tissue> = parameters.iter().map(|p| p.tissue()).collect();
        let fibres = self.tissue.fibres.as_ref();
        let substrate = Substrate { mesh: self.mesh(), tissue: &tissue, fibres };
        Ok(Simulation::new(&substrate, &self.pacing, self.settings.numerics.dt)?)
    }
}

impl TissueFields {
    fn new(ground: &Ground, settings: &TissueSettings) -> Result<Self, AtriumError> {
        let mesh = &ground.surface.mesh;
        let columns = columns(ground, settings)?;
        let refined = Refined::new(mesh.clone(), settings.refine);
        let fibres = fibres(ground, settings, &refined)?;
        Ok(Self { n_coarse: mesh.n_vertices(), refined, columns, fibres })
    }

    pub(super) fn mesh(&self) -> &TriMesh {
        &self.refined.mesh
    }

    /// The parameters at every vertex, from those before the mesh was refined.
    pub(super) fn refine(&self, coarse: Vec<[f64; 5]>) -> Vec<Parameters> {
        let mean = |a: [f64; 5], b: [f64; 5]| std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
        self.refined.carry(coarse, mean).into_iter().map(Parameters::from_array).collect()
    }

    /// The parameters at every vertex as they are given, checked.
    fn given(&self) -> Result<Vec<Parameters>, AtriumError> {
        let at = |vertex| self.columns.each_ref().map(|column| column.at(vertex));
        let parameters = self.refine((0..self.n_coarse).map(at).collect());
        for (vertex, parameters) in parameters.iter().enumerate() {
            parameters.validate().map_err(|source| AtriumError::Parameters { vertex, source })?;
        }
        Ok(parameters)
    }

    fn warnings(&self) -> Vec<Warning> {
        let mean = self.mesh().mean_edge_length();
        let long = (mean > LONGEST_EDGE).then_some(Warning::LongEdges { mean });
        let tilt = self.fibres.as_ref().map(Fibres::tilt).filter(|tilt| *tilt > TILT);
        long.into_iter().chain(tilt.map(|degrees| Warning::TiltedFibres { degrees })).collect()
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
        Source::Field(field) => match ground.surface.point_data.get(field) {
            Some(values) => Ok(Column::Field { name: field.clone(), values: values.clone() }),
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
    let component = |k: usize| ground.surface.point_data.get(&format!("{name}_{k}"));
    let (Some(x), Some(y), Some(z), None) =
        (component(0), component(1), component(2), component(3))
    else {
        return Err(AtriumError::NoPointData {
            what: format!("--fibres {name}: the surface has no vectors of this name"),
            found: ground.names(),
            help: "fibres are point data of three components, NAME_0 to NAME_2 in this list; \
                   vectors of cells become so by ParaView's filter Cell Data to Point Data"
                .to_owned(),
        });
    };
    let given = (0..x.len()).map(|v| [x[v], y[v], z[v]]).collect();
    Ok(Some(Fibres::new(&refined.mesh, &refined.carry(given, halfway), ratio)?))
}
