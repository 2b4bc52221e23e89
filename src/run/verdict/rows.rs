//! Every measurement beside what is predicted of it: with it, and from the others alone.

use std::io;

use rayon::prelude::*;

use super::LeftOut;
use super::reading::{Reading, groups};
use crate::diagnostics::{loo_weights, quantile, relative_efficiency, weighted_quantile};
use crate::infer::Chain;
use crate::model::Observe;
use crate::report::{
    Columns, LEVELS, LeftOutBy, Predicted, PredictedRow, Predictions, Values, Variable,
};
use crate::run::{Fit, RunError};

impl Fit<'_> {
    /// Every measurement beside what is predicted of it, in the order of the model's statements.
    ///
    /// Once from the posterior, which has seen it, and once from all other measurements: by the
    /// importance weights of [`Fit::loo`] where they can be relied on, or as it was left out there.
    /// Measurements of a `density` are not among them: nothing is simulated from one.
    ///
    /// # Errors
    /// [`RunError::Draws`].
    pub fn predictions(&self) -> Result<Predictions, RunError> {
        let table = self.problem().measurements();
        let observes = self.model().observes.iter();
        let places: Vec<(&Observe, usize)> =
            observes.flat_map(|o| (0..o.rows.len()).map(move |i| (o, i))).collect();
        let Some(replicates) = Replicates::of(self) else {
            return Ok(Predictions::default());
        };
        let one = |(i, (observe, own)): (usize, &(&Observe, usize))| -> io::Result<_> {
            let (row, cells) = (observe.rows[*own], observe.observed_row(*own));
            let reading = Reading::of(&cells);
            let drawn = replicates.values.column(i)?;
            Ok(PredictedRow {
                measured: [cells[0], cells[cells.len() - 1]],
                left_out: replicates.left_out(i, &drawn, &reading)?,
                fitted: unweighted(drawn, &reading),
                ..PredictedRow::at(table, row, observe.name, &observe.unit)
            })
        };
        let at_once = self.at_once();
        let rows = places.par_iter().enumerate().with_min_len(at_once).map(one);
        let rows: io::Result<Vec<PredictedRow>> = rows.collect();
        let named: Vec<(&str, usize)> = places.iter().map(|(o, i)| (o.name, o.rows[*i])).collect();
        Ok(Predictions { rows: rows.map_err(RunError::draws)?, sets: groups(&named, table) })
    }
}

/// Draws of the posterior as replicates of each measurement.
struct Replicates<'f> {
    /// (draw, measurement)
    values: &'f Columns,
    /// (draw, measurement of all statements)
    ln_likelihood: &'f Columns,
    left_out: Option<&'f LeftOut>,
    r_eff: f64,
}

/// The numbers of a variable, if it has a row of them for each draw.
fn numbers(variable: &Variable) -> Option<&Columns> {
    match &variable.values {
        Values::Columns(columns) => Some(columns),
        _ => None,
    }
}

impl<'f> Replicates<'f> {
    /// `None` if nothing can be simulated.
    fn of(fit: &'f Fit<'_>) -> Option<Self> {
        let posterior = fit.posterior();
        // all of them together are the last variable with numbers
        let predicted = posterior.posterior_predictive.variables.iter().rev();
        let values = predicted.filter_map(numbers).find(|values| !values.is_empty())?;
        let ln_likelihood = numbers(posterior.log_likelihood.variables.first()?)?;
        let sizes = posterior.rows.iter().map(|row| (row.summary.sd / row.summary.mcse).powi(2));
        let sizes: Vec<f64> = sizes.collect();
        let draws = fit.chains().first().map_or(0, Chain::n_draws);
        let r_eff = relative_efficiency(&sizes, fit.chains().len(), draws);
        Some(Self { values, ln_likelihood, left_out: fit.left_out(), r_eff })
    }

    /// From the other measurements alone, of which replicates were `drawn`; `None` where that cannot be told.
    fn left_out(
        &self,
        i: usize,
        drawn: &[f64],
        reading: &Reading,
    ) -> io::Result<Option<(Predicted, LeftOutBy)>> {
        let Some(LeftOut { loo, replicates }) = self.left_out else { return Ok(None) };
        if let Some(replicates) = replicates.get(&i) {
            return Ok(Some((unweighted(replicates.clone(), reading), loo.rows[i].loo_by)));
        }
        if loo.rows.get(i).is_none_or(|row| row.pareto_k > loo.record.k_threshold) {
            return Ok(None);
        }
        let weights = loo_weights(&self.ln_likelihood.column(i)?, self.r_eff);
        let weighted = |weights| weighted(drawn.iter().copied().zip(weights), reading);
        Ok(weights.map(|weights| (weighted(weights), LeftOutBy::Weights)))
    }
}

