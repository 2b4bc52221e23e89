//! What an experiment leaves: its numbers, its maps and its page; the numbers last.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::KnownTruth;
use super::settings::FIELDS;
use super::simulation::Simulated;
use crate::diagnostics::verdict::Verdict;
use crate::experiment::INTERVALS;
use crate::mesh::write_vtp;
use crate::report::{
    ExperimentPage, Figure, PointData, Surface, after_number, write_experiment_page,
};
use crate::run::atrium::{AtriumRecord, MapDifference, Summary};
use crate::run::{OutputFolder, Results, RunError};
use crate::store::{Identity, write_file};
use crate::study::{RecoveredMap, Recovery, StudyError};

/// What an experiment is, in its folder, from the first.
pub(super) const SETTINGS: &str = "settings.json";
/// The parameters of both simulations.
pub(super) const TISSUE: &str = "simulation/tissue.vtp";
/// The record of an experiment, in its folder.
pub(super) const RECORD: &str = "experiment.json";
/// What else is written with it.
pub(super) const FILES: [&str; 3] = ["fields.vtp", "measurements.csv", "report.html"];
/// An error of so many standard deviations is a large one.
const LARGE: f64 = 3.0;
/// Maps of the beat that are drawn.
const DRAWN: [&str; 2] = ["apd20", "apd90"];

/// All that is known at the end of an experiment.
#[derive(Debug)]
pub struct Findings<'t> {
    pub(super) truth: &'t KnownTruth<'t>,
    /// All that the results depend on.
    pub identity: Identity,
    /// The calibration.
    pub run: Results,
    /// Whether it can be relied on.
    pub verdict: Verdict,
    /// What it recovered.
    pub recovery: Recovery,
    /// The two simulations, if they were not left out.
    pub simulated: Option<Simulated>,
}

/// A map at the vertices, with its name and unit.
type NamedMap = (String, String, Vec<f64>);

