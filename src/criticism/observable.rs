//! What each `observe` compares with its measurements, and the size of a protocol step.

use eplat_language::names::mentions;

use super::error::CriticismError;
use crate::model::{Model, Observe};

/// For each `observe` of a model, the first field or `let` that its likelihood mentions.
///
/// # Errors
/// One that mentions parameters alone: there is nothing that an effect could act on.
pub(super) fn observables(model: &Model) -> Result<Vec<String>, CriticismError> {
    let is_named = |word: &str| {
        let mut statements = model.statements.iter();
        statements.any(|s| ["field", "let"].contains(&s.keyword) && s.decl.name == word)
    };
    let one = |observe: &Observe| {
        let mut statements = model.statements.iter();
        let own = statements.find(|s| s.keyword == "observe" && s.decl.name == observe.name);
        let likelihood = own.and_then(|s| s.decl.text.split_once('~')).map_or("", |(_, l)| l);
        let words = syn::parse_str(likelihood).map_or(vec![], |e: syn::Expr| mentions(&e));
        let mut words = words.iter().map(|mention| mention.name.to_string());
        let found = words.find(|word| is_named(word));
        found.ok_or_else(|| CriticismError::NoObservable { observe: observe.name.into() })
    };
    model.observes.iter().map(one).collect()
}

/// Whether the likelihood in the text of an `observe` allows for outliers.
pub(super) fn has_outliers(text: &str) -> bool {
    let likelihood = text.split_once('~').map_or("", |(_, likelihood)| likelihood);
    let words = syn::parse_str(likelihood).map_or(vec![], |e: syn::Expr| mentions(&e));
    words.iter().any(|mention| mention.name == "Outliers" && mention.arguments.is_some())
}

/// The median width of the brackets; for other measurements, half their standard deviation.
pub(super) fn step_of(model: &Model) -> f64 {
    let (mut widths, mut values) = (vec![], vec![]);
    for cells in model.observes.iter().flat_map(Observe::observed) {
        match cells[..] {
            [lower, upper] if (upper - lower).is_finite() => widths.push(upper - lower),
            [value] => values.push(value),
            _ => {}
        }
    }
    if !widths.is_empty() {
        widths.sort_by(f64::total_cmp);
        return widths[widths.len() / 2];
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    if sd > 0.0 { readable(sd / 2.0) } else { 1.0 }
}

/// Three significant digits, for what is written into a model file.
pub(super) fn readable(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}