/// Draws that are all worth the same.
pub(in crate::run) fn unweighted(mut sorted: Vec<f64>, reading: &Reading) -> Predicted {
    sorted.retain(|value| value.is_finite());
    sorted.sort_unstable_by(f64::total_cmp);
    predicted(&|p| quantile(&sorted, p), reading)
}

/// Draws with weights.
fn weighted(drawn: impl Iterator<Item = (f64, f64)>, reading: &Reading) -> Predicted {
    let mut sorted: Vec<(f64, f64)> = drawn.filter(|(value, _)| value.is_finite()).collect();
    sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    predicted(&|p| weighted_quantile(&sorted, p), reading)
}

/// A measurement against quantiles of replicates; of a bracket they are lower ends, and the middle is told.
fn predicted(at: &dyn Fn(f64) -> f64, reading: &Reading) -> Predicted {
    let is_inside =
        |level: f64| reading.outside([0.5 - 0.5 * level, 0.5 + 0.5 * level].map(at)) <= 0.0;
    Predicted {
        quantiles: [0.05, 0.5, 0.95].map(|p| at(p) + 0.5 * reading.width),
        inside: LEVELS.map(is_inside),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Loaded, Problem, Settings};
    use crate::table::Measurements;

    mod conjugate {
        use crate::prelude::*;
        model! {
            model Conjugate;
            param mean [ms] ~ Normal(10.0, 2.0);
            observe y(row): Number [ms] ~ Normal(mean, 1.0);
        }
    }

    /// Without 13.5 the posterior is Normal(11.444, 1/2.25), with it Normal(12.077, 1/3.25).
    #[test]
    fn a_row_is_predicted_with_it_and_from_the_others() {
        let cells = ["12.0", "13.5", "11.25"].map(|y| vec![y.to_owned()]).to_vec();
        let measurements = Measurements::from_cells("test", vec!["y".into()], cells).unwrap();
        let problem =
            Problem::new(&conjugate::Conjugate, Loaded { measurements, ..Loaded::default() });
        let settings = Settings { seed: 3, ..Settings::default() };
        let fit = problem.unwrap().fit(&settings).unwrap();
        let predictions = fit.predictions().unwrap();
        // the verdict counts the same rows
        let n_inside = predictions.rows.iter().filter(|row| row.fitted.inside[2]).count();
        assert_eq!(fit.questions().fits.as_ref().unwrap().sets[0].inside, n_inside);
        assert_eq!(predictions.sets, [("all".to_owned(), vec![0, 1, 2])]);
        let row = &predictions.rows[1];
        assert_eq!((row.line, row.measured), (3, [13.5, 13.5]));
        let (left_out, by) = row.left_out.as_ref().unwrap();
        assert_eq!(*by, LeftOutBy::Weights);
        let cases = [(&row.fitted, 12.077, 1.0 + 1.0 / 3.25), (left_out, 11.444, 1.0 + 1.0 / 2.25)];
        for (predicted, mean, variance) in cases {
            let sd = f64::sqrt(variance);
            // a thousand independent draws: five standard errors of a median and of a 5 % quantile
            let errors = [0.33, 0.20, 0.33].map(|error| error * sd);
            let exact = [-1.645, 0.0, 1.645].map(|z| mean + z * sd);
            for ((q, exact), error) in predicted.quantiles.iter().zip(exact).zip(errors) {
                assert!((q - exact).abs() < error, "{predicted:?} but {exact}");
            }
        }
        // 1.71 standard deviations from what the others predict
        assert_eq!([0, 1, 3].map(|level| left_out.inside[level]), [false, false, true]);
    }

    #[test]
    fn a_bracket_is_told_by_its_middle_and_compared_on_its_grid() {
        let drawn: Vec<(f64, f64)> = [(220.0, 0.04), (230.0, 0.9), (240.0, 0.06)].to_vec();
        let of = |cells: &[f64]| weighted(drawn.iter().copied(), &Reading::of(cells));
        assert_eq!(of(&[230.0, 240.0]).inside, [true; 4]);
        assert_eq!(format!("{:?}", of(&[230.0, 240.0]).quantiles), "[235.0, 235.0, 245.0]");
        assert_eq!(of(&[240.0, 250.0]).inside, [false, false, true, true]);
        assert_eq!(of(&[220.0, 230.0]).inside, [false, false, false, true]);
        assert_eq!(of(&[f64::NEG_INFINITY, 230.0]).inside, [false, false, false, true]);
        assert_eq!(of(&[f64::NEG_INFINITY, 240.0]).inside, [true; 4]);
        // nothing predicted holds nothing
        assert_eq!(unweighted(vec![], &Reading::of(&[1.0])).inside, [false; 4]);
    }
}
