//! Every model that ships recovers what its measurements were simulated from.
//!
//! Measurements are simulated by the model itself at known unknowns; the posterior mean of every
//! parameter, and of every field at every vertex, must lie within a few posterior standard deviations
//! of the truth (Bonferroni, 0.1 % over all quantities of a test). A likelihood of the wrong width
//! must be found out.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "models/broken.rs"]
mod broken;
#[path = "models/joint_parts.rs"]
mod joint_parts;
#[path = "models/language.rs"]
mod language;
#[path = "support/shipped.rs"]
mod shipped;
mod support;

use std::path::Path;

use eplat::diagnostics::{Summary, summarise};
use eplat::experiment::thinned;
use eplat::infer::{Chain, Settings, Silent, jittered_starts};
use eplat::manifold::Basis;
use eplat::model::{Asked, Declare, Kind, Maps, Model, Sampler};
use eplat::table::Measurements;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use shipped::shipped;
use support::{basis, rng, table};

const VERTICES: usize = 200;

/// A table under construction: cells as numbers, NaN for an empty one, or as text.
struct Table {
    header: &'static str,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn read(&self) -> Measurements {
        let rows: Vec<String> = self.rows.iter().map(|r| r.join(",")).collect();
        let mut data = table(self.header, &rows);
        if data.has("vertex") {
            data.place_at_indices(VERTICES).unwrap();
        }
        data
    }

    fn column(&self, name: &str) -> usize {
        self.header.split(',').position(|h| h == name).unwrap()
    }
}

/// What measurements were simulated from.
struct Truth {
    reported: Vec<f64>,
    fields: Vec<Vec<f64>>,
}

/// The unknowns behind a truth: GP coefficients and labelled numbers standard normal, others as given
/// (unconstrained).
fn unknowns(model: &Model, given: &[(&str, f64)], rng: &mut ChaCha8Rng) -> Vec<f64> {
    let value = |name: &String| {
        if let Some((_, u)) = given.iter().find(|(n, _)| n == name) {
            return *u;
        }
        assert!(name.contains(".eta") || name.starts_with("z["), "{name} is not given");
        rng.sample(StandardNormal)
    };
    model.unknown_names().iter().map(value).collect()
}

/// Writes measurements that `model` simulates into a table that has its rows already.
fn simulate(
    model: &dyn Declare,
    basis: Option<&Basis>,
    table: &mut Table,
    given: &[(&str, f64)],
    seed: u64,
) -> Truth {
    let mut rng = rng(seed);
    let laid_out = Model::new(model, basis, &table.read()).unwrap();
    let u = unknowns(&laid_out, given, &mut rng);
    let mut tape = laid_out.tape();
    laid_out.forward(&mut tape, &u);
    let mut truth = Truth { reported: vec![], fields: vec![] };
    laid_out.report(&tape, &mut rng, &mut truth.reported);
    truth.fields =
        basis.map_or(vec![], |basis| field_moments(&laid_out, basis, std::slice::from_ref(&u)).0);
    for observe in &laid_out.observes {
        for (row, cells) in observe.rows.iter().zip(observe.simulate(&tape, &mut rng)) {
            for (name, cell) in observe.columns.iter().zip(cells) {
                let in_its_own = *name == "value" && !table.header.contains("value");
                let column = table.column(if in_its_own { observe.name } else { name });
                table.rows[*row][column] =
                    if cell.is_finite() { cell.to_string() } else { String::new() };
            }
        }
    }
    truth
}

/// Mean and standard deviation of every field at every vertex over draws.
fn field_moments(
    model: &Model,
    basis: &Basis,
    draws: &[Vec<f64>],
) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let maps = Maps::new(model, basis);
    let summaries = maps.summarise(draws, &Asked::default()).maps;
    summaries.into_iter().take(maps.n_fields()).map(|s| (s.mean, s.sd)).unzip()
}

/// A model with its draws.
struct Fit {
    model: Model,
    chains: Vec<Chain>,
}

fn fit(model: &dyn Declare, basis: Option<&Basis>, data: &Measurements, draws: usize) -> Fit {
    let model = Model::new(model, basis, data).unwrap();
    let settings = Settings { warmup: 500, draws, target_accept: Some(0.9), ..Default::default() };
    let starts = jittered_starts(&model, &model.initial(), settings.chains, 1).unwrap();
    let chains = Sampler::of(&model).sample(&model, &starts, &settings, &Silent).unwrap();
    Fit { model, chains: chains.into_iter().map(Result::unwrap).collect() }
}

