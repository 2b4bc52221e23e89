//! What a run leaves in its output folder, and the summary at its end.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Map, Value, json};

use super::init::{self, WarmStart};
use super::inputs::Inputs;
use super::interrupt::identity;
use crate::diagnostics::e_bfmi;
use crate::error::Failure;
use crate::infer::{Chain, LogDensity as _};
use crate::manifold::Basis;
use crate::mesh::{Surface, write_vtp};
use crate::model::{Maps, Model, equations};
use crate::report::{
    self, Approximation, FieldDraws, Group, Page, PointData, Posterior, RunRecord, Seconds,
    Variable, end_of_run, verdict, write_draws, write_html, write_loo, write_summary_csv,
    write_summary_json, write_zarr,
};
use crate::store::Identity;
use crate::store::write_file;
use crate::study::{coverage, rms_error, thinned};

const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Most draws that field maps are averaged over; more change nothing that can be seen.
const MAP_DRAWS: usize = 1000;

/// An output folder that can be written to; it is made when there are results.
pub(super) struct OutputFolder(PathBuf);

impl OutputFolder {
    /// Tries the folder, or the nearest one above it that exists, before anything slow is done.
    pub(super) fn open(path: &Path) -> Result<Self, Failure> {
        let existing = path.ancestors().find(|p| p.exists()).unwrap_or(Path::new("."));
        tempfile::tempfile_in(existing).map_err(|error| Self::unwritable(path, &error))?;
        Ok(Self(path.to_owned()))
    }

    fn unwritable(path: &Path, error: &std::io::Error) -> Failure {
        Failure::new(format_args!(
            "cannot write to the output folder {}: {error}\nhelp: name another with --out DIR",
            path.display()
        ))
    }

    /// Makes the folder, once there is something to put in it.
    pub(super) fn make(&self) -> Result<(), Failure> {
        fs::create_dir_all(&self.0).map_err(|error| Self::unwritable(&self.0, &error))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

/// A run that has sampled.
pub(super) struct Finished<'a> {
    pub(super) model: &'a Model,
    pub(super) inputs: &'a Inputs,
    pub(super) sampled: Sampled,
    pub(super) seed: u64,
    pub(super) settings: report::Settings,
    pub(super) compile_seconds: f64,
    pub(super) begun: Instant,
}

/// What sampling gave.
#[derive(Default)]
pub(super) struct Sampled {
    /// The chains that came through.
    pub(super) chains: Vec<Chain>,
    /// Why the others did not.
    pub(super) failures: Vec<String>,
    /// Wall time of sampling, s.
    pub(super) seconds: f64,
    /// Of it, before this process: the run was interrupted.
    pub(super) seconds_before: f64,
    /// How good the draws are, if they are from a normal approximation.
    pub(super) laplace: Option<Approximation>,
}

/// What the end of a run shows.
pub(super) struct Outcome {
    rows: Vec<report::Row>,
    record: RunRecord,
    files: Vec<&'static str>,
}

/// Maps over the surface, with the truth beside them where it is known.
struct FieldMaps {
    unphysical: Vec<f64>,
    /// Root mean squared error of each map's mean, in its unit.
    rmse: BTreeMap<String, f64>,
    /// How often each map's intervals have the truth in them.
    coverage: BTreeMap<String, [f64; 3]>,
    units: BTreeMap<String, String>,
    /// Name, unit, values at the vertices.
    arrays: Vec<(String, String, Vec<f64>)>,
}

impl Finished<'_> {
    /// What the draws depend on.
    pub(super) fn identity(&self) -> Identity {
        identity(VERSION, self.seed, &self.settings, &self.inputs.hashes)
    }

