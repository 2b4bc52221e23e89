//! The mode of the posterior instead of draws from it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::check::placed;
use super::folder::NewFiles;
use super::results::VERSION;
use super::{OutputFolder, Problem, RunError};
use crate::experiment::rms_error;
use crate::infer::{InferError, Optimum, OptimumSettings, maximise};
use crate::mesh::write_vtp;
use crate::model::{Asked, Kind, MapSummary, Maps, Model};
use crate::report::{rmse_line, shown};
use crate::store::write_file;

/// What the mode is, so that nobody takes it for the posterior's centre.
const WHAT_IT_IS: &str = "This is the mode of the density that is sampled: joint, in unconstrained coordinates, Jacobian included. \
    Of a hierarchical model it may lie far from the bulk of the posterior; sample for means and intervals";
/// An iteration takes microseconds, and the ripple of bracket likelihoods needs thousands.
const MOST_ITERATIONS: usize = 50_000;
/// Significant digits on the screen.
const DIGITS: usize = 5;
/// Vectors longer than this are one line on the screen.
const LONGEST_VECTOR: usize = 10;

/// A mode and what it means.
#[derive(Debug)]
pub struct Mode<'m> {
    problem: Problem<'m>,
    optimum: Optimum,
    /// Every reported number, in the order of the model's parameters.
    values: Vec<f64>,
    /// Fields and derived quantities at every vertex.
    maps: Vec<MapSummary>,
}

/// Climbs towards the model's mode.
pub(super) fn climb(model: &Model) -> Result<Optimum, InferError> {
    let settings = OptimumSettings { max_iterations: MOST_ITERATIONS, ..Default::default() };
    maximise(model, &model.climbs_from(), &settings)
}

impl<'m> Problem<'m> {
    /// Climbs from the model's initial point to the mode of its posterior.
    ///
    /// # Errors
    /// [`RunError::Infer`] where the climb cannot begin. A climb that reaches no mode is told by
    /// [`Mode::converged`].
    pub fn mode(&self) -> Result<Mode<'m>, RunError> {
        let problem = self.corrected()?;
        let model = problem.model();
        let optimum = climb(model).map_err(|error| placed(model, error))?;
        let (mut tape, mut values) = (model.tape(), vec![]);
        model.forward(&mut tape, &optimum.position);
        model.report_mode(&tape, &mut values);
        let maps = self.loaded().basis().map_or(vec![], |basis| {
            let one = std::slice::from_ref(&optimum.position);
            Maps::new(model, basis).summarise(one, &Asked::default()).maps
        });
        Ok(Mode { problem, optimum, values, maps })
    }
}

