//! What a model may lack: candidate effects from the columns of a table.

use std::collections::BTreeMap;

use super::units::{FOLD, Unit, is_constant_within};
use crate::dsl::{Form, Measurements, Model, Statement, distinct, families};

impl Candidate {
    /// As it is written in a model file, with `row` for the row.
    pub fn text(&self) -> String {
        self.form.as_ref().map_or("Outliers".into(), Form::text)
    }
}

/// Where a candidate acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// On what is observed.
    Observable,
    /// On a field behind it.
    Parameter,
    /// On how far measurements scatter.
    Noise,
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
    /// How it depends on a row; `None` for outliers, which move nothing that is predicted.
    pub form: Option<Form>,
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
    let mut from = Columns { table, on, step, field_sd, unit, found: vec![] };
    let mut unusable = vec![];
    for column in covariates(model, table) {
        let name = column.as_str();
        let usable = match read_column(table, name) {
            Column::Numeric(x) => from.numbers(name, &x),
            Column::Labels(labels) => from.labels(name, &labels),
        };
        if let Err(why) = usable {
            unusable.push(Unusable { column: name.into(), why: why.into() });
        }
    }
    for observable in from.on.clone().split_off(1.min(from.on.len())) {
        from.add("protocol", Level::Observable, vec![observable], Some(Form::All), step);
    }
    let has_outliers = |s: &Statement| s.keyword == "observe" && s.decl.text.contains("Outliers(");
    if !model.statements.iter().any(has_outliers) {
        from.add("outliers", Level::Noise, vec![], None, step);
    }
    (from.found, unusable)
}

/// Candidates under construction.
struct Columns<'a> {
    table: &'a Measurements,
    /// What is observed.
    on: Vec<String>,
    step: f64,
    field_sd: &'a BTreeMap<String, f64>,
    /// The unit with a random effect.
    unit: Option<&'a Unit>,
    found: Vec<Candidate>,
}

impl Columns<'_> {
    fn add(&mut self, name: &str, level: Level, on: Vec<String>, form: Option<Form>, sd: f64) {
        let column = form.as_ref().and_then(Form::column);
        let is_over_units = column
            .zip(self.unit)
            .is_some_and(|(column, unit)| is_constant_within(self.table, column, &unit.name));
        let is_screened = level == Level::Observable && !is_over_units;
        self.found.push(Candidate { name: name.into(), on, level, form, sd, is_screened });
    }

    fn on_observables(&mut self, column: &str, form: Form) {
        self.add(&finding(column), Level::Observable, self.on.clone(), Some(form), self.step);
    }

    fn on_each_field(&mut self, name: &str, form: &Form) {
        for (field, sd) in self.field_sd {
            self.add(name, Level::Parameter, vec![field.clone()], Some(form.clone()), *sd);
        }
    }

    /// # Errors
    /// Why a column of numbers cannot be tried.
    fn numbers(&mut self, name: &str, x: &[f64]) -> Result<(), &'static str> {
        let mut values: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        let (Some(&low), Some(&high)) = (values.first(), values.last()) else {
            return Err("every cell is empty");
        };
        let (mean, sd) = moments(x);
        if !(sd > 1e-9 * mean.abs().max(1e-9)) {
            return Err("it has one value only");
        }
        let column = || name.to_owned();
        self.on_observables(name, Form::Scaled { column: column(), centre: mean, scale: sd });
        if values.len() >= 4 {
            self.on_observables(name, Form::Smooth { column: column(), low, high, degree: 3 });
        }
        if name.starts_with("dist") {
            for share in [0.2, 0.35, 0.5] {
                let at = (share * (values.len() - 1) as f64) as usize;
                let threshold = 0.5 * (values[at] + values[at + 1]);
                self.on_each_field("patch", &Form::Above { column: column(), threshold });
            }
        }
        Ok(())
    }

    /// # Errors
    /// Why a column of labels cannot be tried.
    fn labels(&mut self, name: &str, labels: &[String]) -> Result<(), &'static str> {
        if labels.len() < 2 {
            return Err("it has one value only");
        }
        if self.unit.is_some_and(|unit| unit.is_the_same_as(self.table, name)) {
            return Err(
                "it names the unit over which others vary: its labels have a random effect",
            );
        }
        if labels.len() * 2 > self.table.len() {
            return Err("nearly every row has a label of its own");
        }
        let mut forms = vec![Form::Group { column: name.into() }];
        if (2..labels.len()).contains(&families(self.table, name).len()) {
            forms.push(Form::Family { column: name.into() });
        }
        for form in forms {
            if name == "region" {
                self.on_each_field("region", &form);
            } else {
                self.on_observables(name, form);
            }
        }
        Ok(())
    }
}