impl Fit {
    /// Name, place among the reported numbers, and summary of everything but GP coefficients.
    fn summaries(&self) -> Vec<(String, usize, Summary)> {
        let (mut rng, mut tape) = (rng(99), self.model.tape());
        let mut reported = |chain: &Chain| {
            let mut out = vec![];
            for i in 0..chain.n_draws() {
                self.model.forward(&mut tape, &chain.draw(i).unwrap());
                self.model.report(&tape, &mut rng, &mut out);
            }
            out
        };
        let chains: Vec<Vec<f64>> = self.chains.iter().map(&mut reported).collect();
        let (mut out, mut at) = (vec![], 0);
        for p in &self.model.parameters {
            for i in (0..p.len).filter(|_| p.kind != Kind::Eta) {
                let step = self.model.n_reported();
                let of = |c: &Vec<f64>| c.iter().skip(at + i).step_by(step).copied().collect();
                let values: Vec<Vec<f64>> = chains.iter().map(of).collect();
                let slices: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
                out.push((p.element(i), at + i, summarise(&slices)));
            }
            at += p.len;
        }
        out
    }

    fn get(&self, name: &str) -> Summary {
        self.summaries().into_iter().find(|(n, ..)| n == name).unwrap().2
    }

    /// Distance of each posterior mean from the truth in posterior standard deviations, and its name.
    fn scores(&self, truth: &Truth, basis: Option<&Basis>) -> Vec<(f64, String)> {
        let mut out = vec![];
        for (name, at, s) in self.summaries() {
            out.push(((s.mean - truth.reported[at]).abs() / s.sd.hypot(s.mcse), name));
        }
        if let Some(basis) = basis {
            let draws = thinned(&self.chains, usize::MAX).unwrap();
            let (means, sds) = field_moments(&self.model, basis, &draws);
            for ((mean, sd), truth) in means.iter().zip(&sds).zip(&truth.fields) {
                let score = |v: usize| ((mean[v] - truth[v]).abs() / sd[v], format!("vertex {v}"));
                out.extend((0..VERTICES).map(score));
            }
        }
        out
    }

    fn worst_r_hat(&self) -> (f64, String) {
        let figures = self.summaries().into_iter().map(|(name, _, s)| (s.r_hat, name));
        figures.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
    }
}

/// The two-sided normal limit for `n` scores at 0.1 % in all: 2 Φ(−z) ≤ exp(−z²/2).
fn limit(n: usize) -> f64 {
    (2.0 * (n as f64 / 0.001).ln()).sqrt()
}

/// The worst score as a share of the limit: recovered below 1.
fn worst(fit: &Fit, truth: &Truth, basis: Option<&Basis>) -> (f64, String) {
    let scores = fit.scores(truth, basis);
    let limit = limit(scores.len());
    let (score, name) = scores.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    (score / limit, name)
}

fn assert_recovered(fit: &Fit, truth: &Truth, basis: Option<&Basis>) {
    let (share, name) = worst(fit, truth, basis);
    println!("{}: worst score {share:.2} of the limit ({name})", fit.model.name);
    assert!(share < 1.0, "{}: {name} at {share:.2} of the limit", fit.model.name);
    let (r_hat, name) = fit.worst_r_hat();
    println!("{}: R-hat {r_hat:.3} ({name})", fit.model.name);
    assert!(r_hat < 1.05, "{}: R-hat {r_hat} ({name})", fit.model.name);
}

fn assert_found_out(fit: &Fit, truth: &Truth, basis: Option<&Basis>) {
    let (share, name) = worst(fit, truth, basis);
    println!("{}, broken: worst score {share:.2} of the limit ({name})", fit.model.name);
    assert!(share > 1.0, "{}: the broken twin passes: {name} at {share:.2}", fit.model.name);
}

#[test]
fn normal_recovers_mean_and_spread() {
    let mut table = Table { header: "y", rows: vec![vec!["0".into()]; 200] };
    let given = [("mu", -3.0), ("sigma", 2.5f64.ln())];
    let truth = simulate(shipped("normal"), None, &mut table, &given, 1);
    assert_recovered(&fit(shipped("normal"), None, &table.read(), 500), &truth, None);
    assert_found_out(&fit(&broken::normal::MeanAndSpread, None, &table.read(), 500), &truth, None);
}

#[test]
fn regression_recovers_coefficients_and_spread() {
    let mut rng = rng(2);
    let mut row = |_| {
        let mut x = || rng.random_range(-2.0..2.0f64).to_string();
        vec!["0".into(), x(), x(), x()]
    };
    let mut table = Table { header: "y,x1,x2,x3", rows: (0..150).map(&mut row).collect() };
    let beta = [("beta[0]", 1.5), ("beta[1]", 0.0), ("beta[2]", -4.0)];
    let given = [&beta[..], &[("intercept", 10.0), ("sigma", 0.7f64.ln())]].concat();
    let truth = simulate(shipped("regression"), None, &mut table, &given, 3);
    assert_recovered(&fit(shipped("regression"), None, &table.read(), 500), &truth, None);
    let twin = fit(&broken::regression::Regression, None, &table.read(), 500);
    assert_found_out(&twin, &truth, None);
}

