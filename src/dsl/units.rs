//! A statement's name, unit and text, and whether units agree.

use super::error::ModelError;
use super::model::Model;

/// A statement's name, unit and text, for tables and for `eplat show`.
#[derive(Clone, Copy, Debug)]
pub struct Decl {
    /// Declared name.
    pub name: &'static str,
    /// Declared unit, empty if none.
    pub unit: &'static str,
    /// The rest of the statement, as the compiler prints its tokens.
    pub text: &'static str,
    /// The doc comment above the statement.
    pub doc: &'static str,
}

/// Checks what the declared strings say about each other: a field's mean and amplitudes have its
/// unit, its kernels' arguments are lengths in mm, a likelihood's plain arguments have the
/// measurement's unit. Compound expressions are left alone.
pub(super) fn check_units(model: &Model) -> Result<(), ModelError> {
    for statement in &model.statements {
        let unit = statement.decl.unit;
        match statement.keyword {
            "field" => check_field(model, statement.decl.name, unit, statement.decl.text)?,
            "observe" => check_observe(model, statement.decl.name, unit, statement.decl.text)?,
            _ => {}
        }
    }
    Ok(())
}

fn check_field(model: &Model, field: &str, unit: &str, text: &str) -> Result<(), ModelError> {
    let hyper = |name: &str| {
        let full = format!("{field}.{name}");
        model.parameters.iter().find(|p| p.name == full).map(|p| p.unit.as_str())
    };
    // outside brackets stand the mean, the amplitudes and `gp`; inside `gp(…)` the kernels
    let mut is_kernel = false;
    let mut depth = 0;
    for token in tokens(text) {
        match token {
            "gp" => is_kernel = true,
            "(" => depth += 1,
            ")" => depth -= 1,
            _ => {}
        }
        is_kernel &= depth > 0 || token == "gp";
        let expected = match (is_kernel, depth) {
            (true, _) => "mm",
            (false, 0) => unit,
            _ => continue,
        };
        if let Some(got) = hyper(token) {
            require(&format!("field {field}: {token}"), expected, got)?;
        }
    }
    Ok(())
}

fn check_observe(model: &Model, name: &str, unit: &str, text: &str) -> Result<(), ModelError> {
    let likelihood = text.split_once('~').map_or(text, |(_, l)| l);
    let Some((family, arguments)) = likelihood.split_once('(') else { return Ok(()) };
    let arguments = arguments.trim_end().strip_suffix(')').unwrap_or(arguments);
    for argument in split_top_level(arguments) {
        let tokens: Vec<&str> = tokens(argument).collect();
        let ([mentioned] | [mentioned, "(", _, ")"]) = tokens[..] else { continue };
        let got = unit_of(model, mentioned).unwrap_or_default();
        if !unit.is_empty() && !got.is_empty() {
            require(&format!("observe {name}: {} of {mentioned}", family.trim()), unit, &got)?;
        }
    }
    Ok(())
}

/// The declared unit of a parameter, field or `let`.
pub(super) fn unit_of(model: &Model, name: &str) -> Option<String> {
    let statement = model.statements.iter().find(|s| s.decl.name == name);
    statement.map(|s| s.decl.unit.to_string())
}

/// An error unless both are the same.
pub(super) fn require(place: &str, expected: &str, got: &str) -> Result<(), ModelError> {
    if expected == got {
        return Ok(());
    }
    let shown = |unit: &str| if unit.is_empty() { "no unit".into() } else { format!("[{unit}]") };
    Err(ModelError::Unit { place: place.into(), expected: shown(expected), got: shown(got) })
}

/// Identifiers, numbers and single signs.
fn tokens(text: &str) -> impl Iterator<Item = &str> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut rest = text.trim_start();
    std::iter::from_fn(move || {
        let first = rest.chars().next()?;
        let end = if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        let (token, after) = rest.split_at(end);
        rest = after.trim_start();
        Some(token)
    })
}

/// The arguments of a call.
fn split_top_level(arguments: &str) -> Vec<&str> {
    let (mut depth, mut start, mut parts) = (0, 0, vec![]);
    for (i, c) in arguments.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&arguments[start..i]);
                start = i + 1;
            }
            _ => {}
        }
    }
    parts.push(&arguments[start..]);
    parts
}

#[cfg(test)]
mod tests {
    use crate::dsl::{Declare, Model};
    use crate::prelude::*;

    mod length_in_ms {
        use super::*;
        model! {
            model Length;
            field f(x) [ms] = m + a * gp(Rbf(rho), K = 4) where {
                m   [ms] ~ Flat;
                a   [ms] ~ HalfNormal(1.0);
                rho [ms] ~ InvGamma(1.0, 1.0);
            }
        }
    }

    mod mean_in_mm {
        use super::*;
        model! {
            model Mean;
            field f(x) [ms] = m + a * gp(Rbf(rho), K = 4) where {
                m   [mm] ~ Flat;
                a   [ms] ~ HalfNormal(1.0);
                rho [mm] ~ InvGamma(1.0, 1.0);
            }
        }
    }

    mod observed_in_another {
        use super::*;
        model! {
            model Observed;
            param v [m/s] ~ Normal(0.0, 1.0);
            param noise [ms] ~ HalfNormal(1.0);
            observe t(row): Number [ms] ~ Normal(v, noise);
        }
    }

    #[test]
    fn units_that_disagree_are_named_with_their_statement() {
        let text = |model: &dyn Declare| Model::outline(model).unwrap_err().to_string();
        let length = text(&length_in_ms::Length);
        assert!(length.starts_with("field f: rho: expected [mm], got [ms]"), "{length}");
        let mean = text(&mean_in_mm::Mean);
        assert!(mean.starts_with("field f: m: expected [ms], got [mm]"), "{mean}");
        let observed = text(&observed_in_another::Observed);
        assert!(
            observed.starts_with("observe t: Normal of v: expected [ms], got [m/s]"),
            "{observed}"
        );
    }
}
