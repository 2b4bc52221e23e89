//! Simulation-based calibration: parameters drawn from the prior, measurements simulated from them, and fitted. The
//! ranks of what was drawn among the fit's thinned draws are uniform if the sampler, its warm-up and every map between
//! unknowns and measurements are right.
//!
//! The ERP model with proper priors, the model for conclusions that rest on intervals, five fields together, and arrival
//! times, 200 fits each (`FITS=…` for more, `FIRST=200` to go on after the first 200; `SAMPLER=nuts` for the other sampler of
//! the first and the third):
//!
//! ```text
//! cargo test --release --test sbc -- --ignored --nocapture
//! ```
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "support/posterior.rs"]
mod posterior;
#[path = "models/proper.rs"]
mod proper;
#[path = "support/ranks.rs"]
mod ranks;
mod support;

use eplat::experiment::TRUTH_MODES;
use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::manifold::{Basis, eigenpairs, eigenpairs_cached, maximin};
use eplat::mesh::{Surface, left_atrium};
use eplat::model::{Asked, Declare, Kind, Maps, Model, Sampler};
use eplat::table::Measurements;
use posterior::all;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use ranks::Uniformity;
use rayon::prelude::*;
use support::{rng, table};

/// Draws that a truth is ranked among; every tenth of a chain.
const RANKED: usize = 99;
const THIN: usize = 10;
/// Places where fields are compared but not measured.
const UNSEEN: usize = 3;
/// Fits of a broken twin, where they take long.
const MOST_OF_A_TWIN: usize = 100;
/// Chance of a false alarm over all quantities and both tests.
const ALPHA: f64 = 0.01;

/// An experiment that is made again and again.
struct Design<'a> {
    /// What parameters and measurements are drawn from.
    truth: &'a dyn Declare,
    /// What is fitted to them.
    fitted: &'a dyn Declare,
    /// At the sites, then at places where nothing is measured.
    basis: Basis,
    /// A table of the right shape.
    blank: Measurements,
    /// Measurements of a truth at a position of its unknowns.
    measure: fn(&Design<'_>, &Model, &[f64], &mut ChaCha8Rng) -> Measurements,
    sampler: Option<Sampler>,
}

/// Fields and `let`s at every vertex of the basis, by name, at a position of the unknowns.
fn maps(model: &Model, basis: &Basis, position: &[f64]) -> Vec<(String, Vec<f64>)> {
    let maps = Maps::new(model, basis).summarise(&[position.to_vec()], &Asked::default()).maps;
    maps.into_iter().map(|map| (map.name, map.mean)).collect()
}

/// Everything that is ranked, with its name: parameters, fields and `let`s where nothing was measured, and
/// the log likelihood.
fn quantities(model: &Model, design: &Design<'_>, position: &[f64]) -> Vec<(String, f64)> {
    let mut tape = model.tape();
    model.forward(&mut tape, position);
    let (mut values, mut out) = (vec![], vec![]);
    model.report(&tape, &mut rng(0), &mut values);
    let mut values = values.into_iter();
    for p in &model.parameters {
        let own = values.by_ref().take(p.len).enumerate();
        let own: Vec<_> = own.map(|(i, x)| (p.element(i), x)).collect();
        out.extend(own.into_iter().filter(|_| p.kind != Kind::Eta));
    }
    for (name, map) in maps(model, &design.basis, position) {
        let unseen = map.iter().enumerate().skip(design.basis.n_vertices() - UNSEEN);
        out.extend(unseen.map(|(v, x)| (format!("{name} at {v}"), *x)));
    }
    let mut pointwise = vec![];
    model.pointwise(&tape, &mut pointwise);
    out.push(("log likelihood".to_owned(), pointwise.iter().sum()));
    out
}

