//! Nanoseconds per log density with its gradient, and the same written by hand, in one run.
//!
//! ```text
//! cargo bench --bench gradient                   (EPLAT_SHARED=… for the clinical shell)
//! ```
//! The two reference problems, then sites × modes. Last a regression of 46 rows on 8 columns: written
//! out, which is seen to be a linear predictor; the same so that it is not seen; and as
//! `linear(row.x; b)`. `cargo bench --bench gradient -- regression` prints it alone. A figure is the least of many short batches over
//! points where chains start, on one core.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "a bench")]

use std::hint::black_box;
use std::time::Instant;

use eplat::infer::{LogDensity as _, jittered_starts};
use eplat::manifold::{Basis, eigenpairs_cached};
use eplat::model::{Declare, Model};
use eplat::prelude::{Num, Real};
use eplat::surrogate::{Cubic, cubic, erp_s2, erp_s3};
use eplat::table::Measurements;

#[path = "support/by_hand.rs"]
mod by_hand;
#[path = "../tests/support/posterior.rs"]
mod posterior;
#[path = "../tests/support/reference.rs"]
mod reference;

use by_hand::ByHand;

/// Points that a batch goes through.
const POINTS: usize = 64;
/// Batches of which the fastest counts.
const BATCHES: usize = 1500;

/// The reference model with other numbers of modes.
macro_rules! erp_with {
    ($($M:ident $K:literal),*) => { $( mod $M {
        use eplat::prelude::*;
        model! {
            model Erp;
            field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(authors(Rbf(rho)), K = $K) where {
                m [ms] ~ Flat; alpha [ms] ~ InvGamma(1.0, 5.0); rho [mm] ~ InvGamma(1.01, 64.0);
            }
            field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(authors(Rbf(rho)), K = $K) where {
                m [ms] ~ Flat; alpha [ms] ~ InvGamma(1.0, 5.0); rho [mm] ~ InvGamma(1.01, 64.0);
            }
            observe s1s2(x): Bracket [ms] ~ TopHat(surrogate::erp_s2(tau_out(x), apd_max(x)));
            observe s1s2s3(x): Bracket [ms] ~ TopHat(surrogate::erp_s3(tau_out(x), apd_max(x)));
        }
    } )* };
}
erp_with!(modes_8 8, modes_16 16, modes_32 32, modes_64 64);

/// A regression whose parameters stand as they are, or behind a function.
macro_rules! regression {
    ($M:ident $($same:ident)?) => { mod $M {
        #[allow(unused_imports, reason = "one of the models needs no function")]
        use super::same;
        use eplat::prelude::*;
        model! {
            model Regression;
            column x(8);
            param a ~ Normal(0.0, 1.0);
            param b(8) ~ Normal(0.0, 1.0);
            param sigma ~ HalfNormal(1.0);
            let mean(row) = $($same)?(a)
                + $($same)?(b[0]) * row.x[0] + $($same)?(b[1]) * row.x[1]
                + $($same)?(b[2]) * row.x[2] + $($same)?(b[3]) * row.x[3]
                + $($same)?(b[4]) * row.x[4] + $($same)?(b[5]) * row.x[5]
                + $($same)?(b[6]) * row.x[6] + $($same)?(b[7]) * row.x[7];
            observe y(row): Number ~ Normal(mean(row), sigma);
        }
    } };
}
regression!(written);
regression!(hidden same);

mod named {
    use eplat::prelude::*;
    model! {
        model Named;
        param a ~ Normal(0.0, 1.0);
        param b(8) ~ Normal(0.0, 1.0);
        param sigma ~ HalfNormal(1.0);
        let mean(row) = linear(row.x; b);
        observe y(row): Number ~ Normal(mean(row) + a, sigma);
    }
}

/// The number itself; who reads an expression cannot know that.
fn same<T: Real>(x: Num<T>) -> Num<T> {
    x
}

/// 46 rows of 8 columns that are far from each other, and a sum of them.
fn rows_of_regression() -> Measurements {
    let header = (1..=8).map(|j| format!("x{j}")).chain(["y".into()]).collect();
    let row = |i: usize| {
        let x: Vec<f64> = (1..=8).map(|j| (1.7 * (i * j) as f64 + j as f64).sin()).collect();
        let y = 0.3 + x[1] - 0.5 * x[4] + 0.4 * (3.1 * i as f64).cos();
        x.iter().chain([&y]).map(f64::to_string).collect()
    };
    Measurements::from_cells("regression", header, (0..46).map(row).collect()).unwrap()
}

