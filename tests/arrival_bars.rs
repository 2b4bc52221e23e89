//! What arrival times tell of velocity and fibres on a clinical left atrium, whose truth is the monodomain simulator's;
//! and how well a patient's are told of patches that are left out.
//!
//! ```text
//! cargo test --release --test arrival_bars -- --ignored --nocapture
//! ```
//! Activation from three sites is simulated with edges of 0.14 mm on the atrium of `FiberNet` (`of_fibres`), and on eplat's own with the
//! fibres of that one (`of_carried_fibres`). Fibres are those of the file, turned by a smooth angle that the model is not told;
//! velocity varies smoothly. Times at random vertices get 1 ms of noise and go through `eplat run lat_fibres`, which sees the file's
//! fibres only. `of_tissue_from_the_prior` draws the tissue from the model's prior, and takes the times of the equation on finer triangles
//! instead of the simulator's.
//!
//! Not in the repository: `fibernet/LA_model.vtk` of the reference data (`FiberNet`, Ruiz Herrera et al. 2022). Without it the
//! test says so.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/activation.rs"]
mod activation;
#[path = "support/program.rs"]
mod program;
#[path = "support/shipped.rs"]
mod shipped;
mod support;

use activation::{activation, in_surface, normals, per_triangle, unit, velocity};
use eplat::infer::Settings;
use eplat::manifold::{Eikonal, Front, Medium, eigenpairs};
use eplat::mesh::{Reading, Refined, Surface, TriMesh, halfway, read};
use eplat::model::{Maps, Model};
use program::{Workplace, shared, text};
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, Normal};
use shipped::shipped;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

const RATIO: f64 = 2.0;
/// How often triangles are cut for the simulator, to edges of 0.14 mm. Its velocities are measured on sheets of even
/// triangles with such edges. On an atrium's triangles its ratio is smaller than that: by 1.5 %, with 0.28 mm by 2.6 %.
const CUTS: u32 = 3;

/// What is to be found, at every vertex.
struct Tissue {
    /// Velocity along fibres and across, mm/ms.
    velocity: Vec<[f64; 2]>,
    /// By how much fibres are turned, rad.
    angle: Vec<f64>,
}

struct Truth {
    tissue: Tissue,
    /// Vertices where activation starts.
    sources: [usize; 3],
    /// Fibres, turned so.
    fibres: Vec<[f64; 3]>,
    /// Activation from each source, ms.
    activation: Vec<Vec<f64>>,
}

/// A smooth function of place with mean square 1, about.
fn wave(p: &[f64; 3], [a, b, c]: [f64; 3], phase: f64) -> f64 {
    2f64.sqrt() * (a * p[0] + b * p[1] + c * p[2] + phase).sin()
}

/// Normals that point out of the atrium.
fn outward(mesh: &TriMesh) -> Vec<[f64; 3]> {
    let normals = normals(mesh);
    let n = mesh.n_vertices() as f64;
    let middle: [f64; 3] =
        std::array::from_fn(|k| mesh.vertices().iter().map(|p| p[k]).sum::<f64>() / n);
    let out: f64 = mesh
        .vertices()
        .iter()
        .zip(&normals)
        .map(|(p, n)| (0..3).map(|k| (p[k] - middle[k]) * n[k]).sum::<f64>())
        .sum();
    normals.iter().map(|n| n.map(|x| x * out.signum())).collect()
}

/// Each fibre turned about its normal.
fn turned(fibres: &[[f64; 3]], normals: &[[f64; 3]], angle: &[f64]) -> Vec<[f64; 3]> {
    let of = |((f, n), angle): ((&[f64; 3], &[f64; 3]), &f64)| {
        let g = [n[1] * f[2] - n[2] * f[1], n[2] * f[0] - n[0] * f[2], n[0] * f[1] - n[1] * f[0]];
        unit(std::array::from_fn(|k| angle.cos() * f[k] + angle.sin() * g[k]))
    };
    fibres.iter().zip(normals).zip(angle).map(of).collect()
}

