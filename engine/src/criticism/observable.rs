//! What each `observe` compares with its measurements, and the size of a protocol step.

use super::error::CriticismError;
use crate::model::{Model, Observe};

/// For each `observe` of a model, the first field or `let` that its likelihood mentions.
///
/// # Errors
/// An `observe` that mentions parameters alone: there is nothing that an effect could act on. An operator over
/// the whole surface.
pub fn observables(model: &Model) -> Result<Vec<String>, CriticismError> {
    let no_text = |_| CriticismError::NoObservable { observe: model.name.into() };
    let tree = model.syntax().map_err(no_text)?;
    if let Some(own) = tree.operators_observed().first() {
        return Err(CriticismError::Everywhere { name: own.name.to_string() });
    }
    let one = |observe: &Observe| {
        let own = tree.observes().find(|own| own.name == observe.name);
        let first = own.and_then(|own| tree.first_value(own)).map(ToString::to_string);
        first.ok_or_else(|| CriticismError::NoObservable { observe: observe.name.into() })
    };
    model.observes.iter().map(one).collect()
}

/// The size of a protocol step: the median width of the brackets, or half the standard deviation of
/// other measurements.
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

/// Rounds to three significant digits, for what is written into a model file.
pub(super) fn readable(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}

/// Rounds to as many decimals as `scale` has with three significant digits.
pub(super) fn readable_to(x: f64, scale: f64) -> f64 {
    let decimals = (2.0 - scale.abs().log10().floor()).clamp(0.0, 12.0);
    format!("{x:.0$}", decimals as usize).parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_into_a_model_file_has_few_digits() {
        assert_eq!(readable(7.045994229658082).to_string(), "7.05");
        assert_eq!(readable_to(14.915774999999993, 7.045).to_string(), "14.92");
        assert_eq!(readable_to(1234567.891, 250.0).to_string(), "1234568");
        assert_eq!(readable_to(-0.012346, 0.0034).to_string(), "-0.01235");
    }
}
