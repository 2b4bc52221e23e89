//! What a fit says of measurements that it has not seen.

use super::{Fit, RunError};
use crate::diagnostics::quantile;
use crate::model::{Model, RowId};
use crate::random::Stream;
use crate::table::{MEASURED, Measurements};

/// Most draws that predictions are made of.
const PREDICTION_DRAWS: usize = 1000;

/// What a fit says of one row of a table.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Row of the table, from 0.
    pub row: usize,
    /// The `observe` statement that would take it.
    pub observe: String,
    /// Posterior mean of the value about which the likelihood spreads; NaN if it has none.
    pub expected: f64,
    /// Mean of replicated measurements, noise included; of a bracket, of its middle.
    pub mean: f64,
    /// Their standard deviation.
    pub sd: f64,
    /// Their 5, 50 and 95 % quantiles.
    pub quantiles: [f64; 3],
}

impl Fit<'_> {
    /// The posterior predictive distribution of every row of `table`, from at most 1000 draws.
    ///
    /// The table has the columns of the one that was fitted, without the measured ones if nothing was
    /// measured yet: predictions do not depend on them (a bracket's width is that of the first fitted
    /// row of its protocol). The coefficients of labels that were not fitted, such as a new site, are drawn from their
    /// prior; fields of such labels have coefficients 0. The draws are from a random stream of the fit's seed, so
    /// they are the same every time.
    ///
    /// # Errors
    /// [`RunError::Data`] and [`RunError::Probe`] for rows that do not fit the model or lie off the
    /// surface; [`RunError::Model`] where the model cannot be laid out on them.
    pub fn predict(&self, table: &Measurements) -> Result<Vec<Prediction>, RunError> {
        let joint = self.with_rows(table)?;
        let first = self.problem.measurements().len();
        let ids = joint.row_ids().into_iter();
        let ids: Vec<RowId> = ids.filter(|id| joint.table_row(*id) >= first).collect();
        let mut rng = Stream::HeldOut.rng(self.settings.seed);
        let mut replicates: Vec<Replicates> = ids.iter().map(|_| Replicates::default()).collect();
        let draws = self.thinned(PREDICTION_DRAWS);
        joint.at_draws(self.model(), &draws, &ids, &mut rng, &mut |row, own, rng| {
            let (id, replicates) = (ids[row], &mut replicates[row]);
            let cells = joint.row_replicate(id, &joint.measured_row(id), own, rng);
            replicates.values.push(cells.iter().sum::<f64>() / cells.len() as f64);
            replicates.expected += joint.row_location(id, own).unwrap_or(f64::NAN);
        });
        let predictions = ids.iter().zip(replicates).map(|(id, replicates)| {
            let observe = joint.observes[id.observe].name.to_owned();
            replicates.prediction(joint.table_row(*id) - first, observe)
        });
        let mut predictions: Vec<Prediction> = predictions.collect();
        predictions.sort_by_key(|prediction| prediction.row);
        Ok(predictions)
    }

    /// The model on the rows that were fitted, then those of `table`.
    fn with_rows(&self, table: &Measurements) -> Result<Model, RunError> {
        let loaded = self.problem.loaded();
        let place = |table: Measurements| match &loaded.domain {
            Some(domain) => domain.placed(table),
            None => Ok(table),
        };
        table.check_protocols(&self.model().readers())?;
        place(table.clone())?; // its errors name its own lines
        let mut lent = MEASURED.to_vec();
        let cells = self.model().observes.iter().flat_map(|observe| &observe.cells);
        lent.extend(cells.map(String::as_str));
        let joint = place(loaded.measurements.followed_by(table, &lent))?;
        Ok(Model::new(self.problem.declared(), loaded.basis(), &joint)?)
    }
}

/// Replicated measurements of one row.
#[derive(Default)]
struct Replicates {
    values: Vec<f64>,
    /// Sum over the draws.
    expected: f64,
}

impl Replicates {
    fn prediction(mut self, row: usize, observe: String) -> Prediction {
        let n = self.values.len() as f64;
        let mean = self.values.iter().sum::<f64>() / n;
        let squares: f64 = self.values.iter().map(|x| (x - mean).powi(2)).sum();
        self.values.sort_by(f64::total_cmp);
        Prediction {
            row,
            observe,
            expected: self.expected / n,
            mean,
            sd: (squares / (n - 1.0)).sqrt(),
            quantiles: [0.05, 0.5, 0.95].map(|p| quantile(&self.values, p)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Loaded, Problem, Settings};
    use super::*;

    mod conjugate {
        use crate::prelude::*;
        model! {
            model Conjugate;
            param mean [ms] ~ Normal(10.0, 2.0);
            observe y(row): Number [ms] ~ Normal(mean, 1.0);
        }
    }

    fn table(cells: &[&str]) -> Measurements {
        let cells = cells.iter().map(|y| vec![(*y).to_owned()]).collect();
        Measurements::from_cells("test", vec!["y".into()], cells).unwrap()
    }

    /// The posterior is Normal(12.077, 1/3.25), a further measurement has variance 1 + 1/3.25.
    #[test]
    fn a_further_measurement_has_the_conjugate_predictive() {
        let loaded =
            Loaded { measurements: table(&["12.0", "13.5", "11.25"]), ..Loaded::default() };
        let problem = Problem::new(&conjugate::Conjugate, loaded).unwrap();
        let fit = problem.fit(&Settings { seed: 3, ..Settings::default() }).unwrap();
        let predicted = fit.predict(&table(&["", "99.0"])).unwrap();
        assert_eq!(predicted.iter().map(|p| p.row).collect::<Vec<_>>(), [0, 1]);
        let (mean, sd) = ((10.0 / 4.0 + 12.0 + 13.5 + 11.25) / 3.25, (1.0f64 + 1.0 / 3.25).sqrt());
        for p in &predicted {
            // 1000 draws: five standard errors
            assert!((p.mean - mean).abs() < 5.0 * sd / 1000f64.sqrt(), "{p:?}");
            assert!((p.sd - sd).abs() < 5.0 * sd / 2000f64.sqrt(), "{p:?}");
            assert!((p.expected - mean).abs() < 5.0 * 0.56 / 1000f64.sqrt(), "{p:?}");
            let [low, _, high] = p.quantiles;
            assert!((high - low - 2.0 * 1.645 * sd).abs() < 0.4, "{p:?}");
        }
        let again = fit.predict(&table(&["", "99.0"])).unwrap();
        assert_eq!(format!("{predicted:?}"), format!("{again:?}"));
    }
}