#[test]
fn a_table_with_another_number_of_columns_is_refused() {
    let text = |header: &str, row: &str| {
        let error = Model::new(shipped("regression"), None, &table(header, &[row.into()]));
        error.unwrap_err().to_string()
    };
    let four = text("y,x1,x2,x3,x4", "1,2,3,4,5");
    assert!(four.starts_with("let mean: `beta` has 3 coefficients, the design has 4"), "{four}");
    assert!(four.contains("help: declare `param beta(4) ~ …;`"), "{four}");
    let two = text("y,x1,x2", "1,2,3");
    assert!(two.starts_with("let mean: `beta` has 3 coefficients, the design has 2"), "{two}");
    let none = text("y,z", "1,2");
    assert!(none.contains("no column `x1`, which a linear predictor reads"), "{none}");
}

/// E mu and E tau of eight schools, exactly: `mu` given `tau` is normal, `tau` by quadrature.
fn eight_schools_by_quadrature(y: &[f64], se: &[f64]) -> (f64, f64) {
    let (mut mass, mut mu, mut tau_mean) = (0.0, 0.0, 0.0);
    for i in -12_000..12_000 {
        let tau = (f64::from(i) * 1e-3).exp();
        let variances = || se.iter().map(|s| s * s + tau * tau);
        let precision = 1.0 / 25.0 + variances().map(f64::recip).sum::<f64>();
        let mean = y.iter().zip(variances()).map(|(y, v)| y / v).sum::<f64>() / precision;
        let fit = y.iter().zip(variances()).map(|(y, v)| -0.5 * (v.ln() + y * y / v));
        let ln_p = fit.sum::<f64>() + 0.5 * (mean * mean * precision - precision.ln());
        let weight = ln_p.exp() * tau / (1.0 + (tau / 5.0).powi(2));
        mass += weight;
        mu += weight * mean;
        tau_mean += weight * tau;
    }
    (mu / mass, tau_mean / mass)
}

#[test]
fn eight_schools_has_its_published_posterior() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("models").join("eight_schools.csv");
    let data = Measurements::read(&file).unwrap();
    let y = [28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0];
    let se = [15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0];
    let (mu, tau) = eight_schools_by_quadrature(&y, &se);
    // posteriordb, eight_schools-eight_schools_noncentered: 4.41 and 3.60, of MCSE 0.03 each
    assert!((mu - 4.41).abs() < 0.1 && (tau - 3.6).abs() < 0.1, "{mu} {tau}");
    let score = |fit: &Fit, name: &str, expected: f64| {
        let s = fit.get(name);
        println!("{name}: {:.3} ± {:.3}, exactly {expected:.3}", s.mean, s.mcse);
        (s.mean - expected).abs() / s.mcse
    };
    let good = fit(shipped("eight_schools"), None, &data, 2500);
    let limit = limit(2);
    assert!(score(&good, "mu", mu) < limit && score(&good, "tau", tau) < limit);
    assert!(good.worst_r_hat().0 < 1.01, "{:?}", good.worst_r_hat());
    let twin = fit(&broken::eight_schools::EightSchools, None, &data, 2500);
    assert!(score(&twin, "mu", mu) > limit && score(&twin, "tau", tau) > limit);
}

/// Both protocols at vertices 0, 4, 8, …, brackets of 10 ms.
fn sites(n: usize) -> Table {
    let row = |i: usize| {
        let cells = [(4 * (i / 2)).to_string(), ["s1s2", "s1s2s3"][i % 2].into()];
        [&cells[..], &["200".into(), "210".into()]].concat()
    };
    Table { header: "vertex,protocol,lower,upper", rows: (0..2 * n).map(row).collect() }
}

/// The same table with every bracket displaced by normal noise of `sd` ms.
fn displaced(table: &Table, sd: f64) -> Table {
    let mut rng = rng(8);
    let shift = |row: &Vec<String>| {
        let shift = sd * rng.sample::<f64, _>(StandardNormal);
        let moved =
            |cell: &String| cell.parse::<f64>().map_or(String::new(), |x| (x + shift).to_string());
        vec![row[0].clone(), row[1].clone(), moved(&row[2]), moved(&row[3])]
    };
    Table { header: table.header, rows: table.rows.iter().map(shift).collect() }
}

#[test]
fn erp_exact_recovers_fields_and_noise_with_open_brackets() {
    let basis = basis(VERTICES, 24);
    let given = [
        ("tau_out.m", 12.0),
        ("tau_out.alpha", 2.6f64.ln()),
        ("tau_out.rho", 64f64.ln()),
        ("apd_max.m", 195.0),
        ("apd_max.alpha", 13f64.ln()),
        ("apd_max.rho", 50f64.ln()),
        ("noise", 3f64.ln()),
    ];
    let mut table = sites(40);
    let truth = simulate(shipped("erp_exact"), Some(&basis), &mut table, &given, 5);
    // the protocol ended at 230 ms: what captured nowhere below is known to be longer
    let mut n_open = 0;
    for row in table.rows.iter_mut().filter(|r| r[2].parse::<f64>().unwrap() >= 230.0) {
        (row[2], row[3], n_open) = ("230".into(), String::new(), n_open + 1);
    }
    assert!((5..40).contains(&n_open), "{n_open} brackets are open");
    let good = fit(shipped("erp_exact"), Some(&basis), &table.read(), 1000);
    assert_recovered(&good, &truth, Some(&basis));
    let twin = fit(shipped("erp_exact"), Some(&basis), &displaced(&table, 15.0).read(), 400);
    assert_found_out(&twin, &truth, Some(&basis));
}