impl Design<'_> {
    /// Ranks of every quantity `(quantity, fit)` with its name.
    fn ranks(&self, n_fits: usize) -> Vec<(String, Vec<usize>)> {
        let truth = Model::new(self.truth, Some(&self.basis), &self.blank).unwrap();
        let first = number("FIRST").unwrap_or(0);
        let settings = Settings { chains: 1, draws: first + n_fits, ..Settings::default() };
        let drawn = truth.prior_draws(&settings).unwrap().remove(0);
        let fits: Vec<Vec<(String, usize)>> = (first..first + n_fits)
            .into_par_iter()
            .map(|fit| self.fit(&truth, &drawn.draw(fit).unwrap(), fit as u64))
            .collect();
        let names = fits[0].iter().map(|(name, _)| name.clone()).enumerate();
        names.map(|(i, name)| (name, fits.iter().map(|fit| fit[i].1).collect())).collect()
    }

    fn fit(&self, truth: &Model, position: &[f64], seed: u64) -> Vec<(String, usize)> {
        let data = (self.measure)(self, truth, position, &mut rng(1000 + seed));
        let model = Model::new(self.fitted, Some(&self.basis), &data).unwrap();
        let settings = Settings {
            chains: 1,
            warmup: 500,
            draws: RANKED * THIN,
            seed: 1_000_000 + seed,
            threads: 1,
            ..Settings::default()
        };
        let starts = jittered_starts(&model, &model.initial(), 1, settings.seed).unwrap();
        let sampler = self.sampler.unwrap_or(Sampler::of(&model));
        let chain = all(sampler.sample(&model, &starts, &settings, &Silent).unwrap()).remove(0);
        let exact = quantities(&model, self, position);
        let mut ranks: Vec<(String, usize)> =
            exact.iter().map(|(name, _)| (name.clone(), 0)).collect();
        for i in (THIN - 1..chain.n_draws()).step_by(THIN) {
            let drawn = quantities(&model, self, &chain.draw(i).unwrap());
            for ((rank, drawn), exact) in ranks.iter_mut().zip(&drawn).zip(&exact) {
                rank.1 += usize::from(drawn.1 < exact.1);
            }
        }
        ranks
    }
}

/// The least p value of both tests over all quantities times their number, and whose it is.
fn least_p(ranks: &[(String, Vec<usize>)], n_fits: usize) -> (f64, String) {
    let tests = Uniformity::new(n_fits, RANKED);
    let p_values = ranks.iter().flat_map(|(name, ranks)| {
        let p_values = tests.p_values(&ranks[..n_fits]);
        ["chi-square", "band"]
            .into_iter()
            .zip(p_values)
            .map(move |(test, p)| (p, format!("{name}, {test}")))
    });
    let (p, name) = p_values.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    (p * 2.0 * ranks.len() as f64, name)
}

/// The first modes at `n_sites` sites of the embedded atrium and at places between them.
fn atrium(n_sites: usize, n_modes: usize) -> Basis {
    let atrium = left_atrium(1.5);
    let all = eigenpairs_cached(&atrium.mesh, TRUTH_MODES).unwrap();
    let sites = maximin(&atrium.mesh, n_sites, 6.0, 1).unwrap();
    let unseen: [usize; UNSEEN] = [500, 2000, 4000];
    let places = sites.iter().map(|v| *v as usize).chain(unseen);
    Basis {
        eigenvalues: all.eigenvalues[..n_modes].to_vec(),
        eigenfunctions: places.flat_map(|v| all.at(v)[..n_modes].to_vec()).collect(),
    }
}

fn placed(header: &str, rows: &[String], basis: &Basis) -> Measurements {
    let mut data = table(header, rows);
    data.place_at_indices(basis.n_vertices()).unwrap();
    data
}

/// A 10 ms bracket of `erp`, as the likelihood has it, which is widened by a `variance`: the value is taken for the
/// centre c of a sub-interval of s = 1 ms with a probability proportional to `exp(−(erp − c)²/2(s² + variance))`.
fn bracket(erp: f64, variance: f64, rng: &mut ChaCha8Rng) -> [f64; 2] {
    let wide = 1.0 + variance;
    let reach = (9.0 * wide.sqrt()).ceil() as i32;
    let centres = (-reach..=reach).map(|i| erp.floor() + f64::from(i) + 0.5);
    let weights: Vec<(f64, f64)> =
        centres.map(|c| (c, (-0.5 * (erp - c).powi(2) / wide).exp())).collect();
    let mut left = rng.random::<f64>() * weights.iter().map(|w| w.1).sum::<f64>();
    let chosen = weights.iter().find(|(_, weight)| {
        left -= weight;
        left < 0.0
    });
    let lower = (chosen.unwrap_or(&weights[reach as usize]).0 / 10.0).floor() * 10.0;
    [lower, lower + 10.0]
}

const BRACKETS: &str = "vertex,protocol,lower,upper";

/// Rows with brackets of both ERPs at the sites, of which the likelihoods are widened by variances `(protocol, vertex)`.
fn bracket_rows(
    at: &[(String, Vec<f64>)],
    variances: [&dyn Fn(usize) -> f64; 2],
    rng: &mut ChaCha8Rng,
) -> Vec<String> {
    let mut rows = vec![];
    for ((protocol, name), variance) in
        [("s1s2", "erp_s2"), ("s1s2s3", "erp_s3")].into_iter().zip(variances)
    {
        let erp = named(at, name);
        for (v, erp) in erp[..erp.len() - UNSEEN].iter().enumerate() {
            let [lower, upper] = bracket(*erp, variance(v), rng);
            rows.push(format!("{v},{protocol},{lower},{upper}"));
        }
    }
    rows
}

