//! What a fit, or a finished run, says of measurements that it has not seen.

use std::path::PathBuf;

use super::fit::KEPT;
use super::forecast::{Forecast, Prediction};
use super::results::{MEASUREMENTS, MODEL};
use super::unknowns::{self, Unknowns};
use super::verdict::{Reading, unweighted};
use super::{DataSource, Fit, Inputs, MeshSource, ModelText, Problem, Results, RunError, hash};
use crate::model::{Model, RowId};
use crate::random::Stream;
use crate::report::PredictedRow;
use crate::store::differences;
use crate::table::{MEASURED, Measurements};

/// Numbers that the replicates of a table may have; of a large one fewer draws are taken, but no fewer
/// than [`LEAST_DRAWS`].
const NUMBERS: usize = 20_000_000;
const LEAST_DRAWS: usize = 100;

impl Fit<'_> {
    /// The posterior predictive distribution of every row of `table`, from at most 1000 draws (of more
    /// than 20,000 rows from fewer).
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
    pub fn predict(&self, table: &Measurements) -> Result<Forecast, RunError> {
        let draws = self.thinned(most_draws(table))?;
        self.problem.forecast(&draws, self.chains().len(), self.settings.seed, table)
    }
}

impl Inputs {
    /// What a finished run was made from: the model's text and the table from its folder, the surface
    /// as its record tells. Files that have changed since are found by [`Problem::predict`].
    ///
    /// # Errors
    /// [`RunError::NotKept`] where the surface was in memory; [`RunError::Read`] where the folder has no
    /// model.
    pub fn of_run(run: &Results) -> Result<Self, RunError> {
        let (copy, table) = (run.folder.join(MODEL), run.folder.join(MEASUREMENTS));
        let text = std::fs::read_to_string(&copy).map_err(RunError::read(&copy))?;
        let provenance = &run.record.provenance;
        // the file itself has its modules beside it, the copy has not
        let is_same = |path: &PathBuf| std::fs::read_to_string(path).is_ok_and(|now| now == text);
        let path = provenance.model.clone().filter(is_same).unwrap_or(copy);
        let mesh = match &provenance.surface {
            Some(record) => MeshSource::recorded(record)?,
            None if provenance.mesh.is_none() => MeshSource::default(),
            None => {
                return Err(RunError::NotKept {
                    folder: run.folder.clone(),
                    what: "surface, which was in memory",
                    remedy: "give the surface again",
                });
            }
        };
        let data = if table.exists() { DataSource::File(table) } else { DataSource::default() };
        let (basis, model) = (provenance.basis.clone(), ModelText { text, path: Some(path) });
        Ok(Self { mesh, basis, data, model: Some(model), command: provenance.command.clone() })
    }
}

