//! Candidates: effects that the model may lack.

use super::cause::Cause;
use crate::model::Form;
use crate::model::forms::Above;

/// What a candidate acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// It moves what is observed.
    Observable,
    /// It moves a field behind what is observed.
    Parameter,
    /// It widens the scatter of measurements.
    Noise,
}

/// The quick test that decides whether a candidate is fitted at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Screen {
    /// An F-test of the sites' mean residuals on the candidate's design.
    Sites,
    /// An F-test of the units' random effects on the candidate's design. These effects leave no
    /// residuals of sites over, so that the test of sites would see nothing.
    Units,
    /// The same F-test of the sites' mean absolute residuals: of how far they scatter.
    Scatter,
    /// There is no test: the candidate is always fitted.
    None,
}

/// An effect that the model may lack.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The cause that it stands for. A cause may have several candidates.
    pub cause: Cause,
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// What it acts on.
    pub level: Level,
    /// How it depends on a row; `None` for outliers. A candidate for scatter moves nothing that is
    /// predicted. Its value is ln of the factor by which the error of a row is larger.
    pub form: Option<Form>,
    /// Prior sd of its coefficients, in the unit of what it acts on.
    pub sd: f64,
    /// What decides whether it is fitted.
    pub screen: Screen,
}

impl Candidate {
    /// The column that it reads.
    pub fn column(&self) -> Option<&str> {
        self.form.as_ref()?.column()
    }

    /// Whether it is scatter that depends on a column.
    pub fn is_scatter(&self) -> bool {
        self.level == Level::Noise && self.form.is_some()
    }

    /// The threshold of a patch, if its edge is sharp.
    pub(super) fn edge(&self) -> Option<&Above> {
        self.form.as_ref()?.downcast()
    }

    /// Whether it is a field over the surface or along paths.
    pub(super) fn is_field(&self) -> bool {
        self.form.as_ref().is_some_and(|form| form.n_modes() > 0)
    }
}

/// A column that cannot be tried, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unusable {
    /// The column.
    pub column: String,
    /// Why.
    pub why: String,
}
