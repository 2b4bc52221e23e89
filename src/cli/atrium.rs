//! `eplat simulate atrium`: paced tissue on a surface, from parameter fields to maps of LAT and APD.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::inputs::embedded_atrium;
use crate::atomic::{write_file, write_folder};
use crate::ep::cell::RANGES;
use crate::ep::surface::{BeatMap, Pacing, simulate_surface};
use crate::ep::{Parameters, Precision, Tissue};
use crate::error::Failure;
use crate::mesh::{self, MeshError, Surface, TriMesh, Units, write_vtp};

/// Edges of the embedded atrium, mm: short enough for a front.
const EDGE: f64 = 0.4;

#[derive(Debug, Args)]
pub(super) struct AtriumArgs {
    /// Surface with parameter fields as point data (.vtp or .vtk), such as fields.vtp of a run; the
    /// embedded left atrium with 0.4 mm edges without it
    #[arg(long, value_name = "F.vtp")]
    fields: Option<PathBuf>,
    /// Unit of the file's coordinates: mm, cm, um or m
    #[arg(long, default_value = "mm")]
    units: Units,
    /// Cut every triangle into four, this many times: fronts need edges below 0.5 mm
    #[arg(long, value_name = "N", default_value_t = 0)]
    refine: u32,
    /// CV_max: a number, m/s, or the name of a field
    #[arg(long, value_name = "X", default_value = "0.7")]
    cv_max: String,
    /// tau_in: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "0.05")]
    tau_in: String,
    /// tau_out: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "tau_out_mean")]
    tau_out: String,
    /// tau_open: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "120")]
    tau_open: String,
    /// APD_max: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "apd_max_mean")]
    apd_max: String,
    /// Vertex that is paced, counted from 0 as in the file
    #[arg(long, value_name = "VERTEX")]
    pace: usize,
    /// Vertices closer than this to it are stimulated with it, mm
    #[arg(long, value_name = "MM", default_value_t = 3.0)]
    radius: f64,
    /// Interval of the S1 train, ms
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    s1: f64,
    /// Beats of the S1 train
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Intervals of further stimuli, ms: S2, S3 and so on
    #[arg(long, value_name = "MS", value_delimiter = ',')]
    extra: Vec<f64>,
    /// Strength of the stimuli, 1/ms
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    strength: f64,
    /// Beat that is measured, from 1; the last without it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    measure: Option<u32>,
    /// How long the last beat is followed, ms
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    last: f64,
    /// Time step, ms
    #[arg(long, value_name = "MS", default_value_t = 0.1)]
    dt: f64,
    /// Write V during the measured beat every so many ms, as a series for ParaView (voltage.pvd)
    #[arg(long, value_name = "MS")]
    snapshots: Option<f64>,
    /// Double precision: about half as fast; LAT and APD differ by less than 0.01 ms
    #[arg(long)]
    double: bool,
    /// Folder to write: beat.vtp (parameters, LAT, APD20 to APD90), simulation.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// What is simulated, on the refined mesh.
struct Setup {
    mesh: TriMesh,
    parameters: Vec<Parameters>,
    pacing: Pacing,
}

impl AtriumArgs {
    pub(super) fn run(&self) -> Result<(), Failure> {
        let setup = self.setup()?;
        let Setup { mesh, pacing, .. } = &setup;
        eprintln!(
            "{} vertices, edges {:.2} mm; {} stimuli at {} vertices, {:.0} ms in all",
            mesh.n_vertices(),
            mesh.mean_edge_length(),
            pacing.times.len(),
            pacing.vertices.len(),
            pacing.end
        );
        if mesh.mean_edge_length() > 0.5 {
            eprintln!(
                "warning: fronts need edges below 0.5 mm, or they slow down and block\nhelp: --refine N halves edges N times"
            );
        }
        let mut failed = None;
        let written = write_folder(&self.out, |folder| {
            let result = if self.double {
                self.simulate::<f64>(&setup, folder)
            } else {
                self.simulate::<f32>(&setup, folder)
            };
            result.map_err(|failure| {
                failed = Some(failure);
                io::Error::other("the simulation failed")
            })
        });
        match (failed, written) {
            (Some(failure), _) => Err(failure),
            (None, written) => written.map_err(|e| Failure::io("write", &self.out, &e)),
        }?;
        eprintln!("written to {}", self.out.display());
        Ok(())
    }

