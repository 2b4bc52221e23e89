//! What a model may lack: candidate effects from the columns of a table.

use std::collections::BTreeMap;

use super::units::{FOLD, Unit, is_constant_within};
use crate::dsl::{Form, Measurements, Model, distinct, families};

/// Where a candidate acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// On what is observed.
    Observable,
    /// On a field behind it.
    Parameter,
}

/// Something that the model may lack.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// What it is called in findings: `force`, `drift`, …
    pub name: String,
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// Observable or parameter.
    pub level: Level,
    /// How it depends on a row.
    pub form: Form,
    /// Prior sd of its coefficients, in the unit of what it acts on.
    pub sd: f64,
    /// Whether residuals of sites decide if it is refitted: not on a parameter, and not over units with a
    /// random effect of their own, which leaves no such residuals over.
    pub is_screened: bool,
}

/// Columns that say where and what was measured, never why it differs.
const STRUCTURAL: [&str; 11] =
    ["site", "vertex", "x", "y", "z", "protocol", "lower", "upper", "value", "resolution", FOLD];

/// The columns of a table that may tell why measurements differ: neither place nor measurement.
pub(super) fn covariates<'t>(model: &Model, table: &'t Measurements) -> Vec<&'t String> {
    let is_measured =
        |name: &String| model.observes.iter().any(|o| o.name == name || o.cells.contains(name));
    let is_one = |name: &&String| !STRUCTURAL.contains(&name.as_str()) && !is_measured(name);
    table.columns().iter().filter(is_one).collect()
}

/// What a column is called in findings.
fn finding(column: &str) -> String {
    let known = [
        ("force_g", "force"),
        ("output_mA", "output"),
        ("t_min", "drift"),
        ("S1", "rate"),
        ("wall_mm", "wall"),
        ("dist_scar_mm", "scar_distance"),
        ("impedance_ohm", "impedance"),
        ("temperature_C", "temperature"),
    ];
    known.iter().find(|(c, _)| *c == column).map_or(column, |(_, name)| name).into()
}

/// What a column holds.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Column {
    /// Numbers: those present, one per row, NaN where empty.
    Numeric(Vec<f64>),
    /// Labels.
    Labels(Vec<String>),
}

/// Reads a column: numbers if every cell that is not empty is one.
pub(super) fn read_column(table: &Measurements, name: &str) -> Column {
    let cell = |row: usize| table.cell(row, name).unwrap_or_default();
    let number = |row: usize| {
        let cell = cell(row);
        if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() }
    };
    let numbers: Option<Vec<f64>> = (0..table.len()).map(number).collect();
    numbers.map_or_else(|| Column::Labels(distinct(table, name)), Column::Numeric)
}

/// Mean and standard deviation of the numbers that are there.
fn moments(x: &[f64]) -> (f64, f64) {
    let present: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    let n = present.len() as f64;
    let mean = present.iter().sum::<f64>() / n;
    (mean, (present.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// A covariate that cannot be tried, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unusable {
    /// The column.
    pub column: String,
    /// Why.
    pub why: String,
}

/// All candidates that a table's columns give for a model; and the columns that give none.
///
/// `observables` are what the model's `observe`s compare with their measurements, `step` the width of a
/// protocol step, `field_sd` the standard deviation of each field over the sites.
pub(super) fn candidates(
    model: &Model,
    table: &Measurements,
    observables: &[String],
    step: f64,
    field_sd: &BTreeMap<String, f64>,
    unit: Option<&Unit>,
) -> (Vec<Candidate>, Vec<Unusable>) {
    let mut on: Vec<String> = observables.to_vec();
    on.sort();
    on.dedup();
    let mut found = vec![];
    let mut unusable = vec![];
    for column in covariates(model, table) {
        let name = column.as_str();
        let mut refuse =
            |why: &str| unusable.push(Unusable { column: name.into(), why: why.into() });
        let is_over_units = unit.is_some_and(|unit| is_constant_within(table, name, &unit.name));
        let candidate = |form: Form, level, on: &[String], sd| Candidate {
            name: finding(name),
            on: on.to_vec(),
            level,
            form,
            sd,
            is_screened: level == Level::Observable && !is_over_units,
        };
        match read_column(table, name) {
            Column::Numeric(x) => {
                let (mean, sd) = moments(&x);
                if x.iter().all(|x| x.is_nan()) {
                    refuse("every cell is empty");
                    continue;
                }
                if !(sd > 1e-9 * mean.abs().max(1e-9)) {
                    refuse("it has one value only");
                    continue;
                }
                let (low, high) = x
                    .iter()
                    .filter(|x| x.is_finite())
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                        (low.min(*x), high.max(*x))
                    });
                let scaled = Form::Scaled { column: name.into(), centre: mean, scale: sd };
                found.push(candidate(scaled, Level::Observable, &on, step));
                let mut values: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
                values.sort_by(f64::total_cmp);
                values.dedup();
                if values.len() >= 4 {
                    let smooth = Form::Smooth { column: name.into(), low, high, degree: 3 };
                    found.push(candidate(smooth, Level::Observable, &on, step));
                }
                if name.starts_with("dist") {
                    for share in [0.2, 0.35, 0.5] {
                        let at = (share * (values.len() - 1) as f64) as usize;
                        let threshold = 0.5 * (values[at] + values[at + 1]);
                        for (field, sd) in field_sd {
                            let form = Form::Above { column: name.into(), threshold };
                            let mut patch =
                                candidate(form, Level::Parameter, std::slice::from_ref(field), *sd);
                            patch.name = "patch".into();
                            found.push(patch);
                        }
                    }
                }
            }
            Column::Labels(labels) => {
                if labels.len() < 2 {
                    refuse("it has one value only");
                    continue;
                }
                if unit.is_some_and(|unit| unit.is_the_same_as(table, name)) {
                    refuse(
                        "it names the unit over which others vary: its labels have a random effect",
                    );
                    continue;
                }
                if labels.len() * 2 > table.len() {
                    refuse("nearly every row has a label of its own");
                    continue;
                }
                let mut forms = vec![Form::Group { column: name.into() }];
                if (2..labels.len()).contains(&families(table, name).len()) {
                    forms.push(Form::Family { column: name.into() });
                }
                for form in forms {
                    if name != "region" {
                        found.push(candidate(form, Level::Observable, &on, step));
                        continue;
                    }
                    for (field, sd) in field_sd {
                        let on = std::slice::from_ref(field);
                        found.push(candidate(form.clone(), Level::Parameter, on, *sd));
                    }
                }
            }
        }
    }
    if on.len() > 1 {
        for observable in &on[1..] {
            found.push(Candidate {
                name: "protocol".into(),
                on: vec![observable.clone()],
                level: Level::Observable,
                form: Form::All,
                sd: step,
                is_screened: true,
            });
        }
    }
    (found, unusable)
}
