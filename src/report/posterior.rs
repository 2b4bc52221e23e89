//! Draws of unknowns as what they mean: parameters, log likelihoods, replicated measurements.

use std::io;
use std::path::Path;
use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::quantities::Quantities;
use super::{Columns, Group, LeaveOneOut, Row, Values, Variable};
use crate::infer::{Chain, LogDensity as _};
use crate::model::{Model, Observe};
use crate::random::Stream;
use crate::store::Spool;
use crate::table::Measurements;

/// All measurements together, and their dimension.
const POOLED: &str = "measurements";
const POOLED_DIM: &str = "measurement";

/// Numbers that the log likelihoods of all measurements may have, and so may their replicates: 64 MB. Of a table with
/// more than two thousand rows not every draw is asked.
const MOST: usize = 8_000_000;
/// Draws that are asked of a model whose density takes milliseconds.
const OF_SLOW: usize = 1000;

/// How many log likelihoods of so many rows are kept of so many chains and draws; as many replicates are.
pub fn numbers_at_rows(n_rows: usize, chains: usize, draws: usize) -> usize {
    n_rows.saturating_mul(chains).saturating_mul(draws).min(MOST)
}

/// Everything the draws of a model say, in the groups that `ArviZ` knows.
#[derive(Clone, Debug)]
pub struct Posterior {
    /// Parameters, and `let`s that are no maps (chain, draw, …) in their units.
    pub posterior: Group,
    /// What the sampler did at each draw (chain, draw).
    pub sample_stats: Group,
    /// Log likelihood of each measurement (chain, draw, measurement), of all `observe`s and all `density`s
    /// with a term per row together: one array, so that `az.loo(run)` needs no name. Of every draw, or, of a large
    /// table or a slow model, of every second, third … draw.
    pub log_likelihood: Group,
    /// A replicate of each measurement (chain, draw, row), and of all of them together; of a bracket, its lower end.
    pub posterior_predictive: Group,
    /// The measurements (row), and all of them together; of a bracket, its lower end.
    pub observed_data: Group,
    /// All numbers of the measurements, and where they were made.
    pub constant_data: Group,
    /// Summary of each of these, element by element.
    pub rows: Vec<Row>,
    /// Where the chains disagree, in words, if R̂ of a quantity says that they do.
    pub strays: Option<String>,
    /// How well each measurement is predicted from the others; absent without measurements.
    pub loo: Option<LeaveOneOut>,
}

impl Posterior {
    /// From chains of equal length; `seed` is the run's. With a `folder` it is the same to the last bit in less memory and
    /// more time: what is told of every draw is on its disk, in files without names that go with it.
    ///
    /// # Errors
    /// From that disk, and from that of the chains, if they are on one.
    pub fn new(
        model: &Model,
        data: &Measurements,
        chains: &[Chain],
        seed: u64,
        folder: Option<&Path>,
    ) -> io::Result<Self> {
        let shape = [chains.len(), chains.first().map_or(0, Chain::n_draws)];
        let places = places(model, data);
        let n_draws = shape[0] * shape[1];
        let most = if model.interwoven().is_some() { OF_SLOW } else { usize::MAX };
        let step = (places.len() * n_draws).div_ceil(MOST).max(n_draws.div_ceil(most)).max(1);
        // densities come last: nothing is simulated from them
        let observed_places = &places[..model.observes.iter().map(|o| o.rows.len()).sum()];
        let n_asked = [shape[0], shape[1].div_ceil(step)];
        let quantities = Quantities::of(model);
        let of_chain = |(i, chain)| {
            let new = |width, n| Spool::new(width, n, folder);
            let mut told = Told {
                reported: new(quantities.width(), shape[1]),
                log_likelihood: new(places.len(), n_asked[1]),
                predicted: new(observed_places.len(), n_asked[1]),
            };
            told.fill(model, chain, step, Stream::AfterSampling(i).rng(seed)).map(|()| told)
        };
        let told: io::Result<Vec<Told>> = chains.par_iter().enumerate().map(of_chain).collect();
        let [mut reported, mut log_likelihood, mut predicted] = [(); 3].map(|()| vec![]);
        for told in told? {
            reported.push(told.reported);
            log_likelihood.push(told.log_likelihood);
            predicted.push(told.predicted);
        }
        let posterior = quantities.variables(&Arc::new(reported), shape);
        // of what is on disk one column at a time is in memory
        let at_once = if folder.is_some() { usize::MAX } else { 1 };
        let (rows, strays) = quantities.summaries(&posterior, shape[1], at_once)?;
        let log_likelihood = Columns::new(&Arc::new(log_likelihood), 0, places.len());
        Ok(Self {
            posterior,
            loo: leave_one_out(model, data, &log_likelihood, (&rows, at_once), shape)?,
            rows,
            strays,
            sample_stats: sample_stats(chains, shape),
            log_likelihood: Group {
                name: "log_likelihood".into(),
                variables: pooled(log_likelihood, &by_draw(n_asked), &places),
            },
            posterior_predictive: predictive(model, predicted, observed_places, n_asked),
            observed_data: observed(model, observed_places),
            constant_data: constant(model, data),
        })
    }