impl Findings<'_> {
    /// Writes every file aside, then puts all in their place, the numbers last.
    pub(super) fn write(&self, out: &OutputFolder) -> Result<(), StudyError> {
        let maps = self.maps();
        let surface = &self.truth.domain.surface;
        let data: Vec<(&str, &[f64])> =
            maps.iter().map(|(name, _, values)| (name.as_str(), values.as_slice())).collect();
        let new = out.begin()?;
        let [fields, table, page] = FILES.map(|name| new.path().join(name));
        let write = || -> Result<(), RunError> {
            let text = self.truth.problem.measurements().to_csv();
            write_vtp(&fields, &surface.mesh, &data)?;
            write_file(&table, |file| file.write_all(text.as_bytes()))
                .map_err(|source| RunError::Write { path: table.clone(), source })?;
            self.write_page(&page, &maps)
        };
        write().map_err(|error| new.named(out, error))?;
        let kept = [SETTINGS, TISSUE].map(str::to_owned);
        let kept = if self.simulated.is_some() { &kept[..] } else { &kept[..1] };
        Ok(out.publish(&new, (RECORD, self.json()), kept, &[])?)
    }

    /// All maps, in the order of the figures: name, unit and values (n_vertices).
    pub fn maps(&self) -> Vec<(String, String, Vec<f64>)> {
        let mut maps: Vec<NamedMap> = vec![];
        for map in &self.recovery.maps {
            let parts = [("true", &map.truth), ("mean", &map.mean), ("sd", &map.sd)];
            for (part, values) in parts {
                maps.push((format!("{}_{part}", map.name), map.unit.clone(), values.clone()));
            }
            maps.push((format!("{}_ise", map.name), String::new(), map.ise()));
        }
        for (name, values) in self.simulated.iter().flat_map(|simulated| &simulated.maps) {
            maps.push((name.clone(), "ms".to_owned(), values.clone()));
        }
        maps.push(("repaired".to_owned(), "1".to_owned(), self.recovery.repaired.clone()));
        maps.push(("cv_max".to_owned(), "m/s".to_owned(), self.truth.cv_max.clone()));
        maps
    }

    /// Share of (vertex, draw) pairs that were repaired.
    fn repaired(&self) -> f64 {
        let shares = &self.recovery.repaired;
        shares.iter().sum::<f64>() / shares.len() as f64
    }

    /// All numbers as one object: what `experiment.json` holds.
    pub fn json(&self) -> Value {
        let maps: Map<String, Value> =
            self.recovery.maps.iter().map(|map| (map.name.clone(), of_map(map))).collect();
        let vertices = self.truth.problem.measurements().vertices();
        let simulation = self.simulated.as_ref().map(|simulated| {
            let [truth, mean] = &simulated.records;
            let compared: Map<String, Value> = mean
                .compared
                .iter()
                .map(|(name, difference)| (name.clone(), json!(difference)))
                .collect();
            json!({
                "vertices": truth.vertices,
                "mean_edge_mm": truth.mean_edge_mm,
                "stimuli_ms": truth.stimuli_ms,
                "activated_vertices": { "true": activated(truth), "mean": activated(mean) },
                "seconds": { "true": truth.seconds, "mean": mean.seconds },
                "mean_against_true": compared,
            })
        });
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "settings": self.identity,
            "sites": vertices,
            "measurements": self.truth.problem.measurements().len(),
            "truth_repaired": self.truth.repaired,
            "draws": self.recovery.n_draws,
            "draws_without_a_physical_vertex": self.recovery.n_void,
            "pairs_repaired": self.repaired(),
            "maps": maps,
            "converged": self.verdict.converged(),
            "verdict": self.verdict,
            "seconds_of_the_run": self.run.record.seconds.total,
            "simulation": simulation,
        })
    }

    /// Errors, coverage and differences as lines of text.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{:<8} {:>7} {:>7} {:>8} {:>8} {:>8}   truth in 50, 90, 95 %\n",
            "map", "unit", "RMSE", "error", "mean sd", "ISE > 3"
        );
        for map in &self.recovery.maps {
            let _ = writeln!(
                text,
                "{:<8} {:>7} {:>7.2} {:>+8.2} {:>8.2} {:>6.1} %   {} %",
                map.name,
                map.unit,
                map.rmse(),
                map.bias(),
                mean(&map.sd),
                100.0 * large(map),
                map.coverage.map(|share| format!("{:.0}", 100.0 * share)).join(", ")
            );
        }
        for (name, compared) in self.compared() {
            let _ = writeln!(
                text,
                "{name:<8} {:>7} {:>7.2} {:>+8.2}   of the last beat, mean fields against true ones",
                "ms", compared.rmse_ms, compared.mean_difference_ms
            );
        }
        let _ = write!(
            text,
            "Repaired: {:.1} % of the truth's vertices, {:.1} % of (vertex, draw) pairs of {} draws",
            100.0 * self.truth.repaired,
            100.0 * self.repaired(),
            self.recovery.n_draws
        );
        text
    }

    /// How the two simulations differ in the beat's maps.
    fn compared(&self) -> &[(String, MapDifference)] {
        self.simulated.as_ref().map_or(&[], |simulated| &simulated.records[1].compared)
    }

    fn write_page(&self, path: &Path, maps: &[NamedMap]) -> Result<(), RunError> {
        let surface = &self.truth.domain.surface;
        let vertices = self.truth.problem.measurements().vertices();
        let sites: Vec<[f64; 3]> =
            vertices.iter().map(|v| surface.mesh.vertices()[*v as usize]).collect();
        let data: Vec<PointData<'_>> =
            maps.iter().map(|(name, unit, values)| PointData { name, unit, values }).collect();
        let mut settings: Vec<(String, String)> =
            self.identity.iter().map(|(name, value)| (name.clone(), value.clone())).collect();
        let run = self.run.folder.file_name().unwrap_or_default().display();
        settings.push(("whole run".to_owned(), format!("{run}/report.html")));
        let page = ExperimentPage {
            verdict: &self.verdict,
            tiles: &self.tiles(),
            figures: &self.figures(),
            table: &self.text(),
            settings: &settings,
            surface: Surface {
                mesh: &surface.mesh,
                point_data: &data,
                sites: &sites,
                axes: surface.axes,
            },
        };
        Ok(write_experiment_page(path, &page)?)
    }

    /// The figures that are read first.
    fn tiles(&self) -> Vec<(String, String)> {
        let errors = self.recovery.maps.iter();
        let mut tiles: Vec<(String, String)> = errors
            .map(|map| {
                let rmse = format!("{:.1}{}", map.rmse(), after_number(&map.unit));
                (rmse, format!("RMSE of {}", map.name))
            })
            .collect();
        for (name, compared) in
            self.compared().iter().filter(|(name, _)| DRAWN.contains(&name.as_str()))
        {
            let rmse = compared.rmse_ms;
            tiles.push((format!("{rmse:.1} ms"), format!("RMSE of simulated {name}")));
        }
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        tiles.push((percent(self.truth.repaired), "of the truth repaired".to_owned()));
        tiles.push((percent(self.repaired()), "of the draws' vertices repaired".to_owned()));
        tiles
    }

    fn figures(&self) -> Vec<Figure> {
        let n_fields = FIELDS.len();
        let recovered = |maps: &[RecoveredMap]| -> Vec<Vec<String>> {
            let parts = ["true", "mean", "sd", "ise"];
            maps.iter().map(|map| parts.map(|part| format!("{}_{part}", map.name)).into()).collect()
        };
        let (fields, derived) = self.recovery.maps.split_at(n_fields);
        let mut figures = vec![
            Figure {
                title: "Parameters: truth and what was recovered".to_owned(),
                note: "Truth and posterior mean share one scale. ISE is |mean − truth| over the posterior's standard deviation.".to_owned(),
                rows: recovered(fields),
            },
            Figure {
                title: "ERP".to_owned(),
                note: "From the surrogates: of the truth, and of every draw after its unphysical vertices were repaired.".to_owned(),
                rows: recovered(derived),
            },
        ];
        if self.simulated.is_some() {
            let row =
                |name: &str| ["true", "mean", "difference"].map(|part| format!("{name}_{part}"));
            figures.push(Figure {
                title: "Action potential durations in the simulated atrium".to_owned(),
                note: "The last beat, simulated with the true fields and with their posterior means; the difference is mean less truth.".to_owned(),
                rows: DRAWN.into_iter().map(|name| row(name).into()).collect(),
            });
        }
        figures
    }
}

fn activated(record: &AtriumRecord) -> Option<usize> {
    match record.summary {
        Summary::One { activated_vertices, .. } => Some(activated_vertices),
        Summary::Many { .. } => None,
    }
}

fn of_map(map: &RecoveredMap) -> Value {
    let percent = |level: &f64| format!("{:.0}", 100.0 * level);
    let coverage: Map<String, Value> = INTERVALS
        .iter()
        .zip(map.coverage)
        .map(|(level, share)| (percent(level), json!(share)))
        .collect();
    json!({
        "unit": map.unit,
        "rmse": map.rmse(),
        "mean_error": map.bias(),
        "mean_sd": mean(&map.sd),
        "ise_above_3": large(map),
        "coverage": coverage,
    })
}

/// Share of vertices with a large error.
fn large(map: &RecoveredMap) -> f64 {
    let known: Vec<f64> = map.ise().into_iter().filter(|ise| !ise.is_nan()).collect();
    known.iter().filter(|ise| **ise > LARGE).count() as f64 / known.len() as f64
}

/// Over the vertices with a value.
fn mean(values: &[f64]) -> f64 {
    let known: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    known.iter().sum::<f64>() / known.len() as f64
}
