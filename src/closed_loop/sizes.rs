//! How large an effect is, in the unit of what it acts on.

use super::held_out::PREDICTION_DRAWS;
use crate::diagnostics::quantile;
use crate::model::forms::Extent;
use crate::model::{AddedEffect, Discrepancy};
use crate::num::vector::dot;
use crate::report::after_number;
use crate::run::{Fit, RunError};
use crate::table::{Measurements, SITE, VERTEX};

/// The size of an effect.
#[derive(Clone, Debug)]
pub struct Size {
    /// Central 90 % interval of the size. The size is the one coefficient, the greatest difference
    /// between two labels, the range of the curve over the table or, for a field, its sd there.
    pub interval: [f64; 2],
    /// What it is the size of, in words.
    pub of: String,
}

impl Size {
    pub(super) fn of(
        effect: &AddedEffect,
        after: &Fit<'_>,
        table: &Measurements,
    ) -> Result<Self, RunError> {
        let draws = coefficients(effect, after)?;
        let over_rows = |of: &dyn Fn(&[f64]) -> f64| {
            let (design, n) = effect.form.design(table);
            let rows = |draw: &Vec<f64>| -> Vec<f64> {
                design.chunks_exact(n).map(|z| dot::<1>(z, draw)).collect()
            };
            draws.iter().map(|draw| of(&rows(draw))).collect()
        };
        let (mut values, of): (Vec<f64>, String) = match effect.form.extent() {
            Extent::Coefficient(of) => (draws.iter().map(|draw| draw[0]).collect(), of),
            Extent::Range(of) => (over_rows(&range), of),
            Extent::Sd(of) => (over_rows(&sd), of),
            Extent::Labels => {
                let labels = effect.form.labels(table);
                let (least, most) = extremes(&draws);
                let column = effect.form.column().unwrap_or_default();
                let of = format!("more with {column} {} than with {}", labels[most], labels[least]);
                (draws.iter().map(|draw| draw[most] - draw[least]).collect(), of)
            }
        };
        values.sort_by(f64::total_cmp);
        Ok(Self { interval: [quantile(&values, 0.05), quantile(&values, 0.95)], of })
    }

    /// The size in words, with the quantities that the effect acts on.
    pub(super) fn in_words(&self, effect: &AddedEffect) -> String {
        let (on, interval) = (effect.on.join(", "), interval(self.interval, &effect.unit));
        format!("{on}: {interval} {} (90 % interval)", self.of)
    }
}

/// An interval with as many digits as are needed to tell its ends apart, and its unit. The unit 1
/// is not written.
pub(super) fn interval([low, high]: [f64; 2], unit: &str) -> String {
    let width = (high - low).abs();
    let digits = if width > 0.0 { (1.0 - width.log10()).ceil().clamp(0.0, 6.0) } else { 1.0 };
    let digits = digits as usize;
    let numbers = format!("{low:.digits$} to {high:.digits$}").replace('-', "−");
    numbers + &after_number(unit)
}

/// What a discrepancy's sds are, one line each.
pub(super) fn spread(discrepancy: &Discrepancy, fit: &Fit<'_>) -> Vec<String> {
    let of = |sd: &str, unit: &str, what: &str| {
        let row = fit.summary().iter().find(|row| row.name == sd)?;
        Some(format!(
            "{what} differ by {} (sd, 90 % interval)",
            interval([row.summary.q5, row.summary.q95], unit)
        ))
    };
    let spreads = discrepancy.spreads.iter().filter_map(|spread| {
        let what = match spread.form.column() {
            Some(SITE | VERTEX) => "sites".into(),
            column => format!("units of `{}`", column.unwrap_or_default()),
        };
        of(&spread.sd, &spread.unit, &what)
    });
    let errors = discrepancy.row_errors.iter();
    let errors = errors.filter_map(|error| of(&error.name, &error.unit, "single measurements"));
    spreads.chain(errors).collect()
}

/// Draws of an effect's coefficients.
fn coefficients(effect: &AddedEffect, after: &Fit<'_>) -> Result<Vec<Vec<f64>>, RunError> {
    let names = after.model().unknown_names();
    let is_own = |i: &usize| names[*i].split('[').next() == Some(effect.name.as_str());
    let own: Vec<usize> = (0..names.len()).filter(is_own).collect();
    let draws = after.thinned(PREDICTION_DRAWS)?.into_iter();
    Ok(draws.map(|draw| own.iter().map(|i| draw[*i]).collect()).collect())
}

/// Numbers of the coefficients that are least and greatest on average.
fn extremes(draws: &[Vec<f64>]) -> (usize, usize) {
    let n = draws.first().map_or(0, Vec::len);
    let total = |k: usize| draws.iter().map(|draw| draw[k]).sum::<f64>();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| total(*a).total_cmp(&total(*b)));
    (order.first().copied().unwrap_or(0), order.last().copied().unwrap_or(0))
}

fn range(x: &[f64]) -> f64 {
    let most = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most - x.iter().copied().fold(f64::INFINITY, f64::min)
}

fn sd(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_has_the_digits_that_tell_its_ends_apart() {
        let all = [([0.701, 0.724], "1"), ([-11.36, -6.89], "ms"), ([0.0, 0.0], "ms")];
        let said = all.map(|(ends, unit)| interval(ends, unit));
        assert_eq!(said, ["0.701 to 0.724", "−11.4 to −6.9 ms", "0.0 to 0.0 ms"]);
    }
}
