//! A posterior with two regimes, between which there is next to nothing: the blocked sampler against exact figures.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "support/posterior.rs"]
mod posterior;
#[path = "support/program.rs"]
mod program;
mod support;

use std::f64::consts::TAU;

use eplat::diagnostics::{mcse_mean, mean_and_sd};
use eplat::infer::{Settings, Silent};
use eplat::manifold::Basis;
use eplat::mesh::Surface;
use eplat::model::{Model, Sampler};
use posterior::{all, columns};
use program::{Workplace, text};
use support::table;

/// Vertices, all measured. They are so many that coefficients are not proposed anew with the hyperparameters.
const N: usize = 45;
/// What is measured of the field's square at each, and the error.
const SQUARE: f64 = 4.0;
const SD: f64 = 3.0;
/// The field's mean, and the lengthscale in mm.
const MEAN: f64 = 0.15;
const RHO: f64 = 20.0;
/// Two-sided 0.01 %.
const LARGEST_Z: f64 = 3.9;

mod squares {
    use eplat::prelude::*;
    model! {
        /// The sign of the field is not measured.
        model Squares;
        field f(x) = 0.15 + alpha * gp(Rbf(Num::from(20.0)), K = 2) where { alpha ~ HalfNormal(3.0); }
        let square(x) = f(x) * f(x);
        observe y(x): Number ~ Normal(square(x), 3.0);
    }
}

/// Two modes. The constant one, which is larger, makes the sign the same everywhere.
fn basis() -> Basis {
    let modes = |vertex: usize| [0.02, 0.004 * (0.7 * vertex as f64).sin()];
    Basis { eigenvalues: vec![0.0, 4e-4], eigenfunctions: (0..N).flat_map(modes).collect() }
}

/// Values of the modes at a vertex, each times the root of its spectral density.
fn design(vertex: usize) -> [f64; 2] {
    let basis = basis();
    let density = |lambda: f64| TAU * RHO * RHO * (-0.5 * RHO * RHO * lambda).exp();
    std::array::from_fn(|k| density(basis.eigenvalues[k]).sqrt() * basis.at(vertex)[k])
}

/// The probability that the field is positive at the first vertex: a sum over a grid of the amplitude and of both
/// coefficients times it.
fn share_of_positive() -> f64 {
    let design: Vec<[f64; 2]> = (0..N).map(design).collect();
    let mut shares = [0.0, 0.0];
    for a in 0..60 {
        let alpha = 0.15 * (f64::from(a) + 0.5);
        for i in -120..=120 {
            for j in -60..=60 {
                let w = [0.03 * f64::from(i), 0.1 * f64::from(j)];
                let f = |phi: &[f64; 2]| MEAN + w[0] * phi[0] + w[1] * phi[1];
                let misfit = |phi| (f(phi).powi(2) - SQUARE) / SD;
                let likelihood: f64 = design.iter().map(|phi| misfit(phi).powi(2)).sum();
                let prior = (alpha / 3.0).powi(2) + (w[0] / alpha).powi(2) + (w[1] / alpha).powi(2);
                let density = (-0.5 * (likelihood + prior)).exp() / alpha.powi(2);
                shares[usize::from(f(&design[0]) > 0.0)] += density;
            }
        }
    }
    shares[1] / (shares[0] + shares[1])
}

#[test]
fn each_regime_has_its_share() {
    let rows: Vec<String> = (0..N).map(|vertex| format!("{vertex},{SQUARE}")).collect();
    let mut data = table("vertex,y", &rows);
    data.place_at_indices(N).unwrap();
    let exact = share_of_positive();
    assert!((0.55..0.9).contains(&exact), "one half would not tell a wrong ratio: {exact}");
    let basis = basis();
    let model = Model::new(&squares::Squares, Some(&basis), &data).unwrap();
    let settings = Settings { draws: 2000, ..Settings::default() };
    // what no chain has met in the warm-up cannot be known
    let starts: Vec<Vec<f64>> =
        (0..settings.chains).map(|c| vec![1.0, if c % 2 == 0 { 0.7 } else { -0.7 }, 0.0]).collect();
    let chains = all(Sampler::Blocked.sample(&model, &starts, &settings, &Silent).unwrap());
    let columns = columns(&model, &chains);
    let column = |name: &str| &columns.iter().find(|column| column.name == name).unwrap().chains;
    let etas: Vec<_> = (0..2).map(|k| column(&format!("f.eta[{k}]"))).collect();
    let is_positive = |(c, i): (usize, usize)| {
        let sum: f64 = design(0).iter().zip(&etas).map(|(phi, eta)| phi * eta[c][i]).sum();
        f64::from(MEAN + column("f.alpha")[c][i] * sum > 0.0)
    };
    let signs: Vec<Vec<f64>> = (0..settings.chains)
        .map(|c| (0..settings.draws).map(|i| is_positive((c, i))).collect())
        .collect();
    let slices: Vec<&[f64]> = signs.iter().map(Vec::as_slice).collect();
    let (share, error) = (mean_and_sd(&slices).0, mcse_mean(&slices));
    println!("{share} ± {error}, exactly {exact}");
    assert!(error < 0.02, "chains stay in one regime: {share} ± {error}");
    assert!(((share - exact) / error).abs() < LARGEST_Z, "{share} ± {error}, exactly {exact}");
}

/// What the verdict says of regimes where `seen`, 2 or 4, is measured of a field at ten vertices.
fn said(seen: &str, value: f64) -> Vec<String> {
    let place = Workplace::new();
    let surface = Surface::left_atrium(3.0);
    surface.write_maps(&place.path("atrium.vtp"), &[]).unwrap();
    let n = surface.mesh.n_vertices();
    let row = |i: usize| format!("y,{},{}\n", i * n / 10, value + 0.1 * (i % 3) as f64);
    place.file(
        "y.csv",
        "protocol,vertex,value\n".to_owned() + &(0..10).map(row).collect::<String>(),
    );
    place.file(
        "seen.rs",
        format!(
            "use eplat::prelude::*;
            model! {{
                /// A field, or its square.
                model Seen;
                field f(x) [1] = m + alpha * gp(Rbf(rho), K = 8) where {{
                    m [1] ~ Normal(0.3, 2.0); alpha [1] ~ HalfNormal(0.3); rho [mm] ~ InvGamma(5.0, 150.0);
                }}
                let seen(x) [1] = {seen};
                observe y(x): Number [1] ~ Normal(seen(x), 0.5);
            }}"
        ),
    );
    let run =
        place.eplat("run seen.rs --mesh atrium.vtp --units mm --data y.csv --draws 400 --out run");
    assert!(place.path("run/run.json").exists(), "{}", text(&run.stderr));
    let all = text(&run.stdout);
    all.lines().filter(|line| line.contains("two regimes")).map(str::to_owned).collect()
}

#[test]
fn the_verdict_names_a_region_with_two_regimes() {
    assert_eq!(said("f(x)", 2.0), Vec::<String>::new());
    let found = said("f(x) * f(x)", 4.0);
    let [line] = &found[..] else { panic!("{found:?}") };
    println!("{line}");
    assert!(line.contains("and 9 more") && line.contains("-2"), "{line}");
}