#[test]
fn erp_emulated_recovers_fields() {
    let basis = basis(VERTICES, 24);
    let given = [
        ("tau_out.m", 12.0),
        ("tau_out.alpha", 2.6f64.ln()),
        ("tau_out.rho", 64f64.ln()),
        ("apd_max.m", 195.0),
        ("apd_max.alpha", 13f64.ln()),
        ("apd_max.rho", 50f64.ln()),
    ];
    let mut table = sites(40);
    let model = shipped("erp_emulated");
    let truth = simulate(model, Some(&basis), &mut table, &given, 5);
    let good = fit(model, Some(&basis), &table.read(), 1000);
    assert_recovered(&good, &truth, Some(&basis));
    let twin = fit(model, Some(&basis), &displaced(&table, 20.0).read(), 400);
    assert_found_out(&twin, &truth, Some(&basis));
}

/// Four intervals S2 at each of `n` sites.
fn curves(n: usize) -> Table {
    let row = |i: usize| [(4 * (i / 4)).to_string(), (300 + 60 * (i % 4)).to_string(), "0".into()];
    Table { header: "vertex,s2_ms,value", rows: (0..4 * n).map(|i| row(i).to_vec()).collect() }
}

/// The same table with every S2 said to be 40 ms longer than it was.
fn late(table: &Table) -> Table {
    let shift = |row: &Vec<String>| {
        vec![row[0].clone(), (row[1].parse::<f64>().unwrap() + 40.0).to_string(), row[2].clone()]
    };
    Table { header: table.header, rows: table.rows.iter().map(shift).collect() }
}

/// The unconstrained value of `x` between bounds.
fn between(x: f64, low: f64, high: f64) -> f64 {
    ((x - low) / (high - x)).ln()
}

/// Unknowns of a field of mean `m`, amplitude `alpha` and lengthscale 60 mm.
fn field(name: &str, m: f64, alpha: f64) -> [(String, f64); 3] {
    [("m", m), ("alpha", alpha.ln()), ("rho", 60f64.ln())]
        .map(|(of, value)| (format!("{name}.{of}"), value))
}

/// The same table with every value a quarter larger: a distance that was not what it was taken for.
fn larger(table: &Table) -> Table {
    let scale = |row: &Vec<String>| {
        vec![row[0].clone(), row[1].clone(), (row[2].parse::<f64>().unwrap() * 1.25).to_string()]
    };
    Table { header: table.header, rows: table.rows.iter().map(scale).collect() }
}

fn restitution_is_recovered(
    model: &dyn Declare,
    given: &[(String, f64)],
    seed: u64,
    broken: fn(&Table) -> Table,
) {
    let basis = basis(VERTICES, 24);
    let given: Vec<(&str, f64)> = given.iter().map(|(name, u)| (name.as_str(), *u)).collect();
    let mut table = curves(18);
    let truth = simulate(model, Some(&basis), &mut table, &given, seed);
    let good = fit(model, Some(&basis), &table.read(), 600);
    assert_recovered(&good, &truth, Some(&basis));
    assert!(good.worst_r_hat().0 < 1.02);
    let twin = fit(model, Some(&basis), &broken(&table).read(), 200);
    assert_found_out(&twin, &truth, Some(&basis));
}

#[test]
fn apd_restitution_recovers_fields_and_noise() {
    let fields =
        [field("tau_out", 12.0, 2.0), field("tau_open", 120.0, 8.0), field("apd_max", 180.0, 8.0)];
    let given = [fields.concat(), vec![("noise".into(), 2f64.ln())]].concat();
    restitution_is_recovered(shipped("apd_restitution"), &given, 15, late);
}

#[test]
fn cv_restitution_recovers_fields_and_noise() {
    let fields = [field("cv_max", 0.8, 0.08), field("ln_tau_in", -2.5, 0.25)];
    let others = [("apd_max".into(), between(190.0, 120.0, 270.0)), ("noise".into(), 0.01f64.ln())];
    let given = [fields.concat(), others.to_vec()].concat();
    restitution_is_recovered(shipped("cv_restitution"), &given, 16, larger);
}

