//! What is predicted of the rows of a table, as text and files.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;

use serde_json::{Map, Value, json};

use super::folder::NewFiles;
use super::results::VERSION;
use super::{OutputFolder, RunError};
use crate::report::{
    Forecasted, Group, PredictedRow, Variable, after_number, write_forecast, write_zarr,
};
use crate::store::write_file;

/// Rows that are shown.
const SHOWN: usize = 20;

/// What is predicted of one row of a table.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Row of the table, from 0.
    pub row: usize,
    /// Its line, site, statement and unit; quantiles of the replicates; what was measured there (NaN if
    /// nothing was), and whether it lies in the intervals.
    pub told: PredictedRow,
    /// Posterior mean of the value about which the likelihood spreads; NaN if it has none.
    pub expected: f64,
    /// Mean of replicated measurements, noise included; of a bracket, of its middle.
    pub mean: f64,
    /// Their standard deviation.
    pub sd: f64,
    /// The replicates, one of each draw, chain after chain.
    pub replicates: Vec<f64>,
}

/// What is predicted of the rows of a table that was not fitted.
#[derive(Clone, Debug)]
pub struct Forecast {
    /// In the order of the table.
    pub rows: Vec<Prediction>,
    /// Chains that the draws are from, as many of each.
    pub n_chains: usize,
    /// Name of the model.
    pub model: String,
    /// SHA-256 by role: the `table`, what the run was made from, and its draws (`unknowns`) where they were read.
    pub hashes: BTreeMap<String, String>,
}

/// How well measurements of a protocol were predicted.
#[derive(Clone, Debug, Default, PartialEq)]
struct Score {
    n: usize,
    /// In their central 90 % intervals.
    inside: usize,
    squares: f64,
    unit: String,
}

impl Score {
    fn rmse(&self) -> f64 {
        (self.squares / self.n as f64).sqrt()
    }
}

impl Prediction {
    /// Measured less predicted mean; of a bracket, its middle, of an open one its closed end.
    fn error(&self) -> f64 {
        let [lower, upper] = self.told.measured;
        let middle = match (lower.is_finite(), upper.is_finite()) {
            (true, true) => 0.5 * (lower + upper),
            (true, false) => lower,
            _ => upper,
        };
        middle - self.mean
    }
}

impl Forecast {
    /// Number of draws that every prediction is made of.
    pub fn n_draws(&self) -> usize {
        self.rows.first().map_or(0, |row| row.replicates.len())
    }

    /// Role of the table among the hashes.
    pub const TABLE: &str = "table";
    /// The files of a prediction, the record last.
    pub const FILES: [&str; 3] = ["predictions.csv", "predictions.zarr", "predictions.json"];

    /// Writes `predictions.csv`, the replicates as `predictions.zarr`, which ArviZ opens, and `predictions.json`: of
    /// which run and table they are, how well what was measured is predicted, and the hashes of the other two.
    ///
    /// # Errors
    /// [`RunError::Unwritable`], [`RunError::Write`], [`RunError::Report`].
    pub fn write(&self, out: &OutputFolder) -> Result<[&'static str; 3], RunError> {
        let new = out.begin()?;
        self.write_files(&new).map_err(|error| new.named(out, error))?;
        out.put(&new, &Self::FILES)?;
        Ok(Self::FILES)
    }

    fn write_files(&self, new: &NewFiles) -> Result<(), RunError> {
        let [table, archive, record] = Self::FILES;
        let rows = self.rows.iter().map(|p| {
            let Prediction { told: row, expected, mean, sd, .. } = p;
            Forecasted { row, expected: *expected, mean: *mean, sd: *sd }
        });
        write_forecast(&new.file(table), rows)?;
        let mut attributes = Map::new();
        attributes.insert("eplat_version".into(), json!(VERSION));
        write_zarr(&new.file(archive), &self.groups(), &attributes)?;
        let record = new.file(record);
        let told = json!({
            "eplat_version": VERSION, "model": self.model, "hashes": self.hashes,
            "n_draws": self.n_draws(), "scores": self.scores_json(),
            "files": new.seals(&[table, archive])?,
        });
        write_file(&record, |file| writeln!(file, "{told:#}")).map_err(RunError::write(&record))
    }

    /// The groups `predictions` (chain, draw, row) and `predictions_constant_data`.
    fn groups(&self) -> [Group; 2] {
        let draws = self.n_draws() / self.n_chains.max(1);
        let (mut predictions, mut constant) = (vec![], vec![]);
        for (protocol, rows) in self.by_protocol() {
            let dim = format!("{protocol}_row");
            let row = (dim.as_str(), rows.len());
            let drawn = (0..self.n_draws()).flat_map(|i| rows.iter().map(move |p| p.replicates[i]));
            let dims = [("chain", self.n_chains), ("draw", draws), row];
            let unit = &rows[0].told.unit;
            predictions.push(Variable::new(protocol, unit, &dims, drawn.collect::<Vec<f64>>()));
            let lines: Vec<i64> = rows.iter().map(|p| p.told.line as i64).collect();
            let sites: Vec<String> = rows.iter().map(|p| p.told.site.clone()).collect();
            constant.push(Variable::new(format!("{protocol}_line"), "", &[row], lines));
            constant.push(Variable::new(format!("{protocol}_site"), "", &[row], sites));
        }
        let group = |name: &str, variables| Group { name: name.into(), variables };
        [group("predictions", predictions), group("predictions_constant_data", constant)]
    }

