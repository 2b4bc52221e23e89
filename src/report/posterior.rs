//! Draws of unknowns as what they mean: parameters, log likelihoods, replicated measurements.

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::text::after_number;
use super::{Group, LeaveOneOut, MAX_R_HAT, Row, Values, Variable};
use crate::diagnostics::{Stray, stray, summarise};
use crate::infer::Chain;
use crate::model::{Kind, LetValues, Model, Observe, Parameter};
use crate::random::Stream;
use crate::table::Measurements;

/// All measurements together, and their dimension.
const POOLED: &str = "measurements";
const POOLED_DIM: &str = "measurement";

/// Numbers that the log likelihoods of all measurements may have, and so may their replicates: 64 MB. Of a table with
/// more than two thousand rows not every draw is asked.
const MOST: usize = 8_000_000;

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

/// One chain's draws.
#[derive(Default)]
struct Drawn {
    /// (draw, number of all quantities)
    reported: Vec<f64>,
    /// (draw, measurement of all `observe`s)
    log_likelihood: Vec<f64>,
    /// (draw, measurement of all `observe`s)
    predicted: Vec<f64>,
}

impl Posterior {
    /// From chains of equal length; `seed` is the run's.
    pub fn new(model: &Model, data: &Measurements, chains: &[Chain], seed: u64) -> Self {
        let shape = [chains.len(), chains.first().map_or(0, Chain::n_draws)];
        let places = places(model, data);
        let step = (places.len() * shape[0] * shape[1]).div_ceil(MOST).max(1);
        let of_chain = |(i, chain): (usize, &Chain)| {
            drawn(model, chain, step, Stream::AfterSampling(i).rng(seed))
        };
        let drawn: Vec<Drawn> = chains.par_iter().enumerate().map(of_chain).collect();
        let quantities: Vec<Quantity<'_>> = quantities(model).collect();
        let posterior = variables(&quantities, &drawn, shape);
        let (rows, strays) = rows(&quantities, &posterior, shape);
        let asked = [shape[0], shape[1].div_ceil(step)];
        let log_likelihood = log_likelihood(&drawn, &places, asked);
        // densities come last: nothing is simulated from them
        let observed_places = &places[..model.observes.iter().map(|o| o.rows.len()).sum()];
        Self {
            posterior,
            loo: leave_one_out(model, data, &log_likelihood, &rows, shape),
            rows,
            strays,
            sample_stats: sample_stats(chains, shape),
            log_likelihood,
            posterior_predictive: predictive(model, &drawn, observed_places, asked),
            observed_data: observed(model, observed_places),
            constant_data: constant(model, data),
        }
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

/// The draws of a chain; likelihoods and replicates of every `step`-th.
fn drawn(model: &Model, chain: &Chain, step: usize, mut rng: ChaCha8Rng) -> Drawn {
    let (mut tape, mut out) = (model.tape(), Drawn::default());
    for i in 0..chain.n_draws() {
        model.forward(&mut tape, chain.draw(i));
        model.report(&tape, &mut rng, &mut out.reported);
        model.let_values(&tape, &mut out.reported);
        if !i.is_multiple_of(step) {
            continue;
        }
        model.pointwise(&tape, &mut out.log_likelihood);
        for observe in &model.observes {
            let replicate = observe.simulate(&tape, &mut rng);
            out.predicted.extend(replicate.iter().map(|cells| cells[0]));
        }
    }
    out
}

/// Elements `from..from + len` of every draw's `width` numbers, chain after chain.
fn columns(
    drawn: &[Drawn],
    part: fn(&Drawn) -> &[f64],
    width: usize,
    from: usize,
    len: usize,
) -> Vec<f64> {
    let rows = drawn.iter().flat_map(|d| part(d).chunks_exact(width.max(1)));
    rows.flat_map(|row| &row[from..from + len]).copied().collect()
}

/// A parameter, or a `let` that is no map.
struct Quantity<'m> {
    name: &'m str,
    unit: &'m str,
    len: usize,
    labels: &'m [String],
    is_vector: bool,
}

impl<'m> Quantity<'m> {
    fn of_parameter(p: &'m Parameter) -> Self {
        let is_vector = p.kind != Kind::Scalar;
        Self { name: &p.name, unit: &p.unit, len: p.len, labels: &p.labels, is_vector }
    }

    fn of_let(l: &'m LetValues) -> Self {
        let is_vector = !l.labels.is_empty();
        Self { name: l.name, unit: &l.unit, len: l.len, labels: &l.labels, is_vector }
    }

    /// Name of its `i`-th number.
    fn element(&self, i: usize) -> String {
        match (self.is_vector, self.labels.get(i)) {
            (false, _) => self.name.to_owned(),
            (true, Some(label)) => format!("{}[{label}]", self.name),
            (true, None) => format!("{}[{i}]", self.name),
        }
    }
}

fn quantities(model: &Model) -> impl Iterator<Item = Quantity<'_>> {
    let parameters = model.parameters.iter().map(Quantity::of_parameter);
    parameters.chain(model.lets.iter().map(Quantity::of_let))
}

