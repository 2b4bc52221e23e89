//! Leave-one-out predictive accuracy of a run: `loo.csv`, and its totals in `run.json`.

use std::io;
use std::path::Path;

use eplat_language::print;
use eplat_language::syntax::{Expr, Item};
use rayon::prelude::*;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::run_record::nan_if_null;
use super::{Columns, LeftOutBy, ReportError};
use crate::diagnostics::{Loo, LooPoint, relative_efficiency, standard_error};
use crate::model::Model;
use crate::store::write_file;
use crate::table::{Measurements, as_cell, from_cell};

/// Most measurements that are named for their Pareto k.
const MOST_NAMED: usize = 3;

/// One line of `loo.csv`: a measurement, and how well the others predict it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LooRow {
    /// Name of its `observe` statement.
    pub measurement: String,
    /// Its site or line, in words.
    pub place: String,
    /// The likelihood's name, as written in the model.
    pub likelihood: String,
    /// What was measured: one number, or the two ends of a bracket.
    pub observed: String,
    /// Log predictive density given all other measurements; NaN if it cannot be had.
    pub elpd: f64,
    /// Shape of the importance weights' tail; `inf` if it cannot be had.
    pub pareto_k: f64,
    /// How the measurement was left out for `elpd`. Pareto k is that of plain weights however it was.
    #[serde(alias = "left_out", deserialize_with = "left_out_by")]
    pub loo_by: LeftOutBy,
}

/// Totals over all measurements.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LooRecord {
    /// Expected log pointwise predictive density.
    #[serde(deserialize_with = "nan_if_null")]
    pub elpd_loo: f64,
    /// Its standard error.
    #[serde(deserialize_with = "nan_if_null")]
    pub se: f64,
    /// Effective number of parameters.
    #[serde(deserialize_with = "nan_if_null")]
    pub p_loo: f64,
    /// Number of measurements.
    pub n_measurements: usize,
    /// Pareto k above which a measurement's elpd cannot be relied on.
    pub k_threshold: f64,
    /// Number of measurements above it of which the weights are all there is.
    pub n_high_k: usize,
    /// Number of measurements above it of which the fields integrate out.
    #[serde(default)]
    pub n_integrated: usize,
    /// Number of measurements above it that were left out in a fit of their own.
    #[serde(default)]
    pub n_left_out: usize,
    /// The worst of which the weights are all there is, with their k, in words.
    pub worst: Vec<String>,
}

/// Totals and lines of a run.
#[derive(Clone, Debug)]
pub struct LeaveOneOut {
    /// For `run.json`.
    pub record: LooRecord,
    /// For `loo.csv`, in the order of the model's measurements.
    pub rows: Vec<LooRow>,
}

impl LeaveOneOut {
    /// From log likelihoods (S, measurement) of all chains' draws; `None` if nothing was measured.
    ///
    /// `ess_mean` has every parameter's effective sample size for the mean; one thread reads at least `at_once`
    /// measurements.
    ///
    /// # Errors
    /// From the disk that the log likelihoods are on.
    pub(super) fn new(
        model: &Model,
        data: &Measurements,
        log_likelihood: &Columns,
        (ess_mean, at_once): (&[f64], usize),
        [n_chains, n_draws]: [usize; 2],
    ) -> io::Result<Option<Self>> {
        let n = model.measured().map(|(_, rows)| rows.len()).sum();
        if n == 0 {
            return Ok(None);
        }
        let r_eff = relative_efficiency(ess_mean, n_chains, n_draws);
        let point = |i| log_likelihood.column(i).map(|column| LooPoint::of(&column, r_eff));
        let points: io::Result<Vec<_>> =
            (0..n).into_par_iter().with_min_len(at_once).map(point).collect();
        let loo = Loo::of(&points?, log_likelihood.n_draws());
        let rows = rows(model, data, &loo);
        Ok(Some(Self { record: record(&loo, &rows), rows }))
    }

    /// Puts a log predictive density of measurement `i` in the place of that from importance weights.
    pub fn set(&mut self, i: usize, elpd: f64, by: LeftOutBy) {
        let row = &mut self.rows[i];
        let better = elpd - row.elpd;
        (row.elpd, row.loo_by) = (elpd, by);
        let elpd_of: Vec<f64> = self.rows.iter().map(|row| row.elpd).collect();
        let record = &mut self.record;
        record.elpd_loo = elpd_of.iter().sum();
        record.se = standard_error(&elpd_of);
        record.p_loo -= better;
        let count = |by| self.rows.iter().filter(|row| row.loo_by == by).count();
        record.n_integrated = count(LeftOutBy::Integrated);
        record.n_left_out = count(LeftOutBy::Fit);
        record.n_high_k = self.rows.iter().filter(|row| row.is_untold(record.k_threshold)).count();
        record.worst = worst_k(&self.rows, record.k_threshold);
    }
}

impl LooRow {
    /// The measurement in words.
    pub fn name(&self) -> String {
        format!("{} {}", self.measurement, self.place)
    }

    /// Whether its Pareto k is too high for weights, and these are all there is.
    pub(super) fn is_untold(&self, threshold: f64) -> bool {
        self.pareto_k > threshold && self.loo_by == LeftOutBy::Weights
    }
}

/// A name of [`LeftOutBy`], or, of a version that knew only fits, whether it was one.
fn left_out_by<'de, D: Deserializer<'de>>(cell: D) -> Result<LeftOutBy, D::Error> {
    let name = String::deserialize(cell)?;
    match name.as_str() {
        "true" => Ok(LeftOutBy::Fit),
        "false" => Ok(LeftOutBy::Weights),
        name => LeftOutBy::named(name)
            .ok_or_else(|| D::Error::custom(format!("`{name}` is no way of leaving out"))),
    }
}

