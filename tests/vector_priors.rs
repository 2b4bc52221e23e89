//! Vector priors in models: their posterior without data, and their draws, have their closed forms.

#![allow(clippy::unwrap_used, reason = "a test")]

mod support;
#[allow(dead_code, reason = "another test uses the rest")]
#[path = "models/vector_priors.rs"]
mod vector_priors;

use eplat::diagnostics::summarise;
use eplat::infer::{Chain, Settings, Silent, jittered_starts};
use eplat::model::{Declare, Model, Sampler};
use eplat::table::Measurements;
use support::rng;
use vector_priors::{alone, wrong};

/// Mean of a function of the reported numbers over the chains, its error, and what it should be.
fn assert_mean(model: &Model, chains: &[Chain], expected: f64, f: impl Fn(&[f64]) -> f64) {
    let (mut rng, mut tape) = (rng(99), model.tape());
    let mut of = |chain: &Chain| -> Vec<f64> {
        let mut value = |i| {
            let mut reported = vec![];
            model.forward(&mut tape, &chain.draw(i).unwrap());
            model.report(&tape, &mut rng, &mut reported);
            f(&reported)
        };
        (0..chain.n_draws()).map(&mut value).collect()
    };
    let values: Vec<Vec<f64>> = chains.iter().map(&mut of).collect();
    let s = summarise(&values.iter().map(Vec::as_slice).collect::<Vec<_>>());
    // 14 means in each of two tests, 0.1 % over all
    assert!((s.mean - expected).abs() < 4.2 * s.mcse, "{} ± {}: {expected}", s.mean, s.mcse);
}

/// The closed forms of every prior of the model `Alone`.
fn assert_closed_forms(model: &Model, chains: &[Chain]) {
    let check = |expected, f: fn(&[f64]) -> f64| assert_mean(model, chains, expected, f);
    // pair
    check(0.5, |x| x[0]);
    check(1.5, |x| (x[1] + 1.0).powi(2));
    check(-1.2, |x| (x[0] - 0.5) * (x[1] + 1.0));
    // l: every correlation is Beta(1.5, 1.5) on (−1, 1), of variance ¼, and no two go together
    let row = |x: &[f64]| x[2] * x[3] + x[4] * (1.0 - x[2] * x[2]).sqrt();
    assert_mean(model, chains, 0.0, row);
    assert_mean(model, chains, 0.25, |x| row(x).powi(2));
    check(0.25, |x| x[2] * x[2]);
    check(0.25, |x| x[3] * x[3]);
    assert_mean(model, chains, 0.0, |x| row(x) * x[2]);
    // shift: variance 4 (1 − ¼), covariance −1
    check(3.0, |x| x[5] * x[5]);
    check(3.0, |x| x[8] * x[8]);
    check(-1.0, |x| x[6] * x[8]);
    // walk: the variance of the third number is three steps'
    check(3.0 * 0.49, |x| x[11] * x[11]);
    check(0.49, |x| x[9] * x[11]);
}

#[test]
fn vectors_without_data_have_their_priors_moments() {
    let model = Model::new(&alone::Alone, None, &Measurements::default()).unwrap();
    assert_eq!(model.unknown_names().len(), 2 + 3 + 3 + 3);
    let settings = Settings { warmup: 500, draws: 2500, ..Settings::default() };
    let starts = jittered_starts(&model, &model.initial(), settings.chains, 1).unwrap();
    let chains = Sampler::of(&model).sample(&model, &starts, &settings, &Silent).unwrap();
    let chains: Vec<Chain> = chains.into_iter().map(Result::unwrap).collect();
    assert_closed_forms(&model, &chains);
}

#[test]
fn vectors_drawn_from_the_prior_have_its_moments() {
    let model = Model::new(&alone::Alone, None, &Measurements::default()).unwrap();
    let settings = Settings { draws: 4000, ..Settings::default() };
    assert_closed_forms(&model, &model.prior_draws(&settings).unwrap());
}

#[test]
fn what_is_no_density_or_of_another_length_is_refused() {
    let message = |model: &dyn Declare| {
        Model::new(model, None, &Measurements::default()).unwrap_err().to_string()
    };
    let said = message(&wrong::singular::Singular);
    assert!(said.starts_with("param pair: ") && said.contains("positive definite"), "{said}");
    let said = message(&wrong::triangle::Triangle);
    assert!(said.contains("its prior is of 6 numbers"), "{said}");
}