    fn setup(&self) -> Result<Setup, Failure> {
        let surface = match &self.fields {
            Some(file) => mesh::read(file, self.units)?,
            None => embedded_atrium(EDGE),
        };
        let source =
            u32::try_from(self.pace).ok().filter(|v| (*v as usize) < surface.n_source_vertices);
        let centre = source.and_then(|v| surface.vertex_of_source(v as usize)).ok_or_else(|| {
            Failure::new(format_args!(
                "--pace {} is no vertex of the surface, which has {}\nhelp: vertices are counted from 0",
                self.pace, surface.n_source_vertices
            ))
        })?;
        let centre = surface.mesh.vertices()[centre as usize];
        let mut values = self.parameter_values(&surface)?;
        let mut mesh = surface.mesh;
        for _ in 0..self.refine {
            let (finer, ends) = mesh.refined();
            let mean = |[a, b]: &[u32; 2]| {
                let (a, b) = (values[*a as usize], values[*b as usize]);
                std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
            };
            let new: Vec<[f64; 5]> = ends.iter().map(mean).collect();
            values.extend(new);
            mesh = finer;
        }
        let parameters: Vec<Parameters> = values.into_iter().map(Parameters::from_array).collect();
        for (vertex, parameters) in parameters.iter().enumerate() {
            let wrong = |error| Failure::new(format_args!("vertex {vertex}: {error}"));
            parameters.validate().map_err(wrong)?;
        }
        let near = |p: &[f64; 3]| (0..3).map(|k| (p[k] - centre[k]).powi(2)).sum::<f64>();
        let vertices = (0..mesh.n_vertices() as u32)
            .filter(|v| near(&mesh.vertices()[*v as usize]) <= self.radius * self.radius);
        let pacing = self.pacing(vertices.collect())?;
        pacing.validate(mesh.n_vertices(), self.dt)?;
        Ok(Setup { mesh, parameters, pacing })
    }

    /// The five parameters at every vertex, in the order of [`Parameters::from_array`].
    fn parameter_values(&self, surface: &Surface) -> Result<Vec<[f64; 5]>, Failure> {
        let n = surface.mesh.n_vertices();
        let given = [&self.cv_max, &self.tau_in, &self.tau_out, &self.tau_open, &self.apd_max];
        let mut columns = vec![];
        for (text, (name, ..)) in given.into_iter().zip(RANGES) {
            let column = match (text.parse::<f64>(), surface.point_data.get(text)) {
                (Ok(number), _) => vec![number; n],
                (_, Some(field)) => field.clone(),
                _ => {
                    let has: Vec<&str> = surface.point_data.keys().map(String::as_str).collect();
                    let option = name.replace('_', "-");
                    return Err(Failure::new(format_args!(
                        "{name} is to be {text:?}, but the surface has no such field; it has: {}\n\
                         help: give --{option} a number or one of these names",
                        if has.is_empty() { "none".into() } else { has.join(", ") }
                    )));
                }
            };
            columns.push(column);
        }
        Ok((0..n).map(|v| std::array::from_fn(|k| columns[k][v])).collect())
    }

    fn pacing(&self, vertices: Vec<u32>) -> Result<Pacing, Failure> {
        let mut times: Vec<f64> = (0..self.beats).map(|beat| f64::from(beat) * self.s1).collect();
        for interval in &self.extra {
            times.push(times.last().map_or(0.0, |last| last + interval));
        }
        let end = times.last().map_or(0.0, |last| last + self.last);
        if let Some(every) = self.snapshots.filter(|every| !(*every >= self.dt)) {
            return Err(Failure::usage(format_args!(
                "--snapshots {every} is shorter than a time step\nhelp: give ms, for instance 5"
            )));
        }
        let measured = self.measure.map_or(times.len(), |beat| beat as usize) - 1;
        Ok(Pacing { vertices, times, strength: self.strength, end, measured })
    }