    /// Writes every file; the record last.
    pub(super) fn write(&self, out: &OutputFolder) -> Result<Outcome, Failure> {
        let measurements = &self.inputs.measurements;
        let mut posterior =
            Posterior::new(self.model, measurements, &self.sampled.chains, self.seed);
        if matches!(self.settings.sampler.as_str(), "prior" | "laplace") {
            // Leaving a measurement out is a statement about draws from the posterior.
            posterior.loo = None;
        }
        let surface = self.inputs.surface.as_ref();
        let maps = surface.map(|(surface, basis)| self.maps(surface, basis));
        out.make()?;
        let mut files = vec!["summary.csv", "summary.json", "draws.csv"];
        write_summary_csv(&out.file("summary.csv"), &posterior.rows)?;
        write_summary_json(&out.file("summary.json"), &posterior.rows)?;
        write_draws(&out.file("draws.csv"), &posterior.posterior)?;
        self.write_zarr(out, &posterior, maps.as_ref())?;
        files.push("posterior.zarr");
        if let Some(loo) = &posterior.loo {
            write_loo(&out.file("loo.csv"), &loo.rows)?;
            files.push("loo.csv");
        }
        if let (Some((surface, _)), Some(maps)) = (surface, &maps) {
            let arrays: Vec<(&str, &[f64])> = maps
                .arrays
                .iter()
                .map(|(name, _, values)| (name.as_str(), values.as_slice()))
                .collect();
            write_vtp(&out.file("fields.vtp"), &surface.mesh, &arrays)?;
            files.push("fields.vtp");
        }
        if let Some(draws) = surface.and_then(|(_, basis)| self.field_draws(basis)) {
            draws.write(&out.file(FieldDraws::FILE))?;
            files.push(FieldDraws::FILE);
        }
        if !self.inputs.truth.is_empty() {
            let text = self.inputs.measurements.to_csv();
            let path = out.file("measurements.csv");
            write_file(&path, |file| file.write_all(text.as_bytes()))
                .map_err(|error| Failure::io("write", &path, &error))?;
            files.push("measurements.csv");
        }
        if self.settings.sampler != "prior" {
            WarmStart::new(self.model, &self.sampled.chains).write(&out.file(init::FILE))?;
            files.push(init::FILE);
        }
        let record = self.record(&posterior, maps.as_ref());
        self.write_page(out, &posterior, &record, maps.as_ref())?;
        record.write(&out.file("run.json"))?;
        files.extend(["report.html", "run.json"]);
        Ok(Outcome { rows: posterior.rows, record, files })
    }

    /// Draws that maps are made of.
    fn thinned(&self) -> Vec<&[f64]> {
        thinned(&self.sampled.chains, MAP_DRAWS)
    }

    /// The draws of the fields that maps are made of; `None` if the model has no field.
    fn field_draws(&self, basis: &Basis) -> Option<FieldDraws> {
        let maps = Maps::new(self.model, basis);
        if maps.n_fields() == 0 {
            return None;
        }
        let (n_modes, fields) = maps.coefficients(&self.thinned());
        let rows = (0..basis.n_vertices()).flat_map(|v| &basis.at(v)[..n_modes]);
        Some(FieldDraws {
            n_modes,
            eigenfunctions: rows.copied().collect(),
            coefficients: fields.into_iter().map(|(name, c)| (name.into(), c)).collect(),
        })
    }

    fn maps(&self, surface: &Surface, basis: &Basis) -> FieldMaps {
        let (summaries, unphysical) = Maps::new(self.model, basis).summarise(&self.thinned());
        let mut arrays: Vec<(String, String, Vec<f64>)> = vec![];
        let mut rmse = BTreeMap::new();
        for map in &summaries {
            let mut push = |suffix: &str, unit: &str, values: &[f64]| {
                arrays.push((format!("{}_{suffix}", map.name), unit.into(), values.to_vec()));
            };
            push("mean", &map.unit, &map.mean);
            push("sd", &map.unit, &map.sd);
            if let Some((name, truth)) = self.inputs.truth.iter().find(|t| t.0 == map.name) {
                push("true", &map.unit, truth);
                let errors = map.mean.iter().zip(truth).map(|(m, t)| m - t);
                let ise: Vec<f64> = errors.zip(&map.sd).map(|(e, sd)| e.abs() / sd).collect();
                push("ise", "", &ise);
                rmse.insert((*name).to_string(), rms_error(&map.mean, truth));
            }
        }
        let units = summaries.iter().map(|m| (m.name.to_string(), m.unit.clone())).collect();
        arrays.push(("unphysical".into(), "1".into(), unphysical.clone()));
        // an earlier run's fields.vtp as the mesh has maps of these names already
        let is_new = |name: &String| arrays.iter().all(|(own, ..)| own != name);
        let of_mesh = surface.point_data.iter().filter(|(name, _)| is_new(name));
        let of_mesh: Vec<_> =
            of_mesh.map(|(name, v)| (name.clone(), String::new(), v.clone())).collect();
        arrays.extend(of_mesh);
        FieldMaps { unphysical, rmse, coverage: self.coverage(basis), units, arrays }
    }