fn variables(quantities: &[Quantity<'_>], drawn: &[Drawn], [chains, draws]: [usize; 2]) -> Group {
    let (width, mut from) = (quantities.iter().map(|q| q.len).sum(), 0);
    let mut variables = vec![];
    for q in quantities {
        let values = columns(drawn, |d| &d.reported, width, from, q.len);
        from += q.len;
        let dim = format!("{}_dim", q.name);
        let mut dims = vec![("chain", chains), ("draw", draws)];
        if q.is_vector {
            dims.push((&dim, q.len));
        }
        variables.push(Variable::new(q.name, q.unit, &dims, values));
        if !q.labels.is_empty() {
            variables.push(Variable::new(&dim, "", &[(&dim, q.len)], q.labels.to_vec()));
        }
    }
    Group { name: "posterior".into(), variables }
}

/// All summaries, and where the chains disagree on the worst of them.
fn rows(
    quantities: &[Quantity<'_>],
    posterior: &Group,
    [chains, draws]: [usize; 2],
) -> (Vec<Row>, Option<String>) {
    let mut jobs = vec![];
    for q in quantities {
        let variable = posterior.variables.iter().find(|v| v.name == q.name);
        let Some(Values::Float(values)) = variable.map(|v| &v.values) else { continue };
        jobs.extend((0..q.len).map(|i| (q, i, values)));
    }
    let row = |(q, i, values): &(&Quantity<'_>, usize, &Vec<f64>)| {
        let column: Vec<f64> = values.iter().skip(*i).step_by(q.len).copied().collect();
        let chains: Vec<&[f64]> = column.chunks_exact(draws.max(1)).take(chains).collect();
        let row = Row { name: q.element(*i), unit: q.unit.to_owned(), summary: summarise(&chains) };
        let strays = (row.summary.r_hat > MAX_R_HAT).then(|| strays(&row, &chains)).flatten();
        (row, strays)
    };
    let (rows, strays): (Vec<Row>, Vec<Option<String>>) = jobs.par_iter().map(row).unzip();
    let worst = rows.iter().zip(strays).filter(|(row, _)| !row.summary.r_hat.is_nan());
    let worst = worst.max_by(|(a, _), (b, _)| a.summary.r_hat.total_cmp(&b.summary.r_hat));
    let strays = worst.and_then(|(_, strays)| strays);
    (rows, strays)
}

/// Where the chains disagree on one quantity, in words.
fn strays(row: &Row, chains: &[&[f64]]) -> Option<String> {
    let Stray { chain, draws, mean, rest_mean, rest_sd } = stray(chains)?;
    let unit = after_number(&row.unit);
    Some(format!(
        "chain {} in its draws {} to {}, where {} is {mean:.3}{unit}, elsewhere {rest_mean:.3} ± {rest_sd:.3}",
        chain + 1,
        draws.start + 1,
        draws.end,
        row.name
    ))
}

/// Where each measurement was made, in words.
fn places(model: &Model, data: &Measurements) -> Vec<String> {
    let of = |(name, rows): (&str, &[usize])| -> Vec<String> {
        rows.iter().map(|row| format!("{name} {}", data.place(*row))).collect()
    };
    model.measured().flat_map(of).collect()
}

/// All measurements together, over `dims` and the measurement, with its labels; nothing without measurements.
fn pooled(values: Vec<f64>, dims: &[(&str, usize)], places: &[String]) -> Vec<Variable> {
    if places.is_empty() {
        return vec![];
    }
    let measurement = [(POOLED_DIM, places.len())];
    vec![
        Variable::new(POOLED, "", &[dims, &measurement].concat(), values),
        Variable::new(POOLED_DIM, "", &measurement, places.to_vec()),
    ]
}

fn log_likelihood(drawn: &[Drawn], places: &[String], [chains, draws]: [usize; 2]) -> Group {
    let n = places.len();
    let values = columns(drawn, |d| &d.log_likelihood, n, 0, n);
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
    drawn: &[Drawn],
    places: &[String],
    [chains, draws]: [usize; 2],
) -> Group {
    let width = places.len();
    let mut from = 0;
    let variable = |observe: &Observe| {
        let n = observe.rows.len();
        let values = columns(drawn, |d| &d.predicted, width, from, n);
        from += n;
        let dim = row_dimension(observe);
        let dims = [("chain", chains), ("draw", draws), (dim.as_str(), n)];
        Variable::new(observe.name, &observe.unit, &dims, values)
    };
    let mut variables: Vec<Variable> = model.observes.iter().map(variable).collect();
    let all = columns(drawn, |d| &d.predicted, width, 0, width);
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
