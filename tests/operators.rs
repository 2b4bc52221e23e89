//! Operators over the surface, `path`, `gradient` and `eikonal` from several places: derivatives against differences, values against exact ones, maps, and what is refused.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/as_written.rs"]
mod as_written;
#[path = "support/program.rs"]
mod program;
#[path = "support/shipped.rs"]
mod shipped;
mod support;

use as_written::same_as_written;
use eplat::experiment::thinned;
use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::manifold::{Basis, Eikonal, Front, Gradient, Medium, eigenpairs, integrate_along_paths};
use eplat::mesh::Surface;
use eplat::model::{
    Asked, Everywhere, Exceedance, Maps, Model, Sampler, Summaries, operator_error,
};
use eplat::table::{Fineness, Measurements};
use program::{Workplace, text};
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use shipped::shipped;
use support::{gradient_error, rng, table};

mod way {
    use eplat::prelude::*;
    model! {
        /// Activation along straight ways, through tissue whose velocity varies.
        model Way;
        field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 9) where {
            m [m/s] ~ Normal(0.8, 0.3);
            alpha [m/s] ~ HalfNormal(0.3);
            rho [mm] ~ InvGamma(3.0, 60.0);
        }
        param onset [ms] ~ Normal(0.0, 20.0);
        param noise [ms] ~ HalfNormal(5.0);
        let slowness(x) [ms/mm] = 1.0 / velocity(x);
        let way(row) [ms] = path(slowness(row); row.source);
        observe lat(row): Number [ms] ~ Normal(onset + way(row), noise);
    }
}

mod measured {
    use eplat::prelude::*;
    model! {
        /// How slow a catheter finds the tissue at a place, beside arrival times.
        model Measured;
        field arrival(x) [ms] = m + alpha * gp(Rbf(40.0), K = 12) where {
            m [ms] ~ Normal(60.0, 30.0);
            alpha [ms] ~ HalfNormal(30.0);
        }
        param scale ~ LogNormal(0.0, 0.2);
        let steepness(x) [ms/mm] = gradient(scale * arrival(x));
        observe lat(x): Number [ms] ~ Normal(arrival(x), 2.0);
        observe slow(x): Number [ms/mm] ~ Normal(steepness(x), 0.5);
    }
}

mod breakthroughs {
    use eplat::prelude::*;
    model! {
        /// Activation that breaks through at a second place in some rhythms.
        model Breakthroughs;
        param slowness [ms/mm] ~ Normal(1.3, 0.5);
        param onset(rhythm) [ms] ~ Normal(0.0, 50.0);
        param later(rhythm) [ms] ~ Normal(0.0, 30.0);
        param noise [ms] ~ HalfNormal(5.0);
        let arrival(row) [ms] = eikonal(slowness; row.source, row.source2 + later(row));
        observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row), noise);
    }
}

mod own {
    use eplat::prelude::*;
    model! {
        /// A catheter that sees the mean of what is near, in squares.
        model Catheter;
        field voltage(x) [mV] within 0.1..9.0 = m + alpha * gp(Matern32(20.0), K = 20) where {
            m [mV] ~ Normal(3.0, 1.0);
            alpha [mV] ~ HalfNormal(1.0);
        }
        param gain ~ LogNormal(0.0, 0.1);
        let seen(row) [mV] = near(voltage(row), gain; 8.0);
        observe v(row): Number [mV] ~ Normal(seen(row), 0.1);
    }

    #[derive(Debug)]
    pub(super) struct Near(Vec<Vec<usize>>);

    pub(super) fn near(surface: &Everywhere<'_>, width: f64) -> Near {
        let p = surface.mesh.vertices();
        let gap = |a: usize, b: usize| (0..3).map(|k| (p[a][k] - p[b][k]).powi(2)).sum::<f64>();
        let near = |a: usize| (0..p.len()).filter(|b| gap(a, *b) < width * width).collect();
        Near(surface.at.iter().map(|row| near(*row as usize)).collect())
    }

