//! Which effects are tried: candidates from the columns of a table.

use std::collections::BTreeMap;

use eplat_language::as_name;

use super::candidate::{Candidate, Level, Screen, Unusable};
use super::cause::Cause;
use super::observable::{readable, readable_to};
use super::units::{Unit, by_site, is_constant_within};
use crate::model::forms::{
    above, all, families, family, group, path, saturating, scaled, scaled_by, smooth, surface,
};
use crate::model::{Form, Model};
use crate::table::{FIELD_MODES, Measurements, Role, TypedColumn};

/// The columns of a table that may tell why measurements differ: neither place nor measurement.
pub(super) fn covariates<'t>(model: &Model, table: &'t Measurements) -> Vec<&'t String> {
    let is_measured = |name: &String| {
        let name = as_name(name);
        model.observes.iter().any(|o| o.name == name || o.cells.contains(&name))
    };
    let is_one = |name: &&String| table.role(name).is_cause() && !is_measured(name);
    table.columns().iter().filter(is_one).collect()
}

/// Mean and standard deviation of the numbers that are there.
pub(super) fn mean_and_sd(x: &[f64]) -> (f64, f64) {
    let present: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    let n = present.len() as f64;
    let mean = present.iter().sum::<f64>() / n;
    (mean, (present.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// Shares of the table's distances that may be inside a patch.
const INSIDE: [f64; 12] = [0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.275, 0.3, 0.35, 0.4, 0.5];
/// A positive number of which the greatest is so many times the least may act the less, the more there is.
const CURVED: f64 = 1.5;
/// Most kinds of regions in each of which an effect of a number may differ.
const MOST_REGIONS: usize = 5;
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
        let columns = covariates(self.model, self.table);
        for column in columns.into_iter().filter_map(|name| self.table.column(name)) {
            match self.of_column(column) {
                Ok(candidates) => found.extend(candidates),
                Err(why) => {
                    unusable.push(Unusable { column: column.name().into(), why: why.into() });
                }
            }
        }
        for observable in self.on.iter().skip(1) {
            let on = std::slice::from_ref(observable);
            found.push(self.candidate(Cause::Protocol, all(), on));
        }
        found.extend(self.fields());
        found.extend(self.outliers());
        (found, unusable)
    }

    /// Outliers, unless the model knows them.
    fn outliers(&self) -> Option<Candidate> {
        (!knows_outliers(self.model)).then(|| Candidate {
            cause: Cause::Outliers,
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
            let field = surface(modes as f64, lengthscale);
            found.extend(self.field(&Cause::SpatialField, &field, self.step));
            if let Some(length) = probes.mean_length() {
                let field = path(modes as f64, lengthscale);
                found.extend(self.field(&Cause::SlownessField, &field, self.step / length));
            }
        }
        found
    }

    /// A field of each of [`AMPLITUDES`] times `sd`.
    fn field(&self, cause: &Cause, form: &Form, sd: f64) -> impl Iterator<Item = Candidate> {
        AMPLITUDES.into_iter().map(move |times| Candidate {
            sd: readable(times * sd),
            screen: Screen::None,
            ..self.candidate(cause.clone(), form.clone(), &self.on)
        })
    }

    /// The candidates of a column, or why there are none.
    fn of_column(&self, column: &TypedColumn) -> Result<Vec<Candidate>, &'static str> {
        let read = self.table.column(column.read_as());
        if read.is_none_or(|read| read.name() != column.name()) {
            return Err(
                "without its signs, which a model file cannot hold, its name means something else: rename it",
            );
        }
        if self.unit.is_some_and(|unit| unit.name == column.name()) {
            return Err("it names the units over which others vary: these have a random effect");
        }
        match column.numbers() {
            Some(x) => self.of_numbers(column.name(), x),
            None => self.of_labels(column.name(), &column.labels()),
        }
    }

    /// An effect on what is observed.
    fn candidate(&self, cause: Cause, form: Form, on: &[String]) -> Candidate {
        let is_over = |unit: &Unit| {
            form.column().is_some_and(|column| is_constant_within(self.table, column, &unit.name))
        };
        let is_over_units = self.unit.is_some_and(is_over);
        Candidate {
            cause,
            on: on.to_vec(),
            level: Level::Observable,
            form: Some(form),
            sd: self.step,
            screen: if is_over_units { Screen::Units } else { Screen::Sites },
        }
    }

    /// An effect of tissue: on each field, and on what is observed, where several fields change at once.
    fn everywhere(&self, cause: &Cause, form: &Form) -> impl Iterator<Item = Candidate> {
        let candidate = |on: &[String]| self.candidate(cause.clone(), form.clone(), on);
        let on_field = |(field, sd): (&String, &f64)| Candidate {
            level: Level::Parameter,
            sd: *sd,
            ..candidate(std::slice::from_ref(field))
        };
        let on_fields: Vec<Candidate> = self.field_sd.iter().map(on_field).collect();
        let all = on_fields.into_iter().chain([candidate(&self.on)]);
        all.map(|candidate| Candidate { screen: Screen::None, ..candidate })
    }

    /// Scatter that goes with a column.
    fn scatter(&self, name: &str, form: Form) -> Candidate {
        let cause = Cause::Hetero(name.to_owned());
        let (level, screen) = (Level::Noise, Screen::Scatter);
        Candidate { level, screen, ..self.candidate(cause, form, &[]) }
    }

    /// Columns of regions in which an effect may differ.
    fn regions(&self) -> impl Iterator<Item = &String> {
        let is_region = |name: &&String| self.table.role(name) == Role::Region;
        let is_few =
            |name: &&String| (2..=MOST_REGIONS).contains(&families(self.table, name).len());
        self.table.columns().iter().filter(is_region).filter(is_few)
    }

    fn of_numbers(&self, name: &str, x: &[f64]) -> Result<Vec<Candidate>, &'static str> {
        let mut values: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let (Some(&low), Some(&high)) = (values.first(), values.last()) else {
            return Err("every cell is empty");
        };
        let (centre, scale) = mean_and_sd(x);
        if !(scale > 1e-9 * centre.abs().max(1e-9)) {
            return Err("it has one value only");
        }
        let (centre, scale) = (readable_to(centre, scale), readable(scale));
        let mut forms = vec![scaled(name, centre, scale)];
        values.dedup();
        if values.len() >= 4 {
            forms.push(smooth(name, low, high, 3.0));
        }
        forms.extend(self.regions().map(|region| scaled_by(name, region, centre, scale)));
        let mut found = self.on_observable(name, forms);
        if low > 0.0 && high > CURVED * low {
            found.push(self.saturating(name, x, readable_to(values[values.len() / 2], scale)));
        }
        found.push(self.scatter(name, scaled(name, centre, scale)));
        if self.table.role(name) == Role::Distance {
            for share in INSIDE {
                let at = (share * (values.len() - 1) as f64) as usize;
                let threshold = 0.5 * (values[at] + values[at + 1]);
                found.extend(self.everywhere(&Cause::Patch, &above(name, threshold)));
            }
        }
        Ok(found)
    }

    /// An effect of a positive number that grows less and less, of one step per standard deviation.
    fn saturating(&self, name: &str, x: &[f64], centre: f64) -> Candidate {
        let form = saturating(name, centre);
        let design = form.design(self.table).0.into_iter().zip(x);
        let present: Vec<f64> = design.filter(|(_, x)| x.is_finite()).map(|(z, _)| z).collect();
        let sd = mean_and_sd(&present).1;
        let cause = Cause::Column(name.to_owned());
        Candidate { sd: readable(self.step / sd), ..self.candidate(cause, form, &self.on) }
    }

    /// Effects of a column on what is observed.
    fn on_observable(&self, name: &str, forms: Vec<Form>) -> Vec<Candidate> {
        let cause = || Cause::Column(name.to_owned());
        forms.into_iter().map(|form| self.candidate(cause(), form, &self.on)).collect()
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
        let mut forms = vec![group(name)];
        if (2..labels.len()).contains(&families(self.table, name).len()) {
            forms.push(family(name));
        }
        if self.table.role(name) == Role::Region {
            let cause = Cause::Column(name.to_owned());
            let effects = forms.iter().flat_map(|form| self.everywhere(&cause, form));
            return Ok(effects.chain([self.scatter(name, group(name))]).collect());
        }
        let mut found = self.on_observable(name, forms);
        found.push(self.scatter(name, group(name)));
        Ok(found)
    }
}

/// Whether a likelihood of the model has outliers already.
fn knows_outliers(model: &Model) -> bool {
    model.syntax().is_ok_and(|tree| tree.has_outliers())
}
