//! What a model may lack: candidate effects from the columns of a table.

use std::collections::BTreeMap;

use super::observable::{has_outliers, readable};
use super::units::{FOLD, Unit, by_site, is_constant_within};
use crate::model::{Form, Model, Statement, distinct, families};
use crate::table::{FIELD_MODES, Measurements, PATH, SOURCE};

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

/// What decides whether a candidate is refitted: an F-test on its design of
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Screen {
    /// the residuals of sites.
    Sites,
    /// the random effects of units, which leave no such residuals over.
    Units,
    /// nothing: it always is.
    None,
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
    /// What decides whether it is refitted.
    pub screen: Screen,
}

/// Columns that say where and what was measured, never why it differs.
pub(super) const STRUCTURAL: [&str; 13] = [
    SOURCE,
    PATH,
    "site",
    "vertex",
    "x",
    "y",
    "z",
    "protocol",
    "lower",
    "upper",
    "value",
    "resolution",
    FOLD,
];

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
pub(super) fn moments(x: &[f64]) -> (f64, f64) {
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

/// Shares of the table's distances that may be inside a patch.
const INSIDE: [f64; 12] = [0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.275, 0.3, 0.35, 0.4, 0.5];
/// Sites for each mode of a field that is tried, and its fewest modes.
const SITES_PER_MODE: usize = 8;
const LEAST_MODES: usize = 24;
/// Lengthscales of fields that are tried, in units of the finest that their modes resolve.
const LENGTHSCALES: [f64; 3] = [1.0, 2.0, 4.0];
/// Their amplitudes, in protocol steps.
const AMPLITUDES: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

/// What candidates are made of.
pub(super) struct Maker<'a> {
    pub(super) model: &'a Model,
    pub(super) table: &'a Measurements,
    /// What the model's `observe`s compare with their measurements, each once.
    pub(super) on: Vec<String>,
    /// Width of a protocol step.
    pub(super) step: f64,
    /// Change of each field that moves what is observed by a step.
    pub(super) field_sd: BTreeMap<String, f64>,
    /// The unit with a random effect.
    pub(super) unit: Option<&'a Unit>,
}

