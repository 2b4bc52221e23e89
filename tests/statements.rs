//! Statements that stand for several: what they are short for has the same density.

#![allow(clippy::unwrap_used, reason = "a test")]

mod support;

use std::fmt::Write as _;

use eplat::infer::LogDensity as _;
use eplat::model::{Declare, Maps, Model};
use eplat::prelude::*;
use eplat::table::Measurements;
use support::{basis, table};

const VERTICES: usize = 60;

/// A field for each patient, and the same spelled out for two.
mod labelled {
    use super::*;
    model! {
        model Labelled;
        param noise [ms] ~ HalfNormal(2.0);
        field f(x, patient) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where {
            m(patient) [ms] ~ Normal(20.0, 5.0);
            alpha      [ms] ~ HalfNormal(5.0);
            rho        [mm] ~ InvGamma(5.0, 200.0);
        }
        let late(x) [ms] = 2 * f(x) + 1;
        observe y(x): Number [ms] ~ Normal(late(x), noise);
    }
}

mod spelled_out {
    use super::*;
    model! {
        model SpelledOut;
        param noise [ms] ~ HalfNormal(2.0);
        param alpha [ms] ~ HalfNormal(5.0);
        param rho   [mm] ~ InvGamma(5.0, 200.0);
        field f_a(x) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where { m [ms] ~ Normal(20.0, 5.0); }
        field f_b(x) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where { m [ms] ~ Normal(20.0, 5.0); }
        let late_a(x) [ms] = f_a(x) * 2.0 + 1.0;
        let late_b(x) [ms] = f_b(x) * 2.0 + 1.0;
        observe a(x): Number [ms] ~ Normal(late_a(x), noise);
        observe b(x): Number [ms] ~ Normal(late_b(x), noise);
    }
}

/// Blocks of hyperparameters: with values of each field's own, and with the same values.
mod blocks {
    use super::*;
    model! {
        model Blocks;
        hyper smooth { alpha [ms] ~ HalfNormal(5.0); rho [mm] ~ InvGamma(5.0, 200.0); }
        field f(x) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where smooth { m [ms] ~ Flat; }
        field g(x) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where smooth { m [ms] ~ Flat; }
        observe y(x): Number [ms] ~ Normal(f(x) - g(x), 1);
    }
}

mod shared {
    use super::*;
    model! {
        model Shared;
        hyper smooth { alpha [ms] ~ HalfNormal(5.0); rho [mm] ~ InvGamma(5.0, 200.0); }
        field f(x) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where shared smooth { m [ms] ~ Flat; }
        field g(x) [ms] in 0.0..60.0 = m + alpha * gp(Rbf(rho), K = 12) where shared smooth { m [ms] ~ Flat; }
        observe y(x): Number [ms] ~ Normal(f(x) - g(x), 1);
    }
}

mod imputed {
    use super::*;
    model! {
        model Imputed;
        param mu [g] ~ Normal(0.0, 10.0);
        param rate [1/g] ~ HalfNormal(1.0);
        column dose [g] ~ Normal(mu, 2.0);
        column weight [g] ~ Exponential(rate);
        observe y(row): Number ~ Normal(row.dose + 3 * row.weight, 1.5);
    }
}

fn rows(header: &str, protocols: [&str; 2]) -> Measurements {
    let line = |i: usize| format!("{},{},{}", i * 2 % VERTICES, protocols[i % 2], 30 + i % 7);
    let mut data = table(header, &(0..16).map(line).collect::<Vec<_>>());
    data.place_at_indices(VERTICES).unwrap();
    data
}

/// Log density and gradient where every unknown has a value that follows from its name.
fn at(model: &Model, value: &dyn Fn(&str) -> f64) -> (f64, Vec<(String, f64)>) {
    let names = model.unknown_names();
    let u: Vec<f64> = names.iter().map(|name| value(name)).collect();
    let mut gradient = vec![0.0; u.len()];
    let lp = model.evaluator().ln_density(&u, &mut gradient);
    (lp, names.into_iter().zip(gradient).collect())
}

/// A number from −½ to ½ that a name stands for.
fn number_of(name: &str) -> f64 {
    let hash = name.bytes().fold(17u32, |h, b| h.wrapping_mul(31).wrapping_add(u32::from(b)));
    f64::from(hash % 1000) / 1000.0 - 0.5
}