fn named<'a>(at: &'a [(String, Vec<f64>)], name: &str) -> &'a [f64] {
    &at.iter().find(|(n, _)| *n == name).unwrap().1
}

/// Brackets of both ERPs at the sites.
fn brackets(
    design: &Design<'_>,
    truth: &Model,
    position: &[f64],
    rng: &mut ChaCha8Rng,
) -> Measurements {
    let at = maps(truth, &design.basis, position);
    let rows = bracket_rows(&at, [&|_| 0.0, &|_| 0.0], rng);
    placed(BRACKETS, &rows, &design.basis)
}

/// The same with the surrogate's errors and so many times the discrepancy that is drawn for `erp_robust.rs`.
fn robust_brackets<const TIMES: u32>(
    design: &Design<'_>,
    truth: &Model,
    position: &[f64],
    rng: &mut ChaCha8Rng,
) -> Measurements {
    let own = (f64::from(TIMES) * parameter("discrepancy", truth, design, position)).powi(2);
    let at = maps(truth, &design.basis, position);
    let rows = bracket_rows(&at, [&|_| 0.25 + own, &|_| 1.0 + own], rng);
    placed(BRACKETS, &rows, &design.basis)
}

const JOINT: &str = "vertex,protocol,lower,upper,s2_ms,value";
/// Coupling intervals of APD and CV, ms.
const COUPLINGS: [u32; 2] = [400, 600];

/// A parameter's value at a position of the unknowns.
fn parameter(name: &str, truth: &Model, design: &Design<'_>, position: &[f64]) -> f64 {
    let all = quantities(truth, design, position);
    all.into_iter().find_map(|(of, x)| (of == name).then_some(x)).unwrap()
}

/// Brackets of both ERPs, APD and CV at the sites; APD has so many times its noise.
fn five_fields<const TIMES: u32>(
    design: &Design<'_>,
    truth: &Model,
    position: &[f64],
    rng: &mut ChaCha8Rng,
) -> Measurements {
    let at = maps(truth, &design.basis, position);
    let [s2, s3] = ["sd_s2", "sd_s3"].map(|name| named(&at, name));
    let brackets = bracket_rows(&at, [&|v| s2[v] * s2[v], &|v| s3[v] * s3[v]], rng);
    let mut rows: Vec<String> = brackets.iter().map(|row| format!("{row},600,")).collect();
    let mut tape = truth.tape();
    truth.forward(&mut tape, position);
    let noise = parameter("apd_noise", truth, design, position);
    let further = noise * f64::from(TIMES * TIMES - 1).sqrt();
    for observe in truth.observes.iter().filter(|o| ["apd", "speed"].contains(&o.name)) {
        let mut value = observe.simulate(&tape, rng);
        if observe.name == "apd" {
            for y in &mut value {
                y[0] += further * rng.sample::<f64, _>(StandardNormal);
            }
        }
        let of_row = |(i, y): (usize, &Vec<f64>)| {
            format!("{},{},,,{},{}", i / 2, observe.name, COUPLINGS[i % 2], y[0])
        };
        rows.extend(value.iter().enumerate().map(of_row));
    }
    placed(JOINT, &rows, &design.basis)
}

/// What the model itself simulates.
fn simulated(truth: &Model, position: &[f64], rng: &mut ChaCha8Rng) -> Vec<f64> {
    let mut tape = truth.tape();
    truth.forward(&mut tape, position);
    truth.observes[0].simulate(&tape, rng).iter().map(|y| y[0]).collect()
}

/// What the model itself simulates at the sites.
fn numbers(
    design: &Design<'_>,
    truth: &Model,
    position: &[f64],
    rng: &mut ChaCha8Rng,
) -> Measurements {
    let simulated = simulated(truth, position, rng);
    let rows: Vec<String> = simulated.iter().enumerate().map(|(v, y)| format!("{v},{y}")).collect();
    placed("vertex,y", &rows, &design.basis)
}

/// The table with arrival times that the model itself simulates.
fn arrivals(
    design: &Design<'_>,
    truth: &Model,
    position: &[f64],
    rng: &mut ChaCha8Rng,
) -> Measurements {
    let mut data = design.blank.clone();
    data.set_numbers("value", &simulated(truth, position, rng));
    data
}