    /// How often the truth lies in the intervals of the draws, if it is known.
    fn coverage(&self, basis: &Basis) -> BTreeMap<String, [f64; 3]> {
        if self.inputs.truth.is_empty() {
            return BTreeMap::new();
        }
        // in the order of the model's maps
        let truth: Vec<&[f64]> = self.inputs.truth.iter().map(|(_, map)| map.as_slice()).collect();
        let ranks = Maps::new(self.model, basis).ranks(&self.thinned(), &truth);
        let names = self.inputs.truth.iter().map(|(name, _)| (*name).to_owned());
        names.zip(ranks.iter().map(|ranks| coverage(ranks))).collect()
    }

    fn write_zarr(
        &self,
        out: &OutputFolder,
        posterior: &Posterior,
        maps: Option<&FieldMaps>,
    ) -> Result<(), Failure> {
        let mut groups = posterior.groups();
        if let Some(maps) = maps {
            let variable = |(name, unit, values): &(String, String, Vec<f64>)| {
                Variable::new(name, unit, &[("vertex", values.len())], values.clone())
            };
            let variables = maps.arrays.iter().map(variable).collect();
            groups.push(Group { name: "fields".into(), variables });
        }
        let mut attributes = Map::new();
        attributes.insert("model".into(), json!(self.model.name));
        attributes.insert("eplat_version".into(), json!(VERSION));
        Ok(write_zarr(&out.file("posterior.zarr"), &groups, &attributes)?)
    }