impl Problem<'_> {
    /// As [`Fit::predict`], from the draws that an earlier run of this problem left in its folder.
    ///
    /// # Errors
    /// Those of [`Fit::predict`]; [`RunError::OtherInputs`] where the problem is not what the run was
    /// made from; [`RunError::Report`] for a folder without draws.
    pub fn predict(&self, run: &Results, table: &Measurements) -> Result<Forecast, RunError> {
        let here = &self.loaded().hashes;
        let kept =
            run.record.hashes.clone().into_iter().filter(|(role, _)| here.contains_key(role));
        let kept = kept.collect();
        let here = here.iter().filter(|(role, _)| run.record.hashes.contains_key(*role));
        let mut differences =
            differences(&kept, &here.map(|(role, hash)| (role.clone(), hash.clone())).collect());
        let unknowns = Unknowns::read(&run.record.own(&run.folder, unknowns::FILE)?)?;
        if unknowns.about.model != self.model().name {
            differences.push(format!("model {}, here {}", unknowns.about.model, self.model().name));
        } else if unknowns.about.unknowns != self.model().unknown_names() {
            differences.push("names of the unknowns".to_owned());
        }
        if !differences.is_empty() {
            return Err(RunError::OtherInputs { folder: run.folder.clone(), differences });
        }
        let n_chains = unknowns.chains.len();
        let most = most_draws(table).div_ceil(n_chains);
        let of_chain = |chain: &'_ Vec<Vec<f64>>| chain.len().div_ceil(most).max(1);
        let chains = unknowns.chains.iter();
        let draws = chains.flat_map(|chain| chain.iter().step_by(of_chain(chain)));
        let draws: Vec<Vec<f64>> = draws.cloned().collect();
        let problem = self.corrected_at(&unknowns.corrected_at)?;
        let mut forecast = problem.forecast(&draws, n_chains, run.record.seed, table)?;
        let own = run.record.files.get(unknowns::FILE);
        forecast.hashes.extend(own.map(|hash| ("unknowns".to_owned(), hash.clone())));
        Ok(forecast)
    }

    fn forecast(
        &self,
        draws: &[Vec<f64>],
        n_chains: usize,
        seed: u64,
        table: &Measurements,
    ) -> Result<Forecast, RunError> {
        let placed = self.placed(table)?;
        // with its paths, as the fitted rows have theirs
        let joint = self.with_rows(&placed)?;
        let first = self.measurements().len();
        let ids = joint.row_ids().into_iter();
        let ids: Vec<RowId> = ids.filter(|id| joint.table_row(*id) >= first).collect();
        joint.check_new(self.model(), &mut Stream::HeldOut.rng(seed))?;
        let mut rng = Stream::HeldOut.rng(seed);
        let mut replicates: Vec<Replicates> = ids.iter().map(|_| Replicates::default()).collect();
        joint.at_draws(self.model(), draws, &ids, &mut rng, &mut |row, own, rng| {
            let (id, replicates) = (ids[row], &mut replicates[row]);
            let cells = joint.row_replicate(id, &joint.measured_row(id), own, rng);
            replicates.values.push(cells.iter().sum::<f64>() / cells.len() as f64);
            replicates.expected += joint.row_location(id, own).unwrap_or(f64::NAN);
        });
        let predictions = ids.iter().zip(replicates).map(|(id, replicates)| {
            replicates.prediction(&joint, *id, &placed, joint.table_row(*id) - first)
        });
        let mut rows: Vec<Prediction> = predictions.collect();
        rows.sort_by_key(|prediction| prediction.row);
        let mut hashes = self.loaded().hashes.clone();
        hashes.insert(Forecast::TABLE.into(), hash(table.to_csv().as_bytes()));
        Ok(Forecast { rows, n_chains, model: self.model().name.to_string(), hashes })
    }

    /// The table on the surface.
    fn placed(&self, table: &Measurements) -> Result<Measurements, RunError> {
        match &self.loaded().domain {
            Some(domain) => domain.placed(table.clone()),
            None => Ok(table.clone()),
        }
    }

    /// The model on the rows that were fitted, then those of `table`, whose own places were found.
    fn with_rows(&self, table: &Measurements) -> Result<Model, RunError> {
        let loaded = self.loaded();
        table.check_protocols(&self.model().readers())?;
        let mut lent = MEASURED.to_vec();
        let cells = self.model().observes.iter().flat_map(|observe| &observe.cells);
        lent.extend(cells.map(String::as_str));
        let joint = self.placed(&loaded.measurements.followed_by(table, &lent))?;
        let mut joint = Model::new(self.declared(), loaded.basis(), &joint)?;
        joint.correct_as(self.model())?;
        Ok(joint)
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
    /// Of row `row` of `table`, which is `id` of the model `joint`.
    fn prediction(self, joint: &Model, id: RowId, table: &Measurements, row: usize) -> Prediction {
        let n = self.values.len() as f64;
        let mean = self.values.iter().sum::<f64>() / n;
        let squares: f64 = self.values.iter().map(|x| (x - mean).powi(2)).sum();
        let (observe, cells) = (&joint.observes[id.observe], joint.measured_row(id));
        let reading = Reading::of(&cells);
        let lower_ends = self.values.iter().map(|middle| middle - 0.5 * reading.width);
        let told = PredictedRow {
            fitted: unweighted(lower_ends.collect(), &reading),
            measured: if was_measured(table, row, &observe.cells) {
                [cells[0], cells[cells.len() - 1]]
            } else {
                [f64::NAN; 2]
            },
            ..PredictedRow::at(table, row, observe.name, &observe.unit)
        };
        Prediction {
            row,
            told,
            expected: self.expected / n,
            mean,
            sd: (squares / (n - 1.0)).sqrt(),
            replicates: self.values,
        }
    }
}

/// Whether the row has what was measured: of a bracket one end is enough.
fn was_measured(table: &Measurements, row: usize, columns: &[String]) -> bool {
    let is_there = |column: &String| table.cell(row, column).is_some_and(|cell| !cell.is_empty());
    if columns.len() == 2 && columns.iter().all(|column| MEASURED.contains(&column.as_str())) {
        return columns.iter().any(is_there);
    }
    columns.iter().all(is_there)
}

