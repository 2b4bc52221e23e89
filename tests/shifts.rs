//! Fields and parameters that shift arrival times, integrated out: against the density with them, and against NUTS on all
//! unknowns.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/posterior.rs"]
mod posterior;
mod support;

use eplat::diagnostics::summarise;
use eplat::infer::{Chain, LogDensity, Settings, Silent, jittered_starts, sample};
use eplat::manifold::{Basis, eigenpairs};
use eplat::mesh::{Surface, left_atrium};
use eplat::model::{Declare, Model};
use nalgebra::{DMatrix, DVector};
use posterior::all;
use rand::RngExt as _;
use rand_distr::StandardNormal;
use support::{rng, table};

mod shifted {
    use eplat::prelude::*;
    model! {
        /// Arrival times with a field of delays for each source, which is seen by the rows of that source alone.
        model Shifted;
        field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 6) where {
            m     [m/s] ~ Normal(0.8, 0.2);
            alpha [m/s] ~ LogNormal(-1.5, 0.4);
            rho   [mm]  ~ LogNormal(3.5, 0.4);
        }
        param onset(source) [ms] ~ Normal(5.0, 20.0);
        let slowness(x) [ms/mm] = 1.0 / velocity(x);
        let arrival(row) [ms] = eikonal(slowness(row); row.source);
        field delay(x, source) [ms] = alpha * gp(Matern32(rho), K = 5) where {
            alpha [ms] ~ LogNormal(0.5, 0.5);
            rho   [mm] ~ LogNormal(3.0, 0.4);
        }
        param noise(catheter) [ms] ~ LogNormal(0.0, 0.5);
        let sd(row) [ms] = noise(row) * 2.0;
        observe lat(row): Number [ms] ~ Normal(arrival(row) - delay(row) + onset(row), sd(row));
    }
}

mod others {
    use eplat::prelude::*;
    model! {
        /// As above, but the delays are measured on their own, too, with other than normal errors.
        model SeenTwice;
        param slowness [ms/mm] ~ LogNormal(0.2, 0.2);
        let arrival(row) [ms] = eikonal(slowness; row.source);
        field delay(x) [ms] = alpha * gp(Matern32(20.0), K = 5) where { alpha [ms] ~ HalfNormal(2.0); }
        observe lat(row): Number [ms] ~ Normal(arrival(row) + delay(row), 1.0);
        observe other(row): Number [ms] ~ StudentT(4.0, delay(row), 1.0);
    }
    model! {
        /// The amplitude of the delays is the noise, which moves with the velocity.
        model SharedScale;
        param slowness [ms/mm] ~ LogNormal(0.2, 0.2);
        param noise [ms] ~ HalfNormal(2.0);
        let arrival(row) [ms] = eikonal(slowness; row.source);
        field delay(x) [ms] = noise * gp(Matern32(20.0), K = 5);
        observe lat(row): Number [ms] ~ Normal(arrival(row) + delay(row), noise);
    }
}

/// A coarse atrium with its basis, and times at 20 of its vertices from two sources each, by two catheters.
fn laid_out(declared: &dyn Declare) -> Model {
    let mesh = left_atrium(3.0).mesh.coarsened(300, &[]).unwrap().mesh;
    let surface = Surface::new(mesh, std::collections::BTreeMap::new());
    let basis: Basis = eigenpairs(&surface.mesh, 12).unwrap();
    let n = surface.mesh.n_vertices();
    let mut rng = rng(3);
    let mut row = |i: usize| {
        let (source, vertex) = ([7, n / 2][i % 2], i / 2 % 20 * n / 20);
        let time = 40.0 + 20.0 * rng.random::<f64>();
        let protocol = if i < 40 { "lat" } else { "other" };
        format!("{protocol},{vertex},{source},{},{time}", ["lasso", "grid"][i / 2 % 2])
    };
    let n_rows = if declared.name() == "SeenTwice" { 42 } else { 40 };
    let rows: Vec<String> = (0..n_rows).map(&mut row).collect();
    let mut data = table("protocol,vertex,source,catheter,value", &rows);
    data.place_on(&surface, 1.0).unwrap();
    data.probe(&surface, &basis).unwrap();
    Model::new(declared, Some(&basis), &data).unwrap()
}

/// The unknowns that are integrated out of [`shifted::Shifted`].
fn integrated(model: &Model) -> Vec<usize> {
    let is_integrated =
        |name: &str| name.starts_with("delay") && name.contains("eta") || name.starts_with("onset");
    let names = model.unknown_names();
    (0..model.dim()).filter(|i| is_integrated(&names[*i])).collect()
}

/// Positions about the start.
fn positions(model: &Model, n: usize) -> Vec<Vec<f64>> {
    let mut rng = rng(4);
    let one = |_| {
        model.initial().iter().map(|x| x + 0.3 * rng.sample::<f64, _>(StandardNormal)).collect()
    };
    (0..n).map(one).collect()
}