/// Both ERP, APD90 and CV at three S2, each at `n` sites of its own.
fn everything(n: usize) -> Table {
    let mut rows = vec![];
    for i in 0..n {
        let row = |offset: usize, protocol: &str, s2: &str| {
            let own = [&(9 * i + offset).to_string(), protocol, s2].map(String::from);
            [&own[..], &["200", "210", "0"].map(String::from)].concat()
        };
        rows.extend(["s1s2", "s1s2s3"].map(|protocol| row(0, protocol, "300")));
        for (offset, protocol) in [(3, "apd"), (6, "speed")] {
            rows.extend(["300", "380", "500"].map(|s2| row(offset, protocol, s2)));
        }
    }
    Table { header: "vertex,protocol,s2_ms,lower,upper,value", rows }
}

impl Table {
    /// The rows of these protocols.
    fn of(&self, protocols: &[&str]) -> Table {
        let is_one = |row: &&Vec<String>| protocols.contains(&row[1].as_str());
        Table { header: self.header, rows: self.rows.iter().filter(is_one).cloned().collect() }
    }
}

fn simulate_everything(basis: &Basis) -> (Table, Truth) {
    let fields = [
        field("cv_max", 0.8, 0.08),
        field("ln_tau_in", -2.5, 0.25),
        field("tau_out", 12.0, 2.0),
        field("tau_open", 120.0, 8.0),
        field("apd_max", 180.0, 8.0),
    ];
    let fields = fields.concat();
    let mut given: Vec<(&str, f64)> = fields.iter().map(|(name, u)| (name.as_str(), *u)).collect();
    given.extend([("apd_noise", 2f64.ln()), ("cv_noise", 0.01f64.ln())]);
    let mut table = everything(20);
    let truth = simulate(shipped("joint"), Some(basis), &mut table, &given, 17);
    (table, truth)
}

#[test]
#[ignore = "gradients through a hundred terms for each of 160 measurements, minutes"]
fn joint_recovers_all_five_parameters_from_measurements_at_different_sites() {
    let basis = basis(VERTICES, 16);
    let (table, truth) = simulate_everything(&basis);
    let good = fit(shipped("joint"), Some(&basis), &table.read(), 600);
    assert_recovered(&good, &truth, Some(&basis));
    assert!(good.worst_r_hat().0 < 1.02);
    let mut late = table;
    for row in &mut late.rows {
        if let Ok(s2) = row[2].parse::<f64>() {
            row[2] = (s2 + 40.0).to_string();
        }
    }
    let twin = fit(shipped("joint"), Some(&basis), &late.read(), 200);
    assert_found_out(&twin, &truth, Some(&basis));
}

/// Mean over the vertices of the posterior standard deviation of each field.
#[test]
#[ignore = "prints what each kind of measurement adds, minutes"]
fn what_each_measurement_adds() {
    let basis = basis(VERTICES, 16);
    let (table, truth) = simulate_everything(&basis);
    let erp = ["s1s2", "s1s2s3"];
    let parts: [(&str, &dyn Declare, Table); 3] = [
        ("ERP", &joint_parts::Erp, table.of(&erp)),
        ("ERP and APD", &joint_parts::ErpApd, table.of(&[erp[0], erp[1], "apd"])),
        ("ERP, APD and CV", shipped("joint"), table),
    ];
    println!("cv_max, ln tau_in, tau_out, tau_open, apd_max");
    for (name, model, table) in parts {
        let fit = fit(model, Some(&basis), &table.read(), 600);
        let draws = thinned(&fit.chains, usize::MAX).unwrap();
        let sds = field_moments(&fit.model, &basis, &draws).1;
        let means: Vec<f64> =
            sds.iter().map(|sd| sd.iter().sum::<f64>() / VERTICES as f64).collect();
        println!("{name}: {means:.3?}, R-hat {:?}", fit.worst_r_hat());
        println!("  worst score {:?} of the limit", worst(&fit, &truth, Some(&basis)));
    }
}

#[test]
fn recovery_recovers_its_field_and_noise() {
    let basis = basis(VERTICES, 24);
    let given = [
        ("recovery.m", 90.0),
        ("recovery.alpha", 12f64.ln()),
        ("recovery.rho", 50f64.ln()),
        ("noise", 3f64.ln()),
    ];
    let row = |i: usize| [&(4 * i).to_string(), "s1s2", "80", "90"].map(String::from).to_vec();
    let rows = (0..45).map(row).collect();
    let mut table = Table { header: "vertex,protocol,lower,upper", rows };
    let truth = simulate(shipped("recovery"), Some(&basis), &mut table, &given, 7);
    let good = fit(shipped("recovery"), Some(&basis), &table.read(), 1000);
    assert_recovered(&good, &truth, Some(&basis));
    let twin = fit(shipped("recovery"), Some(&basis), &displaced(&table, 15.0).read(), 400);
    assert_found_out(&twin, &truth, Some(&basis));
}

