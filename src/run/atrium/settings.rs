//! What is simulated and how, as plain data.

use std::convert::Infallible;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Serialize, Serializer};
use serde_json::Value;

use super::AtriumError;
use crate::store::Identity;

/// One simulation of paced tissue on a surface, or one for each of several draws of a posterior.
///
/// The results depend on all of these but `compare`; a checkpoint is known by their names and values.
#[derive(Clone, Debug, Default, Serialize)]
pub struct AtriumSettings {
    /// The tissue at every vertex.
    #[serde(flatten)]
    pub tissue: TissueSettings,
    /// Where and when it is paced.
    #[serde(flatten)]
    pub pacing: PacingSettings,
    /// How it is computed.
    #[serde(flatten)]
    pub numerics: Numerics,
    /// Number of draws of the posterior to simulate; every parameter whose source is the field
    /// `NAME_mean` takes the draws of `NAME`. Without it the fields are simulated as they are.
    pub draws: Option<u32>,
    /// The beat.vtp of an earlier simulation on the same mesh, to compare with.
    #[serde(skip)]
    pub compare: Option<PathBuf>,
}

/// Where a parameter of the tissue comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// The same number at every vertex, in the parameter's unit.
    Number(f64),
    /// Point data of this name.
    Field(String),
}

/// The five parameters of every vertex, and the direction of fast conduction.
#[derive(Clone, Debug, Serialize)]
pub struct TissueSettings {
    /// How often every triangle is cut into four. Fronts need edges below 0.5 mm.
    pub refine: u32,
    /// `CV_max`, m/s; with fibres, along them.
    pub cv_max: Source,
    /// `tau_in`, ms.
    pub tau_in: Source,
    /// `tau_out`, ms.
    pub tau_out: Source,
    /// `tau_open`, ms.
    pub tau_open: Source,
    /// `APD_max`, ms.
    pub apd_max: Source,
    /// Name of the point data that hold a vector for each vertex, along which conduction is faster.
    /// Needs `anisotropy`.
    pub fibres: Option<String>,
    /// CV along the fibres over CV across, 1 or more. Needs `fibres`.
    pub anisotropy: Option<f64>,
}

/// Where and when a surface is paced.
#[derive(Clone, Debug, Serialize)]
pub struct PacingSettings {
    /// Vertices that are paced together, counted from 0 as in the surface's file.
    pub pace: Vec<usize>,
    /// Instead of `pace`: all vertices at which point data of this name have this value.
    pub pace_region: Option<(String, f64)>,
    /// Vertices closer than this to one of `pace` are stimulated with it, mm.
    pub radius: f64,
    /// Interval of the S1 train, ms.
    pub s1: f64,
    /// Beats of the S1 train.
    pub beats: u32,
    /// Intervals of further stimuli, ms: S2, S3 and so on.
    pub extra: Vec<f64>,
    /// Strength of the stimuli, 1/ms.
    pub strength: f64,
    /// Beat that is measured, counted from 1; the last without it.
    pub measure: Option<u32>,
    /// How long the last beat is followed, ms.
    pub last: f64,
}

/// How a simulation is computed.
#[derive(Clone, Debug, Serialize)]
pub struct Numerics {
    /// Time step, ms.
    pub dt: f64,
    /// Double instead of single precision: about half as fast.
    pub double: bool,
    /// Interval at which V is written during the measured beat, ms. Only a simulation of one set of
    /// parameters that writes to a folder does so.
    pub snapshots: Option<f64>,
}

impl Default for TissueSettings {
    /// The fields of `models/erp.rs` as a run leaves them.
    fn default() -> Self {
        let field = |name: &str| Source::Field(name.to_owned());
        Self {
            refine: 0,
            cv_max: Source::Number(0.7),
            tau_in: Source::Number(0.05),
            tau_out: field("tau_out_mean"),
            tau_open: Source::Number(120.0),
            apd_max: field("apd_max_mean"),
            fibres: None,
            anisotropy: None,
        }
    }
}

impl Default for PacingSettings {
    /// Eight beats, 600 ms apart. Where is to be said.
    fn default() -> Self {
        Self {
            pace: vec![],
            pace_region: None,
            radius: 3.0,
            s1: 600.0,
            beats: 8,
            extra: vec![],
            strength: 1.0,
            measure: None,
            last: 600.0,
        }
    }
}

impl Default for Numerics {
    /// Single precision in steps of 0.1 ms.
    fn default() -> Self {
        Self { dt: 0.1, double: false, snapshots: None }
    }
}

impl FromStr for Source {
    type Err = Infallible;
    /// A number if the text is one, otherwise the name of a field.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(text.parse().map_or_else(|_| Self::Field(text.to_owned()), Self::Number))
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Field(name) => name.fmt(f),
        }
    }
}

impl Serialize for Source {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl AtriumSettings {
    /// Every setting that the results depend on, by the name of its option, and the version.
    pub(super) fn identity(&self) -> Result<Identity, AtriumError> {
        let mut identity =
            Identity::from([("eplat's version".into(), env!("CARGO_PKG_VERSION").to_owned())]);
        if let Value::Object(options) = serde_json::to_value(self)? {
            let named =
                |(name, value): (String, Value)| (name.replace('_', "-"), value.to_string());
            identity.extend(options.into_iter().map(named));
        }
        Ok(identity)
    }
}