    impl Operator for Near {
        fn forward(&self, of: &Operands<'_>, _: &mut Memo, out: &mut [f64]) {
            let [x, gain] = of.everywhere[..] else { return };
            for (out, near) in out.iter_mut().zip(&self.0) {
                let sum: f64 = near.iter().map(|v| gain[*v] * x[*v] * x[*v]).sum();
                *out = (sum / near.len() as f64).sqrt();
            }
        }
        fn push(&self, of: &Operands<'_>, _: &Memo, changes: &Operands<'_>, out: &mut [f64]) {
            let ([x, gain], [dx, d_gain]) = (&of.everywhere[..], &changes.everywhere[..]) else {
                return;
            };
            self.forward(of, &mut Memo::default(), out);
            for (out, near) in out.iter_mut().zip(&self.0) {
                let change =
                    |v: &usize| 2.0 * gain[*v] * x[*v] * dx[*v] + d_gain[*v] * x[*v] * x[*v];
                *out = near.iter().map(change).sum::<f64>() / (2.0 * *out * near.len() as f64);
            }
        }
        fn pull(&self, of: &Operands<'_>, _: &Memo, bars: &[f64], into: &mut Adjoints<'_>) {
            let [x, gain] = of.everywhere[..] else { return };
            let mut out = vec![0.0; bars.len()];
            self.forward(of, &mut Memo::default(), &mut out);
            for ((near, bar), out) in self.0.iter().zip(bars).zip(out) {
                let bar = bar / (2.0 * out * near.len() as f64);
                for v in near {
                    into.everywhere[0][*v] += 2.0 * bar * gain[*v] * x[*v];
                    into.everywhere[1][*v] += bar * x[*v] * x[*v];
                }
            }
        }
    }
}

/// An atrium with edges of this length, mm, and its modes.
fn atrium(edge: f64) -> (Surface, Basis) {
    let surface = Surface::left_atrium(edge);
    let basis = eigenpairs(&surface.mesh, 128).unwrap();
    (surface, basis)
}

/// Rows of these protocols, in turn, at every `step`th vertex, from the vertex 5.
fn rows(surface: &Surface, basis: &Basis, step: usize, protocols: &[&str]) -> Measurements {
    let line =
        |i: usize| format!("{},{},5,{}", protocols[i % protocols.len()], step * i, 10 + i % 90);
    let lines: Vec<String> = (0..surface.mesh.n_vertices() / step).map(line).collect();
    let mut rows = table("protocol,vertex,source,value", &lines);
    rows.place_on(surface, 1.0).unwrap();
    rows.probe(surface, basis).unwrap();
    rows
}

#[test]
fn gradients_are_those_of_differences() {
    let (surface, basis) = atrium(3.0);
    let ways = rows(&surface, &basis, 13, &["lat"]);
    let both = rows(&surface, &basis, 13, &["lat", "slow"]);
    let of_ways = Model::new(&way::Way, Some(&basis), &ways).unwrap();
    let of_both = Model::new(&measured::Measured, Some(&basis), &both).unwrap();
    same_as_written(&way::Way, &basis, &ways, &of_ways.initial());
    same_as_written(&measured::Measured, &basis, &both, &of_both.initial());
    for model in [&of_ways, &of_both] {
        for point in 0..3 {
            let error = gradient_error(model, point);
            assert!(error < 1e-5, "point {point}: {error}");
        }
        assert_eq!(Sampler::of(model), Sampler::Nuts);
        assert!(!Sampler::Blocked.takes(model) && !Sampler::Integrated.takes(model));
    }
}

/// The values of the first `let` that is reported of each row.
fn let_values(model: &Model, u: &[f64]) -> Vec<f64> {
    let mut t = model.tape();
    model.forward(&mut t, u);
    let mut values = vec![];
    model.let_values(&t, &mut values);
    values
}

/// Unknowns of a model around its start.
fn some_draw(model: &Model, seed: u64) -> Vec<f64> {
    let mut rng = rng(seed);
    let mut u = model.initial();
    for x in &mut u {
        *x += rng.random_range(-0.5..0.5);
    }
    u
}

/// A map in one draw at every vertex.
fn map_of(model: &Model, basis: &Basis, u: &[f64], name: &str) -> Vec<f64> {
    let maps = Maps::new(model, basis);
    let at = maps.names().iter().position(|map| map.name == name).unwrap();
    let everywhere: Vec<usize> = (0..basis.n_vertices()).collect();
    maps.draws_at(&[u.to_vec()], &everywhere).iter().map(|maps| maps[at][0]).collect()
}