/// What `SAMPLER` names.
fn asked() -> Option<Sampler> {
    std::env::var("SAMPLER").is_ok_and(|s| s == "nuts").then_some(Sampler::Nuts)
}

/// Ranks of the ERP model's fits to what `truth` says.
fn erp_ranks(truth: &dyn Declare, n_fits: usize) -> Vec<(String, Vec<usize>)> {
    let basis = atrium(10, 24);
    let row = |v: usize| ["s1s2", "s1s2s3"].map(|protocol| format!("{v},{protocol},200,210"));
    let blank = placed(BRACKETS, &(0..10).flat_map(row).collect::<Vec<_>>(), &basis);
    let fitted = &proper::erp::ErpProper;
    Design { truth, fitted, basis, blank, measure: brackets, sampler: asked() }.ranks(n_fits)
}

/// The same of the model for conclusions that rest on intervals, with so many times the discrepancy in the measurements.
fn robust_ranks<const TIMES: u32>(n_fits: usize) -> Vec<(String, Vec<usize>)> {
    let basis = atrium(10, 128);
    let row = |v: usize| ["s1s2", "s1s2s3"].map(|protocol| format!("{v},{protocol},200,210"));
    let blank = placed(BRACKETS, &(0..10).flat_map(row).collect::<Vec<_>>(), &basis);
    let (model, measure) = (&proper::robust::Robust, robust_brackets::<TIMES>);
    Design { truth: model, fitted: model, basis, blank, measure, sampler: None }.ranks(n_fits)
}

/// The same of five fields from ERP, APD and CV at the same sites, with so many times the noise in APD.
fn five_field_ranks<const TIMES: u32>(n_fits: usize) -> Vec<(String, Vec<usize>)> {
    const SITES: usize = 5;
    let basis = atrium(SITES, 8);
    let erp = |protocol| (0..SITES).map(move |v| format!("{v},{protocol},200,210,600,"));
    let number = |protocol| {
        let each = move |v| COUPLINGS.map(move |s2| format!("{v},{protocol},,,{s2},0.5"));
        (0..SITES).flat_map(each)
    };
    let rows = erp("s1s2").chain(erp("s1s2s3")).chain(number("apd")).chain(number("speed"));
    let blank = placed(JOINT, &rows.collect::<Vec<_>>(), &basis);
    let (model, measure) = (&proper::joint::JointProper, five_fields::<TIMES>);
    Design { truth: model, fitted: model, basis, blank, measure, sampler: asked() }.ranks(n_fits)
}

/// The same of a small field model.
fn field_ranks(truth: &dyn Declare, sampler: Sampler, n_fits: usize) -> Vec<(String, Vec<usize>)> {
    let basis = atrium(6, 8);
    let blank = placed("vertex,y", &(0..6).map(|v| format!("{v},0")).collect::<Vec<_>>(), &basis);
    let fitted = &proper::field::FieldProper;
    Design { truth, fitted, basis, blank, measure: numbers, sampler: Some(sampler) }.ranks(n_fits)
}

/// The same of arrival times at 20 vertices of a coarse atrium, from two sources each; the model `fitted` may let the first
/// activation start at the second source, too.
fn arrival_ranks(
    truth: &dyn Declare,
    fitted: &dyn Declare,
    n_fits: usize,
) -> Vec<(String, Vec<usize>)> {
    let mesh = left_atrium(3.0).mesh.coarsened(300, &[]).unwrap().mesh;
    let surface = Surface::new(mesh, std::collections::BTreeMap::new());
    let basis = eigenpairs(&surface.mesh, 12).unwrap();
    let n = surface.mesh.n_vertices();
    let second = (n / 2).to_string();
    let row = |i: usize| {
        let sources = [("7", &*second), (&*second, "")];
        sources.map(|(source, further)| format!("lat,{},{source},{further},0", i * n / 20))
    };
    let rows: Vec<String> = (0..20).flat_map(row).collect();
    let mut blank = table("protocol,vertex,source,source2,value", &rows);
    blank.place_on(&surface, 1.0).unwrap();
    blank.probe(&surface, &basis).unwrap();
    Design { truth, fitted, basis, blank, measure: arrivals, sampler: None }.ranks(n_fits)
}

/// Of `FITS`, or of so many.
fn n_fits(usual: usize) -> usize {
    number("FITS").unwrap_or(usual)
}

fn number(variable: &str) -> Option<usize> {
    std::env::var(variable).ok()?.parse().ok()
}

