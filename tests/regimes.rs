//! Whether chains get stuck: the blocked sampler on the default experiment of many seeds.
//!
//! ```text
//! cargo test --profile bench --test regimes -- --ignored --nocapture
//! SITES=10 SEEDS=7,11,15,17,19,20,31,56 RUNS=4 cargo test --profile bench --test regimes -- --ignored --nocapture
//! ```
//! `MODEL` is erp or exact, `SEEDS` are those of the experiment (1-40), `RUNS` how often each is sampled with other random
//! numbers, `TARGET` the acceptance aimed at. Prints of each run, and of all, the smallest effective sample size of
//! 4 × 1000 draws (bulk or tail), the same by CPU second with the warm-up, and which runs do not converge.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "support/posterior.rs"]
mod posterior;
#[path = "support/speed.rs"]
mod speed;

use std::env::var;

use eplat::experiment::{Design, TRUTH_MODES, experiment};
use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::manifold::eigenpairs_cached;
use eplat::mesh::left_atrium;
use eplat::model::{Declare, Model, Sampler};
use posterior::all;
use posterior::shipped::shipped;
use speed::{Figures, cpu_seconds};

#[test]
#[ignore = "a measurement, 2 minutes"]
fn no_seed_is_stuck() {
    let n_sites = var("SITES").map_or(10, |sites| sites.parse().unwrap());
    let seeds = var("SEEDS").unwrap_or("1-40".into());
    let runs = var("RUNS").map_or(1, |runs| runs.parse().unwrap());
    let declared: &dyn Declare = match var("MODEL").as_deref() {
        Err(_) | Ok("erp") => shipped("erp"),
        Ok("exact") => shipped("erp_exact"),
        Ok(other) => panic!("MODEL={other}: expected erp or exact"),
    };
    let mesh = left_atrium(1.5).mesh;
    let basis = eigenpairs_cached(&mesh, TRUTH_MODES).unwrap();
    let (mut least, mut rates, mut refused) = (vec![], vec![], vec![]);
    for (seed, run) in
        numbers(&seeds).into_iter().flat_map(|seed| (0..runs).map(move |run| (seed, run)))
    {
        let design = Design { n_sites, seed, ..Design::default() };
        let data = experiment(declared, &mesh, &basis, &design).unwrap().measurements;
        let model = Model::new(declared, Some(&basis), &data).unwrap();
        let target_accept = var("TARGET").ok().map(|target| target.parse().unwrap());
        let settings =
            Settings { seed: seed + 1000 * run, threads: 1, target_accept, ..Settings::default() };
        let begun = cpu_seconds();
        let starts = jittered_starts(&model, &model.initial(), settings.chains, seed).unwrap();
        let chains = all(Sampler::Blocked.sample(&model, &starts, &settings, &Silent).unwrap());
        let figures = Figures::new(&model, &chains, cpu_seconds() - begun);
        println!("seed {seed}: {figures}");
        let ess = figures.bulk.min(figures.tail);
        if figures.r_hat > 1.01 || ess < 400.0 {
            refused.push(seed);
        }
        least.push(ess);
        rates.push(ess / figures.cpu);
    }
    for (what, values) in [("ESS", &mut least), ("ESS per CPU second", &mut rates)] {
        values.sort_by(f64::total_cmp);
        let [worst, middle] = [values[0], values[values.len() / 2]];
        println!("{n_sites} sites, smallest {what}: median {middle:.0}, worst {worst:.0}");
    }
    println!("refused: {refused:?}");
    assert!(refused.is_empty());
}

/// The numbers of a list such as `1-3,7`.
fn numbers(list: &str) -> Vec<u64> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        first.parse().unwrap()..=last.parse::<u64>().unwrap()
    };
    list.split(',').flat_map(range).collect()
}