    fn write_page(
        &self,
        out: &OutputFolder,
        posterior: &Posterior,
        record: &RunRecord,
        maps: Option<&FieldMaps>,
    ) -> Result<(), Failure> {
        let surface = self.inputs.surface.as_ref().map(|(surface, _)| surface);
        let sites: Vec<[f64; 3]> = surface.map_or(vec![], |s| {
            let vertices = self.inputs.measurements.vertices();
            vertices.iter().map(|v| s.mesh.vertices()[*v as usize]).collect()
        });
        let data: Vec<PointData<'_>> = maps.map_or(vec![], |maps| {
            maps.arrays
                .iter()
                .map(|(name, unit, values)| PointData { name, unit, values })
                .collect()
        });
        let page = Page {
            title: self.model.name,
            equations: &equations(self.model),
            record,
            rows: &posterior.rows,
            posterior: &posterior.posterior,
            loo: posterior.loo.as_ref(),
            surface: surface.map(|s| report::Surface {
                mesh: &s.mesh,
                point_data: &data,
                sites: &sites,
            }),
        };
        Ok(write_html(&out.file("report.html"), &page)?)
    }

    fn record(&self, posterior: &Posterior, maps: Option<&FieldMaps>) -> RunRecord {
        let sum = |of: fn(&Chain) -> f64| self.sampled.chains.iter().map(of).sum::<f64>();
        let (warmup, sampling) = (sum(|c| c.seconds_warmup), sum(|c| c.seconds_sampling));
        let Sampled { chains, failures, seconds: sampled_in, seconds_before, laplace } =
            &self.sampled;
        let wall = sampled_in / (warmup + sampling);
        let elapsed = self.begun.elapsed().as_secs_f64() + seconds_before;
        let grad_evals =
            self.sampled.chains.iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum::<u64>();
        let least = |of: fn(&report::Row) -> f64| {
            posterior.rows.iter().map(of).fold(f64::INFINITY, f64::min)
        };
        let min_ess_bulk = least(|r| r.summary.ess_bulk);
        RunRecord {
            model: self.model.name.into(),
            version: VERSION.into(),
            seed: self.seed,
            settings: self.settings.clone(),
            hashes: self.inputs.hashes.clone(),
            n_params: self.model.dim(),
            grad_evals,
            ns_per_grad: 1e9 * (warmup + sampling) / grad_evals as f64,
            seconds: Seconds {
                compile: self.compile_seconds,
                setup: elapsed - sampled_in,
                warmup: warmup * wall,
                sampling: sampling * wall,
                total: elapsed + self.compile_seconds,
            },
            divergences: chains.iter().map(Chain::n_divergences).sum(),
            failed_chains: failures.clone(),
            max_r_hat: -least(|r| -r.summary.r_hat),
            min_ess_bulk,
            min_ess_tail: least(|r| r.summary.ess_tail),
            ess_per_second: min_ess_bulk / sampled_in,
            e_bfmi: self
                .sampled
                .chains
                .iter()
                .map(|c| e_bfmi(&c.energy))
                .fold(f64::INFINITY, f64::min),
            rmse: maps.map(|m| m.rmse.clone()).filter(|rmse| !rmse.is_empty()),
            coverage: maps.map(|m| m.coverage.clone()).filter(|coverage| !coverage.is_empty()),
            unphysical: maps.map(|m| m.unphysical.iter().sum::<f64>() / m.unphysical.len() as f64),
            units: maps.map(|m| m.units.clone()).unwrap_or_default(),
            divergent_at: self.suspects(),
            strays: posterior.strays.clone(),
            not_simulated: self.not_simulated(),
            loo: posterior.loo.as_ref().map(|loo| loo.record.clone()),
            laplace: laplace.clone(),
        }
    }

    fn not_simulated(&self) -> Vec<String> {
        let densities = self.model.densities.iter().filter(|density| density.reads_data);
        densities.map(|density| density.name.to_owned()).collect()
    }

    /// The measurements whose log likelihood falls most along divergent transitions.
    fn suspects(&self) -> Vec<String> {
        let mut blamed: BTreeMap<usize, usize> = BTreeMap::new();
        let mut tape = self.model.tape();
        let mut pointwise = |u: &[f64]| {
            let mut out = vec![];
            self.model.forward(&mut tape, u);
            self.model.pointwise(&tape, &mut out);
            out
        };
        for divergence in self.sampled.chains.iter().flat_map(|c| &c.divergences) {
            let (start, end) = (pointwise(&divergence.start), pointwise(&divergence.end));
            let falls = end.iter().zip(&start).map(|(e, s)| e - s).enumerate();
            let worst = falls.min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((row, fall)) = worst
                && fall < 0.0
            {
                *blamed.entry(row).or_default() += 1;
            }
        }
        let mut blamed: Vec<(usize, usize)> = blamed.into_iter().collect();
        blamed.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        blamed
            .iter()
            .take(3)
            .map(|(row, count)| format!("{} ({count})", self.place_of(*row)))
            .collect()
    }

    /// Measurement number `row` of all, in words.
    fn place_of(&self, mut row: usize) -> String {
        for (name, rows) in self.model.measured() {
            match rows.get(row) {
                Some(at) => return format!("{name} {}", self.inputs.measurements.place(*at)),
                None => row -= rows.len(),
            }
        }
        String::new()
    }
}

impl Outcome {
    pub(super) fn converged(&self) -> bool {
        verdict(&self.record, &self.rows).converged
    }

    /// What the run found, and where the files are.
    pub(super) fn text(&self, out: &OutputFolder) -> String {
        let said = end_of_run(&self.rows, &self.record);
        format!("{said}\nFiles in {}: {}", out.0.display(), self.files.join(", "))
    }

    /// Summary and record as one object.
    pub(super) fn json(&self) -> Value {
        let rows = self.rows.iter().map(|r| (r.name.clone(), json!(r.summary)));
        let summary: Map<String, Value> = rows.collect();
        let verdict = verdict(&self.record, &self.rows);
        json!({
            "summary": summary,
            "run": self.record,
            "converged": verdict.converged,
            "verdict": verdict.sentence,
        })
    }
}