impl Truth {
    fn new(surface: &Surface, sources: [usize; 3]) -> Self {
        let mesh = &surface.mesh;
        let at = |of: &dyn Fn(&[f64; 3]) -> f64| mesh.vertices().iter().map(of).collect::<Vec<_>>();
        let cv_max = at(&|p| 0.75 + 0.12 * wave(p, [0.08, 0.05, -0.06], 0.4));
        let angle = at(&|p| 0.15 + 0.35 * wave(p, [-0.05, 0.09, 0.06], 1.0));
        let normals = outward(mesh);
        let (name, _) = surface.any_fibres().unwrap();
        let of_file = in_surface(&surface.fibres(name).unwrap(), &normals);
        let fibres = turned(&of_file, &normals, &angle);
        let fine = Refined::new(mesh.clone(), CUTS).unwrap();
        let carried = fine.carry(fibres.clone(), halfway);
        let cv = fine.carry(cv_max.clone(), |a, b| 0.5 * (a + b));
        let edge = fine.mesh.mean_edge_length();
        // what fronts on such edges make of CV_max, along fibres and across: more where they are thin
        let steps: Vec<f64> = (0..6).map(|i| 0.55 + 0.08 * f64::from(i)).collect();
        let along_and_across = |cv: &f64| {
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|fibre| velocity(edge, fibre, (*cv, RATIO)) / cv)
        };
        let shares: Vec<[f64; 2]> = steps.iter().map(along_and_across).collect();
        let share = |cv: f64, k: usize| {
            let at = ((cv - 0.55) / 0.08).clamp(0.0, 4.999);
            let (i, part) = (at as usize, at.fract());
            (1.0 - part) * shares[i][k] + part * shares[i + 1][k]
        };
        let mut activations = vec![];
        for source in sources {
            let begun = Instant::now();
            let at = mesh.vertices()[source];
            let near = |p: &[f64; 3]| (0..3).map(|k| (p[k] - at[k]).powi(2)).sum::<f64>() < 4.0;
            let paced = (0..fine.mesh.n_vertices() as u32)
                .filter(|v| near(&fine.mesh.vertices()[*v as usize]));
            let all = activation(&fine.mesh, (&carried, RATIO), &cv, paced.collect(), 260.0);
            let lat = all[..mesh.n_vertices()].to_vec();
            let last = lat.iter().fold(0.0, |a: f64, b| a.max(*b));
            println!("from vertex {source}: until {last:.0} ms, {:.1?}", begun.elapsed());
            activations.push(lat);
        }
        let velocity = cv_max.iter().map(|cv| [0, 1].map(|k| share(*cv, k) * cv)).collect();
        println!("edges of {edge:.2} mm, CV / CV_max {shares:.3?} at {steps:.2?}");
        Self { tissue: Tissue { velocity, angle }, sources, fibres, activation: activations }
    }

    /// Prints by how much arrivals with the true tissue differ from the simulator's: without and with the thickness that
    /// fronts have in theory, and with the slowing of their own shape; on the surface's own triangles, and cut into 4 and 16.
    fn beside_the_equation(&self, surface: &Surface) {
        for times in 0..3 {
            let fine = Refined::new(surface.mesh.clone(), times).unwrap();
            let mesh = &fine.mesh;
            let fibres = fine.carry(self.fibres.clone(), halfway);
            let velocity = fine
                .carry(self.tissue.velocity.clone(), |a, b| [0, 1].map(|k| 0.5 * (a[k] + b[k])));
            let eikonal = Eikonal::new(mesh, Some(&per_triangle(mesh, &fibres))).unwrap();
            let slowness: Vec<f64> = velocity.iter().map(|v| 1.0 / v[0]).collect();
            let ratio: Vec<f64> = velocity.iter().map(|v| v[0] / v[1]).collect();
            for (source, lat) in self.sources.iter().zip(&self.activation) {
                let theory = activation::TAU_IN / 0.32;
                for (thickness, settled) in [(0.0, false), (theory, false), (theory, true)] {
                    let thick = vec![thickness; slowness.len()];
                    let medium = Medium {
                        slowness: &slowness,
                        ratio: Some(&ratio),
                        angle: None,
                        thickness: Some(&thick),
                    };
                    let (mut front, born) = (Front::default(), [(*source as u32, 0.0)]);
                    let arrival = if settled {
                        eikonal.settled(&medium, &born, &mut front)
                    } else {
                        eikonal.forward(&medium, &born, &mut front);
                        front.arrival
                    };
                    // where the stimulus does not reach
                    let far = lat.iter().zip(&arrival).filter(|(lat, _)| **lat > 10.0);
                    let pairs: Vec<(f64, f64)> = far.map(|(lat, t)| (*t, lat - t)).collect();
                    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| {
                        pairs.iter().map(of).sum::<f64>() / pairs.len() as f64
                    };
                    let [t, gap] = [mean(&|p| p.0), mean(&|p| p.1)];
                    let slope = mean(&|p| (p.0 - t) * (p.1 - gap)) / mean(&|p| (p.0 - t).powi(2));
                    let rms =
                        |slope: f64| mean(&|p| (p.1 - gap - slope * (p.0 - t)).powi(2)).sqrt();
                    println!(
                        "{} vertices, from vertex {source}, thickness {thickness:.2} ms{}: simulator's later by {gap:.2} ms and {:.1} % of the time, rms {:.2} ms, with that line taken off {:.2}",
                        mesh.n_vertices(),
                        if settled { ", slowing of its own shape" } else { "" },
                        100.0 * slope,
                        rms(0.0),
                        rms(slope),
                    );
                }
            }
        }
    }

    /// Times at `n` random vertices from each of these sources, with 1 ms noise.
    fn recorded(&self, n: usize, sources: &[usize], seed: u64) -> String {
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let noise = Normal::new(0.0, 1.0).unwrap();
        let mut rows = String::from("protocol,site,vertex,source,value\n");
        for site in 0..n {
            let vertex = rng.random_range(0..self.tissue.angle.len());
            for source in sources {
                let value = self.activation[*source][vertex] + noise.sample(&mut rng);
                writeln!(rows, "lat,{site},{vertex},{},{value}", self.sources[*source]).unwrap();
            }
        }
        rows
    }
}

