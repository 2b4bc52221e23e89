//! What an atrium simulation leaves: beat.vtp, the voltage series, and last simulation.json.

use std::fs;
use std::io::{self, Write as _};
use std::path::PathBuf;

use serde_json::{Map, Value, json};

use super::{Outcome, Setup};
use crate::ep::Precision;
use crate::ep::surface::Simulation;
use crate::error::Failure;
use crate::mesh::write_vtp;
use crate::run::OutputFolder;
use crate::store::Identity;
use crate::store::write_file;

/// The file that says what was simulated; without it there is no result.
pub(super) const RECORD: &str = "simulation.json";

/// Writes the maps and the record, and compares with an earlier simulation if one was named.
pub(super) fn write(
    out: &OutputFolder,
    setup: &Setup,
    outcome: Outcome,
    identity: &Identity,
    seconds: f64,
) -> Result<(), Failure> {
    let Outcome { mut maps, record: found } = outcome;
    let (mesh, pacing) = (setup.mesh(), &setup.pacing);
    let mut record = Map::new();
    for (name, value) in [
        ("vertices", json!(mesh.n_vertices())),
        ("mean_edge_mm", json!(mesh.mean_edge_length())),
        ("stimuli_ms", json!(pacing.times)),
        ("stimulated_vertices", json!(pacing.vertices.len())),
        ("end_ms", json!(pacing.end)),
        ("measured_beat", json!(pacing.measured + 1)),
        ("seconds", json!(seconds)),
        ("settings", json!(identity)),
    ]
    .into_iter()
    .chain(found)
    {
        record.insert(name.into(), value);
    }
    if let Some(earlier) = &setup.earlier {
        record.insert("compared".into(), earlier.compare(&mut maps));
    }
    out.make()?;
    let data: Vec<(&str, &[f64])> =
        maps.iter().map(|(n, values)| (n.as_str(), &values[..])).collect();
    write_vtp(&out.file("beat.vtp"), mesh, &data)?;
    let text = serde_json::to_string_pretty(&Value::Object(record))? + "\n";
    let path = out.file(RECORD);
    write_file(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::io("write", &path, &error))
}

/// V at times of the measured beat, a file each: in the checkpoint while the simulation runs, in the
/// folder `voltage` when it is done.
pub(super) struct Series {
    every: Option<f64>,
    from: f64,
    to: f64,
    folder: PathBuf,
    /// Times (ms) of what has been written.
    times: Vec<f64>,
}

impl Series {
    pub(super) fn new(
        every: Option<f64>,
        setup: &Setup,
        out: &OutputFolder,
        goes_on: bool,
    ) -> Result<Self, Failure> {
        let pacing = &setup.pacing;
        let to = pacing.times.get(pacing.measured + 1).copied().unwrap_or(pacing.end);
        let folder = out.file("checkpoint").join("voltage");
        if !goes_on && folder.exists() {
            fs::remove_dir_all(&folder).map_err(|error| Failure::io("remove", &folder, &error))?;
        }
        if every.is_some() {
            fs::create_dir_all(&folder).map_err(|error| Failure::io("write", &folder, &error))?;
        }
        Ok(Self { every, from: pacing.times[pacing.measured], to, folder, times: vec![] })
    }

    /// When the next is due: at the end of a step of `dt` ms.
    fn next(&self, dt: f64) -> Option<f64> {
        let due = self.from + self.every? * self.times.len() as f64;
        let step = ((due - 1e-9) / dt).ceil().max(1.0);
        Some(step * dt).filter(|time| *time <= self.to + 1e-9)
    }

    /// Writes V if it is time. What was due before a simulation goes on has been written then.
    pub(super) fn take<F: Precision>(
        &mut self,
        setup: &Setup,
        simulation: &Simulation<F>,
    ) -> Result<(), Failure> {
        let (now, dt) = (simulation.time(), setup.dt);
        while let Some(next) = self.next(dt).filter(|next| *next < now + 0.5 * dt) {
            if next > now - 0.5 * dt {
                let path = self.folder.join(name(self.times.len()));
                write_vtp(&path, setup.mesh(), &[("v", &simulation.voltage())])?;
            }
            self.times.push(next - self.from);
        }
        Ok(())
    }

    /// Gives the series its place and writes the list of its files; without one, those of an earlier
    /// simulation go.
    pub(super) fn finish(&self, out: &OutputFolder) -> Result<(), Failure> {
        let (list, folder) = (out.file("voltage.pvd"), out.file("voltage"));
        let failed = |error: io::Error| Failure::io("write", &folder, &error);
        if list.exists() {
            fs::remove_file(&list).map_err(failed)?;
        }
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(failed)?;
        }
        if self.every.is_none() {
            return Ok(());
        }
        fs::rename(&self.folder, &folder).map_err(failed)?;
        let entry = |(k, time): (usize, &f64)| {
            format!("<DataSet timestep=\"{time:.3}\" file=\"voltage/{}\"/>\n", name(k))
        };
        let entries: String = self.times.iter().enumerate().map(entry).collect();
        let text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n{entries}</Collection>\n</VTKFile>\n"
        );
        write_file(&list, |file| file.write_all(text.as_bytes())).map_err(failed)
    }
}

fn name(k: usize) -> String {
    format!("{k:04}.vtp")
}
