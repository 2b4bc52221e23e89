//! How large an effect is, in the unit of what it acts on.

use super::super::inputs::Inputs;
use super::Sampling;
use super::predictions::thinned;
use crate::diagnostics::quantile;
use crate::model::{AddedEffect, Form};
use crate::num::vector::dot;

/// The size of an effect.
pub(super) struct Size {
    /// Central 90 % interval of its one coefficient, of the greatest difference between two labels, of
    /// the range of its curve over the table or, of a field, of its sd there.
    pub(super) interval: [f64; 2],
    /// What it is the size of.
    of: String,
}

impl Size {
    pub(super) fn of(effect: &AddedEffect, after: &Sampling, inputs: &Inputs) -> Self {
        let draws = coefficients(effect, after);
        let labels = effect.form.labels(&inputs.measurements);
        let (mut values, of): (Vec<f64>, String) = match &effect.form {
            Form::Smooth { column, .. } => {
                let (design, n) = effect.form.design(&inputs.measurements);
                let range = |draw: &Vec<f64>| {
                    let curve = design.chunks_exact(n).map(|z| dot::<1>(z, draw));
                    let ends = curve.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
                        (low.min(y), high.max(y))
                    });
                    ends.1 - ends.0
                };
                (
                    draws.iter().map(range).collect(),
                    format!("from end to end of its curve in {column}"),
                )
            }
            Form::Group { column } | Form::Family { column } => {
                let (least, most) = extremes(&draws);
                let of = format!("more with {column} {} than with {}", labels[most], labels[least]);
                (draws.iter().map(|draw| draw[most] - draw[least]).collect(), of)
            }
            Form::Scaled { column, scale, .. } => {
                (draws.iter().map(|draw| draw[0]).collect(), format!("per {scale:.3} of {column}"))
            }
            Form::Above { column, threshold } => (
                draws.iter().map(|draw| draw[0]).collect(),
                format!("where {column} is above {threshold:.3}"),
            ),
            Form::Logistic { column, centre, .. } => (
                draws.iter().map(|draw| draw[0]).collect(),
                format!("well above {centre} of {column}, more than well below"),
            ),
            Form::Surface { .. } | Form::Path { .. } => {
                let (design, n) = effect.form.design(&inputs.measurements);
                let of_rows = |draw: &Vec<f64>| {
                    sd(&design.chunks_exact(n).map(|z| dot::<1>(z, draw)).collect::<Vec<f64>>())
                };
                (draws.iter().map(of_rows).collect(), "sd over the measurements".into())
            }
            Form::All => (draws.iter().map(|draw| draw[0]).collect(), "everywhere".into()),
        };
        values.sort_by(f64::total_cmp);
        Self { interval: [quantile(&values, 0.05), quantile(&values, 0.95)], of }
    }

    pub(super) fn in_words(&self, effect: &AddedEffect) -> String {
        let ([low, high], on, unit) = (self.interval, effect.on.join(", "), &effect.unit);
        let range = format!("{on}: {low:.1} to {high:.1} {unit}").replace('-', "−");
        format!("{range} {} (90 % interval)", self.of)
    }
}

/// Draws of an effect's coefficients.
fn coefficients(effect: &AddedEffect, after: &Sampling) -> Vec<Vec<f64>> {
    let names = after.model.unknown_names();
    let is_own = |i: &usize| names[*i].split('[').next() == Some(effect.name.as_str());
    let own: Vec<usize> = (0..names.len()).filter(is_own).collect();
    let draws = thinned(&after.chains).into_iter();
    draws.map(|draw| own.iter().map(|i| draw[*i]).collect()).collect()
}

/// Numbers of the coefficients that are least and greatest on average.
fn extremes(draws: &[Vec<f64>]) -> (usize, usize) {
    let n = draws.first().map_or(0, Vec::len);
    let total = |k: usize| draws.iter().map(|draw| draw[k]).sum::<f64>();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| total(*a).total_cmp(&total(*b)));
    (order.first().copied().unwrap_or(0), order.last().copied().unwrap_or(0))
}

fn sd(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt()
}