/// Prints nanoseconds of the three regressions, having compared them.
fn regressions() {
    let data = rows_of_regression();
    let time = |declared: &dyn Declare| {
        let model = Model::new(declared, None, &data).unwrap();
        let (mut evaluator, points) = (model.evaluator(), points(&model));
        let at = evaluator.ln_density(&vec![0.3; model.dim()], &mut vec![0.0; model.dim()]);
        (at, nanoseconds(&points, |u, g| evaluator.ln_density(u, g)))
    };
    let all: [&dyn Declare; 3] = [&written::Regression, &hidden::Regression, &named::Named];
    let [(a, written), (b, hidden), (c, named)] = all.map(time);
    assert!((a - b).abs() < 1e-12 * a.abs() && (a - c).abs() < 1e-12 * a.abs(), "{a} {b} {c}");
    println!(
        "regression of 46 rows on 8 columns: written out {written:6.0} ns, if not seen {hidden:6.0} ns, ratio {:.2}; linear(row.x; b) {named:6.0} ns",
        hidden / written
    );
}

/// Points where chains would start: near the optimum, as far apart as draws.
fn points(model: &Model) -> Vec<Vec<f64>> {
    jittered_starts(model, &model.initial(), POINTS, 1).unwrap()
}

/// Nanoseconds of one call of `f`, the least mean over a batch of calls with every point.
fn nanoseconds(points: &[Vec<f64>], mut f: impl FnMut(&[f64], &mut [f64]) -> f64) -> f64 {
    let mut gradient = vec![0.0; points[0].len()];
    let mut batch = || {
        let begun = Instant::now();
        for point in points {
            black_box(f(black_box(point), &mut gradient));
        }
        begun.elapsed().as_secs_f64()
    };
    let least = (0..BATCHES).map(|_| batch()).fold(f64::INFINITY, f64::min);
    least * 1e9 / points.len() as f64
}

/// The polynomials behind the model's surrogates, from their own values.
fn cubics() -> [Cubic; 2] {
    let grid = || (0..25).map(|i| (2.0 + 5.0 * f64::from(i % 5), 120.0 + 30.0 * f64::from(i / 5)));
    [erp_s2::<f64, f64>, erp_s3::<f64, f64>].map(|f| {
        cubic::fit(&grid().map(|(t, a)| [t, a, f(t, a)]).collect::<Vec<_>>()).unwrap().cubic
    })
}

/// Measures the declared model and the one by hand, having compared them.
fn compare(declared: &dyn Declare, basis: &Basis, data: &Measurements) -> [f64; 2] {
    let model = Model::new(declared, Some(basis), data).unwrap();
    let mut by_hand = ByHand::new(basis, data, model.n_modes(), cubics());
    let mut evaluator = model.evaluator();
    let points = points(&model);
    let (mut a, mut b) = (vec![0.0; model.dim()], vec![0.0; model.dim()]);
    let mut difference = |point: &[f64]| {
        let d = evaluator.ln_density(point, &mut a) - by_hand.ln_density(point, &mut b);
        for (a, b) in a.iter().zip(&b) {
            assert!((a - b).abs() < 1e-6 * (1.0 + a.abs()), "{a} {b}");
        }
        d
    };
    let (first, second) = (difference(&points[0]), difference(&points[1]));
    assert!((first - second).abs() < 1e-6 * first.abs(), "{first} {second}");
    [
        nanoseconds(&points, |u, g| evaluator.ln_density(u, g)),
        nanoseconds(&points, |u, g| by_hand.ln_density(u, g)),
    ]
}

fn print(what: &str, [declared, by_hand]: [f64; 2]) {
    println!(
        "{what}: {declared:6.0} ns, by hand {by_hand:6.0} ns, ratio {:.2}",
        declared / by_hand
    );
}

fn main() {
    if std::env::args().any(|word| word == "regression") {
        return regressions();
    }
    let (name, mesh) = reference::surface();
    println!("log density and gradient, ERP model on the {name}");
    for n_sites in [10, 40] {
        let (model, k) = (reference::model(n_sites), if n_sites == 10 { 24 } else { 32 });
        let (basis, data) = posterior::experiment_on(&mesh, model, n_sites);
        print(&format!("{n_sites} sites, K = {k}"), compare(model, &basis, &data));
    }
    let basis = eigenpairs_cached(&mesh, 64).unwrap();
    for n_sites in [5, 10, 20, 40, 80, 160] {
        let models: [(usize, &dyn Declare); 4] =
            [(8, &modes_8::Erp), (16, &modes_16::Erp), (32, &modes_32::Erp), (64, &modes_64::Erp)];
        for (k, model) in models {
            let what = format!("{n_sites:3} sites, K = {k:2}");
            print(&what, compare(model, &basis, &reference::brackets(mesh.n_vertices(), n_sites)));
        }
    }
    regressions();
}
