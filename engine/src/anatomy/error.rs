//! Why an atrium has no coordinates.

use crate::manifold::ManifoldError;
use crate::mesh::MeshError;
use thiserror::Error;

/// Why an atrium has no coordinates.
#[derive(Debug, Error)]
pub enum AnatomyError {
    /// Which opening is which cannot be told.
    #[error(
        "openings of at least {least} mm around: {n}, expected 5, four pulmonary veins and the mitral valve\n\
         help: say which is which by the numbers of `eplat mesh info`: --openings mv=1,lspv=2,lipv=3,rspv=4,ripv=5 \
         (--from-openings for the mesh that has fibres)"
    )]
    HowManyOpenings {
        /// The openings that are large enough.
        n: usize,
        /// Least length around, mm.
        least: f64,
    },
    /// The list of openings cannot be understood.
    #[error(
        "openings {given}: {what}\nhelp: write mv=1,lspv=2,lipv=3,rspv=4,ripv=5, as `eplat mesh info` numbers them"
    )]
    Openings {
        /// What was given.
        given: String,
        /// What is wrong with it.
        what: String,
    },
    /// A line on the surface cannot be drawn.
    #[error(
        "no way on the surface {what} that crosses no other line\n\
         help: see in a viewer whether the openings are those that were taken for them, and say which is which by the numbers \
         of `eplat mesh info` (--openings, --from-openings)"
    )]
    NoWay {
        /// From where to where.
        what: &'static str,
    },
    /// The lines do not divide the surface into a posterior and an anterior half.
    #[error(
        "the lines between the openings do not divide the surface in two: {what}\n\
         help: see in a viewer whether the openings are those that were taken for them, and say which is which by the numbers \
         of `eplat mesh info` (--openings, --from-openings)"
    )]
    NotInTwo {
        /// What is wrong.
        what: &'static str,
    },
    /// A half of the surface is no surface.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A coordinate cannot be computed.
    #[error(transparent)]
    Manifold(#[from] ManifoldError),
}