impl Mode<'_> {
    /// Whether the climb reached a mode.
    pub fn converged(&self) -> bool {
        self.optimum.converged
    }

    /// Where it ended, in the unknowns.
    pub fn optimum(&self) -> &Optimum {
        &self.optimum
    }

    /// Fields and derived quantities at every vertex, their sd 0; empty for a model without a surface.
    pub fn maps(&self) -> &[MapSummary] {
        &self.maps
    }

    /// Name, value and unit of every reported number.
    pub fn parameters(&self) -> Vec<(String, f64, &str)> {
        let elements =
            self.problem.model().parameters.iter().flat_map(|p| (0..p.len).map(move |i| (p, i)));
        elements.zip(&self.values).map(|((p, i), x)| (p.element(i), *x, p.unit.as_str())).collect()
    }

    /// The true map of this name, if it is known.
    fn truth(&self, name: &str) -> Option<&[f64]> {
        let mut known = self.problem.loaded().truth.iter();
        known.find(|(of, _)| *of == name).map(|(_, truth)| truth.as_slice())
    }

    /// Root mean squared error of each map with a known truth.
    fn errors(&self) -> BTreeMap<String, f64> {
        let error = |map: &MapSummary| {
            Some((map.name.clone(), rms_error(&map.mean, self.truth(&map.name)?)))
        };
        self.maps.iter().filter_map(error).collect()
    }

    /// Writes `map.csv`, `fields.vtp` and `map.json`, the record last; returns their names.
    ///
    /// # Errors
    /// [`RunError::Unwritable`], [`RunError::Write`], [`RunError::Mesh`].
    pub fn write(&self, folder: impl AsRef<Path>) -> Result<Vec<&'static str>, RunError> {
        self.write_into(&OutputFolder::open(folder)?)
    }

    /// As [`Mode::write`], into a folder that was tried before.
    ///
    /// # Errors
    /// Those of [`Mode::write`].
    pub fn write_into(&self, out: &OutputFolder) -> Result<Vec<&'static str>, RunError> {
        let new = out.begin()?;
        let files = self.write_files(&new).map_err(|error| new.named(out, error))?;
        out.replace(&new, &files)?;
        Ok(files)
    }

    /// Writes all files, the record last; their names.
    fn write_files(&self, new: &NewFiles) -> Result<Vec<&'static str>, RunError> {
        let mut files = vec!["map.csv"];
        let path = new.file("map.csv");
        write_file(&path, |file| {
            let mut table = csv::Writer::from_writer(file);
            table.write_record(["parameter", "value", "unit"])?;
            for (name, value, unit) in self.parameters() {
                table.write_record([&name, &format!("{value:?}"), unit])?;
            }
            table.flush()
        })
        .map_err(RunError::write(&path))?;
        if let Some(surface) = self.problem.loaded().surface() {
            let mut arrays: Vec<(String, &[f64])> = vec![];
            for map in &self.maps {
                arrays.push((map.name.clone(), &map.mean));
                let truth = self.truth(&map.name);
                arrays.extend(truth.map(|truth| (format!("{}_true", map.name), truth)));
            }
            let arrays: Vec<(&str, &[f64])> =
                arrays.iter().map(|(name, values)| (name.as_str(), *values)).collect();
            write_vtp(&new.file("fields.vtp"), &surface.mesh, &arrays)?;
            files.push("fields.vtp");
        }
        let mut record = self.json();
        record["files"] = json!(new.seals(&files)?);
        let path = new.file("map.json");
        write_file(&path, |file| writeln!(file, "{record:#}")).map_err(RunError::write(&path))?;
        files.push("map.json");
        Ok(files)
    }

    /// The record, `map.json`.
    pub fn json(&self) -> Value {
        let parameters = self.parameters().into_iter();
        let parameters: Map<String, Value> = parameters
            .map(|(name, value, unit)| (name, json!({ "value": value, "unit": unit })))
            .collect();
        json!({
            "model": self.problem.model().name,
            "version": VERSION,
            "hashes": self.problem.loaded().hashes,
            "converged": self.optimum.converged,
            "iterations": self.optimum.iterations,
            "gradient_norm": self.optimum.gradient_norm,
            "ln_density": self.optimum.ln_density,
            "parameters": parameters,
            "rmse": self.errors(),
        })
    }

    /// The parameters as a table, and how the climb ended.
    pub fn text(&self) -> String {
        let mut text = table(&self.lines());
        let errors = self.errors();
        if !errors.is_empty() {
            let units = self.maps.iter().map(|map| (map.name.clone(), map.unit.clone()));
            let _ = writeln!(text, "\n{}", rmse_line(&errors, &units.collect()));
        }
        let Optimum { iterations, gradient_norm, ln_density, converged, .. } = &self.optimum;
        let figures = format!(
            "ln density {ln_density:.3}, {iterations} iterations, largest gradient entry {gradient_norm:.1e}"
        );
        let _ = match converged {
            true => write!(text, "Mode found: {figures}.\n{WHAT_IT_IS}."),
            false => write!(
                text,
                "No mode reached: {figures}; the density may have no maximum. Use tighter priors, or sample.\n{WHAT_IT_IS}."
            ),
        };
        text
    }

    /// Name, value and unit of each line of the table; long vectors are one line.
    fn lines(&self) -> Vec<[String; 3]> {
        let mut values = self.values.iter();
        let lines = self.problem.model().parameters.iter().flat_map(|p| {
            let own: Vec<f64> = values.by_ref().take(p.len).copied().collect();
            if p.kind != Kind::Scalar && p.len > LONGEST_VECTOR {
                let name = format!("{}[…]", p.name);
                return vec![[name, format!("{} values", p.len), shown(&p.unit).to_owned()]];
            }
            let unit = shown(&p.unit);
            let line = |(i, x): (usize, &f64)| [p.element(i), significant(*x), unit.to_owned()];
            own.iter().enumerate().map(line).collect()
        });
        lines.collect()
    }
}

