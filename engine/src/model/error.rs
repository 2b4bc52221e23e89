//! What can be wrong between a model and its data.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::store::advice;
use crate::table::{DataError, ProbeError};

/// Why a model cannot be built on its data.
#[derive(Debug, Error)]
pub enum ModelError {
    /// A table of measurements is wrong.
    #[error(transparent)]
    Data(#[from] DataError),
    /// Draws that the disk of [`Settings::disk`](crate::infer::Settings::disk) does not take.
    #[error("cannot write draws to the disk of {}: {source}\nhelp: {}", folder.display(), advice(source))]
    Disk {
        /// The folder.
        folder: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// More modes than the basis has.
    #[error(
        "field {field}: K = {k}, but the basis has {available} modes\nhelp: lower K in the model file, or give a basis with more modes"
    )]
    TooManyModes {
        /// The field.
        field: String,
        /// Asked for.
        k: usize,
        /// There are.
        available: usize,
    },
    /// A field without a surface.
    #[error("the model has a field ({field}) but no surface was given\nhelp: give a mesh (--mesh)")]
    NoBasis {
        /// The field.
        field: String,
    },
    /// A statement that reads measurements without a single row.
    #[error(
        "{file}: no measurement for `{keyword} {name}`\nhelp: rows belong to it by their column `protocol` ({name}, upper or lower case); remove the statement if it was not measured"
    )]
    NoRows {
        /// `observe` or `density`.
        keyword: &'static str,
        /// The statement.
        name: String,
        /// The table.
        file: String,
    },
    /// An effect on something that is neither a field nor a `let`.
    #[error(
        "effect {effect}: `{target}` is neither a field nor a `let` that a measurement depends on\nhelp: an effect acts on the name of a field or of a `let`, for instance `effect {effect} on erp_s2 = …`"
    )]
    NoTarget {
        /// The effect.
        effect: String,
        /// What it names.
        target: String,
    },
    /// A linear predictor whose coefficients are not a vector of the right length.
    #[error(
        "let {name}: `{beta}` has {got} coefficients, the design has {expected} columns\nhelp: declare `param {beta}({expected}) ~ …;`"
    )]
    Coefficients {
        /// The predictor.
        name: String,
        /// Its coefficients.
        beta: String,
        /// Columns.
        expected: usize,
        /// Coefficients.
        got: usize,
    },
    /// Arrival times in a table that does not say where activation starts.
    #[error(
        "let {name}: {file} has no column `{column}`\nhelp: it holds, for each row, the vertex of the mesh at which activation starts (from 0, as in column `vertex`)"
    )]
    NoSource {
        /// The `let`.
        name: String,
        /// The table.
        file: String,
        /// `source`, or `source2` and so on.
        column: String,
    },
    /// An operator where nothing but modes is known of the surface.
    #[error(
        "let {name}: an operator over the surface needs its triangles, and there are none\nhelp: give the mesh itself with --mesh, not its modes alone"
    )]
    NoMesh {
        /// The `let`.
        name: String,
    },
    /// The surface, as operators over it need it.
    #[error(transparent)]
    Surface(Box<ProbeError>),
    /// Different velocities along fibres and across them, on a mesh that has none.
    #[error(
        "let {name}: `eikonal` has a ratio of velocities, but the mesh has no fibres\nhelp: fibres are data of three components called `fibre`, `fibres`, `fiber` or `fibers`, of points or of triangles; `eplat mesh fibres` carries those of another atrium over; without them leave the ratio out, or give an angle as the third argument"
    )]
    NoFibres {
        /// The `let`.
        name: String,
    },
    /// A parameter whose prior cannot be drawn from.
    #[error(
        "{parameter} ~ {prior}: no draw can be made from this prior\nhelp: give {parameter} a proper prior in the model file, for instance `~ Normal(0.0, 10.0)`; one of your own needs its method `sample`"
    )]
    NoPriorDraw {
        /// The parameter.
        parameter: String,
        /// Its prior as written.
        prior: String,
    },
    /// A log density beside the priors, which draws from them would leave out.
    #[error(
        "density {name}: draws from the priors would leave it out\nhelp: write it as priors of the parameters, or take it out of the model file for these draws"
    )]
    DensityInPrior {
        /// The statement.
        name: &'static str,
    },
    /// A density whose terms are not one per row.
    #[error(
        "density {density}: {got} terms for {rows} rows\nhelp: give one term per row, or one for each of the last rows (a series whose first values are taken as given); a density that cannot be told apart by rows is one number, a `D`"
    )]
    Terms {
        /// The statement.
        density: &'static str,
        /// Terms.
        got: usize,
        /// Rows of the table that are its own.
        rows: usize,
    },
    /// A column with a prior whose bounds are unknowns.
    #[error(
        "column {column}: the bounds of its prior depend on parameters\nhelp: give the empty cells a prior with fixed bounds, for instance `~ Normal(mean, sd)`"
    )]
    ImputedBounds {
        /// The column.
        column: String,
    },
    /// A vector prior of fewer than two numbers.
    #[error(
        "param {parameter}({len}): proportions and ordered numbers come at least in twos\nhelp: declare `param {parameter}(2) ~ …;` or more"
    )]
    TooShort {
        /// The parameter.
        parameter: String,
        /// Its length.
        len: usize,
    },
    /// A vector prior of another length.
    #[error(
        "param {parameter}({len}): its prior is of {expected} numbers\nhelp: declare `param {parameter}({expected}) ~ …;`, or give the prior as many arguments as there are numbers"
    )]
    Length {
        /// The parameter.
        parameter: String,
        /// Its length.
        len: usize,
        /// Its prior's.
        expected: usize,
    },
    /// A vector prior that is no density at its constants.
    #[error(
        "param {parameter}: `{prior}` is no density\nhelp: scales and shapes must be positive, and a covariance matrix symmetric and positive definite"
    )]
    NoDensity {
        /// The parameter.
        parameter: String,
        /// Its prior.
        prior: String,
    },
}

/// It is large beside the other errors.
impl From<ProbeError> for ModelError {
    fn from(error: ProbeError) -> Self {
        Self::Surface(error.into())
    }
}