/// The integral times the conditional of what is integrated out is the whole density, wherever that is. The integral does
/// not depend on it, and its gradient is right in all that moves.
#[test]
fn the_integral_times_the_conditional_is_the_density() {
    let model = laid_out(&shifted::Shifted);
    let density = model.without_shifts().unwrap();
    let (mut integral, mut whole) = (density.evaluator(), model.evaluator());
    let names = model.unknown_names();
    let resting = density.interwoven().unwrap();
    let resting: Vec<&str> = resting.iter().map(|i| &*names[*i]).collect();
    let rests = |name: &str| {
        name.starts_with("delay") && name.contains("eta")
            || ["onset", "noise", "velocity.alpha", "velocity.rho"]
                .iter()
                .any(|n| name.starts_with(n))
    };
    let expected = names.iter().filter(|n| rests(n));
    assert_eq!(resting, expected.map(|n| &**n).collect::<Vec<_>>());
    // what the delay is multiplied by moves in trajectories, but not before
    let unclimbed = density.unclimbed();
    let shaping = unclimbed.iter().map(|i| &*names[*i]).filter(|name| !resting.contains(name));
    assert_eq!(shaping.collect::<Vec<_>>(), ["delay.alpha", "delay.rho"]);

    let mut gradient = vec![0.0; model.dim()];
    let integrated = integrated(&model);
    assert_eq!(integrated.len(), 2 * 5 + 2);
    for position in positions(&model, 5) {
        let value = integral.ln_density(&position, &mut gradient);
        let mut elsewhere = position.clone();
        for i in &integrated {
            elsewhere[*i] -= 1.7;
        }
        for at in [&position, &elsewhere] {
            let own = integral.ln_whole(at, value);
            let exact = whole.value(at);
            assert!((own - exact).abs() < 1e-9 * exact.abs(), "{own} {exact}");
        }
        assert!((integral.value(&elsewhere) - value).abs() < 1e-9 * value.abs());
        for i in (0..model.dim()).filter(|i| !resting.contains(&&*names[*i])) {
            let step = |h: f64| {
                let mut moved = position.clone();
                moved[i] += h;
                moved
            };
            let [low, high] = [-1e-5, 1e-5].map(|h| integral.value(&step(h)));
            let slope = (high - low) / 2e-5;
            assert!(
                (slope - gradient[i]).abs() < 1e-4 * (1.0 + slope.abs()),
                "{}: {slope} {}",
                names[i],
                gradient[i]
            );
        }
    }
}

/// Of all that moves, that of the whole density where what is integrated out has its mean, less what goes with that. In what
/// that is multiplied by, as the gradient changes.
#[test]
fn the_hessian_is_that_of_the_integral() {
    let model = laid_out(&shifted::Shifted);
    let density = model.without_shifts().unwrap();
    let (resting, unclimbed) = (density.interwoven().unwrap(), density.unclimbed());
    let w = integrated(&model);
    let r: Vec<usize> = (0..model.dim()).filter(|i| !unclimbed.contains(i)).collect();
    let hessian_of = |density: &dyn LogDensity, at: &[f64]| {
        let mut h = DMatrix::zeros(model.dim(), model.dim());
        density
            .evaluator()
            .hessian(at, &mut |i, column| h.set_column(i, &DVector::from_column_slice(column)));
        h
    };
    for mut position in positions(&model, 2) {
        let own = hessian_of(&*density, &position);
        for i in unclimbed.iter().copied().filter(|i| !resting.contains(i)) {
            let gradient_at = |h: f64| {
                let (mut moved, mut gradient) = (position.clone(), vec![0.0; model.dim()]);
                moved[i] += h;
                density.evaluator().ln_density(&moved, &mut gradient);
                gradient
            };
            let [low, high] = [-1e-5, 1e-5].map(gradient_at);
            for j in 0..model.dim() {
                let slope = (high[j] - low[j]) / 2e-5;
                for entry in [own[(i, j)], own[(j, i)]] {
                    assert!((entry - slope).abs() < 1e-5 * (1.0 + slope.abs()), "{entry} {slope}");
                }
            }
        }
        // Newton's step leads to the mean
        let mut gradient = vec![0.0; model.dim()];
        model.evaluator().ln_density(&position, &mut gradient);
        let whole = hessian_of(&model, &position);
        let part = |h: &DMatrix<f64>, rows: &[usize], columns: &[usize]| {
            h.select_rows(rows).select_columns(columns)
        };
        let slope = DVector::from_iterator(w.len(), w.iter().map(|i| gradient[*i]));
        let step = part(&whole, &w, &w).lu().solve(&slope).unwrap();
        w.iter().zip(&step).for_each(|(i, step)| position[*i] -= step);
        let whole = hessian_of(&model, &position);
        let inner = part(&whole, &w, &w).lu().solve(&part(&whole, &w, &r)).unwrap();
        let exact = part(&whole, &r, &r) - part(&whole, &r, &w) * inner;
        let error = (part(&own, &r, &r) - &exact).abs().max();
        assert!(error < 1e-8 * exact.abs().max(), "{error}");
        assert!((part(&whole, &r, &r) - &exact).abs().max() > 1e-2 * exact.abs().max());
    }
}