#[test]
fn restitution_recovers_its_ratio_from_two_amplitudes() {
    let mut rng = rng(11);
    let truth = Truth { reported: vec![0.8, 0.07], fields: vec![] };
    let mut row = |_| {
        let before = rng.random_range(50.0..300.0);
        let ratio = truth.reported[0] + truth.reported[1] * rng.sample::<f64, _>(StandardNormal);
        [before, before * ratio]
    };
    let rows: Vec<[f64; 2]> = (0..120).map(&mut row).collect();
    // amplitudes above a baseline that was not taken away are another ratio
    let read = |baseline: f64| {
        let line = |r: &[f64; 2]| format!("{},{}", r[0] + baseline, r[1] + baseline);
        table("amp_s1,amp_s2", &rows.iter().map(line).collect::<Vec<_>>())
    };
    assert_recovered(&fit(shipped("restitution"), None, &read(0.0), 500), &truth, None);
    assert_found_out(&fit(shipped("restitution"), None, &read(40.0), 500), &truth, None);
}

#[test]
fn a_measurement_is_computed_from_columns_or_refused() {
    let new = |rows: &[&str]| {
        let rows: Vec<String> = rows.iter().map(ToString::to_string).collect();
        Model::new(shipped("restitution"), None, &table("amp_s1,amp_s2", &rows))
    };
    let model = new(&["100,80", "100,", "50,30"]).unwrap();
    assert_eq!(model.observes[0].rows, [0, 2], "a row without an amplitude holds no measurement");
    assert_eq!(model.observes[0].observed(), [[0.8], [0.6]]);
    let text = new(&["100,80", "0,80"]).unwrap_err().to_string();
    assert!(text.contains("line 3, column `amp_s1, amp_s2`"), "{text}");
    assert!(text.contains("row.amp_s2 / row.amp_s1 = inf"), "{text}");
    let missing = table("amp_s1,amp", &["1,2".into()]);
    let text = Model::new(shipped("restitution"), None, &missing).unwrap_err().to_string();
    assert!(text.contains("no column `amp_s2`, which observe ratio reads"), "{text}");
}

#[test]
fn lat_recovers_onset_and_slowness() {
    let given = [("onset", 20.0), ("slowness", 1.3), ("noise", 6f64.ln())];
    let mut rng = rng(12);
    let mut row = |_| vec![rng.random_range(0.0..120.0f64).to_string(), "0".into()];
    let mut table = Table { header: "path_mm,lat", rows: (0..100).map(&mut row).collect() };
    let truth = simulate(shipped("lat"), None, &mut table, &given, 13);
    assert_recovered(&fit(shipped("lat"), None, &table.read(), 500), &truth, None);
    // straight lines instead of paths are shorter
    for row in &mut table.rows {
        row[0] = (0.8 * row[0].parse::<f64>().unwrap()).to_string();
    }
    assert_found_out(&fit(shipped("lat"), None, &table.read(), 500), &truth, None);
}

#[test]
fn erp_multiscale_recovers_fields() {
    let basis = basis(VERTICES, 60);
    let given = [
        ("tau_out.m", 12.0),
        ("tau_out.alpha", 3f64.ln()),
        ("tau_out.rho", 70f64.ln()),
        ("tau_out.beta", 1f64.ln()),
        ("tau_out.ell", 18f64.ln()),
        ("apd_max.m", 195.0),
        ("apd_max.alpha", 15f64.ln()),
        ("apd_max.rho", 70f64.ln()),
        ("apd_max.beta", 4f64.ln()),
        ("apd_max.ell", 18f64.ln()),
    ];
    recovers_fields(shipped("erp_multiscale"), &basis, &given);
}

/// Fields of this truth are found from 25 sites, and not from brackets that are displaced; gives the truth.
fn recovers_fields(model: &dyn Declare, basis: &Basis, given: &[(&str, f64)]) -> Truth {
    let mut table = sites(25);
    let truth = simulate(model, Some(basis), &mut table, given, 6);
    assert_recovered(&fit(model, Some(basis), &table.read(), 600), &truth, Some(basis));
    let twin = fit(model, Some(basis), &displaced(&table, 20.0).read(), 400);
    assert_found_out(&twin, &truth, Some(basis));
    truth
}

#[test]
fn a_prior_a_kernel_a_likelihood_and_a_form_of_the_users_own() {
    let basis = basis(VERTICES, 24);
    let row = |i: usize| {
        let protocol = if i.is_multiple_of(3) { "offset_seen" } else { "arrival" };
        vec![(2 * i).to_string(), protocol.to_string(), "0".into(), (7 * i % 24).to_string()]
    };
    let mut table =
        Table { header: "vertex,protocol,value,hour", rows: (0..90).map(row).collect() };
    let given = [
        ("offset", 3.0),
        ("noise", 1f64.ln()),
        ("delay.m", 18.0),
        ("delay.alpha", 6f64.ln()),
        ("delay.rho", 50f64.ln()),
        ("clock[0]", 3.0),
        ("clock[1]", -2.0),
    ];
    let truth = simulate(shipped("custom"), Some(&basis), &mut table, &given, 4);
    let good = fit(shipped("custom"), Some(&basis), &table.read(), 400);
    assert_recovered(&good, &truth, Some(&basis));
}