/// Both p values of every quantity; the least of all times their number, and whose it is.
fn told(ranks: &[(String, Vec<usize>)], n_fits: usize) -> (f64, String) {
    let tests = Uniformity::new(n_fits, RANKED);
    for (name, ranks) in ranks {
        let [chi_square, band] = tests.p_values(ranks);
        let mut tenths = [0; 10];
        for rank in ranks {
            tenths[10 * rank / (RANKED + 1)] += 1;
        }
        println!(
            "{name:<16} chi-square p {chi_square:.3}, band p {band:.3}; in each tenth {tenths:?}"
        );
    }
    let (p, name) = least_p(ranks, n_fits);
    println!("least p times the number of tests: {p:.3} ({name})");
    (p, name)
}

/// Fails where ranks are not uniform, or those of a broken twin are, of which there are at most so many fits.
fn judge(
    ranks: impl Fn(usize) -> Vec<(String, Vec<usize>)>,
    what: &str,
    twin: impl Fn(usize) -> Vec<(String, Vec<usize>)>,
    most_of_a_twin: usize,
) {
    let n_fits = n_fits(200);
    let (p, name) = told(&ranks(n_fits), n_fits);
    let n_twin = n_fits.min(most_of_a_twin);
    let twin = least_p(&twin(n_twin), n_twin);
    println!("{what}: {twin:?}");
    assert!(p > ALPHA, "{name}: p = {p} after Bonferroni");
    assert!(twin.0 < ALPHA, "the broken twin goes unseen");
}

#[test]
#[ignore = "200 fits of arrival times and as many of a broken twin, minutes"]
fn arrival_times_are_calibrated() {
    let fitted = &proper::lat::LatProper;
    let slower = |n| arrival_ranks(&proper::lat_slower::LatSlower, fitted, n);
    judge(|n| arrival_ranks(fitted, fitted, n), "activation a fifth slower", slower, usize::MAX);
}

#[test]
#[ignore = "200 fits of arrival times with a thickness and as many of a broken twin, minutes"]
fn thick_fronts_from_two_places_are_calibrated() {
    let fitted = &proper::lat_thick::LatThick;
    let thicker = |n| arrival_ranks(&proper::lat_thicker::LatThicker, fitted, n);
    judge(|n| arrival_ranks(fitted, fitted, n), "fronts twice as thick", thicker, usize::MAX);
}

#[test]
#[ignore = "200 fits of the ERP model and of a broken twin, 2 minutes (6 with SAMPLER=nuts)"]
fn the_erp_model_is_calibrated() {
    let n_fits = n_fits(200);
    let (p, name) = told(&erp_ranks(&proper::erp::ErpProper, n_fits), n_fits);
    let twin = erp_ranks(&proper::erp_larger::ErpLarger, n_fits);
    for n in (40..=n_fits).step_by(40) {
        let (p, name) = least_p(&twin, n);
        println!("amplitudes and lengthscales a fifth larger, {n:>4} fits: p {p:.4} ({name})");
    }
    assert!(p > ALPHA, "{name}: p = {p} after Bonferroni");
    assert!(least_p(&twin, n_fits).0 < ALPHA, "the broken twin goes unseen");
}

#[test]
#[ignore = "200 fits of erp_robust.rs and 100 of a broken twin, a quarter of an hour"]
fn the_robust_model_is_calibrated() {
    let twin = "twice the discrepancy in the measurements";
    judge(robust_ranks::<1>, twin, robust_ranks::<2>, MOST_OF_A_TWIN);
}

#[test]
#[ignore = "200 fits of five fields and 100 of a broken twin, an hour"]
fn five_fields_together_are_calibrated() {
    let twin = "twice the noise in APD";
    judge(five_field_ranks::<1>, twin, five_field_ranks::<2>, MOST_OF_A_TWIN);
}

#[test]
fn a_field_model_is_calibrated_with_either_sampler() {
    const FITS: usize = 200;
    for sampler in [Sampler::Blocked, Sampler::Nuts] {
        let ranks = field_ranks(&proper::field::FieldProper, sampler, FITS);
        let (p, name) = least_p(&ranks, FITS);
        assert!(p > ALPHA, "{sampler:?}, {name}: p = {p} after Bonferroni");
    }
    let twin = field_ranks(&proper::field_noisier::FieldNoisier, Sampler::Blocked, FITS);
    let (p, name) = least_p(&twin, FITS);
    assert!(p < ALPHA, "noise a fifth larger goes unseen: {name}, p = {p}");
}
