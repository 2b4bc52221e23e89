//! What the first effect that was found adds to each prediction, and its curve along a column.

use std::collections::BTreeMap;

use super::FoundEffect;
use crate::diagnostics::quantile;
use crate::model::{AddedEffect, Model, RowId};
use crate::random::Stream;
use crate::run::{Fit, RunError};
use crate::table::{Measurements, PROTOCOL};

/// Number of draws that it is computed from.
const DRAWS: usize = 400;
/// Most points of the curve.
const MOST_POINTS: usize = 40;

/// What the effects of the first cause add to what is predicted, in the unit of the measurement.
#[derive(Clone, Debug)]
pub struct Contribution {
    /// The column that they read, if they read one.
    pub column: Option<String>,
    /// The median of what they add, for each row of the table that is measured.
    pub rows: BTreeMap<usize, f64>,
    /// The curve along the column.
    pub curve: Vec<Point>,
    /// Labels of the column, if it is one of labels. Each of the curve's points is then one of
    /// them.
    pub labels: Vec<String>,
}

/// A point of the curve: the mean of the rows there.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// The mean cell of these rows, or the number of their label.
    pub x: f64,
    /// 5, 50 and 95 % quantiles.
    pub quantiles: [f64; 3],
}

impl Contribution {
    /// Computed from the draws of the model after: what is predicted, less what would be predicted
    /// without the effects.
    pub(super) fn of(
        effects: &[FoundEffect],
        after: &Fit<'_>,
        table: &Measurements,
    ) -> Result<Option<Self>, RunError> {
        let moving = effects.iter().filter(|found| !found.is_scatter());
        let moving: Vec<&AddedEffect> = moving.map(|found| &found.effect).collect();
        let Some(first) = moving.first() else { return Ok(None) };
        let own: Vec<&&AddedEffect> = moving.iter().filter(|e| e.form == first.form).collect();
        let model = after.model();
        let names = model.unknown_names();
        let is_own = |name: &str| own.iter().any(|e| name.split('[').next() == Some(&e.name));
        let draws = after.thinned(DRAWS)?;
        let without: Vec<Vec<f64>> = draws
            .iter()
            .map(|draw| {
                let one = |(x, name): (&f64, &String)| if is_own(name) { 0.0 } else { *x };
                draw.iter().zip(&names).map(one).collect()
            })
            .collect();
        let ids = model.row_ids();
        let (with, without) = (locations(model, &draws, &ids), locations(model, &without, &ids));
        let added: Vec<Vec<f64>> = with
            .iter()
            .zip(&without)
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect())
            .collect();
        let rows: Vec<usize> = ids.iter().map(|id| model.table_row(*id)).collect();
        let medians = rows.iter().zip(&added).map(|(row, draws)| (*row, quantiles(draws)[1]));
        let offset = || (first.form.n_modes() == 0 && table.has(PROTOCOL)).then_some(PROTOCOL);
        let column = first.form.column().or_else(offset).map(String::from);
        let (x, labels) = column.as_deref().map_or((vec![], vec![]), |name| places(table, name));
        let at: Vec<f64> =
            rows.iter().map(|row| x.get(*row).copied().unwrap_or(f64::NAN)).collect();
        let curve = curve(&at, &added);
        Ok(Some(Self { rows: medians.collect(), curve, column, labels }))
    }
}

/// The predicted value of each row at each draw.
fn locations(model: &Model, draws: &[Vec<f64>], ids: &[RowId]) -> Vec<Vec<f64>> {
    let mut all = vec![vec![]; ids.len()];
    let mut rng = Stream::HeldOut.rng(0); // every unknown is known: nothing is drawn
    model.at_draws(model, draws, ids, &mut rng, &mut |row, own, _| {
        all[row].push(model.row_location(ids[row], own).unwrap_or(f64::NAN));
    });
    all
}

/// Where each row of the table stands along a column: its number, or the number of its label.
pub(super) fn places(table: &Measurements, column: &str) -> (Vec<f64>, Vec<String>) {
    let Some(column) = table.column(column) else { return (vec![], vec![]) };
    if let Some(numbers) = column.numbers() {
        return (numbers.to_vec(), vec![]);
    }
    let mut labels = column.labels();
    labels.sort_unstable();
    let number = |row: usize| labels.iter().position(|label| label == column.text(row));
    let x = (0..table.len()).map(|row| number(row).map_or(f64::NAN, |number| number as f64));
    (x.collect(), labels)
}

/// The curve. Rows at the same place stay together; rows are joined until there are some forty
/// points at most. Each point has the quantiles, over the draws, of the mean of its rows.
fn curve(x: &[f64], added: &[Vec<f64>]) -> Vec<Point> {
    let mut order: Vec<usize> = (0..x.len()).filter(|row| x[*row].is_finite()).collect();
    order.sort_by(|a, b| x[*a].total_cmp(&x[*b]));
    let least = order.len().div_ceil(MOST_POINTS);
    let mut parts: Vec<Vec<usize>> = vec![];
    for row in order {
        match parts.last_mut() {
            // the rows of a place stay together
            Some(part)
                if part.len() < least || part.last().is_some_and(|last| x[*last] >= x[row]) =>
            {
                part.push(row);
            }
            _ => parts.push(vec![row]),
        }
    }
    let point = |part: &Vec<usize>| {
        let n = part.len() as f64;
        let draw = |draw: usize| part.iter().map(|row| added[*row][draw]).sum::<f64>() / n;
        let draws: Vec<f64> = (0..added[part[0]].len()).map(draw).collect();
        Point { x: part.iter().map(|row| x[*row]).sum::<f64>() / n, quantiles: quantiles(&draws) }
    };
    parts.iter().map(point).collect()
}

fn quantiles(draws: &[f64]) -> [f64; 3] {
    let mut sorted = draws.to_vec();
    sorted.sort_by(f64::total_cmp);
    [0.05, 0.5, 0.95].map(|p| quantile(&sorted, p))
}
