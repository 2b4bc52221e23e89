//! `simulation.json`: what was simulated, and what came of it in a few numbers.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write as _};
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::compare::MapDifference;
use super::{Atrium, AtriumError};
use crate::store::{Identity, write_file};

/// How far the activation came.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Summary {
    /// In one simulation.
    One {
        /// Vertices that were activated in the measured beat.
        activated_vertices: usize,
        /// When the last of them was, ms after the stimulus.
        latest_activation_ms: f64,
    },
    /// In one for each of several draws.
    Many {
        /// Draws that were simulated.
        draws: u32,
        /// Share of (vertex, draw) pairs that were activated and recovered.
        captured_pairs: f64,
        /// Share of pairs whose parameters were in their valid ranges. The others are simulated at the
        /// nearest valid values and left out of the maps.
        pairs_in_range: f64,
    },
}

/// The record of a simulation. It is written last: without it there is no result.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AtriumRecord {
    /// Vertices of the refined mesh.
    pub vertices: usize,
    /// Mean length of its edges, mm.
    pub mean_edge_mm: f64,
    /// When stimuli begin, ms.
    pub stimuli_ms: Vec<f64>,
    /// Vertices that are stimulated.
    pub stimulated_vertices: usize,
    /// When the simulation ends, ms.
    pub end_ms: f64,
    /// The beat that is measured, from 1.
    pub measured_beat: usize,
    /// Wall time, s, that before interruptions included.
    pub seconds: f64,
    /// All that the results depend on.
    pub settings: Identity,
    /// Every other file and folder of the simulation, with its SHA-256 ([`seal_of`](crate::store::seal_of)).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// How far the activation came.
    #[serde(flatten)]
    pub summary: Summary,
    /// Differences from an earlier simulation by map, if one was named.
    #[serde(default, skip_serializing_if = "Vec::is_empty", with = "by_name")]
    pub compared: Vec<(String, MapDifference)>,
}

impl AtriumRecord {
    /// Its file in the output folder.
    pub const FILE: &str = "simulation.json";

    pub(super) fn new(atrium: &Atrium, summary: Summary, seconds: f64) -> Self {
        let (mesh, pacing) = (atrium.mesh(), &atrium.pacing);
        Self {
            vertices: mesh.n_vertices(),
            mean_edge_mm: mesh.mean_edge_length(),
            stimuli_ms: pacing.times.clone(),
            stimulated_vertices: pacing.vertices.len(),
            end_ms: pacing.end,
            measured_beat: pacing.measured + 1,
            seconds,
            settings: atrium.identity.clone(),
            files: BTreeMap::new(),
            summary,
            compared: vec![],
        }
    }

    /// Reads the record in an output folder.
    ///
    /// # Errors
    /// [`AtriumError::Io`], [`AtriumError::Record`].
    pub fn read(folder: &Path) -> Result<Self, AtriumError> {
        read_record(&folder.join(Self::FILE))
    }

    /// Removes the record of an earlier simulation, so that none of its files stands beside new ones as one of them.
    pub(super) fn remove(folder: &Path) -> Result<(), AtriumError> {
        remove_record(&folder.join(Self::FILE))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), AtriumError> {
        write_record(&folder.join(Self::FILE), self)
    }
}

pub(super) fn read_record<T: DeserializeOwned>(path: &Path) -> Result<T, AtriumError> {
    let bytes = fs::read(path).map_err(AtriumError::io("read", path))?;
    Ok(serde_json::from_slice(&bytes)?)
}

pub(super) fn write_record<T: Serialize>(path: &Path, record: &T) -> Result<(), AtriumError> {
    let text = serde_json::to_string_pretty(record)? + "\n";
    write_file(path, |file| file.write_all(text.as_bytes())).map_err(AtriumError::io("write", path))
}

/// Removes a record, if there is one.
pub(super) fn remove_record(path: &Path) -> Result<(), AtriumError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(AtriumError::io("remove", path)(error))
        }
        _ => Ok(()),
    }
}

/// Pairs as an object, in their order.
mod by_name {
    use serde::de::Error as _;
    use serde::ser::SerializeMap as _;

    use super::{Deserialize, Deserializer, MapDifference, Serializer};

    pub(super) fn serialize<S: Serializer>(
        pairs: &[(String, MapDifference)],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(pairs.len()))?;
        for (name, difference) in pairs {
            map.serialize_entry(name, difference)?;
        }
        map.end()
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<(String, MapDifference)>, D::Error> {
        let map = serde_json::Map::deserialize(deserializer)?;
        let pair =
            |(name, value)| Ok((name, serde_json::from_value(value).map_err(D::Error::custom)?));
        map.into_iter().map(pair).collect()
    }
}
