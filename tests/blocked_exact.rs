//! The blocked sampler against NUTS on the ERP model: every reported number, means and spreads.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "models/language.rs"]
#[allow(dead_code, reason = "one of its models is sampled here")]
mod language;
#[path = "support/posterior.rs"]
mod posterior;
mod support;

use eplat::diagnostics::{mcse_mean, mcse_quantile, mcse_sd, mean_and_sd, quantile};
use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::model::{Model, Sampler};
use posterior::shipped::shipped;
use posterior::{Column, all, columns, erp_experiment, largest_z};

/// Two-sided 0.1 % over the hundred or so comparisons of two posteriors.
const LARGEST_Z: f64 = 4.5;

fn sample(sampler: Sampler, n_sites: usize, settings: &Settings) -> Vec<Column> {
    let (basis, measurements) = erp_experiment(n_sites);
    let model = Model::new(shipped("erp"), Some(&basis), &measurements).unwrap();
    sample_model(sampler, &model, settings)
}

fn sample_model(sampler: Sampler, model: &Model, settings: &Settings) -> Vec<Column> {
    let Settings { chains, seed, .. } = *settings;
    let starts = jittered_starts(model, &model.initial(), chains, seed).unwrap();
    columns(model, &all(sampler.sample(model, &starts, settings, &Silent).unwrap()))
}

/// Both posteriors, NUTS with this many draws per chain.
fn both(n_sites: usize, draws: usize) -> [Vec<Column>; 2] {
    let settings = Settings { draws, ..Settings::default() };
    let nuts = sample(Sampler::Nuts, n_sites, &settings);
    let blocked = sample(Sampler::Blocked, n_sites, &settings);
    let r_hat = blocked.iter().map(|c| c.summary().r_hat).fold(0.0, f64::max);
    assert!(r_hat < 1.01, "{n_sites} sites: R-hat {r_hat}");
    [blocked, nuts]
}

/// Quartiles and medians: with ten sites the amplitudes' tails are those of a power law (index 2),
/// and NUTS, which enters them seldom and stays long, has no usable error estimate there.
#[test]
fn ten_sites_fewer_than_modes_agree_with_nuts() {
    let [blocked, nuts] = both(10, 2000);
    compare_quartiles(&blocked, &nuts);
}

fn compare_quartiles(blocked: &[Column], nuts: &[Column]) {
    for (a, b) in blocked.iter().zip(nuts) {
        for probability in [0.25, 0.5, 0.75] {
            let [(x, ex), (y, ey)] = [a, b].map(|column| {
                let slices = column.slices();
                let mut all: Vec<f64> = column.chains.concat();
                all.sort_by(f64::total_cmp);
                (quantile(&all, probability), mcse_quantile(&slices, probability))
            });
            let z = ((x - y) / ex.hypot(ey)).abs();
            assert!(z < LARGEST_Z, "{} at {probability}: {x} against {y}, z = {z}", a.name);
        }
    }
}

#[test]
fn thirty_sites_more_than_modes_agree_with_nuts() {
    let [blocked, nuts] = both(30, 1000);
    let (z, what) = largest_z(&blocked, &nuts);
    assert!(z < LARGEST_Z, "{what}");
}

#[test]
fn constant_modes_are_standard_normal() {
    let columns = sample(Sampler::Blocked, 10, &Settings::default());
    for column in columns.iter().filter(|c| c.name.ends_with("eta[0]")) {
        let slices = column.slices();
        let (mean, sd) = mean_and_sd(&slices);
        assert!((mean / mcse_mean(&slices)).abs() < LARGEST_Z, "{}: {mean}", column.name);
        assert!(((sd - 1.0) / mcse_sd(&slices)).abs() < LARGEST_Z, "{}: {sd}", column.name);
    }
}

/// Two terms in a field, a mean with a prior, labels, effects, noise: much that is not in the block.
#[test]
fn everything_mixed_agrees_with_nuts() {
    let basis = support::basis(200, 24);
    let model = Model::new(&language::mixed::Mixed, Some(&basis), &support::mixed_rows()).unwrap();
    let settings = Settings { target_accept: Some(0.9), ..Settings::default() };
    let blocked = sample_model(Sampler::Blocked, &model, &settings);
    let nuts = sample_model(Sampler::Nuts, &model, &settings);
    compare_quartiles(&blocked, &nuts);
}