/// Names and units to the left, numbers to the right.
fn table(lines: &[[String; 3]]) -> String {
    let header = ["parameter", "value", "unit"].map(str::to_owned);
    let width = |column: usize| {
        let cells = lines.iter().chain([&header]).map(|line| line[column].chars().count());
        cells.max().unwrap_or_default()
    };
    let (names, numbers) = (width(0), width(1));
    let line = |[name, value, unit]: &[String; 3]| {
        let line = format!("{name:<names$}  {value:>numbers$}  {unit}");
        format!("{}\n", line.trim_end())
    };
    [&header].into_iter().chain(lines).map(line).collect()
}

/// A number with [`DIGITS`] significant digits, in powers of ten where that is long.
fn significant(value: f64) -> String {
    let exponent = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
    let decimals = (DIGITS as f64 - 1.0 - exponent).max(0.0) as usize;
    if (-4.0..7.0).contains(&exponent) {
        format!("{value:.decimals$}")
    } else {
        format!("{value:.0$e}", DIGITS - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Loaded;
    use super::*;
    use crate::table::Measurements;

    mod conjugate {
        use crate::prelude::*;
        model! {
            model Conjugate;
            param mean [ms] ~ Normal(10.0, 2.0);
            observe y(row): Number [ms] ~ Normal(mean, 1.0);
        }
    }

    #[test]
    fn the_mode_of_a_conjugate_normal_is_exact() {
        let cells = ["12.0", "13.5", "11.25"].map(|y| vec![y.to_owned()]).to_vec();
        let measurements = Measurements::from_cells("test", vec!["y".into()], cells).unwrap();
        let loaded = Loaded { measurements, ..Loaded::default() };
        let problem = Problem::new(&conjugate::Conjugate, loaded).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mode = problem.mode().unwrap();
        assert_eq!(mode.write(folder.path()).unwrap(), ["map.csv", "map.json"]);
        // Precisions 1/4 and 3 · 1.
        let exact = (10.0 / 4.0 + 12.0 + 13.5 + 11.25) / 3.25;
        let text = std::fs::read_to_string(folder.path().join("map.json")).unwrap();
        let json: Value = serde_json::from_str(&text).unwrap();
        let found = json["parameters"]["mean"]["value"].as_f64().unwrap();
        assert!((found - exact).abs() < 1e-6, "{found} {exact}");
        assert_eq!(json["converged"], true);
        let csv = std::fs::read_to_string(folder.path().join("map.csv")).unwrap();
        assert_eq!(csv, format!("parameter,value,unit\nmean,{found:?},ms\n"));
        let text = mode.text();
        assert!(
            text.starts_with("parameter   value  unit\nmean       12.077  ms\nMode found: "),
            "{text}"
        );
    }

    #[test]
    fn numbers_have_five_digits() {
        let texts =
            [0.0, 12.0, -0.012_345_67, 1_234_567.8, 1e9, -1.5e-7, f64::NAN].map(significant);
        insta::assert_snapshot!(texts.join("  "), @"0.0000  12.000  -0.012346  1234568  1.0000e9  -1.5000e-7  NaN");
    }
}