    fn by_protocol(&self) -> BTreeMap<&str, Vec<&Prediction>> {
        let mut found: BTreeMap<&str, Vec<&Prediction>> = BTreeMap::new();
        for row in &self.rows {
            found.entry(&row.told.protocol).or_default().push(row);
        }
        found
    }

    /// How well what was measured is predicted, by protocol.
    fn scores(&self) -> BTreeMap<&str, Score> {
        let mut scores = BTreeMap::new();
        for (protocol, rows) in self.by_protocol() {
            let mut score = Score { unit: rows[0].told.unit.clone(), ..Score::default() };
            for row in rows.iter().filter(|row| row.told.is_measured()) {
                score.n += 1;
                score.inside += usize::from(row.told.fitted.is_inside());
                score.squares += row.error().powi(2);
            }
            if score.n > 0 {
                scores.insert(protocol, score);
            }
        }
        scores
    }

    /// The first rows as a table, and how well what was measured is predicted.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let titles =
            ["line", "site", "protocol", "mean", "sd", "q5", "q50", "q95", "unit", "measured"];
        let shown = self.rows.iter().take(SHOWN).map(cells);
        let lines: Vec<[String; 10]> =
            std::iter::once(titles.map(String::from)).chain(shown).collect();
        let n = |s: &String| s.chars().count();
        let width = |i: usize| lines.iter().map(|l| n(&l[i])).max().unwrap_or(0);
        let widths: Vec<usize> = (0..titles.len()).map(width).collect();
        for line in &lines {
            let mut told = String::new();
            for (i, (cell, width)) in line.iter().zip(&widths).enumerate() {
                let pad = " ".repeat(width - n(cell));
                // words to the left, numbers to the right
                let is_word = [1, 2, 8, 9].contains(&i);
                let _ = if is_word {
                    write!(told, "{cell}{pad}  ")
                } else {
                    write!(told, "{pad}{cell}  ")
                };
            }
            text += told.trim_end();
            text.push('\n');
        }
        if self.rows.len() > SHOWN {
            let _ = writeln!(text, "… and {} rows more", self.rows.len() - SHOWN);
        }
        for (protocol, score) in self.scores() {
            let (Score { n, inside, .. }, rmse) = (&score, score.rmse());
            let unit = after_number(&score.unit);
            let _ = writeln!(
                text,
                "{protocol}: {inside} of {n} measured rows in their 90 % intervals, RMSE {rmse:.3}{unit}"
            );
        }
        text
    }

    /// The same for programs.
    pub fn json(&self) -> Value {
        let row = |p: &Prediction| {
            let [q5, q50, q95] = p.told.fitted.quantiles;
            let inside = p.told.is_measured().then(|| p.told.fitted.is_inside());
            json!({
                "line": p.told.line, "site": p.told.site, "protocol": p.told.protocol,
                "unit": p.told.unit, "expected": p.expected, "mean": p.mean, "sd": p.sd,
                "q5": q5, "q50": q50, "q95": q95, "inside": inside,
            })
        };
        json!({
            "rows": self.rows.iter().map(row).collect::<Vec<Value>>(),
            "scores": self.scores_json(),
            "n_draws": self.n_draws(),
        })
    }

    fn scores_json(&self) -> Map<String, Value> {
        let score = |(protocol, s): (&str, Score)| {
            (protocol.to_owned(), json!({ "n": s.n, "inside": s.inside, "rmse": s.rmse() }))
        };
        self.scores().into_iter().map(score).collect()
    }
}

/// A row of the table of [`Forecast::text`]; numbers to a tenth of the sd.
fn cells(p: &Prediction) -> [String; 10] {
    let decimals =
        if p.sd > 0.0 { (1.0 - p.sd.log10().floor()).clamp(0.0, 9.0) as usize } else { 3 };
    let number = |x: f64| format!("{x:.decimals$}");
    let [q5, q50, q95] = p.told.fitted.quantiles.map(number);
    let PredictedRow { line, site, protocol, unit, .. } = &p.told;
    let measured = match p.told.measured {
        [lower, _] if lower.is_nan() => String::new(),
        [lower, upper] => {
            let is_bracket = upper > lower;
            let value = if is_bracket { format!("{lower} to {upper}") } else { lower.to_string() };
            format!("{value}{}", if p.told.fitted.is_inside() { "" } else { ", outside" })
        }
    };
    let unit = after_number(unit).trim().to_owned();
    let (mean, sd) = (number(p.mean), number(p.sd));
    [line.to_string(), site.clone(), protocol.clone(), mean, sd, q5, q50, q95, unit, measured]
}
