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
    /// row of its protocol). What was not fitted, such as the coefficient of a new site or the field of
    /// a new patient, is drawn from its prior. The draws are from a random stream of the fit's seed, so
    /// they are the same every time.
    ///
    /// # Errors
    /// [`RunError::Data`] and [`RunError::Probe`] for rows that do not fit the model or lie off the
    /// surface; [`RunError::Model`] where the model cannot be laid out on them, and where they have a new
    /// label and the prior of what belongs to it cannot be drawn from, such as `Flat`.
    pub fn predict(&self, table: &Measurements) -> Result<Vec<Prediction>, RunError> {
        let joint = self.with_rows(table)?;
        let first = self.problem.measurements().len();
        let ids = joint.row_ids().into_iter();
        let ids: Vec<RowId> = ids.filter(|id| joint.table_row(*id) >= first).collect();
        joint.check_new(self.model(), &mut Stream::HeldOut.rng(self.settings.seed))?;
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
    use super::super::{Inputs, Loaded, MeshSource, Problem, Settings};
    use super::*;
    use crate::field::{Kernel as _, Matern52};
    use crate::model::Declare;

    mod conjugate {
        use crate::prelude::*;
        model! {
            model Conjugate;
            param mean [ms] ~ Normal(10.0, 2.0);
            observe y(row): Number [ms] ~ Normal(mean, 1.0);
        }
    }
    mod sites {
        use crate::prelude::*;
        model! {
            model Sites;
            param level(site) [ms] ~ Normal(5.0, 3.0);
            observe y(row): Number [ms] ~ Normal(level(row), 0.5);
        }
    }
    mod flat_sites {
        use crate::prelude::*;
        model! {
            model FlatSites;
            param level(site) [ms] ~ Flat;
            observe y(row): Number [ms] ~ Normal(level(row), 0.5);
        }
    }
    mod doses {
        use crate::prelude::*;
        model! {
            model Doses;
            column dose [g] ~ Normal(2.0, 0.5);
            observe y(row): Number ~ Normal(10.0 * row.dose, 0.1);
        }
    }
    mod patients {
        use crate::prelude::*;
        model! {
            model Patients;
            field level(x, patient) [ms] = m + 2.0 * gp(Matern52(Num::from(30.0)), K = 8) where {
                m(patient) [ms] ~ Normal(10.0, 1.0);
            }
            observe y(x): Number [ms] ~ Normal(level(x), 0.5);
        }
    }

    fn table(header: &str, lines: &[&str]) -> Measurements {
        let cells = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
        let rows = lines.iter().map(|line| cells(line)).collect();
        Measurements::from_cells("test", cells(header), rows).unwrap()
    }

    fn fitted(model: &dyn Declare, measurements: Measurements) -> Fit<'_> {
        let loaded = Loaded { measurements, ..Loaded::default() };
        let problem = Problem::new(model, loaded).unwrap();
        problem.fit(&Settings { seed: 3, ..Settings::default() }).unwrap()
    }

    /// Whether these are the moments of 1000 draws of a normal with this mean and variance, within
    /// five standard errors.
    fn is_normal(p: &Prediction, mean: f64, variance: f64) -> bool {
        let sd = variance.sqrt();
        (p.mean - mean).abs() < 5.0 * sd / 1000f64.sqrt()
            && (p.sd - sd).abs() < 5.0 * sd / 2000f64.sqrt()
    }

    /// The posterior is Normal(12.077, 1/3.25), a further measurement has variance 1 + 1/3.25.
    #[test]
    fn a_further_measurement_has_the_conjugate_predictive() {
        let fit = fitted(&conjugate::Conjugate, table("y", &["12.0", "13.5", "11.25"]));
        let predicted = fit.predict(&table("y", &["", "99.0"])).unwrap();
        assert_eq!(predicted.iter().map(|p| p.row).collect::<Vec<_>>(), [0, 1]);
        let (mean, sd) = ((10.0 / 4.0 + 12.0 + 13.5 + 11.25) / 3.25, (1.0f64 + 1.0 / 3.25).sqrt());
        for p in &predicted {
            assert!(is_normal(p, mean, sd * sd), "{p:?}");
            assert!((p.expected - mean).abs() < 5.0 * 0.56 / 1000f64.sqrt(), "{p:?}");
            let [low, _, high] = p.quantiles;
            assert!((high - low - 2.0 * 1.645 * sd).abs() < 0.4, "{p:?}");
        }
        let again = fit.predict(&table("y", &["", "99.0"])).unwrap();
        assert_eq!(format!("{predicted:?}"), format!("{again:?}"));
    }

    #[test]
    fn a_new_label_has_its_prior_and_a_fitted_one_its_posterior() {
        let fit = fitted(&sites::Sites, table("site,y", &["a,9.0", "b,-1.0"]));
        let predicted = fit.predict(&table("site,y", &["c,", "b,"])).unwrap();
        assert!(is_normal(&predicted[0], 5.0, 9.0 + 0.25), "{:?}", predicted[0]);
        let precision = 1.0 / 9.0 + 4.0;
        let mean = (5.0 / 9.0 - 4.0) / precision;
        assert!(is_normal(&predicted[1], mean, 1.0 / precision + 0.25), "{:?}", predicted[1]);
    }

    #[test]
    fn a_new_label_without_a_prior_is_refused() {
        let fit = fitted(&flat_sites::FlatSites, table("site,y", &["a,9.0", "b,-1.0"]));
        assert_eq!(fit.predict(&table("site,y", &["b,"])).unwrap().len(), 1);
        let error = fit.predict(&table("site,y", &["c,"])).unwrap_err().to_string();
        assert!(error.starts_with("level[c] ~ Flat: no draw can be made"), "{error}");
    }

    /// Line 2 of both tables has an empty cell: that of the fitted one is 5 g, the other's is anything.
    #[test]
    fn an_empty_cell_is_that_of_its_own_table() {
        let fit = fitted(&doses::Doses, table("dose,y", &[",50.0", "2.0,20.0"]));
        let predicted = fit.predict(&table("dose,y", &[",", "3.0,"])).unwrap();
        assert!(is_normal(&predicted[0], 20.0, 25.0 + 0.01), "{:?}", predicted[0]);
        assert!(is_normal(&predicted[1], 30.0, 0.01), "{:?}", predicted[1]);
    }

    /// At a vertex the field of a new patient has the variance of its mean and of its process.
    #[test]
    fn a_new_patient_has_the_prior_of_its_field() {
        let header = "vertex,patient,y";
        let rows = ["0,a,11.0", "40,a,12.0", "90,a,13.0", "0,b,8.0", "40,b,9.0", "90,b,7.5"];
        let mesh = MeshSource::Embedded { edge: 3.0 };
        let inputs = Inputs { mesh, data: table(header, &rows).into(), ..Inputs::default() };
        let problem = Problem::load(&patients::Patients, &inputs).unwrap();
        let fit = problem.fit(&Settings { seed: 3, ..Settings::default() }).unwrap();
        let predicted = fit.predict(&table(header, &["0,c,", "40,c,", "90,b,"])).unwrap();
        let basis = problem.loaded().basis().unwrap();
        for (p, vertex) in predicted.iter().zip([0, 40]) {
            let modes = basis.at(vertex).iter().zip(&basis.eigenvalues).take(8);
            let variance = modes.map(|(phi, lambda)| {
                let root: f64 = Matern52(30.0).sqrt_density(lambda.max(0.0).sqrt());
                (2.0 * phi * root).powi(2)
            });
            let variance = 1.0 + variance.sum::<f64>();
            assert!(variance > 2.0, "the process counts: {variance}");
            assert!(is_normal(p, 10.0, variance + 0.25), "{p:?} {variance}");
        }
        assert!((predicted[2].mean - 7.5).abs() < 1.0 && predicted[2].sd < 1.0, "{predicted:?}");
    }
}
