//! V at times of the measured beat, a file for each: in the checkpoint while the simulation runs, in the
//! folder `voltage` when it is done.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::{Atrium, AtriumError};
use crate::ep::Precision;
use crate::ep::surface::Simulation;
use crate::mesh::write_vtp;
use crate::store::{write_file, write_folder};

/// The files of a series, as far as they are written.
pub(super) struct Series {
    every: f64,
    from: f64,
    to: f64,
    folder: PathBuf,
    /// Times (ms) of what has been written.
    times: Vec<f64>,
}

impl Series {
    /// A series in `checkpoint`; `None` if none is asked for. What an earlier simulation left there
    /// goes, unless this one `goes_on` with it.
    pub(super) fn new(
        atrium: &Atrium,
        checkpoint: &Path,
        goes_on: bool,
    ) -> Result<Option<Self>, AtriumError> {
        let folder = checkpoint.join("voltage");
        if !goes_on && folder.exists() {
            fs::remove_dir_all(&folder).map_err(AtriumError::io("remove", &folder))?;
        }
        let Some(every) = atrium.settings.numerics.snapshots else { return Ok(None) };
        fs::create_dir_all(&folder).map_err(AtriumError::io("write", &folder))?;
        let pacing = &atrium.pacing;
        let to = pacing.times.get(pacing.measured + 1).copied().unwrap_or(pacing.end);
        Ok(Some(Self { every, from: pacing.times[pacing.measured], to, folder, times: vec![] }))
    }

    /// When the next is due: at the end of a step of `dt` ms.
    fn next(&self, dt: f64) -> Option<f64> {
        let due = self.from + self.every * self.times.len() as f64;
        let step = ((due - 1e-9) / dt).ceil().max(1.0);
        Some(step * dt).filter(|time| *time <= self.to + 1e-9)
    }

    /// Writes V if it is time. What was due before a simulation goes on has been written then.
    pub(super) fn take<F: Precision>(
        &mut self,
        atrium: &Atrium,
        simulation: &Simulation<F>,
    ) -> Result<(), AtriumError> {
        let (now, dt) = (simulation.time(), atrium.settings.numerics.dt);
        while let Some(next) = self.next(dt).filter(|next| *next < now + 0.5 * dt) {
            if next > now - 0.5 * dt {
                let path = self.folder.join(name(self.times.len()));
                write_vtp(&path, atrium.mesh(), &[("v", &simulation.voltage())])?;
            }
            self.times.push(next - self.from);
        }
        Ok(())
    }

    /// Puts the series in `out` and writes the list of its files. The checkpoint keeps its own as long as a
    /// simulation may go on from there.
    fn finish(&self, out: &Path) -> Result<(), AtriumError> {
        let (list, folder) = (out.join("voltage.pvd"), out.join("voltage"));
        let link = |from: &Path, to: &Path| {
            // without links on this file system, a copy
            fs::hard_link(from, to).or_else(|_| fs::copy(from, to).map(drop))
        };
        let fill = |new: &Path| {
            (0..self.times.len())
                .try_for_each(|k| link(&self.folder.join(name(k)), &new.join(name(k))))
        };
        write_folder(&folder, fill).map_err(AtriumError::io("write", &folder))?;
        let entry = |(k, time): (usize, &f64)| {
            format!("<DataSet timestep=\"{time:.3}\" file=\"voltage/{}\"/>\n", name(k))
        };
        let entries: String = self.times.iter().enumerate().map(entry).collect();
        let text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n{entries}</Collection>\n</VTKFile>\n"
        );
        write_file(&list, |file| file.write_all(text.as_bytes()))
            .map_err(AtriumError::io("write", &list))
    }
}

/// Puts the series, if there is one, in the place of that of an earlier simulation, which goes.
pub(super) fn replace(series: Option<&Series>, out: &Path) -> Result<(), AtriumError> {
    let (list, folder) = (out.join("voltage.pvd"), out.join("voltage"));
    if list.exists() {
        fs::remove_file(&list).map_err(AtriumError::io("remove", &list))?;
    }
    if let Some(series) = series {
        return series.finish(out);
    }
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(AtriumError::io("remove", &folder))?;
    }
    Ok(())
}

/// Removes what a simulation that is done has left of its series in the checkpoint, of which nothing else is there.
pub(super) fn forget(checkpoint: &Path) -> Result<(), AtriumError> {
    let folder = checkpoint.join("voltage");
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(AtriumError::io("remove", &folder))?;
        // somebody may have put something else there
        let _ = fs::remove_dir(checkpoint);
    }
    Ok(())
}

fn name(k: usize) -> String {
    format!("{k:04}.vtp")
}