impl Maker<'_> {
    /// All candidates that the table's columns give; and the columns that give none.
    pub(super) fn all(&self) -> (Vec<Candidate>, Vec<Unusable>) {
        let (mut found, mut unusable) = (vec![], vec![]);
        for name in covariates(self.model, self.table) {
            match self.of_column(name) {
                Ok(candidates) => found.extend(candidates),
                Err(why) => unusable.push(Unusable { column: name.into(), why: why.into() }),
            }
        }
        for observable in self.on.iter().skip(1) {
            let on = std::slice::from_ref(observable);
            let mut offset = self.candidate("protocol", Form::All, on);
            offset.screen = Screen::Sites;
            found.push(offset);
        }
        found.extend(self.fields());
        found.extend(self.outliers());
        (found, unusable)
    }

    /// Outliers, unless the model knows them.
    fn outliers(&self) -> Option<Candidate> {
        let has = |s: &Statement| s.keyword == "observe" && has_outliers(s.decl.text);
        (!self.model.statements.iter().any(has)).then(|| Candidate {
            name: "outliers".into(),
            on: vec![],
            level: Level::Noise,
            form: None,
            sd: self.step,
            screen: Screen::None,
        })
    }

    /// For a model without fields on a surface: a field of what is observed and, where there are paths, one
    /// along them, each with three lengthscales from what the modes resolve and four amplitudes.
    fn fields(&self) -> Vec<Candidate> {
        let Some(probes) = self.table.probes().filter(|_| self.model.field_names().is_empty())
        else {
            return vec![];
        };
        let resolved = by_site(self.table).n / SITES_PER_MODE;
        let modes = resolved.clamp(LEAST_MODES, FIELD_MODES).min(probes.n_modes());
        let finest = std::f64::consts::FRAC_PI_2 / probes.frequency(modes);
        let mut found = vec![];
        for lengthscale in LENGTHSCALES.map(|times| (times * finest).round()) {
            let surface = Form::Surface { modes, lengthscale };
            found.extend(self.field("spatial_field", &surface, self.step));
            if let Some(length) = probes.mean_length() {
                let path = Form::Path { modes, lengthscale };
                found.extend(self.field("slowness_field", &path, self.step / length));
            }
        }
        found
    }

    /// A field of each of [`AMPLITUDES`] times `sd`.
    fn field(&self, name: &str, form: &Form, sd: f64) -> impl Iterator<Item = Candidate> {
        AMPLITUDES.into_iter().map(move |times| Candidate {
            name: name.into(),
            sd: readable(times * sd),
            screen: Screen::None,
            ..self.candidate(name, form.clone(), &self.on)
        })
    }

    /// The candidates of a column, or why there are none.
    fn of_column(&self, name: &str) -> Result<Vec<Candidate>, &'static str> {
        let unit = self.unit.filter(|unit| unit.name == name);
        match read_column(self.table, name) {
            _ if unit.is_some() => {
                Err("it names the units over which others vary: these have a random effect")
            }
            Column::Numeric(x) => self.of_numbers(name, &x),
            Column::Labels(labels) => self.of_labels(name, &labels),
        }
    }

    /// An effect on what is observed.
    fn candidate(&self, column: &str, form: Form, on: &[String]) -> Candidate {
        let is_over_units =
            self.unit.is_some_and(|unit| is_constant_within(self.table, column, &unit.name));
        Candidate {
            name: finding(column),
            on: on.to_vec(),
            level: Level::Observable,
            form: Some(form),
            sd: self.step,
            screen: if is_over_units { Screen::Units } else { Screen::Sites },
        }
    }

    /// An effect of tissue: on each field, and on what is observed, where several fields change at once.
    fn everywhere(&self, column: &str, form: &Form) -> impl Iterator<Item = Candidate> {
        let on_field = move |(field, sd): (&String, &f64)| Candidate {
            level: Level::Parameter,
            sd: *sd,
            ..self.candidate(column, form.clone(), std::slice::from_ref(field))
        };
        let on_observable = self.candidate(column, form.clone(), &self.on);
        let all = self.field_sd.iter().map(on_field).chain([on_observable]);
        all.map(|candidate| Candidate { screen: Screen::None, ..candidate })
    }

    fn of_numbers(&self, name: &str, x: &[f64]) -> Result<Vec<Candidate>, &'static str> {
        let mut values: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let (Some(&low), Some(&high)) = (values.first(), values.last()) else {
            return Err("every cell is empty");
        };
        let (centre, scale) = moments(x);
        if !(scale > 1e-9 * centre.abs().max(1e-9)) {
            return Err("it has one value only");
        }
        let column = || name.to_owned();
        let mut forms = vec![Form::Scaled { column: column(), centre, scale }];
        values.dedup();
        if values.len() >= 4 {
            forms.push(Form::Smooth { column: column(), low, high, degree: 3 });
        }
        let mut found: Vec<Candidate> =
            forms.into_iter().map(|form| self.candidate(name, form, &self.on)).collect();
        if name.starts_with("dist") {
            for share in INSIDE {
                let at = (share * (values.len() - 1) as f64) as usize;
                let threshold = 0.5 * (values[at] + values[at + 1]);
                let form = Form::Above { column: column(), threshold };
                let patches = self.everywhere(name, &form);
                found.extend(patches.map(|patch| Candidate { name: "patch".into(), ..patch }));
            }
        }
        Ok(found)
    }

    fn of_labels(&self, name: &str, labels: &[String]) -> Result<Vec<Candidate>, &'static str> {
        if labels.len() < 2 {
            return Err("it has one value only");
        }
        if self.unit.is_some_and(|unit| unit.is_the_same_as(self.table, name)) {
            return Err("it names the units over which others vary: these have a random effect");
        }
        if labels.len() * 2 > self.table.len() {
            return Err("nearly every row has a label of its own");
        }
        let mut forms = vec![Form::Group { column: name.into() }];
        if (2..labels.len()).contains(&families(self.table, name).len()) {
            forms.push(Form::Family { column: name.into() });
        }
        if name == "region" {
            return Ok(forms.iter().flat_map(|form| self.everywhere(name, form)).collect());
        }
        Ok(forms.into_iter().map(|form| self.candidate(name, form, &self.on)).collect())
    }
}