/// NUTS on all unknowns draws from the same posterior.
#[test]
fn draws_are_those_of_the_whole_density() {
    let model = laid_out(&shifted::Shifted);
    let density = model.without_shifts().unwrap();
    let settings = Settings { warmup: 300, draws: 1000, ..Settings::default() };
    let draws = |density: &dyn LogDensity| {
        let starts = jittered_starts(&model, &model.initial(), settings.chains, 1).unwrap();
        all(sample(density, &starts, &settings, &Silent).unwrap())
    };
    let [own, whole] = [&*density, &model as &dyn LogDensity].map(draws);
    let names = model.unknown_names();
    let mut worst: f64 = 0.0;
    for (i, name) in names.iter().enumerate() {
        for square in [false, true] {
            let column = |chains: &[Chain]| -> Vec<Vec<f64>> {
                let of = |chain: &Chain| {
                    let x = |d: usize| chain.draw(d).unwrap()[i];
                    (0..chain.n_draws()).map(|d| if square { x(d) * x(d) } else { x(d) }).collect()
                };
                chains.iter().map(of).collect()
            };
            let [a, b] = [column(&own), column(&whole)]
                .map(|columns| summarise(&columns.iter().map(Vec::as_slice).collect::<Vec<_>>()));
            let z = (a.mean - b.mean).abs() / a.mcse.hypot(b.mcse);
            println!(
                "{name} {square}: {:.3} {:.3}, z {z:.1}, ESS {:.0} {:.0}",
                a.mean, b.mean, a.ess_bulk, b.ess_bulk
            );
            worst = worst.max(z);
        }
    }
    // the largest of some 70 normal numbers
    assert!(worst < 4.5, "{worst}");
}

/// What the others predict of a row, in a draw, is the ratio of the integrals with it and without it. Replicates are normal
/// with that density.
#[test]
fn a_row_is_predicted_from_the_others() {
    let whole = laid_out(&shifted::Shifted);
    let draws = positions(&whole, 2000);
    let ids = whole.row_ids();
    let rows = [ids[0], ids[17], ids[39]];
    let predictive = whole.predictive(&draws, &rows, 1);
    for (id, own) in rows.iter().zip(predictive) {
        let own = own.unwrap();
        let mut without = laid_out(&shifted::Shifted);
        without.leave_out(*id);
        let value =
            |model: &Model, draw: &[f64]| model.without_shifts().unwrap().evaluator().value(draw);
        for (draw, ln_density) in draws.iter().zip(&own.ln_density).take(5) {
            let exact = value(&whole, draw) - value(&without, draw);
            assert!(
                (ln_density - exact).abs() < 1e-8 * exact.abs().max(1.0),
                "{ln_density} {exact}"
            );
        }
    }
    // the same position again and again
    let again = vec![draws[3].clone(); 20_000];
    let own = whole.predictive(&again, &rows[..1], 1).remove(0).unwrap();
    let n = own.replicates.len() as f64;
    let mean = own.replicates.iter().sum::<f64>() / n;
    let variance = own.replicates.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n;
    let y = whole.measured_row(rows[0])[0];
    let ln = -0.5 * ((y - mean).powi(2) / variance + (std::f64::consts::TAU * variance).ln());
    let z = (y - mean) / variance.sqrt();
    // of 20,000: the errors of a mean, 0.7 %, and of a variance, 1 %, four times
    let error = 4.0 * (0.007 * z.abs() + 0.01 * (z * z + 1.0) / 2.0);
    assert!((ln - own.ln_density[0]).abs() < error, "{ln} {} ± {error}", own.ln_density[0]);
}

/// What a likelihood that is not normal sees stays, and what is scaled by unknowns that move.
#[test]
fn what_does_not_integrate_out_stays() {
    assert!(laid_out(&others::SharedScale).without_shifts().is_none());
    assert!(laid_out(&others::SeenTwice).without_shifts().is_none());
}

/// After its moves the integral knows value and gradient of where it led, without an operator.
#[test]
fn moves_know_the_density_where_they_lead() {
    let model = laid_out(&shifted::Shifted);
    let density = model.without_shifts().unwrap();
    let (mut moving, mut anew) = (density.evaluator(), density.evaluator());
    let (mut rng, mut known, mut exact) = (rng(5), vec![0.0; model.dim()], vec![0.0; model.dim()]);
    for start in positions(&model, 5) {
        let mut position = start.clone();
        let value = moving.interweave(&mut position, &mut known, &mut rng).unwrap();
        assert_ne!(position, start);
        let ln_density = anew.ln_density(&position, &mut exact);
        assert!((value - ln_density).abs() < 1e-9 * ln_density.abs(), "{value} {ln_density}");
        let size = exact.iter().fold(1.0, |a: f64, b| a.max(b.abs()));
        for (known, exact) in known.iter().zip(&exact) {
            assert!((known - exact).abs() < 1e-7 * size, "{known} {exact}");
        }
        let [one, other] = [&mut moving, &mut anew].map(|of| of.ln_whole(&position, value));
        assert!((one - other).abs() < 1e-9 * other.abs(), "{one} {other}");
    }
}