/// How many draws are taken at the rows of `table`.
fn most_draws(table: &Measurements) -> usize {
    (NUMBERS / table.len().max(1)).clamp(LEAST_DRAWS, KEPT)
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
        let predicted = fit.predict(&table("y", &["", "99.0"])).unwrap().rows;
        assert_eq!(predicted.iter().map(|p| p.row).collect::<Vec<_>>(), [0, 1]);
        let (mean, sd) = ((10.0 / 4.0 + 12.0 + 13.5 + 11.25) / 3.25, (1.0f64 + 1.0 / 3.25).sqrt());
        for p in &predicted {
            assert!(is_normal(p, mean, sd * sd), "{p:?}");
            assert!((p.expected - mean).abs() < 5.0 * 0.56 / 1000f64.sqrt(), "{p:?}");
            let [low, _, high] = p.told.fitted.quantiles;
            assert!((high - low - 2.0 * 1.645 * sd).abs() < 0.4, "{p:?}");
        }
        let again = fit.predict(&table("y", &["", "99.0"])).unwrap().rows;
        assert_eq!(format!("{predicted:?}"), format!("{again:?}"));
    }

    /// The folder of a run has what it takes: the same numbers, to the last bit.
    #[test]
    fn a_finished_run_predicts_what_its_fit_did() {
        let folder = tempfile::tempdir().unwrap();
        let model = Some(ModelText { text: "the text".into(), path: None });
        let data = table("y", &["12.0", "13.5", "11.25"]).into();
        let inputs = Inputs { data, model, ..Inputs::default() };
        let fit = Problem::load(&conjugate::Conjugate, &inputs).unwrap();
        let fit = fit.fit(&Settings { seed: 3, ..Settings::default() }).unwrap();
        fit.write(folder.path()).unwrap();
        let run = Results::read(folder.path()).unwrap();
        let inputs = Inputs::of_run(&run).unwrap();
        let again = Problem::load(&conjugate::Conjugate, &inputs).unwrap();
        let new = table("y", &["12.5", "", "30.0"]);
        let predicted = again.predict(&run, &new).unwrap();
        let told = fit.predict(&new).unwrap();
        assert_eq!(format!("{:?}", predicted.rows), format!("{:?}", told.rows));
        assert_eq!(predicted.model, told.model);
        // it tells what it was made from, and the draws that it read
        let mut hashes = told.hashes.clone();
        hashes.insert("unknowns".into(), run.record.files[unknowns::FILE].clone());
        assert_eq!(predicted.hashes, hashes);
        assert_eq!((predicted.n_chains, predicted.n_draws()), (4, 1000));
        let measured = predicted.rows.iter().map(|p| p.told.is_measured());
        assert_eq!(measured.collect::<Vec<_>>(), [true, false, true]);
        let inside = [0, 2].map(|i| predicted.rows[i].told.fitted.is_inside());
        assert_eq!(inside, [true, false]);

        std::fs::write(folder.path().join("measurements.csv"), "y\n12.0\n").unwrap();
        let another = Problem::load(&conjugate::Conjugate, &inputs).unwrap();
        let error = another.predict(&run, &new).unwrap_err().to_string();
        assert!(error.contains("was made from other inputs: data is "), "{error}");
        let other = Problem::load(
            &doses::Doses,
            &Inputs { data: table("dose,y", &["1.0,2.0"]).into(), ..Inputs::default() },
        );
        let error = other.unwrap().predict(&run, &new).unwrap_err().to_string();
        assert!(error.contains("model Conjugate, here Doses"), "{error}");
    }

    #[test]
    fn a_new_label_has_its_prior_and_a_fitted_one_its_posterior() {
        let fit = fitted(&sites::Sites, table("site,y", &["a,9.0", "b,-1.0"]));
        let predicted = fit.predict(&table("site,y", &["c,", "b,"])).unwrap().rows;
        assert!(is_normal(&predicted[0], 5.0, 9.0 + 0.25), "{:?}", predicted[0]);
        let precision = 1.0 / 9.0 + 4.0;
        let mean = (5.0 / 9.0 - 4.0) / precision;
        assert!(is_normal(&predicted[1], mean, 1.0 / precision + 0.25), "{:?}", predicted[1]);
    }

    #[test]
    fn a_new_label_without_a_prior_is_refused() {
        let fit = fitted(&flat_sites::FlatSites, table("site,y", &["a,9.0", "b,-1.0"]));
        assert_eq!(fit.predict(&table("site,y", &["b,"])).unwrap().rows.len(), 1);
        let error = fit.predict(&table("site,y", &["c,"])).unwrap_err().to_string();
        assert!(error.starts_with("level[c] ~ Flat: no draw can be made"), "{error}");
    }

    /// Line 2 of both tables has an empty cell: that of the fitted one is 5 g, the other's is anything.
    #[test]
    fn an_empty_cell_is_that_of_its_own_table() {
        let fit = fitted(&doses::Doses, table("dose,y", &[",50.0", "2.0,20.0"]));
        let predicted = fit.predict(&table("dose,y", &[",", "3.0,"])).unwrap().rows;
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
        let predicted = fit.predict(&table(header, &["0,c,", "40,c,", "90,b,"])).unwrap().rows;
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
