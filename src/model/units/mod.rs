//! A statement's name, unit and text, and whether the units of a model agree.

use std::collections::BTreeMap;

use super::error::ModelError;
use super::model::{Model, Statement};
use expression::{Known, Names, Wanted, check};
use unit::Unit;

mod expression;
mod unit;

/// A statement's name, unit and text, for tables and for `eplat show`.
#[derive(Clone, Copy, Debug)]
pub struct Decl {
    /// Declared name.
    pub name: &'static str,
    /// What stands in round brackets after it: a row's name, a length or a column; empty if nothing.
    pub over: &'static str,
    /// Declared unit, empty if none.
    pub unit: &'static str,
    /// The rest of the statement, as the compiler prints its tokens.
    pub text: &'static str,
    /// The doc comment above the statement.
    pub doc: &'static str,
}

/// Checks every statement's expression, as far as the units of what it mentions are declared.
pub(super) fn check_units(model: &Model) -> Result<(), ModelError> {
    let mut units = Units::of(model);
    for statement in &model.statements {
        let Decl { name, unit, text, .. } = statement.decl;
        let declared = Unit::parse(unit);
        match statement.keyword {
            "let" => {
                let known = check_let(&units, statement, declared)?;
                units.names.insert(name.into(), declared.or(known.unit()));
            }
            "observe" => {
                let (kind, likelihood) = text.split_once('~').unwrap_or(("", text));
                if let Some((_, from)) = kind.split_once("from") {
                    units.check(statement, from, wanted(declared, "as declared").as_ref())?;
                }
                units.check(
                    statement,
                    likelihood,
                    wanted(declared, "like the measurement").as_ref(),
                )?;
            }
            "param" => {
                units.check(
                    statement,
                    text,
                    wanted(declared, &format!("like `{name}`")).as_ref(),
                )?;
            }
            "field" => check_field(model, &units, statement, declared)?,
            "effect" => check_effect(&units, statement, declared)?,
            "density" => {
                units.check(statement, text, None)?;
            }
            _ => {}
        }
    }
    Ok(())
}

fn wanted(unit: Option<Unit>, why: &str) -> Option<Wanted> {
    unit.map(|unit| Wanted { unit, why: why.into() })
}

/// `expression`, or `linear(row.a, row.b; beta)`: each column times its coefficient.
fn check_let(
    units: &Units<'_>,
    statement: &Statement,
    declared: Option<Unit>,
) -> Result<Known, ModelError> {
    let text = statement.decl.text;
    let wanted = wanted(declared, "as declared");
    let linear = text.split_once('(').zip(text.split_once(';'));
    let Some((("linear" | "linear ", columns), (_, beta))) = linear else {
        return units.check(statement, text, wanted.as_ref());
    };
    let mut known = Known::Nothing;
    let columns = columns.split(';').next().unwrap_or_default();
    for column in columns.split(',') {
        let product = format!("{} * {column}", beta.trim_end_matches([')', ' ']));
        known = units.check(statement, &product, wanted.as_ref())?;
    }
    Ok(known)
}

/// Mean, amplitudes and kernels, and the priors of the hyperparameters.
fn check_field(
    model: &Model,
    units: &Units<'_>,
    statement: &Statement,
    declared: Option<Unit>,
) -> Result<(), ModelError> {
    let Decl { name: field, text, .. } = statement.decl;
    let units = Units { field: Some(field), ..units.clone() };
    units.check(statement, text, wanted(declared, "as declared").as_ref())?;
    for p in &model.parameters {
        if let Some(name) = p.name.strip_prefix(&format!("{field}.")) {
            let unit = Unit::parse(&p.unit);
            units.check(statement, &p.prior, wanted(unit, &format!("like `{name}`")).as_ref())?;
        }
    }
    Ok(())
}

/// An effect is added to its targets.
fn check_effect(
    units: &Units<'_>,
    statement: &Statement,
    declared: Option<Unit>,
) -> Result<(), ModelError> {
    let Some((on, prior)) = statement.decl.text.split_once('~') else { return Ok(()) };
    let targets = on.split('=').next().unwrap_or_default().trim_start_matches("on ");
    for target in targets.split(',') {
        units.check(statement, target, wanted(declared, "like the effect").as_ref())?;
    }
    units.check(statement, prior, None)?;
    Ok(())
}

/// The units of a model's names.
#[derive(Clone)]
struct Units<'a> {
    /// Of parameters, fields and `let`s; `field.name` of hyperparameters.
    names: BTreeMap<String, Option<Unit>>,
    columns: BTreeMap<&'a str, Option<Unit>>,
    /// The field whose hyperparameters are in sight.
    field: Option<&'a str>,
}

impl<'a> Units<'a> {
    fn of(model: &'a Model) -> Self {
        let mut names = BTreeMap::new();
        for p in &model.parameters {
            names.insert(p.name.clone(), Unit::parse(&p.unit));
        }
        let mut columns = BTreeMap::new();
        for statement in &model.statements {
            let (name, unit) = (statement.decl.name, Unit::parse(statement.decl.unit));
            match statement.keyword {
                "column" => drop(columns.insert(name, unit)),
                "field" | "let" => drop(names.insert(name.into(), unit)),
                _ => {}
            }
        }
        Self { names, columns, field: None }
    }

    /// What is known of an expression of a statement.
    fn check(
        &self,
        statement: &Statement,
        text: &str,
        wanted: Option<&Wanted>,
    ) -> Result<Known, ModelError> {
        let Ok(parsed) = syn::parse_str(text) else { return Ok(Known::Nothing) };
        check(&parsed, wanted, self).map_err(|mismatch| ModelError::Unit {
            statement: format!("{} {}", statement.keyword, statement.decl.name),
            expression: mismatch.expression,
            expected: mismatch.expected,
            got: mismatch.got,
        })
    }
}

impl Names for Units<'_> {
    fn name(&self, name: &str) -> Option<Unit> {
        let of_field = self.field.and_then(|field| self.names.get(&format!("{field}.{name}")));
        *of_field.or_else(|| self.names.get(name))?
    }

    fn column(&self, name: &str) -> Option<Unit> {
        *self.columns.get(name)?
    }
}

#[cfg(test)]
mod tests;
