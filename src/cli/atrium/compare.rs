//! A simulation beside an earlier one on the same mesh.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::ep::surface::BeatMap;
use crate::error::Failure;
use crate::mesh::{self, TriMesh, Units};

/// The maps of an earlier simulation.
pub(super) struct Earlier {
    file: PathBuf,
    maps: BTreeMap<String, Vec<f64>>,
}

impl Earlier {
    /// Reads its beat.vtp, which must be on `mesh`.
    pub(super) fn read(file: &Path, mesh: &TriMesh) -> Result<Self, Failure> {
        let surface = mesh::read(file, Units::Mm)?;
        let (here, there) = (mesh.vertices(), surface.mesh.vertices());
        let apart = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > 1e-6);
        if here.len() != there.len() || here.iter().zip(there).any(apart) {
            return Err(Failure::new(format_args!(
                "--compare {}: it is of another mesh: {} vertices there, {} here\n\
                 help: simulate both on the same surface with the same --refine",
                file.display(),
                there.len(),
                here.len()
            )));
        }
        let maps = surface.point_data;
        if let Some(name) = BeatMap::NAMES.iter().find(|name| of(&maps, name).is_none()) {
            return Err(Failure::new(format_args!(
                "--compare {}: it has no map {name}\nhelp: give the beat.vtp of a simulation",
                file.display()
            )));
        }
        Ok(Self { file: file.to_owned(), maps })
    }

    /// Adds the differences from it to `maps`; tells bias and root mean square over the vertices that have
    /// a value in both.
    pub(super) fn compare(&self, maps: &mut Vec<(String, Vec<f64>)>) -> Value {
        eprintln!("against {}:", self.file.display());
        let here: BTreeMap<String, Vec<f64>> = maps.iter().cloned().collect();
        let mut table = Map::new();
        for name in BeatMap::NAMES {
            let (Some(here), Some(there)) = (of(&here, name), of(&self.maps, name)) else {
                continue;
            };
            let difference: Vec<f64> = here.iter().zip(there).map(|(a, b)| a - b).collect();
            let finite: Vec<f64> = difference.iter().copied().filter(|d| d.is_finite()).collect();
            let mean =
                |of: fn(&f64) -> f64| finite.iter().map(of).sum::<f64>() / finite.len() as f64;
            let (bias, rmse) = (mean(|d| *d), mean(|d| d * d).sqrt());
            let n = finite.len();
            eprintln!(
                "  {name:<6} RMSE {rmse:6.2} ms, mean difference {bias:+6.2} ms, {n} vertices"
            );
            table.insert(
                name.into(),
                json!({ "rmse_ms": rmse, "mean_difference_ms": bias, "vertices": n }),
            );
            maps.push((format!("{name}_difference"), difference));
        }
        Value::Object(table)
    }
}

/// A map, or of an ensemble its mean.
fn of<'a>(maps: &'a BTreeMap<String, Vec<f64>>, name: &str) -> Option<&'a Vec<f64>> {
    maps.get(name).or_else(|| maps.get(&format!("{name}_mean")))
}