impl Tissue {
    /// Shares of the surface that a finished run has right, and how it was got.
    fn judge(&self, what: &str, fitted: &Surface) {
        let of = |name: &str| fitted.point_data[name].scalars().unwrap();
        let share = |is: &dyn Fn(usize) -> bool| {
            let n = self.angle.len();
            100.0 * (0..n).filter(|v| is(*v)).count() as f64 / n as f64
        };
        let (angle, along, across) =
            (of("angle_mean"), of("velocity_mean"), of("velocity_across_mean"));
        let off = |a: f64, b: f64| {
            let gap = (a - b).rem_euclid(std::f64::consts::PI);
            gap.min(std::f64::consts::PI - gap)
        };
        let right = [
            share(&|v| off(angle[v], self.angle[v]) < std::f64::consts::FRAC_PI_6),
            share(&|v| (across[v] - self.velocity[v][1]).abs() < 0.1),
            share(&|v| (along[v] - self.velocity[v][0]).abs() < 0.2),
        ];
        let untold = share(&|v| off(0.0, self.angle[v]) < std::f64::consts::FRAC_PI_6);
        let held = |name: &str, truth: &dyn Fn(usize) -> f64| {
            let [low, high] = ["q5", "q95"].map(|q| of(&format!("{name}_{q}")));
            share(&|v| (low[v]..=high[v]).contains(&truth(v)))
        };
        let held = [
            held("angle", &|v| self.angle[v]),
            held("velocity_across", &|v| self.velocity[v][1]),
            held("velocity", &|v| self.velocity[v][0]),
        ];
        let rms = |of: &[f64], truth: &dyn Fn(usize) -> f64| {
            (of.iter().enumerate().map(|(v, x)| (x - truth(v)).powi(2)).sum::<f64>()
                / of.len() as f64)
                .sqrt()
        };
        println!(
            "{what}: angle within 30° {:.0} % (fibres of the file {untold:.0}), across within 0.1 m/s {:.0} %, along within \
             0.2 m/s {:.0} %; in 90 % intervals {:.0}, {:.0}, {:.0} %; rms {:.3} rad, {:.3}, {:.3} m/s",
            right[0],
            right[1],
            right[2],
            held[0],
            held[1],
            held[2],
            rms(angle, &|v| self.angle[v]),
            rms(across, &|v| self.velocity[v][1]),
            rms(along, &|v| self.velocity[v][0]),
        );
    }
}

/// Runs `lat_fibres` on the atrium in `file` and prints how much of its tissue is told.
fn fit(file: &Path, what: &str, table: String, truth: &Tissue) {
    let settings = std::env::var("EPLAT_BARS").unwrap_or_else(|_| "--seed 1".into());
    let place = Workplace::new();
    place.file("lat.csv", table);
    let begun = Instant::now();
    let run = place.eplat(&format!(
        "run lat_fibres --mesh {} --data lat.csv --out run {settings}",
        file.display()
    ));
    let seconds = begun.elapsed().as_secs_f64();
    println!("{}", text(&run.stdout));
    if !place.path("run/fields.vtp").exists() {
        println!("{what}: {}", text(&run.stderr));
        return;
    }
    let what = format!("{what}, {seconds:.0} s, exit {:?}", run.status.code());
    truth.judge(&what, &read(&place.path("run/fields.vtp"), Reading::default()).unwrap());
}

