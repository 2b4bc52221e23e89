//! Causes: what a finding is named after.

use std::fmt;

use eplat_language::as_name;

/// Why measurements may differ from what a model says.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// A column of the table, by its name.
    Column(String),
    /// A patch of different tissue: what is nearer to something than a threshold.
    Patch,
    /// An offset between protocols.
    Protocol,
    /// Some measurements are much further off than the others.
    Outliers,
    /// Scatter that depends on a column of the table.
    Hetero(String),
    /// A smooth field over the surface.
    SpatialField,
    /// A slowness that varies along the paths of activation.
    SlownessField,
    /// Detail that the model's own fields would follow if they had more modes.
    Short,
}

impl Cause {
    /// Its name in a form that a model file allows.
    pub fn name(&self) -> String {
        as_name(&self.to_string())
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Hetero(name) => return write!(f, "hetero({name})"),
            Self::Column(name) => name,
            Self::Patch => "patch",
            Self::Protocol => "protocol",
            Self::Outliers => "outliers",
            Self::SpatialField => "spatial_field",
            Self::SlownessField => "slowness_field",
            Self::Short => "short",
        })
    }
}