    /// All groups, for [`super::write_zarr`].
    pub fn groups(&self) -> Vec<&Group> {
        [
            &self.posterior,
            &self.sample_stats,
            &self.log_likelihood,
            &self.posterior_predictive,
            &self.observed_data,
            &self.constant_data,
        ]
        .into_iter()
        .filter(|group| !group.variables.is_empty())
        .collect()
    }
}

/// What the draws of one chain say.
struct Told {
    /// Of every draw (number of all quantities).
    reported: Spool,
    /// Of every `step`-th draw (measurement).
    log_likelihood: Spool,
    predicted: Spool,
}

impl Told {
    fn fill(
        &mut self,
        model: &Model,
        chain: &Chain,
        step: usize,
        mut rng: ChaCha8Rng,
    ) -> io::Result<()> {
        let (mut tape, mut row) = (model.tape(), vec![]);
        chain.draws.each(1, |i, draw| {
            let is_asked = i.is_multiple_of(step);
            if is_asked {
                model.forward(&mut tape, draw);
            } else {
                model.forward_reported(&mut tape, draw);
            }
            row.clear();
            model.report(&tape, &mut rng, &mut row);
            model.let_values(&tape, &mut row);
            self.reported.push(&row)?;
            if !is_asked {
                return Ok(());
            }
            row.clear();
            model.pointwise(&tape, &mut row);
            self.log_likelihood.push(&row)?;
            row.clear();
            for observe in &model.observes {
                let simulated = observe.simulate(&tape, &mut rng);
                row.extend(simulated.iter().map(|cells| cells[0]));
            }
            self.predicted.push(&row)
        })
    }
}

/// Where each measurement was made, in words.
fn places(model: &Model, data: &Measurements) -> Vec<String> {
    let of = |(name, rows): (&str, &[usize])| -> Vec<String> {
        rows.iter().map(|row| format!("{name} {}", data.place(*row))).collect()
    };
    model.measured().flat_map(of).collect()
}

/// All measurements together, over `dims` and the measurement, with its labels; nothing without measurements.
fn pooled(values: impl Into<Values>, dims: &[(&str, usize)], places: &[String]) -> Vec<Variable> {
    if places.is_empty() {
        return vec![];
    }
    let measurement = [(POOLED_DIM, places.len())];
    vec![
        Variable::new(POOLED, "", &[dims, &measurement].concat(), values),
        Variable::new(POOLED_DIM, "", &measurement, places.to_vec()),
    ]
}

