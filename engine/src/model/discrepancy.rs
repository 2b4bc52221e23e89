//! A discrepancy: what measurements differ by for reasons that no column tells. It is added as
//! statements that the model lacks.

use eplat_language::FurtherError;

use super::forms::Form;
use super::functions::Decl;

/// A random difference between the labels of a column, whose size is learnt:
/// `param SD [unit] ~ HalfNormal(…); effect NAME on … [unit] = group(row.COLUMN) ~ Normal(0.0, SD);`
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Name of the effect.
    pub name: String,
    /// Name of the parameter that is its sd.
    pub sd: String,
    /// Sd of the half-normal prior of that.
    pub prior_sd: f64,
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// Their unit, empty if none.
    pub unit: String,
    /// The group of the column.
    pub form: Form,
    /// Why it is there, a sentence.
    pub why: String,
}

/// A further normal error of every measurement of some `observe`s, whose size is learnt:
/// `param NAME [unit] ~ HalfNormal(…);` and `Widened(…, NAME)`.
#[derive(Clone, Debug, PartialEq)]
pub struct RowError {
    /// Name of the parameter that is its sd.
    pub name: String,
    /// Sd of the half-normal prior of that.
    pub prior_sd: f64,
    /// Unit of what is measured, empty if none.
    pub unit: String,
    /// The `observe`s.
    pub observes: Vec<String>,
    /// The name of a `let` of the row that is added too: ln of a factor of the sd, 0 but for the
    /// effects on it. Then the likelihood is `Widened(…, NAME * SCATTER(row).exp())`.
    pub scatter: Option<String>,
    /// Why it is there, a sentence.
    pub why: String,
}

/// Everything that measurements differ by for reasons that no column tells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Discrepancy {
    /// Differences of sites, recordings or sessions.
    pub spreads: Vec<Spread>,
    /// Further errors of single measurements.
    pub row_errors: Vec<RowError>,
}

impl Spread {
    /// The effect's name, unit and prior.
    pub(super) fn decl(&self) -> Decl {
        let (name, unit) = (self.name.clone().into(), self.unit.clone().into());
        Decl { name, unit, text: format!("Normal(0.0, {})", self.sd).into() }
    }

    /// The two statements.
    pub fn statements(&self) -> [String; 2] {
        let Self { name, sd, form, .. } = self;
        let (on, unit) = (self.on.join(", "), in_brackets(&self.unit));
        [
            format!("param {sd}{unit} ~ HalfNormal({:?});", self.prior_sd),
            format!("effect {name} on {on}{unit} = {} ~ Normal(0.0, {sd});", form.text()),
        ]
    }
}

impl RowError {
    /// The parameter.
    pub fn statement(&self) -> String {
        let unit = in_brackets(&self.unit);
        format!("param {}{unit} ~ HalfNormal({:?});", self.name, self.prior_sd)
    }

    /// The `observe`s, each with its further error.
    pub fn of_observes(&self) -> impl Iterator<Item = FurtherError> {
        self.observes.iter().map(|observe| FurtherError {
            observe: observe.clone(),
            sd: self.name.clone(),
            scatter: self.scatter.clone(),
        })
    }
}

impl Discrepancy {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.spreads.is_empty() && self.row_errors.is_empty()
    }

    /// The statements of the factors of further errors.
    pub fn scatter(&self) -> Vec<String> {
        let names = self.row_errors.iter().filter_map(|error| error.scatter.as_deref());
        let mut names: Vec<&str> = names.collect();
        names.dedup();
        names.into_iter().map(|name| format!("let {name}(row) = 0.0;")).collect()
    }

    /// All its statements.
    pub fn statements(&self) -> Vec<String> {
        let errors = self.row_errors.iter().map(RowError::statement);
        errors
            .chain(self.scatter())
            .chain(self.spreads.iter().flat_map(Spread::statements))
            .collect()
    }
}

fn in_brackets(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" [{unit}]") }
}