/// Checks the means of [`language::vector_priors`] against their closed forms.
fn assert_vector_priors(fit: &Fit) {
    // the largest of three standard normals has the mean 3/(2√π)
    let extreme = 2.0 * 1.5 / std::f64::consts::PI.sqrt();
    let expected = [
        ("share[0]", 0.25),
        ("share[3]", 0.25),
        ("cut[0]", -extreme),
        ("cut[1]", 0.0),
        ("cut[2]", extreme),
        ("noise[1]", 3.0 * (2.0 / std::f64::consts::PI).sqrt()),
        ("bounded[0]", 0.5),
    ];
    for (name, mean) in expected {
        let s = fit.get(name);
        assert!((s.mean - mean).abs() < limit(9) * s.mcse, "{name}: {} {mean}", s.mean);
    }
    // Var of a symmetric Dirichlet's proportion: (n − 1)/(n² (na + 1)) = 3/(16 · 9)
    for name in ["share[0]", "share[3]"] {
        let s = fit.get(name);
        let sd = (3.0f64 / 144.0).sqrt();
        // an sd's error is about its own over √(2 ESS); a proportion's tails are lighter than a normal's
        let error = sd / (2.0 * s.ess_tail.min(s.ess_bulk)).sqrt();
        assert!((s.sd - sd).abs() < limit(9) * error, "{name}: {} {sd}", s.sd);
    }
}

#[test]
fn constrained_vectors_sample_their_priors() {
    let fit = fit(&language::vector_priors::VectorPriors, None, &Measurements::default(), 2000);
    assert_vector_priors(&fit);
    assert_eq!(fit.model.unknown_names().len(), 3 + 3 + 2 + 2);
}

fn prior(model: &dyn Declare, basis: Option<&Basis>, data: &Measurements, draws: usize) -> Fit {
    let model = Model::new(model, basis, data).unwrap();
    let chains = model.prior_draws(&Settings { draws, ..Settings::default() }).unwrap();
    Fit { model, chains }
}

#[test]
fn draws_from_the_prior_have_its_moments() {
    let vectors = &language::vector_priors::VectorPriors;
    assert_vector_priors(&prior(vectors, None, &Measurements::default(), 2000));

    // a field: m ~ Normal(20, 5), alpha ~ HalfNormal(5)
    let basis = basis(VERTICES, 24);
    let mut data =
        table("vertex,protocol,value,hour", &["0,arrival,0,3".into(), "4,offset_seen,0,".into()]);
    data.place_at_indices(VERTICES).unwrap();
    let fit = prior(shipped("custom"), Some(&basis), &data, 2000);
    let alpha = fit.get("delay.alpha");
    let expected = 5.0 * (2.0 / std::f64::consts::PI).sqrt();
    assert!((alpha.mean - expected).abs() < limit(2) * alpha.mcse, "{} {expected}", alpha.mean);
    let draws = thinned(&fit.chains, usize::MAX).unwrap();
    let (means, sds) = field_moments(&fit.model, &basis, &draws);
    let error = sds[0][17] / (draws.len() as f64).sqrt();
    assert!((means[0][17] - 20.0).abs() < limit(2) * error, "{} ± {error}", means[0][17]);
    assert!(sds[0][17] > 5.5, "the prior of the mean alone has 5: {}", sds[0][17]);
}

#[test]
fn a_prior_that_cannot_be_drawn_from_is_named() {
    let basis = basis(VERTICES, 60);
    let basis = Some(&basis);
    let model = Model::new(shipped("erp_multiscale"), basis, &sites(3).read()).unwrap();
    let text = model.prior_draws(&Settings::default()).unwrap_err().to_string();
    assert!(
        text.starts_with("tau_out.m ~ Flat: no draw can be made from this prior\nhelp: "),
        "{text}"
    );
}

#[test]
fn voltage_recovers_map_and_noise() {
    let basis = basis(VERTICES, 64);
    let row = |i: usize| vec![(2 * i).to_string(), "bipolar".into(), "1".into()];
    let mut table = Table { header: "vertex,protocol,value", rows: (0..100).map(row).collect() };
    let given = [
        ("voltage.m", 3.0),
        ("voltage.alpha", 1.5f64.ln()),
        ("voltage.rho", 20f64.ln()),
        ("noise", 0.4f64.ln()),
    ];
    let truth = simulate(shipped("voltage"), Some(&basis), &mut table, &given, 12);
    let good = fit(shipped("voltage"), Some(&basis), &table.read(), 500);
    assert_recovered(&good, &truth, Some(&basis));
    let twin = fit(&broken::voltage::Voltage, Some(&basis), &table.read(), 500);
    assert_found_out(&twin, &truth, Some(&basis));
}