/// Prints how well four designs tell velocity and fibres of the atrium in `file`.
fn tell(file: &Path, sources: [usize; 3]) {
    let surface = read(file, Reading::default()).unwrap();
    let truth = Truth::new(&surface, sources);
    truth.beside_the_equation(&surface);
    for (sites, sources) in
        [(200, &[0, 1, 2][..]), (600, &[0, 1, 2]), (200, &[0]), (100, &[0, 1, 2])]
    {
        let what = format!("{sites} sites, {} maps", sources.len());
        fit(file, &what, truth.recorded(sites, sources, 7), &truth.tissue);
    }
}

/// Arrival times that the model says of unknowns drawn from its prior, with 1 ms of noise, on finer triangles, and the tissue there.
fn drawn(surface: &Surface, n: usize, sources: [usize; 3], seed: u64) -> (String, Tissue) {
    let mut rng = support::rng(seed);
    let site = |site| (site, rng.random_range(0..surface.mesh.n_vertices()));
    let sites: Vec<_> = (0..n).map(site).collect();
    let row = |(site, vertex)| sources.map(|source| format!("lat,{site},{vertex},{source},0"));
    let rows: Vec<String> = sites.into_iter().flat_map(row).collect();
    let basis = eigenpairs(&surface.mesh, 64).unwrap();
    let mut data = support::table("protocol,site,vertex,source,value", &rows);
    data.place_on(surface, 1.0).unwrap();
    data.probe(surface, &basis).unwrap();
    let mut model = Model::new(shipped("lat_fibres"), Some(&basis), &data).unwrap();
    let settings = Settings { chains: 1, draws: 1, seed, ..Settings::default() };
    let mut u = model.prior_draws(&settings).unwrap()[0].draw(0).unwrap().into_owned();
    let noise = model.unknown_names().iter().position(|name| name == "noise").unwrap();
    u[noise] = 0.0; // ln of 1 ms
    model.correct_at(std::slice::from_ref(&u)).unwrap();
    let mut tape = model.tape();
    model.forward(&mut tape, &u);
    let times: Vec<f64> = model.observes[0].simulate(&tape, &mut rng).concat();
    data.set_numbers("value", &times);
    let maps = Maps::new(&model, &basis);
    let everywhere: Vec<usize> = (0..surface.mesh.n_vertices()).collect();
    let at = maps.draws_at(std::slice::from_ref(&u), &everywhere);
    let map = |name: &str| maps.all_names().iter().position(|own| *own == name).unwrap();
    let [along, across, angle] = ["velocity", "velocity_across", "angle"].map(map);
    let velocity = at.iter().map(|maps| [maps[along][0], maps[across][0]]).collect();
    let angle = at.iter().map(|maps| maps[angle][0]).collect();
    (data.to_csv(), Tissue { velocity, angle })
}

#[test]
#[ignore = "minutes"]
fn what_arrival_times_tell_of_fibres() {
    let Some(file) = shared("fibernet/LA_model.vtk") else { return };
    tell(&file, [4000, 92, 8835]);
}

/// eplat's own atrium with the fibres of that one, and three places of pacing.
fn carried(place: &Workplace) -> Option<(PathBuf, [usize; 3])> {
    let other = shared("fibernet/LA_model.vtk")?;
    let from = other.display();
    for arguments in [
        "mesh atrium --edge 1.1 --out bare.vtp",
        &format!("mesh fibres bare.vtp atrium.vtp --from {from}"),
    ] {
        let made = place.eplat(arguments);
        assert!(made.status.success(), "{}", text(&made.stderr));
    }
    let sites = place.eplat("mesh sites atrium.vtp --n 3");
    let sites: Vec<usize> = text(&sites.stdout)
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(1).unwrap().parse().unwrap())
        .collect();
    Some((place.path("atrium.vtp"), sites.try_into().unwrap()))
}

#[test]
#[ignore = "minutes"]
fn what_arrival_times_tell_of_carried_fibres() {
    let place = Workplace::new();
    let Some((file, sources)) = carried(&place) else { return };
    tell(&file, sources);
}