/// The ways of a surface of more vertices than operators see are those of the surface itself.
#[test]
fn a_path_is_the_integral_along_the_geodesic() {
    for (edge, bound) in [(3.0, 1e-9), (1.5, 0.02)] {
        let (surface, basis) = atrium(edge);
        let data = rows(&surface, &basis, 41, &["lat"]);
        let model = Model::new(&way::Way, Some(&basis), &data).unwrap();
        let u = some_draw(&model, 4);
        let slowness: Vec<f64> =
            map_of(&model, &basis, &u, "velocity").iter().map(|v| 1.0 / v).collect();
        let exact = integrate_along_paths(&surface.mesh, 5, &slowness, 1).unwrap();
        let ways = let_values(&model, &u);
        assert_eq!(ways.len(), data.len());
        for (row, way) in ways.iter().enumerate() {
            let exact = exact[data.vertex(row).unwrap() as usize];
            assert!((way - exact).abs() <= bound * (1.0 + exact), "{edge}, {row}: {way} {exact}");
        }
    }
}

/// Sites of two rhythms: activation of the first starts at two vertices, of the second at one of them.
fn rhythms(
    surface: &Surface,
    basis: &Basis,
    mut value: impl FnMut(&str, usize) -> f64,
) -> Measurements {
    let n = surface.mesh.n_vertices();
    let mut line = |i: usize| {
        let (vertex, rhythm) = (19 * i % n, ["sinus", "paced"][i % 2]);
        let second = if rhythm == "sinus" { (n - 9).to_string() } else { String::new() };
        format!("lat,{vertex},5,{second},{rhythm},{}", value(rhythm, vertex))
    };
    let lines: Vec<String> = (0..120).map(&mut line).collect();
    let mut rows = table("protocol,vertex,source,source2,rhythm,value", &lines);
    rows.place_on(surface, 1.0).unwrap();
    rows.probe(surface, basis).unwrap();
    rows
}

/// Arrivals are the first from either place, and when the second starts is found from them.
#[test]
fn activation_starts_at_several_places() {
    let (surface, basis) = atrium(3.0);
    let solver = Eikonal::new(&surface.mesh, None).unwrap();
    let n = surface.mesh.n_vertices();
    let slowness = vec![1.4; n];
    let from = |source: usize| {
        let mut front = Front::default();
        let medium = Medium { slowness: &slowness, ..Medium::default() };
        solver.forward(&medium, &[(source as u32, 0.0)], &mut front);
        front.arrival
    };
    let (first, second) = (from(5), from(n - 9));
    let exact = |rhythm: &str, v: usize| match rhythm {
        "sinus" => first[v].min(second[v] + 17.0),
        _ => first[v],
    };
    let n_of_second = (0..n).filter(|v| second[*v] + 17.0 < first[*v]).count();
    assert!(n_of_second > n / 4 && n_of_second < n * 3 / 4, "{n_of_second} of {n}");

    let data = rhythms(&surface, &basis, &exact);
    let model = Model::new(&breakthroughs::Breakthroughs, Some(&basis), &data).unwrap();
    let unknown = |name: &str| match name {
        "slowness" => 1.4,
        "later[sinus]" => 17.0,
        // no second place of this rhythm
        "later[paced]" => -40.0,
        _ => 0.0,
    };
    let u: Vec<f64> = model.unknown_names().iter().map(|name| unknown(name)).collect();
    for (row, arrival) in let_values(&model, &u).iter().enumerate() {
        let exact = data.number(row, "value", "").unwrap();
        // where the two meet, arrivals are off by less than the error of the method
        assert!((arrival - exact).abs() < 0.7, "row {row}: {arrival} {exact}");
    }
    assert!(gradient_error(&model, 2) < 1e-5);
    let names = Maps::new(&model, &basis).all_names().join(" ");
    assert_eq!(names, format!("arrival[5+{}:sinus] arrival[5]", n - 9));

    let mut noise = rng(3);
    let data = rhythms(&surface, &basis, |rhythm, v| {
        let error: f64 = StandardNormal.sample(&mut noise);
        exact(rhythm, v) + error + if rhythm == "sinus" { 100.0 } else { -20.0 }
    });
    let model = Model::new(&breakthroughs::Breakthroughs, Some(&basis), &data).unwrap();
    let starts = jittered_starts(&model, &model.initial(), 2, 1).unwrap();
    let settings = Settings { chains: 2, warmup: 200, draws: 200, ..Settings::default() };
    let chains = Sampler::Nuts.sample(&model, &starts, &settings, &Silent).unwrap();
    let chains: Vec<_> = chains.into_iter().map(Result::unwrap).collect();
    let draws = thinned(&chains, usize::MAX).unwrap();
    let names = model.unknown_names();
    for (name, truth) in [("later[sinus]", 17.0), ("slowness", 1.4), ("onset[sinus]", 100.0)] {
        let at = names.iter().position(|own| own == name).unwrap();
        let own: Vec<f64> = draws.iter().map(|u| u[at]).collect();
        let mean = own.iter().sum::<f64>() / own.len() as f64;
        let sd = (own.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / own.len() as f64).sqrt();
        println!("{name}: {mean:.3} ± {sd:.3}, truth {truth}");
        assert!((mean - truth).abs() < 4.0 * sd && sd < 1.0, "{name}: {mean} ± {sd}");
    }
}