#[test]
fn erp_population_recovers_three_patients_and_what_they_share() {
    let basis = basis(VERTICES, 24);
    let row = |i: usize| {
        let (patient, protocol) = (["a", "b", "c"][i % 6 / 2], ["s1s2", "s1s2s3"][i % 2]);
        let vertex = 7 * (i / 6) + i % 6 / 2;
        vec![vertex.to_string(), patient.into(), protocol.into(), "200".into(), "210".into()]
    };
    let mut table = Table {
        header: "vertex,patient,protocol,lower,upper",
        rows: (0..6 * 14).map(row).collect(),
    };
    let given = [
        ("tau_out.alpha", 2.6f64.ln()),
        ("tau_out.rho", 64f64.ln()),
        ("tau_mean", 12.0),
        ("tau_sd", 1f64.ln()),
        ("apd_max.alpha", 13f64.ln()),
        ("apd_max.rho", 50f64.ln()),
        ("apd_mean", 195.0),
        ("apd_sd", 5f64.ln()),
        ("tau_out.m[a]", 11.0),
        ("tau_out.m[b]", 12.0),
        ("tau_out.m[c]", 13.0),
        ("apd_max.m[a]", 190.0),
        ("apd_max.m[b]", 196.0),
        ("apd_max.m[c]", 200.0),
    ];
    let truth = simulate(shipped("erp_population"), Some(&basis), &mut table, &given, 13);
    let good = fit(shipped("erp_population"), Some(&basis), &table.read(), 500);
    assert_recovered(&good, &truth, Some(&basis));
    // the same truth with one patient's rows taken for another's
    let mut mistaken = Table { header: table.header, rows: table.rows.clone() };
    // but for the first site, so that the labels appear in the same order
    for row in mistaken.rows.iter_mut().skip(6) {
        row[1] = row[1].replace('a', "d").replace('c', "a").replace('d', "c");
    }
    let twin = fit(shipped("erp_population"), Some(&basis), &mistaken.read(), 500);
    assert_found_out(&twin, &truth, Some(&basis));
}

/// 40 patients with 5 sites each and 10 ms brackets: 2,008 unknowns.
#[test]
#[ignore = "40 patients, a minute"]
fn erp_population_recovers_forty_patients() {
    let basis = basis(VERTICES, 24);
    let row = |i: usize| {
        let (patient, site, protocol) = (i / 10, i / 2 % 5, ["s1s2", "s1s2s3"][i % 2]);
        let vertex = (37 * patient + 41 * site) % VERTICES;
        vec![vertex.to_string(), format!("p{patient}"), protocol.into(), "200".into(), "210".into()]
    };
    let header = "vertex,patient,protocol,lower,upper";
    let mut table = Table { header, rows: (0..400).map(row).collect() };
    let mut given: Vec<(String, f64)> = [
        ("tau_out.alpha", 2.6f64.ln()),
        ("tau_out.rho", 64f64.ln()),
        ("tau_mean", 12.0),
        ("tau_sd", 1f64.ln()),
        ("apd_max.alpha", 13f64.ln()),
        ("apd_max.rho", 50f64.ln()),
        ("apd_mean", 195.0),
        ("apd_sd", 5f64.ln()),
    ]
    .map(|(name, u)| (name.to_string(), u))
    .to_vec();
    let mut rng = rng(40);
    for patient in 0..40 {
        for (field, mean, sd) in [("tau_out", 12.0, 1.0), ("apd_max", 195.0, 5.0)] {
            let z: f64 = rng.sample(StandardNormal);
            given.push((format!("{field}.m[p{patient}]"), mean + sd * z));
        }
    }
    let given: Vec<(&str, f64)> = given.iter().map(|(name, u)| (&name[..], *u)).collect();
    let truth = simulate(shipped("erp_population"), Some(&basis), &mut table, &given, 13);
    let fit = fit(shipped("erp_population"), Some(&basis), &table.read(), 500);
    assert_eq!(Sampler::of(&fit.model), Sampler::Blocked);
    assert_recovered(&fit, &truth, Some(&basis));
}

#[test]
fn erp_robust_recovers_fields_within_their_ranges() {
    let basis = basis(VERTICES, 128);
    let given = [
        ("tau_out.m", 20.0),
        ("tau_out.alpha", 6f64.ln()),
        ("tau_out.rho", 50f64.ln()),
        ("apd_max.m", 195.0),
        ("apd_max.alpha", 25f64.ln()),
        ("apd_max.rho", 50f64.ln()),
        ("discrepancy", 1.5f64.ln()),
    ];
    let truth = recovers_fields(shipped("erp_robust"), &basis, &given);
    assert!(truth.fields[0].iter().all(|x| (1.0..=30.0).contains(x)));
}
