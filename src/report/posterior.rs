//! Draws of unknowns as what they mean: parameters, log likelihoods, replicated measurements.

use std::io;
use std::path::Path;
use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::columns::{Sink, Table, parts};
use super::quantities::Quantities;
use super::{Columns, Group, LeaveOneOut, Row, Values, Variable};
use crate::infer::Chain;
use crate::model::{Model, Observe};
use crate::random::Stream;
use crate::table::Measurements;

/// All measurements together, and their dimension.
const POOLED: &str = "measurements";
const POOLED_DIM: &str = "measurement";

/// Numbers that the log likelihoods of all measurements may have, and so may their replicates: 64 MB. Of a table with
/// more than two thousand rows not every draw is asked.
const MOST: usize = 8_000_000;

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
    /// table, of every second, third … draw.
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

/// What is asked of every `step`-th draw, of all chains (chain, draw, measurement): 64 MB each, so that they are made
/// where they stay.
struct Asked {
    step: usize,
    log_likelihood: Vec<f64>,
    predicted: Vec<f64>,
}

impl Posterior {
    /// From chains of equal length; `seed` is the run's.
    #[allow(clippy::expect_used, reason = "nothing is read or written")]
    pub fn new(model: &Model, data: &Measurements, chains: &[Chain], seed: u64) -> Self {
        Self::made(model, data, chains, seed, None).expect("no disk is used")
    }

    /// The same to the last bit, in less memory and more time: [`Posterior::posterior`] is on the disk of `folder`, in
    /// files without names that go with it.
    ///
    /// # Errors
    /// From the disk.
    pub fn on_disk(
        model: &Model,
        data: &Measurements,
        chains: &[Chain],
        seed: u64,
        folder: &Path,
    ) -> io::Result<Self> {
        Self::made(model, data, chains, seed, Some(folder))
    }

