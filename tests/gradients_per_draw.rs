//! What an effective draw costs in gradients: plain NUTS beside nuts-rs on nine models without
//! fields. Counts, not times, so they are the same on every machine.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]
#![allow(clippy::disallowed_types, reason = "nuts-rs asks for a HashMap")]

#[path = "models/posteriors.rs"]
#[allow(dead_code, reason = "other tests use the rest")]
mod models;
#[path = "support/nuts_rs.rs"]
mod nuts_rs_chain;
#[path = "support/posterior.rs"]
mod posterior;
mod support;

use std::env::var;

use eplat::infer::{Chain, Settings, Silent, jittered_starts, sample};
use eplat::model::{Declare, Model};
use eplat::table::Measurements;
use posterior::shipped::shipped;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use support::{rng, table};

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    rng.sample(StandardNormal)
}

/// A table of as many rows, each by `row`.
fn rows(
    header: &str,
    n: usize,
    seed: u64,
    row: impl Fn(usize, &mut ChaCha8Rng) -> Vec<f64>,
) -> Measurements {
    let mut rng = rng(seed);
    let line = |i| row(i, &mut rng).iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    table(header, &(0..n).map(line).collect::<Vec<_>>())
}

fn series(
    seed: u64,
    n: usize,
    mut next: impl FnMut(&[f64], &mut ChaCha8Rng) -> f64,
) -> Measurements {
    let (mut rng, mut y) = (rng(seed), vec![]);
    for _ in 0..n {
        let value = next(&y, &mut rng);
        y.push(value);
    }
    table("y", &y.iter().map(f64::to_string).collect::<Vec<_>>())
}

fn columns_and_sum(n: usize, columns: usize, seed: u64, shared: f64) -> Measurements {
    let header: Vec<String> = (1..=columns).map(|k| format!("x{k}")).collect();
    rows(&format!("{},y", header.join(",")), n, seed, |_, rng| {
        let common = normal(rng);
        let x: Vec<f64> = (0..columns)
            .map(|_| shared * common + (1.0 - shared * shared).sqrt() * normal(rng))
            .collect();
        let y = 2.0 * x[1] - x[2] + 1.5 * normal(rng);
        [&x[..], &[y]].concat()
    })
}

/// The models and their tables.
fn problems() -> Vec<(&'static str, &'static dyn Declare, Measurements)> {
    let schools = [
        (28.0, 15.0),
        (8.0, 10.0),
        (-3.0, 16.0),
        (7.0, 11.0),
        (-1.0, 9.0),
        (1.0, 11.0),
        (18.0, 10.0),
        (12.0, 18.0),
    ];
    let schools: Vec<String> =
        schools.iter().enumerate().map(|(i, (y, se))| format!("{i},{y},{se}")).collect();
    let mut variance = 0.25;
    vec![
        ("eight schools", shipped("eight_schools"), table("school,effect_size,se", &schools)),
        (
            "autoregression",
            &models::autoregression::Autoregression,
            series(21, 82, |y, rng| match y {
                [.., b, a] => 0.2 + 0.6 * a - 0.3 * b + 0.7 * normal(rng),
                _ => 0.1,
            }),
        ),
        (
            "garch",
            shipped("garch"),
            series(23, 150, |y, rng| {
                if let Some(y) = y.last() {
                    variance = 1.5 + 0.5 * (y - 5.0f64).powi(2) + 0.3 * variance;
                }
                5.0 + f64::sqrt(variance) * normal(rng)
            }),
        ),
        (
            "curve",
            &models::curve::Curve,
            rows("x,y", 11, 24, |i, rng| {
                let x = 2.0 * i as f64 - 10.0;
                vec![x, 2.0 * (x / 4.0).sin() + 0.5 * normal(rng)]
            }),
        ),
        ("thirty columns", &models::thirty::Thirty, columns_and_sum(120, 30, 22, 0.0)),
        ("columns alike", &models::alike::Alike, columns_and_sum(100, 5, 25, 0.95)),
        (
            "test scores",
            &models::interaction::Interaction,
            rows("first,second,y", 120, 26, |_, rng| {
                let (school, iq) =
                    (f64::from(u8::from(rng.random::<f64>() < 0.79)), 100.0 + 15.0 * normal(rng));
                vec![
                    school,
                    iq,
                    -11.0 + 51.0 * school + 1.1 * iq - 0.5 * school * iq + 18.0 * normal(rng),
                ]
            }),
        ),
        (
            "earnings",
            &models::interaction::Interaction,
            rows("first,second,y", 150, 27, |_, rng| {
                let male = f64::from(u8::from(rng.random::<f64>() < 0.37));
                let height = 64.5 + 5.5 * male + 2.6 * normal(rng);
                vec![
                    male,
                    height,
                    8.4 + 0.017 * height - 0.08 * male + 0.007 * male * height + 0.88 * normal(rng),
                ]
            }),
        ),
        (
            "trend",
            &models::trend::Trend,
            rows("year,temperature", 62, 28, |i, rng| {
                let year = 1952.0 + i as f64;
                vec![year, 9.3 + 0.019 * (year - 1983.0) + 1.1 * normal(rng)]
            }),
        ),
    ]
}

/// Gradients, warm-up included, per effective draw of the number that mixes worst, bulk or tail.
fn cost(model: &Model, chains: &[Chain]) -> f64 {
    let columns = posterior::columns(model, chains);
    let effective = columns.iter().map(|column| {
        let summary = column.summary();
        assert!(summary.r_hat < 1.02, "{}: R-hat {}", column.name, summary.r_hat);
        summary.ess_bulk.min(summary.ess_tail)
    });
    let gradients: u64 = chains.iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum();
    gradients as f64 / effective.fold(f64::INFINITY, f64::min)
}

#[test]
fn an_effective_draw_costs_fewer_gradients_than_in_nuts_rs() {
    for (name, declared, data) in problems() {
        let model = Model::new(declared, None, &data).unwrap();
        let settings = Settings::default();
        let starts =
            jittered_starts(&model, &model.initial(), settings.chains, settings.seed).unwrap();
        let ours = posterior::all(sample(&model, &starts, &settings, &Silent).unwrap());
        assert_eq!(ours.iter().map(Chain::n_divergences).sum::<usize>(), 0, "{name}");
        let each = starts.iter().enumerate();
        let theirs: Vec<Chain> =
            each.map(|(i, start)| nuts_rs_chain::chain(&model, i, start, &settings)).collect();
        let (ours, theirs) = (cost(&model, &ours), cost(&model, &theirs));
        println!("{name:16} {ours:6.1}, nuts-rs {theirs:7.1}: {:6.2} times", theirs / ours);
        let is_default = var("NUTS_RS_METRIC").is_err() && var("NUTS_RS_WARMUP").is_err();
        assert!(
            theirs > 1.5 * ours || !is_default,
            "{name}: {ours} gradients per effective draw, nuts-rs {theirs}"
        );
        assert!(ours < 60.0, "{name}: {ours}");
    }
}
