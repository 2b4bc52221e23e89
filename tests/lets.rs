//! What is reported of a `let`: the value of its expression at every draw, row by row or label by label.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "models/language.rs"]
#[allow(dead_code, reason = "one of its models is sampled here")]
mod language;
#[path = "support/shipped.rs"]
mod shipped;
mod support;

use eplat::infer::{Settings, Silent, jittered_starts, sample};
use eplat::manifold::Basis;
use eplat::model::{Declare, Model};
use eplat::report::{Group, Posterior};
use eplat::table::Measurements;
use shipped::shipped;
use support::table;

fn posterior(model: &dyn Declare, basis: Option<&Basis>, data: &Measurements) -> Posterior {
    let model = Model::new(model, basis, data).unwrap();
    let settings = Settings { chains: 2, warmup: 60, draws: 10, ..Settings::default() };
    let starts = jittered_starts(&model, &model.initial(), settings.chains, 1).unwrap();
    let chains = sample(&model, &starts, &settings, &Silent).unwrap();
    let chains: Vec<_> = chains.into_iter().map(Result::unwrap).collect();
    Posterior::new(&model, data, &chains, 1, None).unwrap()
}

/// (draw of both chains, element)
fn values(group: &Group, name: &str) -> Vec<Vec<f64>> {
    let variable = group.variables.iter().find(|v| v.name == name).unwrap();
    let values = variable.values.floats().unwrap().unwrap();
    values.chunks_exact(values.len() / 20).map(<[f64]>::to_vec).collect()
}

fn labels(posterior: &Posterior, name: &str) -> Vec<String> {
    let starts = |row: &&eplat::report::Row| row.name.split('[').next() == Some(name);
    posterior.rows.iter().filter(starts).map(|row| row.name.clone()).collect()
}

/// Two rows of one school: it has one theta all the same.
#[test]
fn a_let_of_a_label_is_reported_once_for_each() {
    let rows = ["B,10,9", "A,-3,15", "B,12,4"].map(String::from);
    let data = table("school,effect_size,se", &rows);
    let posterior = posterior(shipped("eight_schools"), None, &data);
    assert_eq!(labels(&posterior, "theta"), ["theta[B]", "theta[A]"]);
    let [theta, mu, tau, z] =
        ["theta", "mu", "tau", "z"].map(|name| values(&posterior.posterior, name));
    for draw in 0..20 {
        for school in 0..2 {
            let by_hand = mu[draw][0] + tau[draw][0] * z[draw][school];
            assert!((theta[draw][school] - by_hand).abs() < 1e-12);
        }
    }
}

mod forms {
    use eplat::prelude::*;
    model! {
        model Forms;
        column x;
        param a ~ Normal(0.0, 1.0);
        param b(group) ~ Normal(0.0, 1.0);
        param beta(2) ~ Normal(0.0, 1.0);
        let twice(row) = a * 2.0;
        let line(row) = linear(row.u, row.v; beta);
        let sum(row) = line(row) + b(row) * row.x + twice(row);
        effect shift on sum = linear(row.w) ~ Normal(0.0, 1.0);
        observe y(row): Number ~ Normal(sum(row), 1.0);
    }
}

#[test]
fn lets_of_rows_have_linear_predictors_earlier_lets_and_effects_in_them() {
    let rows = ["1,2,3,4,p,0.5", "-1,0.5,2,-3,q,1.5", "2,1,1,0,p,0.1"].map(String::from);
    let data = table("x,u,v,w,group,y", &rows);
    let posterior = posterior(&forms::Forms, None, &data);
    assert_eq!(labels(&posterior, "twice"), ["twice"]);
    assert_eq!(labels(&posterior, "sum"), ["sum[line 2]", "sum[line 3]", "sum[line 4]"]);
    let [a, b, beta, shift, twice, line, sum] = ["a", "b", "beta", "shift", "twice", "line", "sum"]
        .map(|name| values(&posterior.posterior, name));
    let table = [[1.0, 2.0, 3.0, 4.0], [-1.0, 0.5, 2.0, -3.0], [2.0, 1.0, 1.0, 0.0]];
    for i in 0..20 {
        for (row, [x, u, v, w]) in table.into_iter().enumerate() {
            let predictor = beta[i][0] * u + beta[i][1] * v;
            assert!((line[i][row] - predictor).abs() < 1e-12);
            let by_hand = predictor + b[i][row % 2] * x + 2.0 * a[i][0] + shift[i][0] * w;
            assert!((sum[i][row] - by_hand).abs() < 1e-12, "row {row}");
        }
        assert!((twice[i][0] - 2.0 * a[i][0]).abs() < 1e-12);
    }
}

#[test]
fn lets_of_many_rows_are_left_to_the_replicates() {
    let rows: Vec<String> = (0..201).map(|i| format!("{i},1,1,1,p,0")).collect();
    let posterior = posterior(&forms::Forms, None, &table("x,u,v,w,group,y", &rows));
    assert_eq!(labels(&posterior, "twice"), ["twice"]);
    assert!(labels(&posterior, "sum").is_empty() && labels(&posterior, "line").is_empty());
}

/// What depends on a place alone is a map; what reads a row of a model with fields is not.
#[test]
fn lets_beside_fields_have_the_values_that_their_measurements_see() {
    let data = support::mixed_rows();
    let posterior = posterior(&language::mixed::Mixed, Some(&support::basis(200, 24)), &data);
    // base: rows of s1s2, open, direct and beats; log_rate: those of beats
    assert_eq!(labels(&posterior, "base").len(), 40);
    let (rate, shifted) = (values(&posterior.posterior, "log_rate"), labels(&posterior, "shifted"));
    assert_eq!((rate[0].len(), shifted.len()), (10, 30));
    let [scale, pace, shifted] =
        ["scale", "pace", "shifted"].map(|name| values(&posterior.posterior, name));
    // the last row of the table is of beats, and the last of `shifted` too
    let force = data.number(49, "force_g", "the test").unwrap();
    for draw in 0..20 {
        let by_hand =
            shifted[draw][29] / 100.0 + scale[draw][1] * scale[draw][2] + pace[draw][0] * force;
        assert!((rate[draw][9] - by_hand).abs() < 1e-9);
    }
}