/// The worst of the measurements whose k is above `threshold` and of which weights are all there is, with their
/// k, in words.
pub fn worst_k(rows: &[LooRow], threshold: f64) -> Vec<String> {
    let mut high: Vec<&LooRow> = rows.iter().filter(|row| row.is_untold(threshold)).collect();
    high.sort_by(|a, b| b.pareto_k.total_cmp(&a.pareto_k));
    let words = |row: &&LooRow| format!("{} ({:.2})", row.name(), row.pareto_k);
    high.iter().take(MOST_NAMED).map(words).collect()
}

fn rows(model: &Model, data: &Measurements, loo: &Loo) -> Vec<LooRow> {
    let mut measured = model.observed().zip(&loo.pointwise);
    let mut out = vec![];
    for (name, rows) in model.measured() {
        let likelihood = likelihood_of(model, name);
        for (row, (observed, point)) in rows.iter().zip(measured.by_ref()) {
            out.push(LooRow {
                measurement: name.to_owned(),
                place: data.place(*row),
                likelihood: likelihood.clone(),
                observed: observed.iter().map(f64::to_string).collect::<Vec<_>>().join(" "),
                elpd: point.elpd,
                pareto_k: point.pareto_k,
                loo_by: LeftOutBy::Weights,
            });
        }
    }
    out
}

/// `TopHat` of `Bracket ~ TopHat(erp_s2(x))`, `garch` of `garch(mu, alpha, data.y)`.
fn likelihood_of(model: &Model, name: &str) -> String {
    let Ok(tree) = model.syntax() else { return String::new() };
    let expr = tree.statements.iter().find_map(|statement| match &statement.item {
        Item::Observe(observe) if observe.name == name => Some(&observe.likelihood),
        Item::Density(density) if density.name == name => Some(&density.expr),
        _ => None,
    });
    let function = |expr: &Expr| match expr {
        Expr::Call(call) => print(&call.func),
        other => print(other),
    };
    expr.map_or(String::new(), function)
}

fn record(loo: &Loo, rows: &[LooRow]) -> LooRecord {
    LooRecord {
        elpd_loo: loo.elpd,
        se: loo.se,
        p_loo: loo.p_loo,
        n_measurements: rows.len(),
        k_threshold: loo.k_threshold,
        n_high_k: rows.iter().filter(|row| row.is_untold(loo.k_threshold)).count(),
        n_integrated: 0,
        n_left_out: 0,
        worst: worst_k(rows, loo.k_threshold),
    }
}

/// Writes `loo.csv`, one line per measurement.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_loo(path: &Path, rows: &[LooRow]) -> Result<(), ReportError> {
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        let safe = |row: &LooRow| LooRow { place: as_cell(&row.place), ..row.clone() };
        rows.iter().try_for_each(|row| table.serialize(safe(row)))?;
        table.flush()
    })
    .map_err(ReportError::write(path))
}

/// Reads what [`write_loo`] wrote.
///
/// # Errors
/// [`ReportError::Read`] and [`ReportError::Malformed`].
pub fn read_loo(path: &Path) -> Result<Vec<LooRow>, ReportError> {
    let file = std::fs::File::open(path).map_err(ReportError::read(path))?;
    let given = |row: LooRow| LooRow { place: from_cell(&row.place).to_owned(), ..row };
    let rows = csv::Reader::from_reader(file).into_deserialize().map(|row| row.map(given));
    rows.collect::<Result<_, csv::Error>>().map_err(|error| ReportError::Malformed {
        path: path.to_owned(),
        reason: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn the_table_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("loo.csv");
        let mut rows = vec![samples::loo_row("s1s2", 1, -2.5), samples::loo_row("s1s2", 2, -0.25)];
        (rows[1].pareto_k, rows[1].loo_by) = (f64::INFINITY, LeftOutBy::Integrated);
        write_loo(&path, &rows).unwrap();
        insta::assert_snapshot!(std::fs::read_to_string(&path).unwrap(), @r"
        measurement,place,likelihood,observed,elpd,pareto_k,loo_by
        s1s2,at site 1,TopHat,240 250,-2.5,0.5,weights
        s1s2,at site 2,TopHat,240 250,-0.25,inf,integrated
        ");
        assert_eq!(format!("{:?}", read_loo(&path).unwrap()), format!("{rows:?}"));
        assert!(worst_k(&rows, 0.7).is_empty());
        rows[1].loo_by = LeftOutBy::Weights;
        assert_eq!(worst_k(&rows, 0.7), ["s1s2 at site 2 (inf)"]);
    }

    /// It told only whether a measurement was left out in a fit.
    #[test]
    fn a_table_of_an_earlier_version_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("loo.csv");
        let header = "measurement,place,likelihood,observed,elpd,pareto_k,left_out";
        std::fs::write(&path, format!("{header}\ns,p,l,1,-1,0.5,true\ns,p,l,1,-1,0.5,false\n"))
            .unwrap();
        let by: Vec<LeftOutBy> = read_loo(&path).unwrap().iter().map(|row| row.loo_by).collect();
        assert_eq!(by, [LeftOutBy::Fit, LeftOutBy::Weights]);
    }

    #[test]
    fn an_edited_table_is_named_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("loo.csv");
        let header = "measurement,place,likelihood,observed,elpd,pareto_k,loo_by";
        std::fs::write(&path, format!("{header}\ns1s2,at site 1,TopHat,1,ten,0.5,fit\n")).unwrap();
        let text = read_loo(&path).unwrap_err().to_string();
        assert!(text.contains("loo.csv") && text.contains("line: 2"), "{text}");
    }
}