#[test]
fn a_field_for_each_label_is_as_many_fields() {
    let basis = basis(VERTICES, 12);
    let one = Model::new(&labelled::Labelled, Some(&basis), &rows("vertex,patient,y", ["a", "b"]));
    let two = Model::new(
        &spelled_out::SpelledOut,
        Some(&basis),
        &rows("vertex,protocol,value", ["a", "b"]),
    );
    let (one, two) = (one.unwrap(), two.unwrap());
    let short = |name: &str| {
        let name = name.replace("f_a.m", "f.m[a]").replace("f_b.m", "f.m[b]");
        let name = name.replace("f_a.", "f[a].").replace("f_b.", "f[b].");
        match name.as_str() {
            "alpha" | "rho" => format!("f.{name}"),
            _ => name,
        }
    };
    let (lp, gradient) = at(&one, &number_of);
    let (lp_two, gradient_two) = at(&two, &|name| number_of(&short(name)));
    assert!((lp - lp_two).abs() < 1e-9 * lp.abs(), "{lp} {lp_two}");
    assert_eq!(gradient.len(), gradient_two.len());
    for (name, slope) in gradient_two {
        let own = gradient.iter().find(|(own, _)| *own == short(&name));
        let (_, own) = own.unwrap_or_else(|| panic!("{name} has no counterpart"));
        assert!((own - slope).abs() < 1e-9 * (1.0 + slope.abs()), "{name}: {own} {slope}");
    }
    let maps = Maps::new(&one, &basis);
    let names: Vec<&str> = maps.names().iter().map(|map| map.name).collect();
    assert_eq!(names, ["f[a]", "f[b]", "late[a]", "late[b]"]);
}

#[test]
fn a_block_gives_each_field_its_own_values_or_all_the_same() {
    let basis = basis(VERTICES, 12);
    let data = rows("vertex,protocol,value", ["y", "y"]);
    let reported = |declared: &dyn Declare| -> Vec<String> {
        let model = Model::new(declared, Some(&basis), &data).unwrap();
        model.parameters.iter().map(|p| p.name.clone()).collect()
    };
    let own = ["f.alpha", "f.rho", "f.m", "f.eta", "g.alpha", "g.rho", "g.m", "g.eta"];
    assert_eq!(reported(&blocks::Blocks), own);
    let same = ["smooth.alpha", "smooth.rho", "f.m", "f.eta", "g.m", "g.eta"];
    assert_eq!(reported(&shared::Shared), same);
}

#[test]
fn an_empty_cell_is_an_unknown_and_a_filled_one_tells_of_the_prior() {
    let cells = [("1.0", "2.0"), ("", "0.5"), ("4.0", ""), ("", "")];
    let lines: Vec<String> = (0..4).map(|i| format!("{},{},{i}", cells[i].0, cells[i].1)).collect();
    let model = Model::new(&imputed::Imputed, None, &table("dose,weight,y", &lines)).unwrap();
    let names = ["mu", "rate", "dose[line 3]", "dose[line 5]", "weight[line 4]", "weight[line 5]"];
    assert_eq!(model.unknown_names(), names);
    let u = [0.7, -0.3, 1.5, -2.0, 0.4, -1.1];
    let mut gradient = vec![0.0; 6];
    let lp: f64 = model.evaluator().ln_density(&u, &mut gradient);

    // by hand, with positive unknowns as logarithms
    let normal = |x: f64, mean: f64, sd: f64| -> f64 { Normal(mean, sd).ln_likelihood(&x) };
    let by_hand = |u: &[f64]| {
        let (mu, rate) = (u[0], u[1].exp());
        let dose = [1.0, u[2], 4.0, u[3]];
        let weight = [2.0, 0.5, u[4].exp(), u[5].exp()];
        let half_normal = (2f64).ln() + normal(rate, 0.0, 1.0) + u[1];
        let mut lp = normal(mu, 0.0, 10.0) + half_normal + u[4] + u[5];
        for i in 0..4 {
            lp += normal(dose[i], mu, 2.0) + rate.ln() - rate * weight[i];
            lp += normal(i as f64, dose[i] + 3.0 * weight[i], 1.5);
        }
        lp
    };
    assert!((lp - by_hand(&u)).abs() < 1e-10, "{lp} {}", by_hand(&u));
    let mut said = String::new();
    for i in 0..6 {
        let (mut up, mut down) = (u, u);
        (up[i], down[i]) = (u[i] + 1e-5, u[i] - 1e-5);
        let slope = (by_hand(&up) - by_hand(&down)) / 2e-5;
        if (slope - gradient[i]).abs() > 1e-6 * (1.0 + slope.abs()) {
            let _ = writeln!(said, "{}: {slope} {}", names[i], gradient[i]);
        }
    }
    assert!(said.is_empty(), "{said}");
}
