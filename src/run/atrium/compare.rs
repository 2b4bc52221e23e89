//! A simulation beside an earlier one on the same mesh.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Deserializer, Serialize};

use super::AtriumError;
use crate::ep::surface::BeatMap;
use crate::mesh::{self, TriMesh, Units};

/// Vertices that are further apart than this are not the same, mm.
const SAME: f64 = 1e-6;

/// Name and values (n_vertices) of a map; NaN where there is none.
pub type Map = (String, Vec<f64>);

/// The maps of an earlier simulation.
#[derive(Debug)]
pub(super) struct Earlier {
    maps: BTreeMap<String, Vec<f64>>,
}

/// How far a map is from that of an earlier simulation, over the vertices with a value in both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapDifference {
    /// Root mean squared difference, ms; NaN without such a vertex.
    #[serde(deserialize_with = "nan_if_null")]
    pub rmse_ms: f64,
    /// Mean of this simulation less the earlier one, ms; NaN without such a vertex.
    #[serde(deserialize_with = "nan_if_null")]
    pub mean_difference_ms: f64,
    /// Number of vertices with a value in both.
    pub vertices: usize,
}

impl Earlier {
    /// Reads its beat.vtp, which must be on `mesh`.
    pub(super) fn read(file: &Path, mesh: &TriMesh) -> Result<Self, AtriumError> {
        let surface = mesh::read(file, Units::Mm)?;
        let (here, there) = (mesh.vertices(), surface.mesh.vertices());
        let apart = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > SAME);
        let file = file.to_owned();
        if here.len() != there.len() || here.iter().zip(there).any(apart) {
            let (here, there) = (here.len(), there.len());
            return Err(AtriumError::OtherMesh { file, there, here });
        }
        let maps = surface.scalars();
        match BeatMap::NAMES.into_iter().find(|name| of(&maps, name).is_none()) {
            Some(name) => Err(AtriumError::NoMap { file, name }),
            None => Ok(Self { maps }),
        }
    }

    /// The differences of `maps` from it, as further maps, and how large they are, by map.
    pub(super) fn compare(&self, maps: &[Map]) -> (Vec<Map>, Vec<(String, MapDifference)>) {
        let here: BTreeMap<String, Vec<f64>> = maps.iter().cloned().collect();
        let mut further = vec![];
        let mut table = vec![];
        for name in BeatMap::NAMES {
            let (Some(here), Some(there)) = (of(&here, name), of(&self.maps, name)) else {
                continue;
            };
            let difference: Vec<f64> = here.iter().zip(there).map(|(a, b)| a - b).collect();
            table.push((name.to_owned(), MapDifference::of(&difference)));
            further.push((format!("{name}_difference"), difference));
        }
        (further, table)
    }
}

impl MapDifference {
    fn of(difference: &[f64]) -> Self {
        let finite: Vec<f64> = difference.iter().copied().filter(|d| d.is_finite()).collect();
        let mean = |of: fn(&f64) -> f64| finite.iter().map(of).sum::<f64>() / finite.len() as f64;
        Self {
            rmse_ms: mean(|d| d * d).sqrt(),
            mean_difference_ms: mean(|d| *d),
            vertices: finite.len(),
        }
    }
}

/// JSON has no NaN.
fn nan_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// A map, or of an ensemble its mean.
fn of<'a>(maps: &'a BTreeMap<String, Vec<f64>>, name: &str) -> Option<&'a Vec<f64>> {
    maps.get(name).or_else(|| maps.get(&format!("{name}_mean")))
}
