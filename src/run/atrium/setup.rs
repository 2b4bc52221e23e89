//! A simulation before its first step: refined mesh, parameters, fibres, pacing.

use super::compare::Earlier;
use super::posterior::Posterior;
use super::tissue::TissueFields;
use super::{AtriumError, AtriumSettings, Ground};
use crate::ep::surface::{Fibres, Pacing, Simulation, Substrate};
use crate::ep::{Parameters, Precision, Tissue};
use crate::mesh::TriMesh;
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
    /// The mean of a posterior leaves a parameter's range somewhere, where the nearest in it is simulated.
    OutOfRange {
        /// Share of the vertices.
        share: f64,
    },
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
        let mut warnings = warnings(&tissue);
        let subject = match (settings.draws, ground.draws) {
            (Some(n), Some(draws)) => {
                Subject::Posterior(Posterior::new(draws, n as usize, &tissue)?)
            }
            (Some(n), None) => {
                let drawn = vec![];
                return Err(AtriumError::NothingDrawn { asked: n as usize, drawn });
            }
            (None, _) => {
                let given = tissue.given()?;
                let share = given.n_outside() as f64 / given.was.len() as f64;
                warnings.extend((share > 0.0).then_some(Warning::OutOfRange { share }));
                Subject::Given(given.parameters)
            }
        };
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
        self.begin_with(parameters, &self.pacing)
    }

    /// The same, paced otherwise.
    pub(super) fn begin_with<F: Precision>(
        &self,
        parameters: &[Parameters],
        pacing: &Pacing,
    ) -> Result<Simulation<F>, AtriumError> {
        let tissue: Vec<Tissue> = parameters.iter().map(|p| p.tissue()).collect();
        let fibres = self.tissue.fibres.as_ref();
        let substrate = Substrate { mesh: self.mesh(), tissue: &tissue, fibres };
        Ok(Simulation::new(&substrate, pacing, self.settings.numerics.dt)?)
    }
}

/// What a user should know of the tissue.
fn warnings(tissue: &TissueFields) -> Vec<Warning> {
    let mean = tissue.mesh().mean_edge_length();
    let long = (mean > LONGEST_EDGE).then_some(Warning::LongEdges { mean });
    let tilt = tissue.fibres.as_ref().map(Fibres::tilt).filter(|tilt| *tilt > TILT);
    long.into_iter().chain(tilt.map(|degrees| Warning::TiltedFibres { degrees })).collect()
}