/// What intervals lack here is neither the simulator's nor that of a truth that the prior does not expect.
#[test]
#[ignore = "16 runs, half an hour and more: one tissue did not end in eight minutes"]
fn what_arrival_times_tell_of_tissue_from_the_prior() {
    let place = Workplace::new();
    let Some((file, sources)) = carried(&place) else { return };
    let surface = read(&file, Reading::default()).unwrap();
    for (n, seed) in [200, 600].into_iter().flat_map(|n| (1..=8).map(move |seed| (n, seed))) {
        let (table, tissue) = drawn(&surface, n, sources, seed);
        fit(&file, &format!("{n} sites, 3 maps, prior draw {seed}"), table, &tissue);
    }
}

/// Slowness that varies along straight paths, and a field that is added to one velocity's times.
const ON_STRAIGHT_PATHS: [&str; 2] = [
    "field slowness(x) [ms/mm] = m + alpha * gp(Matern52(rho), K = 64) where {
        m     [ms/mm] ~ Normal(1.0, 0.5);
        alpha [ms/mm] ~ HalfNormal(0.5);
        rho   [mm]    ~ LogNormal(3.4, 0.5);
    }
    let way(row) [ms] = path(slowness(row); row.source);
    let arrival(row) [ms] = onset + way(row);",
    "column path_mm [mm];
    param slowness [ms/mm] ~ Normal(1.0, 0.5);
    field further(x) [ms] = alpha * gp(Matern52(rho), K = 64) where {
        alpha [ms] ~ HalfNormal(20.0);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }
    let arrival(row) [ms] = onset + slowness * row.path_mm + further(row);",
];

/// Not in the repository: `openep_la/la_lat.vtk` of the reference data.
#[test]
#[ignore = "48 runs, a quarter of an hour"]
fn patches_left_out_of_a_clinical_map() {
    let Some(file) = shared("openep_la/la_lat.vtk") else { return };
    let place = Workplace::new();
    let table = place.path("lat.csv");
    let made = std::process::Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--release", "--example", "measured_tables", "--", "lat"])
        .args([&file, &table])
        .status();
    assert!(made.unwrap().success());
    for (name, own) in ["slowness.rs", "added.rs"].iter().zip(ON_STRAIGHT_PATHS) {
        let text = format!(
            "use eplat::prelude::*;\n\nmodel! {{\n    model Own;\n    param onset [ms] ~ Normal(0.0, 100.0);\n    \
             param noise [ms] ~ HalfNormal(20.0);\n    {own}\n    \
             observe lat(row): Number [ms] ~ Normal(arrival(row), noise);\n}}\n"
        );
        place.file(name, text);
    }
    let text_of = std::fs::read_to_string(&table).unwrap();
    let (header, rows) = text_of.split_once('\n').unwrap();
    let fold = |row: &str| row.split(',').nth(3).unwrap().to_owned();
    let folds: std::collections::BTreeSet<String> = rows.lines().map(fold).collect();
    for (model, draws) in
        [("lat", 300), ("slowness.rs", 300), ("lat_velocity", 300), ("added.rs", 500)]
    {
        let (mut square, mut inside, mut n, mut red) = (0.0, 0.0, 0.0, 0);
        for own in &folds {
            let of = |left_out: bool| {
                let kept = rows.lines().filter(|row| (fold(row) == *own) == left_out);
                [&[header], &kept.collect::<Vec<_>>()[..]].concat().join("\n") + "\n"
            };
            place.file("fitted.csv", of(false)).file("left_out.csv", of(true));
            let run = place.eplat(&format!(
                "run {model} --mesh {} --units mm --data fitted.csv --chains 2 --warmup {draws} --draws {draws} --out run --force",
                file.display()
            ));
            assert!(place.path("run/run.json").exists(), "{}", text(&run.stderr));
            red += usize::from(run.status.code() == Some(3));
            let predicted = place.eplat("predict run left_out.csv --out predicted");
            assert!(predicted.status.success(), "{}", text(&predicted.stderr));
            let csv = place.read("predicted/predictions.csv");
            let at = |title: &str| csv.lines().next().unwrap().split(',').position(|c| c == title);
            let [measured, median, is_inside] =
                ["measured_lower", "predicted_q50", "inside"].map(|title| at(title).unwrap());
            for cells in csv.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>()) {
                let [y, q50]: [f64; 2] = [measured, median].map(|at| cells[at].parse().unwrap());
                square += (y - q50).powi(2);
                inside += f64::from(u8::from(cells[is_inside] == "true"));
                n += 1.0;
            }
            std::fs::remove_dir_all(place.path("predicted")).unwrap();
        }
        println!(
            "{model}: left out {:.2} ms rms, {:.0} % in 90 % intervals; {red} of {} fits not converged",
            f64::sqrt(square / n),
            100.0 * inside / n,
            folds.len()
        );
    }
}