    fn made(
        model: &Model,
        data: &Measurements,
        chains: &[Chain],
        seed: u64,
        folder: Option<&Path>,
    ) -> io::Result<Self> {
        let shape = [chains.len(), chains.first().map_or(0, Chain::n_draws)];
        let places = places(model, data);
        let step = (places.len() * shape[0] * shape[1]).div_ceil(MOST).max(1);
        // densities come last: nothing is simulated from them
        let observed_places = &places[..model.observes.iter().map(|o| o.rows.len()).sum()];
        let n_asked = [shape[0], shape[1].div_ceil(step)];
        let room = |places: &[String]| vec![0.0; n_asked[0] * n_asked[1] * places.len()];
        let mut asked =
            Asked { step, log_likelihood: room(&places), predicted: room(observed_places) };
        let quantities = Quantities::of(model);
        let reported = Table::filled([shape[0], shape[1], quantities.width()], folder, |sinks| {
            asked.fill(model, chains, seed, sinks)
        })?;
        let posterior = quantities.variables(&Arc::new(reported), shape);
        // of what is on disk one column at a time is in memory
        let at_once = if folder.is_some() { usize::MAX } else { 1 };
        let (rows, strays) = quantities.summaries(&posterior, shape[1], at_once)?;
        let log_likelihood = log_likelihood(asked.log_likelihood, &places, n_asked);
        Ok(Self {
            posterior,
            loo: leave_one_out(model, data, &log_likelihood, &rows, shape),
            rows,
            strays,
            sample_stats: sample_stats(chains, shape),
            log_likelihood,
            posterior_predictive: predictive(model, asked.predicted, observed_places, n_asked),
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

impl Asked {
    /// Makes them, and writes what is reported of every draw (draw, number of all quantities) to the `sinks`, one for
    /// each chain.
    fn fill<'t>(
        &mut self,
        model: &Model,
        chains: &[Chain],
        seed: u64,
        sinks: Vec<Sink<'t>>,
    ) -> io::Result<Vec<Sink<'t>>> {
        let step = self.step;
        let of_chain = |(i, (((chain, sink), log_likelihood), predicted))| {
            let rng = Stream::AfterSampling(i).rng(seed);
            drawn(model, chain, step, rng, sink, [log_likelihood, predicted])
        };
        let parts = chains
            .iter()
            .zip(sinks)
            .zip(parts(&mut self.log_likelihood, chains.len()))
            .zip(parts(&mut self.predicted, chains.len()));
        parts.collect::<Vec<_>>().into_par_iter().enumerate().map(of_chain).collect()
    }
}

/// Writes what is reported of the draws of a chain to its `sink`, and likelihoods and replicates of every `step`-th.
fn drawn<'t>(
    model: &Model,
    chain: &Chain,
    step: usize,
    mut rng: ChaCha8Rng,
    mut sink: Sink<'t>,
    [log_likelihood, predicted]: [&mut [f64]; 2],
) -> io::Result<Sink<'t>> {
    let (mut tape, mut reported) = (model.tape(), vec![]);
    let (mut pointwise, mut replicates): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    for i in 0..chain.n_draws() {
        let is_asked = i.is_multiple_of(step);
        if is_asked {
            model.forward(&mut tape, chain.draw(i));
        } else {
            model.forward_reported(&mut tape, chain.draw(i));
        }
        reported.clear();
        model.report(&tape, &mut rng, &mut reported);
        model.let_values(&tape, &mut reported);
        sink.push(&reported)?;
        if !is_asked {
            continue;
        }
        pointwise.clear();
        model.pointwise(&tape, &mut pointwise);
        replicates.clear();
        for observe in &model.observes {
            let simulated = observe.simulate(&tape, &mut rng);
            replicates.extend(simulated.iter().map(|cells| cells[0]));
        }
        let (n, m) = (pointwise.len(), replicates.len());
        log_likelihood[i / step * n..][..n].copy_from_slice(&pointwise);
        predicted[i / step * m..][..m].copy_from_slice(&replicates);
    }
    Ok(sink)
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

fn log_likelihood(values: Vec<f64>, places: &[String], [chains, draws]: [usize; 2]) -> Group {
    let variables = pooled(values, &[("chain", chains), ("draw", draws)], places);
    Group { name: "log_likelihood".into(), variables }
}

fn leave_one_out(
    model: &Model,
    data: &Measurements,
    log_likelihood: &Group,
    rows: &[Row],
    shape: [usize; 2],
) -> Option<LeaveOneOut> {
    let Values::Float(values) = &log_likelihood.variables.first()?.values else { return None };
    // MCSE = sd / √ESS, of the mean
    let ess_mean: Vec<f64> =
        rows.iter().map(|row| (row.summary.sd / row.summary.mcse).powi(2)).collect();
    LeaveOneOut::new(model, data, values, &ess_mean, shape)
}

fn predictive(
    model: &Model,
    predicted: Vec<f64>,
    places: &[String],
    [chains, draws]: [usize; 2],
) -> Group {
    let all = Arc::new(predicted);
    let table = Arc::new(Table::of(Arc::clone(&all), places.len(), draws));
    let mut from = 0;
    let variable = |observe: &Observe| {
        let n = observe.rows.len();
        let values = Columns::new(&table, from, n);
        from += n;
        let dim = row_dimension(observe);
        let dims = [("chain", chains), ("draw", draws), (dim.as_str(), n)];
        Variable::new(observe.name, &observe.unit, &dims, values)
    };
    let mut variables: Vec<Variable> = model.observes.iter().map(variable).collect();
    variables.extend(pooled(all, &[("chain", chains), ("draw", draws)], places));
    Group { name: "posterior_predictive".into(), variables }
}

fn row_dimension(observe: &Observe) -> String {
    format!("{}_row", observe.name)
}

fn sample_stats(chains: &[Chain], [n, draws]: [usize; 2]) -> Group {
    let dims = [("chain", n), ("draw", draws)];
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
