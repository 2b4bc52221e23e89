//! `run.json`: what was run, on what, how long it took and how well it sampled.

use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::{Approximation, LooRecord, ReportError};
use crate::diagnostics::verdict::{Questions, Verdict};
use crate::store::{seal_of, write_file};

/// Everything needed to repeat a run and to judge it at a glance.
///
/// A number that does not exist is NaN here and null in the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunRecord {
    /// Name of the model.
    pub model: String,
    /// Version of eplat.
    pub version: String,
    /// Seed of all random streams.
    pub seed: u64,
    /// What was fitted to what, when.
    #[serde(default)]
    pub provenance: Provenance,
    /// Sampler settings.
    pub settings: SettingsRecord,
    /// SHA-256 of each input in hexadecimal, by role, e.g. `mesh`, `data`, `model`.
    pub hashes: BTreeMap<String, String>,
    /// Every other file and folder that the run left beside its record, with its SHA-256
    /// ([`seal_of`]).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// Number of unconstrained parameters.
    pub n_params: usize,
    /// Gradient evaluations of all chains, warm-up included.
    pub grad_evals: u64,
    /// Time of one log density with gradient, ns.
    #[serde(deserialize_with = "nan_if_null")]
    pub ns_per_grad: f64,
    /// What a sampler spends besides, for each gradient, ns.
    #[serde(default, deserialize_with = "nan_if_null")]
    pub sampler_ns_per_grad: f64,
    /// Wall-clock time of each stage.
    pub seconds: Seconds,
    /// Chains that ended without their draws, and why; the results are from the others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed_chains: Vec<String>,
    /// Divergent draws after warm-up, all chains.
    pub divergences: usize,
    /// Worst rank-normalised split R̂ of any parameter.
    #[serde(deserialize_with = "nan_if_null")]
    pub max_r_hat: f64,
    /// Smallest bulk effective sample size of any parameter.
    #[serde(deserialize_with = "nan_if_null")]
    pub min_ess_bulk: f64,
    /// Smallest tail effective sample size of any parameter.
    #[serde(deserialize_with = "nan_if_null")]
    pub min_ess_tail: f64,
    /// Smallest bulk effective sample size per second of warm-up and sampling.
    #[serde(deserialize_with = "nan_if_null")]
    pub ess_per_second: f64,
    /// Smallest energy Bayesian fraction of missing information of any chain.
    #[serde(deserialize_with = "nan_if_null")]
    pub e_bfmi: f64,
    /// With a known truth: root mean squared error over the surface by field, in the field's unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse: Option<BTreeMap<String, f64>>,
    /// With a known truth: share of the surface whose truth lies in the central 50, 90 and 95 % interval, by
    /// field and derived quantity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coverage: Option<BTreeMap<String, [f64; 3]>>,
    /// Units of the fields and derived quantities that have a map.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub units: BTreeMap<String, String>,
    /// Share of (vertex, draw) pairs outside a declared range, for models with fields.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unphysical: Option<f64>,
    /// The measurements that most divergences come from, with their number, in words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub divergent_at: Vec<String>,
    /// Where the chains disagree most, in words, if they do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strays: Option<String>,
    /// Statements over the table that measurements cannot be simulated from: those of `density`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_simulated: Vec<String>,
    /// Leave-one-out predictive accuracy, for models with measurements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loo: Option<LooRecord>,
    /// Of a normal approximation: how good it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub laplace: Option<Approximation>,
    /// The figures behind the verdict, but for those of sampling.
    #[serde(default)]
    pub questions: Questions,
    /// Whether the posterior is worth believing.
    #[serde(default)]
    pub verdict: Verdict,
}

/// [`Provenance::mesh`] of the procedural atrium, whose axes and openings are known.
pub const EMBEDDED_ATRIUM: &str = "the embedded left atrium";

/// What was fitted to what, when, and by which command.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Provenance {
    /// The model's file, an absolute path; absent where it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// The surface's file, or what it is; absent for a model without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// Vertices of the surface.
    pub n_vertices: usize,
    /// What was mended of the surface's file, how its unit is known, and its size.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mesh_notes: Vec<String>,
    /// How to read or make the surface again; absent where it was in memory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<SurfaceRecord>,
    /// The file of eigenpairs from elsewhere, an absolute path.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub basis: Option<PathBuf>,
    /// The table's file, or what it is.
    pub data: String,
    /// Measurements that the model takes.
    pub n_rows: usize,
    /// Vertices at which there are any.
    pub n_sites: usize,
    /// The command line; empty if there was none.
    pub command: String,
    /// The day it ended, UTC: YYYY-MM-DD.
    pub date: String,
}

/// How to read or make a surface again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceRecord {
    /// The procedural left atrium.
    Embedded {
        /// Length of its edges, mm.
        edge: f64,
    },
    /// A mesh file.
    File {
        /// An absolute path.
        path: PathBuf,
        /// Unit of its coordinates, if it was given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        units: Option<String>,
        /// Which piece of it, from 1, if that was given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        piece: Option<usize>,
        /// Distance within which vertices were joined, mm, if that was given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        tolerance: Option<f64>,
        /// Whether every vertex was kept of a large one.
        whole: bool,
    },
}

