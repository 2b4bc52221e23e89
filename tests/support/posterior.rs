//! Posteriors as tables, for tests of samplers: columns per reported number, their summaries, z-scores.
#![allow(clippy::unwrap_used, reason = "for tests")]
#![allow(dead_code, reason = "each test uses a part of it")]

use eplat::diagnostics::{Summary, mcse_mean, mcse_sd, summarise};
use eplat::experiment::{Design, TRUTH_MODES, experiment};
use eplat::infer::{Chain, ChainResult};
use eplat::manifold::{Basis, eigenpairs_cached};
use eplat::mesh::{TriMesh, left_atrium};
use eplat::model::{Declare, Model};
use eplat::table::Measurements;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[path = "shipped.rs"]
pub(crate) mod shipped;

/// The main job's experiment on the embedded atrium, with this many sites.
pub(crate) fn erp_experiment(n_sites: usize) -> (Basis, Measurements) {
    experiment_on(&left_atrium(1.5).mesh, shipped::shipped("erp"), n_sites)
}

/// A model's experiment on this surface, with this many sites.
pub(crate) fn experiment_on(
    mesh: &TriMesh,
    model: &dyn Declare,
    n_sites: usize,
) -> (Basis, Measurements) {
    let basis = eigenpairs_cached(mesh, TRUTH_MODES).unwrap();
    let design = Design { n_sites, ..Design::default() };
    let made = experiment(model, mesh, &basis, &design).unwrap();
    (basis, made.measurements)
}

/// Every reported number: its name and its draws, chain by chain.
pub(crate) struct Column {
    pub(crate) name: String,
    pub(crate) chains: Vec<Vec<f64>>,
}

impl Column {
    pub(crate) fn summary(&self) -> Summary {
        summarise(&self.slices())
    }
    pub(crate) fn slices(&self) -> Vec<&[f64]> {
        self.chains.iter().map(Vec::as_slice).collect()
    }
}

/// The chains of a result that must all have come through.
pub(crate) fn all(chains: Vec<ChainResult>) -> Vec<Chain> {
    chains.into_iter().map(|chain| chain.unwrap_or_else(|e| panic!("{e}"))).collect()
}

/// All reported numbers of all draws; the constant modes are drawn with a stream of their own.
pub(crate) fn columns(model: &Model, chains: &[Chain]) -> Vec<Column> {
    let names = model.parameters.iter().flat_map(|p| (0..p.len).map(|i| p.element(i)));
    let mut columns: Vec<Column> =
        names.map(|name| Column { name, chains: vec![vec![]; chains.len()] }).collect();
    let (mut tape, mut values) = (model.tape(), vec![]);
    let mut rng = ChaCha8Rng::seed_from_u64(99);
    for (c, chain) in chains.iter().enumerate() {
        for i in 0..chain.n_draws() {
            model.forward(&mut tape, &chain.draw(i).unwrap());
            values.clear();
            model.report(&tape, &mut rng, &mut values);
            for (column, x) in columns.iter_mut().zip(&values) {
                column.chains[c].push(*x);
            }
        }
    }
    columns
}

/// Mean and standard deviation of f(draw) with their Monte Carlo errors.
pub(crate) fn moments(column: &Column, f: impl Fn(f64) -> f64) -> [(f64, f64); 2] {
    let chains: Vec<Vec<f64>> =
        column.chains.iter().map(|c| c.iter().map(|x| f(*x)).collect()).collect();
    let slices: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
    let (mean, sd) = eplat::diagnostics::mean_and_sd(&slices);
    [(mean, mcse_mean(&slices)), (sd, mcse_sd(&slices))]
}

/// The largest |z| between two posteriors over all means and standard deviations, and whose it is.
///
/// Numbers are compared through asinh, which is the identity near 0 and tames heavy tails, whose
/// moments need not exist.
pub(crate) fn largest_z(a: &[Column], b: &[Column]) -> (f64, String) {
    let mut worst = (0.0, String::new());
    for (a, b) in a.iter().zip(b) {
        for ((x, ex), (y, ey)) in moments(a, f64::asinh).into_iter().zip(moments(b, f64::asinh)) {
            let z = (x - y) / ex.hypot(ey);
            if z.abs() > worst.0 || z.is_nan() {
                worst = (z.abs(), format!("{}: {x} against {y}, z = {z:.2}", a.name));
            }
        }
    }
    worst
}