    /// Runs the simulation and writes everything to `folder`.
    fn simulate<F: Precision>(&self, setup: &Setup, folder: &Path) -> Result<(), Failure> {
        let Setup { mesh, parameters, pacing } = setup;
        let tissue: Vec<Tissue> = parameters.iter().map(|p| p.tissue()).collect();
        let bar = ProgressBar::new(pacing.end as u64)
            .with_style(ProgressStyle::with_template("{bar:30} {pos}/{len} ms, {eta} left{msg}")?);
        let mut series = Series::new(self.snapshots, pacing);
        let mut failed = None;
        let begun = Instant::now();
        let beat = simulate_surface::<F>(mesh, &tissue, pacing, self.dt, &mut |moment| {
            bar.set_position(moment.time as u64);
            if failed.is_none() && series.is_due(moment.time) {
                failed = series.write(folder, mesh, moment.time, &moment.voltage()).err();
            }
        })?;
        bar.finish_and_clear();
        if let Some(error) = failed {
            return Err(error.into());
        }
        series.finish(folder)?;
        let seconds = begun.elapsed().as_secs_f64();
        write_beat(&folder.join("beat.vtp"), mesh, parameters, &beat)?;
        let activated = beat.lat.iter().filter(|t| t.is_finite());
        let latest = activated.clone().copied().fold(0.0, f64::max);
        let n = activated.count();
        eprintln!(
            "beat {} of {}: {n} of {} vertices activated, the last after {latest:.1} ms; {seconds:.1} s",
            pacing.measured + 1,
            pacing.times.len(),
            mesh.n_vertices()
        );
        let record = json!({
            "vertices": mesh.n_vertices(),
            "mean_edge_mm": mesh.mean_edge_length(),
            "stimuli_ms": pacing.times,
            "stimulated_vertices": pacing.vertices.len(),
            "strength_per_ms": pacing.strength,
            "end_ms": pacing.end,
            "dt_ms": self.dt,
            "precision": if self.double { "f64" } else { "f32" },
            "measured_beat": pacing.measured + 1,
            "activated_vertices": n,
            "latest_activation_ms": latest,
            "seconds": seconds,
        });
        let text = serde_json::to_string_pretty(&record)? + "\n";
        write_file(&folder.join("simulation.json"), |file| file.write_all(text.as_bytes()))?;
        Ok(())
    }
}

fn write_beat(
    path: &Path,
    mesh: &TriMesh,
    parameters: &[Parameters],
    beat: &BeatMap,
) -> Result<(), Failure> {
    let column = |k: usize| parameters.iter().map(|p| p.to_array()[k]).collect::<Vec<f64>>();
    let columns: Vec<(&str, Vec<f64>)> =
        RANGES.iter().enumerate().map(|(k, (name, ..))| (*name, column(k))).collect();
    let mut data: Vec<(&str, &[f64])> = columns.iter().map(|(n, c)| (*n, &c[..])).collect();
    let BeatMap { lat, apd20, apd30, apd50, apd90 } = beat;
    data.extend([("lat", &lat[..]), ("apd20", apd20), ("apd30", apd30)]);
    data.extend([("apd50", &apd50[..]), ("apd90", apd90)]);
    Ok(write_vtp(path, mesh, &data)?)
}

/// V at times of the measured beat, a file each.
struct Series {
    every: Option<f64>,
    from: f64,
    to: f64,
    /// Time (ms) and name of what has been written.
    written: Vec<(f64, String)>,
}

impl Series {
    fn new(every: Option<f64>, pacing: &Pacing) -> Self {
        let to = pacing.times.get(pacing.measured + 1).copied().unwrap_or(pacing.end);
        Self { every, from: pacing.times[pacing.measured], to, written: vec![] }
    }

    fn is_due(&self, time: f64) -> bool {
        let due = |every: f64| self.from + every * self.written.len() as f64;
        self.every.is_some_and(|every| time <= self.to + 1e-9 && time + 1e-9 >= due(every))
    }

    fn write(
        &mut self,
        folder: &Path,
        mesh: &TriMesh,
        time: f64,
        v: &[f64],
    ) -> Result<(), MeshError> {
        let name = format!("voltage_{:04}.vtp", self.written.len());
        write_vtp(&folder.join(&name), mesh, &[("v", v)])?;
        self.written.push((time - self.from, name));
        Ok(())
    }

    /// The list of all files, for ParaView.
    fn finish(&self, folder: &Path) -> io::Result<()> {
        if self.every.is_none() {
            return Ok(());
        }
        let entry = |(time, name): &(f64, String)| {
            format!("<DataSet timestep=\"{time:.3}\" file=\"{name}\"/>\n")
        };
        let entries: String = self.written.iter().map(entry).collect();
        let text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n{entries}</Collection>\n</VTKFile>\n"
        );
        write_file(&folder.join("voltage.pvd"), |file| file.write_all(text.as_bytes()))
    }
}