/// Sampler settings.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SettingsRecord {
    /// `blocked`, `nuts`, or `prior` or `laplace` where nothing was sampled.
    pub sampler: String,
    /// Number of chains.
    pub chains: usize,
    /// Warm-up draws of each chain.
    pub warmup: usize,
    /// Kept draws of each chain.
    pub draws: usize,
    /// The most that would have been kept, where a run ends when there are enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub most_draws: Option<usize>,
    /// Mean acceptance that the step size was tuned to; none where there is no step size.
    pub target_accept: Option<f64>,
    /// `low-rank` or `diag`.
    pub metric: String,
}

/// Wall-clock time of each stage, s.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Seconds {
    /// Compiling the model file.
    pub compile: f64,
    /// Mesh, basis, surrogate, data.
    pub setup: f64,
    /// Warm-up.
    pub warmup: f64,
    /// Kept draws.
    pub sampling: f64,
    /// From start to files written.
    pub total: f64,
}

impl RunRecord {
    /// Writes `run.json`.
    ///
    /// # Errors
    /// [`ReportError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), ReportError> {
        write_file(path, |file| {
            serde_json::to_writer_pretty(&mut *file, self)?;
            writeln!(file)
        })
        .map_err(ReportError::write(path))
    }

    /// The path of a file in the run's folder, if it is the one that this run left. A record of a version
    /// that named no files is content with any.
    ///
    /// # Errors
    /// [`ReportError::NotOfRun`], [`ReportError::Read`].
    pub fn own(&self, folder: &Path, name: &str) -> Result<PathBuf, ReportError> {
        let path = folder.join(name);
        if self.files.is_empty() {
            return Ok(path);
        }
        let found = seal_of(&path).map_err(ReportError::read(&path))?;
        if self.files.get(name) == Some(&found) {
            Ok(path)
        } else {
            Err(ReportError::NotOfRun { path, record: folder.join("run.json") })
        }
    }

    /// [`RunRecord::own`] of the record in `folder`; where there is none, whatever file is there.
    ///
    /// # Errors
    /// Those of [`RunRecord::own`] and [`RunRecord::read`].
    pub fn file_of(folder: &Path, name: &str) -> Result<PathBuf, ReportError> {
        let record = folder.join("run.json");
        if record.exists() { Self::read(&record)?.own(folder, name) } else { Ok(folder.join(name)) }
    }

    /// Reads what [`RunRecord::write`] wrote.
    ///
    /// # Errors
    /// [`ReportError::Read`] and [`ReportError::Malformed`].
    pub fn read(path: &Path) -> Result<Self, ReportError> {
        let text = fs::read_to_string(path).map_err(ReportError::read(path))?;
        serde_json::from_str(&text).map_err(|error| ReportError::Malformed {
            path: path.to_owned(),
            reason: error.to_string(),
        })
    }
}

/// For a number that may be missing: JSON has no NaN.
pub(super) fn nan_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn a_record_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.json");
        let mut record = RunRecord {
            max_r_hat: f64::NAN,
            unphysical: Some(0.25),
            divergent_at: vec!["s1s2 at site 1 (3)".to_owned()],
            ..samples::record()
        };
        if let Some(loo) = &mut record.loo {
            loo.se = f64::NAN;
        }
        record.write(&path).unwrap();
        insta::assert_snapshot!(fs::read_to_string(&path).unwrap(), @r#"
        {
          "model": "Erp",
          "version": "0.1.0",
          "seed": 1,
          "provenance": {
            "mesh": "atrium <1>.vtk",
            "n_vertices": 5166,
            "data": "brackets.csv",
            "n_rows": 20,
            "n_sites": 10,
            "command": "eplat run erp.rs",
            "date": "2026-11-22"
          },
          "settings": {
            "sampler": "nuts",
            "chains": 4,
            "warmup": 1000,
            "draws": 1000,
            "target_accept": 0.95,
            "metric": "diag"
          },
          "hashes": {
            "mesh": "ab12"
          },
          "n_params": 54,
          "grad_evals": 901234,
          "ns_per_grad": 1830.5,
          "sampler_ns_per_grad": 410.25,
          "seconds": {
            "compile": 0.0,
            "setup": 1.25,
            "warmup": 2.0,
            "sampling": 2.5,
            "total": 5.75
          },
          "divergences": 0,
          "max_r_hat": null,
          "min_ess_bulk": 1600.0,
          "min_ess_tail": 1512.7,
          "ess_per_second": 605.1,
          "e_bfmi": 0.83,
          "rmse": {
            "tau_out": 2.25
          },
          "coverage": {
            "tau_out": [
              0.48,
              0.871,
              0.93
            ]
          },
          "units": {
            "tau_out": "ms"
          },
          "unphysical": 0.25,
          "divergent_at": [
            "s1s2 at site 1 (3)"
          ],
          "loo": {
            "elpd_loo": -52.25,
            "se": null,
            "p_loo": 8.2,
            "n_measurements": 20,
            "k_threshold": 0.7,
            "n_high_k": 0,
            "n_integrated": 0,
            "n_left_out": 0,
            "worst": []
          },
          "questions": {},
          "verdict": {
            "answers": []
          }
        }
        "#);
        assert_eq!(format!("{:?}", RunRecord::read(&path).unwrap()), format!("{record:?}"));
    }

    #[test]
    fn a_missing_and_a_truncated_record_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.json");
        let missing = RunRecord::read(&path).unwrap_err().to_string();
        assert!(missing.contains("run.json") && missing.contains("help: name the --out"));
        fs::write(&path, "{\n  \"model\": \"Erp\"").unwrap();
        let truncated = RunRecord::read(&path).unwrap_err().to_string();
        assert!(truncated.contains("line 2 column 16"), "{truncated}");
    }
}
