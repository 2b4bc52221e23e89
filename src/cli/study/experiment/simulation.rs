//! The paced atrium with the true fields, and with their posterior means.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use super::super::super::atrium::AtriumArgs;
use super::Setup;
use crate::ep::surface::BeatMap;
use crate::error::Failure;
use crate::mesh::{self, Surface, TriMesh, Units, write_vtp};
use crate::run::OutputFolder;
use crate::store::Identity;
use crate::study::Recovery;

/// Fronts need vertices no farther apart than this, mm.
const EDGE: f64 = 0.4;

#[derive(Debug, Args)]
pub(super) struct SimulationArgs {
    /// Do not simulate the atrium: no APD. The same command without this goes on with it
    #[arg(long)]
    pub(super) skip_simulation: bool,
    /// Beats of the atrium, 600 ms apart; the last is measured
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Vertex that is paced, counted from 0 as in the file [default: one at the rim of the widest opening]
    #[arg(long, value_name = "VERTEX")]
    pace: Option<usize>,
    /// Cut every triangle into four, this many times, for the simulation [default: until vertices are 0.4 mm
    /// apart]
    #[arg(long, value_name = "N")]
    refine: Option<u32>,
}

/// What the two simulations gave.
pub(super) struct Simulated {
    /// Name and values at the vertices before they were refined: each map of the beat for the truth and the
    /// mean, and mean less truth.
    pub(super) maps: Vec<(String, Vec<f64>)>,
    /// `simulation.json` of the truth and of the mean, which has the comparison.
    pub(super) records: [Value; 2],
}

impl SimulationArgs {
    /// Complains about what only the simulation would.
    pub(super) fn check(&self, surface: &Surface) -> Result<(), Failure> {
        self.paced(surface).map(|_| ())
    }

    /// What the results depend on.
    pub(super) fn identity(&self) -> Identity {
        let text = |value: Option<String>| value.unwrap_or_else(|| "default".to_owned());
        Identity::from([
            ("beats".to_owned(), self.beats.to_string()),
            ("pace".to_owned(), text(self.pace.map(|v| v.to_string()))),
            ("refine".to_owned(), text(self.refine.map(|n| n.to_string()))),
        ])
    }

    /// Simulates what is not simulated yet; `None` if interrupted.
    pub(super) fn run(
        &self,
        setup: &Setup,
        recovery: &Recovery,
        out: &OutputFolder,
    ) -> Result<Option<Simulated>, Failure> {
        let folder = OutputFolder::open(&out.file("simulation"))?;
        folder.make()?;
        let surface = &setup.domain()?.surface;
        let tissue = folder.file("tissue.vtp");
        write_tissue(&tissue, &surface.mesh, setup, recovery)?;
        let beats = ["true", "mean"].map(|which| folder.file(which));
        for (which, to) in ["true", "mean"].into_iter().zip(&beats) {
            eprintln!("atrium with the {which} fields");
            let mut line = self.line(&tissue, which, to, surface)?;
            if which == "mean" {
                line.extend(["--compare".to_owned(), path(&beats[0].join("beat.vtp"))]);
            }
            if !AtriumArgs::from_line(&line)?.going_on()?.simulate()? {
                return Ok(None);
            }
        }
        Simulated::read(&beats, surface.mesh.n_vertices()).map(Some)
    }

    /// The command line of one of them, as `eplat simulate atrium` takes it.
    fn line(
        &self,
        tissue: &Path,
        which: &str,
        to: &Path,
        surface: &Surface,
    ) -> Result<Vec<String>, Failure> {
        let pace = self.paced(surface)?;
        let halvings = (surface.mesh.mean_edge_length() / EDGE).log2().ceil().max(0.0);
        let refine = self.refine.unwrap_or(halvings as u32);
        let words = [
            ("--fields", path(tissue)),
            ("--cv-max", "cv_max".to_owned()),
            ("--tau-out", format!("tau_out_{which}")),
            ("--apd-max", format!("apd_max_{which}")),
            ("--refine", refine.to_string()),
            ("--pace", pace.to_string()),
            ("--beats", self.beats.to_string()),
            ("--out", path(to)),
        ];
        Ok(words.into_iter().flat_map(|(name, value)| [name.to_owned(), value]).collect())
    }

    /// The vertex of the surface that is paced.
    fn paced(&self, surface: &Surface) -> Result<u32, Failure> {
        let Some(source) = self.pace else {
            let loops = surface.mesh.boundary_loops();
            let widest = loops.iter().max_by_key(|rim| rim.len());
            return Ok(widest.and_then(|rim| rim.first().copied()).unwrap_or(0));
        };
        surface.vertex_of_source(source).ok_or_else(|| {
            Failure::new(format_args!(
                "--pace {source} is no vertex of the surface, which has {}\nhelp: vertices are counted from 0",
                surface.n_source_vertices
            ))
        })
    }
}

/// What is simulated: the surface with the parameters of both.
fn write_tissue(
    file: &Path,
    mesh: &TriMesh,
    setup: &Setup,
    recovery: &Recovery,
) -> Result<(), Failure> {
    let mut data = vec![("cv_max".to_owned(), &setup.cv_max)];
    for map in &recovery.maps {
        data.push((format!("{}_true", map.name), &map.truth));
        data.push((format!("{}_mean", map.name), &map.mean));
    }
    let data: Vec<(&str, &[f64])> = data.iter().map(|(n, v)| (n.as_str(), v.as_slice())).collect();
    Ok(write_vtp(file, mesh, &data)?)
}

impl Simulated {
    fn read(folders: &[PathBuf; 2], n_vertices: usize) -> Result<Self, Failure> {
        let beat = |folder: &PathBuf| mesh::read(&folder.join("beat.vtp"), Units::Mm);
        let [truth, mean] = [beat(&folders[0])?, beat(&folders[1])?];
        let mut maps = vec![];
        for name in BeatMap::NAMES {
            // the vertices of the refined mesh begin with those it was made of
            let of = |beat: &Surface| beat.point_data[name][..n_vertices].to_vec();
            let (truth, mean) = (of(&truth), of(&mean));
            let difference = mean.iter().zip(&truth).map(|(mean, truth)| mean - truth).collect();
            maps.push((format!("{name}_true"), truth));
            maps.push((format!("{name}_mean"), mean));
            maps.push((format!("{name}_difference"), difference));
        }
        let record = |folder: &PathBuf| -> Result<Value, Failure> {
            let path = folder.join("simulation.json");
            let text = std::fs::read(&path).map_err(|error| Failure::io("read", &path, &error))?;
            Ok(serde_json::from_slice(&text)?)
        };
        Ok(Self { maps, records: [record(&folders[0])?, record(&folders[1])?] })
    }
}

fn path(path: &Path) -> String {
    path.display().to_string()
}