/// An operator of a model file's own: its derivatives, and those of the model.
#[test]
fn an_operator_of_ones_own_is_a_function_of_the_file() {
    let (surface, basis) = atrium(3.0);
    let data = rows(&surface, &basis, 13, &["v"]);
    let model = Model::new(&own::Catheter, Some(&basis), &data).unwrap();
    for point in 0..2 {
        let error = gradient_error(&model, point);
        assert!(error < 1e-5, "point {point}: {error}");
    }
    assert_eq!(Sampler::of(&model), Sampler::Nuts);
    let on = data.ground().unwrap().triangulation(Fineness::Any).unwrap();
    let everywhere = Everywhere { mesh: &on.mesh, at: &on.at, source: &[] };
    let operator = own::near(&everywhere, 8.0);
    let n = surface.mesh.n_vertices();
    let voltage: Vec<f64> = (0..n).map(|i| 3.0 + (i as f64).sin()).collect();
    let error = operator_error(&operator, &[&voltage, &vec![1.1; n]], on.at.len());
    assert!(error < 1e-6, "{error}");
}

/// A gradient that nothing measures is a map; the model is sampled as it would be without.
#[test]
fn a_gradient_and_what_follows_from_it_are_maps() {
    let (surface, basis) = atrium(3.0);
    let data = rows(&surface, &basis, 29, &["lat"]);
    let model = Model::new(shipped("lat_local"), Some(&basis), &data).unwrap();
    assert_eq!(Sampler::of(&model), Sampler::Integrated);
    let maps = Maps::new(&model, &basis);
    assert_eq!(maps.all_names(), ["arrival", "steepness", "velocity"]);
    let draws: Vec<Vec<f64>> = (0..150).map(|seed| some_draw(&model, seed)).collect();
    let asked = Exceedance::read("velocity < 0.5", &maps.all_names()).unwrap();
    let Summaries { maps: all, exceeded, unphysical } =
        maps.summarise(&draws, &Asked { exceed: &[asked], ..Asked::default() });
    let named = |name: &str| all.iter().find(|map| map.name == name).unwrap();
    let (steepness, velocity) = (named("steepness"), named("velocity"));
    assert_eq!((&*steepness.unit, &*velocity.unit, steepness.outside), ("ms/mm", "m/s", None));

    // by hand, in every second draw
    let gradient = Gradient::new(&surface.mesh);
    let kept: Vec<Vec<f64>> =
        draws.iter().step_by(2).map(|u| map_of(&model, &basis, u, "arrival")).collect();
    let mut outside = 0;
    for (v, exceeded) in exceeded[0].iter().enumerate() {
        let slopes: Vec<f64> = kept.iter().map(|values| gradient.length(v, values)).collect();
        let mean = slopes.iter().sum::<f64>() / slopes.len() as f64;
        assert!((steepness.mean[v] - mean).abs() < 1e-9, "{v}: {} {mean}", steepness.mean[v]);
        let within: Vec<f64> = slopes.iter().map(|s| 1.0 / s).filter(|v| *v <= 3.0).collect();
        outside += slopes.len() - within.len();
        let share = within.iter().filter(|v| **v < 0.5).count() as f64 / within.len() as f64;
        assert!((exceeded - share).abs() < 1e-12, "{v}: {exceeded} {share}");
    }
    let mean = unphysical.iter().sum::<f64>() / unphysical.len() as f64;
    assert!((mean - velocity.outside.unwrap()).abs() < 1e-12, "{mean}");
    let share = outside as f64 / (75 * surface.mesh.n_vertices()) as f64;
    assert!(share > 0.0 && (velocity.outside.unwrap() - share).abs() < 1e-12, "{share}");
}

