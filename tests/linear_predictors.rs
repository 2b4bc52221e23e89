//! Linear predictors that a model file writes out are seen as such, and change nothing but the time.
//! The oracle is the same model with each parameter behind a function, where no predictor is seen.

#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use eplat::infer::LogDensity as _;
use eplat::model::{AddedEffect, Augmented, Declare, Discrepancy, Model, RowError, Spread, forms};
use eplat::prelude::{Num, Real};
use eplat::table::Measurements;
use rand::RngExt as _;
use support::{rng, table};

/// The number itself; who reads an expression cannot know that.
fn same<T: Real>(x: Num<T>) -> Num<T> {
    x
}

/// A model whose predictors have their parameters as they stand, or through a function.
/// `$sign` is that of one term.
macro_rules! regression {
    ($module:ident $sign:tt $($same:ident)?) => {
        mod $module {
            #[allow(unused_imports, reason = "one of the models needs no function")]
            use super::same;
            use eplat::prelude::*;
            model! {
                model Regression;
                column dose;
                column x(3);
                param a ~ Normal(0.0, 1.0);
                param b(3) ~ Normal(0.0, 1.0);
                param share(2) ~ Dirichlet(2.0);
                param tau ~ HalfNormal(1.0);
                param c(group) ~ Normal(0.0, tau);
                param sigma ~ HalfNormal(1.0);
                let mean(row) = $($same)?(a) + $($same)?(b[0]) * row.dose
                    $sign ($($same)?(b[2]) / row.x[1] - 2.0 * $($same)?(share[0])) * row.x[0] + 0.5;
                let z(row) = exp(c(row) + $($same)?(b[1]) * row.dose - (0.3 - $($same)?(b[2]) * row.x[2]));
                effect shift on mean = linear(row.w) ~ Normal(0.0, 1.0);
                observe y(row): Number ~ Normal(mean(row) + c(row), sigma);
                observe n(row): Number ~ Normal(z(row), 2.0);
                observe z(row): Number ~
                    Outliers(Normal($($same)?(a) - $($same)?(tau) * row.dose, sigma), 0.1, 9.0);
                observe both(row): Number ~ Normal(z(row) - mean(row), sigma);
            }
        }
    };
}
regression!(seen - );
regression!(hidden - same);
regression!(broken + same);

fn data() -> Measurements {
    let mut rng = rng(5);
    let mut line = |i: usize| {
        let mut number = || rng.random_range(0.2..2.0f64);
        let cells: Vec<String> = (0..6).map(|_| number().to_string()).collect();
        format!("{},g{},{}", ["y", "n", "z", "both"][i % 4], i % 3, cells.join(","))
    };
    table("protocol,group,value,dose,x1,x2,x3,w", &(0..30).map(&mut line).collect::<Vec<_>>())
}

/// Log density, gradient, Hessian, log likelihoods, values of `let`s and replicates at three points.
fn numbers(declared: &dyn Declare) -> Vec<f64> {
    let model = Model::new(declared, None, &data()).unwrap();
    let (mut evaluator, mut tape, mut rng) = (model.evaluator(), model.tape(), rng(12));
    let mut all = vec![];
    for _ in 0..3 {
        let u: Vec<f64> = model.initial().iter().map(|u| u + rng.random_range(-0.5..0.5)).collect();
        let mut gradient = vec![0.0; u.len()];
        all.push(evaluator.ln_density(&u, &mut gradient));
        all.extend(gradient);
        evaluator.hessian(&u, &mut |_, column| all.extend(column));
        model.forward(&mut tape, &u);
        model.pointwise(&tape, &mut all);
        model.let_values(&tape, &mut all);
        for observe in &model.observes {
            all.extend(observe.simulate(&tape, &mut rng).concat());
        }
    }
    all
}

/// Largest difference, relative to a number or to one.
fn worst(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let error = |(a, b): (&f64, &f64)| (a - b).abs() / a.abs().max(1.0);
    a.iter().zip(b).map(error).fold(0.0, f64::max)
}

#[test]
fn a_predictor_that_is_seen_gives_the_numbers_of_one_that_is_not() {
    let (seen, hidden) = (numbers(&seen::Regression), numbers(&hidden::Regression));
    assert!(seen.iter().all(|x| x.is_finite()));
    assert!(worst(&seen, &hidden) < 1e-12, "{}", worst(&seen, &hidden));
    assert!(worst(&seen, &numbers(&broken::Regression)) > 0.1);
}

/// What `eplat loop` adds: effects on predictors and on what they are part of, further errors, outliers.
#[test]
fn so_it_does_with_effects_and_errors_that_are_added() {
    let effect = |name: &str, on: &str, form| AddedEffect {
        name: name.into(),
        on: vec![on.into()],
        unit: String::new(),
        form,
        sd: 1.0,
    };
    let effects = [
        effect("drift", "mean", forms::scaled("w", 1.0, 0.5)),
        effect("pace", "z", forms::group("group")),
        effect("spread", "ln_scatter", forms::group("group")),
    ];
    let discrepancy = Discrepancy {
        spreads: vec![Spread {
            name: "group_difference".into(),
            sd: "group_sd".into(),
            prior_sd: 1.0,
            on: vec!["mean".into()],
            unit: String::new(),
            form: forms::group("group"),
            why: String::new(),
        }],
        row_errors: vec![RowError {
            name: "row_error".into(),
            prior_sd: 1.0,
            unit: String::new(),
            observes: vec!["y".into(), "both".into()],
            scatter: Some("ln_scatter".into()),
            why: String::new(),
        }],
    };
    let with_all = |declared: &dyn Declare| {
        let augmented = Augmented::new(declared, &effects).with_discrepancy(discrepancy.clone());
        numbers(&augmented.with_outliers(Some((0.1, 3.0))))
    };
    let (seen, hidden) = (with_all(&seen::Regression), with_all(&hidden::Regression));
    assert!(worst(&seen, &hidden) < 1e-12, "{}", worst(&seen, &hidden));
    assert!(worst(&seen, &with_all(&broken::Regression)) > 0.1);
}

/// Numbers that a row of each `observe` depends on.
fn widths(declared: &dyn Declare) -> Vec<usize> {
    let model = Model::new(declared, None, &data()).unwrap();
    let ids = model.row_ids();
    let first = |observe| ids.iter().find(|id| id.observe == observe).copied().unwrap();
    (0..model.observes.len()).map(|observe| model.n_locals(first(observe))).collect()
}

#[test]
fn a_row_depends_on_its_predictors_instead_of_their_parameters() {
    // mean, c, sigma; what the `let` z is made of: a predictor and c; a predictor and sigma; all
    assert_eq!(widths(&seen::Regression), [3, 2, 2, 4]);
    // `mean`'s offset counts as a number of its own
    assert_eq!(widths(&hidden::Regression), [9, 4, 3, 9]);
}
