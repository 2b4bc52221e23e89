//! `eplat design next`: the expected gain is the gain that comes, where that can be known.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/program.rs"]
mod program;
mod support;

use eplat::experiment::{lessons, thinned};
use eplat::infer::{Chain, Settings, Silent, jittered_starts};
use eplat::manifold::Basis;
use eplat::model::{Asked, Declare, Maps, Model, Sampler};
use eplat::table::Measurements;
use program::{Workplace, text};
use support::{basis, table};

mod gaussian {
    use eplat::prelude::*;

    model! {
        /// Everything normal: variances do not depend on what is measured.
        model Gaussian;
        field v(x) [mV] in -10.0..10.0 = m + alpha * gp(Rbf(rho), K = 16) where {
            m     [mV] ~ Normal(0.0, 2.0);
            alpha [mV] ~ LogNormal(0.7, 0.0001);
            rho   [mm] ~ LogNormal(3.0, 0.0001);
        }
        observe point(x): Number [mV] ~ Normal(v(x), 0.5);
    }
}

/// The same with two maps, the second in units of which `$n` are one of the first's.
macro_rules! two_maps {
    ($($module:ident $n:literal),*) => { $( mod $module {
        use eplat::prelude::*;

        model! {
            model TwoMaps;
            field v(x) [mV] in -10.0..10.0 = m + alpha * gp(Rbf(rho), K = 16) where {
                m     [mV] ~ Normal(0.0, 2.0);
                alpha [mV] ~ LogNormal(0.7, 0.0001);
                rho   [mm] ~ LogNormal(3.0, 0.0001);
            }
            let level(x) [mV] = v(x);
            let size(x) [1] = (v(x) / 2.0).exp() * $n;
            observe point(x): Number [mV] ~ Normal(v(x), 0.5);
        }
    } )* };
}
two_maps!(whole 1.0, thousandths 1000.0);

const VERTICES: usize = 200;

fn measured(vertices: &[u32]) -> Measurements {
    let rows: Vec<String> =
        vertices.iter().map(|v| format!("{v},point,{}", f64::from(v % 7) - 3.0)).collect();
    let mut table = table("vertex,protocol,value", &rows);
    table.place_at_indices(VERTICES).unwrap();
    table
}

fn draws(model: &Model) -> Vec<Chain> {
    let settings = Settings { draws: 2500, ..Settings::default() };
    let starts = jittered_starts(model, &model.initial(), settings.chains, 1).unwrap();
    let chains = Sampler::of(model).sample(model, &starts, &settings, &Silent).unwrap();
    chains.into_iter().map(Result::unwrap).collect()
}

/// Mean posterior variance of the field over the surface.
fn variance(model: &Model, basis: &Basis, chains: &[Chain]) -> f64 {
    let all = thinned(chains, usize::MAX).unwrap();
    let field = &Maps::new(model, basis).summarise(&all, &Asked::default()).maps[0];
    field.sd.iter().map(|sd| sd * sd).sum::<f64>() / VERTICES as f64
}

#[test]
fn the_expected_gain_is_the_gain_that_comes() {
    let basis = basis(VERTICES, 16);
    let sites = [3, 60, 110];
    let model = Model::new(&gaussian::Gaussian, Some(&basis), &measured(&sites)).unwrap();
    let chains = draws(&model);
    let all = thinned(&chains, usize::MAX).unwrap();
    let candidates = [3, 4, 85, 199];
    let found = lessons(&gaussian::Gaussian, &model, &basis, &all, &candidates, 10.0).unwrap();
    let before = variance(&model, &basis, &chains);
    let mut gains = vec![];
    for lesson in &found {
        let more = [&sites[..], &[lesson.vertex]].concat();
        let more = Model::new(&gaussian::Gaussian, Some(&basis), &measured(&more)).unwrap();
        let gain = 1.0 - variance(&more, &basis, &draws(&more)) / before;
        println!("vertex {}: expected {:.4}, came {gain:.4}", lesson.vertex, lesson.gain);
        // a variance from 10,000 nearly independent draws is known to 1.4 %, its mean over a surface with
        // some six independent modes to 0.6 %; the difference of two, four times over
        assert!((lesson.gain - gain).abs() < 4.0 * 2f64.sqrt() * 0.006);
        gains.push(lesson.gain);
    }
    // where it is measured already there is little to learn: equal gains for all would not pass
    assert!(gains[0] < 0.3 * gains[1], "{gains:?}");
}

#[test]
fn a_map_in_smaller_units_counts_no_more() {
    let basis = basis(VERTICES, 16);
    let table = measured(&[3, 60, 110]);
    let gains = |declared: &dyn Declare| -> Vec<f64> {
        let model = Model::new(declared, Some(&basis), &table).unwrap();
        let chains = draws(&model);
        let first: Vec<Vec<f64>> =
            (0..500).map(|i| chains[0].draw(i).unwrap().into_owned()).collect();
        let found = lessons(declared, &model, &basis, &first, &[4, 85, 199], 10.0).unwrap();
        found.into_iter().map(|lesson| lesson.gain).collect()
    };
    let [whole, thousandths] = [gains(&whole::TwoMaps), gains(&thousandths::TwoMaps)];
    for (a, b) in whole.iter().zip(&thousandths) {
        assert!((a - b).abs() < 1e-9, "{whole:?} {thousandths:?}");
    }
}

#[test]
fn what_to_measure_next_is_ranked_by_what_it_teaches_per_minute() {
    let place = Workplace::new().with_erp();
    let said = |options: &str| {
        let command = format!("design next erp.rs --candidates 30 --out next.csv {options}");
        let output = place.eplat(&command);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let table = place.read("next.csv");
        let rows: Vec<Vec<String>> = table
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(str::to_owned).collect())
            .collect();
        (text(&output.stdout), rows)
    };
    let (shown, rows) = said("");
    assert!(shown.starts_with("vertex  variance  minutes"), "{shown}");
    assert_eq!(rows.len(), 30 * 3);
    let rate = |row: &Vec<String>| {
        let [gain, minutes] = [5, 6].map(|at| row[at].parse::<f64>().unwrap());
        assert!((0.0..1.0).contains(&gain), "{row:?}");
        gain / minutes
    };
    assert!(rows.windows(2).all(|pair| rate(&pair[0]) >= rate(&pair[1])));
    // a protocol that takes an hour is not the best
    let (_, slow) = said("--minutes s1s2=60");
    assert_eq!(slow[0][4], "s1s2s3");
    let wrong = place.eplat("design next erp.rs --minutes s1=2");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong.stderr).contains("the model observes s1s2, s1s2s3"));
}