/// How steep fields are is covered as it should be, where their arrivals are draws of the model's prior: eight tables of 60
/// rows. A twin that is steeper by three tenths is covered less.
#[test]
fn the_steepness_of_fitted_maps_is_calibrated() {
    let (surface, basis) = atrium(3.0);
    let gradient = Gradient::new(&surface.mesh);
    let (mut inside, mut of_twin, mut n) = (0, 0, 0);
    for seed in 0..8 {
        let mut rng = rng(seed);
        let mut data = rows(&surface, &basis, surface.mesh.n_vertices() / 60, &["lat"]);
        let model = Model::new(shipped("lat_local"), Some(&basis), &data).unwrap();
        let mut truth = some_draw(&model, seed);
        for (u, name) in truth.iter_mut().zip(model.unknown_names()) {
            match &*name {
                // ln of 30 ms, of 30 mm and of 2 ms
                "arrival.alpha" | "arrival.rho" => *u = 3.4,
                "noise" => *u = 0.7,
                _ => *u = StandardNormal.sample(&mut rng),
            }
        }
        let mut t = model.tape();
        model.forward(&mut t, &truth);
        let simulated = model.observes[0].simulate(&t, &mut rng);
        let values: Vec<f64> = simulated.into_iter().map(|row| row[0]).collect();
        data.set_numbers("value", &values);
        let arrivals = map_of(&model, &basis, &truth, "arrival");

        let model = Model::new(shipped("lat_local"), Some(&basis), &data).unwrap();
        let starts = jittered_starts(&model, &model.initial(), 4, seed).unwrap();
        let settings = Settings { chains: 4, draws: 250, seed, ..Settings::default() };
        let chains = Sampler::of(&model).sample(&model, &starts, &settings, &Silent).unwrap();
        let chains: Vec<_> = chains.into_iter().map(Result::unwrap).collect();
        let draws = thinned(&chains, usize::MAX).unwrap();
        let all = Maps::new(&model, &basis).summarise(&draws, &Asked::default()).maps;
        let map = all.iter().find(|map| map.name == "steepness").unwrap();
        for v in 0..surface.mesh.n_vertices() {
            let exact = gradient.length(v, &arrivals);
            let holds =
                |x: f64| i32::from((map.quantiles[0][v]..=map.quantiles[2][v]).contains(&x));
            inside += holds(exact);
            of_twin += holds(1.3 * exact);
            n += 1;
        }
    }
    let [share, of_twin] = [inside, of_twin].map(|k| f64::from(k) / f64::from(n));
    println!("{share:.3} of the surface within 90 % intervals, {of_twin:.3} of a twin's");
    assert!((0.82..0.96).contains(&share) && of_twin < 0.8, "{share} {of_twin}");
}

#[test]
fn a_gradient_needs_triangles() {
    let (_, basis) = atrium(3.0);
    let mut data = table("protocol,vertex,value", &["lat,3,20".into()]);
    data.place_at_indices(basis.n_vertices()).unwrap();
    let refused = Model::new(shipped("lat_local"), Some(&basis), &data).unwrap_err().to_string();
    assert!(
        refused.starts_with("let steepness: an operator over the surface needs its triangles"),
        "{refused}"
    );
    let refused = Model::new(&way::Way, Some(&basis), &data).unwrap_err().to_string();
    assert!(refused.contains("has no column `source`"), "{refused}");
}

/// Activation of a sheet-like wave at 0.7 m/s: the program shows its velocity.
#[test]
fn the_program_shows_the_local_velocity() {
    let place = Workplace::new();
    let surface = Surface::left_atrium(3.0);
    surface.write_maps(&place.path("atrium.vtp"), &[]).unwrap();
    let geodesic =
        integrate_along_paths(&surface.mesh, 5, &vec![1.0; surface.mesh.n_vertices()], 1);
    let lines: Vec<String> = geodesic
        .unwrap()
        .iter()
        .enumerate()
        .step_by(9)
        .map(|(v, mm)| format!("lat,{v},{}", 10.0 + mm / 0.7))
        .collect();
    place.file("lat.csv", format!("protocol,vertex,value\n{}\n", lines.join("\n")));
    let run = place.eplat(
        "run lat_local --mesh atrium.vtp --units mm --data lat.csv --draws 300 --exceed velocity>0.6 --out run",
    );
    assert!(matches!(run.status.code(), Some(0 | 3)), "{}", text(&run.stderr));
    let maps = place.read("run/fields.vtp");
    for name in ["steepness_mean", "velocity_q50", "velocity_sd", "P_velocity_gt_0.6"] {
        assert!(maps.contains(&format!("Name=\"{name}\"")), "{name}");
    }
}