fn by_draw([chains, draws]: [usize; 2]) -> [(&'static str, usize); 2] {
    [("chain", chains), ("draw", draws)]
}

/// `rows` summarise the parameters; of the log likelihoods one thread reads at least `at_once` columns.
fn leave_one_out(
    model: &Model,
    data: &Measurements,
    log_likelihood: &Columns,
    (rows, at_once): (&[Row], usize),
    shape: [usize; 2],
) -> io::Result<Option<LeaveOneOut>> {
    // MCSE = sd / √ESS, of the mean
    let ess_mean: Vec<f64> =
        rows.iter().map(|row| (row.summary.sd / row.summary.mcse).powi(2)).collect();
    LeaveOneOut::new(model, data, log_likelihood, (&ess_mean, at_once), shape)
}

fn predictive(
    model: &Model,
    predicted: Vec<Spool>,
    places: &[String],
    n_asked: [usize; 2],
) -> Group {
    let (predicted, by_draw) = (Arc::new(predicted), by_draw(n_asked));
    let mut from = 0;
    let variable = |observe: &Observe| {
        let n = observe.rows.len();
        let values = Columns::new(&predicted, from, n);
        from += n;
        let dim = row_dimension(observe);
        let dims = [by_draw[0], by_draw[1], (dim.as_str(), n)];
        Variable::new(observe.name, &observe.unit, &dims, values)
    };
    let mut variables: Vec<Variable> = model.observes.iter().map(variable).collect();
    let all = Columns::new(&predicted, 0, places.len());
    variables.extend(pooled(all, &by_draw, places));
    Group { name: "posterior_predictive".into(), variables }
}

fn row_dimension(observe: &Observe) -> String {
    format!("{}_row", observe.name)
}

fn sample_stats(chains: &[Chain], shape: [usize; 2]) -> Group {
    let dims = by_draw(shape);
    let floats = |name: &str, of: fn(&Chain) -> Vec<f64>| {
        Variable::new(name, "", &dims, chains.iter().flat_map(of).collect::<Vec<f64>>())
    };
    let integers = |name: &str, of: fn(&Chain) -> &[u32]| {
        let values = chains.iter().flat_map(|c| of(c).iter().map(|x| i64::from(*x)));
        Variable::new(name, "", &dims, values.collect::<Vec<i64>>())
    };
    let diverging: Vec<bool> = chains.iter().flat_map(|c| c.diverging.clone()).collect();
    let variables = vec![
        floats("lp", |c| c.ln_density.clone()),
        floats("energy", |c| c.energy.clone()),
        floats("acceptance_rate", |c| c.accept.clone()),
        floats("step_size", |c| vec![c.step_size; c.n_draws()]),
        integers("tree_depth", |c| &c.depth),
        integers("n_steps", |c| &c.n_leapfrog),
        Variable::new("diverging", "", &dims, diverging),
    ];
    Group { name: "sample_stats".into(), variables }
}

fn observed(model: &Model, places: &[String]) -> Group {
    let variable = |observe: &Observe| {
        let dim = row_dimension(observe);
        let values: Vec<f64> = observe.observed().iter().map(|cells| cells[0]).collect();
        Variable::new(observe.name, &observe.unit, &[(dim.as_str(), values.len())], values)
    };
    let mut variables: Vec<Variable> = model.observes.iter().map(variable).collect();
    let all: Vec<f64> =
        model.observes.iter().flat_map(Observe::observed).map(|cells| cells[0]).collect();
    variables.extend(pooled(all, &[], places));
    Group { name: "observed_data".into(), variables }
}

fn constant(model: &Model, data: &Measurements) -> Group {
    let mut variables = vec![];
    for observe in &model.observes {
        let dim = row_dimension(observe);
        let dims = [(dim.as_str(), observe.rows.len())];
        let cells = observe.observed();
        for (i, column) in observe.columns.iter().enumerate() {
            let values: Vec<f64> = cells.iter().map(|c| c[i]).collect();
            let name = format!("{}_{column}", observe.name);
            variables.push(Variable::new(name, &observe.unit, &dims, values));
        }
        if observe.rows.iter().all(|row| data.vertex(*row).is_some()) {
            let vertex = observe.rows.iter().filter_map(|row| data.vertex(*row)).map(i64::from);
            let name = format!("{}_vertex", observe.name);
            variables.push(Variable::new(name, "", &dims, vertex.collect::<Vec<i64>>()));
        }
    }
    Group { name: "constant_data".into(), variables }
}
